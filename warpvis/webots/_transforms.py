# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Frames of Webots' nodes in the world."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.webots._nodes import Node


class Transform(NamedTuple):
    """A frame in the world: a point p of it is at ``offset + linear p``."""

    linear: NDArray[np.float64]
    """Rotations and scales, shape ``(3, 3)``."""
    rotation: NDArray[np.float64]
    """The rotations alone."""
    offset: NDArray[np.float64]
    """Its origin [m], shape ``(3,)``."""

    def within(self, node: Node, scale: NDArray[np.float64]) -> Transform:
        """Compute the frame of a node in this one: ``p_parent = T + R (S p_child)``."""
        rotation = rotation_matrix(node.vector("rotation", (0.0, 0.0, 1.0, 0.0)))
        offset = self.offset + self.linear @ node.vector("translation", (0.0, 0.0, 0.0))
        return Transform(self.linear @ (rotation * scale), self.rotation @ rotation, offset)


def rotation_matrix(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert an SFRotation, axis and angle [rad], to a matrix; the axis has any length, and 0 0 0 turns nothing."""
    length = np.linalg.norm(rotation[:3])
    if length == 0:
        return np.eye(3)
    x, y, z = rotation[:3] / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = rotation[3]
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)
