# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A caster that renders colors by shading the points, objects and triangles from another caster."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import warp as wp

from warpvis.cameras.base import AnyCamera
from warpvis.core.arrays import empty
from warpvis.core.poses import Convention
from warpvis.core.threads import launch_images
from warpvis.core.types import PoseLike
from warpvis.rendering._prepared import FreeList
from warpvis.rendering._views import CAST_OUTPUTS, COLOR_OUTPUTS, OUTPUTS
from warpvis.rendering.casters import CastPoses, as_images

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds
    from warpvis.kernels.shading.base_colors import Footprint
    from warpvis.scene import Scene

_NEEDED = ("points", "segmentation", "faces")
# Maximum number of kinds of calls (shape and stream) with cached memory for images that were not requested.
_MAX_KINDS = 3


class ShadingCaster:
    """Wrap another caster and add colors of the visible surfaces."""

    def __init__(self, caster: Any, scene: Scene, camera: AnyCamera, *, threads: int) -> None:
        """Set up shading of the images of `caster`, which must use the same scene and camera."""
        self._caster = caster
        self._scene = scene
        self._camera = camera
        self._threads = threads
        self._free = FreeList[dict[str, wp.array]](_MAX_KINDS)

    def parse_poses(self, poses: PoseLike, convention: Convention) -> CastPoses:
        """Check poses and return them in the format of `cast`."""
        return self._caster.parse_poses(poses, convention)

    def cast(self, poses: CastPoses, worlds: Worlds, images: list[wp.array | None]) -> None:
        """Write images of all poses, in the order of `OUTPUTS`; skip images that are None."""
        self._shade(poses, worlds, images, lambda needed: self._caster.cast(poses, worlds, needed))

    def cast_at(self, poses: CastPoses, worlds: Worlds, pixels: wp.array, images: list[wp.array | None]) -> None:
        """Write images through image points, vec2 of shape ``(V, Y, X)``, which is also the images' shape."""
        self._shade(poses, worlds, images, lambda needed: self._caster.cast_at(poses, worlds, pixels, needed))

    def _shade(self, poses: CastPoses, worlds: Worlds, images: list[wp.array | None], cast: Any) -> None:
        by_name = dict(zip(OUTPUTS, images, strict=False))
        color_images = {name: image for name, image in by_name.items() if name in COLOR_OUTPUTS and image is not None}
        lit = "color" in color_images and bool(self._scene.lights)
        if not color_images:
            cast(images[: len(CAST_OUTPUTS)])
            return
        device, shape = self._scene.device, next(iter(color_images.values())).shape
        reuses = device.is_cpu or not device.is_capturing  # a captured graph must not share its memory
        kind = (shape, device.is_cuda and device.stream)
        scratch = (self._free.take(kind) if reuses else None) or {}
        for name in (*_NEEDED, "normals") if lit else _NEEDED:
            if by_name[name] is None:
                if name not in scratch:
                    scratch[name] = empty(shape, CAST_OUTPUTS[name], name=name, device=device)
                by_name[name] = scratch[name]
        cast([by_name[name] for name in CAST_OUTPUTS])
        device_poses = poses if isinstance(poses, wp.array) else wp.array(poses, dtype=wp.transform, device=device)
        for name, image in color_images.items():
            self._launch(device_poses, worlds, by_name, image, lit=lit and name == "color")
        if reuses:
            self._free.give_back(kind, scratch)

    def _launch(
        self, poses: wp.array, worlds: Worlds, by_name: dict[str, wp.array | None], image: wp.array, *, lit: bool
    ) -> None:
        from warpvis.kernels.shading import base_colors, lighting

        scene = self._scene
        names = (*_NEEDED, "normals") if lit else _NEEDED
        *seen, colors = as_images([*(by_name[name] for name in names), image])
        assert colors is not None  # only requested images are shaded
        scene_data = [scene.device_materials(scene.background), *([scene.device_lights(scene.lights)] if lit else [])]
        footprint = self._footprint()
        launch_images(
            lighting.shade_lit_colors if lit else base_colors.shade_base_colors,
            colors.shape,
            lambda window: [*scene_data, footprint, poses, window, worlds, *seen, colors],
            device=scene.device,
            threads=self._threads,
        )

    def _footprint(self) -> Footprint:
        """Return the size of a pixel."""
        from warpvis.kernels.shading import base_colors

        footprint = base_colors.Footprint()
        footprint.kind = {
            "pinhole": base_colors.FOOTPRINT_PINHOLE,
            "parallel": base_colors.FOOTPRINT_PARALLEL,
            "table": base_colors.FOOTPRINT_CONE,
        }[self._camera.ray_model]
        footprint.size = wp.vec2(*self._camera.pixel_size())
        return footprint


def extra_bytes(outputs: tuple[str, ...]) -> int:
    """Return the memory used per pixel in addition to outputs with colors [bytes]."""
    lacking = [name for name in (*_NEEDED, "normals") if name not in outputs]
    return sum(wp.types.type_size_in_bytes(CAST_OUTPUTS[name]) for name in lacking)
