# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Options of a renderer: outputs, casters, and the treatment of near surfaces and of pixels without depth."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import warp as wp

from warpvis.cameras.base import AnyCamera
from warpvis.core.checks import check_choice, check_number, check_whole
from warpvis.core.outputs import Output
from warpvis.errors import ArrayError, CameraError
from warpvis.rendering._cpu_ray_origins import CpuRayOriginsCaster
from warpvis.rendering._cpu_remap import CpuRemapCaster
from warpvis.rendering._cpu_table import CpuTablePacketsCaster
from warpvis.rendering._cuda_packets import CudaPacketsCaster
from warpvis.rendering._cuda_table import CudaTablePacketsCaster
from warpvis.rendering._views import ALL_OUTPUTS, SENSOR_OUTPUTS, check_outputs
from warpvis.rendering.casters import OrthographicCaster, RaysCaster, RayTableCaster

Caster = Literal["auto", "packets", "rays"]
"""Method of casting rays: in packets, one by one, or the faster of the two."""
Fill = Literal["inf", "far"] | float
"""Depth of pixels without a surface: infinite, the camera's `far`, or a number."""
NearPlane = Literal["occlude", "clip"]
"""Whether surfaces nearer than `near` hide surfaces behind them, as for a real sensor, or are cut away."""

_MAX_FLOAT = 3.4e38  # about the largest float32


DEFAULT_OUTPUTS: tuple[Output, ...] = ("depth", "points", "labels", "segmentation")


def check_output_names(outputs: object, sensor: object) -> tuple[str, ...]:
    """Return the names of a renderer's outputs without duplicates; `sensor` is its sensor or None.

    Raises:
        ArrayError: If there is no output, an unknown one, or an output of sensors without a sensor.
    """
    names = check_outputs(outputs, ALL_OUTPUTS)
    sensor_only = [name for name in names if name in SENSOR_OUTPUTS]
    if sensor is None and sensor_only:
        raise ArrayError(f"outputs must not contain {' and '.join(sensor_only)} without a sensor")
    return names


def choose_caster(caster: Caster, camera: AnyCamera) -> Literal["packets", "rays"]:
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


def caster_class(
    caster: Literal["packets", "rays"], camera: AnyCamera, device: wp.Device
) -> Callable[..., RaysCaster | CpuRemapCaster | CpuTablePacketsCaster]:
    """Return the class of the caster for a camera and a device."""
    if camera.ray_model == "parallel":
        return OrthographicCaster
    if camera.ray_model == "table":
        if caster == "rays":
            return RayTableCaster
        if not device.is_cpu:
            return CudaTablePacketsCaster
        return CpuTablePacketsCaster if camera.origins is None else CpuRayOriginsCaster
    if caster == "rays":
        return RaysCaster
    return CpuRemapCaster if device.is_cpu else CudaPacketsCaster


def fill_numbers(fill: Fill, camera: AnyCamera) -> tuple[float, float] | None:
    """Return the depths of empty pixels and of pixels that are too near; None for the infinities.

    Raises:
        ArrayError: If `fill` is invalid.
    """
    fill = check_fill(fill)
    if isinstance(fill, str):
        if fill == "far" and not math.isfinite(camera.far):
            raise ArrayError('the camera\'s far must be finite for fill="far", got inf')
        return None if fill == "inf" else (camera.far, camera.near)
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
