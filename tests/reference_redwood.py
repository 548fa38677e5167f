# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision reference of the kernel of `warpvis.kernels.sensors.redwood`, and files in the data set's format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from reference_kinect_noise import Said, say
from reference_random import draw_normals

from warpvis import Camera
from warpvis.kernels.constants import STREAM_ACROSS, STREAM_DISPARITY, STREAM_DOWN
from warpvis.sensors import Reason, RedwoodNoise


def make_table(seed: int = 0, blind: float = 0.03) -> NDArray[np.float32]:
    """Return factors about 1, (80, 80, 5), that vary with position and depth, and some invalid cells."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:80, :80] / 79
    bent = 0.05 * np.cos(3 * x + 5 * y)[..., None] * np.linspace(0.2, 1, 5)
    table = 1 + bent + 0.003 * rng.normal(size=(80, 80, 5))
    table[rng.random((80, 80)) < blind] = 0.0
    return table.astype(np.float32)


def write_table(path: Path, table: NDArray) -> Path:
    """Write lines of numbers in the format of ``dist-model.txt``: 3 of the header, then 23 per cell."""
    cells = np.full((6400, 23), 7.0)
    cells[:, :5] = 9000.0
    cells[:, 15:20] = table.reshape(6400, 5)
    none = (table == 0).all(axis=-1).ravel()
    cells[none, :5], cells[none, 15:20] = 7999.0, 1.5
    head = ["# one", "two", "three 3", "4 four", "five"]
    lines = [*head, "640", "480 % wide", "10", *(repr(float(number)) for number in cells.ravel())]
    path.write_text("\n".join(lines) + "\n")
    return path


def _pixel(at: NDArray, size: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return rounded pixel coordinates and their distance from a rounding boundary."""
    kept = np.clip(at, 0, size - 1)
    return np.floor(kept + 0.5).astype(int), np.abs((kept + 0.5) % 1 - np.rint((kept + 0.5) % 1))


@np.errstate(divide="ignore", invalid="ignore")
def measure_redwood(model: RedwoodNoise, camera: Camera, true_depth: NDArray, draws: NDArray, seed: int) -> Said:
    """Return the measurement of exact depth."""
    height, width = shape = true_depth.shape[1:]
    views, frames = np.asarray(draws).T
    across, down, noise = (
        model.multiplier * draw_normals(views, frames, shape, seed, stream)
        for stream in (STREAM_ACROSS, STREAM_DOWN, STREAM_DISPARITY)
    )
    view, y, x = np.ogrid[: len(true_depth), :height, :width]
    row, row_margin = _pixel(y + 0.25 * down, height)
    column, column_margin = _pixel(x + 0.25 * across, width)
    # At the image's edge, coordinates are clamped and half a pixel from any boundary.
    margin = np.minimum(row_margin, column_margin)
    depth = true_depth[view, row // 2 * 2, column // 2 * 2].astype(np.float64)
    cells = np.asarray(model.distortion, dtype=np.float64)[
        np.floor(row / max(height - 1, 1) * 479 + 0.5).astype(int) // 6,
        np.floor(column / max(width - 1, 1) * 639 + 0.5).astype(int) // 8,
    ]
    # Interpolate between bin centers 1, 3, 5, 7 and 9 m; constant beyond.
    place = np.clip(np.where(np.isfinite(depth), (depth - 1) / 2, 0), 0, 4)
    before = np.minimum(np.floor(place).astype(int), 3)
    lower, upper = (np.take_along_axis(cells, (before + k)[..., None], axis=-1)[..., 0] for k in (0, 1))
    factor = lower + (place - before) * (upper - lower)
    levels = 8 * (35.130 / (depth / factor) + 0.027778 * noise)
    lost = np.where(np.isfinite(depth), Reason.VALID, Reason.EMPTY)
    blind = (lost == Reason.VALID) & (depth < 10) & (factor < 1e-5)
    margin = np.minimum(margin, np.where(lost == Reason.VALID, np.abs(depth - 10), np.inf))
    margin = np.minimum(margin, np.where(blind, np.inf, np.abs(levels % 1 - 0.5)))
    levels = np.rint(levels)
    measured = np.where((levels > 0) & (depth < 10), 8 * 35.130 / levels, np.inf)
    return say(camera, measured, np.where(blind, Reason.DROPOUT, lost), margin)
