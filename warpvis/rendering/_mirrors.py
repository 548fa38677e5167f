# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Mirror images: what a camera behind the plane of a mirror sees is added to the colors of the mirror's surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.base import AnyCamera
from warpvis.cameras.rays import RayCamera
from warpvis.core.kernel_cache import launch
from warpvis.core.threads import WHOLE_ROW, launch_images
from warpvis.rendering._computed import Frame, compute_output, needs_of
from warpvis.rendering._layer_lists import blend_layers
from warpvis.rendering._layers import is_layered
from warpvis.rendering._views import pixel_type
from warpvis.rendering.casters.base import Caster, CastOptions, Scratch, ViewBatch, images_struct
from warpvis.rendering.casters.rays import rays_on_device
from warpvis.scene.mirror_planes import Mirror, Mirrors

if TYPE_CHECKING:
    from warpvis.core.types import KernelArguments
    from warpvis.kernels.casting.worlds import Worlds
    from warpvis.kernels.pinhole import Window


class FlippedRays(RayCamera):
    """A camera whose rays are those of another one, with the x axis of its frame flipped."""

    def __init__(self, camera: RayCamera) -> None:
        """Flip the rays of a camera, from the range 0 to its `far`."""
        self.width, self.height, self.kind, self.axes = camera.width, camera.height, camera.kind, camera.axes
        self.near, self.far, self._camera = 0.0, camera.far, camera

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the image of one view."""
        return self._camera.shape

    @property
    def rays(self) -> NDArray[np.float64]:
        """Rays of depth 1."""
        return _flipped(self._camera.rays)

    @property
    def origins(self) -> NDArray[np.float64] | None:
        """Ray origins in the camera frame [m]."""
        return None if self._camera.origins is None else _flipped(self._camera.origins)

    def rays_at(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return rays of depth 1 through image points [px]."""
        return _flipped(self._camera.rays_at(pixels))


