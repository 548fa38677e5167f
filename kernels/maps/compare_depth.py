# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Comparison of measured depth with the expected depth of the same pixels."""

import warp as wp

from warpvis.kernels.constants import (
    DEPTH_AGREES,
    DEPTH_FARTHER,
    DEPTH_NEARER,
    DEPTH_NO_MEASUREMENT,
    DEPTH_NO_SURFACE,
)
from warpvis.kernels.maps.classify import has_depth
from warpvis.kernels.pinhole import Window, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

NO_MEASUREMENT = wp.constant(wp.uint8(DEPTH_NO_MEASUREMENT))
AGREES = wp.constant(wp.uint8(DEPTH_AGREES))
NEARER = wp.constant(wp.uint8(DEPTH_NEARER))
FARTHER = wp.constant(wp.uint8(DEPTH_FARTHER))
NO_SURFACE = wp.constant(wp.uint8(DEPTH_NO_SURFACE))


@wp.struct
class Criteria:
    """When measured and expected depth agree: `warpvis.compare_depth`."""

    near: float
    far: float
    threshold: float
    tolerance: float
    edge: int
    empty: wp.uint8  # label of pixels with depth where no surface is expected
    first_bits: int  # bits of the depth [m] of the first standard deviation
    step_bits: int  # distance of the bits of the next depth
    span: int  # pixels of a row per thread


@wp.func
def sigma_at(criteria: Criteria, sigmas: wp.array[float], depth: float) -> float:
    """Interpolate the standard deviation of depth [m] linearly between depths whose binary forms are equidistant."""
    last = sigmas.shape[0] - 1
    place = wp.clamp(wp.cast(depth, int) - criteria.first_bits, 0, last * criteria.step_bits)
    before = wp.min(place / criteria.step_bits, last - 1)
    start = sigmas[before]
    return start + (sigmas[before + 1] - start) * float(place - before * criteria.step_bits) / float(criteria.step_bits)


@wp.func
def compare_pixel(
    view: int,
    y: int,
    x: int,
    criteria: Criteria,
    sigmas: wp.array[float],
    expected_in: wp.array3d[float],
    nearest_in: wp.array3d[float],
    farthest_in: wp.array3d[float],
    depth_in: wp.array3d[float],
    labels_out: wp.array3d[wp.uint8],
    residual_out: wp.array3d[float],
):
    depth = depth_in[view, y, x]
    if not has_depth(depth, criteria.near, criteria.far):
        labels_out[view, y, x] = NO_MEASUREMENT
        residual_out[view, y, x] = wp.nan
        return
    expected = expected_in[view, y, x]
    residual_out[view, y, x] = wp.nan
    if wp.isfinite(expected):
        sigma = sigma_at(criteria, sigmas, expected)
        residual_out[view, y, x] = (depth - expected) / sigma
        if wp.abs(depth - expected) <= criteria.tolerance + criteria.threshold * sigma:
            labels_out[view, y, x] = AGREES
            return

    nearest = float(wp.inf)
    farthest = float(0.0)
    for row in range(wp.max(y - criteria.edge, 0), wp.min(y + criteria.edge + 1, expected_in.shape[1])):
        for column in range(wp.max(x - criteria.edge, 0), wp.min(x + criteria.edge + 1, expected_in.shape[2])):
            beside = expected_in[view, row, column]
            if not wp.isnan(beside):
                if nearest_in:
                    nearest = wp.min(nearest, nearest_in[view, row, column])
                    farthest = wp.max(farthest, farthest_in[view, row, column])
                else:
                    nearest, farthest = wp.min(nearest, beside), wp.max(farthest, beside)
    label = AGREES
    if nearest == wp.inf:
        label = wp.where(wp.isnan(expected), NO_SURFACE, criteria.empty)
    elif nearest - depth > criteria.tolerance + criteria.threshold * sigma_at(criteria, sigmas, nearest):
        label = NEARER
    elif depth - farthest > criteria.tolerance + criteria.threshold * sigma_at(criteria, sigmas, farthest):
        label = FARTHER
    if label != AGREES and wp.isnan(expected):
        label = NO_SURFACE
    labels_out[view, y, x] = label


@wp.kernel
def compare_depth(
    # Cameras:
    window: Window,
    # In:
    criteria: Criteria,
    sigmas: wp.array[float],
    expected_in: wp.array3d[float],
    nearest_in: wp.array3d[float],
    farthest_in: wp.array3d[float],
    depth_in: wp.array3d[float],
    # Out:
    labels_out: wp.array3d[wp.uint8],
    residual_out: wp.array3d[float],
):
    """Label pixels by measured depth against the range of expected depth around them, and write residuals.

    `nearest_in` and `farthest_in` are depths between which the surfaces of a map are, None for those of a scene.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    first = x * criteria.span
    for column in range(first, wp.min(first + criteria.span, expected_in.shape[2])):
        compare_pixel(
            view, y, column, criteria, sigmas, expected_in, nearest_in, farthest_in, depth_in, labels_out, residual_out
        )
