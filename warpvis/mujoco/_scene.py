# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A MuJoCo model's geoms as a scene."""

from __future__ import annotations

import copy
import fnmatch
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import Label
from warpvis.core.types import DeviceLike
from warpvis.errors import SceneError
from warpvis.mujoco import _tessellation as tessellation
from warpvis.mujoco._tessellation import Mesh
from warpvis.scene import Scene, solids
from warpvis.scene.solids import DEFAULT_TOLERANCE, Solid, check_metres

Movable = Literal["bodies", "all"]

DEFAULT_GROUPS = (0, 1, 2)
"""The geom groups that MuJoCo draws by default (`mjv_defaultOption` in src/engine/engine_vis_init.c)."""

INFINITE_PLANE = 10.0
"""Half size of an infinite plane, in times the distance of the far clipping plane."""

_GROUND_NAMES = ("*floor*", "*ground*")
_GEOM = mujoco.mjtGeom


@dataclass(frozen=True, eq=False)
class MujocoScene:
    """A MuJoCo model's geoms as a scene, and which geom is which object; `scene_from_mujoco` makes it.

    Objects that are added to `scene` come after the geoms' own.
    """

    scene: Scene
    """The geoms as objects, in the order of `geom_ids`, and whatever was added to them."""
    geom_ids: NDArray[np.int32]
    """The geom of each of the scene's first objects, shape ``(G,)``."""
    movable_geoms: NDArray[np.int32]
    """The geoms whose poses say where all that moves is: the first columns of object poses, shape ``(M,)``."""
    geom_count: int
    """How many geoms the model has, shown or not."""

    def __copy__(self) -> MujocoScene:
        """Share the meshes only: what is added to the copy is not in this one."""
        return replace(self, scene=copy.copy(self.scene))

    def to(self, device: DeviceLike) -> MujocoScene:
        """Return the same scene for another device."""
        return replace(self, scene=self.scene.to(device))

    def geoms_of_objects(self) -> NDArray[np.int32]:
        """List the geom of every object of the scene, shape ``(objects,)``; -1 of those that were added to it."""
        geoms = np.full(len(self.scene), -1, dtype=np.int32)
        geoms[: len(self.geom_ids)] = self.geom_ids
        return geoms


def scene_from_mujoco(
    model: mujoco.MjModel,
    *,
    geom_groups: Iterable[int] = DEFAULT_GROUPS,
    tolerance: float = DEFAULT_TOLERANCE,
    labels: Mapping[str, Label | int | str] | None = None,
    exclude: Iterable[str] = (),
    movable: Movable = "bodies",
    static: bool = True,
    device: DeviceLike = "cpu",
) -> MujocoScene:
    """Make a scene of a MuJoCo model's geoms, one object each, whether or not they collide.

    What MuJoCo's renderer leaves out is left out: geoms whose colour has alpha 0 (`addGeomGeoms` in
    src/engine/engine_vis_visualize.c). So are sites, tendons, skins and flexes, which MuJoCo draws. Sizes, meshes,
    heights and colours are read once, and so is where geoms are in their bodies; make another scene after changing
    them.

    All shapes are exact, but for planes from below, which are 0.1 mm lower there, and infinite ones, which end at 10
    times the distance of MuJoCo's far clipping plane from their origin. From inside of a round shape, and on export,
    its triangles stand for it; they are nowhere farther from it than `tolerance`, or 1e-4 of its largest radius if that
    is more.

    An object is named as its geom, or as the geom's body if the geom has no name, with ``_1``, ``_2``, ... where that
    is taken. Planes, height fields, and what has "floor" or "ground" in its name are `Label.GROUND`; the rest are
    `Label.OBSTACLE`, unless `labels` says otherwise.

    Args:
        model: A `mujoco.MjModel`.
        geom_groups: Groups of geoms to show, of 0 to 5; 0, 1 and 2 by default, as in MuJoCo.
        tolerance: Most distance between round shapes and their triangles [m].
        labels: Labels by name of the object or its body; a name may be a pattern (``"wall_*"``), and the last one that
            fits counts.
        exclude: Names or patterns of objects or bodies to leave out.
        movable: ``"bodies"``: geoms of bodies that are not welded to the world, and of mocap bodies, move, and all
            round ones; ``"all"``: so does every other geom, each by itself, for models whose geoms are moved by hand.
        static: Whether geoms show whose body is welded to the world.
        device: Where the scene is rendered.

    Raises:
        SceneError: An argument is not what it has to be, or a pattern fits nothing.
    """
    if not isinstance(model, mujoco.MjModel):
        raise SceneError(f"model must be a mujoco.MjModel, got {type(model).__name__}")
    if movable not in ("bodies", "all"):
        raise SceneError(f'movable must be "bodies" or "all", got {movable!r}')
    check_metres("tolerance", tolerance)
    groups, exclude = check_groups(geom_groups), tuple(exclude)
    names = _object_names(model)
    wanted, left_out = _assign_labels(model, names, labels or {}, exclude)
    moves = movable_bodies(model)[model.geom_bodyid]
    shown = [
        geom
        for geom in range(model.ngeom)
        if _group(model, geom) in groups and geom not in left_out and (static or moves[geom])
    ]
    scene = Scene(device=device)
    poses, kept = _initial_poses(model), []
    first_of: dict[int, str] = {}  # the object of a piece that has the pose
    for geom, shape in _meshes(model, shown, tolerance):
        name, alone = names[geom], isinstance(shape, Solid) or movable == "all"
        first = first_of.setdefault(_rigid_piece(model, geom), name) if moves[geom] and not alone else name
        carrier = None if first == name else first
        moving = bool(moves[geom]) or alone
        scene.add(shape, name=name, label=wanted[geom], pose=poses[geom], movable=moving, attach_to=carrier)
        kept.append(geom)
    geom_ids = np.array(kept, dtype=np.int32)
    return MujocoScene(scene, geom_ids, geom_ids[list(scene.movable)], int(model.ngeom))


