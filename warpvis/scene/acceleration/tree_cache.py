# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A cache of trees that outlives a build, for scenes whose objects are replaced repeatedly."""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.kernels.constants import CUDA_LANES
from warpvis.scene._mesh import Mesh
from warpvis.scene._object import SceneObject
from warpvis.scene.acceleration.bvh import Bvh, build_bvh
from warpvis.scene.acceleration.bvh_cuda import build_device_bvh, builds_on
from warpvis.scene.closed import provably_closed

_Key = tuple[bytes, ...]


class TreeCache:
    """The trees of the last build, by their inputs; the next build reuses those with equal inputs."""

    def __init__(self, *, keep: bool = True) -> None:
        """Create an empty cache; without `keep` it stores nothing, since caching takes the memory of trees again."""
        self.keep = keep
        self._previous: dict[_Key, Bvh] = {}
        self._current: dict[_Key, Bvh] = {}
        # Which meshes are known to be closed. Holds the arrays, so that their ids cannot be reused.
        self._closed: dict[tuple[int, int], tuple[np.ndarray, np.ndarray, bool]] = {}
        self._current_closed: dict[tuple[int, int], tuple[np.ndarray, np.ndarray, bool]] = {}

    def tree(
        self,
        mesh: Mesh,
        owner: NDArray[np.int32],
        closed: NDArray[np.bool_],
        lanes: int,
        device: wp.Device,
    ) -> Bvh:
        """Return the tree of a mesh, built on a GPU where that is faster. Cached trees must not be modified."""
        if not self.keep:
            return build_tree(mesh, owner, closed, lanes, device)
        # Only the flags of the triangles' objects matter.
        arrays = mesh.rounded, mesh.faces, owner, closed[owner]
        key = (*(array.tobytes() for array in arrays), bytes([lanes]))
        found = self._previous.get(key) or build_tree(mesh, owner, closed, lanes, device)
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
        vertices, faces = item.frame_vertices, item.faces
        self._closed[id(vertices), id(faces)] = vertices, faces, closed

    def finish(self) -> None:
        """Drop entries that this build did not use."""
        self._previous, self._current = self._current, {}
        self._closed, self._current_closed = self._current_closed, {}


def build_tree(mesh: Mesh, owner: NDArray[np.int32], closed: NDArray[np.bool_], lanes: int, device: wp.Device) -> Bvh:
    """Build a tree on the CPU, or on its GPU if it has many triangles."""
    from warpvis.kernels.casting.packets_cuda import LEVELS

    arrays = mesh.rounded, mesh.faces, owner, closed
    if lanes == CUDA_LANES and builds_on(device, len(mesh.faces)):
        return build_device_bvh(*arrays, device, max_levels=LEVELS)
    return build_bvh(*arrays, lanes=lanes, max_levels=LEVELS if lanes == CUDA_LANES else None)


def build_object_tree(item: SceneObject, closed: bool, lanes: int, device: wp.Device) -> Bvh:
    """Build the tree of a movable object, on the device if that has its mesh."""
    from warpvis.kernels.casting.packets_cuda import LEVELS

    mesh, flags = item.mesh, np.array([closed])
    if isinstance(mesh.source_faces, wp.array):
        owner = wp.zeros(item.triangle_count, dtype=wp.int32, device=device)
        return build_device_bvh(mesh.source, mesh.source_faces, owner, flags, device, max_levels=LEVELS)
    return build_tree(mesh, np.zeros(item.triangle_count, dtype=np.int32), flags, lanes, device)
