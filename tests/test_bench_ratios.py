# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The performance regression guard: ratios of simulated times against a table."""

from __future__ import annotations

import gc
import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).resolve().parent.parent / "bench"))

import cpu_all
import gpu_all
from ratios import Contest, Figure, Guard, Workload, measure, read_table, write_table


class Told:
    """A timer of calls that return their own duration."""

    def device_seconds(self, run, calls):
        return run()

    def synchronize(self):
        pass

    def record(self, run):
        return None


def constant(seconds):
    return lambda: seconds


def contest(ours, same=1.0, **peers):
    return Contest(ours, peers, Told(), same)


def workload(name, ours=1.0, **peers):
    return Workload(name, lambda: contest(constant(ours), **{peer: [constant(t)] for peer, t in peers.items()}))


@pytest.fixture(autouse=True)
def no_collection(monkeypatch):
    """Disable garbage collection between calls, which takes a second in a large test process."""
    monkeypatch.setattr(gc, "collect", lambda: 0)


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "card.json"
    write_table(path, "card", {"room": Figure(1000.0, {"bare": 3.5, "rays": 5.0}, "abc1234", "2026-01-01")})
    return path


def guard(table, **options):
    return Guard("card", table, commit="def5678", **options)


def test_fastest_variant_of_a_peer_counts():
    ways = [constant(9.0), constant(3.0), constant(3.3)]
    figure = measure(contest(constant(1.5), bare=ways, rays=[constant(6.0)]), 3)
    assert figure.ms == 1500
    assert figure.ratios == {"bare": pytest.approx(2.0), "rays": pytest.approx(4.0)}


def test_ratio_is_the_median_of_rounds():
    times = iter([1.0, 1.0, 1.0, 50.0, 1.0, 1.0, 1.0])
    assert measure(contest(lambda: next(times), bare=[constant(2.0)]), 5).ratios == {"bare": pytest.approx(2.0)}


def test_disagreeing_values_raise():
    with pytest.raises(RuntimeError, match=r"both sides must agree on 95% of values, got 80\.00%"):
        measure(contest(constant(1.0), same=0.8, bare=[constant(2.0)]), 3)
    with pytest.raises(RuntimeError, match="got nan"):
        measure(contest(constant(1.0), same=float("nan"), bare=[constant(2.0)]), 3)


@pytest.mark.parametrize(("bare", "status"), [(3.5, 0), (9.0, 0), (3.34, 0), (3.3, 1), (1.0, 1)])
def test_more_than_5_percent_lower_is_reported(table, capsys, bare, status):
    assert guard(table).run([workload("room", bare=bare, rays=5.0)]) == status
    said = capsys.readouterr().out
    assert f"room: 1000 ms; bare {bare:g} (3.5), rays 5 (5)" in said
    assert (f"room: bare {bare:g}, {1 - bare / 3.5:.0%} below 3.5 of abc1234 (2026-01-01)" in said) == bool(status)


def test_low_ratio_is_measured_again(table, capsys):
    disturbed = iter([2.0] * 11)
    slow_at_first = Workload("room", lambda: contest(lambda: next(disturbed, 1.0), bare=[constant(3.5)]))
    assert guard(table).run([slow_at_first]) == 0
    said = capsys.readouterr().out
    assert "measured again" in said and "bare 3.5 (3.5)" in said


def test_failing_workload_does_not_stop_the_others(table, capsys):
    def missing():
        raise ModuleNotFoundError("No module named 'newton'", name="newton")

    def broken():
        raise RuntimeError("device lost.\nand more")

    one = guard(table)
    assert one.run([Workload("a", missing), Workload("b", broken), workload("c", bare=2.0)]) == 0
    said = capsys.readouterr().out
    assert "a: newton is not installed; not measured" in said and "b: device lost; not measured" in said
    assert list(one.found) == ["c"] and "bare 2 (new)" in said
    assert guard(table).run([Workload("room", missing)]) == 0
    assert guard(table).run([Workload("room", broken)]) == 1
    assert "room: device lost; the table has it" in capsys.readouterr().out


def test_figures_are_written_incrementally(table, tmp_path):
    out, before = tmp_path / "new" / "out.json", table.read_text()

    def cut_off():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        guard(table, out_path=out).run([workload("room", bare=2.0), Workload("next", cut_off)])
    assert read_table(out)["room"].ratios == {"bare": pytest.approx(2.0)}
    assert read_table(out)["room"].commit == "def5678"
    assert table.read_text() == before


def test_update_keeps_figures_that_were_not_measured(table):
    one = guard(table, update=True)
    assert one.run([workload("new", bare=2.0)]) == 0
    rows = read_table(table)
    assert rows["room"].commit == "abc1234" and rows["new"].commit == "def5678"
    assert json.loads(table.read_text())["machine"] == "card"


def test_no_workload_starts_after_the_time_limit(table, capsys):
    assert guard(table, limit=-1.0).run([workload("room", bare=0.1)]) == 0
    assert "room: -1 s have passed" in capsys.readouterr().out


def test_missing_peer_is_reported(table, capsys):
    guard(table).run([workload("room", bare=3.5)])
    assert "room: rays, which the table has" in capsys.readouterr().out


def test_figures_from_another_machine(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(gpu_all, "TABLES", tmp_path / "tables")
    path, out = gpu_all.table_path("NVIDIA H100 80GB HBM3"), tmp_path / "out.json"
    assert path == tmp_path / "tables" / "NVIDIA_H100_80GB_HBM3.json"
    for ratio, status in ((4.0, 0), (3.0, 1)):
        write_table(out, "NVIDIA H100 80GB HBM3", {"room-320": Figure(1.0, {"bare": ratio}, "aaa", "2026-01-01")})
        assert gpu_all.main(["--figures", str(out), "--update"]) == status
        assert read_table(path)["room-320"].ratios == {"bare": ratio}
    assert "25% below 4 of aaa" in capsys.readouterr().out
    out.write_text("[]")
    assert gpu_all.main(["--figures", str(out)]) == 2
    assert "--figures must be a file of --out, got" in capsys.readouterr().err


@pytest.mark.slow
def test_workload_names_are_unique_and_one_runs_on_a_cpu(tmp_path, capsys):
    assert gpu_all.main(["--device", "cpu", "--list"]) == 0
    names = capsys.readouterr().out.splitlines()
    assert len(names) == len(set(names)) > 90
    out, chosen = tmp_path / "out.json", ["--only", "small-room-1 waited"]
    options = ["--device", "cpu", "--views", "1", "--rounds", "1", "--table", str(tmp_path / "none.json")]
    assert gpu_all.main([*options, *chosen, "--out", str(out)]) == 0
    figure = read_table(out)["small-room-1 waited for"]
    assert figure.ms > 0 and np.isfinite(figure.ratios["bare"])


@pytest.mark.slow
def test_single_core_cpu_workloads_run(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(os, "sched_setaffinity", lambda process, cores: None, raising=False)
    out = tmp_path / "out.json"
    options = ["--table", str(tmp_path / "none.json"), "--rounds", "3", "--out", str(out)]
    assert cpu_all.main([*options, "--only", "classify NumPy", "lidar mj_multiRay"]) == 0
    assert "not measured" not in capsys.readouterr().out
    assert {name: list(row.ratios) for name, row in read_table(out).items()} == {
        "classify NumPy": ["NumPy"],
        "lidar mj_multiRay": ["mj_multiRay"],
    }
