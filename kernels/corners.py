# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The order in which the leaves of a BVH store the corners of a triangle."""

import warp as wp


@wp.func
def l1_distance(a: wp.vec3, b: wp.vec3) -> float:
    return wp.abs(a[0] - b[0]) + wp.abs(a[1] - b[1]) + wp.abs(a[2] - b[2])


@wp.func
def first_corner(a: wp.vec3, b: wp.vec3, c: wp.vec3) -> int:
    """Return the index of the corner opposite to the longest side; see ``native/cpu/bvh_bounds.h``."""
    first = int(0)
    longest = l1_distance(b, c)
    if l1_distance(c, a) > longest:
        first = 1
        longest = l1_distance(c, a)
    if l1_distance(a, b) > longest:
        first = 2
    return first
