# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Noise of a Kinect as Ankur Handa's simkinect makes it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import check_number
from warpvis.core.threads import launch_images
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.kernels.constants import STREAM_ACROSS, STREAM_DISPARITY, STREAM_DOWN
from warpvis.rendering import DepthSensor, Exposure
from warpvis.sensors.depth._by_value import ByValue
from warpvis.sensors.depth._closest import closest_first
from warpvis.sensors.depth._normal_images import draw_normal_image

# A dot in each cell of so many pixels, as in the pattern that comes with simkinect; after so many cells it repeats.
_CELL, _CELLS = 3, 96
# Half the window's side plus what simkinect leaves out at the end, [px].
_MIN_PATTERN = 10
_PATTERN_KEY = 0x5EED
_FILL_REACH = 3


@dataclass(frozen=True, eq=False)
class SimKinect(ByValue, DepthSensor):
    """A Kinect as Ankur Handa's simkinect simulates one (``add_noise.py``), of one exact image.

    In its steps: depth is looked up beside each pixel, by a normal shift of `shift` px, between the four pixels around
    it, of which those without a surface have depth 0; its disparity f b / z is rounded to 1/8 px. A dot of the
    projector's pattern is found if it and others near the mean of its window of 9x9 pixels are more than 1 / 1.2 of
    the window's light: a disparity is near that is less than 0.1 px from it times 1.44 r^2, r px away from the dot. A
    pixel has the depth of the nearest dot that is found, up to 3 px away, or none (EDGE), as have one to three rows
    and columns at the image's edge. Depth is then rounded to whole units, 1 / `units` m, and becomes
    35130 / round(35130 / depth + `sigma` n + 0.5): so it is, on average, half a step nearer than what was seen, where
    the paper, which takes the floor, has it right.

    Sources: A. Handa, T. Whelan, J. McDonald and A. J. Davison, "A Benchmark for RGB-D Visual Odometry, 3D
    Reconstruction and SLAM", ICRA 2014; J. T. Barron and J. Malik, "Intrinsic Scene Properties from a Single RGB-D
    Image", CVPR 2013, for the steps; J. Bohg, J. Romero, A. Herzog and S. Schaal, "Robot Arm Pose Estimation through
    Pixel-Wise Part Classification", ICRA 2014, for the dots. What the program leaves to OpenCV is exact here, where
    ``remap`` may round places to 1/32 px.
    """

    shift: float = 0.5
    """Deviation of where depth is looked up, along both axes [px]."""
    baseline: float = 0.075
    """Distance of projector and imager [m]."""
    focal_length: float | None = None
    """Focal length of disparities [px]; the camera's `fx` by default."""
    units: float = 100.0
    """Units of depth in a metre. 1 / z has steps of `units` / 35130: with 200, steps of depth are twice as high."""
    sigma: float = 1 / 6
    """Deviation of disparities before they are rounded at the end [steps]."""
    pattern: ArrayInput | None = field(default=None, repr=False)
    """The projector's dots, ``(H, W)`` uint8: 0, or how bright a dot is; at the image's upper left corner, and nothing
    is found beside it. By default each 3x3 pixels have one, as in simkinect's ``kinect-pattern_3x3.png``, at a place
    of its own, the same in all images."""

    def __post_init__(self) -> None:
        for name in ("shift", "sigma"):
            check_number(getattr(self, name), name, least=0.0)
        for name, unit in (("baseline", "m"), ("focal_length", "px"), ("units", "per metre")):
            value = getattr(self, name)
            if (name != "focal_length" or value is not None) and check_number(value, name, least=0.0) == 0.0:
                raise ArrayError(f"{name} must be above 0 {unit}")
        if self.pattern is not None:
            object.__setattr__(self, "pattern", _check_pattern(self.pattern))

    @property
    def bytes_per_pixel(self) -> int:
        """How much room a pixel takes."""
        return 16

    def measure(self, exposure: Exposure) -> None:
        """Write the sensor's depth and reasons."""
        from warpvis.kernels.simkinect import SimKinectModel, detect_dots, fill_from_dots, shift_to_levels

        lens, device, shape = exposure.camera, exposure.scene.device, exposure.true_depth.shape
        model, camera = SimKinectModel(), lens.device_struct()
        model.disparity_scale = (lens.fx if self.focal_length is None else self.focal_length) * self.baseline
        model.shift, model.units, model.sigma = self.shift, self.units, self.sigma
        pattern = make_pattern(lens.height, lens.width) if self.pattern is None else self.pattern
        dots = wp.array(pattern, dtype=wp.uint8, device=device)
        nearest = wp.array(closest_first(_FILL_REACH, _FILL_REACH**2), dtype=wp.vec2i, device=device)
        levels, kept = (exposure.room(name, shape, wp.int32) for name in ("levels", "kept"))

        def launch(kernel: wp.Kernel, *given: object, cameras: tuple[object, ...] = ()) -> None:
            launch_images(
                kernel, shape, lambda window: [*cameras, window, *given], device=device, threads=exposure.threads
            )

        across = draw_normal_image(exposure, STREAM_ACROSS, "across")
        down = draw_normal_image(exposure, STREAM_DOWN, "down")
        launch(shift_to_levels, model, exposure.true_depth, across, down, levels)
        launch(detect_dots, dots, levels, kept)
        noise = draw_normal_image(exposure, STREAM_DISPARITY, "across")
        written = exposure.depth_out, exposure.reasons_out
        launch(fill_from_dots, model, exposure.true_depth, kept, nearest, noise, *written, cameras=(camera,))


def make_pattern(height: int, width: int) -> NDArray[np.uint8]:
    """Return dots, one in each 3x3 pixels, of 255 where one is, ``(height, width)``; the same ones in every size."""
    places = (np.random.Philox(key=_PATTERN_KEY).random_raw(_CELLS * _CELLS) >> 32) * _CELL**2 >> 32
    block = np.zeros((_CELLS, _CELL, _CELLS, _CELL), dtype=np.uint8)
    row, column = np.divmod(places.astype(np.int64).reshape(_CELLS, _CELLS), _CELL)
    block[np.arange(_CELLS)[:, None], row, np.arange(_CELLS), column] = 255
    side = _CELLS * _CELL
    copies = -(-height // side), -(-width // side)
    return np.ascontiguousarray(np.tile(block.reshape(side, side), copies)[:height, :width])


def _check_pattern(value: object) -> NDArray[np.uint8]:
    dots = as_numpy(value, name="pattern")
    if dots.ndim != 2 or min(dots.shape) < _MIN_PATTERN or dots.dtype.kind not in "iub":
        raise ArrayError(
            f"pattern must be an image (H, W) of whole numbers, of at least {_MIN_PATTERN}x{_MIN_PATTERN} pixels, "
            f"got {dots.dtype} of shape {dots.shape}"
        )
    if dots.min() < 0 or dots.max() > 255:
        raise ArrayError(f"pattern must be from 0 to 255, got {dots.min()} to {dots.max()}")
    if not dots.any():
        raise ArrayError("pattern must have dots, and is 0 everywhere")
    return np.ascontiguousarray(dots, dtype=np.uint8)
