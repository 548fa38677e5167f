# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Livox's lidars, whose pattern does not repeat from frame to frame: by a file of where they look, sample by sample."""

from __future__ import annotations

import importlib.util
import math
import os
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_path, check_number, check_whole, describe_exception, truncate
from warpvis.errors import CameraError, FileFormatError
from warpvis.sensors._rays import Rays
from warpvis.sensors.lidars._angles import directions_at

# Samples in a second, and lasers that fire in turn. HAP's samples are by its user manual, table 1.2.1; the lines of HAP
# and Mid-360 by livox_ros_driver2 (src/comm/comm.h), the rest by livox_ros_driver (lds.h); Mid-360's samples are not
# checked against Livox's words. The patterns agree: samples of one line lie close to each other.
_MODELS = {
    "mid360": (200_000, 4),
    "avia": (240_000, 6),
    "horizon": (240_000, 6),
    "tele": (240_000, 6),
    "mid40": (100_000, 1),
    "mid70": (100_000, 1),
    "HAP": (452_000, 6),
}
_HEADER = "Time/s,Azimuth/deg,Zenith/deg"


class Livox:
    """Where a Livox lidar looks, sample by sample; `frame` makes the rays of a frame of it."""

    def __init__(
        self,
        azimuth: NDArray[np.float64],
        elevation: NDArray[np.float64],
        samples_per_second: int,
        lines: int = 1,
    ) -> None:
        """Keep angles [rad] of samples, in their order, how many there are in a second, and of how many lasers."""
        self.azimuth = azimuth
        """Angles from x towards y, so to the left, of all samples [rad]."""
        self.elevation = elevation
        """Angles above the horizontal plane of all samples [rad]."""
        self.samples_per_second = samples_per_second
        """How many samples the sensor takes in a second."""
        self.lines = lines
        """How many lasers take them in turn."""

    def frame(
        self,
        index: int = 0,
        *,
        rate: float = 10.0,
        samples: int | None = None,
        near: float = 0.0,
        far: float = math.inf,
    ) -> Rays:
        """Make the rays of a frame: the samples after those of the frame before, beginning again after the last.

        Args:
            index: Number of the frame, from 0 up.
            rate: Frames in a second.
            samples: How many samples a frame has: by default those that the sensor takes in its time.
            near: Least range that it measures [m].
            far: Greatest [m].

        Returns:
            Rays of shape ``(samples,)``, x forward, y left, z up, with times from 0 up, evenly spread over the frame;
            their rings are the numbers of the lasers, Livox's ``line``.

        Raises:
            CameraError: A number is not what it has to be.
        """
        index = check_whole(index, "index", least=0, error=CameraError)
        rate = check_number(rate, "rate", error=CameraError)
        if rate <= 0:
            raise CameraError(f"rate must be more than 0 frames in a second, got {rate:g}")
        if samples is None:
            samples = max(math.floor(self.samples_per_second / rate), 1)
        samples = check_whole(samples, "samples", error=CameraError)
        if samples > len(self.azimuth):
            raise CameraError(f"a frame of {samples} samples is longer than the pattern, which has {len(self.azimuth)}")
        place = (index * samples % len(self.azimuth) + np.arange(samples)) % len(self.azimuth)
        directions = directions_at(self.azimuth[place], self.elevation[place])
        times = np.arange(samples) / (samples * rate)
        return Rays(directions, times=times, rings=place % self.lines, near=near, far=far, axes="ros_body")


def livox(model: str, file: str | os.PathLike[str] | None = None) -> Livox:
    """Read where a Livox lidar looks, as Livox's own simulation and mujoco-lidar have it.

    Args:
        model: ``"mid360"``, ``"avia"``, ``"horizon"``, ``"tele"``, ``"mid40"``, ``"mid70"`` or ``"HAP"``.
        file: Its samples: a CSV file of livox_laser_simulation (``Time/s,Azimuth/deg,Zenith/deg``), or a ``.npy`` file
            of azimuth and elevation [rad], shape ``(samples, 2)``, as the wheel of mujoco-lidar has them; by default
            that wheel's, which has to be installed then.

    Returns:
        The pattern, whose `Livox.frame` makes rays.

    Raises:
        CameraError: There is no such model, or no file and no wheel.
        FileFormatError: The file is not what it has to be.
    """
    known = {name.lower(): name for name in _MODELS}
    plain = model.lower().replace("-", "").replace("_", "") if isinstance(model, str) else ""
    if plain not in known:
        raise CameraError(f"model must be one of {', '.join(_MODELS)}, got {model!r}")
    model = known[plain]
    path = _from_wheel(model) if file is None else as_path(file, "file")
    azimuth, elevation = _read_npy(path) if path.suffix.lower() == ".npy" else _read_csv(path)
    return Livox(azimuth, elevation, *_MODELS[model])


def _from_wheel(model: str) -> Path:
    """Find the file of a model in an installed mujoco-lidar, which is not imported."""
    found = importlib.util.find_spec("mujoco_lidar")
    if found is None or not found.origin:
        raise CameraError(
            "file must be said, Livox's CSV or a .npy of angles, where mujoco-lidar, which has such files, is not "
            "installed"
        )
    return Path(found.origin).parent / "scan_mode" / f"{model}.npy"


def _read_npy(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    try:
        loaded = np.load(path, allow_pickle=False)
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror or 'it is no NPY'}") from None
    except Exception as error:  # a damaged file raises what it likes
        raise FileFormatError(f"{path}: does not read as NPY: {describe_exception(error)}") from None
    if not isinstance(loaded, np.ndarray) or loaded.ndim != 2 or loaded.shape[1] != 2 or loaded.dtype.kind != "f":
        got = f"{loaded.dtype} of {loaded.shape}" if isinstance(loaded, np.ndarray) else "an archive"
        raise FileFormatError(f"{path}: must hold azimuth and elevation, floats of shape (samples, 2), got {got}")
    azimuth, elevation = loaded.astype(np.float64).T
    return _checked(path, azimuth, elevation, math.pi / 2)


def _read_csv(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read Livox's CSV, whose zenith is 90 degrees on the horizon."""
    try:
        with path.open(encoding="utf-8-sig") as lines:
            header = lines.readline().strip()
            if [name.strip().lower() for name in header.split(",")] != _HEADER.lower().split(","):
                raise FileFormatError(f"{path}:1: must begin with the line '{_HEADER}', got {truncate(header)!r}")
            with warnings.catch_warnings(action="ignore"):  # of no lines, which are refused below
                numbers = np.loadtxt(lines, delimiter=",", ndmin=2)
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise FileFormatError(f"{path}: is not a text file of lines '{_HEADER}'") from None
    except ValueError as error:
        if isinstance(error, FileFormatError):
            raise
        raise FileFormatError(f"{path}: must hold three numbers a line: {describe_exception(error)}") from None
    if numbers.ndim != 2 or not len(numbers) or numbers.shape[1] != 3:
        raise FileFormatError(f"{path}: must hold lines of three numbers, '{_HEADER}', got {numbers.shape}")
    return _checked(path, np.radians(numbers[:, 1]), np.radians(90.0 - numbers[:, 2]), math.pi / 2)


def _checked(
    path: Path, azimuth: NDArray[np.float64], elevation: NDArray[np.float64], most: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if not len(azimuth) or not (np.isfinite(azimuth) & (np.abs(elevation) <= most + 1e-6)).all():
        raise FileFormatError(f"{path}: must hold finite angles, elevations between -90 and 90 degrees, and any at all")
    return azimuth, elevation
