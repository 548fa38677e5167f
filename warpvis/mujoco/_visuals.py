# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo's visual elements other than geoms and sites: skins, flexes, tendons, and elements enabled by options.

They come from `mjv_updateScene` (src/engine/engine_vis_visualize.c), with the vertices of skins and flexes, and are
scene objects with moving vertices and fixed faces.
"""

from __future__ import annotations

import copy
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from typing import NamedTuple

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.mujoco._appearances import SHININESS, blending, texture_number, texture_of
from warpvis.mujoco._scene import ADDING_FLAGS, JOINT_WRAP
from warpvis.mujoco._tessellation import (
    SIMPLE_SHAPES,
    Blocks,
    Eye,
    bands,
    box_edges,
    facing,
    simple_normals,
    simple_shapes,
)
from warpvis.mujoco._texture_coordinates import stored_uv
from warpvis.scene.materials import Appearance, Material

_GEOM, _OBJ = mujoco.mjtGeom, mujoco.mjtObj
_LINES = int(_GEOM.mjGEOM_LINE), int(_GEOM.mjGEOM_LINEBOX)
_FLAT = int(_GEOM.mjGEOM_BOX), int(_GEOM.mjGEOM_TRIANGLE)
_SHAPES = int(_OBJ.mjOBJ_GEOM), int(_OBJ.mjOBJ_SITE)
_FRAMES_OF_SHAPES = mujoco.mjtFrame.mjFRAME_GEOM, mujoco.mjtFrame.mjFRAME_SITE
_ALL, _DECOR = int(mujoco.mjtCatBit.mjCAT_ALL), int(mujoco.mjtCatBit.mjCAT_DECOR)
MAX_GEOMS = 10000
"""The default of `mujoco.Renderer`."""

_BOX_WIDTH = 1.5  # of lines that are edges of boxes, relative to the model's line width
_SENSORS = [int(getattr(mujoco.mjtSensor, f"mjSENS_{name}")) for name in ("RANGEFINDER", "GEOMFROMTO")]
_CRANK = int(mujoco.mjtTrn.mjTRN_SLIDERCRANK)


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


class Paint(NamedTuple):
    """The appearance of n shapes with f faces and t vertices each."""

    colors: NDArray[np.float32]
    """Colors of the shapes with opacity, from 0 to 1, shape ``(n, 4)``."""
    material: Material
    uv: NDArray[np.float32] | None = None
    """Texture coordinates, ``(n f, 3, 2)`` or ``(n t, 2)``."""
    normals: NDArray[np.floating] | None = None
    """Normals of the corners of the triangles, ``(n f, 3, 3)``, or of the vertices, ``(n t, 3)``."""

    def filled_up(self, count: int) -> Paint:
        """Return the appearance of `count` shapes, of which the last ones are copies."""
        shapes = len(self.colors)
        chosen = np.minimum(np.arange(count), shapes - 1)

        def chosen_rows(rows: np.ndarray | None) -> np.ndarray | None:
            return (
                None if rows is None else rows.reshape(shapes, -1, *rows.shape[1:])[chosen].reshape(-1, *rows.shape[1:])
            )

        uv, normals = chosen_rows(self.uv), chosen_rows(self.normals)
        return self._replace(colors=self.colors[chosen], uv=uv, normals=normals)

    def looks_like(self, other: Paint) -> bool:
        """Return whether another appearance differs in normals only."""
        mine, theirs, names = self.material, other.material, ("alpha_mode", "specular", "shininess", "emission")
        is_same = mine.texture is theirs.texture and all(getattr(mine, name) == getattr(theirs, name) for name in names)
        same_uv = (
            np.array_equal(self.uv, other.uv) if self.uv is not None and other.uv is not None else self.uv is other.uv
        )
        return is_same and same_uv and np.array_equal(self.colors, other.colors)

    def appearance(self, faces: int) -> Appearance:
        """Return it as the appearance of a mesh, given the number of faces per shape."""
        if (self.colors == self.colors[0]).all():
            return Appearance((replace(self.material, base_color=tuple(self.colors[0].tolist())),), uv=self.uv)
        return Appearance((self.material,), uv=self.uv, face_colors=np.repeat(self.colors, faces, axis=0))


class Visuals:
    """Reads MuJoCo's visual elements of a model."""

    def __init__(self, model: mujoco.MjModel, *, mesh_tolerance: float, max_geoms: int = MAX_GEOMS) -> None:
        self._model, self._mesh_tolerance, self._max_geoms = model, mesh_tolerance, max_geoms
        self._default = draws_by_default(model)
        self._plain = _without_shapes(mujoco.MjvOption())
        self._scene: mujoco.MjvScene | None = None
        self._geoms: dict[VisualKey, list[mujoco.MjvGeom]] = {}
        self._counts: dict[VisualKey, int] = {}
        self._smooth: dict[VisualKey, Callable[[], NDArray[np.float64]]] = {}
        """Functions that compute the normals of the edges and vertices of flexes."""
        self._texture = cache(partial(texture_of, model))
        self.undrawn: list[str] = []
        """Elements of the last `read` that are not supported."""

    def clear(self) -> None:
        """Forget the elements of the last `read`."""
        self._geoms = {}

    def may_draw(self, option: mujoco.MjvOption | None) -> bool:
        """Return whether there may be elements to draw."""
        if self._default or option is None:
            return self._default
        return option.frame != mujoco.mjtFrame.mjFRAME_NONE or bool(option.flags[ADDING_FLAGS].any())

    def read(
        self, data: mujoco.MjData, viewer: mujoco.MjvCamera, option: mujoco.MjvOption | None, eye: Eye | None
    ) -> dict[VisualKey, Blocks]:
        """Return the elements other than geoms and sites that MuJoCo draws now, for the camera `eye`.

        Without `eye`, lines and single triangles must not be enabled.
        """
        if self._scene is None:
            self._scene = mujoco.MjvScene(self._model, maxgeom=self._max_geoms)
        scene, chosen = self._scene, self._plain if option is None else _without_shapes(option)
        mujoco.mjv_updateScene(self._model, data, chosen, None, viewer, _ALL, scene)
        drawn: dict[VisualKey, Blocks] = {}
        simple: dict[VisualKey, list[mujoco.MjvGeom]] = defaultdict(list)
        soft: dict[VisualKey, list[mujoco.MjvGeom]] = {}
        left_out: dict[str, None] = {}
        for geom in scene.geoms[: scene.ngeom]:
            kind = geom.type
            if geom.objtype in _SHAPES and geom.category != _DECOR:
                continue
            if kind == _GEOM.mjGEOM_SKIN:
                key = VisualKey(geom.objtype, geom.objid, "skin")
                drawn[key], soft[key] = self._skin(scene, geom.objid), [geom]
            elif kind == _GEOM.mjGEOM_FLEX:
                parts = dict(self._flex(scene, geom.objid, float(geom.size[0])))
                drawn |= parts
                soft |= {key: [geom] for key in parts}
            elif kind in SIMPLE_SHAPES or kind in _LINES:
                part = _GEOM(kind).name.removeprefix("mjGEOM_").lower()
                simple[VisualKey(geom.objtype, geom.objid, part)].append(geom)
            else:
                left_out[f"{_GEOM(kind).name} of {_OBJ(geom.objtype).name}"] = None
        for key, geoms in simple.items():
            drawn[key] = self._shapes(geoms, eye)
        self.undrawn, self._geoms = list(left_out), {**simple, **soft}
        self._counts = {key: len(blocks.vertices) for key, blocks in drawn.items()}
        return drawn

    def paints(self) -> dict[VisualKey, Paint]:
        """Return the appearances of the elements of the last `read`."""
        return {key: self._paint(key, geoms) for key, geoms in self._geoms.items()}

    def _paint(self, key: VisualKey, geoms: list[mujoco.MjvGeom]) -> Paint:
        first = geoms[0]
        colors = np.clip(np.array([geom.rgba for geom in geoms], dtype=np.float32), 0, 1)
        if len(colors) < self._counts[key]:  # several shapes of one geom, or a box of lines
            colors = np.repeat(colors, self._counts[key] // len(colors), axis=0)
        uv = self._uv(key, first)
        shine, emission = min(max(float(first.specular), 0.0), 1.0), max(0.0, float(first.emission))
        material = Material(
            **blending(float(colors[:, 3].min())),
            specular=(shine, shine, shine),
            shininess=SHININESS * max(0.0, float(first.shininess)),
            emission=tuple((emission * colors[0, :3]).tolist()),
            texture=None if uv is None else self._texture(texture_number(self._model, int(first.matid))),
        )
        return Paint(colors, material, uv, self._normals(key, geoms))

    def _uv(self, key: VisualKey, geom: mujoco.MjvGeom) -> NDArray[np.float32] | None:
        """Return the texture coordinates of a skin or flex with a two-dimensional texture; None for other elements."""
        model, material, which = self._model, int(geom.matid), key.which
        number = texture_number(model, material) if material >= 0 else -1
        if number < 0 or int(model.tex_type[number]) != mujoco.mjtTexture.mjTEXTURE_2D:
            return None
        if key.part == "skin" and model.skin_texcoordadr[which] >= 0:
            first = int(model.skin_texcoordadr[which])
            rows = model.skin_texcoord[first : first + int(model.skin_vertnum[which])]
        elif key.part == "faces" and self._scene is not None and geom.texcoord:
            first, used = self._scene.flexfaceadr[which], int(self._scene.flexfaceused[which])
            rows = self._scene.flextexcoord.reshape(-1, 3, 2)[first:][:used]
        else:
            return None
        return stored_uv(rows, np.ones(3), model.mat_texrepeat[material].astype(np.float64), uniform=False)

    def _normals(self, key: VisualKey, geoms: list[mujoco.MjvGeom]) -> NDArray[np.floating] | None:
        """Return the normals of an element; None for flat triangles."""
        scene, model, which = self._scene, self._model, key.which
        assert scene is not None  # there are geoms
        if key.part == "skin":
            first = model.skin_vertadr[which]
            normals = scene.skinnormal.reshape(-1, 3)[first : first + model.skin_vertnum[which]].astype(np.float64)
            normals[~normals.any(axis=1)] = 0, 0, 1  # vertices without faces
            return normals
        if key.part == "faces":
            first, used = scene.flexfaceadr[which], int(scene.flexfaceused[which])
            normals = scene.flexnormal.reshape(-1, 3, 3)[first:][:used].astype(np.float64)
            return normals if np.linalg.norm(normals, axis=-1).all() else None
        if key in self._smooth:
            return self._smooth[key]().reshape(-1, 3, 3)
        if geoms[0].type not in SIMPLE_SHAPES or geoms[0].type in _FLAT:
            return None
        sizes = np.array([geom.size for geom in geoms], dtype=np.float64)
        rotation = np.array([geom.mat for geom in geoms], dtype=np.float64).reshape(-1, 3, 3)
        found = simple_normals(geoms[0].type, sizes, rotation, mesh_tolerance=self._mesh_tolerance)
        return found.reshape(-1, 3, 3)

    def _shapes(self, geoms: list[mujoco.MjvGeom], eye: Eye | None) -> Blocks:
        kind = geoms[0].type
        sizes, position, rotation = (
            np.array([getattr(geom, name) for geom in geoms], dtype=np.float64) for name in ("size", "pos", "mat")
        )
        rotation = rotation.reshape(-1, 3, 3)
        if kind not in _LINES and kind != _GEOM.mjGEOM_TRIANGLE:
            return simple_shapes(kind, sizes, position, rotation, mesh_tolerance=self._mesh_tolerance)
        assert eye is not None  # lines and triangles are enabled with a camera only
        if kind == _GEOM.mjGEOM_TRIANGLE:
            shapes = simple_shapes(kind, sizes, position, rotation, mesh_tolerance=self._mesh_tolerance)
            return replace(shapes, vertices=facing(shapes.vertices, eye))
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
            key = VisualKey(kind, flex, "vertices")
            self._smooth[key] = partial(simple_normals, ball, sizes, rotation, mesh_tolerance=tolerance)
            yield key, balls
        count = int(scene.flexedgenum[flex])
        if scene.flexedgeopt and count:
            edges = scene.flexedge.reshape(-1, 2)[scene.flexedgeadr[flex] :][:count]
            key = VisualKey(kind, flex, "edges")
            yield key, self._rods(key, vertices[edges], radius)

    def _rods(self, key: VisualKey, ends: NDArray[np.float64], radius: float) -> Blocks:
        """Build open cylinders between pairs of points, ``(n, 2, 3)``."""
        along = ends[:, 1] - ends[:, 0]
        length = np.linalg.norm(along, axis=1)
        sizes = np.stack([np.full_like(length, radius), np.full_like(length, radius), length / 2], axis=1)
        kind, rotation, options = int(_GEOM.mjGEOM_CYLINDER), _rotations_to(along), {"open_ends": True}
        self._smooth[key] = partial(
            simple_normals, kind, sizes, rotation, mesh_tolerance=self._mesh_tolerance, **options
        )
        return simple_shapes(kind, sizes, ends.mean(axis=1), rotation, mesh_tolerance=self._mesh_tolerance, **options)


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
