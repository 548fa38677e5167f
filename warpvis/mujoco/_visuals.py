# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo's visual elements other than geoms and sites: skins, flexes, tendons, and elements enabled by options.

They come from `mjv_updateScene` (src/engine/engine_vis_visualize.c), with the vertices of skins and flexes, and are
scene objects with moving vertices and fixed faces.
"""

from __future__ import annotations

import copy
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import Label
from warpvis.mujoco._model_fields import drawn_number, free_name, shape_count
from warpvis.mujoco._scene import ADDING_FLAGS, JOINT_WRAP, Selection
from warpvis.mujoco._tessellation import SIMPLE_SHAPES, Blocks, Eye, bands, box_edges, facing, simple_shapes
from warpvis.scene import Scene, SceneObject

_GEOM, _OBJ = mujoco.mjtGeom, mujoco.mjtObj
_LINES = int(_GEOM.mjGEOM_LINE), int(_GEOM.mjGEOM_LINEBOX)
_SHAPES = int(_OBJ.mjOBJ_GEOM), int(_OBJ.mjOBJ_SITE)
_FRAMES_OF_SHAPES = mujoco.mjtFrame.mjFRAME_GEOM, mujoco.mjtFrame.mjFRAME_SITE
_ALL, _DECOR = int(mujoco.mjtCatBit.mjCAT_ALL), int(mujoco.mjtCatBit.mjCAT_DECOR)
_MAX_GEOMS = 10000  # the default of mujoco.Renderer
_BOX_WIDTH = 1.5  # of lines that are edges of boxes, relative to the model's line width
_SENSORS = [int(getattr(mujoco.mjtSensor, f"mjSENS_{name}")) for name in ("RANGEFINDER", "GEOMFROMTO")]
_CRANK = int(mujoco.mjtTrn.mjTRN_SLIDERCRANK)

MAIN_PARTS = "skin", "faces", "capsule"
"""The main, and mostly only, shapes of skins, flexes and tendons."""


class VisualKey(NamedTuple):
    """Identifier of a visual object."""

    kind: int
    """A `mujoco.mjtObj`."""
    which: int
    """Its id."""
    part: str
    """Name of one of its shapes."""


def draws_by_default(model: mujoco.MjModel) -> bool:
    """Return whether MuJoCo, by default, draws elements of a model other than geoms and sites."""
    wraps = model.wrap_type[model.tendon_adr] if model.ntendon else np.zeros(0)
    cranks, rays = (model.actuator_trntype == _CRANK).any(), np.isin(model.sensor_type, _SENSORS).any()
    spatial = (wraps != JOINT_WRAP).any()
    return bool(model.nskin or model.nflex or model.nplugin or spatial or cranks or rays)


class Visuals:
    """Reads MuJoCo's visual elements of a model."""

    def __init__(self, model: mujoco.MjModel, *, mesh_tolerance: float) -> None:
        self._model, self._mesh_tolerance = model, mesh_tolerance
        self._default = draws_by_default(model)
        self._plain = _without_shapes(mujoco.MjvOption())
        self._scene: mujoco.MjvScene | None = None
        self.undrawn: list[str] = []
        """Elements of the last `read` that are not supported."""

    def may_draw(self, option: mujoco.MjvOption | None) -> bool:
        """Return whether there may be elements to draw."""
        if self._default or option is None:
            return self._default
        return option.frame != mujoco.mjtFrame.mjFRAME_NONE or bool(option.flags[ADDING_FLAGS].any())

    def read(
        self, data: mujoco.MjData, viewer: mujoco.MjvCamera, option: mujoco.MjvOption | None, eye: Eye
    ) -> dict[VisualKey, Blocks]:
        """Return the elements other than geoms and sites that MuJoCo draws now, for the camera `eye`."""
        if self._scene is None:
            self._scene = mujoco.MjvScene(self._model, maxgeom=_MAX_GEOMS)
        scene, chosen = self._scene, self._plain if option is None else _without_shapes(option)
        mujoco.mjv_updateScene(self._model, data, chosen, None, viewer, _ALL, scene)
        drawn: dict[VisualKey, Blocks] = {}
        simple: dict[VisualKey, list[mujoco.MjvGeom]] = defaultdict(list)
        left_out: dict[str, None] = {}
        for geom in scene.geoms[: scene.ngeom]:
            kind = geom.type
            if geom.objtype in _SHAPES and geom.category != _DECOR:
                continue
            if kind == _GEOM.mjGEOM_SKIN:
                drawn[VisualKey(geom.objtype, geom.objid, "skin")] = self._skin(scene, geom.objid)
            elif kind == _GEOM.mjGEOM_FLEX:
                drawn |= self._flex(scene, geom.objid, float(geom.size[0]))
            elif kind in SIMPLE_SHAPES or kind in _LINES:
                part = _GEOM(kind).name.removeprefix("mjGEOM_").lower()
                simple[VisualKey(geom.objtype, geom.objid, part)].append(geom)
            else:
                left_out[f"{_GEOM(kind).name} of {_OBJ(geom.objtype).name}"] = None
        for key, geoms in simple.items():
            drawn[key] = self._shapes(geoms, eye)
        self.undrawn = list(left_out)
        return drawn

    def _shapes(self, geoms: list[mujoco.MjvGeom], eye: Eye) -> Blocks:
        kind = geoms[0].type
        sizes, position, rotation = (
            np.array([getattr(geom, name) for geom in geoms], dtype=np.float64) for name in ("size", "pos", "mat")
        )
        rotation = rotation.reshape(-1, 3, 3)
        if kind not in _LINES:
            shapes = simple_shapes(kind, sizes, position, rotation, mesh_tolerance=self._mesh_tolerance)
            return replace(shapes, vertices=facing(shapes.vertices, eye)) if kind == _GEOM.mjGEOM_TRIANGLE else shapes
        one = float(self._model.vis.global_.linewidth)
        if kind == _GEOM.mjGEOM_LINEBOX:
            return bands(box_edges(sizes, position, rotation), _BOX_WIDTH * one, eye)
        ends = np.stack([position, position + rotation[:, :, 2] * sizes[:, 2:]], axis=1)
        return bands(ends, one * float(sizes[0, 0]), eye)

    def _skin(self, scene: mujoco.MjvScene, skin: int) -> Blocks:
        model = self._model
        first, faces = model.skin_vertadr[skin], model.skin_faceadr[skin]
        vertices = scene.skinvert.reshape(-1, 3)[first : first + model.skin_vertnum[skin]]
        return Blocks(vertices[None], model.skin_face[faces : faces + model.skin_facenum[skin]])

    def _flex(self, scene: mujoco.MjvScene, flex: int, radius: float) -> Iterator[tuple[VisualKey, Blocks]]:
        """Yield the faces of a flex, or its edges and vertices, as in case mjGEOM_FLEX of `renderGeom`."""
        kind = int(_OBJ.mjOBJ_FLEX)
        used = int(scene.flexfaceused[flex])
        if used:
            faces = scene.flexface.reshape(-1, 3, 3)[scene.flexfaceadr[flex] :][:used]
            yield VisualKey(kind, flex, "faces"), Blocks(faces, np.array([[0, 1, 2]], dtype=np.int32))
        if radius <= 0 or (scene.flexskinopt and used):
            return
        first = scene.flexvertadr[flex]
        vertices = scene.flexvert.reshape(-1, 3)[first : first + scene.flexvertnum[flex]].astype(np.float64)
        if scene.flexvertopt:
            sizes, rotation = np.full((len(vertices), 3), radius), np.broadcast_to(np.eye(3), (len(vertices), 3, 3))
            ball, tolerance = int(_GEOM.mjGEOM_SPHERE), self._mesh_tolerance
            balls = simple_shapes(ball, sizes, vertices, rotation, mesh_tolerance=tolerance)
            yield VisualKey(kind, flex, "vertices"), balls
        count = int(scene.flexedgenum[flex])
        if scene.flexedgeopt and count:
            edges = scene.flexedge.reshape(-1, 2)[scene.flexedgeadr[flex] :][:count]
            yield VisualKey(kind, flex, "edges"), self._rods(vertices[edges], radius)

    def _rods(self, ends: NDArray[np.float64], radius: float) -> Blocks:
        """Build open cylinders between pairs of points, ``(n, 2, 3)``."""
        along = ends[:, 1] - ends[:, 0]
        length = np.linalg.norm(along, axis=1)
        sizes = np.stack([np.full_like(length, radius), np.full_like(length, radius), length / 2], axis=1)
        return simple_shapes(
            int(_GEOM.mjGEOM_CYLINDER),
            sizes,
            ends.mean(axis=1),
            _rotations_to(along),
            mesh_tolerance=self._mesh_tolerance,
            open_ends=True,
        )


