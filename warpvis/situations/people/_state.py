# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A body while its posture is solved."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.situations.people._body import Body
from warpvis.situations.people._skeleton import SEGMENTS, Angles, Frames, pose_segments, rotation


class State:
    """Joint angles and pelvis of a body in W worlds.

    The body's frame is at its place on the floor: x forward, y left, z up.
    """

    def __init__(self, body: Body, places: NDArray[np.float64], floor: float) -> None:
        """Start with all angles 0 at places ``x y heading``, shape ``(W, 3)``."""
        self.body, self.worlds = body, len(places)
        self.angles: Angles = {}
        """Joint angles [rad], each a number or of shape ``(W,)``."""
        self.root = np.tile(body.joints["pelvis"], (len(places), 1))
        """Joint of the pelvis [m], shape ``(W, 3)``."""
        self.heading = rotation("z", places[:, 2])
        self.origin = np.column_stack([places[:, :2], np.full(len(places), floor)])

    def set(self, angles: Mapping[str, ArrayLike], side: str) -> None:
        """Set angles of the limbs of one side."""
        self.angles |= {f"{name}_{side}": np.asarray(value, dtype=np.float64) for name, value in angles.items()}

    def angle(self, name: str) -> NDArray[np.float64]:
        """Return an angle in each world [rad], shape ``(W,)``, as a new array."""
        return np.array(np.broadcast_to(self.angles.get(name, np.zeros(())), (self.worlds,)))

    def frames(self, segments: Iterable[str] = SEGMENTS) -> Frames:
        """Return the frames of segments in the body's frame."""
        return pose_segments(self.body, self.angles, self.root, segments)

    def to_body(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Convert points of the world to the body's frame, shapes ``(W, 3)``."""
        return self.turned(points - self.origin)

    def turned(self, vectors: NDArray[np.float64]) -> NDArray[np.float64]:
        """Convert vectors of the world to the body's frame, shapes ``(W, 3)``."""
        return np.einsum("wji,wj->wi", self.heading, vectors)
