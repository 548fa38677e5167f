# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Trees that outlive a build, for scenes of which parts are replaced again and again."""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.kernels.constants import CUDA_LANES
from warpvis.scene._bvh import Bvh, build_bvh
from warpvis.scene._bvh_cuda import DeviceMesh, build_device_bvh, builds_on
from warpvis.scene._object import SceneObject
from warpvis.scene.closed import provably_closed

_Key = tuple[bytes, ...]


class KeptTrees:
    """The trees of the last build, by what they were made of: the next one makes only those that it does not find."""

    def __init__(self, *, keep: bool = True) -> None:
        """Begin without any.

        Args:
            keep: Whether to keep trees at all: it costs their memory a second time.
        """
        self.keep = keep
        self._last: dict[_Key, Bvh] = {}
        self._now: dict[_Key, Bvh] = {}
        # Which arrays are known to be closed: of objects, which keep theirs as long as they are. Held here, so that
        # other arrays cannot come to have their ids.
        self._closed: dict[tuple[int, int], tuple[np.ndarray, np.ndarray, bool]] = {}
        self._closed_now: dict[tuple[int, int], tuple[np.ndarray, np.ndarray, bool]] = {}

    def tree(
        self,
        vertices: NDArray[np.float32],
        faces: NDArray[np.int32],
        owner: NDArray[np.int32],
        closed: NDArray[np.bool_],
        lanes: int,
        device: wp.Device,
    ) -> Bvh:
        """Return the tree of some triangles, built on a GPU where that is quicker. Nobody may write into kept ones."""
        if not self.keep:
            return build_tree(vertices, faces, owner, closed, lanes, device)
        # Of the flags only those of the triangles' own objects count.
        own = closed[owner]
        key = (vertices.tobytes(), faces.tobytes(), owner.tobytes(), own.tobytes(), bytes([lanes]))
        found = self._last.get(key)
        if found is None:
            found = build_tree(vertices, faces, owner, closed, lanes, device)
        self._now[key] = found
        return found

    def closed(self, vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> bool:
        """Tell whether `provably_closed` says so of an object's mesh."""
        if not self.keep:
            return provably_closed(vertices, faces)
        key = (id(vertices), id(faces))
        known = self._closed.get(key) or (vertices, faces, provably_closed(vertices, faces))
        self._closed_now[key] = known
        return known[2]

    def know_closed(self, item: SceneObject, closed: bool) -> None:
        """Take it as known whether an object's mesh is closed, which nobody looks for then."""
        vertices = item.vertices if item.mesh_vertices is None else item.mesh_vertices
        self._closed[id(vertices), id(item.faces)] = (vertices, item.faces, closed)

    def finish(self) -> None:
        """Let go of what this build did not ask for."""
        self._last, self._now = self._now, {}
        self._closed, self._closed_now = self._closed_now, {}


def build_tree(
    vertices: NDArray[np.float32],
    faces: NDArray[np.int32],
    owner: NDArray[np.int32],
    closed: NDArray[np.bool_],
    lanes: int,
    device: wp.Device,
) -> Bvh:
    """Build a tree; on the CPU, unless it is for a GPU and has many triangles."""
    from warpvis.kernels.packets_cuda import LEVELS

    if lanes == CUDA_LANES and builds_on(device, len(faces)):
        return build_device_bvh(DeviceMesh.of(vertices, faces, owner, closed, device), most_levels=LEVELS)
    most_levels = LEVELS if lanes == CUDA_LANES else None
    return build_bvh(vertices, faces, owner, closed, lanes=lanes, most_levels=most_levels)
