# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Acceleration structures and device data of a scene, created on first use and cached until the objects change."""

from __future__ import annotations

from collections.abc import Hashable
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warpvis.cameras.rays import OnceCache
from warpvis.errors import SceneError
from warpvis.scene._object import SceneObject
from warpvis.scene._object_list import ObjectList
from warpvis.scene.acceleration.geometry import SceneBvh, Triangles, build_scene_bvh, build_triangles
from warpvis.scene.acceleration.traversal_plan import plan_traversal

if TYPE_CHECKING:
    from warpvis.kernels.shading.base_colors import DeviceMaterials
    from warpvis.kernels.shading.lighting import Lights
    from warpvis.scene.acceleration.tree_cache import TreeCache
    from warpvis.scene.lights import Background, Light


class SceneTrees:
    """The objects of a scene, and the device data that casters read."""

    def __init__(self, device: wp.Device) -> None:
        """Create it without objects."""
        self.device = device
        self._objects = ObjectList()
        self._movable: list[int] = []
        self._tree_cache: TreeCache | None = None
        # Prepared ray bundles of the most recent renderers, by their inputs.
        self.cached_rays: dict[Hashable, OnceCache] = {}
        self._lock = Lock()
        self._tuple: tuple[SceneObject, ...] | None = None
        self._columns: tuple[int, ...] | None = None
        self._triangles: Triangles | None = None
        self._bvh: SceneBvh | None = None
        self._wants_faces = False
        self._device_materials: tuple[DeviceMaterials, bool] | None = None
        self._device_lights: tuple[tuple[Light, ...], Lights] | None = None
        self._sizes: wp.array | None = None
        self._poses: wp.array | None = None

    @property
    def objects(self) -> tuple[SceneObject, ...]:
        """The objects; values of the object image are indices into this."""
        if self._tuple is None:
            self._tuple = tuple(self._objects)
        return self._tuple

    @property
    def movable(self) -> tuple[int, ...]:
        """Indices of the movable objects with separate poses: the columns of `object_poses`."""
        if self._columns is None:
            self._columns = tuple(self._movable)
        return self._columns

    def triangles(self, *, faces: bool = False) -> Triangles:
        """Return the triangles and Warp's trees of them, built on first use after a change.

        Args:
            faces: Whether to store the face index in the object's mesh for each triangle.

        Raises:
            SceneError: If the scene is empty.
        """
        with self._lock:
            if self._triangles is None:
                self._triangles = build_triangles(self.require_objects(), self.device)
            if faces:
                self._triangles.store_faces()
            return self._triangles

    def bvh(self, *, faces: bool = False) -> SceneBvh:
        """Return the BVH, built on first use after a change.

        Args:
            faces: Whether to store the face index in the object's mesh for each triangle. This takes 4 bytes per leaf
                slot. Trees that were built without it are rebuilt, and all later ones are built with it.

        Raises:
            SceneError: If the scene is empty.
        """
        with self._lock:
            self._wants_faces |= faces
            if self._bvh is None or (faces and not self._bvh.has_faces):
                self._bvh = build_scene_bvh(
                    self.require_objects(), self.device, cache=self._tree_cache, faces=self._wants_faces
                )
            return self._bvh

    def device_materials(self, background: Background | None) -> DeviceMaterials:
        """Return the device materials of the objects, created on first use after a change."""
        from warpvis.scene._device_materials import pack_materials, set_background

        objects, movable = self.objects, self.movable
        with self._lock:
            if self._device_materials is None or self._device_materials[1]:
                self._device_materials = pack_materials(objects, movable, self.device)
            set_background(self._device_materials[0], background)
            return self._device_materials[0]

    def device_lights(self, lights: tuple[Light, ...]) -> Lights:
        """Return the lights on the device, created on first use after they were changed."""
        from warpvis.scene._device_materials import pack_lights

        with self._lock:
            if self._device_lights is None or self._device_lights[0] != lights:
                self._device_lights = lights, pack_lights(lights, self.device)
            return self._device_lights[1]

    def object_labels(self) -> wp.array:
        """Return the objects' labels on the scene's device, shape ``(objects,)`` uint8."""
        return wp.array(plan_traversal(self.require_objects(), self.device).labels, dtype=wp.uint8, device=self.device)

    def movable_sizes(self) -> wp.array:
        """Return the initial solid sizes of the movable objects on the device, shape ``(M,)`` vec4."""
        with self._lock:
            if self._sizes is None:
                sizes = plan_traversal(self._objects, self.device).solid_sizes[: len(self._movable)]
                self._sizes = wp.array(sizes, dtype=wp.vec4, device=self.device)
            return self._sizes

    def movable_poses(self, worlds: int = 1) -> wp.array:
        """Return the initial poses of the movable objects on the device, shape ``(worlds, M)``.

        Poses of a single world are cached.
        """
        with self._lock:
            if worlds == 1 and self._poses is not None:
                return self._poses
            rows = plan_traversal(self._objects, self.device).movable_poses
            repeated = np.repeat(rows[None], worlds, axis=0)
            poses = wp.array(repeated, dtype=wp.transform, shape=repeated.shape[:2], device=self.device)
            if worlds == 1:
                self._poses = poses
            return poses

    def attached(self) -> dict[int, int]:
        """Return the parents of attached objects, by object index."""
        runs = ((first, item) for first, _, item in self._objects.runs() if isinstance(item, SceneObject))
        return {first: item.parent for first, item in runs if item.parent is not None}

    def has_solids(self) -> bool:
        """Return whether any object is rendered as a round solid."""
        return any(item.solid is not None for _, _, item in self._objects.runs())

    def _exchange(self, index: int, item: SceneObject, *, closed: bool) -> None:
        """Replace an object by one with another mesh; it is neither attached to another one nor a parent.

        Args:
            index: Index of the object.
            item: The new object, movable if the old one is.
            closed: Whether its back faces can be culled when it is seen from outside.
        """
        from warpvis.scene._new_mesh import build_mesh_tree, build_warp_mesh
        from warpvis.scene.acceleration.splicing import splice_bvh, splice_triangles
        from warpvis.scene.acceleration.tree_cache import TreeCache

        old_count = self._objects[index].triangle_count
        with self._lock:
            bvh, triangles = self._bvh, self._triangles
            column = self._movable.index(index) if item.pose is not None else -1
            if column < 0 or (bvh and bvh.refits.keys() - {index}):  # other objects deform in these arrays
                bvh = None
            bvh = bvh and splice_bvh(
                bvh, column, build_mesh_tree(item, closed, self.device), closed=closed, old_count=old_count
            )
            triangles = None if column < 0 or triangles is None else triangles
            if triangles is not None:
                triangles = splice_triangles(triangles, column, index, build_warp_mesh(item, self.device))
            if bvh is None:
                self._tree_cache = self._tree_cache or TreeCache()
            if self._tree_cache is not None:
                self._tree_cache.set_closed(item, closed)
            self._objects[index] = item
            self._forget()
            self._bvh, self._triangles = bvh, triangles

    def _forget(self) -> None:
        """Drop all data derived from the objects, since they have changed."""
        self._tuple = self._columns = self._triangles = self._bvh = self._sizes = self._poses = (
            self._device_materials
        ) = None

    def require_objects(self) -> ObjectList:
        """Return the objects; raise a `SceneError` if the scene is empty."""
        if not self._objects:
            raise SceneError("the scene has no objects; add() one first")
        return self._objects
