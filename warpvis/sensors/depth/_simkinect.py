# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Noise model of the Kinect from Ankur Handa's simkinect."""

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

# Side of a cell with one dot [px], as in the pattern of simkinect; number of cells after which the pattern repeats.
_CELL, _CELLS = 3, 96
# Half the side of the window plus the margin that simkinect skips at the end [px].
_MIN_PATTERN = 10
_PATTERN_KEY = 0x5EED
_FILL_REACH = 3


@dataclass(frozen=True, eq=False)
class SimKinect(ByValue, DepthSensor):
    """The Kinect model of Ankur Handa's simkinect (``add_noise.py``), computed from one exact image.

    Depth is sampled bilinearly at each pixel plus a normal shift of `shift` px, with 0 for pixels without a surface,
    and its disparity f b / z is rounded to 1/8 px. A dot of the projector's pattern is detected if more than 1 / 1.2 of
    the brightness in its window of 9x9 pixels, including its own, belongs to dots with a disparity near the mean of the
    window: at a distance of r px from the dot, the difference times 1.44 r^2 must be less than 0.1 px. A pixel gets the
    depth of the nearest detected dot up to 3 px away, or none (EDGE); one to three rows and columns at the edge of the
    image have none. Depth is then rounded to multiples of 1 / `units` m, and becomes
    35130 / round(35130 / depth + `sigma` n + 0.5) of these. On average it is half a step nearer than the surface; the
    paper uses floor, which has no such bias.

    Sources: A. Handa, T. Whelan, J. McDonald and A. J. Davison, "A Benchmark for RGB-D Visual Odometry, 3D
    Reconstruction and SLAM", ICRA 2014; J. T. Barron and J. Malik, "Intrinsic Scene Properties from a Single RGB-D
    Image", CVPR 2013, for the steps; J. Bohg, J. Romero, A. Herzog and S. Schaal, "Robot Arm Pose Estimation through
    Pixel-Wise Part Classification", ICRA 2014, for the dots. Interpolation is exact, whereas ``remap`` of OpenCV, used
    by simkinect, may round positions to 1/32 px.
    """

    shift: float = 0.5
    """Standard deviation of the sampling position along both axes [px]."""
    baseline: float = 0.075
    """Distance between projector and imager [m]."""
    focal_length: float | None = None
    """Focal length of disparities [px]; the camera's `fx` by default."""
    units: float = 100.0
    """Units of depth per meter. 1 / z has steps of `units` / 35130: with 200, steps of depth are twice as high."""
    sigma: float = 1 / 6
    """Standard deviation of disparities before the final rounding [steps]."""
    pattern: ArrayInput | None = field(default=None, repr=False)
    """Brightness of the projector's dots, ``(H, W)`` uint8, 0 without a dot, aligned with the upper left corner of the
    image; no depth is measured outside of it. The default has one dot at a random position in each 3x3 pixels, as in
    simkinect's ``kinect-pattern_3x3.png``, the same in all images."""

    def __post_init__(self) -> None:
        for name in ("shift", "sigma"):
            check_number(getattr(self, name), name, minimum=0.0)
        for name, unit in (("baseline", "m"), ("focal_length", "px"), ("units", "per meter")):
            value = getattr(self, name)
            if (name != "focal_length" or value is not None) and check_number(value, name, minimum=0.0) == 0.0:
                raise ArrayError(f"{name} must be above 0 {unit}")
        if self.pattern is not None:
            object.__setattr__(self, "pattern", _check_pattern(self.pattern))

    @property
    def bytes_per_pixel(self) -> int:
        """Scratch memory per pixel [B]."""
        return 16

    def measure(self, exposure: Exposure) -> None:
        """Write the depth and reasons of the sensor."""
        from warpvis.kernels.simkinect import SimKinectModel, detect_dots, fill_from_dots, shift_to_levels

        lens, device, shape = exposure.camera, exposure.scene.device, exposure.true_depth.shape
        model, camera = SimKinectModel(), lens.device_struct()
        model.disparity_scale = (lens.fx if self.focal_length is None else self.focal_length) * self.baseline
        model.shift, model.units, model.sigma = self.shift, self.units, self.sigma
        pattern = make_pattern(lens.height, lens.width) if self.pattern is None else self.pattern
        dots = wp.array(pattern, dtype=wp.uint8, device=device)
        nearest = wp.array(closest_first(_FILL_REACH, _FILL_REACH**2), dtype=wp.vec2i, device=device)
        levels, detected = (exposure.scratch(name, shape, wp.int32) for name in ("levels", "kept"))

        def launch(kernel: wp.Kernel, *arguments: object, cameras: tuple[object, ...] = ()) -> None:
            launch_images(
                kernel, shape, lambda window: [*cameras, window, *arguments], device=device, threads=exposure.threads
            )

        across = draw_normal_image(exposure, STREAM_ACROSS, "across")
        down = draw_normal_image(exposure, STREAM_DOWN, "down")
        launch(shift_to_levels, model, exposure.true_depth, across, down, levels)
        launch(detect_dots, dots, levels, detected)
        noise = draw_normal_image(exposure, STREAM_DISPARITY, "across")
        written = exposure.depth_out, exposure.reasons_out
        launch(fill_from_dots, model, exposure.true_depth, detected, nearest, noise, *written, cameras=(camera,))


def make_pattern(height: int, width: int) -> NDArray[np.uint8]:
    """Return a pattern with one dot of brightness 255 in each 3x3 pixels, ``(height, width)``, equal for all sizes."""
    positions = (np.random.Philox(key=_PATTERN_KEY).random_raw(_CELLS * _CELLS) >> 32) * _CELL**2 >> 32
    block = np.zeros((_CELLS, _CELL, _CELLS, _CELL), dtype=np.uint8)
    row, column = np.divmod(positions.astype(np.int64).reshape(_CELLS, _CELLS), _CELL)
    block[np.arange(_CELLS)[:, None], row, np.arange(_CELLS), column] = 255
    side = _CELLS * _CELL
    copies = -(-height // side), -(-width // side)
    return np.ascontiguousarray(np.tile(block.reshape(side, side), copies)[:height, :width])


def _check_pattern(value: object) -> NDArray[np.uint8]:
    dots = as_numpy(value, name="pattern")
    if dots.ndim != 2 or min(dots.shape) < _MIN_PATTERN or dots.dtype.kind not in "iub":
        raise ArrayError(
            f"pattern must be an image (H, W) of whole numbers with at least {_MIN_PATTERN}x{_MIN_PATTERN} pixels, "
            f"got {dots.dtype} of shape {dots.shape}"
        )
    if dots.min() < 0 or dots.max() > 255:
        raise ArrayError(f"pattern must be from 0 to 255, got {dots.min()} to {dots.max()}")
    if not dots.any():
        raise ArrayError("pattern must have dots, got 0 everywhere")
    return np.ascontiguousarray(dots, dtype=np.uint8)
