# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of lenses, and derivatives of the directions of pixels with respect to them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from warpvis.cameras.lenses._lens import Floats, Lens
from warpvis.core.checks import is_number
from warpvis.errors import CameraError

_STEP = float(np.finfo(np.float64).eps) ** (1 / 3)
"""Step of central differences, for functions of scale 1: truncation and rounding errors are about equal, 4e-11."""
_SCALINGS = 4
_CHUNK = 2**15  # limits memory: intermediate values take several times as much memory as the result


def lens_parameters(lens: Lens) -> dict[str, float]:
    """Return the numbers of a lens by name, in the order of its constructor.

    Each number of a field that is a tuple is a parameter, with the name of the coefficient where the class defines one,
    or else ``field_0 field_1 ...``. Lenses that are not dataclasses have no parameters.
    """
    parameters: dict[str, float] = {}
    for field, value in _numbers(lens):
        if isinstance(value, tuple):
            names = lens._coefficient_names if field == "coefficients" else ()
            names = names or tuple(f"{field}_{i}" for i in range(len(value)))
            parameters.update(zip(names, value, strict=False))
        else:
            parameters[field] = value
    return parameters


def lens_with_parameters(lens: Lens, values: Sequence[float]) -> Lens:
    """Return a lens of the same class with other `lens_parameters`.

    Raises:
        CameraError: If the lens does not support a value.
    """
    numbers, changes = iter(float(value) for value in values), {}
    for field, value in _numbers(lens):
        changes[field] = tuple(next(numbers) for _ in value) if isinstance(value, tuple) else next(numbers)
    return replace(lens, **changes) if changes else lens  # type: ignore[type-var]  # lenses with numbers are dataclasses


def lens_jacobian(lens: Lens, pixels: Floats, directions: Floats) -> Floats:
    """Return derivatives of directions with respect to `lens_parameters`, at fixed pixels.

    Args:
        lens: The lens.
        pixels: Image points [px], shape ``(n, 2)``.
        directions: Their directions, `lens.unproject(pixels)`, shape ``(n, 3)``.

    Returns:
        Shape ``(n, 3, P)``; not finite where a pixel has no direction, or where the lens turns back.
    """
    result = np.empty((*directions.shape, len(lens_parameters(lens))))
    for first in range(0, len(pixels), _CHUNK):
        part = slice(first, first + _CHUNK)
        with np.errstate(all="ignore"):
            jacobian = lens._direction_jacobian(pixels[part], directions[part])
        result[part] = implicit_jacobian(lens, directions[part]) if jacobian is None else jacobian
    result[~np.isfinite(directions).all(axis=1)] = np.nan  # formulas may be defined at pixels without a direction
    return result


def implicit_jacobian(lens: Lens, directions: Floats) -> Floats:
    """Return derivatives of directions at fixed pixels from central differences of the projection p.

    With a basis B of the tangent plane of a unit vector d, ``dd = -B (dp/dd B)^-1 dp/dparameter``. Where p is not
    defined within a step, the differences are one-sided, of second order. The relative error is about 1e-9 for
    projections that are smooth on the scale of a radian.
    """
    values, size = np.array(list(lens_parameters(lens).values())), len(directions)
    result = np.full((size, 3, len(values)), np.nan)
    rows = np.flatnonzero(np.isfinite(directions).all(axis=1))
    d = directions[rows]
    if not len(rows):
        return result
    basis = _tangents(d)
    changes = [_difference(lambda h, t=tangent: lens.project(d + h * t), _STEP) for tangent in basis]  # type: ignore[misc]
    (xx, yx), (xy, yy) = (change.T for change in changes)
    scale = float(np.nanmedian(np.abs(changes))) * np.sqrt(2)  # pixels per radian
    for column in range(len(values)):
        x, y = _parameter_slope(lens, values, column, d, scale).T
        determinant = xx * yy - xy * yx
        along, across = (xy * y - yy * x) / determinant, (yx * x - xx * y) / determinant
        result[rows, :, column] = basis[0] * along[:, None] + basis[1] * across[:, None]
    return result


def _parameter_slope(lens: Lens, values: Floats, column: int, directions: Floats, scale: float) -> Floats:
    """Return the derivative of the projection with respect to a parameter, with steps of `_STEP` times `scale` [px]."""

    def project(h: float) -> Floats:
        changed = values.copy()
        changed[column] += h
        try:
            return lens_with_parameters(lens, changed.tolist()).project(directions)
        except CameraError:  # beyond the valid range of the parameter
            return np.full((len(directions), 2), np.nan)

    step = _STEP * max(1.0, abs(values[column]))
    slope = _difference(project, step)
    for _ in range(_SCALINGS):
        largest = float(np.nanmax(np.abs(slope), initial=0.0)) * step
        if np.isfinite(slope).any() and (largest == 0 or 0.1 < largest / (_STEP * scale) < 10):
            break
        step = step * _STEP * scale / largest if largest > 0 else step * _STEP
        slope = _difference(project, step)
    return slope


def _difference(function: Callable[[float], Floats], step: float) -> Floats:
    """Return the derivative at 0 by central differences, or one-sided differences where a side is NaN."""
    below, above = function(-step), function(step)
    slope = (above - below) / (2 * step)
    if np.isnan(slope).any():
        center, far_below, far_above = function(0.0), function(-2 * step), function(2 * step)
        ahead = (4 * above - 3 * center - far_above) / (2 * step)
        behind = (far_below - 4 * below + 3 * center) / (2 * step)
        slope = np.where(np.isnan(slope), np.where(np.isnan(ahead), behind, ahead), slope)
    return slope


def _tangents(directions: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors normal to each direction and to each other, shape ``(n, 3)`` each."""
    axis = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(directions, first)


def _numbers(lens: Lens) -> list[tuple[str, Any]]:
    """Return the fields of the constructor that are numbers or tuples of numbers, and their values."""
    if not is_dataclass(lens):
        return []
    items = [(field.name, getattr(lens, field.name)) for field in fields(lens) if field.init]
    return [(name, value) for name, value in items if name not in lens._settings and _is_numeric(value)]


def _is_numeric(value: object) -> bool:
    return all(map(is_number, value)) and len(value) > 0 if isinstance(value, tuple) else is_number(value)
