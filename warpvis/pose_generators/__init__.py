# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Generators of camera poses: around a point, in a volume, at random, along a path.

Poses are rows ``x y z qx qy qz qw`` [m], OpenCV camera to world. Images are upright: their x axis is horizontal. In the
image of a camera that looks straight up or down, the floor's first axis (x where z is up, z where y is up) points up.
"""

from __future__ import annotations

from warpvis.pose_generators._framing import fitting_distance as fitting_distance, framing
from warpvis.pose_generators._generators import along, grid, orbit, random_poses, sphere
from warpvis.pose_generators._specs import frames_from_spec, looks_like_spec

__all__ = [
    "along",
    "frames_from_spec",
    "framing",
    "grid",
    "looks_like_spec",
    "orbit",
    "random_poses",
    "sphere",
]
