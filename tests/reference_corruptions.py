# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision references of the kernels of `warpvis.kernels.sensors.corruptions`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from reference_kinect_noise import Said, say
from reference_random import draw_normals, random_words, to_uniform

from warpvis import Camera
from warpvis.kernels.constants import STREAM_ADDED, STREAM_LOST, STREAM_MULTIPLIED, STREAM_RECTANGLES
from warpvis.sensors import Corruptions, Reason


def place_rectangles(model: Corruptions, camera: Camera, draws: NDArray, seed: int) -> NDArray[np.int64]:
    """Return left, top, right and bottom of rectangles, (V, N, 4); 0 for unused ones."""
    views, frames = np.asarray(draws).T
    least, most = model.rectangles
    uniform = to_uniform(random_words(views, frames, (most + 1, 4), seed, STREAM_RECTANGLES))
    count = least + np.floor(uniform[:, 0, 0] * (most - least + 1))
    sides = model.sides[0] + np.floor(uniform[:, 1:, :2] * (model.sides[1] - model.sides[0] + 1)).astype(int)
    middle = np.floor(uniform[:, 1:, 2:] * (camera.width, camera.height)).astype(int)
    first = middle - sides // 2
    there = np.arange(most) < count[:, None]
    return np.where(there[..., None], np.concatenate([first, first + sides], axis=-1), 0)


def corrupt_depth(
    model: Corruptions, camera: Camera, depth: NDArray, reasons: NDArray, draws: NDArray, seed: int
) -> Said:
    """Return the corrupted depth (V, H, W) and its reasons."""
    views, frames = np.asarray(draws).T
    shape = depth.shape[1:]
    chance = to_uniform(random_words(views, frames, shape, seed, STREAM_LOST))
    lost = chance < model.dropout
    y, x = np.mgrid[: shape[0], : shape[1]]
    for view, boxes in enumerate(place_rectangles(model, camera, draws, seed)):
        for left, top, right, bottom in boxes:
            lost[view] |= (x >= left) & (x < right) & (y >= top) & (y < bottom)
    factor = 1 + model.multiplied * draw_normals(views, frames, shape, seed, STREAM_MULTIPLIED)
    added = model.added * draw_normals(views, frames, shape, seed, STREAM_ADDED)
    measured = depth.astype(np.float64) * factor + added
    said = say(camera, measured, np.where(lost, Reason.DROPOUT, Reason.VALID), np.abs(chance - model.dropout))
    none = ~np.isfinite(depth)
    return Said(np.where(none, depth, said.depth), np.where(none, reasons, said.reasons), said.margin)
