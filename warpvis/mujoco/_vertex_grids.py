# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cells of MuJoCo's built-in shapes, at whose corners its renderer computes light."""

from __future__ import annotations

import math

import mujoco  # noqa: TID253 - the whole package is about it

from warpvis.mujoco._model_fields import shape_value
from warpvis.scene.vertex_grids import VertexGrid, box_grid, round_grid

_MAX_CELLS = 200
"""Maximum number of cells of a plane along x and y (`mjMAXPLANEGRID` in mjrender.h)."""

_GEOM = mujoco.mjtGeom
_ROUND = (_GEOM.mjGEOM_SPHERE, _GEOM.mjGEOM_ELLIPSOID, _GEOM.mjGEOM_CAPSULE, _GEOM.mjGEOM_CYLINDER)


def grid_of(model: mujoco.MjModel, shape: int) -> VertexGrid | None:
    """Return the cells of a geom or site; None if MuJoCo draws the triangles of a mesh or height field."""
    kind, quality = int(shape_value(model, "type", shape)), model.vis.quality
    if kind in _ROUND:
        return round_grid(int(quality.numslices), int(quality.numstacks))
    if kind == _GEOM.mjGEOM_BOX:
        return box_grid(shape_value(model, "size", shape), int(quality.numquads))
    return _plane_grid(model, shape) if kind == _GEOM.mjGEOM_PLANE else None


def _plane_grid(model: mujoco.MjModel, geom: int) -> VertexGrid:
    """Return the cells of a plane (`makePlane` in render_context.c, and `addGeomGeoms` in engine_vis_visualize.c)."""
    x, y, spacing = model.geom_size[geom].tolist()
    axes = [_plane_axis(model, geom, axis, size, spacing) for axis, size in enumerate((x, y))]
    half, count, first, step, period = zip(*axes, (0.0, 1, 1.0, 1.0, 0.0), strict=True)
    return VertexGrid("plane", half, count, first, step, period)


def _plane_axis(
    model: mujoco.MjModel, geom: int, axis: int, size: float, spacing: float
) -> tuple[float, int, float, float, float]:
    """Return half the size, the number of cells, the widths of the first and the others, and the period on an axis."""
    if size > 0:
        spacing = max(spacing, size / (_MAX_CELLS - 2))
        count = math.floor(size / max(1e-15, spacing)) // 2 * 2
        return size, count + 2, size - count * spacing, 2 * spacing, 0.0
    far, material = float(model.vis.map.zfar * model.stat.extent), int(model.geom_matid[geom])
    repeat = float(model.mat_texrepeat[material, axis]) if material >= 0 else 0.0
    unit = 2 / repeat if repeat > 0 else 2.1 * far / (_MAX_CELLS - 2)
    step = (2.1 * far + 2 * unit) / _MAX_CELLS
    return step * _MAX_CELLS / 2, _MAX_CELLS, step, step, 2 * unit
