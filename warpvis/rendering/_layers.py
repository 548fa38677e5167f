# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Transparent surfaces: rays go on behind them, and their colors are blended with those of the surfaces behind."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import warp as wp

from warpvis.core.threads import launch_images
from warpvis.rendering._computed import Frame, compute_output, make_footprint
from warpvis.rendering._shadows import cast_shadows
from warpvis.rendering.casters.base import CastOptions, Scratch, images_struct
from warpvis.rendering.casters.layers_cpu import FRONT_IMAGES
from warpvis.rendering.casters.rays import rays_on_device

if TYPE_CHECKING:
    from warpvis.kernels.shading.base_colors import DeviceMaterials

LAYER_IMAGES = {"points": wp.vec3, "normals": wp.vec3, "segmentation": wp.int32, "faces": wp.int32}
"""Images of the surfaces behind others."""


def blend_layer_images(frame: Frame, out: wp.array, caster: str, options: CastOptions, scratch: Scratch) -> None:
    """Blend the colors of transparent surfaces with those behind them on a GPU, for `MAX_LAYERS` surfaces along a ray.

    Kernels run for whole images, and end at once for pixels that are finished, so that no result is waited for; see
    `_layer_lists` for CPU cores.

    Args:
        frame: The views and the surfaces in front.
        out: Their colors, which are replaced.
        caster: ``"packets"`` or ``"rays"``, for shadows.
        options: Options of casters.
        scratch: Memory for the surfaces behind.
    """
    from warpvis.kernels.casting.layers import FrontSurfaces, cast_layer
    from warpvis.kernels.shading.layers import MAX_LAYERS, Layers, blend_layer, find_opacity

    shape, device = out.shape, frame.scene.device
    layers, front = Layers(), FrontSurfaces()
    for name, dtype in (("over", wp.vec3), ("under", wp.vec3), ("clear", wp.vec2)):
        setattr(layers, name, scratch.array(f"layer {name}", shape, dtype))
    front.clear = layers.clear
    opacity = scratch.array("layer opacity", shape, wp.vec2)
    color = scratch.array("layer color", shape, wp.vec3ub)
    is_back = scratch.array("layer is_back", shape, wp.uint8)
    images = {name: scratch.array(f"layer {name}", shape, dtype) for name, dtype in LAYER_IMAGES.items()}
    behind = replace(frame, images=images, shadows=None, occlusion=None)
    fixed = [materials_of(frame), make_footprint(frame.camera), frame.poses]
    rays = [*ray_arguments(frame).values(), frame.poses]
    current, shown = frame, out

    def launch(kernel: wp.Kernel, cameras: list[Any], inputs: list[Any]) -> None:
        launch_images(kernel, shape, lambda window: [*cameras, window, *inputs], device=device)

    for number in range(MAX_LAYERS):
        if number > 0:
            for name in FRONT_IMAGES:
                setattr(front, name, current.images[name])
            inputs = [frame.worlds, options.cull_backfaces, front, images_struct(images), is_back]
            launch(cast_layer, rays, inputs)
            shadows = None if frame.shadows is None else cast_shadows(behind, caster, scratch)
            current, shown = replace(behind, shadows=shadows), color
            compute_output("color", current, color, scratch)
        seen = [frame.worlds, *(current.images[name] for name in FRONT_IMAGES), is_back if number else None, opacity]
        launch(find_opacity, fixed, seen)
        launch(blend_layer, [], [number, shown, opacity, layers, out])


def is_layered(frame: Frame) -> bool:
    """Return whether surfaces may show what is behind them, by their materials or colors of worlds."""
    materials = materials_of(frame)
    return bool(materials.is_layered) or materials.world_color is not None


def materials_of(frame: Frame) -> DeviceMaterials:
    """Return the materials of the scene, or of its worlds."""
    if frame.appearances is not None:
        return frame.appearances.materials
    return frame.scene.device_materials(frame.scene.background)


def ray_arguments(frame: Frame) -> dict[str, Any]:
    """Return the first arguments of `cast_layer`: the scene, and how the rays of the camera begin and end."""
    scene, camera = frame.scene, frame.camera
    is_parallel = camera.ray_model == "parallel"
    has_origins = not is_parallel and camera.origins is not None
    return {
        "scene": scene.triangles(faces=True).struct,
        "camera": camera.ray_range(),
        "is_parallel": is_parallel,
        "origins": rays_on_device(camera, scene.device, "origins") if has_origins else None,
    }
