# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the process that runs templates: limits beyond those of the engines, and its end with the parent."""

import importlib.util
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from warpvis.errors import FileFormatError
from warpvis.webots import load_webots
from warpvis.webots.protos import _expansion as expansion, _template_engine as engines, _templates as templates
from warpvis.webots.protos._expansion import Protos

from support.webots_protos import Project

needs_engines = pytest.mark.skipif(
    importlib.util.find_spec("quickjs") is None or importlib.util.find_spec("lupa") is None, reason="no engines"
)
pytestmark = needs_engines
JAVASCRIPT = "# template language: javascript\n"
LONG = 60  # s; a process that does not end would run for minutes or forever


@pytest.fixture
def project(tmp_path):
    return Project(tmp_path)


def sphere(radius):
    return f'Solid {{ name "it" children Shape {{ geometry Sphere {{ radius {radius} }} }} }}'


# C code inside the engines, which their own limits do not interrupt.
ENDLESS = {
    "lua pattern": ("", '%{ local _ = ("a"):rep(20000):find(".-.-.-.-.-b") }%'),
    "what is thrown": (JAVASCRIPT, "%< throw {toString() { while (true) { } }}; >%"),
    "javascript search": (
        JAVASCRIPT,
        "%< const a = 'a'.repeat(2 ** 22); const b = 'a'.repeat(2 ** 21) + 'b'; a.indexOf(b); >%",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", ENDLESS)
def test_native_code_is_stopped_by_the_time_limit(case, project, monkeypatch):
    monkeypatch.setattr(templates, "SECONDS", 1)
    head, program = ENDLESS[case]
    project.proto("Endless", "", program + sphere(1), head=head)
    project.proto("Fine", "", "%< const r = 2; >%" + sphere("%<= r >%"), head=JAVASCRIPT)
    world = project.world("Endless { } Fine { }")
    protos = Protos(world)
    start = time.monotonic()
    with pytest.raises(FileFormatError, match=r"Endless.proto:\d+: expected a template that runs, got one that runs"):
        protos.expand(world.nodes[0])
    assert time.monotonic() - start < LONG
    assert protos.expand(world.nodes[1]).type == "Solid"  # in another process
    protos.close()


@pytest.mark.slow
def test_world_loads_despite_endless_templates(project, monkeypatch):
    monkeypatch.setattr(templates, "SECONDS", 1)
    project.proto("Endless", "", ENDLESS["lua pattern"][1] + sphere(1))
    path = project.root / "worlds" / "w.wbt"
    path.write_text(f"#VRML_SIM R2023b utf8\n{sphere(1)}\nEndless {{ }} Endless {{ }}\n")
    with pytest.warns(UserWarning, match="ignored the file of Endless: .*one that runs longer than 1 s"):
        world = load_webots(path)
    assert len(world.scene) == 1 and world.skipped == {"Endless": 2}


def test_memory_is_limited(project, monkeypatch):
    """For the whole process, including memory that an engine does not count."""
    monkeypatch.setattr(templates, "_MEMORY", 64 << 20)
    monkeypatch.setattr(templates, "_HEAP", 4 << 30)
    program = "%< let s = []; for (let i = 0; i < 100; ++i) s.push(new Uint8Array(2 ** 24).fill(i)); >%"
    project.proto("Large", "", program + sphere(1), head=JAVASCRIPT)
    with pytest.raises(FileFormatError, match=r"Large.proto:\d+: expected a template that runs, got "):
        project.expand("Large { }")


def test_one_process_runs_all_templates_of_a_world(project, monkeypatch):
    started = []

    class Popen(subprocess.Popen):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            if str(engines._SCRIPT) in self.args:  # Warp queries the processor's name at startup
                started.append(self)

    monkeypatch.setattr(engines.subprocess, "Popen", Popen)
    project.proto("Ball", "field SFFloat r 1", sphere("%<= fields.r.value >%"), head=JAVASCRIPT)
    project.proto("Old", "field SFFloat r 1", sphere("%{= fields.r.value }%"))
    path = project.root / "worlds" / "w.wbt"
    balls = " ".join(f"Ball {{ r {k} }} Old {{ r {k} }}" for k in range(1, 20))
    path.write_text(f"#VRML_SIM R2023b utf8\n{balls}\n")
    assert len(load_webots(path).scene) == 38
    assert len(started) == 1 and started[0].returncode is not None  # and it has ended
    path.write_text(f"#VRML_SIM R2023b utf8\n{sphere(1)}\n")
    load_webots(path)
    assert len(started) == 1  # a world without templates needs none


def test_frozen_program_is_not_started_for_templates(project, monkeypatch):
    # Its executable is the program itself, which would start, read the world, and start itself again.
    monkeypatch.setattr(sys, "frozen", True, raising=False)
    monkeypatch.setattr(engines.subprocess, "Popen", None)
    project.proto("Ball", "", sphere("%<= 1 >%"), head=JAVASCRIPT)
    with pytest.raises(
        FileFormatError, match=r"no process to run it in: sys.executable must be a Python interpreter, got none"
    ):
        project.expand("Ball { }")


@pytest.mark.slow
def test_templates_of_a_world_share_a_time_limit(project, monkeypatch):
    monkeypatch.setattr(engines, "WORLD_SECONDS", 0.5)
    busy = "%< let n = 0; for (let i = 0; i < 3e7; ++i) n += i; >%"
    project.proto("Slow", "field SFInt32 k 0", busy + sphere("%<= fields.k.value + 1 >%"), head=JAVASCRIPT)
    world = project.world(" ".join(f"Slow {{ k {k} }}" for k in range(50)))
    protos = Protos(world)
    with pytest.raises(FileFormatError, match=r"ones of a world that together run longer than 0.5 s"):
        for node in world.nodes:
            protos.expand(node)
    protos.close()


def test_failed_template_is_not_run_again(project, monkeypatch):
    asked = []
    run = engines.TemplateEngine.run
    monkeypatch.setattr(engines.TemplateEngine, "run", lambda self, job: asked.append(job) or run(self, job))
    project.proto("Wrong", "", "%< nothing(); >%" + sphere(1), head=JAVASCRIPT)
    world = project.world("Wrong { } Wrong { }")
    protos = Protos(world)
    for node in world.nodes:
        with pytest.raises(FileFormatError, match="nothing is not defined"):
            protos.expand(node)
    assert len(asked) == 1
    protos.close()


def test_number_of_proto_instances_is_limited(project, monkeypatch):
    """26 nested pairs stand for 67 million instances."""
    monkeypatch.setattr(expansion, "MAX_INSTANCES", 2000)
    for k in range(26):
        project.proto(f"D{k}", "", f"Group {{ children [ D{k + 1} {{ }} D{k + 1} {{ }} ] }}")
    project.proto("D26", "", sphere(1))
    path = project.root / "worlds" / "w.wbt"
    path.write_text(f"#VRML_SIM R2023b utf8\n{sphere(1)}\nD0 {{ }}\n")
    with pytest.warns(UserWarning, match="expected at most 2000 instances of PROTOs in a world, got more"):
        world = load_webots(path)
    assert 900 < len(world.scene) < 2000


# ---------------------------------------------------------------------------------- processes, threads, termination


def load_ball(path, queue):
    queue.put(len(load_webots(path).scene))


def ball_world(project):
    project.proto("Ball", "field SFFloat r 1", sphere("%<= fields.r.value >%"), head=JAVASCRIPT)
    path = project.root / "worlds" / "w.wbt"
    path.write_text("#VRML_SIM R2023b utf8\nBall { r 1 } Ball { r 2 }\n")
    return path


@pytest.mark.smoke("fork")
@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_other_processes_start_separate_engines(method, project):
    """Also processes forked while the parent's engine runs."""
    path = ball_world(project)
    world = project.world("Ball { r 1 } Ball { r 2 }")
    protos = Protos(world)
    protos.expand(world.nodes[0])
    own = protos._engine._process.pid
    context = multiprocessing.get_context(method)
    queue = context.Queue()
    others = [context.Process(target=load_ball, args=(path, queue)) for _ in range(2)]
    for other in others:
        other.start()
    assert [queue.get(timeout=LONG) for _ in others] == [2, 2]
    for other in others:
        other.join()
        assert other.exitcode == 0
    assert protos.expand(world.nodes[1]).type == "Solid" and protos._engine._process.pid == own
    protos.close()


def test_forked_copy_starts_a_separate_engine(project):
    path = project.root / "worlds" / "w.wbt"
    ball_world(project)
    world = project.world("Ball { r 1 } Ball { r 2 }")
    protos = Protos(world)
    protos.expand(world.nodes[0])
    own = protos._engine._process.pid
    queue = multiprocessing.get_context("fork").Queue()

    def go_on():
        queue.put((protos.expand(world.nodes[1]).type, protos._engine._process.pid))
        protos.close()

    other = multiprocessing.get_context("fork").Process(target=go_on)
    other.start()
    kind, pid = queue.get(timeout=LONG)
    other.join()
    assert kind == "Solid" and pid != own and path.exists()
    assert protos._engine._process.poll() is None and protos.expand(world.nodes[1]).type == "Solid"
    protos.close()


def test_threads_load_worlds_concurrently(project):
    path = ball_world(project)
    counts = []
    threads = [threading.Thread(target=lambda: counts.append(len(load_webots(path).scene))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert counts == [2] * 4


PARENT = """
import json, os, sys, time
from warpvis.webots.protos._template_engine import TemplateEngine
from warpvis.webots.protos._templates import _javascript_job
engine = TemplateEngine()
job = {**_javascript_job("1;", {}), "language": "javascript", "heap": 1 << 28, "memory": 1 << 30, "seconds": 3}
assert "text" in engine.run(job)
if sys.argv[1] == "held" and os.fork() == 0:
    time.sleep(60)
print(json.dumps([engine._process.pid, os.getpid()]), flush=True)
if sys.argv[1] == "busy":
    program = "const a = 'a'.repeat(2 ** 24); const b = 'a'.repeat(2 ** 23) + 'b'; a.indexOf(b);"
    engine.run({**job, **_javascript_job(program, {}), "limit": 1000})
time.sleep(60)
"""


def is_alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as stat:
            return stat.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.smoke("idle")
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
@pytest.mark.parametrize("case", ["idle", pytest.param("busy", marks=pytest.mark.slow), "held"])
def test_process_ends_with_its_parent(case):
    """Kill the parent while the process is idle, busy, or its pipe is held by another child."""
    parent = subprocess.Popen([sys.executable, "-c", PARENT, case], stdout=subprocess.PIPE, text=True)
    pid, _ = json.loads(next(line for line in parent.stdout if line.startswith("[")))
    holder = None
    try:
        assert is_alive(pid)
        if case == "held":
            holder = next(
                int(name)
                for name in os.listdir("/proc")
                if name.isdigit() and _parent_of(name) == parent.pid and int(name) != pid
            )
        time.sleep(0.3)  # let the job start
        parent.kill()
        parent.wait()
        end = time.monotonic() + LONG
        while is_alive(pid) and time.monotonic() < end:
            time.sleep(0.05)
        assert not is_alive(pid)
        assert holder is None or is_alive(holder)
    finally:
        for each in filter(None, (holder, pid if is_alive(pid) else None)):
            os.kill(each, signal.SIGKILL)
        parent.stdout.close()


def _parent_of(pid):
    try:
        with open(f"/proc/{pid}/stat") as stat:
            return int(stat.read().rpartition(")")[2].split()[1])
    except (FileNotFoundError, ProcessLookupError):
        return None
