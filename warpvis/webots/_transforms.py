# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Transforms of Webots' nodes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.webots._nodes import Node


class Transform(NamedTuple):
    """An affine transform to the world: ``p_world = offset + linear p``."""

    linear: NDArray[np.float64]
    """Product of rotations and scales, shape ``(3, 3)``."""
    rotation: NDArray[np.float64]
    """Product of rotations, without scales, shape ``(3, 3)``."""
    offset: NDArray[np.float64]
    """Origin in the world [m], shape ``(3,)``."""

    def within(self, node: Node, scale: NDArray[np.float64]) -> Transform:
        """Compute the transform of a child node: ``p_parent = T + R (S p_child)``."""
        rotation = rotation_matrix(node.vector("rotation", (0.0, 0.0, 1.0, 0.0)))
        offset = self.offset + self.linear @ node.vector("translation", (0.0, 0.0, 0.0))
        return Transform(self.linear @ (rotation * scale), self.rotation @ rotation, offset)


def rotation_matrix(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert an SFRotation, axis and angle [rad], to a matrix; the axis need not be normalized, 0 0 0 is identity."""
    length = np.linalg.norm(rotation[:3])
    if length == 0:
        return np.eye(3)
    x, y, z = rotation[:3] / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = rotation[3]
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)
