# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Plain corruptions of depth images, for learning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import warp as wp

from warpvis.core.camera import Camera
from warpvis.core.checks import as_items, check_number, check_whole
from warpvis.core.kernel_cache import launch
from warpvis.core.threads import WHOLE_ROW, launch_images
from warpvis.errors import ArrayError
from warpvis.rendering import DepthSensor, Exposure, TakesLens
from warpvis.scene import Scene

_MAX_RECTANGLES, _MAX_SIDE = 256, 2**20


@dataclass(frozen=True)
class Corruptions(DepthSensor):
    """Exact depth, or what another sensor says, with noise and holes that are of no device.

    Depth z becomes z (1 + `multiplied` n) + `added` m, with standard normal n and m of each pixel. Lost (DROPOUT, NaN)
    are pixels one by one, with a chance of `dropout`, and those inside of a view's rectangles, whose number and sides
    are drawn from ranges, each whole number as likely as another, and whose middles are anywhere in the image. What is
    then outside of the camera's range is told as that (RANGE). Pixels without depth stay as they are.
    """

    added: float = 0.0
    """Deviation of what is added [m]."""
    multiplied: float = 0.0
    """Deviation of what depth is multiplied with, about 1."""
    dropout: float = 0.0
    """Share of pixels that are lost by chance, from 0 to 1."""
    rectangles: tuple[int, int] = (0, 0)
    """Least and greatest number of rectangles that are lost in a view."""
    sides: tuple[int, int] = (8, 32)
    """Least and greatest width and height of one [px]."""
    of: DepthSensor | None = None
    """The sensor whose depth is corrupted; the exact depth by default."""

    takes_lens: ClassVar[TakesLens] = "any"

    def __post_init__(self) -> None:
        check_number(self.added, "added", least=0.0)
        check_number(self.multiplied, "multiplied", least=0.0)
        check_number(self.dropout, "dropout", least=0.0, most=1.0)
        object.__setattr__(self, "rectangles", _check_limits(self.rectangles, "rectangles", 0, _MAX_RECTANGLES))
        object.__setattr__(self, "sides", _check_limits(self.sides, "sides", 1, _MAX_SIDE))
        if self.of is not None and not isinstance(self.of, DepthSensor):
            raise ArrayError(f"of must be a model of warpvis.sensors, such as StereoDepth, got {self.of!r}")
        inner: object = self.of
        while inner is not None:
            if isinstance(inner, Corruptions):
                raise ArrayError(
                    "of must be a device's model, and no Corruptions: both would have the same random numbers"
                )
            inner = getattr(inner, "of", None)

    def camera(self) -> Camera:
        """Return the camera of the sensor whose depth is corrupted.

        Raises:
            CameraError: There is none, or it was made without one.
        """
        return super().camera() if self.of is None else self.of.camera()

    @property
    def needs(self) -> tuple[Literal["normals", "segmentation"], ...]:
        """Which images of the first surface are read."""
        return () if self.of is None else self.of.needs

    @property
    def bytes_per_pixel(self) -> int:
        """How much room a pixel takes."""
        return 0 if self.of is None else self.of.bytes_per_pixel

    def check(self, scene: Scene, camera: object) -> Camera:
        """Return the camera, if the model is one of it in a scene.

        Raises:
            WarpvisError: It is not.
        """
        return super().check(scene, camera) if self.of is None else self.of.check(scene, camera)

    def measure(self, exposure: Exposure) -> None:
        """Write the sensor's depth and reasons."""
        from warpvis.kernels.corruptions import CorruptionModel, place_rectangles

        if self.of is not None:
            self.of.measure(exposure)
        model = CorruptionModel()
        model.added, model.multiplied, model.dropout = self.added, self.multiplied, self.dropout
        model.min_count, model.max_count = self.rectangles
        model.min_side, model.max_side = self.sides
        model.seed = exposure.seed
        camera, views = exposure.image_range, len(exposure.poses)
        rectangles = None
        if model.max_count:
            rectangles = exposure.room("rectangles", (views, model.max_count), wp.vec4i)
            placed = [camera, model, exposure.draws, rectangles]
            launch(place_rectangles, rectangles.shape, placed, exposure.scene.device)
        given = [model, exposure.true_depth if self.of is None else None, rectangles, exposure.draws]
        kernel, span = _kernel(exposure.scene.device)
        launch_images(
            kernel,
            exposure.depth_out.shape,
            lambda window: [camera, window, *given, exposure.depth_out, exposure.reasons_out],
            device=exposure.scene.device,
            threads=exposure.threads,
            span=span,
        )


def _kernel(device: wp.Device) -> tuple[wp.Kernel, int]:
    """Return what corrupts on a device, and how many pixels a thread takes."""
    if device.is_cpu:
        from warpvis.kernels.noise_rows import corrupt_depth_rows

        return corrupt_depth_rows, WHOLE_ROW
    from warpvis.kernels.corruptions import corrupt_depth

    return corrupt_depth, 1


def _check_limits(value: object, name: str, least: int, most: int) -> tuple[int, int]:
    """Return two whole numbers, the second no less than the first."""
    limits = as_items(value, name)
    if len(limits) != 2:
        raise ArrayError(f"{name} must be two whole numbers, the least and the greatest, got {value!r}")
    low, high = (check_whole(limit, name, least=least) for limit in limits)
    if not low <= high <= most:
        raise ArrayError(f"{name} must be from a number to one no less, and at most {most}, got {low} and {high}")
    return low, high
