# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Sums of the normal equations of registration: rendered and measured depth of some views at their current poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.base import AnyCamera
from warpvis.cameras.rays import Rays
from warpvis.core.arrays import take_rows
from warpvis.core.kernel_cache import launch
from warpvis.core.poses import vectors_in_axes
from warpvis.core.threads import launch_images
from warpvis.rendering import Output, Renderer, Views, as_views, views_for
from warpvis.scene import Scene
from warpvis.scene.worlds import part_of

# Pixels that one thread of a CPU or one warp of 32 threads adds up.
_CPU_STRIP, _GPU_STRIP, _WARP = 2048, 512, 32

# Minimum number of strips of a launch on a CPU thread: they take as long as the launch, about 0.1 ms.
_PIECE = 8

# Size of the rendered images of one block of views [bytes].
_CPU_BLOCK, _GPU_BLOCK = 1 << 26, 1 << 30

NUM_SUMS = 45
"""Number of sums of a view and a body: H, b, cost, inliers, measured pixels."""


class DepthSums:
    """Renders views, and adds the terms of the pixels of each moving body.

    A body is a set of rigidly connected objects. Its twist is about the origin of one of them, in a column of the
    object poses.
    """

    def __init__(
        self,
        scene: Scene,
        camera: AnyCamera,
        depth: wp.array,
        sigmas: wp.array,
        weighting: Any,
        threads: int,
        columns: NDArray[np.integer],
        bodies: Sequence[int],
    ) -> None:
        """Initialize.

        Args:
            scene: The scene.
            camera: The camera.
            depth: Measured depth, ``(V, pixels)`` or ``(1, pixels)``.
            sigmas: Tabulated standard deviations of depth.
            weighting: A `Weighting` struct; its column is set for each body.
            threads: Number of CPU threads.
            columns: Column of the body of each object, -1 for static objects.
            bodies: Columns of the bodies, -1 for the camera.
        """
        self.device, self.threads = scene.device, threads
        self.weighting, self.depth, self.sigmas = weighting, depth, sigmas
        self.bodies, self.is_camera = tuple(bodies), tuple(bodies) == (-1,)
        outputs: list[Output] = ["depth", "normals"]
        if not self.is_camera:
            outputs.append("segmentation")
        self.renderer = Renderer(scene, _without_range(camera), outputs=outputs, threads=threads)
        self.shape = camera.shape
        self.columns = wp.array(np.asarray(columns, dtype=np.int32), dtype=wp.int32, device=self.device)
        self.rays = _table(camera.rays, camera, self.device)
        self.origins = None if camera.origins is None else _table(camera.origins, camera, self.device)
        self.strips = _strips(camera, self.device)
        # The views of the last call with their memory: those of a whole block are the same in most calls.
        self._slots: tuple[slice | NDArray[np.integer], Views, Any, wp.array] | None = None
        self.num_strips = -(-self.strips.pixels // self.strips.size)

    def blocks(self, count: int) -> list[slice]:
        """Return blocks of views, and allocate memory for the largest one."""
        self._slots = None
        limit = _CPU_BLOCK if self.device.is_cpu else _GPU_BLOCK
        size = min(count, max(1, limit // ((16 if self.is_camera else 20) * self.strips.pixels)))
        self._views = views_for(self.renderer.outputs, (size, *self.shape), self.device)
        self._memory = wp.empty((size, self.num_strips, NUM_SUMS), dtype=wp.float64, device=self.device)
        return [slice(first, min(first + size, count)) for first in range(0, count, size)]

    def add(self, chosen: slice | NDArray[np.integer], poses: wp.array, worlds: Any, sums: Sequence[wp.array]) -> None:
        """Render some views of a block, and write their sums.

        Args:
            chosen: The views.
            poses: Camera poses of all views, ``(V,)`` transform.
            worlds: The worlds of all views.
            sums: Sums of each body, ``(V, 45)`` float64; rows of other views keep their values.
        """
        from warpvis.kernels.gradients.normal_equations import add_strips, sum_terms
        from warpvis.kernels.gradients.normal_rows import sum_terms_rows

        cameras, shown = take_rows(poses, chosen), part_of(worlds, chosen)
        if self._slots is None or chosen is not self._slots[0]:
            self._slots = chosen, *self._slots_of(chosen)
        _, images, rendered, strips = self._slots
        self.renderer.render_parsed(cameras, shown, out=images)
        count, lanes = len(strips), self.strips.lanes
        scene = [self.columns, cameras, self.rays, self.origins]
        for body, sums_out in zip(self.bodies, sums, strict=True):
            self.weighting.column = body
            inputs = [self.weighting, self.strips, self.sigmas, shown.object_poses, rendered, self.depth, strips]
            launch_images(
                sum_terms_rows if self.device.is_cpu else sum_terms,
                (count, self.num_strips, lanes),
                lambda window, inputs=inputs: [*scene, window, *inputs],  # type: ignore[misc]
                device=self.device,
                threads=self.threads,
                min_pixels=_PIECE,
            )
            launch(add_strips, (count, NUM_SUMS, lanes), [rendered.views, lanes, strips, sums_out], self.device)

    def _slots_of(self, chosen: slice | NDArray[np.integer]) -> tuple[Views, Any, wp.array]:
        """Return the images of some views, the images as a `Rendered` struct, and memory for the sums of strips."""
        from warpvis.kernels.gradients.normal_equations import Rendered

        numbers = np.arange(chosen.start, chosen.stop) if isinstance(chosen, slice) else chosen
        count = len(numbers)
        images = {name: getattr(self._views, name)[:count] for name in self.renderer.outputs}
        flat = {name: image.reshape((count, self.strips.pixels)) for name, image in images.items()}
        rendered = Rendered()
        rendered.views = wp.array(numbers, dtype=wp.int32, device=self.device)
        rendered.depth, rendered.normals = flat["depth"], flat["normals"]
        if "segmentation" in flat:
            rendered.objects = flat["segmentation"]
        return as_views(images), rendered, self._memory[:count]


def _without_range(camera: AnyCamera) -> AnyCamera:
    """Return a camera whose depth is finite at any distance of the surface."""
    if isinstance(camera, Rays):
        return camera.with_range(0.0, math.inf)
    return replace(camera, near=0.0, far=math.inf)  # type: ignore[type-var]  # all other cameras are dataclasses


def _table(vectors: NDArray[np.float64], camera: AnyCamera, device: wp.Device) -> wp.array:
    """Return vectors of all pixels in the OpenCV frame, shape ``(3, pixels)`` float64."""
    rows = vectors_in_axes(vectors.reshape(-1, 3), camera.axes, "opencv")
    return wp.array(np.ascontiguousarray(rows.T), dtype=wp.float64, device=device)


def _strips(camera: AnyCamera, device: wp.Device) -> Any:
    """Return how pixels are distributed, by the number of pixels only: sums do not depend on the number of threads."""
    from warpvis.kernels.gradients.normal_equations import Strips

    strips = Strips()
    strips.width, strips.pixels = camera.width, math.prod(camera.shape)
    strips.size, strips.lanes = (_CPU_STRIP, 1) if device.is_cpu else (_GPU_STRIP, _WARP)
    return strips
