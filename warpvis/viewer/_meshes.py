# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The objects of the page's 3D view, with their materials, or in the colors of the agents that see them."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from warpvis.scene.materials import Appearance
from warpvis.viewer._materials import Shelf, base_color
from warpvis.viewer._nodes import Nodes, place
from warpvis.visibility import State

if TYPE_CHECKING:
    from viser import SceneApi

    from warpvis.viewer._state import Snapshot, ViewerState

_DARK_GROUND = (52, 52, 56)
_NO_SHADOWS: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}

MeshKind = Literal["materials", "visibility"]
"""Whether objects show their materials, or which agents see them."""

_MAX_LOOKS = 64
"""Maximum number of different appearances of instances of a mesh; beyond, instances show their base colors."""


class Meshes(Nodes):
    """Meshes of the scene's objects. Shared meshes are sent once; movable objects are children of frames."""

    def __init__(self, scene: SceneApi, state: ViewerState, *, dark: bool = False) -> None:
        self._scene, self._state, self._dark = scene, state, dark
        self._colors = self._all_colors({})
        self._frames = [
            scene.add_frame(f"/moving/{row}", show_axes=False) for row in range(len(state.stage.object_poses))
        ]
        self._meshes: dict[int, Any] = {}
        self._batches: list[tuple[Any, NDArray[np.int64]]] = []
        self._shown: dict[MeshKind, list[Any]] = {}
        self._kind: MeshKind = "materials" if state.has_colors else "visibility"
        self._make()

    @property
    def kind(self) -> MeshKind:
        """Whether objects show their materials, or which agents see them; others have no appearance."""
        return self._kind

    @kind.setter
    def kind(self, kind: MeshKind) -> None:
        visible, self.visible = self.visible, False
        self._kind = kind
        if kind not in self._shown:
            self._make()
        self.visible = visible

    def _make(self) -> None:
        """Add the nodes of the current kind; those without appearances are shared."""
        state, nodes = self._state, self._shown.setdefault(self._kind, [])
        looks = {index: self._looks(index) for index in range(len(state.scene.objects))}
        painted = {index for index, found in looks.items() if found and self._kind == "materials"}
        shelf = Shelf(look for index in sorted(painted) for look in looks[index])
        shared = defaultdict(list)
        for index, item in enumerate(state.scene.objects):
            mesh = item.shared_mesh
            shared[id(mesh) if mesh is not None else -1 - index].append(index)
        for indices in shared.values():
            if len(indices) > 1:
                nodes += self._add_instances(shelf, indices, painted)
            elif indices[0] in painted:
                parts = state.stage.parts_of(state.scene.objects[indices[0]].name)
                nodes.append(self._scene.add_glb(self._path(indices[0], "look"), shelf.glb(parts), **_NO_SHADOWS))
            else:
                nodes.append(self._add_mesh(indices[0]))

    def _looks(self, index: int) -> list[Appearance]:
        """Return the appearances of an object's parts."""
        parts = self._state.stage.parts_of(self._state.scene.objects[index].name)
        return [look for part in parts if (look := part.appearance) is not None]

    def _path(self, index: int, kind: str = "") -> str:
        row = int(self._state.stage.columns[index])
        return (f"/moving/{row}/{index}" if row >= 0 else f"/objects/{index}") + kind

    def _add_instances(self, shelf: Shelf, indices: list[int], painted: set[int]) -> list[Any]:
        """Add the instances of a mesh: one node for each appearance, and one for those without."""
        objects = self._state.scene.objects
        groups = defaultdict(list)
        for index in indices:
            groups[id(objects[index].lazy_appearance) if index in painted else None].append(index)
        nodes = []
        if len(groups) > _MAX_LOOKS:
            plain = np.array(indices)
            colors = [base_color(look) for index in indices for look in self._looks(index)[:1] or [Appearance()]]
            return [self._add_batch(plain, np.array(colors, dtype=np.uint8), "base")]
        for look, members in groups.items():
            if look is None:
                batch = self._add_batch(np.array(members), self._colors[members])
                self._batches.append((batch, np.array(members)))
                nodes.append(batch)
                continue
            places = np.array([objects[index].place for index in members], dtype=np.float64)
            mesh = objects[members[0]].shared_mesh
            assert mesh is not None  # only objects with a shared mesh are instances
            nodes.append(
                self._scene.add_batched_glb(
                    f"/objects/{members[0]}look",
                    shelf.glb_of(mesh.rounded, mesh.faces, objects[members[0]].appearance),
                    batched_wxyzs=places[:, [6, 3, 4, 5]],
                    batched_positions=places[:, :3],
                    **_NO_SHADOWS,
                )
            )
        return nodes

    def _all_colors(self, states: dict[str, State]) -> NDArray[np.uint8]:
        """Return the color of every object; on a dark page, the ground is dark."""
        colors = self._state.colors(states)
        if self._dark:
            ground = self._state.scene.ground_labels
            dark = [item.label in ground and item.name not in states for item in self._state.scene.objects]
            colors[np.flatnonzero(dark)] = _DARK_GROUND
        return colors

    def _add_mesh(self, index: int) -> Any:
        if index not in self._meshes:
            vertices, faces = self._state.stage.mesh(self._state.scene.objects[index].name)
            color = tuple(self._colors[index].tolist())
            options: dict[str, Any] = {"color": color, "flat_shading": True, "side": "double", **_NO_SHADOWS}
            self._meshes[index] = self._scene.add_mesh_simple(self._path(index), vertices, faces, **options)
        return self._meshes[index]

    def _add_batch(self, indices: NDArray[np.int64], colors: NDArray[np.uint8], kind: str = "") -> Any:
        items = [self._state.scene.objects[index] for index in indices]
        mesh = items[0].shared_mesh
        assert mesh is not None  # only objects with a shared mesh are batched
        places = np.array([item.place for item in items], dtype=np.float64)
        return self._scene.add_batched_meshes_simple(
            f"/objects/{indices[0]}{kind}",
            mesh.rounded,
            mesh.faces,
            batched_wxyzs=places[:, [6, 3, 4, 5]],
            batched_positions=places[:, :3],
            batched_colors=colors,
            flat_shading=True,
            side="double",
            **_NO_SHADOWS,
        )

    def _nodes(self) -> list[Any]:
        return self._shown[self._kind]

    def show(self, snapshot: Snapshot) -> None:
        """Update poses and colors, which show which agents see each object."""
        for frame, pose in zip(self._frames, snapshot.object_poses, strict=True):
            place(frame, pose)
        colors = self._all_colors(snapshot.object_states)
        for index in np.flatnonzero((colors[:-1] != self._colors[:-1]).any(axis=1)).tolist():
            if index in self._meshes:
                self._meshes[index].color = tuple(colors[index].tolist())
        for batch, indices in self._batches:
            if (colors[indices] != self._colors[indices]).any():
                batch.batched_colors = colors[indices]
        self._colors = colors
