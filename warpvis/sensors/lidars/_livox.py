# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Livox lidars, whose scan pattern does not repeat from frame to frame, from files with the angles of all samples."""

from __future__ import annotations

import importlib.util
import math
import os
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.rays import Rays
from warpvis.core.checks import as_path, check_whole, describe_exception, truncate
from warpvis.core.numpy_files import read_array
from warpvis.errors import CameraError, FileFormatError
from warpvis.sensors.lidars._plain import check_positive, directions_at

# Samples per second, number of lasers, which fire in turn, and minimum and maximum range [m]. Sources: HAP user manual,
# table 1.2.1 (samples and range of HAP, at 10 % reflectivity); livoxtech.com's specification of the Mid-360, as in
# ku-gcl/lidar_sim_pkg (samples and range, at 80 %); livox_ros_driver2, src/comm/comm.h (lines of HAP and Mid-360);
# livox_ros_driver, lds.h (the rest). Ranges of the others have not been found. The patterns agree with the number of
# lines: consecutive samples of one line are close to each other.
_MODELS: dict[str, tuple[int, int, float, float]] = {
    "mid360": (200_000, 4, 0.1, 70.0),
    "avia": (240_000, 6, 0.0, math.inf),
    "horizon": (240_000, 6, 0.0, math.inf),
    "tele": (240_000, 6, 0.0, math.inf),
    "mid40": (100_000, 1, 0.0, math.inf),
    "mid70": (100_000, 1, 0.0, math.inf),
    "HAP": (452_000, 6, 0.5, 150.0),
}
_HEADER = "Time/s,Azimuth/deg,Zenith/deg"


@dataclass(eq=False, repr=False)
class Livox:
    """The scan pattern of a Livox lidar, with samples in scan order; `frame` returns the rays of a frame."""

    azimuth: NDArray[np.float64]
    """Angles of all samples from x toward y, that is to the left [rad]."""
    elevation: NDArray[np.float64]
    """Angles of all samples above the horizontal plane [rad]."""
    samples_per_second: int
    """Number of samples per second."""
    lines: int = 1
    """Number of lasers, which take samples in turn."""
    near: float = 0.0
    """Minimum range of the device [m]."""
    far: float = math.inf
    """Maximum range of the device [m]."""

    def frame(
        self,
        index: int = 0,
        *,
        rate: float = 10.0,
        samples: int | None = None,
        near: float | None = None,
        far: float | None = None,
    ) -> Rays:
        """Return the rays of a frame: the samples that follow those of the previous frame, cyclically.

        Args:
            index: Number of the frame, starting at 0.
            rate: Frames per second.
            samples: Number of samples per frame; by default ``samples_per_second / rate``, rounded down.
            near: Minimum measured range [m]; by default that of the device.
            far: Maximum measured range [m]; by default that of the device.

        Returns:
            Rays of shape ``(samples,)``, x forward, y left, z up, with times evenly spread over the frame. Rings are
            the laser numbers, Livox's ``line``.
        """
        index = check_whole(index, "index", minimum=0, error=CameraError)
        rate = check_positive(rate, "rate", "Hz")
        if samples is None:
            samples = max(math.floor(self.samples_per_second / rate), 1)
        samples = check_whole(samples, "samples", error=CameraError)
        if samples > len(self.azimuth):
            raise CameraError(f"samples must be at most the {len(self.azimuth)} samples of the pattern, got {samples}")
        indices = (index * samples % len(self.azimuth) + np.arange(samples)) % len(self.azimuth)
        directions = directions_at(self.azimuth[indices], self.elevation[indices])
        times = np.arange(samples) / (samples * rate)
        near, far = self.near if near is None else near, self.far if far is None else far
        return Rays(directions, times=times, rings=indices % self.lines, near=near, far=far, axes="ros_body")


