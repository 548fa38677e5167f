# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Corruptions of depth images for machine learning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.checks import as_floats
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import as_items, check_number, check_whole
from warpvis.core.kernel_cache import launch
from warpvis.errors import ArrayError
from warpvis.rendering import DepthSensor, Exposure, TakesLens
from warpvis.scene import Scene
from warpvis.sensors.depth._base import RANDOM_WORDS, kernel_images, kernel_inputs

_MAX_RECTANGLES, _MAX_SIDE = 256, 2**20


@dataclass(frozen=True)
class Corruptions(DepthSensor):
    """Exact depth, or the depth of another sensor, with generic noise and holes that model no particular device.

    Depth z becomes z (1 + `multiplied` n) + `added` m, with independent standard normal n and m for each pixel. Pixels
    are lost (DROPOUT, NaN) independently with probability `dropout`, and inside rectangles. The number and the sides of
    the rectangles of a view are uniformly distributed integers, their centers are uniformly distributed in the image.
    Depth outside of the camera's range is then reported as such (RANGE). Pixels without depth are not changed.
    """

    added: float = 0.0
    """Standard deviation of additive noise [m]."""
    multiplied: float = 0.0
    """Standard deviation of the factor of depth, whose mean is 1."""
    dropout: float = 0.0
    """Probability that a pixel is lost, from 0 to 1."""
    rectangles: tuple[int, int] = (0, 0)
    """Minimum and maximum number of lost rectangles per view."""
    sides: tuple[int, int] = (8, 32)
    """Minimum and maximum width and height of rectangles [px]."""
    of: DepthSensor | None = None
    """The sensor whose depth is corrupted; by default, exact depth."""

    takes_lens: ClassVar[TakesLens] = "any"

    def __post_init__(self) -> None:
        check_number(self.added, "added", minimum=0.0)
        check_number(self.multiplied, "multiplied", minimum=0.0)
        check_number(self.dropout, "dropout", minimum=0.0, maximum=1.0)
        object.__setattr__(self, "rectangles", _check_limits(self.rectangles, "rectangles", 0, _MAX_RECTANGLES))
        object.__setattr__(self, "sides", _check_limits(self.sides, "sides", 1, _MAX_SIDE))
        if self.of is not None and not isinstance(self.of, DepthSensor):
            raise ArrayError(f"of must be a model of warpvis.sensors, such as StereoDepth, got {self.of!r}")
        inner: object = self.of
        while inner is not None:
            if isinstance(inner, Corruptions):
                raise ArrayError("of must not contain Corruptions, because both would use the same random numbers")
            inner = getattr(inner, "of", None)

    def camera(self) -> Camera:
        """Return the camera of the sensor whose depth is corrupted."""
        return super().camera() if self.of is None else self.of.camera()

    @property
    def needs(self) -> tuple[Literal["normals", "segmentation"], ...]:
        """Exact images that are read."""
        return () if self.of is None else self.of.needs

    @property
    def bytes_per_pixel(self) -> int:
        """Scratch memory per pixel [B]."""
        return 0 if self.of is None else self.of.bytes_per_pixel

    @property
    def edge_shift(self) -> int:
        """Maximum distance by which the sensor displaces edges [px]."""
        return 0 if self.of is None else self.of.edge_shift

    def check(self, scene: Scene, camera: object) -> Camera:
        """Return the camera if it can be used with the sensor and the scene."""
        return super().check(scene, camera) if self.of is None else self.of.check(scene, camera)

    def depth_sigma(self, depth: ArrayLike, camera: Camera) -> NDArray[np.float64]:
        """Return the root of the sum of squares of both kinds of noise and of that of the sensor."""
        z = as_floats(depth, "depth")
        inner = 0.0 if self.of is None else self.of.depth_sigma(z, camera)
        return np.sqrt(self.added**2 + (self.multiplied * z) ** 2 + np.square(inner))

    def measure(self, exposure: Exposure) -> None:
        """Write the depth and reasons of the sensor."""
        from warpvis.kernels.sensors.corruptions import CorruptionModel, corrupt_depth, place_rectangles

        if self.of is not None:
            self.of.measure(exposure)
        model = CorruptionModel()
        model.added, model.multiplied, model.dropout = self.added, self.multiplied, self.dropout
        model.min_count, model.max_count = self.rectangles
        model.min_side, model.max_side = self.sides
        inputs = kernel_inputs(exposure)
        if self.of is not None:
            inputs.true_depth = None
        if model.max_count:
            rectangles = exposure.scratch("rectangles", (len(exposure.poses), model.max_count), wp.vec4i)
            launch(place_rectangles, rectangles.shape, [model, inputs, rectangles], exposure.scene.device)
            model.rectangles = rectangles
        exposure.launch(corrupt_depth, model, inputs, kernel_images(exposure), rows=RANDOM_WORDS)


def _check_limits(value: object, name: str, minimum: int, maximum: int) -> tuple[int, int]:
    """Check that `value` is two integers in ascending order within limits, and return them."""
    limits = as_items(value, name)
    if len(limits) != 2:
        raise ArrayError(f"{name} must be two whole numbers, minimum and maximum, got {value!r}")
    low, high = (check_whole(limit, name, minimum=minimum) for limit in limits)
    if not low <= high <= maximum:
        raise ArrayError(f"{name} must be a minimum and a maximum of at most {maximum}, got {low} and {high}")
    return low, high
