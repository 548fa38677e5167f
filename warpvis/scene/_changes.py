# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Objects of a scene by their names, and how they change: they deform, get other meshes, or are others."""

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
    """Objects that have names, and may change."""

    def __init__(self, device: wp.Device) -> None:
        """Begin without objects."""
        super().__init__(device)
        self._index: dict[str, int] = {}

    def index(self, name: str) -> int:
        """Return the index of the object of that name.

        Raises:
            SceneError: There is none.
        """
        if not isinstance(name, str) or name not in self._index:
            raise SceneError(f"the scene has no object {name!r}; it has {', '.join(map(repr, self._index)) or 'none'}")
        return self._index[name]

    def update_vertices(self, name: str, vertices: ArrayInput) -> None:
        """Deform a movable object: its vertices are elsewhere from now on, its triangles stay.

        The first call for an object gives it a tree of its own, of which no back faces are left out, makes triangles of
        a round solid, and the scene's trees are built again when it is next rendered. Later calls refit what has been
        built, on the scene's device, which takes a fraction of the time. A tree keeps the structure of the shape that
        it was built for: where a mesh is deformed beyond recognition, rendering slows down.

        Vertices that are on the scene's GPU already are copied there and not read back, so their values are not
        checked: they have to be finite. After one call and one rendering, such a call waits for nothing and allocates
        nothing (`wp.Mesh.refit`, for the ``rays`` caster, borrows from Warp's memory pool): with `Renderer.render` it
        records into a CUDA graph. That is void once trees are built again.

        `SceneObject.vertices`, `bounds` and `export` give the newest vertices; they are copied from the device when
        asked for.

        Args:
            name: The object's name. It must have been added with ``movable=True``.
            vertices: Corners in the object's frame [m], as many as before, shape ``(n, 3)``: an array of the host or
                of the scene's GPU; or `wp.vec3` of shape ``(n,)``. The scale that the object was added with is not
                applied again.

        Raises:
            SceneError: There is no such object, it is not movable, or the vertices are malformed.
        """
        from warpvis.scene._refit import DeformingObject, parse_vertices

        index = self.index(name)
        item = self._objects[index]
        if not item.movable:
            raise SceneError(f"object {name!r} is not movable, so its vertices stay; add it with movable=True")
        if item.points is None:  # nothing can be attached to one that deforms already
            self._require_alone(index, "vertices stay")
        given = parse_vertices(vertices, item, self.device)
        with self._lock:
            item = self._objects[index]
            if item.points is None:
                item = self._objects[index] = DeformingObject(item, self.device)
                self._forget()
            wp.copy(item.points, given)
            for built in (self._bvh, self._triangles):
                if built is not None:
                    built.refits[index].refit()

    def update_mesh(
        self, name: str, vertices: ArrayInput, faces: ArrayInput | None = None, *, closed: bool = False
    ) -> None:
        """Give an object another mesh: cut, filled with holes, made by marching cubes, ...

        Its name, its index, its label and its pose stay. A movable object has a tree of its own, and only that is built
        again: at once, if the scene was rendered before. All that stays is one tree, which is built again as a whole
        when it is next rendered. To deform a mesh whose triangles stay, take `update_vertices`, which builds nothing.

        A movable object's mesh on the scene's GPU is copied there, checked there, and its tree built there: the host is
        told how many ranges a level of the tree has, and whether the mesh is sound. `SceneObject.mesh_vertices` and
        `faces` are copied from there when asked for.

        Objects that had the same mesh keep it. A round solid becomes the mesh. CUDA graphs of renderings that were
        recorded before are void: they read memory that the scene has let go of.

        Args:
            name: The object's name. What is attached to another object, or another one to, keeps its mesh.
            vertices: Corners [m], shape ``(n, 3)`` or `wp.vec3` of shape ``(n,)``, in the frame of an object that is
                movable, else in the world's. The scale that the object was added with is not applied again.
            faces: Corner indices of the triangles, shape ``(m, 3)``, int32 on a GPU; those that it has by default.
            closed: Whether the mesh is known to be closed, with all normals outwards, so that its back faces can be
                left out where it is seen from outside of its box: rendering is faster then. `add` finds out by
                itself, which takes longer than building a tree.

        Raises:
            SceneError: There is no such object, it is of one piece with others, or the mesh is empty or malformed.
        """
        from warpvis.scene._new_mesh import with_mesh

        index = self.index(name)
        closed = check_flag(closed, "closed", SceneError)
        self._require_alone(index, "mesh stays")
        self._exchange(index, with_mesh(self._objects[index], vertices, faces, self.device), closed=closed)

    def replace_objects(self, objects: Sequence[SceneObject]) -> None:
        """Make these all objects of the scene, in their order; carriers are indices among them.

        From here on the scene keeps its trees, so that only those of other triangles are built again.
        """
        from warpvis.scene._kept_trees import KeptTrees

        index = {item.name: number for number, item in enumerate(objects)}
        if len(index) < len(objects):
            name, _ = Counter(item.name for item in objects).most_common(1)[0]
            raise SceneError(f"objects must have different names, got {name!r} twice")
        with self._lock:
            self._objects, self._index = ObjectList(objects), index
            self._movable = [number for number, item in enumerate(objects) if item.pose is not None]
            self._kept_trees = self._kept_trees or KeptTrees()
            self._forget()

    def _require_alone(self, index: int, what: str) -> None:
        """Raise a `SceneError` if an object moves with others, which says what therefore stays."""
        item = self._objects[index]
        others = [self._objects[other].name for other, carrier in self.attached().items() if carrier == index]
        if item.carrier is not None:
            others = [self._objects[item.carrier].name]
        if others:
            some = ", ".join(map(repr, others))
            raise SceneError(f"object {item.name!r} is of one piece with {some}, so its {what}; do not attach them")
