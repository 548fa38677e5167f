# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Texture coordinates of 2D and cube textures on MuJoCo's shapes, per triangle corner.

The formulas are those of MuJoCo 4's renderer: `makeBuiltin`, `sphere`, `halfSphere`, `cylinder`, `disk` and `makePlane`
in src/render/classic/render_context.c, and `settexture` in render_gl3.c. Renderers before MuJoCo 3.12 project textures
along z onto all shapes, and ignore repetitions on meshes with coordinates. MuJoCo's v is downward; here it is upward.
Coordinates include repetitions.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

Corners = NDArray[np.float64]

_GEOM = mujoco.mjtGeom
_PROJECTS = tuple(map(int, mujoco.__version__.split(".")[:2])) < (3, 12)
"""Whether the installed MuJoCo projects 2D textures onto all shapes without coordinates."""


def plain_uv(
    kind: int, size: Corners, vertices: Corners, faces: NDArray[np.int32], repeat: Corners, *, uniform: bool
) -> NDArray[np.float32]:
    """Compute coordinates of a 2D texture at the triangle corners of a shape in its geom's frame, ``(m, 3, 2)``.

    With `uniform`, the repetitions in u and v are per two meters instead of per shape.
    """
    corners = vertices[faces]
    size = _size(kind, size)
    sides = np.where(size[:2] > 0, size[:2], 1.0)
    along, shift = np.where(repeat > 0, repeat, 1.0) * (sides if uniform else 1.0), 0.0
    if kind in _UNIT and not _PROJECTS:
        uv = _UNIT[kind](corners / size, size)
    elif kind == _GEOM.mjGEOM_PLANE and not _PROJECTS:
        uv = np.where(size[:2] > 0, corners[..., :2] / sides + 1, corners[..., :2]) / 2
        uv[..., 1] += np.where(size[1] > 0, 0.0, 1.0)
        shift = 0.0 if (size[:2] > 0).all() else 0.5
    else:
        along = np.abs(repeat) * (1.0 if uniform else 1 / sides)
        uv = np.stack([0.5 * along[0] * corners[..., 0] - 0.5, 1.5 + 0.5 * along[1] * corners[..., 1]], axis=-1)
        return uv.astype(np.float32)
    return _repeated(uv, along, shift)


def stored_uv(rows: NDArray[np.floating], size: Corners, repeat: Corners, *, uniform: bool) -> NDArray[np.float32]:
    """Apply repetitions to a mesh's coordinates, whose v is downward, shape ``(m, 3, 2)``."""
    along = np.where(repeat > 0, repeat, 1.0) * (np.where(size[:2] > 0, size[:2], 1.0) if uniform else 1.0)
    if _PROJECTS:
        along = np.ones(2)
    uv = np.array(rows, dtype=np.float64)
    uv[..., 1] = 1 - uv[..., 1]
    return _repeated(uv, along, 0.0)


def box_cube_uv(corners: Corners, size: Corners, width: int) -> NDArray[np.float32]:
    """Compute coordinates of six vertically stacked images of the given width, one for each side of a box.

    They are for viewers without cube maps, and end at the centers of the border texels, so that sides do not mix.
    """
    unit = corners / size
    axis, sign = _sides(corners)
    x, y, z = np.moveaxis(unit, -1, 0)
    ahead = sign[:, None]
    right = np.choose(axis[:, None], [-ahead * z, x, ahead * x])
    down = np.choose(axis[:, None], [-y, ahead * z, -y])
    place = np.stack([right, down], axis=-1) / 2 * (1 - 1 / width) + 0.5
    number = 2 * axis + (sign < 0)
    return np.stack([place[..., 0], 1 - (number[:, None] + place[..., 1]) / 6], axis=-1).astype(np.float32)


