# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure the live viewer: updates per second while objects move, and the time from the command to the first picture.

    python bench/bench_viewer.py

An update computes visibility, points of all surfaces, both images and lines of sight, and encodes the messages to the
page. The models are the four experiments, whose robot moves back and forth, and aloha_pot of mujoco-warp with two
people at its table and one moving joint.
"""

from __future__ import annotations

import importlib.resources
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from warpvis.cli import View
from warpvis.scenes import EXPERIMENTS
from warpvis.viewer import Viewer, ViewerState

_UPDATES = 60


def main() -> None:
    """Print a table."""
    print("| scene | objects in the table | points | updates/s |\n|---|---:|---:|---:|")
    for experiment in EXPERIMENTS:
        state = ViewerState(experiment.build(), experiment.agents())
        start = state.agents["robot"].poses[0]
        report(experiment.name, state, lambda k, state=state, start=start: to_and_fro(state, start, k))
    state = View(file=aloha(), robot="teleoperator_pov", human="collaborator_pov").load()
    report("aloha_pot", state, lambda k: state.set_joint("left\\waist", 0.3 * np.sin(k / 5)))
    print(f"\nfrom the command to the page, experiment_3: {first_picture():.1f} s")


def aloha() -> Path:
    """Return the model's file."""
    return Path(str(importlib.resources.files("mujoco_warp") / "test_data" / "aloha_pot" / "scene.xml"))


def to_and_fro(state: ViewerState, start: np.ndarray, k: int) -> None:
    """Move the robot a little."""
    pose = start.copy()
    pose[1] += 0.3 * np.sin(k / 5)
    state.move_agent("robot", pose)


def report(name: str, state: ViewerState, move: Callable[[int], None]) -> None:
    """Print the number of updates per second."""
    with Viewer(state, port=8700) as viewer:
        for k in range(5):
            move(k)
            viewer.page.update(wait=True)
        begin = time.perf_counter()
        for k in range(_UPDATES):
            move(k)
            viewer.page.update(wait=True)
        rate = _UPDATES / (time.perf_counter() - begin)
        snapshot = viewer.page.snapshot
        assert snapshot is not None
        print(f"| {name} | {len(snapshot.rows)} | {len(snapshot.points):,} | {rate:.0f} |")


def first_picture() -> float:
    """Return the time from the command to the printed address, when all that the page shows has been computed."""
    begin = time.perf_counter()
    command = [sys.executable, "-m", "warpvis", "view", "experiment_3", "--port", "8701"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith("http://"):
                break
        seconds = time.perf_counter() - begin
        process.terminate()
    return seconds


if __name__ == "__main__":
    main()
