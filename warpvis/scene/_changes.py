# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Named objects of a scene, and how they change: deform, get another mesh, or are replaced."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import warp as wp

from warpvis.core.checks import check_flag
from warpvis.core.types import ArrayInput
from warpvis.errors import SceneError
from warpvis.scene._object import SceneObject
from warpvis.scene._object_list import ObjectList
from warpvis.scene._trees import SceneTrees


class SceneChanges(SceneTrees):
    """Objects that have names and can change."""

    def __init__(self, device: wp.Device) -> None:
        """Create it without objects."""
        super().__init__(device)
        self._index: dict[str, int] = {}

    def index(self, name: str) -> int:
        """Return the index of the object with the given name.

        Raises:
            SceneError: If the scene has no object with this name.
        """
        if not isinstance(name, str) or name not in self._index:
            raise SceneError(
                f"the scene has no object {name!r}; it has {', '.join(map(repr, self._index)) or 'no objects'}"
            )
        return self._index[name]

    def update_vertices(self, name: str, vertices: ArrayInput) -> None:
        """Move the vertices of a movable object; its triangles are unchanged.

        The first call for an object gives it a separate tree without back-face culling and replaces a round solid by
        its triangles; the scene's trees are then rebuilt by the next render. Later calls refit the trees on the scene's
        device, which takes a fraction of the time. Refitting keeps the structure of the original tree, so rendering
        slows down if the shape changes a lot.

        Vertices that are on the scene's GPU are copied there and not read back, so their values are not checked: they
        must be finite. After one call and one render, such a call neither synchronizes nor allocates (except that
        `wp.Mesh.refit`, for the ``rays`` caster, takes memory from Warp's pool), so it can be captured with
        `Renderer.render` in a CUDA graph. Rebuilding the trees invalidates the graph.

        `SceneObject.vertices`, `bounds` and `export` use the newest vertices; they copy them from the device on access.

        Args:
            name: The object's name. It must have been added with ``movable=True``.
            vertices: Corners in the object's frame [m], as many as before, shape ``(n, 3)``: a host array or one on
                the scene's GPU; or `wp.vec3` of shape ``(n,)``. The scale that the object was added with is not
                applied again.

        Raises:
            SceneError: If there is no such object, it is not movable, or the vertices are malformed.
        """
        from warpvis.scene.acceleration.refit import DeformingObject, parse_vertices

        index = self.index(name)
        item = self._objects[index]
        if not item.movable:
            raise SceneError(
                f"object {name!r} is not movable, so its vertices cannot be updated; add it with movable=True"
            )
        if item.points is None:  # nothing can be attached to an object that already deforms
            self._require_detached(index, "vertices cannot be updated")
        parsed = parse_vertices(vertices, item, self.device)
        with self._lock:
            item = self._objects[index]
            if item.points is None:
                item = self._objects[index] = DeformingObject(item, self.device)
                self._forget()
            wp.copy(item.points, parsed)
            for built in (self._bvh, self._triangles):
                if built is not None:
                    built.refits[index].refit()

    def update_mesh(
        self, name: str, vertices: ArrayInput, faces: ArrayInput | None = None, *, closed: bool = False
    ) -> None:
        """Replace the mesh of an object, for example after cutting, filling holes or marching cubes.

        The object's name, index, label and pose are unchanged. A movable object has a separate tree, and only that is
        rebuilt: at once, if the scene was rendered before. All static objects share one tree, which the next render
        rebuilds as a whole. To deform a mesh whose triangles do not change, use `update_vertices`, which builds no
        tree.

        A mesh on the scene's GPU is copied, checked and built into a tree there if the object is movable: the host
        reads only the number of ranges per level and whether the mesh is valid. `SceneObject.mesh_vertices` and `faces`
        are copied from the GPU on access.

        Other objects that share the old mesh keep it. A round solid is replaced by the mesh. CUDA graphs of renders
        captured before are invalid: they read memory that the scene has released.

        Args:
            name: The object's name. Attached objects, and objects that others are attached to, cannot change meshes.
            vertices: Corners [m], shape ``(n, 3)`` or `wp.vec3` of shape ``(n,)``, in the object's frame if it is
                movable, else in the world's. The scale that the object was added with is not applied again.
            faces: Corner indices of the triangles, shape ``(m, 3)``, int32 on a GPU; the object's faces by default.
            closed: Whether the mesh is known to be closed, with all normals outwards, so that its back faces can be
                culled where it is seen from outside of its box, which renders faster. `add` checks this itself, which
                takes longer than building a tree.

        Raises:
            SceneError: If there is no such object, it is rigidly attached to others, or the mesh is empty or malformed.
        """
        from warpvis.scene._new_mesh import with_mesh

        index = self.index(name)
        closed = check_flag(closed, "closed", SceneError)
        self._require_detached(index, "mesh cannot be updated")
        self._exchange(index, with_mesh(self._objects[index], vertices, faces, self.device), closed=closed)

    def replace_objects(self, objects: Sequence[SceneObject]) -> None:
        """Replace all objects of the scene, in this order; parents are indices into `objects`.

        From then on the scene caches its trees, so that only trees of new triangles are built.
        """
        from warpvis.scene.acceleration.tree_cache import TreeCache

        index = {item.name: number for number, item in enumerate(objects)}
        if len(index) < len(objects):
            name, _ = Counter(item.name for item in objects).most_common(1)[0]
            raise SceneError(f"objects must have different names, got {name!r} twice")
        with self._lock:
            self._objects, self._index = ObjectList(objects), index
            self._movable = [number for number, item in enumerate(objects) if item.pose is not None]
            self._tree_cache = self._tree_cache or TreeCache()
            self._forget()

    def _require_detached(self, index: int, consequence: str) -> None:
        """Raise a `SceneError`, ending in `consequence`, if an object is rigidly attached to others."""
        item = self._objects[index]
        attached = [self._objects[other].name for other, parent in self.attached().items() if parent == index]
        if item.parent is not None:
            attached = [self._objects[item.parent].name]
        if attached:
            names = ", ".join(map(repr, attached))
            raise SceneError(
                f"object {item.name!r} is rigidly attached to {names}, so its {consequence}; do not attach them"
            )
