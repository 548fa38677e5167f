# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo's visual elements other than geoms and sites: skins, flexes, tendons, and elements enabled by options.

They come from `mjv_updateScene` (src/engine/engine_vis_visualize.c), with the vertices of skins and flexes.
"""

from __future__ import annotations

import copy
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.errors import SceneError
from warpvis.mujoco._geoms import DEFAULT_GROUPS, has_opacity
from warpvis.mujoco._shapes import drawn_number
from warpvis.mujoco._tessellation import Blocks, Eye, bands, box_edges, facing, is_simple, line_ends, simple_shapes

_GEOM, _OBJ = mujoco.mjtGeom, mujoco.mjtObj
_LINES = int(_GEOM.mjGEOM_LINE), int(_GEOM.mjGEOM_LINEBOX)
_SHAPES = int(_OBJ.mjOBJ_GEOM), int(_OBJ.mjOBJ_SITE)
_FRAMES_OF_SHAPES = mujoco.mjtFrame.mjFRAME_GEOM, mujoco.mjtFrame.mjFRAME_SITE
_ALL, _DECOR = int(mujoco.mjtCatBit.mjCAT_ALL), int(mujoco.mjtCatBit.mjCAT_DECOR)
_MAX_GEOMS = 10000  # the default of mujoco.Renderer
_BOX_WIDTH = 1.5  # of lines that are edges of boxes, relative to the model's line width
_SENSORS = [int(getattr(mujoco.mjtSensor, f"mjSENS_{name}")) for name in ("RANGEFINDER", "GEOMFROMTO")]
_JOINT_WRAP, _CRANK = int(mujoco.mjtWrap.mjWRAP_JOINT), int(mujoco.mjtTrn.mjTRN_SLIDERCRANK)

# Indices of the flags of a `mujoco.MjvOption`.
_FLAGS = {
    name.removeprefix("mjVIS_"): int(flag)
    for name, flag in mujoco.mjtVisFlag.__members__.items()
    if name.startswith("mjVIS_")
}
_SOFT_FLAGS = "SKIN", "TENDON", "FLEXVERT", "FLEXEDGE", "FLEXFACE", "FLEXSKIN"
# Flags that only change the appearance of geoms, sites, skins, flexes and tendons, or what other flags draw.
_ADD_NOTHING = (
    *("CONVEXHULL", "TEXTURE", "ACTIVATION", "RANGEFINDER", "SCLINERTIA", "PERTOBJ", "ISLAND", "CONTACTSPLIT"),
    *("TRANSPARENT", "STATIC", *_SOFT_FLAGS),
)
_ADDING = [flag for name, flag in _FLAGS.items() if name not in _ADD_NOTHING]

MAIN_PARTS = "skin", "faces", "capsule"
"""The main, and mostly only, shapes of skins, flexes and tendons."""


def shown_by(option: mujoco.MjvOption | None) -> tuple[tuple[int, ...], bool, tuple[int, ...]]:
    """Return the shown groups of geoms, whether geoms welded to the world are shown, and the shown groups of sites."""
    if option is None:
        return DEFAULT_GROUPS, True, DEFAULT_GROUPS
    if not isinstance(option, mujoco.MjvOption):
        raise SceneError(f"scene_option must be a mujoco.MjvOption, got {type(option).__name__}")
    if option.flags[_FLAGS["CONVEXHULL"]]:
        raise SceneError("scene_option must not enable convex hulls (mjVIS_CONVEXHULL), which are not rendered")
    groups, sites = (tuple(np.flatnonzero(shown).tolist()) for shown in (option.geomgroup, option.sitegroup))
    return groups, bool(option.flags[_FLAGS["STATIC"]]), sites


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
    spatial = (wraps != _JOINT_WRAP).any()
    return bool(model.nskin or model.nflex or model.nplugin or spatial or cranks or rays)


def soft_names(model: mujoco.MjModel, names: Sequence[str], option: mujoco.MjvOption | None) -> dict[int, str]:
    """Return the names of the skins, flexes and spatial tendons that MuJoCo draws, by their numbers in `names`."""
    option = mujoco.MjvOption() if option is None else option
    flags = {name: bool(option.flags[_FLAGS[name]]) for name in _SOFT_FLAGS}
    of_flex = any(flags[name] for name in _SOFT_FLAGS if name.startswith("FLEX"))
    kinds = (("skin", option.skingroup, flags["SKIN"]), ("flex", option.flexgroup, of_flex))
    found = {}
    for kind, groups, drawn in (*kinds, ("tendon", option.tendongroup, flags["TENDON"])):
        for index in range(getattr(model, f"n{kind}")):
            group, rgba, material = (getattr(model, f"{kind}_{name}")[index] for name in ("group", "rgba", "matid"))
            if kind == "tendon":  # visible regardless of opacity
                shows = model.wrap_type[model.tendon_adr[index]] != _JOINT_WRAP
            else:
                shows = has_opacity(model, rgba, int(material))
            number = drawn_number(model, int(getattr(_OBJ, f"mjOBJ_{kind.upper()}")), index)
            if drawn and shows and groups[min(max(int(group), 0), len(groups) - 1)] and number is not None:
                found[number] = f"{kind} {names[number]!r}"
    return found


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
        return option.frame != mujoco.mjtFrame.mjFRAME_NONE or bool(option.flags[_ADDING].any())

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
            elif is_simple(kind) or kind in _LINES:
                simple[VisualKey(geom.objtype, geom.objid, _GEOM(kind).name.removeprefix("mjGEOM_").lower())].append(
                    geom
                )
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
        return bands(line_ends(sizes, position, rotation), one * float(sizes[0, 0]), eye)

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
            yield VisualKey(kind, flex, "vertices"), self._balls(vertices, radius)
        count = int(scene.flexedgenum[flex])
        if scene.flexedgeopt and count:
            edges = scene.flexedge.reshape(-1, 2)[scene.flexedgeadr[flex] :][:count]
            yield VisualKey(kind, flex, "edges"), self._rods(vertices[edges], radius)

    def _balls(self, middles: NDArray[np.float64], radius: float) -> Blocks:
        sizes = np.full((len(middles), 3), radius)
        rotation = np.broadcast_to(np.eye(3), (len(middles), 3, 3))
        return simple_shapes(int(_GEOM.mjGEOM_SPHERE), sizes, middles, rotation, mesh_tolerance=self._mesh_tolerance)

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
