# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras with lenses."""

import numpy as np

import warpvis as wv
from warpvis.cameras import lenses

PLUMB_BOB = (-0.3, 0.1, 0.001, -0.002, 0.01)
RATIONAL = (0.3, 0.1, 0.001, -0.002, 0.01, 0.5, 0.05, 0.001)
FISHEYE = (0.01, 0.002, -0.003, 0.0004)
SMALL = lenses.OpenCVPinhole(52, 50, 32, 24, PLUMB_BOB)
WIDE = lenses.KannalaBrandt(11, 11, 32, 24, FISHEYE)
PINHOLE = wv.Camera(64, 48, 52, 50, 32, 24)
STRAIGHT = np.array([0, 0, 0, 0, 0, 0, 1.0])
