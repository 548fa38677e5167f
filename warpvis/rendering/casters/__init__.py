# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Casters: ray by ray, or in packets on CPU cores and on CUDA, for each kind of camera."""

from __future__ import annotations

from typing import Any, Literal

from warpvis.cameras.base import AnyCamera
from warpvis.rendering.casters.base import (
    Caster,
    CastOptions as CastOptions,
    ImagesByName as ImagesByName,
    Scratch as Scratch,
    ViewBatch as ViewBatch,
)
from warpvis.rendering.casters.packets_cpu import CpuPacketsCaster
from warpvis.rendering.casters.packets_cuda import CudaPacketsCaster
from warpvis.rendering.casters.ray_bundles_cpu import CpuRayBundleCaster
from warpvis.rendering.casters.ray_bundles_cuda import CudaRayBundleCaster
from warpvis.rendering.casters.rays import OrthographicCaster, RayBundleCaster, RaysCaster
from warpvis.scene import Scene


def make_caster(method: Literal["packets", "rays"], scene: Scene, camera: AnyCamera, options: CastOptions) -> Caster:
    """Return a caster for a camera on the scene's device."""
    on_cpu = scene.device.is_cpu
    rays: Any
    packets: Any
    if camera.ray_model == "parallel":
        rays = packets = OrthographicCaster
    elif camera.ray_model == "table":
        rays, packets = RayBundleCaster, CpuRayBundleCaster if on_cpu else CudaRayBundleCaster
    else:
        rays, packets = RaysCaster, CpuPacketsCaster if on_cpu else CudaPacketsCaster
    return (packets if method == "packets" else rays)(scene, camera, options)
