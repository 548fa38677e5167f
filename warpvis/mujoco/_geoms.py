# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The geoms and sites of a MuJoCo model as parts of a scene: visibility, shapes, labels and poses.

In this module, "geom" may also mean a site: `warpvis.mujoco._model_fields` defines their numbering.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Sequence

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_items, is_whole
from warpvis.core.labels import Label
from warpvis.errors import SceneError
from warpvis.mujoco import _tessellation as tessellation
from warpvis.mujoco._appearances import GeomAppearances
from warpvis.mujoco._model_fields import DEFAULT_COLOR, shape_bodies, shape_count, shape_data, shape_places, shape_value
from warpvis.mujoco._tessellation import Mesh
from warpvis.scene import Part, solids
from warpvis.scene.solids import DEFAULT_MESH_TOLERANCE, Solid

DEFAULT_GROUPS = (0, 1, 2)
"""The geom groups that MuJoCo draws by default (`mjv_defaultOption` in src/engine/engine_vis_init.c)."""

INFINITE_PLANE = 10.0
"""Half size of an infinite plane, as a multiple of the distance of the far clipping plane."""

FIXED = -1
"""The piece of static geoms."""

_GROUND_NAMES = ("*floor*", "*ground*")
_GEOM = mujoco.mjtGeom


def geom_parts(
    model: mujoco.MjModel,
    geoms: Iterable[int],
    names: Sequence[str],
    labels: Sequence[int],
    *,
    mesh_tolerance: float = DEFAULT_MESH_TOLERANCE,
    pieces: NDArray[np.int32] | None = None,
    poses: NDArray[np.float64] | None = None,
) -> list[tuple[int, Part]]:
    """Make parts of the geoms that have a shape, with their geoms, at the model's initial poses.

    Names, labels, pieces (by default those of `rigid_pieces`) and poses (by default `initial_poses`) are those of all
    geoms. Round solids and geoms of moving pieces are movable: the geoms of one piece are attached to its first.
    """
    pieces = rigid_pieces(model) if pieces is None else pieces
    poses = initial_poses(model) if poses is None else poses
    bodies = shape_bodies(model)
    first_of: dict[int, str] = {}  # the part of a piece that carries the pose
    appearances = GeomAppearances(model)
    shapes: dict[tuple[float, ...], Mesh | Solid | None] = {}  # geoms of equal shape share arrays
    parts = []
    for geom in geoms:
        key = shape_key(model, geom)
        if key not in shapes:
            shapes[key] = geom_shape(model, geom, mesh_tolerance)
        shape = shapes[key]
        if shape is None:
            continue
        name, by_itself, piece = names[geom], isinstance(shape, Solid), int(pieces[geom])
        first = first_of.setdefault(piece, name) if piece != FIXED and not by_itself else name
        part = Part(
            name,
            shape,
            labels[geom],
            poses[geom],
            movable=piece != FIXED or by_itself,
            attach_to=None if first == name else first,
            aliases=(model.body(bodies[geom]).name,),
            appearance=appearances.of(geom, shape),
        )
        parts.append((geom, part))
    return parts


def shown_geoms(model: mujoco.MjModel, groups: Sequence[int], site_groups: Sequence[int] = ()) -> list[int]:
    """List the geoms and sites of the given groups that are not fully transparent."""
    geoms, count = range(model.ngeom), shape_count(model) if site_groups else 0
    drawn = [(geom, groups) for geom in geoms] + [(site, site_groups) for site in range(model.ngeom, count)]
    last = mujoco.mjNGROUP - 1  # MuJoCo clamps groups
    shown = [s for s, chosen in drawn if min(max(int(shape_value(model, "group", s)), 0), last) in chosen]
    return [s for s in shown if has_opacity(model, shape_value(model, "rgba", s), int(shape_value(model, "matid", s)))]


def rigid_pieces(
    model: mujoco.MjModel, *, loose_bodies: Iterable[int] = (), independent: Iterable[int] = ()
) -> NDArray[np.int32]:
    """Assign piece numbers, ``(shapes,)``: geoms that move together share a number; static geoms have `FIXED`.

    `loose_bodies` are welded to the world but movable, and `independent` geoms do not move with their bodies.
    """
    # The number of a piece is that of a body; body_weldid is 0 for the world body and for mocap bodies.
    piece_of_body = np.where(np.asarray(model.body_weldid) > 0, model.body_weldid, np.arange(model.nbody))
    piece_of_body[~movable_bodies(model)] = FIXED
    loose = list(loose_bodies)
    piece_of_body[loose] = loose
    pieces: NDArray[np.int32] = piece_of_body[shape_bodies(model)].astype(np.int32)
    single = list(independent)
    pieces[single] = model.nbody + np.array(single, dtype=np.int32)
    return pieces


