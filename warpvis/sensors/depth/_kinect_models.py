# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Published models of the Kinect: the noise of two papers, and models of the Redwood dataset, Habitat and simkinect."""

from __future__ import annotations

import math
import os
import warnings
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.checks import as_floats
from warpvis.cameras.pinhole import Camera, require_camera
from warpvis.core.arrays import as_numpy
from warpvis.core.checks import as_path, check_angle, check_flag, check_number, describe_exception
from warpvis.core.numpy_files import read_array
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError, FileFormatError
from warpvis.rendering import DepthSensor, Exposure, TakesLens
from warpvis.sensors.depth._base import (
    RANDOM_WORDS,
    ByValue,
    check_positive,
    closest_first,
    kernel_images,
    kernel_inputs,
)

_STEEPEST = math.radians(89.9)


@dataclass(frozen=True)
class NguyenNoise(DepthSensor):
    """Axial and lateral noise of a Kinect as functions of distance and angle, by Nguyen, Izadi and Lovell.

    C. V. Nguyen, S. Izadi and D. Lovell, "Modeling Kinect Sensor Noise for Improved 3D Reconstruction and Tracking",
    3DIMPVT 2012. Let a be the angle between the surface normal and the optical axis, and z the depth [m]. The error of
    depth is normal with standard deviation 0.0012 + 0.0019 (z - 0.4)^2, plus 0.0001 / sqrt(z) (a / (pi / 2 - a))^2 for
    a of 60 degrees or more (equations 3 and 4). The lateral standard deviation is 0.8 + 0.035 a / (pi / 2 - a) px
    (equation 2): the center of each pixel is shifted along both axes, and the pixel measures the plane of the surface
    at the shifted position. Edges become ragged, but a plane stays a plane, with the axial deviation of the paper.
    Positions outside of the image are clamped to the nearest pixel.

    The measurements of the paper range from 0.4 to 3 m. Surfaces at more than `max_angle` are lost (GRAZING).
    """

    min_axial: float = 0.0012
    """Minimum axial standard deviation [m]."""
    axial_growth: float = 0.0019
    """Quadratic coefficient of the axial standard deviation [1/m]."""
    best_depth: float = 0.4
    """Depth of the minimum axial standard deviation [m]."""
    grazing_axial: float = 0.0001
    """Coefficient of the term added from `grazing_angle` on: its value at 45 degrees and 1 m [m]."""
    grazing_angle: float = math.radians(60.0)
    """Angle from which that term is added [rad]."""
    lateral: float = 0.8
    """Lateral standard deviation at normal incidence [px]."""
    lateral_growth: float = 0.035
    """Coefficient of the growth with the angle: the added deviation at 45 degrees [px]."""
    max_angle: float = math.radians(85.0)
    """Maximum angle at which a surface is measured [rad]; the formulas diverge at 90 degrees. Not from the paper."""

    def __post_init__(self) -> None:
        for name in ("min_axial", "axial_growth", "best_depth", "grazing_axial", "lateral", "lateral_growth"):
            check_number(getattr(self, name), name, minimum=0.0)
        check_angle(self.grazing_angle, "grazing_angle", minimum=0.0, maximum=math.pi / 2)
        check_angle(self.max_angle, "max_angle", minimum=0.0, maximum=_STEEPEST)

    @property
    def needs(self) -> tuple[Literal["normals", "segmentation"], ...]:
        """Exact images that are read."""
        return ("normals",)

    def depth_sigma(self, depth: ArrayLike, camera: Camera) -> NDArray[np.float64]:
        """Return the axial standard deviation at normal incidence, equation 3."""
        return self.min_axial + self.axial_growth * (as_floats(depth, "depth") - self.best_depth) ** 2

    def measure(self, exposure: Exposure) -> None:
        """Write the depth and reasons of the sensor."""
        from warpvis.kernels.sensors.kinect_noise import NguyenModel, measure_nguyen

        model = NguyenModel()
        for name in self.__dataclass_fields__:
            setattr(model, name, getattr(self, name))
        inputs = model, kernel_inputs(exposure), kernel_images(exposure)
        exposure.launch(measure_nguyen, *inputs, cameras=[exposure.poses], rows=RANDOM_WORDS)