def _rigid_piece(model: mujoco.MjModel, geom: int) -> int:
    """A body that the geom's body is welded to, the same one for all that move together."""
    body = int(model.geom_bodyid[geom])
    return int(model.body_weldid[body]) or body  # 0, the world, is said of mocap bodies too


def movable_bodies(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Which bodies can move: those not welded to the world, mocap bodies, and what hangs on these, shape ``(nbody,)``.

    `bodycategory` in src/engine/engine_vis_visualize.c; older MuJoCo counts mocap bodies as welded to the world.
    """
    moves = (np.asarray(model.body_weldid) != 0) | (np.asarray(model.body_mocapid) >= 0)
    for body in range(1, model.nbody):  # parents come first
        moves[body] |= moves[model.body_parentid[body]]
    return moves


def check_groups(groups: Iterable[int]) -> tuple[int, ...]:
    """The groups as a sorted tuple.

    Raises:
        SceneError: One is not a whole number from 0 to 5.
    """
    known = range(mujoco.mjNGROUP)
    groups = (groups,) if isinstance(groups, int) else tuple(groups)
    if not all(group in known for group in groups):
        raise SceneError(f"geom_groups must be of 0 to {known[-1]}, got {groups}")
    return tuple(sorted({int(group) for group in groups}))


def _group(model: mujoco.MjModel, geom: int) -> int:
    """The group that a geom counts for: MuJoCo clamps it."""
    return min(max(int(model.geom_group[geom]), 0), mujoco.mjNGROUP - 1)


def _meshes(model: mujoco.MjModel, geoms: Iterable[int], tolerance: float) -> list[tuple[int, Mesh | Solid]]:
    """Those geoms that are drawn, and their shapes in their frames: the same arrays for geoms of the same shape."""
    shared: dict[tuple[float, ...], Mesh | Solid | None] = {}
    drawn = []
    for geom in geoms:
        if _alpha(model, geom) == 0:
            continue
        kind = int(model.geom_type[geom])
        key: tuple[float, ...] = (kind, int(model.geom_dataid[geom]))
        if model.geom_dataid[geom] < 0:
            key = (kind, *model.geom_size[geom].tolist())
        if key not in shared:
            shared[key] = _mesh(model, geom, tolerance)
        mesh = shared[key]
        if mesh is not None:
            drawn.append((geom, mesh))
    return drawn


def _alpha(model: mujoco.MjModel, geom: int) -> float:
    """Opacity: the material's, unless the geom has a colour of its own (`setMaterial` in engine_vis_visualize.c)."""
    rgba, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    own = material < 0 or rgba.tolist() != [0.5, 0.5, 0.5, 1.0]
    return float(rgba[3] if own else model.mat_rgba[material][3])


def _mesh(model: mujoco.MjModel, geom: int, tolerance: float) -> Mesh | Solid | None:
    """A geom's shape in its own frame; None where it has none."""
    kind, data = int(model.geom_type[geom]), int(model.geom_dataid[geom])
    a, b, c = model.geom_size[geom].tolist()
    if kind == _GEOM.mjGEOM_PLANE:
        far = INFINITE_PLANE * model.vis.map.zfar * model.stat.extent
        return tessellation.plane(a if a > 0 else far, b if b > 0 else far)
    if kind == _GEOM.mjGEOM_HFIELD:
        return _height_field(model, data)
    if kind == _GEOM.mjGEOM_SPHERE:
        return solids.sphere(a, tolerance=tolerance)
    if kind == _GEOM.mjGEOM_CAPSULE:
        return solids.capsule(a, b, tolerance=tolerance)
    if kind == _GEOM.mjGEOM_ELLIPSOID:
        return solids.ellipsoid((a, b, c), tolerance=tolerance)
    if kind == _GEOM.mjGEOM_CYLINDER:
        return solids.cylinder(a, b, tolerance=tolerance)
    if kind == _GEOM.mjGEOM_BOX:
        return tessellation.box((a, b, c))
    return _compiled_mesh(model, data) if data >= 0 else None  # meshes, and signed distance fields that have one


def _compiled_mesh(model: mujoco.MjModel, mesh: int) -> Mesh | None:
    first_vertex, first_face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    vertices = model.mesh_vert[first_vertex : first_vertex + model.mesh_vertnum[mesh]]
    faces = model.mesh_face[first_face : first_face + model.mesh_facenum[mesh]]
    return (vertices.astype(np.float64), faces.astype(np.int32)) if len(faces) else None


def _height_field(model: mujoco.MjModel, field: int) -> Mesh:
    rows, columns, first = model.hfield_nrow[field], model.hfield_ncol[field], model.hfield_adr[field]
    elevation = model.hfield_data[first : first + rows * columns].reshape(rows, columns)
    return tessellation.height_field(elevation.astype(np.float64), np.array(model.hfield_size[field]))


def _object_names(model: mujoco.MjModel) -> list[str]:
    """Names of all geoms' objects, all different."""
    names = [model.geom(geom).name for geom in range(model.ngeom)]
    taken, last = {name for name in names if name}, dict.fromkeys(range(model.nbody), -1)
    for geom, body in enumerate(model.geom_bodyid.tolist()):
        while not names[geom]:
            last[body] += 1
            name = (model.body(body).name or f"body_{body}") + (f"_{last[body]}" if last[body] else "")
            if name not in taken:
                names[geom] = name
                taken.add(name)
    return names


def _assign_labels(
    model: mujoco.MjModel, names: list[str], labels: Mapping[str, Label | int | str], exclude: tuple[str, ...]
) -> tuple[list[Label], set[int]]:
    """Every geom's label, and the geoms that are left out."""
    wanted = [_default_label(model, geom, name) for geom, name in enumerate(names)]
    for pattern, label in labels.items():
        for geom in _fitting(model, names, pattern, "labels"):
            wanted[geom] = Label.parse(label)
    return wanted, {geom for pattern in exclude for geom in _fitting(model, names, pattern, "exclude")}


def _default_label(model: mujoco.MjModel, geom: int, name: str) -> Label:
    flat = int(model.geom_type[geom]) in (_GEOM.mjGEOM_PLANE, _GEOM.mjGEOM_HFIELD)
    return Label.GROUND if flat or _fits(name.lower(), _GROUND_NAMES) else Label.OBSTACLE


def _fitting(model: mujoco.MjModel, names: list[str], pattern: str, argument: str) -> list[int]:
    """The geoms whose object or body has a name that fits."""
    bodies = [model.body(body).name for body in range(model.nbody)]
    fitting = [
        geom
        for geom, (name, body) in enumerate(zip(names, model.geom_bodyid, strict=True))
        if _fits(name, (pattern,)) or _fits(bodies[body], (pattern,))
    ]
    if not fitting:
        some = ", ".join(map(repr, names[:10])) or "none"
        raise SceneError(f"{pattern!r} in {argument} fits no geom and no body of the model, which has {some}")
    return fitting


def _fits(name: str, patterns: Iterable[str]) -> bool:
    return any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns)


def _initial_poses(model: mujoco.MjModel) -> NDArray[np.float64]:
    """Geoms to world as the model is at first, matrices of shape ``(ngeom, 4, 4)``."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    poses = np.zeros((model.ngeom, 4, 4))
    poses[:, :3, :3] = data.geom_xmat.reshape(-1, 3, 3)
    poses[:, :3, 3], poses[:, 3, 3] = data.geom_xpos, 1
    return poses