def _rotations_to(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute rotations ``(n, 3, 3)`` from z to the given directions, of any length."""
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    z = np.where(length > 0, directions / np.where(length > 0, length, 1), [0, 0, 1])
    across = np.where(np.abs(z[:, :1]) < 0.5, [1.0, 0, 0], [0.0, 1, 0])
    x = np.cross(across, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


def _without_shapes(option: mujoco.MjvOption) -> mujoco.MjvOption:
    """Copy options, with geoms, sites and text disabled, unless frames of geoms or sites require their groups."""
    chosen = copy.copy(option)
    if chosen.frame not in _FRAMES_OF_SHAPES:
        chosen.geomgroup[:] = chosen.sitegroup[:] = 0
    chosen.label = mujoco.mjtLabel.mjLABEL_NONE
    return chosen


@dataclass
class _VisualObject:
    """The data of one object."""

    name: str
    capacity: int
    """Maximum number of blocks."""
    faces: NDArray[np.int32]
    """Faces of one block."""
    vertices: NDArray[np.float32]
    """Vertices of the last update [m], shape ``(capacity * t, 3)``."""

    def holds(self, blocks: Blocks) -> bool:
        """Return whether the object can represent the blocks with its faces and capacity."""
        count, corners, _ = blocks.vertices.shape
        fits = self.capacity >= count and len(self.vertices) == self.capacity * corners
        return fits and np.array_equal(self.faces, blocks.faces)

    def blocks(self) -> Blocks:
        """Return blocks that reproduce the object."""
        return Blocks(self.vertices.reshape(self.capacity, -1, 3), self.faces)


class VisualObjects:
    """The objects of visual elements, between the geoms and sites of a scene and its added objects.

    Each object is created when it is first drawn, and hidden when it is not drawn. The capacity of an object of several
    shapes, such as the segments of a tendon, is at least doubled when it is exceeded.
    """

    def __init__(self, model: mujoco.MjModel, selection: Selection, scene: Scene) -> None:
        self._model, self._selection, self._scene = model, selection, scene
        self._items: dict[VisualKey, _VisualObject] = {}
        self._shown: set[VisualKey] = set()

    def __len__(self) -> int:
        return len(self._items)

    def meanings(self) -> list[tuple[int, int]]:
        """List id and `mujoco.mjtObj` of every object."""
        return [(key.which, key.kind) for key in self._items]

    def hidden(self, first: int) -> list[int]:
        """List the scene indices of objects that are not drawn now, where `first` is the index of the first object."""
        if len(self._shown) == len(self._items):
            return []
        return [first + place for place, key in enumerate(self._items) if key not in self._shown]

    def state(self) -> dict[VisualKey, Blocks]:
        """Return the blocks with which `update` reproduces the visible objects."""
        return {key: self._items[key].blocks() for key in self._items if key in self._shown}

    def update(self, drawn: Mapping[VisualKey, Blocks], first: int) -> None:
        """Set the shapes of the visible elements; `first` is the scene index of the first object."""
        left_out = self._selection.left_out
        shown = {key: blocks for key, blocks in drawn.items() if self._number(key) not in left_out}
        self._shown = set(shown)
        new = {
            key: blocks for key, blocks in shown.items() if key not in self._items or not self._items[key].holds(blocks)
        }
        if new:
            self._make(new, first)
        for key, blocks in shown.items():
            item = self._items[key]
            vertices = blocks.filled_up(item.capacity)
            if key in new or not np.array_equal(vertices, item.vertices):
                self._scene.update_vertices(item.name, vertices)
                item.vertices = vertices

    def _make(self, new: Mapping[VisualKey, Blocks], first: int) -> None:
        """Create or rebuild objects."""
        scene, draft = self._scene, Scene()
        objects = scene.objects
        mine = dict(zip(self._items, objects[first:], strict=False))
        added = objects[first + len(mine) :]
        taken = {item.name for item in objects} | set(self._selection.names[: shape_count(self._model)])
        for key, blocks in new.items():
            before, count = self._items.get(key), len(blocks.vertices)
            capacity = count if before is None or count <= before.capacity else max(count, 2 * before.capacity)
            name = free_name(self._name(key), taken) if before is None else before.name
            taken.add(name)
            vertices = blocks.filled_up(capacity)
            draft.add((vertices, blocks.all_faces(capacity)), name=name, label=self._label(key), movable=True)
            self._items[key] = _VisualObject(name, capacity, np.array(blocks.faces), vertices)
            mine[key] = draft[name]
        put_objects(scene, [*objects[:first], *mine.values(), *added], names_of_parents(objects))

    def _number(self, key: VisualKey) -> int | None:
        return drawn_number(self._model, key.kind, key.which)

    def _name(self, key: VisualKey) -> str:
        number = self._number(key)
        if number is None:
            return f"{mujoco.mju_type2Str(key.kind) or 'mark'}_{key.which}_{key.part}"
        name = self._selection.names[number]
        return name if key.part in MAIN_PARTS else f"{name}_{key.part}"

    def _label(self, key: VisualKey) -> int:
        number = self._number(key)
        return Label.OBSTACLE if number is None else self._selection.labels[number]


def names_of_parents(objects: Sequence[SceneObject]) -> dict[str, str]:
    """Return the name of the object to which each attached object is attached, by name."""
    return {item.name: objects[item.parent].name for item in objects if item.parent is not None}


def put_objects(scene: Scene, objects: Sequence[SceneObject], parents: Mapping[str, str]) -> None:
    """Replace a scene's objects, attached to parents of the given names."""
    index = {item.name: number for number, item in enumerate(objects)}
    scene.replace_objects(
        [replace(item, parent=index[parents[item.name]]) if item.name in parents else item for item in objects]
    )
