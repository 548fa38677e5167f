# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure depth observations of vector environments against `mujoco.Renderer`: steps per second and memory.

``python bench/bench_gymnasium.py`` steps Fetch's PickAndPlace (Gymnasium's Pusher if gymnasium-robotics is missing) in
two workers, forked and spawned, and in eight environments: without images, with depth by `mujoco.Renderer` in a wrapper
like `DepthObservation`, by `DepthObservation`, and by `VectorDepthObservation`. Each row is measured in a separate
process, one after the other. It has environment steps per second, CPU time per step, which depends little on other
processes, and the memory of the process and its workers.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from machine import describe

FETCH, PUSHER = ("FetchPickAndPlace-v4", "external_camera_0"), ("Pusher-v5", -1)
MAX_GROWTH = 0.05
"""Largest growth of memory from a tenth of the steps to the end."""

# Name, images, start method of the workers (None without workers), number of environments.
RUNS: list[tuple[str, str, str | None, int]] = [
    ("no images, fork", "none", "fork", 2),
    ("mujoco.Renderer, fork", "gl", "fork", 2),
    ("DepthObservation, fork", "single", "fork", 2),
    ("VectorDepthObservation, fork", "vector", "fork", 2),
    ("mujoco.Renderer, spawn", "gl", "spawn", 2),
    ("DepthObservation, spawn", "single", "spawn", 2),
    ("VectorDepthObservation, spawn", "vector", "spawn", 2),
    ("mujoco.Renderer, fork", "gl", "fork", 8),
    ("DepthObservation, fork", "single", "fork", 8),
    ("VectorDepthObservation, fork", "vector", "fork", 8),
    ("VectorDepthObservation, no workers", "vector", None, 8),
]


def make(images: str, name: str, camera: int | str, size: int) -> Any:
    """Make one environment, as a worker does."""
    import gymnasium as gym
    import warp as wp

    from warpvis.mujoco.gymnasium import DepthObservation, PoseObservation

    wp.config.log_level = wp.LOG_WARNING
    if name.startswith("Fetch"):
        import gymnasium_robotics

        gym.register_envs(gymnasium_robotics)
    env = gym.make(name)
    if images == "gl":
        return gl_wrapper()(env, camera, size)
    if images == "single":
        return DepthObservation(env, camera=camera, width=size, height=size)
    return PoseObservation(env) if images == "vector" else env


def gl_wrapper() -> Callable[..., Any]:
    """Depth as an observation, rendered by `mujoco.Renderer` as `DepthObservation` renders it."""
    import gymnasium as gym
    import mujoco

    class GlDepthObservation(gym.ObservationWrapper):
        def __init__(self, env: gym.Env, camera: int | str, size: int) -> None:
            super().__init__(env)
            self._camera, self._size, self._renderer = camera, size, None
            known = env.observation_space
            spaces = dict(known.spaces) if isinstance(known, gym.spaces.Dict) else {"state": known}
            depth = gym.spaces.Box(0.0, np.inf, (size, size), np.float32)
            self.observation_space = gym.spaces.Dict({**spaces, "depth": depth})

        def observation(self, observation: Any) -> dict[str, Any]:
            simulation = self.unwrapped
            if self._renderer is None:
                self._renderer = mujoco.Renderer(simulation.model, self._size, self._size)
                self._renderer.enable_depth_rendering()
            self._renderer.update_scene(simulation.data, self._camera)
            known = observation if isinstance(observation, dict) else {"state": observation}
            return {**known, "depth": self._renderer.render()}

    return GlDepthObservation


def family() -> list[Any]:
    """Return this process and its workers."""
    import psutil

    process = psutil.Process()
    return [process, *process.children(recursive=True)]


def family_memory() -> float:
    """Return their resident memory [MB]; shared pages count once per process."""
    return sum(one.memory_info().rss for one in family()) / 1e6


def family_seconds() -> float:
    """Return the CPU time of all their threads [s]."""
    return sum(sum(one.cpu_times()[:2]) for one in family())


def run_one(index: int, steps: int, size: int) -> dict[str, Any]:
    """Measure one row of the table."""
    import gymnasium as gym

    from warpvis.mujoco.gymnasium import VectorDepthObservation

    _, images, start, count = RUNS[index]
    name, camera = FETCH if importlib.util.find_spec("gymnasium_robotics") else PUSHER
    makers = [partial(make, images, name, camera, size)] * count
    env: Any = gym.vector.SyncVectorEnv(makers) if start is None else gym.vector.AsyncVectorEnv(makers, context=start)
    if images == "vector":
        env = VectorDepthObservation(env, camera=camera, width=size, height=size)
    env.reset(seed=0)
    env.action_space.seed(0)
    steps = steps * 2 // count
    memory = []
    for _ in range(20):
        env.step(env.action_space.sample())
    begun, used = time.perf_counter(), family_seconds()
    for step in range(steps):
        observation, *_ = env.step(env.action_space.sample())
        if step in (steps // 10, steps // 2, steps - 1):
            memory.append(family_memory())
    seconds, used = time.perf_counter() - begun, family_seconds() - used
    if images != "none":
        assert observation["depth"].shape == (count, size, size) and np.isfinite(observation["depth"]).all()
    env.close()
    done = steps * count
    return {"environment": name, "steps": steps, "rate": done / seconds, "used": used / done, "memory": memory}


def main() -> None:
    """Run all cases, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=5000, help="vectorized steps of two environments")
    parser.add_argument("--size", type=int, default=84, help="image width and height [px]")
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    os.environ.setdefault("MUJOCO_GL", "egl")
    if arguments.one is not None:
        print(json.dumps(run_one(arguments.one, arguments.steps, arguments.size)))
        return
    print(describe(["mujoco", "gymnasium", "gymnasium-robotics", "warp-lang"]))
    grown = []
    for index, (label, _, _, count) in enumerate(RUNS):
        command = [
            sys.executable,
            __file__,
            "--one",
            str(index),
            f"--steps={arguments.steps}",
            f"--size={arguments.size}",
        ]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
        line = json.loads(done.stdout.splitlines()[-1])
        first, _, last = line["memory"]
        memory = ", ".join(f"{megabytes:.0f}" for megabytes in line["memory"])
        print(
            f"{line['environment']}, {count} environments, {line['steps']} steps, {label}: {line['rate']:.0f} steps/s, "
            f"{line['used'] * 1e3:.2f} ms of a core each, memory after 10, 50 and 100 %: {memory} MB",
            flush=True,
        )
        if last > first * (1 + MAX_GROWTH):
            grown.append(label)
    if grown:
        sys.exit(f"memory grew: {', '.join(grown)}")


if __name__ == "__main__":
    main()
