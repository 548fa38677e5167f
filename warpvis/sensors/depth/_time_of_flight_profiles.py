# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth cameras that one can buy, as `TimeOfFlight` with the camera that each has.

Image sizes, fields of view and ranges are the makers'. Noise is set so that it is what is specified or was measured, as
each docstring says, with no other light; `dataclasses.replace` gives a profile other numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from warpvis.core.camera import Camera
from warpvis.core.checks import check_choice
from warpvis.sensors.depth._time_of_flight import SPEED_OF_LIGHT, TimeOfFlight

# Width, height [px], horizontal and vertical field of view [deg], least and greatest depth [m].
_AZURE_MODES = {
    "nfov": (640, 576, 75.0, 65.0, 0.5, 3.86),
    "nfov_binned": (320, 288, 75.0, 65.0, 0.5, 5.46),
    "wfov": (1024, 1024, 120.0, 120.0, 0.25, 2.21),
    "wfov_binned": (512, 512, 120.0, 120.0, 0.25, 2.88),
}
_AZURE_SIGMA, _AZURE_DARKEST = 0.017, 0.15
_CONTRAST = 0.7
# No source: pixels whose light is of one phase to less than this are taken for flying ones.
_MIN_COHERENCE = 0.9


def azure_kinect(mode: str = "nfov") -> TimeOfFlight:
    """Make a Microsoft Azure Kinect, in a mode of its data sheet: ``"nfov"`` has 640x576 pixels and 0.5 to 3.86 m.

    Where a mode ends, the standard deviation is the 17 mm that the maker specifies, of a surface that returns 15 % of
    the light, as dark as the specification goes, and is seen straight; a white one's is 6.6 mm there. Tolgyessy, Dekan,
    Chovanec and Hubinsky ("Evaluation of the Azure Kinect and Its Comparison to Kinect V1 and Kinect V2", Sensors
    21(2):413, 2021) confirm the specification: at most 17 mm of random error, less than 11 mm + 0.1 % of systematic
    error. Of the latter the model has wiggling of 5.5 mm; no source says what it is made of. Frequencies are not
    published: two are taken that are unambiguous up to 7.5 m. Pixels are those of a pinhole with the data sheet's
    fields of view, without the lens's distortion; a calibrated camera does as well.

    Args:
        mode: ``"nfov"`` or ``"wfov"``, narrow and wide fields of view; ``"nfov_binned"`` and ``"wfov_binned"`` have
            half the width and height, and see farther.

    Raises:
        ArrayError: It is no mode.
    """
    width, height, hfov, vfov, near, far = _AZURE_MODES[check_choice(mode, "mode", tuple(_AZURE_MODES))]
    white = _AZURE_SIGMA * math.sqrt(_AZURE_DARKEST) / far  # deviation [m] at 1 m
    return _profile(
        (200e6, 180e6),
        white,
        (width, height, hfov, vfov, near, far),
        least_signal=_AZURE_DARKEST / far**2 * math.cos(math.radians(80.0)),
        wiggle=0.0055,
    )


def kinect_v2() -> TimeOfFlight:
    """Make a Microsoft Kinect of 2013, for Xbox One: 512x424 pixels, 70.6 by 60 degrees, 0.5 to 4.5 m.

    Its frequencies are those of libfreenect2, 120, 80 and 16 MHz, unambiguous up to 18.7 m. No source for noise: 1.5 mm
    at 1 m of a white surface seen straight.
    """
    camera = (512, 424, 70.6, 60.0, 0.5, 4.5)
    return _profile((120e6, 80e6, 16e6), 0.0015, camera, least_signal=0.0015, wiggle=0.005)


def pmd_flexx2() -> TimeOfFlight:
    """Make a PMD flexx2: 224x172 pixels, 56 by 44 degrees, 0.1 to 7 m.

    No source for noise and frequencies: 0.5 % of the range of a white surface seen straight, and 80 and 60 MHz,
    unambiguous up to 7.5 m.
    """
    return _profile((80e6, 60e6), 0.005, (224, 172, 56.0, 44.0, 0.1, 7.0), least_signal=0.002, wiggle=0.003)


def _profile(
    frequencies: Sequence[float],
    sigma: float,
    camera: tuple[int, int, float, float, float, float],
    *,
    least_signal: float,
    wiggle: float,
) -> TimeOfFlight:
    """Make a sensor whose deviation [m] is `sigma` where a white surface is seen straight at 1 m."""
    width, height, hfov, vfov, near, far = camera
    fx, fy = (size / (2 * math.tan(math.radians(fov) / 2)) for size, fov in ((width, hfov), (height, vfov)))
    electrons = (SPEED_OF_LIGHT / (4 * math.sqrt(2) * math.pi * frequencies[0] * _CONTRAST * sigma)) ** 2
    return TimeOfFlight(
        frequencies,
        signal=electrons,
        contrast=_CONTRAST,
        wiggle=wiggle,
        least_coherence=_MIN_COHERENCE,
        least_signal=least_signal,
        native_camera=Camera(width, height, fx, fy, width / 2, height / 2, near, far),
    )
