# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Functions shared by noise models of depth: random numbers of a pixel, angles, and range limits."""

import warp as wp

from warpvis.kernels.constants import REASON_EMPTY, REASON_RANGE, REASON_VALID
from warpvis.kernels.sensors.random_numbers import random_word, to_normal, to_uniform

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})


@wp.func
def draw_uniform(seed: wp.uint32, stream: int, draw: wp.vec2ui, y: int, x: int) -> float:
    """Return a pixel's uniform random number in (0, 1)."""
    return to_uniform(random_word(seed, wp.uint32(stream), draw[0], draw[1], y, x))


@wp.func
def draw_normal(seed: wp.uint32, stream: int, draw: wp.vec2ui, y: int, x: int) -> float:
    """Return a pixel's standard normal random number."""
    return to_normal(random_word(seed, wp.uint32(stream), draw[0], draw[1], y, x))


@wp.func
def angle_of(cosine: float) -> float:
    """Return the angle of a cosine in [0, 1], with an error below 2e-8 before rounding, the same on every device:
    Abramowitz and Stegun, "Handbook of Mathematical Functions", 4.4.46.
    """
    x = wp.clamp(cosine, 0.0, 1.0)
    total = float(-0.0012624911)
    total = total * x + 0.0066700901
    total = total * x - 0.0170881256
    total = total * x + 0.0308918810
    total = total * x - 0.0501743046
    total = total * x + 0.0889789874
    total = total * x - 0.2145988016
    total = total * x + 1.5707963050
    return wp.sqrt(1.0 - x) * total


@wp.func
def limit_depth(near: float, far: float, depth: float) -> float:
    """Return depth in the convention of REP 117: -inf below near or if noise made it 0, +inf beyond far."""
    if depth > far:
        return wp.inf
    if depth < near or not depth > 0.0:
        return -wp.inf
    return depth


@wp.func
def range_reason(depth: float) -> int:
    """Return `REASON_VALID` for finite depth, and `REASON_RANGE` otherwise."""
    return wp.where(wp.isfinite(depth), REASON_VALID, REASON_RANGE)


@wp.func
def clean_reason(true_depth: float, depth: float) -> int:
    """Return the reason for a depth without noise: `REASON_EMPTY` if the true depth is not finite."""
    return wp.where(wp.isfinite(true_depth), range_reason(depth), REASON_EMPTY)
