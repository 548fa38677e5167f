# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure the registration of many pose hypotheses to one depth image: `wv.register`, Open3D and small_gicp, in turns.

``python bench/bench_register.py`` perturbs the true pose of a camera by 5 degrees and 5 cm in random directions, and
prints, for each method, the median time, the errors after 10 iterations, and the fraction of poses within 1 cm and 1
degree. Peers are slow: they are measured on the first ``--subset`` hypotheses, and their times are scaled to all.
``--hypotheses``, ``--scenes`` and ``--sizes`` take lists; ``--device cuda:0`` measures `wv.register` on a GPU, and its
peers on the CPU. Peers register to `--points` points on all surfaces, visible or not.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from functools import partial

import numpy as np
import warp as wp
from machine import OtherWork, describe
from numpy.typing import NDArray
from registration import METHODS, Problem, Refine, errors, perturb, successes, synthetic
from timing import take_turns

import warpvis as wv

PACKAGES = ("warpvis", "warp-lang", "open3d", "small_gicp")


def prepare(problem: Problem, points: int) -> Iterator[tuple[str, Refine]]:
    """Yield the methods that are installed."""
    for title, method in METHODS.items():
        try:
            yield title, method(problem) if "wv." in title else method(problem, points)
        except ImportError as error:
            print(f"{title}: {error}", flush=True)


def table(problem: Problem, starts: NDArray[np.float64], arguments: argparse.Namespace) -> Iterator[str]:
    """Yield the rows of a table: times for all hypotheses, and errors of those that a method registered."""
    methods = dict(prepare(problem, arguments.points))
    parts = {title: starts if "wv." in title else starts[: arguments.subset] for title in methods}
    iterations = arguments.iterations

    def call(title: str) -> NDArray[np.float64]:
        found = methods[title](parts[title], iterations)
        wp.synchronize_device(problem.scene.device)
        return found

    found = {title: call(title) for title in methods}
    times = take_turns([partial(call, title) for title in methods], arguments.rounds)
    yield "| | ms | ms each | relative | error, median | error, 90 % | success | hypotheses |"
    yield "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"
    first = None
    for (title, poses), column in zip(found.items(), times, strict=True):
        each = 1e3 * float(np.median(column)) / len(poses)
        first = first or each
        translation, rotation = errors(poses, problem.truth)
        middle, high = (
            f"{1e3 * np.quantile(translation, q):.2f} mm, {np.quantile(rotation, q):.3f}°" for q in (0.5, 0.9)
        )
        success = successes(poses, problem.truth).mean()
        yield (
            f"| {title} | {each * len(starts):,.0f} | {each:.3f} | {each / first:.1f}x | {middle} | {high} | "
            f"{success:.1%} | {len(poses)} |"
        )


def main() -> None:
    """Print a table for each scene, image size and number of hypotheses."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--hypotheses", type=int, nargs="+", default=[1000])
    parser.add_argument("--scenes", nargs="+", default=["blobs_77k"])
    parser.add_argument("--sizes", nargs="+", default=["160x120"])
    parser.add_argument("--degrees", type=float, default=5.0)
    parser.add_argument("--meters", type=float, default=0.05)
    parser.add_argument("--iterations", type=int, default=10)
    parser.add_argument("--distance", type=float, default=0.5, help="of corresponding points [m]")
    parser.add_argument("--points", type=int, default=50_000, help="that peers register to")
    parser.add_argument("--subset", type=int, default=20, help="hypotheses of peers")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--noisy", action="store_true", help="a Kinect's errors of depth")
    arguments = parser.parse_args()

    sensor, others = wv.sensors.KhoshelhamNoise() if arguments.noisy else None, OtherWork()
    print(describe(PACKAGES))
    for name in arguments.scenes:
        for size in arguments.sizes:
            width, height = map(int, size.split("x"))
            problem = synthetic(
                name, (width, height), distance=arguments.distance, device=arguments.device, sensor=sensor
            )
            rng = np.random.default_rng(0)
            for count in arguments.hypotheses:
                starts = perturb(problem.truth, count, arguments.degrees, arguments.meters, rng)
                print(f"\n{name}, {size}, {count} hypotheses, {arguments.iterations} iterations\n")
                for row in table(problem, starts, arguments):
                    print(row, flush=True)
    print(f"\n{others.warning()}".rstrip())


if __name__ == "__main__":
    main()
