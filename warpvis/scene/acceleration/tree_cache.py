# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A cache of trees that outlives a build, for scenes whose objects are replaced repeatedly."""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.kernels.constants import CUDA_LANES
from warpvis.scene._object import SceneObject
from warpvis.scene.acceleration.bvh import Bvh, build_bvh
from warpvis.scene.acceleration.bvh_cuda import DeviceMesh, build_device_bvh, builds_on
from warpvis.scene.closed import provably_closed

_Key = tuple[bytes, ...]


class TreeCache:
    """The trees of the last build, by their inputs; the next build reuses those with equal inputs."""

    def __init__(self, *, keep: bool = True) -> None:
        """Create an empty cache.

        Args:
            keep: Whether to cache trees at all: this takes their memory a second time.
        """
        self.keep = keep
        self._previous: dict[_Key, Bvh] = {}
        self._current: dict[_Key, Bvh] = {}
        # Which meshes are known to be closed. Holds the arrays, so that their ids cannot be reused.
        self._closed: dict[tuple[int, int], tuple[np.ndarray, np.ndarray, bool]] = {}
        self._current_closed: dict[tuple[int, int], tuple[np.ndarray, np.ndarray, bool]] = {}

    def tree(
        self,
        vertices: NDArray[np.float32],
        faces: NDArray[np.int32],
        owner: NDArray[np.int32],
        closed: NDArray[np.bool_],
        lanes: int,
        device: wp.Device,
    ) -> Bvh:
        """Return the tree of the triangles, built on a GPU where that is faster. Cached trees must not be modified."""
        if not self.keep:
            return build_tree(vertices, faces, owner, closed, lanes, device)
        # Only the flags of the triangles' objects matter.
        owner_closed = closed[owner]
        key = (vertices.tobytes(), faces.tobytes(), owner.tobytes(), owner_closed.tobytes(), bytes([lanes]))
        found = self._previous.get(key)
        if found is None:
            found = build_tree(vertices, faces, owner, closed, lanes, device)
        self._current[key] = found
        return found

    def closed(self, vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> bool:
        """Return the cached result of `provably_closed` for an object's mesh."""
        if not self.keep:
            return provably_closed(vertices, faces)
        key = (id(vertices), id(faces))
        known = self._closed.get(key) or (vertices, faces, provably_closed(vertices, faces))
        self._current_closed[key] = known
        return known[2]

    def set_closed(self, item: SceneObject, closed: bool) -> None:
        """Store whether an object's mesh is closed, so that it is not checked."""
        vertices = item.vertices if item.mesh_vertices is None else item.mesh_vertices
        self._closed[id(vertices), id(item.faces)] = (vertices, item.faces, closed)

    def finish(self) -> None:
        """Drop entries that this build did not use."""
        self._previous, self._current = self._current, {}
        self._closed, self._current_closed = self._current_closed, {}


def build_tree(
    vertices: NDArray[np.float32],
    faces: NDArray[np.int32],
    owner: NDArray[np.int32],
    closed: NDArray[np.bool_],
    lanes: int,
    device: wp.Device,
) -> Bvh:
    """Build a tree on the CPU, or on its GPU if it has many triangles."""
    from warpvis.kernels.casting.packets_cuda import LEVELS

    if lanes == CUDA_LANES and builds_on(device, len(faces)):
        return build_device_bvh(DeviceMesh.of(vertices, faces, owner, closed, device), max_levels=LEVELS)
    max_levels = LEVELS if lanes == CUDA_LANES else None
    return build_bvh(vertices, faces, owner, closed, lanes=lanes, max_levels=max_levels)
