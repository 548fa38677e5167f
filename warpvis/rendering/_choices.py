# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What a renderer may be told: outputs, casters, what becomes of near surfaces and of pixels without depth."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import warp as wp

from warpvis.core.checks import check_choice, check_number, check_whole
from warpvis.core.outputs import Output
from warpvis.core.ray_camera import RayCamera
from warpvis.errors import ArrayError, CameraError
from warpvis.rendering._cpu_apart import CpuApartPacketsCaster
from warpvis.rendering._cpu_remap import CpuRemapCaster
from warpvis.rendering._cpu_table import CpuTablePacketsCaster
from warpvis.rendering._cuda_packets import CudaPacketsCaster
from warpvis.rendering._cuda_table import CudaTablePacketsCaster
from warpvis.rendering._orthographic import OrthographicCamera, RenderCamera
from warpvis.rendering._views import ALL_OUTPUTS, SENSOR_OUTPUTS, check_outputs
from warpvis.rendering.casters import OrthographicCaster, RaysCaster, RayTableCaster

Caster = Literal["auto", "packets", "rays"]
"""How rays are cast: in packets, one by one, or by whichever of the two is faster."""
Fill = Literal["inf", "far"] | float
"""What depth is where nothing is seen: infinite, the camera's `far`, or a number."""
NearPlane = Literal["occlude", "clip"]
"""Whether what is nearer than `near` hides what is behind it, as in a real sensor, or is cut away."""

_MAX_FLOAT = 3.4e38  # what single precision holds


DEFAULT_OUTPUTS: tuple[Output, ...] = ("depth", "points", "labels", "segmentation")


def check_asked(outputs: object, sensor: object) -> tuple[str, ...]:
    """Take names of outputs of a renderer, with a sensor or None.

    Raises:
        ArrayError: There is none, an unknown one, or one of a sensor where there is none.
    """
    names = check_outputs(outputs, ALL_OUTPUTS)
    alone = [name for name in names if name in SENSOR_OUTPUTS]
    if sensor is None and alone:
        raise ArrayError(f"outputs must be without {' and '.join(alone)} where there is no sensor")
    return names


def choose_caster(caster: Caster, camera: RenderCamera) -> Literal["packets", "rays"]:
    """Return the caster of a camera that a name stands for.

    Raises:
        CameraError: It casts no such rays.
    """
    check_choice(caster, "caster", ("auto", "packets", "rays"))
    if isinstance(camera, OrthographicCamera):
        if caster == "packets":
            raise CameraError('packets are cast through a pinhole; an OrthographicCamera needs caster="rays" or "auto"')
        return "rays"
    return "packets" if caster == "auto" else caster


def caster_class(
    caster: Literal["packets", "rays"], camera: RenderCamera, device: wp.Device
) -> Callable[..., RaysCaster | CpuRemapCaster | CpuTablePacketsCaster]:
    """Return the class of a caster of a camera on a device."""
    if isinstance(camera, OrthographicCamera):
        return OrthographicCaster
    if isinstance(camera, RayCamera):
        if caster == "rays":
            return RayTableCaster
        if not device.is_cpu:
            return CudaTablePacketsCaster
        return CpuTablePacketsCaster if camera.origins is None else CpuApartPacketsCaster
    if caster == "rays":
        return RaysCaster
    return CpuRemapCaster if device.is_cpu else CudaPacketsCaster


def fill_numbers(fill: Fill, camera: RenderCamera) -> tuple[float, float] | None:
    """Return the depth of empty pixels and of those that are too near; None for the infinities.

    Raises:
        ArrayError: `fill` is not what it has to be.
    """
    fill = check_fill(fill)
    if isinstance(fill, str):
        if fill == "far" and not math.isfinite(camera.far):
            raise ArrayError('fill="far" needs a camera whose far is finite, got inf')
        return None if fill == "inf" else (camera.far, camera.near)
    return fill, fill


def check_fill(fill: Fill) -> Fill:
    """Return `fill` if it is ``"inf"``, ``"far"`` or a number.

    Raises:
        ArrayError: It is neither.
    """
    if isinstance(fill, str):
        check_choice(fill, "fill", ("inf", "far"))
        return fill
    return check_number(fill, "fill", least=-_MAX_FLOAT, most=_MAX_FLOAT)


def check_device_bytes(device_bytes: int | None, device: wp.Device) -> int:
    """Return the most bytes of images that a call holds on a GPU; half of its memory by default.

    Raises:
        ArrayError: It is no number of bytes.
    """
    if device_bytes is None:
        return 0 if device.is_cpu else device.total_memory // 2
    return check_whole(device_bytes, "device_bytes")
