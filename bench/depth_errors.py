# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compare errors of Kinect models by depth with those of ICL-NUIM's formula, in the same images of a room.

``python bench/depth_errors.py errors.png`` draws histograms and prints a table. For each band of depth it has the mean
and the standard deviation of the errors [mm] over the nine tenths of the pixels nearest to the median (a few pixels
show another surface, meters away), and the fraction of lost pixels.

A. Handa, T. Whelan, J. McDonald and A. J. Davison, "A Benchmark for RGB-D Visual Odometry, 3D Reconstruction and SLAM",
ICRA 2014, after J. T. Barron and J. Malik, "Intrinsic Scene Properties from a Single RGB-D Image", CVPR 2013: the depth
at a position that is displaced by N(0, 0.5 px) along both axes is, in centimeters,
35130 / floor(35130 / z + N(0, 1/6) + 0.5).
"""

from __future__ import annotations

import argparse
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

import warpvis as wv
from warpvis.rendering import DepthSensor

CAMERA = wv.Camera(640, 480, 481.2, 480.0, 319.5, 239.5, near=0.4, far=8.0)
"""ICL-NUIM's camera, except for the sign of fy."""
BANDS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0)
MODELS: dict[str, DepthSensor] = {
    "SimKinect": wv.sensors.SimKinect(focal_length=480.0),
    "RedwoodNoise, no distortion": wv.sensors.RedwoodNoise(np.ones((80, 80, 5))),
    "KhoshelhamNoise": wv.sensors.KhoshelhamNoise(),
    "NguyenNoise": wv.sensors.NguyenNoise(),
    "kinect_v1": wv.sensors.kinect_v1(),
}
FORMULA = "ICL-NUIM's formula"


def say_icl_nuim(depth: NDArray, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return noisy depth by the formula, ``(V, H, W)``, with nearest-neighbor sampling at displaced positions."""
    views, height, width = depth.shape
    view, y, x = np.ogrid[:views, :height, :width]
    row, column = (
        np.clip(np.rint(center + rng.normal(scale=0.5, size=depth.shape)), 0, size - 1).astype(int)
        for center, size in ((y, height), (x, width))
    )
    centimeters = 100.0 * depth[view, row, column].astype(np.float64)
    with np.errstate(divide="ignore"):  # the sky has infinite depth
        return 351.30 / np.floor(35130 / centimeters + rng.normal(scale=1 / 6, size=depth.shape) + 0.5)


def measure(views: int) -> tuple[NDArray, dict[str, NDArray]]:
    """Return exact depth of views of a room, and the errors of each model [m], NaN where depth is missing."""
    preset = wv.scenes.PRESETS["room"]
    scene, poses, rng = preset.build(), preset.pose_rows(views).astype(np.float32), np.random.default_rng(1)
    errors: dict[str, NDArray] = {}
    for name, model in MODELS.items():
        seen = wv.render(scene, CAMERA, poses, outputs=("depth", "true_depth"), sensor=model, seed=1, frame=0)
        exact = seen.true_depth.numpy()
        images = {name: seen.depth.numpy()} if errors else {FORMULA: say_icl_nuim(exact, rng), name: seen.depth.numpy()}
        errors |= {key: np.where(np.isfinite(depth + exact), depth, np.nan) - exact for key, depth in images.items()}
    return exact, errors


def middle_of(errors: NDArray) -> NDArray:
    """Return the nine tenths nearest to the median."""
    away = np.abs(errors - np.median(errors))
    return errors[away <= np.quantile(away, 0.9)]


def show(exact: NDArray, errors: dict[str, NDArray]) -> None:
    """Print the table."""
    print("| depth, m | " + " | ".join(errors) + " |")
    print("|---|" + "---:|" * len(errors))
    for low, high in pairwise(BANDS):
        in_band = (exact >= low) & (exact < high)
        cells = []
        for found in errors.values():
            of_band = found[in_band]
            seen = of_band[np.isfinite(of_band)]
            central = 1000 * middle_of(seen)
            lost = 1 - len(seen) / len(of_band)
            cells.append(f"{central.mean():+.1f}, {central.std():.1f}; {lost:.1%}")
        print(f"| {low:g} to {high:g} | " + " | ".join(cells) + " |")


def draw(exact: NDArray, errors: dict[str, NDArray], path: str) -> None:
    """Draw histograms, one row per band, with the formula's behind each model's."""
    import matplotlib.pyplot as plt

    bands, names = list(pairwise(BANDS)), [name for name in errors if name != FORMULA]
    figure, axes = plt.subplots(
        len(bands), len(names), figsize=(2.5 * len(names), 1.15 * len(bands)), sharex="row", layout="constrained"
    )
    for row, (low, high) in zip(axes, bands, strict=True):
        in_band = (exact >= low) & (exact < high)
        limit = 3 * 2.85e-3 * high**2
        bins = 1000 * np.linspace(-limit, limit, 61)
        for axis, name in zip(row, names, strict=True):
            axis.hist(1000 * errors[FORMULA][in_band], bins, density=True, color="0.75")
            axis.hist(1000 * errors[name][in_band], bins, density=True, histtype="step", color="tab:blue")
            axis.set_yticks([])
            axis.tick_params(labelsize=7)
        row[0].set_ylabel(f"{low:g} to {high:g} m", fontsize=8)
    for axis, name in zip(axes[0], names, strict=True):
        axis.set_title(name, fontsize=9)
    figure.supxlabel("error, mm; gray: ICL-NUIM's formula", fontsize=8)
    figure.savefig(path, dpi=70)


def main() -> None:
    """Print the table, and draw the histograms if a file is named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("picture", nargs="?", help="where to draw, such as errors.png")
    parser.add_argument("--views", type=int, default=24)
    arguments = parser.parse_args()
    exact, errors = measure(arguments.views)
    show(exact, errors)
    if arguments.picture:
        draw(exact, errors, arguments.picture)


if __name__ == "__main__":
    main()