def livox(model: str, path: str | os.PathLike[str] | None = None) -> Livox:
    """Read the scan pattern of a Livox lidar from a file of livox_laser_simulation or mujoco-lidar.

    Args:
        model: ``"mid360"``, ``"avia"``, ``"horizon"``, ``"tele"``, ``"mid40"``, ``"mid70"`` or ``"HAP"``.
        path: A CSV file of livox_laser_simulation (``Time/s,Azimuth/deg,Zenith/deg``), or a ``.npy`` file of azimuth
            and elevation [rad], shape ``(samples, 2)``, as in the wheel of mujoco-lidar. By default the file of that
            wheel, which must be installed then.

    Returns:
        The pattern; `Livox.frame` returns the rays of a frame. A Mid-360 measures 0.1 to 70 m and a HAP 0.5 to 150 m;
        the range of the others is not limited.

    Raises:
        CameraError: If `model` is unknown, or if no file is given and mujoco-lidar is not installed.
        FileFormatError: If the file is invalid.
    """
    known = {name.lower(): name for name in _MODELS}
    plain = model.lower().replace("-", "").replace("_", "") if isinstance(model, str) else ""
    if plain not in known:
        raise CameraError(f"model must be one of {', '.join(_MODELS)}, got {model!r}")
    model = known[plain]
    file = _from_wheel(model) if path is None else as_path(path, "path")
    azimuth, elevation = _read_npy(file) if file.suffix.lower() == ".npy" else _read_csv(file)
    return Livox(azimuth, elevation, *_MODELS[model])


def _from_wheel(model: str) -> Path:
    """Return the path of a model's file in the installed mujoco-lidar, without importing it."""
    found = importlib.util.find_spec("mujoco_lidar")
    if found is None or not found.origin:
        raise CameraError(
            "path must be given, Livox's CSV or a .npy file of angles, because mujoco-lidar, which has such files, "
            "is not installed"
        )
    return Path(found.origin).parent / "scan_mode" / f"{model}.npy"


def _read_npy(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    loaded = read_array(path)
    if loaded.ndim != 2 or loaded.shape[1] != 2 or loaded.dtype.kind != "f":
        raise FileFormatError(
            f"{path}: must contain azimuth and elevation, floats of shape (samples, 2), got {loaded.dtype} of "
            f"{loaded.shape}"
        )
    azimuth, elevation = loaded.astype(np.float64).T
    return _check_angles(path, azimuth, elevation)


def _read_csv(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read Livox's CSV. Its zenith angle is 90 degrees at the horizon."""
    try:
        with path.open(encoding="utf-8-sig") as lines:
            header = lines.readline().strip()
            if [name.strip().lower() for name in header.split(",")] != _HEADER.lower().split(","):
                raise FileFormatError(f"{path}:1: must begin with the line '{_HEADER}', got {truncate(header)!r}")
            with warnings.catch_warnings(action="ignore"):  # for an empty file, which is rejected below
                numbers = np.loadtxt(lines, delimiter=",", ndmin=2)
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise FileFormatError(f"{path}: is not a text file of lines '{_HEADER}'") from None
    except ValueError as error:
        if isinstance(error, FileFormatError):
            raise
        raise FileFormatError(f"{path}: must contain three numbers per line: {describe_exception(error)}") from None
    if numbers.ndim != 2 or not len(numbers) or numbers.shape[1] != 3:
        raise FileFormatError(f"{path}: must contain lines of three numbers, '{_HEADER}', got shape {numbers.shape}")
    return _check_angles(path, np.radians(numbers[:, 1]), np.radians(90.0 - numbers[:, 2]))


def _check_angles(
    path: Path, azimuth: NDArray[np.float64], elevation: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if not len(azimuth) or not (np.isfinite(azimuth) & (np.abs(elevation) <= math.pi / 2 + 1e-6)).all():
        raise FileFormatError(f"{path}: must contain finite angles, with elevations from -90 to 90 degrees")
    return azimuth, elevation
