# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Draw the convergence basin of registration: success rates by the initial errors of rotation and translation.

``python bench/register_basin.py basin.png`` perturbs the true poses of a camera in `blobs_77k` by 0 to 45 degrees and 0
to 0.5 m in random directions, and registers 160x120 images within 30 iterations. A success ends within 1 cm and 1
degree. ``--peer`` adds small_gicp, from fewer starts.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray
from registration import Problem, Refine, perturb, small_gicp, successes, synthetic, warpvis

DEGREES = np.arange(0, 46, 5)
METERS = np.arange(0, 0.51, 0.1)


def basin(problems: list[Problem], methods: list[Refine], starts: int, iterations: int) -> NDArray[np.float64]:
    """Return success rates, ``(DEGREES, METERS)``; all starts of a problem are registered in one call."""
    rates = np.zeros((len(DEGREES), len(METERS)))
    for number, (problem, refine) in enumerate(zip(problems, methods, strict=True)):
        rng = np.random.default_rng(number)
        poses = np.concatenate([perturb(problem.truth, starts, d, m, rng) for d in DEGREES for m in METERS])
        good = successes(refine(poses, iterations), problem.truth)
        rates += good.reshape(*rates.shape, starts).mean(axis=-1) / len(problems)
    return rates


def main() -> None:
    """Draw one heat map for each method, and print it."""
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path")
    parser.add_argument("--scene", default="blobs_77k")
    parser.add_argument("--views", type=int, default=3)
    parser.add_argument("--starts", type=int, default=8, help="for each cell and view")
    parser.add_argument("--iterations", type=int, default=30)
    parser.add_argument("--distance", type=float, default=0.5)
    parser.add_argument("--peer", type=int, default=0, help="starts of small_gicp for each cell and view")
    arguments = parser.parse_args()
    problems = [
        synthetic(arguments.scene, (160, 120), view=view, distance=arguments.distance)
        for view in range(arguments.views)
    ]
    maps = {
        "wv.register": basin(problems, [*map(warpvis, problems)], arguments.starts, arguments.iterations),
    }
    if arguments.peer:
        peers = [small_gicp(problem, 50_000) for problem in problems]
        maps["small_gicp PLANE_ICP"] = basin(problems, peers, arguments.peer, arguments.iterations)
    figure, axes = plt.subplots(1, len(maps), figsize=(0.6 + 4.4 * len(maps), 4.2), squeeze=False, layout="constrained")
    for axis, (title, rates) in zip(axes[0], maps.items(), strict=True):
        image = axis.imshow(100 * rates.T, origin="lower", vmin=0, vmax=100, cmap="viridis", aspect="auto")
        axis.set_xticks(range(len(DEGREES)), DEGREES)
        axis.set_yticks(range(len(METERS)), [f"{m:.1f}" for m in METERS])
        axis.set(title=title, xlabel="initial rotation error [degrees]", ylabel="initial translation error [m]")
        for (column, row), rate in np.ndenumerate(rates):
            color = "black" if rate > 0.6 else "white"
            axis.text(column, row, f"{100 * rate:.0f}", ha="center", va="center", color=color, fontsize=8)
        print(f"{title}, success rates [%], rows are translation errors\n{np.round(100 * rates.T).astype(int)}")
    figure.colorbar(image, ax=axes, label="within 1 cm and 1 degree [%]")
    figure.savefig(arguments.path, dpi=110)


if __name__ == "__main__":
    main()