def _flipped(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors * (-1.0, 1.0, 1.0)


def flipped_camera(camera: AnyCamera) -> AnyCamera:
    """Return the camera of mirror images: with its image, or the rays of its pixels, flipped from right to left."""
    if isinstance(camera, RayCamera):
        return FlippedRays(camera)
    flat: Any = camera
    return replace(flat, cx=flat.width - flat.cx, near=0.0)


def add_mirror(
    frame: Frame,
    views: ViewBatch,
    mirror: Mirror,
    mirrors: Mirrors,
    camera: AnyCamera,
    caster: Caster,
    options: CastOptions,
    scratch: Scratch,
    out: wp.array,
) -> None:
    """Add the mirror image of a plane, lit without shadows, to the colors of a frame's surfaces.

    Args:
        frame: The views, with the images of visible surfaces.
        views: The same views, as for casters.
        mirror: The plane.
        mirrors: All mirrors of the scene.
        camera: The `flipped_camera`.
        caster: Its caster.
        options: Options of the caster.
        scratch: Memory for the image.
        out: The colors.
    """
    from warpvis.kernels.shading import mirrors as kernels
    from warpvis.kernels.shading.lighting import DeviceLight, Lights

    scene, shape, device = frame.scene, frame.images["segmentation"].shape, frame.scene.device
    if device.is_cpu and not (frame.images["segmentation"].numpy() == mirror.owner).any():
        return
    count = shape[0]
    struct: Any = kernels.Mirror()
    struct.index, struct.column = mirror.owner, mirror.column
    struct.point, struct.normal = wp.vec3d(*mirror.point), wp.vec3d(*mirror.normal)
    planes = scratch.array("mirror planes", (count,), wp.vec4d)
    poses = scratch.array("mirror poses", (count,), wp.transform)
    excluded = scratch.array("mirror excluded", (count, len(scene)), wp.uint8)
    boxes = [mirrors.columns, mirrors.centers, mirrors.halves]
    inputs = [struct, *boxes, frame.poses, frame.worlds, planes, poses, excluded]
    launch(kernels.mirror_views, excluded.shape, inputs, device)
    worlds = _excluding(frame.worlds, excluded)
    pixels, is_flipped = frame.pixels, False
    if camera.ray_model != "table":
        is_flipped = pixels is None
        if pixels is not None:
            pixels = scratch.array("mirror pixels", pixels.shape, wp.vec2)
            launch(kernels.flip_points, pixels.shape, [float(camera.width), frame.pixels, pixels], device)
    images = {name: scratch.array(f"mirror {name}", shape, pixel_type(name)) for name in needs_of("color", scene)}
    batch = ViewBatch(caster.parse_poses(poses, camera.axes), worlds, pixels=pixels, appearances=views.appearances)
    caster.cast(batch, images)
    image: Any = kernels.MirrorImage()
    image.index, image.planes, image.is_flipped, image.scale = mirror.owner, planes, is_flipped, 1.0
    image.segmentation, image.color = images["segmentation"], scratch.array("mirror color", shape, wp.vec3ub)
    span, cameras = _span(frame), [frame.materials(), image, frame.poses]
    seen = [frame.images[name] for name in ("points", "segmentation", "faces")]
    hidden = [frame.worlds, span, *seen, image.segmentation]
    _launch(kernels.hide_unmirrored, frame, lambda window: [*cameras, window, *hidden], shape, span)
    is_parallel = camera.ray_model == "parallel"
    has_origins = not is_parallel and camera.origins is not None
    origins = rays_on_device(camera, device, "origins") if has_origins else None
    cast = [scene.triangles(faces=True).struct, planes, camera.ray_range(), is_parallel, origins, poses]
    beyond = [worlds, options.cull_backfaces, span, images_struct(images)]
    _launch(kernels.cast_beyond_mirror, frame, lambda window: [*cast, window, *beyond], shape, span)
    lights: Any = None
    if scene.lights:
        of_frame, lights = frame.lights(), Lights()
        lights.all = scratch.array("mirror lights", (count, len(scene.lights)), DeviceLight)
        lights.is_linear, lights.is_of_views, lights.dimming = of_frame.is_linear, True, 1.0
        if not of_frame.is_linear:  # as MuJoCo, which dims colors before they are lit, and thus not highlights
            lights.dimming, image.scale = mirror.reflectance, 1.0 / mirror.reflectance
        launch(kernels.mirror_lights, lights.all.shape, [of_frame, frame.poses, frame.worlds, lights.all], device)
    changed: dict[str, Any] = {"camera": camera, "poses": poses, "worlds": worlds, "images": images, "pixels": pixels}
    mirrored = replace(frame, **changed, shadows=None, occlusion=None, lit_by=lights, is_mirrored=True)
    compute_output("color", mirrored, image.color, scratch)
    if is_layered(mirrored):
        blend_layers(mirrored, image.color, "rays", options, scratch)
    added = [frame.materials(), image]
    inputs = [frame.worlds, span, frame.images["faces"], out]
    _launch(kernels.add_mirror_image, frame, lambda window: [*added, window, *inputs], shape, span)


def _excluding(worlds: Worlds, excluded: wp.array) -> Worlds:
    """Return worlds that exclude other objects."""
    from warpvis.kernels.casting.worlds import Worlds

    found: Any = Worlds()
    found.object_poses, found.world, found.object_sizes = worlds.object_poses, worlds.world, worlds.object_sizes
    found.excluded = excluded
    return found


def _launch(
    kernel: wp.Kernel,
    frame: Frame,
    arguments: Callable[[Window], KernelArguments],
    shape: tuple[int, int, int],
    span: int,
) -> None:
    launch_images(kernel, shape, arguments, device=frame.scene.device, threads=frame.threads, span=span)


def _span(frame: Frame) -> int:
    return WHOLE_ROW if frame.scene.device.is_cpu else 1