@dataclass(frozen=True)
class KhoshelhamNoise(DepthSensor):
    """Random error and quantization of a Kinect's depth, by Khoshelham and Elberink.

    K. Khoshelham and S. O. Elberink, "Accuracy and Resolution of Kinect Depth Data for Indoor Mapping Applications",
    Sensors 12(2), 2012. Depth z follows from integer disparities d as 1 / z = `step` d; consecutive depths differ by
    2.85e-3 z^2 m. The measured standard deviation of disparities is half a step, 1.425e-3 z^2 m. Rounding contributes
    sqrt(1/12) of a step to it; `sigma` is the rest. Errors are along the ray of the pixel: x and y of the point have
    proportional errors, as in the paper.
    """

    step: float = 2.85e-3
    """Step of disparity, as 1 / z [1/m]: m / (f b) in the paper, there in centimeters."""
    sigma: float = math.sqrt(0.25 - 1 / 12)
    """Standard deviation of disparities before rounding [steps]."""
    rounds: bool = True
    """Whether disparities are rounded to integers."""

    takes_lens: ClassVar[TakesLens] = "z"

    def __post_init__(self) -> None:
        check_positive(self.step, "step", "per meter")
        check_number(self.sigma, "sigma", minimum=0.0)
        check_flag(self.rounds, "rounds")

    def depth_sigma(self, depth: ArrayLike, camera: Camera) -> NDArray[np.float64]:
        """Return `step` z^2 times the standard deviation of disparities, with rounding."""
        disparity_sigma = math.sqrt(self.sigma**2 + (1 / 12 if self.rounds else 0.0))
        return self.step * disparity_sigma * as_floats(depth, "depth") ** 2

    def measure(self, exposure: Exposure) -> None:
        """Write the depth and reasons of the sensor."""
        from warpvis.kernels.sensors.kinect_noise import KhoshelhamModel, measure_khoshelham

        model = KhoshelhamModel()
        model.step, model.sigma, model.rounds = self.step, self.sigma, int(self.rounds)
        exposure.launch(measure_khoshelham, model, kernel_inputs(exposure), kernel_images(exposure), rows=RANDOM_WORDS)


# Constants of the Redwood simulator, with the names of `RedwoodModel`.
_REDWOOD = {
    "jitter": 0.25,
    "farthest": 10.0,
    "disparity_scale": 35.130,
    "disparity_sigma": 0.027778,
    "levels": 8.0,
    "min_factor": 1e-5,
}
_TABLE = (80, 80, 5)
# The distortion file: number of header lines, of numbers before the first cell, and of numbers per cell; offset of the
# five factors in a cell; minimum count of samples: cells with fewer samples in all five bins have no factors.
_HEADER_LINES, _LEADING_NUMBERS, _CELL_NUMBERS, _FACTORS, _MIN_SAMPLES = 5, 3, 23, 15, 8000
_MAX_BYTES = 2**28

# Side of a cell with one dot [px], as in the pattern of simkinect; number of cells after which the pattern repeats.
_CELL, _CELLS = 3, 96
# Half the side of the window plus the margin that simkinect skips at the end [px].
_MIN_PATTERN = 10
_PATTERN_KEY = 0x5EED
_FILL_REACH, _DOT_REACH = 3, 4  # of a dot that fills pixels, and of the window of a dot [px]


@dataclass(frozen=True, eq=False)
class RedwoodNoise(ByValue, DepthSensor):
    """The Kinect model of the simulator of the Redwood dataset and of Habitat's ``RedwoodDepthNoiseModel`` on a CPU.

    S. Choi, Q.-Y. Zhou and V. Koltun, "Robust Reconstruction of Indoor Scenes", CVPR 2015, and its ``simdepth.py``,
    after A. Teichman, S. Miller and S. Thrun, "Unsupervised Intrinsic Calibration of Depth Sensors via SLAM", RSS
    2013. The position of each pixel is shifted by a normal error of 0.25 px, rounded, and then rounded to even rows and
    columns: one of four pixels is read. Depth of 10 m or more is lost (RANGE). Depth is divided by a factor from the
    table of 80x80 cells of the image, interpolated between 1, 3, 5, 7 and 9 m; it is lost where the factor is 0
    (DROPOUT). Then a normal error of 1/36 px is added to 35.13 / depth, and the sum is rounded to 1/8 px. For images of
    other sizes than 640x480, the table is stretched.

    Habitat's code for GPUs differs: it rounds disparities to whole pixels, and clamps depth to 5 m.
    """

    distortion: str | os.PathLike[str] | ArrayInput = field(repr=False)
    """The table: ``dist-model.txt`` of the Redwood dataset, an ``.npy`` file as in Habitat, or an array (80, 80, 5) of
    factors by row, column and depth; 0 for missing factors."""
    multiplier: float = 1.0
    """Factor of the standard deviations of both errors, Habitat's ``noise_multiplier``."""

    def __post_init__(self) -> None:
        check_number(self.multiplier, "multiplier", minimum=0.0)
        object.__setattr__(self, "distortion", _read_table(self.distortion))

    def depth_sigma(self, depth: ArrayLike, camera: Camera) -> NDArray[np.float64]:
        """Return the standard deviation without the distortion of the table."""
        sigma = math.sqrt((_REDWOOD["disparity_sigma"] * self.multiplier) ** 2 + 1 / (12 * _REDWOOD["levels"] ** 2))
        return as_floats(depth, "depth") ** 2 * (sigma / _REDWOOD["disparity_scale"])

    def measure(self, exposure: Exposure) -> None:
        """Write the depth and reasons of the sensor."""
        from warpvis.kernels.sensors.redwood import RedwoodModel, measure_redwood

        model = RedwoodModel()
        model.multiplier = self.multiplier
        for name, value in _REDWOOD.items():
            setattr(model, name, value)
        table = _table_on(self, str(exposure.scene.device))
        inputs = kernel_inputs(exposure), kernel_images(exposure)
        exposure.launch(measure_redwood, model, table, *inputs, rows=RANDOM_WORDS)


