# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The trees of a scene over its lifetime: built on first use, refitted, spliced, and dropped when objects change."""

from __future__ import annotations

from typing import TYPE_CHECKING

import warp as wp

from warpvis.kernels.constants import CPU_LANES, CUDA_LANES
from warpvis.scene._object import ObjectList, SceneObject
from warpvis.scene.acceleration.geometry import SceneBvh, Triangles, build_scene_bvh, build_triangles, make_mesh
from warpvis.scene.acceleration.splicing import splice_bvh, splice_triangles

if TYPE_CHECKING:
    from warpvis.scene.acceleration.tree_cache import TreeCache


class SceneTrees:
    """The trees of a scene; the caller holds a lock."""

    def __init__(self, device: wp.Device) -> None:
        """Create it without trees."""
        self._device = device
        self._cache: TreeCache | None = None
        self._bvh: SceneBvh | None = None
        self._triangles: Triangles | None = None
        self._with_faces = False

    def triangles(self, objects: ObjectList, *, faces: bool) -> Triangles:
        """Return the triangles and Warp's trees of them."""
        if self._triangles is None:
            self._triangles = build_triangles(objects, self._device)
        if faces:
            self._triangles.store_faces()
        return self._triangles

    def bvh(self, objects: ObjectList, *, faces: bool) -> SceneBvh:
        """Return the BVH; all later ones have faces, too, if this one has."""
        self._with_faces |= faces
        if self._bvh is None or (faces and not self._bvh.has_faces):
            self._bvh = build_scene_bvh(objects, self._device, cache=self._cache, faces=self._with_faces)
        return self._bvh

    def forget(self, *, cache_next: bool = False) -> None:
        """Drop the trees; with `cache_next`, those built from now on are cached, and reused where nothing changed."""
        self._bvh = self._triangles = None
        if cache_next:
            from warpvis.scene.acceleration.tree_cache import TreeCache

            self._cache = self._cache or TreeCache()

    def refit(self, index: int) -> None:
        """Update the trees of an object that deforms to its vertices."""
        for built in (self._bvh, self._triangles):
            if built is not None:
                built.refits[index].refit()

    def exchange(self, objects: ObjectList, index: int, item: SceneObject, *, closed: bool) -> None:
        """Replace an object by one with another mesh; it is neither attached to another one nor a parent.

        Args:
            objects: All objects.
            index: Index of the object.
            item: The new object, movable if the old one is.
            closed: Whether its back faces can be culled when it is seen from outside.
        """
        from warpvis.scene.acceleration.tree_cache import build_object_tree

        bvh, triangles = self._bvh, self._triangles
        if item.pose is None:
            bvh = triangles = None
        if bvh is not None and bvh.refits.keys() - {index}:  # other objects deform in these arrays
            bvh = None
        column = objects.movable.index(index) if item.pose is not None else -1
        if bvh is not None:
            lanes = CPU_LANES if self._device.is_cpu else CUDA_LANES
            tree = build_object_tree(item, closed, lanes, self._device)
            bvh = splice_bvh(bvh, column, tree, closed=closed, old_count=objects[index].triangle_count)
        if triangles is not None:
            triangles = splice_triangles(triangles, column, index, make_mesh(item.mesh, self._device))
        self.forget(cache_next=bvh is None)
        if self._cache is not None:
            self._cache.set_closed(item, closed)
        objects[index] = item
        self._bvh, self._triangles = bvh, triangles
