# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Options of a renderer: outputs, casters, and the treatment of near surfaces and of pixels without depth."""

from __future__ import annotations

import math
from typing import Literal

import warp as wp

from warpvis.cameras.base import AnyCamera
from warpvis.core.checks import check_choice, check_number, check_whole
from warpvis.core.outputs import SENSOR_NAMES, Output
from warpvis.errors import ArrayError, CameraError
from warpvis.rendering._views import check_outputs

CasterName = Literal["auto", "packets", "rays"]
"""Method of casting rays: in packets, one by one, or the faster of the two."""
Fill = Literal["inf", "far"] | float
"""Depth of pixels without a surface: infinite, the camera's `far`, or a number."""
NearPlane = Literal["occlude", "clip"]
"""Whether surfaces nearer than `near` hide surfaces behind them, as for a real sensor, or are cut away."""
Lighting = Literal["pixel", "vertex"]
"""Where light is computed: at pixels, or at vertices and interpolated, as in OpenGL's fixed-function pipeline."""

_MAX_FLOAT = 3.4e38  # about the largest float32


DEFAULT_OUTPUTS: tuple[Output, ...] = ("depth", "points", "labels", "segmentation")


def check_output_names(outputs: object, sensor: object) -> tuple[str, ...]:
    """Return the names of a renderer's outputs without duplicates; `sensor` is its sensor or None.

    Raises:
        ArrayError: If there is no output, an unknown one, or an output of sensors without a sensor.
    """
    if outputs is DEFAULT_OUTPUTS:
        return DEFAULT_OUTPUTS
    names = check_outputs(outputs)
    sensor_only = () if sensor is not None else set(SENSOR_NAMES).intersection(names)
    if sensor_only:
        raise ArrayError(f"outputs must not contain {' and '.join(sorted(sensor_only))} without a sensor")
    return names


def choose_caster(caster: CasterName, camera: AnyCamera) -> Literal["packets", "rays"]:
    """Resolve the name of a caster for a camera.

    Raises:
        CameraError: If the caster does not support the camera.
    """
    check_choice(caster, "caster", ("auto", "packets", "rays"))
    if camera.ray_model == "parallel":
        if caster == "packets":
            raise CameraError('caster must be "rays" or "auto" for an OrthographicCamera, got "packets"')
        return "rays"
    return "packets" if caster == "auto" else caster


def fill_numbers(fill: Fill, camera: AnyCamera) -> tuple[float, float] | None:
    """Return the depths of empty pixels and of pixels that are too near; None for the infinities.

    Raises:
        ArrayError: If `fill` is invalid.
    """
    if isinstance(fill, str) and fill == "inf":
        return None
    fill = check_fill(fill)
    if isinstance(fill, str):
        if not math.isfinite(camera.far):
            raise ArrayError('the camera\'s far must be finite for fill="far", got inf')
        return camera.far, camera.near
    return fill, fill


def check_fill(fill: Fill) -> Fill:
    """Return `fill` if it is ``"inf"``, ``"far"`` or a number.

    Raises:
        ArrayError: If `fill` is neither.
    """
    if isinstance(fill, str):
        check_choice(fill, "fill", ("inf", "far"))
        return fill
    return check_number(fill, "fill", minimum=-_MAX_FLOAT, maximum=_MAX_FLOAT)


def check_device_bytes(device_bytes: int | None, device: wp.Device) -> int:
    """Return the maximum size of the images that a call holds on a GPU [bytes]; half of its memory by default.

    Raises:
        ArrayError: If `device_bytes` is not a whole number of bytes.
    """
    if device_bytes is None:
        return 0 if device.is_cpu else device.total_memory // 2
    return check_whole(device_bytes, "device_bytes")
