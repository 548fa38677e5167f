# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Outputs that are computed from images of casters: colors, and outputs that users register."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, cast

import warp as wp

from warpvis.cameras.base import AnyCamera
from warpvis.cameras.rays import RayCamera
from warpvis.core.outputs import CAST, OUTPUTS, OutputSpec
from warpvis.core.threads import launch_images
from warpvis.errors import ArrayError
from warpvis.rendering._choices import Lighting
from warpvis.rendering._views import is_pixel_type
from warpvis.rendering.casters.base import ImagesByName, Scratch
from warpvis.rendering.casters.packed_rows import PackedRows
from warpvis.rendering.casters.rays import rays_through

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds
    from warpvis.kernels.shading.base_colors import DeviceMaterials, Footprint
    from warpvis.kernels.shading.lighting import Lights
    from warpvis.scene import Scene
    from warpvis.scene.device_sky import DeviceSkies
    from warpvis.scene.world_appearances import DeviceAppearances


@dataclass(frozen=True)
class Frame:
    """The views of one call and their exact images, from which an output is computed."""

    scene: Scene
    """The scene."""
    camera: AnyCamera
    """The camera; with a sensor, its depth is not limited."""
    poses: wp.array
    """Camera to world, axes of the camera, ``(V,)`` transform on the scene's device."""
    worlds: Worlds
    """The world of each view."""
    images: ImagesByName
    """The images that the output needs, by name, ``(V, H, W)``; lists of rays and points are images of one row."""
    threads: int
    """CPU threads to use."""
    pixels: wp.array | None = None
    """Image points through which rays were cast instead of pixel centers [px], vec2 of the images' shape."""
    rays: wp.array | None = None
    """Rays of the camera frame, vec3d of the images' shape; None for those of the camera's pixels or of `pixels`."""
    shadows: wp.array | None = None
    """Fraction of each light with shadows that reaches a pixel, for ``"color"``, ``(lights, V, H, W)`` uint8."""
    lighting: Lighting = "pixel"
    """Whether light is computed at pixels or at vertices, for ``"color"``."""
    appearances: DeviceAppearances | None = None
    """Appearances that differ between worlds, for colors; None if all worlds have the scene's."""

    lit_by: Lights | None = None
    """Lights, for ``"color"``; by default those of the scene or of its worlds."""

    is_mirrored: bool = False
    """Whether they are mirror images, which show no sky and no background."""
    occlusion: wp.array | None = None
    """Fraction of ambient light that reaches a pixel, for ``"color"``, ``(V, H, W)`` uint8."""

    def materials(self) -> DeviceMaterials:
        """Return the materials of the scene, or of its worlds."""
        if self.appearances is not None:
            return self.appearances.materials
        return self.scene.device_materials(None if self.is_mirrored else self.scene.background)

    def lights(self) -> Lights:
        """Return the lights of the views, of the scene, or of its worlds."""
        if self.lit_by is not None:
            return self.lit_by
        if self.occlusion is not None:
            return lights_with(replace(self, occlusion=None).lights(), occlusion=self.occlusion)
        of_worlds = None if self.appearances is None else self.appearances.lights
        return self.scene.device_lights(self.scene.lights) if of_worlds is None else of_worlds

    def skies(self) -> DeviceSkies | None:
        """Return the sky of the scene and those of its worlds; None without any."""
        if self.is_mirrored:
            return None
        if self.appearances is not None:
            return self.appearances.skies
        background = self.scene.background
        return self.scene.device_skies(background) if background is not None and background.has_sky else None


def lights_with(lights: Lights, **fields: object) -> Lights:
    """Return a copy of lights with other values of some fields."""
    from warpvis.kernels.shading.lighting import Lights

    found, kind = Lights(), cast("Any", Lights)
    for name in kind.vars:
        setattr(found, name, fields.get(name, getattr(lights, name)))
    return found


Compute = Callable[[Frame, wp.array], None]
"""Writes an output, its last argument, from the images of a frame."""

_COMPUTED: dict[str, Compute] = {}


def register_output(spec: OutputSpec, compute: Compute) -> None:
    """Add an output to those of all renderers and datasets of this process.

    Registering it again replaces `compute`, if the spec is the same.

    Args:
        spec: Its name, its dtype, and the images of casters that it is computed from. Its `stage` must be
            ``"compute"``.
        compute: Writes the output by kernels on the scene's device: ``compute(frame, out)``, where `out` has the dtype
            of `spec` and the shape of `Frame.images`.

    Raises:
        ArrayError: If the name is invalid or taken, or the spec cannot be computed.
    """
    if not isinstance(spec, OutputSpec) or not callable(compute):
        raise ArrayError(f"spec must be an OutputSpec and compute a function, got {spec!r} and {compute!r}")
    is_new = spec.name not in OUTPUTS or (spec.name in _COMPUTED and OUTPUTS[spec.name] == spec)
    if not spec.name.isidentifier() or spec.name.startswith("_") or not is_new:
        raise ArrayError(f"name of an output must be a new Python identifier, got {spec.name!r}")
    if spec.stage != "compute" or not is_pixel_type(spec):
        raise ArrayError(
            f'{spec.name} must have stage="compute" and be float32, int32 or uint8, or three float32 or uint8, got '
            f"stage={spec.stage!r}, {spec.dtype} and components {spec.components!r}"
        )
    unknown = [name for name in spec.needs if name not in CAST]
    if unknown or not spec.needs:
        raise ArrayError(f"needs of {spec.name} must be some of {', '.join(CAST)}, got {', '.join(unknown) or 'none'}")
    OUTPUTS[spec.name], _COMPUTED[spec.name] = spec, compute


def needs_of(name: str, scene: Scene) -> tuple[str, ...]:
    """Return the images of casters that an output is computed from."""
    return OUTPUTS["albedo" if name == "color" and not scene.lights else name].needs


