# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision references of the kernels of `warpvis.kernels.sensors.simkinect`; dots are processed in sequence.

They also return where single precision may give another result.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from reference_kinect_noise import Said, say
from reference_random import draw_normals
from scipy import ndimage

from warpvis import Camera
from warpvis.kernels.constants import STREAM_ACROSS, STREAM_DISPARITY, STREAM_DOWN
from warpvis.sensors import Reason, SimKinect

_INVALID = 1e8
"""Disparities from here on are invalid [px]."""
_REACH = 4


def _disparity_scale(model: SimKinect, camera: Camera) -> float:
    return (camera.fx if model.focal_length is None else model.focal_length) * model.baseline


def shift_to_levels(
    model: SimKinect, camera: Camera, true_depth: NDArray, draws: NDArray, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return disparities in eighths of a pixel, (V, H, W), 0 for none, and their error bounds.

    Depth at the shifted position is interpolated bilinearly.
    """
    height, width = true_depth.shape[1:]
    views, frames = np.asarray(draws).T
    depth = np.pad(np.where(np.isfinite(true_depth), true_depth, 0.0).astype(np.float64), ((0, 0), (0, 2), (0, 2)))
    view, y, x = np.ogrid[: len(depth), :height, :width]
    across = x + model.shift * draw_normals(views, frames, (height, width), seed, STREAM_ACROSS)
    down = y + model.shift * draw_normals(views, frames, (height, width), seed, STREAM_DOWN)
    across, down = np.clip(across, 0, width), np.clip(down, 0, height)
    column, row = np.floor(across).astype(int), np.floor(down).astype(int)
    found = np.zeros(depth[:, :height, :width].shape)
    for below in (0, 1):
        for right in (0, 1):
            weight = np.abs(1 - below - (down - row)) * np.abs(1 - right - (across - column))
            found += weight * depth[view, row + below, column + right]
    disparity = _disparity_scale(model, camera) / (found + 1e-10)
    levels = 8 * disparity
    doubt = np.where(np.abs(levels % 1 - 0.5) < 1e-4 + 1e-5 * levels, 1.0 + 1e-5 * levels, 0.0)
    valid = disparity < _INVALID
    # Bilinear weights can be tiny: the interpolated depth tends to 0 and the disparity has no bound.
    doubt[valid & (levels > 1e6)] = np.inf
    return np.where(valid, np.rint(levels), 0.0), np.where(valid, doubt, 0.0)


def detect_dots(dots: NDArray, levels: NDArray, doubt: NDArray) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the levels of detected dots, 0 elsewhere."""
    kept, doubtful = np.zeros(levels.shape), np.zeros(levels.shape, dtype=bool)
    squared = np.add.outer(np.arange(-_REACH, _REACH + 1) ** 2, np.arange(-_REACH, _REACH + 1) ** 2)
    weights = 1 / np.where(squared == 0, 1.0, 1.44 * squared)
    rows, columns = (min(*sides) for sides in zip(levels.shape[1:], dots.shape, strict=True))
    for row, column in np.argwhere(dots):
        if not (_REACH <= row < rows - _REACH - 1 and _REACH <= column < columns - _REACH - 1):
            continue
        about = np.s_[row - _REACH : row + _REACH + 1, column - _REACH : column + _REACH + 1]
        light = dots[about].astype(np.float64)
        for view in range(len(levels)):
            window = levels[view][about]
            valid = window > 0
            if not valid.any():
                continue
            apart = weights * np.abs(window - window[valid].mean()) / 8
            enough = light.sum() / 1.2
            share = (light * (valid & (apart < 0.1))).sum()
            kept[view, row, column] = window[_REACH, _REACH] if share > enough else 0.0
            differ = (doubt[view][about] + doubt[view][about].sum() / valid.sum()) / 8
            close = valid & (np.abs(apart - 0.1) <= weights * differ + 1e-6)
            decides = abs(share - enough) <= light[close].sum() + 1e-6
            doubtful[view, row, column] = decides or doubt[view, row, column] > 0
    return kept, doubtful


@np.errstate(divide="ignore", invalid="ignore")
def fill_from_dots(
    model: SimKinect,
    camera: Camera,
    true_depth: NDArray,
    found: tuple[NDArray, NDArray],
    draws: NDArray,
    seed: int,
) -> Said:
    """Fill pixels within 3 px of each dot unless an earlier dot is as near, then quantize and add noise."""
    kept, doubtful = found
    level, nearness = np.zeros(kept.shape), np.zeros(kept.shape)
    for view, row, column in np.argwhere(kept > 0):
        about = np.s_[view, max(row - 3, 0) : row + 4, max(column - 3, 0) : column + 4]
        y, x = np.mgrid[: kept.shape[1], : kept.shape[2]][:, about[1], about[2]]
        squared = (y - row) ** 2 + (x - column) ** 2
        nearer = (squared <= 9) & (1 / (1 + squared) > nearness[about])
        level[about] = np.where(nearer, kept[view, row, column], level[about])
        nearness[about] = np.where(nearer, 1 / (1 + squared), nearness[about])
    views, frames = np.asarray(draws).T
    noise = model.sigma * draw_normals(views, frames, kept.shape[1:], seed, STREAM_DISPARITY)
    exact = _disparity_scale(model, camera) / (level / 8) * model.units
    steps = 35130 / np.rint(exact) + noise + 0.5
    margin = np.minimum(np.abs(exact % 1 - 0.5) / np.maximum(exact, 1), np.abs(steps % 1 - 0.5))
    steps = np.rint(steps)
    depth = np.where(steps > 0, 35130 / steps / model.units, np.inf)
    lost = np.where(np.isfinite(true_depth), Reason.EDGE, Reason.EMPTY)
    said = say(camera, depth, np.where(level > 0, Reason.VALID, lost), margin)
    said.margin[ndimage.maximum_filter(doubtful, size=(1, 7, 7))] = 0.0
    return said