@lru_cache(maxsize=16)
def _table_on(sensor: RedwoodNoise, device: str) -> wp.array:
    return wp.array(sensor.distortion, dtype=wp.float32, device=device)


def _read_table(value: object) -> NDArray[np.float32]:
    """Return the table from an array or a file."""
    if not isinstance(value, str | os.PathLike):
        return _check_table(as_numpy(value, name="distortion"), ArrayError, "distortion")
    path = as_path(value, "distortion")
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise FileFormatError(f"{path}: must be a table of 32,000 distortion factors, but is too large")
        table = read_array(path) if path.suffix.lower() == ".npy" else _read_text(path)
    except FileFormatError:
        raise
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror or 'it is not an NPY file'}") from None
    except Exception as error:  # NumPy may raise any exception
        raise FileFormatError(f"{path}: is not a table of distortion factors: {describe_exception(error)}") from None
    return _check_table(table, FileFormatError, f"{path}: the table")


def _read_text(path: Path) -> NDArray[np.float64]:
    """Read the text format of ``simdepth.py``: five header lines, then one number per line; % starts a comment."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # for empty files; the number of lines is checked below
        numbers = np.loadtxt(path, comments="%", skiprows=_HEADER_LINES, ndmin=1)
    cells = _TABLE[0] * _TABLE[1]
    if numbers.ndim != 1 or len(numbers) < _LEADING_NUMBERS + _CELL_NUMBERS * (cells - 1) + _FACTORS + _TABLE[2]:
        raise FileFormatError(
            f"{path}: must have {_LEADING_NUMBERS + _CELL_NUMBERS * cells} numbers, one per line, got {numbers.shape}"
        )
    padded = np.zeros(_LEADING_NUMBERS + _CELL_NUMBERS * cells)
    padded[: min(len(padded), len(numbers))] = numbers[: len(padded)]
    rows = padded[_LEADING_NUMBERS:].reshape(*_TABLE[:2], _CELL_NUMBERS)
    few = np.all(rows[..., : _TABLE[2]] < _MIN_SAMPLES, axis=-1, keepdims=True)
    return np.where(few, 0.0, rows[..., _FACTORS : _FACTORS + _TABLE[2]])


def _check_table(table: np.ndarray, error: type[ArrayError | FileFormatError], name: str) -> NDArray[np.float32]:
    if table.dtype.kind not in "fiu" or table.size != np.prod(_TABLE) or table.shape[:1] != _TABLE[:1]:
        raise error(f"{name} must have shape {_TABLE}, got {table.dtype} of shape {table.shape}")
    if not np.isfinite(table).all() or (np.abs(table) > 1e6).any():
        raise error(f"{name} must contain finite factors below 1e6")
    return np.ascontiguousarray(table.reshape(_TABLE), dtype=np.float32)


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
            if name != "focal_length" or self.focal_length is not None:
                check_positive(getattr(self, name), name, unit)
        if self.pattern is not None:
            object.__setattr__(self, "pattern", _check_pattern(self.pattern))

    @property
    def bytes_per_pixel(self) -> int:
        """Scratch memory per pixel [B]."""
        return 8

    def depth_sigma(self, depth: ArrayLike, camera: Camera) -> NDArray[np.float64]:
        """Return the root mean square error of both roundings and of the noise, with the bias of half a step."""
        squared = as_floats(depth, "depth") ** 2
        focal_length = require_camera(camera).fx if self.focal_length is None else self.focal_length
        fine = squared / (8 * focal_length * self.baseline)
        coarse = squared * (self.units / 35130)
        noise = coarse**2 * (self.sigma**2 + 1 / 4)
        return np.sqrt(noise + (fine**2 + coarse**2 + 1 / self.units**2) / 12)

    def measure(self, exposure: Exposure) -> None:
        """Write the depth and reasons of the sensor."""
        from warpvis.kernels.sensors.simkinect import SimKinectModel, detect_dots, fill_from_dots, shift_to_levels

        lens, device, shape = exposure.camera, exposure.scene.device, exposure.true_depth.shape
        model = SimKinectModel()
        model.disparity_scale = (lens.fx if self.focal_length is None else self.focal_length) * self.baseline
        model.shift, model.units, model.sigma = self.shift, self.units, self.sigma
        dots = _lay_out_dots(self, lens.height, lens.width, str(device), listed=device.is_cuda)
        levels, detected = (exposure.scratch(name, shape, wp.int32) for name in ("levels", "kept"))
        inputs, images = kernel_inputs(exposure), kernel_images(exposure)
        exposure.launch(shift_to_levels, model, inputs, levels, rows=RANDOM_WORDS)
        if dots.pixels is None:
            exposure.launch(detect_dots, dots.pattern, None, None, levels, detected, rows=1)
        else:
            detected.zero_()
            listed = (shape[0], 1, len(dots.pixels))
            exposure.launch(detect_dots, dots.pattern, dots.pixels, dots.windows, levels, detected, shape=listed)
        arguments = model, inputs, detected, dots.nearest, dots.near, images
        exposure.launch(fill_from_dots, *arguments, rows=RANDOM_WORDS)


@dataclass(frozen=True)
class _Dots:
    """A pattern on a device and, if dots are listed, which is faster on a GPU, where they are."""

    pattern: wp.array
    nearest: wp.array
    """Offsets (column, row) to the pixels that a dot may fill, by increasing distance."""
    pixels: wp.array | None = None
    """Row-major pixels of dots that may be detected."""
    windows: wp.array | None = None
    """Bits of the dots in the window of each: three rows of pixels in each of three words."""
    near: wp.array | None = None
    """Bits of the offsets of `nearest` at which a pixel has a dot, ``(H, W)``."""


@lru_cache(maxsize=16)
def _lay_out_dots(sensor: SimKinect, height: int, width: int, device: str, *, listed: bool) -> _Dots:
    pattern = make_pattern(height, width) if sensor.pattern is None else sensor.pattern
    offsets = closest_first(_FILL_REACH, _FILL_REACH**2)
    on_device = wp.array(pattern, dtype=wp.uint8, device=device)
    nearest = wp.array(offsets, dtype=wp.vec2i, device=device)
    if not listed:
        return _Dots(on_device, nearest)
    pixels, windows, near = _list_dots(pattern, offsets, height, width)
    return _Dots(
        on_device,
        nearest,
        wp.array(pixels, dtype=wp.int32, device=device),
        wp.array(windows, dtype=wp.vec3ui, device=device),
        wp.array(near, dtype=wp.uint32, device=device),
    )


def _list_dots(
    pattern: NDArray[np.uint8], offsets: NDArray[np.int32], height: int, width: int
) -> tuple[NDArray[np.int32], NDArray[np.uint32], NDArray[np.uint32]]:
    """Return the arrays of `_Dots`."""
    reach = _DOT_REACH
    rows, columns = min(height, len(pattern)), min(width, pattern.shape[1])
    is_dot = np.zeros((height, width), dtype=bool)  # with a whole window
    inner = np.s_[reach : max(rows - reach - 1, reach), reach : max(columns - reach - 1, reach)]
    is_dot[inner] = pattern[inner] > 0
    y, x = np.nonzero(is_dot)
    side = np.arange(-reach, reach + 1)
    lit = pattern[y[:, None, None] + side[:, None], x[:, None, None] + side] > 0
    bits = np.left_shift(np.uint32(1), np.arange(27, dtype=np.uint32))
    windows = (lit.reshape(-1, 3, 27) * bits).sum(axis=-1, dtype=np.uint32)
    padded = np.pad(is_dot, _FILL_REACH)
    near = np.zeros((height, width), dtype=np.uint32)
    for bit, (column, row) in enumerate(offsets + _FILL_REACH):
        near |= padded[row : row + height, column : column + width].astype(np.uint32) << np.uint32(bit)
    return (y * width + x).astype(np.int32), windows, near


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
