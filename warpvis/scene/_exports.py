# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Export of a scene to trimesh and to glTF files."""

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
    """Objects with classes, in a world with lights and a vertical axis, that can be exported."""

    def __init__(
        self,
        device: wp.Device,
        up: Literal["z", "y"],
        label_names: Mapping[int, str] | None,
        ground_labels: Iterable[Label | int | str],
    ) -> None:
        """Create it without objects; see `Scene`."""
        SceneClasses.__init__(self, label_names, ground_labels)
        SceneChanges.__init__(self, device)
        SceneEnvironment.__init__(self)
        self.up: Literal["z", "y"] = up

    def to_trimesh(self) -> trimesh.Scene:
        """Return a `trimesh.Scene` of the objects in the same frame, with names, and labels in the meshes' metadata.

        Appearances, lights and the background are left out.
        """
        import trimesh

        scene = trimesh.Scene()
        for item in self._objects:
            mesh = trimesh.Trimesh(item.vertices, item.faces, process=False, metadata=self._metadata(item.label))
            scene.add_geometry(mesh, node_name=item.name, geom_name=item.name)
        return scene

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write the scene as glTF (``.glb``), y up as specified by the format; `load` reads it back with its labels.

        Every object is a node. Objects that share a mesh share it in the file. Nodes of these objects and of movable
        ones have transforms; the vertices of all others are in the world's frame. Appearances, lights and the
        background are left out.

        Raises:
            FileFormatError: If the path does not end in ``.glb`` or cannot be written, if vertices on a GPU are not
                finite, or if the file would exceed 4 GB, the format's limit.
        """
        from warpvis.io import export_scene

        objects = self.require_objects()
        export_scene(path, objects, (self._metadata(item.label) for item in objects), self.up)
