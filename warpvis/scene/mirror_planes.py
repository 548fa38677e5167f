# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Mirrors of a scene: planes of flat surfaces whose material has a reflectance, and boxes of all objects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.user_warnings import warn_user
from warpvis.scene._object import SceneObject
from warpvis.scene.materials import Appearance

_MAX_PLANES = 6
"""Maximum number of planes of an object that mirror: those of a box."""
_MAX_ANGLE = 1e-3
"""Maximum angle between triangles of one plane [rad]."""
_FLATNESS = 1e-5
"""Maximum distance of corners from their plane, as a fraction of the size of the object."""


class Mirror(NamedTuple):
    """A plane of an object whose surfaces mirror, in the frame of a movable object, or in the world."""

    owner: int
    """Index of the object."""
    column: int
    """Index of the movable object whose frame it is; -1 for the world."""
    point: tuple[float, ...]
    normal: tuple[float, ...]
    """Unit normal of the faces."""
    reflectance: float


class Mirrors(NamedTuple):
    """All mirrors of a scene, in the order of objects, those of an object by their area."""

    planes: tuple[Mirror, ...]
    columns: wp.array
    """Index of the movable object that each object follows, -1 for static ones, ``(objects,)`` int32."""
    centers: wp.array
    """Centers of the boxes of objects in that frame [m], ``(objects,)`` vec3d."""
    halves: wp.array
    """Half sizes of these boxes [m], infinite for deforming objects, ``(objects,)`` vec3d."""


def find_mirrors(objects: Sequence[SceneObject], movable: Sequence[int], device: wp.Device) -> Mirrors | None:
    """Return the mirrors of a scene; None if it has none."""
    rows = {index: row for row, index in enumerate(movable)}
    columns = [rows.get(index if item.parent is None else item.parent, -1) for index, item in enumerate(objects)]
    planes: list[Mirror] = []
    for index, item in enumerate(objects):
        look = item.appearance
        if look is not None and any(material.reflectance > 0 for material in look.materials):
            planes += [Mirror(index, columns[index], *plane) for plane in _planes(item, look)]
    if not planes:
        return None
    boxes = np.empty((len(objects), 2, 3))
    for box, item in zip(boxes, objects, strict=True):
        corners = item.frame_vertices
        box[:] = [[-np.inf], [np.inf]] if item.mesh.deforms else [corners.min(axis=0), corners.max(axis=0)]
    with np.errstate(invalid="ignore"):
        centers, halves = np.nan_to_num((boxes[:, 0] + boxes[:, 1]) / 2), (boxes[:, 1] - boxes[:, 0]) / 2
    return Mirrors(
        tuple(planes),
        wp.array(np.array(columns, dtype=np.int32), dtype=wp.int32, device=device),
        wp.array(centers, dtype=wp.vec3d, device=device),
        wp.array(halves, dtype=wp.vec3d, device=device),
    )


def _planes(item: SceneObject, look: Appearance) -> list[tuple[tuple[float, ...], tuple[float, ...], float]]:
    """Return a point, the normal and the reflectance of each plane of an object that mirrors, the largest first."""
    if item.solid is not None or item.mesh.deforms:
        return []
    materials = [material.reflectance if material.alpha_mode == "opaque" else 0.0 for material in look.materials]
    rows = np.zeros(len(item.faces), dtype=np.int32) if look.face_materials is None else look.face_materials
    shares, faces = np.array(materials)[rows], item.faces
    faces, shares = faces[shares > 0], shares[shares > 0]
    corners = item.frame_vertices[faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    corners, normals, shares, area = corners[area > 0], normals[area > 0], shares[area > 0], area[area > 0]
    normals /= area[:, None]
    found: list[tuple[float, NDArray[np.float64], NDArray[np.float64], float]] = []
    tolerance = _FLATNESS * float(np.ptp(corners.reshape(-1, 3), axis=0).max(initial=0.0)) if len(corners) else 0.0
    while len(area):
        if len(found) == _MAX_PLANES:
            warn_user(
                f"{item.name!r} does not mirror: its surfaces with reflectance are in more than {_MAX_PLANES} planes",
                UserWarning,
            )
            return []
        largest = int(area.argmax())
        point, normal = corners[largest, 0], normals[largest]
        is_same = (normals @ normal > np.cos(_MAX_ANGLE)) & (
            np.abs((corners - point) @ normal).max(axis=1) <= tolerance
        )
        is_same[largest] = True
        found.append((float(area[is_same].sum()), point, normal, float(shares[largest])))
        corners, normals, shares, area = corners[~is_same], normals[~is_same], shares[~is_same], area[~is_same]
    found.sort(key=lambda plane: -plane[0])
    return [(tuple(point.tolist()), tuple(normal.tolist()), share) for _, point, normal, share in found]