def compute_output(name: str, frame: Frame, out: wp.array, scratch: Scratch) -> None:
    """Write an output that is computed from others, with memory of the call."""
    if name in _COMPUTED:
        _COMPUTED[name](frame, out)
        return
    scene = frame.scene
    is_lit, footprint = name == "color" and bool(scene.lights), make_footprint(frame.camera)
    materials = frame.materials()
    if is_lit and frame.lighting == "vertex" and materials.pbr is not None:
        raise ArrayError('lighting must be "pixel" for materials of the shadings "pbr" and "webots", got "vertex"')
    if scene.device.is_cpu:
        _shade_rows(frame, materials, footprint, out, scratch, is_lit=is_lit)
    else:
        _shade_pixels(frame, materials, footprint, out, is_lit=is_lit)
    skies = frame.skies()
    if skies is not None:
        _paint_sky(frame, skies, footprint, out, scratch)


def _shade_pixels(
    frame: Frame, materials: DeviceMaterials, footprint: Footprint, out: wp.array, *, is_lit: bool
) -> None:
    """Write the colors of visible surfaces on a GPU: under the scene's lights, or base colors."""
    if not is_lit:
        from warpvis.kernels.shading.base_colors import shade_base_colors as kernel
    elif materials.pbr is not None:
        from warpvis.kernels.shading.pbr import shade_pbr_colors as kernel
    elif frame.lighting == "vertex":
        from warpvis.kernels.shading.vertex_lighting import shade_vertex_lit_colors as kernel
    else:
        from warpvis.kernels.shading.lighting import shade_lit_colors as kernel
    images: list[Any] = [frame.images[name] for name in OUTPUTS["color" if is_lit else "albedo"].needs]
    scene_data = [materials, *([frame.lights()] if is_lit else [])]
    if is_lit:
        images.append(frame.shadows)
    launch_images(
        kernel,
        out.shape,
        lambda window: [*scene_data, footprint, frame.poses, window, frame.worlds, *images, out],
        device=frame.scene.device,
    )


def _shade_rows(
    frame: Frame, materials: DeviceMaterials, footprint: Footprint, out: wp.array, scratch: Scratch, *, is_lit: bool
) -> None:
    """Write the colors of visible surfaces on CPU cores: under the scene's lights, or base colors."""
    from warpvis.kernels.shading import color_rows

    if is_lit and materials.pbr is not None:
        from warpvis.kernels.shading.pbr_rows import shade_pbr_rows as kernel
    elif is_lit and frame.lighting == "vertex":
        from warpvis.kernels.shading.vertex_color_rows import shade_vertex_color_rows as kernel
    else:
        kernel = color_rows.shade_color_rows
    images = {name: frame.images[name] for name in OUTPUTS["color" if is_lit else "albedo"].needs}
    values: dict[str, Any] = {"normals": None, "shadows": frame.shadows, **images}
    if is_lit:
        values["lights"] = frame.lights()
    packed = scratch.item(
        kernel.key,
        lambda: PackedRows(kernel, color_rows.ColorCall, color_rows.ColorImages, frame.threads),
    )
    packed.run(
        out.shape,
        {"color": out},
        appearance=materials,
        is_lit=int(is_lit),
        footprint=footprint,
        camera_to_world=frame.poses,
        worlds=frame.worlds,
        **values,
    )


def make_footprint(camera: AnyCamera) -> Footprint:
    """Return the size of a camera's pixels as the struct that kernels use, cached: callers must not change it."""
    return _make_footprint(camera.ray_model, *camera.pixel_size())


@lru_cache(maxsize=64)
def _make_footprint(ray_model: str, width: float, height: float) -> Footprint:
    from warpvis.kernels.shading import base_colors

    footprint = base_colors.Footprint()
    footprint.kind = {
        "pinhole": base_colors.FOOTPRINT_PINHOLE,
        "parallel": base_colors.FOOTPRINT_PARALLEL,
        "table": base_colors.FOOTPRINT_CONE,
    }[ray_model]
    footprint.size = wp.vec2(width, height)
    return footprint


def _paint_sky(frame: Frame, skies: DeviceSkies, footprint: Footprint, out: wp.array, scratch: Scratch) -> None:
    """Paint the sky over pixels that see no surface, and haze."""
    from warpvis.kernels.pinhole import PinholeCamera
    from warpvis.kernels.shading import sky, sky_rows

    scene, camera, pixels, rays = frame.scene, frame.camera, frame.pixels, None
    world_sky = None if frame.appearances is None else frame.appearances.world_sky
    struct = camera.device_struct() if camera.ray_model == "pinhole" else PinholeCamera()
    if isinstance(camera, RayCamera):
        rays = rays_through(camera, pixels, scene.device) if frame.rays is None else frame.rays
    segmentation, points = frame.images["segmentation"], frame.images["points"]
    if not scene.device.is_cpu:
        scene_data, cameras = [skies.all, world_sky, frame.worlds], [struct, footprint, frame.poses]
        images = [rays, pixels, segmentation, points, out]
        launch_images(
            sky.paint_sky, out.shape, lambda window: [*scene_data, *cameras, window, *images], device=scene.device
        )
        return
    packed = scratch.item(
        "sky rows",
        lambda: PackedRows(sky_rows.paint_sky_rows, sky_rows.SkyCall, sky_rows.ColorImages, frame.threads),
    )
    packed.run(
        out.shape,
        {"color": out},
        skies=skies.all,
        world_sky=world_sky,
        worlds=frame.worlds,
        camera=struct,
        footprint=footprint,
        camera_to_world=frame.poses,
        rays=rays,
        pixels=pixels,
        segmentation=segmentation,
        points=points,
    )
