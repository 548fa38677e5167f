# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure rangefinder sensors of a MuJoCo model in thousands of worlds against MuJoCo's own sensors, in rays/s.

    python bench/rangefinders.py quadruped.xml [--worlds 4096] [--hills] [--device cuda:0]

The model is any MJCF file with rangefinders, such as the quadruped of dm_control's suite. MuJoCo computes all position
sensors (`mj_sensorPos`) of data with computed poses, on as many threads; warpvis reads the same poses. Readings are
compared first. Calls alternate; the medians are printed, and the time of a call that starts from joint positions.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Sequence

import mujoco
import numpy as np
import warp as wp

from warpvis.core.threads import core_count, run_each
from warpvis.mujoco import Rangefinders, WorldPoses

ROUNDS = 7


def place_worlds(model: mujoco.MjModel, count: int) -> list[mujoco.MjData]:
    """Place the model's first free body at random in each world, slightly above the floor, and move its joints."""
    rng, worlds = np.random.default_rng(0), []
    for _ in range(count):
        data = mujoco.MjData(model)
        data.qpos[:2] += rng.uniform(-10, 10, 2)
        data.qpos[2] += rng.uniform(0, 1.5)
        data.qpos[7:] += rng.normal(scale=0.3, size=model.nq - 7)
        mujoco.mj_fwdPosition(model, data)
        worlds.append(data)
    return worlds


def median_seconds(calls: Sequence[Callable[[], object]]) -> list[float]:
    """Return median times of alternating calls."""
    times: list[list[float]] = [[] for _ in calls]
    for _ in range(ROUNDS):
        for call, seconds in zip(calls, times, strict=True):
            start = time.perf_counter()
            call()
            wp.synchronize()
            seconds.append(time.perf_counter() - start)
    return [statistics.median(seconds) for seconds in times]


def main() -> None:
    """Compare, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("model")
    parser.add_argument("--worlds", type=int, default=4096)
    parser.add_argument("--hills", action="store_true", help="random heights in the model's height fields")
    parser.add_argument("--device", default="cpu")
    options = parser.parse_args()
    model = mujoco.MjModel.from_xml_path(options.model)
    if options.hills:
        model.hfield_data[:] = np.random.default_rng(0).random(len(model.hfield_data)) * 0.1
    worlds, threads = place_worlds(model, options.worlds), core_count()
    finders = Rangefinders(model, device=options.device)
    qpos, poses = np.stack([data.qpos for data in worlds]), WorldPoses.of(worlds)
    parts = np.array_split(np.arange(len(worlds)), threads)
    out = finders.read(poses)

    def theirs(part: np.ndarray) -> None:
        for world in part.tolist():
            mujoco.mj_sensorPos(model, worlds[world])

    run_each(theirs, parts, threads)
    expected = np.stack([data.sensordata[finders.addresses] for data in worlds])
    error = np.abs(out.numpy() - expected) / np.maximum(1, np.abs(expected))
    print(f"{expected.size} readings, {np.sum(error > 1e-5)} of them differ by more than 1e-5")
    print(f"largest difference of the others: {error[error <= 1e-5].max():.1e}")
    calls = (lambda: finders.read(poses, out=out), lambda: run_each(theirs, parts, threads), lambda: finders.read(qpos))
    names = ("warpvis, from poses", f"MuJoCo, {threads} threads", "warpvis, from joint positions")
    for name, seconds in zip(names, median_seconds(calls), strict=True):
        print(f"{name}: {seconds * 1e3:.1f} ms, {expected.size / seconds / 1e6:.2f} M rays/s")


if __name__ == "__main__":
    main()