def _size(kind: int, size: Corners) -> Corners:
    """Return the scale of a shape relative to its unit shape."""
    if kind == _GEOM.mjGEOM_SPHERE:
        return np.repeat(size[:1], 3)
    if kind in (_GEOM.mjGEOM_CAPSULE, _GEOM.mjGEOM_CYLINDER):
        return size[[0, 0, 1]]
    return size


def _repeated(uv: Corners, along: Corners, shift: float) -> NDArray[np.float32]:
    u, down = uv[..., 0] * along[0] - shift, (1 - uv[..., 1]) * along[1] - shift
    return np.stack([u, 1 - down], axis=-1).astype(np.float32)


def _sides(corners: Corners) -> tuple[NDArray[np.intp], Corners]:
    """Return the dominant axis of each triangle's normal, and its sign."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    axis = np.abs(normals).argmax(axis=1)
    return axis, np.where(np.take_along_axis(normals, axis[:, None], axis=1)[:, 0] < 0, -1.0, 1.0)


def _box(unit: Corners, size: Corners) -> Corners:
    axis, _ = _sides(unit * size)
    first, second = np.where(axis == 0, 1, 0), np.where(axis == 2, 1, 2)
    rows = np.arange(len(unit))
    return np.stack([unit[rows, :, first], unit[rows, :, second]], axis=-1) / 2 + 0.5


def _azimuth(unit: Corners) -> Corners:
    """Compute the azimuth about z in revolutions.

    Triangles across the seam get values above 1, and corners at poles the mean of the other corners.
    """
    share = np.arctan2(unit[..., 1], unit[..., 0]) / (2 * np.pi) % 1.0
    pole = np.abs(unit[..., :2]).max(axis=-1) < 1e-6
    low, high = np.where(pole, 1.0, share).min(axis=1), np.where(pole, 0.0, share).max(axis=1)
    share = np.where((high - low > 0.5)[:, None] & (share < 0.5), share + 1, share)
    mean = np.where(pole, 0.0, share).sum(axis=1) / np.maximum((~pole).sum(axis=1), 1)
    return np.where(pole, mean[:, None], share)


def _elevation(unit: Corners) -> Corners:
    """Compute the elevation in units of pi/2, -1 to 1."""
    return np.arctan2(unit[..., 2], np.hypot(unit[..., 0], unit[..., 1])) / (np.pi / 2)


def _ball(unit: Corners, size: Corners) -> Corners:
    return np.stack([_azimuth(unit), 0.5 + _elevation(unit) / 2], axis=-1)


def _cylinder(unit: Corners, size: Corners) -> Corners:
    is_cap = (np.ptp(unit[..., 2], axis=1) < 1e-6)[:, None, None]
    side = np.stack([_azimuth(unit), unit[..., 2] / 2 + 0.5], axis=-1)
    cap = np.stack([unit[..., 0], -unit[..., 1]], axis=-1) / 2 + 0.5
    return np.where(is_cap, cap, side)


def _capsule(unit: Corners, size: Corners) -> Corners:
    """Map the texture on the side, and again on each end."""
    middle = unit[..., 2].mean(axis=1)
    end = np.where(middle > 1, 1.0, np.where(middle < -1, -1.0, 0.0))[:, None]
    beyond = np.stack([unit[..., 0], unit[..., 1], (unit[..., 2] - end) * size[2] / size[0]], axis=-1)
    height = np.where(end > 0, _elevation(beyond), np.where(end < 0, 1 + _elevation(beyond), unit[..., 2] / 2 + 0.5))
    return np.stack([_azimuth(unit), height], axis=-1)


_UNIT: dict[int, Callable[[Corners, Corners], Corners]] = {
    int(_GEOM.mjGEOM_BOX): _box,
    int(_GEOM.mjGEOM_SPHERE): _ball,
    int(_GEOM.mjGEOM_ELLIPSOID): _ball,
    int(_GEOM.mjGEOM_CYLINDER): _cylinder,
    int(_GEOM.mjGEOM_CAPSULE): _capsule,
}
