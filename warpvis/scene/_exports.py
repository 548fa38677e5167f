# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A scene as others have it: trimesh's, and a glTF file."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Literal

import warp as wp

from warpvis.core.labels import Label
from warpvis.scene._changes import SceneChanges
from warpvis.scene._classes import SceneClasses
from warpvis.scene._environment import SceneEnvironment

if TYPE_CHECKING:
    import trimesh


class SceneExports(SceneClasses, SceneChanges, SceneEnvironment):
    """Objects with classes, in a world with lights and a vertical axis, that others can have."""

    def __init__(
        self,
        device: wp.Device,
        up: Literal["z", "y"],
        label_names: Mapping[int, str] | None,
        ground_labels: Iterable[Label | int | str],
    ) -> None:
        """Begin without objects; see `Scene`."""
        SceneClasses.__init__(self, label_names, ground_labels)
        SceneChanges.__init__(self, device)
        SceneEnvironment.__init__(self)
        self.up: Literal["z", "y"] = up

    def to_trimesh(self) -> trimesh.Scene:
        """Make a `trimesh.Scene` of the objects in the same frame, with names, and labels in the meshes' metadata.

        Appearances, lights and the background are left out.
        """
        import trimesh

        scene = trimesh.Scene()
        for item in self._objects:
            mesh = trimesh.Trimesh(item.vertices, item.faces, process=False, metadata=self._metadata(item.label))
            scene.add_geometry(mesh, node_name=item.name, geom_name=item.name)
        return scene

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write the scene as glTF (``.glb``), y up as its specification says; `load` reads it back with its labels.

        Every object is a node. Objects that share a mesh share it in the file, and their nodes say where they are, as
        do those of movable objects; of others, the vertices do. Appearances, lights and the background are left out.

        Raises:
            FileFormatError: The path does not end in ``.glb``, or cannot be written; or vertices that are on a GPU are
                not finite, or the file would be larger than 4 GB, which the format cannot be.
        """
        from warpvis.io import export_scene

        objects = self.require_objects()
        export_scene(path, objects, (self._metadata(item.label) for item in objects), self.up)
