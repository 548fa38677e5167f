# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated color vision deficiency of full severity: Machado, Oliveira and Fernandes (2009), table 1."""

import itertools

import numpy as np
from matplotlib.colors import to_rgb

# Applied to linear sRGB.
SEEN_WITHOUT = {
    "none": np.eye(3),
    "red": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "green": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "blue": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
_TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def nearest_pair(colors):
    """Return the smallest CIELAB distance of two colors over all deficiencies, with the deficiency and the two names.

    Args:
        colors: By name: red, green and blue from 0 to 255, or a color name of matplotlib.
    """
    linear = {name: _linear(color) for name, color in colors.items()}
    found = []
    for cones, matrix in SEEN_WITHOUT.items():
        places = {name: _lab(np.clip(np.asarray(matrix) @ color, 0, 1)) for name, color in linear.items()}
        for one, other in itertools.combinations(places, 2):
            found.append((float(np.linalg.norm(places[one] - places[other])), cones, one, other))
    return min(found)


def _linear(color):
    parts = np.array(to_rgb(color)) if isinstance(color, str) else np.array(color) / 255
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def _lab(linear):
    xyz = linear @ _TO_XYZ.T / _TO_XYZ.sum(axis=1)
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])