def movable_bodies(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return which bodies can move, ``(nbody,)``: those not welded to the world, mocap bodies, and their descendants.

    `bodycategory` in src/engine/engine_vis_visualize.c; older MuJoCo counts mocap bodies as welded to the world.
    """
    moves = (np.asarray(model.body_weldid) != 0) | (np.asarray(model.body_mocapid) >= 0)
    for body in range(1, model.nbody):  # parents come first
        moves[body] |= moves[model.body_parentid[body]]
    return moves


def check_groups(groups: Iterable[int], name: str = "geom_groups") -> tuple[int, ...]:
    """Return the groups as a sorted tuple."""
    known = range(mujoco.mjNGROUP)
    items = [groups] if is_whole(groups) else as_items(groups, name, SceneError)
    if not all(is_whole(group) and group in known for group in items):
        raise SceneError(f"{name} must be of 0 to {known[-1]}, got {tuple(items)}")
    return tuple(sorted({int(group) for group in items}))


def shape_key(model: mujoco.MjModel, geom: int) -> tuple[float, ...]:
    """Return the key of a geom's shape: geoms with equal keys share their shape."""
    kind, data = int(shape_value(model, "type", geom)), shape_data(model, geom)
    if data >= 0:
        return kind, data
    far = _infinite(model) if kind == _GEOM.mjGEOM_PLANE else 0.0
    return (kind, *shape_value(model, "size", geom).tolist(), far)


def has_opacity(model: mujoco.MjModel, rgba: NDArray[np.float32], material: int) -> bool:
    """Return whether a color is not fully transparent: by default, the color of its material (-1 for none) counts."""
    uses_geom_color = material < 0 or tuple(rgba.tolist()) != DEFAULT_COLOR
    return bool((rgba[3] if uses_geom_color else model.mat_rgba[material][3]) != 0)


def _infinite(model: mujoco.MjModel) -> float:
    """Return the half size of an infinite plane."""
    return float(INFINITE_PLANE * model.vis.map.zfar * model.stat.extent)


def geom_shape(model: mujoco.MjModel, geom: int, mesh_tolerance: float) -> Mesh | Solid | None:
    """Make a geom's shape in its frame; None if it has no shape."""
    kind, data = int(shape_value(model, "type", geom)), shape_data(model, geom)
    a, b, c = shape_value(model, "size", geom).tolist()
    if kind == _GEOM.mjGEOM_PLANE:
        far = _infinite(model)
        return tessellation.plane(a if a > 0 else far, b if b > 0 else far)
    if kind == _GEOM.mjGEOM_SPHERE:
        return solids.sphere(a, mesh_tolerance=mesh_tolerance)
    if kind == _GEOM.mjGEOM_CAPSULE:
        return solids.capsule(a, b, mesh_tolerance=mesh_tolerance)
    if kind == _GEOM.mjGEOM_ELLIPSOID:
        return solids.ellipsoid((a, b, c), mesh_tolerance=mesh_tolerance)
    if kind == _GEOM.mjGEOM_CYLINDER:
        return solids.cylinder(a, b, mesh_tolerance=mesh_tolerance)
    if kind == _GEOM.mjGEOM_BOX:
        return tessellation.box((a, b, c))
    return stored_mesh(model, kind, data)


def stored_mesh(model: mujoco.MjModel, kind: int, data: int) -> Mesh | None:
    """Make a height field, a mesh, or a signed distance field's mesh from the model's data; None if it has none."""
    if kind == _GEOM.mjGEOM_HFIELD:
        rows, columns, first = model.hfield_nrow[data], model.hfield_ncol[data], model.hfield_adr[data]
        elevation = model.hfield_data[first : first + rows * columns].reshape(rows, columns)
        return tessellation.height_field(elevation.astype(np.float64), np.array(model.hfield_size[data]))
    if data < 0:
        return None
    first_vertex, first_face = model.mesh_vertadr[data], model.mesh_faceadr[data]
    vertices = model.mesh_vert[first_vertex : first_vertex + model.mesh_vertnum[data]]
    faces = model.mesh_face[first_face : first_face + model.mesh_facenum[data]]
    return (vertices.astype(np.float64), faces.astype(np.int32)) if len(faces) else None


def default_label(model: mujoco.MjModel, geom: int, name: str) -> Label:
    """Label a geom by its shape and name: ground, or an obstacle."""
    if geom >= model.ngeom:  # sites are never ground
        return Label.OBSTACLE
    flat = int(model.geom_type[geom]) in (_GEOM.mjGEOM_PLANE, _GEOM.mjGEOM_HFIELD)
    return Label.GROUND if flat or fits(name.lower(), _GROUND_NAMES) else Label.OBSTACLE


def fits(name: str, patterns: Iterable[str]) -> bool:
    """Return whether a name matches one of the patterns."""
    return any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns)


def initial_poses(model: mujoco.MjModel, data: mujoco.MjData | None = None) -> NDArray[np.float64]:
    """Return the initial poses of geoms and sites, shape to world, ``(shapes, 4, 4)``; `data` is scratch memory."""
    data = mujoco.MjData(model) if data is None else data
    mujoco.mj_resetData(model, data)
    mujoco.mj_kinematics(model, data)
    poses = np.zeros((shape_count(model), 4, 4))
    position, rotation = shape_places(data)
    poses[:, :3, :3] = rotation.reshape(-1, 3, 3)
    poses[:, :3, 3], poses[:, 3, 3] = position, 1
    return poses
