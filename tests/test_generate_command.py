# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The command generate: its output, and errors of one sentence; with a generator without geometry."""

from functools import partial

import pytest
from command_line import run_inside
from situation_jobs import FakeGenerator, FakeOptions

from warpvis import situations
from warpvis.batch.situations import open_situations
from warpvis.cli._generate import Generate

pytest.importorskip("sklearn")


def make_options(shortcut="", **options):
    return FakeOptions(options["seed"], shortcut, per_shard=options["per_shard"])


@pytest.fixture(autouse=True)
def fake_generator(monkeypatch):
    monkeypatch.setattr(situations, "SituationGenerator", FakeGenerator)
    monkeypatch.setattr(situations, "SituationOptions", make_options)


def generate(tmp_path, *others, count=60):
    given = ("generate", "--scenes", "procedural", "--out", "out", "--per-shard", "10", "--threads", "1")
    return run_inside(*given, "--count", count, *others, cwd=tmp_path)


def test_generate(tmp_path):
    first = generate(tmp_path, "--seed", "3", "--format", "jsonl", "--license", "mit")
    assert first.returncode == 0, first.stderr
    assert first.stdout.startswith("situations: 60, questions: 120, shards: 6, ")
    assert "60 of them generated in" in first.stdout and "situations/s" in first.stdout
    assert "not tested for shortcuts: 120 questions, too few of their kind" in first.stdout
    assert open_situations(tmp_path / "out")[0].room == {"seed": 0, "kind": "kitchen"}
    text = (tmp_path / "out" / "README.md").read_text()
    command = "--seed 3 --format jsonl --per-shard 10 --license mit --out OUT"
    assert f"warpvis generate --count 60 {command}" in text
    again = generate(tmp_path, "--seed", "3", "--format", "jsonl", "--license", "mit", "--resume")
    assert again.returncode == 0 and "nothing was left to do" in again.stdout
    checked = run_inside("verify", "out", cwd=tmp_path)
    assert checked.returncode == 0 and "complete and intact: 6 of 6 shards (jsonl, " in checked.stdout


WRONG = {
    "format": (("--format", "csv"), "format must be one of webdataset, parquet, jsonl, lerobot, got 'csv'"),
    "scenes": (("--scenes", "house.glb"), "--scenes must be procedural or files of scenes, and house.glb is no file"),
    "count": (("--count", "0"), "--count must be a whole number from 1 up, got 0"),
    "repair": (("--repair",), "--repair requires --resume"),
    "workers": (("--workers", "0"), "--workers must be a whole number from 1 up, got 0"),
    "threshold": (("--shortcut-threshold", "2"), "--shortcut-threshold must be a number from 0 to 1, got 2.0"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_options(tmp_path, name):
    options, message = WRONG[name]
    result = generate(tmp_path, *options)
    assert result.returncode == 2 and message in result.stderr
    assert result.stderr.count("\n") == 1 and not (tmp_path / "out").exists()


def test_shortcut_names_the_option(tmp_path, monkeypatch):
    monkeypatch.setattr(situations, "SituationOptions", partial(make_options, shortcut="text"))
    refused = generate(tmp_path, count=100)
    assert refused.returncode == 2 and "Use --allow-shortcuts to accept this" in refused.stderr
    accepted = generate(tmp_path, "--resume", "--allow-shortcuts", count=100)
    assert accepted.returncode == 0 and "shortcuts: the best is " in accepted.stdout


@pytest.mark.parametrize(("word", "outputs"), [("none", ()), ("depth,seen_by", ("depth", "seen_by"))])
def test_outputs(monkeypatch, word, outputs):
    monkeypatch.setattr(situations, "SituationOptions", dict)
    assert Generate(outputs=(word,), count=1, out="out").options()["outputs"] == outputs
