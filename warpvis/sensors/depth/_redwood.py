# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Noise model of the Kinect from the simulator of the Redwood dataset, as in Habitat, with a distortion table."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import as_path, check_number, describe_exception
from warpvis.core.threads import launch_images
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError, FileFormatError
from warpvis.kernels.constants import STREAM_ACROSS, STREAM_DISPARITY, STREAM_DOWN
from warpvis.rendering import DepthSensor, Exposure
from warpvis.sensors.depth._by_value import ByValue
from warpvis.sensors.depth._normal_images import draw_normal_image

_TABLE = (80, 80, 5)
# The distortion file: number of header lines, of numbers before the first cell, and of numbers per cell; offset of the
# five factors in a cell; minimum count of samples: cells with fewer samples in all five bins have no factors.
_HEADER_LINES, _LEADING_NUMBERS, _CELL_NUMBERS, _FACTORS, _MIN_SAMPLES = 5, 3, 23, 15, 8000
_MAX_BYTES = 2**28


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

    @property
    def bytes_per_pixel(self) -> int:
        """Scratch memory per pixel [B]."""
        return 12

    def measure(self, exposure: Exposure) -> None:
        """Write the depth and reasons of the sensor."""
        from warpvis.kernels.redwood import RedwoodModel, measure_redwood

        model, camera, device = RedwoodModel(), exposure.camera.device_struct(), exposure.scene.device
        model.multiplier = self.multiplier
        table = wp.array(self.distortion, dtype=wp.float32, device=device)
        streams = {"across": STREAM_ACROSS, "down": STREAM_DOWN, "disparity": STREAM_DISPARITY}
        normals = [draw_normal_image(exposure, stream, name) for name, stream in streams.items()]
        inputs = [model, table, exposure.true_depth, *normals, exposure.depth_out, exposure.reasons_out]
        launch_images(
            measure_redwood,
            exposure.depth_out.shape,
            lambda window: [camera, window, *inputs],
            device=device,
            threads=exposure.threads,
        )


def _read_table(value: object) -> NDArray[np.float32]:
    """Return the table from an array or a file.

    Raises:
        WarpvisError: If it is invalid.
    """
    if not isinstance(value, str | os.PathLike):
        return _check_table(as_numpy(value, name="distortion"), ArrayError, "distortion")
    path = as_path(value, "distortion")
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise FileFormatError(f"{path}: must be a table of 32,000 distortion factors, but is too large")
        table = np.load(path, allow_pickle=False) if path.suffix.lower() == ".npy" else _read_text(path)
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
