# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A two-node Ray cluster that loses a node: the job continues, and Ray's messages are suppressed."""

import io
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from batch_jobs import make_frames, make_scene, run, tree

pytest.importorskip("ray")

pytestmark = [pytest.mark.slow, pytest.mark.skipif(os.name != "posix", reason="needs POSIX")]

CLUSTER = """
import os, sys
os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
from ray.cluster_utils import Cluster
cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
node = cluster.add_node(num_cpus=1)
print("READY", cluster.address, node.all_processes["raylet"][0].process.pid, flush=True)
sys.stdin.read()
cluster.shutdown()
"""

JOB = """
import sys
import warp as wp
sys.path.insert(0, sys.argv[1])
wp.config.log_level = wp.LOG_WARNING
from batch_jobs import make_frames, make_scene, run
print("begins", flush=True)
given = {"engine": "ray", "workers": 2, "threads": None, "address": sys.argv[3]}
run(sys.argv[2], scene=make_scene(), frames=make_frames(1500), **given)
print("ends", flush=True)
"""


def test_job_continues_after_losing_a_node(tmp_path):
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
    cluster = subprocess.Popen([sys.executable, "-c", CLUSTER], **pipes)
    try:
        line = next(line for line in cluster.stdout if line.startswith("READY"))
        _, address, raylet = line.split()
        out = tmp_path / "out"
        command = [sys.executable, "-c", JOB, os.path.dirname(__file__), str(out), address]
        job = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        deadline = time.monotonic() + 120
        while job.poll() is None and (not (out / "shards").is_dir() or len(os.listdir(out / "shards")) < 20):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        os.kill(int(raylet), signal.SIGKILL)
        printed, _ = job.communicate(timeout=180)
    finally:
        cluster.stdin.close()
        cluster.wait(30)
    assert job.returncode == 0 and printed == "begins\nends\n"
    run(tmp_path / "whole", scene=make_scene(), frames=make_frames(1500))
    assert tree(out) == tree(tmp_path / "whole")


def test_ray_messages_at_shutdown_are_suppressed(monkeypatch, capsys):
    """Ray prints delayed messages seconds later or at shutdown, on the thread that shuts it down."""
    import ray

    from warpvis.batch.engines._ray import _cluster as cluster

    monkeypatch.setattr(ray, "is_initialized", lambda: False)
    monkeypatch.setattr(ray, "init", lambda **_: None)
    monkeypatch.setattr(ray, "shutdown", lambda: print("(raylet) kept back") or print("too", file=sys.stderr))
    with cluster(None):
        print("ours")
    assert capsys.readouterr() == ("ours\n", "")


def test_output_of_ray_threads_is_suppressed():
    from warpvis.batch.engines._ray import _WithoutRay as WithoutRay

    there = io.StringIO()
    stream = WithoutRay(there)
    for name in ("ray_listen_error_messages", "mine", "ray_print_logs"):
        thread = threading.Thread(target=print, args=(name,), kwargs={"file": stream}, name=name)
        thread.start()
        thread.join()
    print("main", file=stream, flush=True)
    assert there.getvalue() == "mine\nmain\n" and not stream.isatty()
