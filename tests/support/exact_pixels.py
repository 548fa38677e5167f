# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Families of random scenes, and their pixels that differ from exact results."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from warpvis.core.poses import poses_to_matrices

sys.path.append(str(Path(__file__).resolve().parents[2] / "bench"))

from exact_pixels import EDGE, Check, look_again
from exact_scenes import FAMILIES  # noqa: F401


def wrong_pixels(case, depth, most=50):
    """Return wrong pixels of a CPU image away from edges; at most `most` differing pixels are examined."""
    matrices = poses_to_matrices(case.poses.astype(np.float32))
    found = Check("cpu", "packets", 1)._compare(case, matrices, depth)[:most]
    wrong = [look_again(case, matrices[view], x, y, float(depth.numpy()[view, y, x]), "") for view, y, x in found]
    return [pixel for pixel in wrong if pixel.edge > EDGE]
