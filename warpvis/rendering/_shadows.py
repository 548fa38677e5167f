# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Shadows: for each light that surfaces may block, an image of where it shines; and of ambient light, likewise."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import warp as wp

from warpvis.core.kernel_cache import launch
from warpvis.core.threads import WHOLE_ROW, launch_images
from warpvis.errors import SceneError
from warpvis.rendering._computed import Frame, lights_with
from warpvis.rendering.casters.base import Scratch
from warpvis.scene.light_samples import direction_samples
from warpvis.scene.lights import AmbientOcclusion, Light

if TYPE_CHECKING:
    from warpvis.kernels.shading.lighting import Lights

_IMAGES = "points", "segmentation", "normals"
"""Images that kernels read, in the order of their arguments."""

_MIN_PIXELS = 1024
"""Minimum number of pixels that a thread takes."""

_MAX_OBJECTS = 1024
"""Maximum number of objects with separate frames for warps, which test all of them; rays find them by a tree."""


def count_shadows(lights: Sequence[Light]) -> int:
    """Return the number of lights that surfaces may block."""
    return sum(light.casts_shadow for light in lights)


def cast_shadows(frame: Frame, caster: str, scratch: Scratch) -> wp.array | None:
    """Return the fraction of each light that reaches each pixel's surface, 255 for 1; None without shadows.

    Args:
        frame: The views, with points, normals and segmentation.
        caster: ``"packets"`` or ``"rays"``.
        scratch: Memory for the result, shape ``(lights, V, H, W)`` uint8.
    """
    lights = frame.scene.lights
    count = count_shadows(lights)
    if not count:
        return None
    shadows = scratch.array("shadows", (count, *frame.images["points"].shape), wp.uint8)
    radii = [light.radius for light in lights if light.casts_shadow]
    if 0 in radii:
        from warpvis.kernels.shading.shadow_packets import PACKET_ROWS, cast_shadow_packets
        from warpvis.kernels.shading.shadow_rays import cast_shadow_rays

        if not _cast_by_warps(frame, caster, shadows):
            kernels = cast_shadow_packets, cast_shadow_rays
            _launch(kernels, PACKET_ROWS, frame, caster, [], shadows)
    if any(radii):
        from warpvis.kernels.shading.soft_shadow_packets import SOFT_ROWS, cast_soft_shadow_packets
        from warpvis.kernels.shading.soft_shadow_rays import cast_soft_shadow_rays

        kernels = cast_soft_shadow_packets, cast_soft_shadow_rays
        _launch(kernels, SOFT_ROWS, frame, caster, [], shadows)
    return shadows


def _cast_by_warps(frame: Frame, caster: str, out: wp.array) -> bool:
    """Cast hard shadows by packets on CUDA; return whether this was possible."""
    scene, device = frame.scene, frame.scene.device
    if caster != "packets" or device.is_cpu:
        return False
    geometry = scene.bvh().struct
    if geometry.drawn_count > _MAX_OBJECTS:
        return False
    from warpvis.kernels.casting.packets_cuda import FoundObjects
    from warpvis.kernels.constants import CUDA_LANES
    from warpvis.kernels.shading.shadow_packets_cuda import BLOCK_HEIGHT, BLOCK_WIDTH

    images = [frame.images[name] for name in _IMAGES]
    views, height, width = images[0].shape
    resized = geometry.drawn_count > 0 and frame.worlds.object_sizes is not None
    size = (-(-height // BLOCK_HEIGHT), views, -(-width // BLOCK_WIDTH), CUDA_LANES)
    inputs = [geometry, _lights(frame), frame.poses, frame.worlds, FoundObjects(), *images, out]
    launch(_kernel(resized), size, inputs, device, block_dim=CUDA_LANES)
    return True


def _lights(frame: Frame) -> Lights:
    """Return the lights; light that is computed at vertices also reaches points outside of a light's cone."""
    lights = frame.lights()
    return lights_with(lights, is_at_vertices=True) if frame.lighting == "vertex" else lights


@cache
def _kernel(resized: bool) -> wp.Kernel:
    from warpvis.kernels.shading.shadow_packets_cuda import make_shadow_kernel

    return make_shadow_kernel(resized)


def check_occlusion(occlusion: object) -> AmbientOcclusion | None:
    """Return ambient occlusion or None, or raise a `SceneError`."""
    if occlusion is None or isinstance(occlusion, AmbientOcclusion):
        return occlusion
    raise SceneError(f"ambient_occlusion must be an AmbientOcclusion or None, got {type(occlusion).__name__}")


def cast_occlusion(frame: Frame, occlusion: AmbientOcclusion, caster: str, scratch: Scratch) -> wp.array:
    """Return the fraction of ambient light that reaches each pixel's surface, 255 for 1, ``(V, H, W)`` uint8."""
    from warpvis.kernels.shading.soft_shadow_packets import SOFT_ROWS, cast_occlusion_packets
    from warpvis.kernels.shading.soft_shadow_rays import cast_occlusion_rays

    device, samples = frame.scene.device, occlusion.samples
    directions = scratch.item(
        f"directions {samples}", lambda: wp.array(direction_samples(samples), dtype=wp.vec3, device=device)
    )
    out = scratch.array("occlusion", frame.images["points"].shape, wp.uint8)
    kernels = cast_occlusion_packets, cast_occlusion_rays
    _launch(kernels, SOFT_ROWS, frame, caster, [directions, occlusion.distance], out)
    return out


def _launch(
    kernels: tuple[wp.Kernel, wp.Kernel], rows: int, frame: Frame, caster: str, options: list[Any], out: wp.array
) -> None:
    """Launch the first kernel for packets on a CPU, whose threads write several rows, or else the second one."""
    scene, images = frame.scene, [frame.images[name] for name in _IMAGES]
    lights, (views, height, width) = _lights(frame), images[0].shape
    geometry: Any
    if caster == "packets" and scene.device.is_cpu:
        kernel, geometry, span = kernels[0], scene.bvh().struct, WHOLE_ROW
    else:
        kernel, geometry, rows, span = kernels[1], scene.triangles().struct, 1, 1
    launch_images(
        kernel,
        (views, -(-height // rows), width),
        lambda window: [geometry, lights, frame.poses, window, frame.worlds, *options, *images, out],
        device=scene.device,
        threads=frame.threads,
        span=span,
        min_pixels=_MIN_PIXELS // rows,
    )
