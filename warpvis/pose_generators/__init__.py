# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Make camera poses by rule: around a point, in a volume, at random, along a path.

All are rows ``x y z qx qy qz qw`` [m] of the OpenCV camera frame, camera to world, and images are upright: their x axis
is level. A camera that looks straight up or down has the floor's first axis (x where z is up, z where y is up) at the
top of its image.
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
