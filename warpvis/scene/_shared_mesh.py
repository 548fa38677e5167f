# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A mesh that several objects share at different poses."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import FARTHEST
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import SceneError

# If all instances of a mesh together have more corners, their world vertices are not cached.
_MAX_CACHED = 1 << 24


@dataclass(eq=False)
class SharedMesh:
    """A mesh in the frame of the objects that share it."""

    vertices: NDArray[np.float64] = field(repr=False)
    """Corners, scaled [m], shape ``(n, 3)``."""
    faces: NDArray[np.int32] = field(repr=False)
    """Corner indices of the triangles, shape ``(m, 3)``."""
    uses: int = 0
    """Number of static objects that share it."""

    @property
    def exceeds_cache(self) -> bool:
        """Whether the world vertices of all instances would take too much memory to cache."""
        return self.uses * len(self.vertices) > _MAX_CACHED

    def rounded_at(self, row: NDArray[np.float64] | None) -> NDArray[np.float32]:
        """Return the corners in the world of an object at a pose, in single precision."""
        return self.rounded if row is None else placed_at(self.vertices, row).astype(np.float32)

    @cached_property
    def rounded(self) -> NDArray[np.float32]:
        """The corners in single precision."""
        return self.vertices.astype(np.float32)

    @cached_property
    def reach(self) -> float:
        """Maximum absolute coordinate of a corner under any rotation [m]."""
        return float(np.sqrt(3.0) * np.abs(self.vertices).max())

    def placed(self, row: NDArray[np.float64] | None, name: str) -> NDArray[np.float64]:
        """Return the corners in the world of an object at a pose; raise a `SceneError` if they are too far away."""
        placed = self.vertices if row is None else placed_at(self.vertices, row)
        if np.abs(placed).max() > FARTHEST:
            raise SceneError(f"vertices of {name!r} must lie within 1e18 m of the origin")
        return placed

    def check_reach(self, rows: NDArray[np.floating], name: str) -> None:
        """Raise a `SceneError` if a corner of an object at any of the poses, ``(n, 7)``, is too far away."""
        if self.reach + np.abs(rows[:, :3]).max(initial=0) > FARTHEST:
            for row in rows:
                self.placed(row.astype(np.float64), name)


def placed_at(vertices: np.ndarray, pose: np.ndarray) -> NDArray[np.float64]:
    """Transform vertices from an object's frame to the world, shape ``(n, 3)``, by a pose of 7 numbers."""
    matrix = poses_to_matrices(pose)
    return vertices @ matrix[:3, :3].T + matrix[:3, 3]
