# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Commercial depth cameras as `TimeOfFlight`, with their native cameras.

Image sizes, fields of view and ranges are from the manufacturers. Noise is as specified or measured without ambient
light; see the docstrings. Use `dataclasses.replace` to change parameters of a profile.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import check_choice
from warpvis.sensors.depth._time_of_flight import SPEED_OF_LIGHT, TimeOfFlight

# Width, height [px], horizontal and vertical field of view [deg], minimum and maximum depth [m].
_AZURE_MODES = {
    "nfov": (640, 576, 75.0, 65.0, 0.5, 3.86),
    "nfov_binned": (320, 288, 75.0, 65.0, 0.5, 5.46),
    "wfov": (1024, 1024, 120.0, 120.0, 0.25, 2.21),
    "wfov_binned": (512, 512, 120.0, 120.0, 0.25, 2.88),
}
_AZURE_SIGMA, _AZURE_DARKEST = 0.017, 0.15
_CONTRAST = 0.7
# No source: pixels with a coherence below this are treated as flying pixels.
_MIN_COHERENCE = 0.9


def azure_kinect(mode: str = "nfov") -> TimeOfFlight:
    """Return a Microsoft Azure Kinect, in a mode of its data sheet: ``"nfov"`` has 640x576 pixels and 0.5 to 3.86 m.

    At the maximum range of a mode, the standard deviation is the specified 17 mm for a surface with a reflectivity of
    15 %, the minimum of the specification, at normal incidence; it is 6.6 mm for a white surface. Tolgyessy, Dekan,
    Chovanec and Hubinsky ("Evaluation of the Azure Kinect and Its Comparison to Kinect V1 and Kinect V2", Sensors
    21(2):413, 2021) confirm the specification: at most 17 mm of random error, less than 11 mm + 0.1 % of systematic
    error. The model of the systematic error is a wiggle of 5.5 mm, because its composition is not published. The
    frequencies are not published either; the two used here are unambiguous up to 7.5 m. The native camera is a pinhole
    camera with the fields of view of the data sheet, without lens distortion; a calibrated camera may be used instead.

    Args:
        mode: ``"nfov"`` or ``"wfov"``, narrow and wide fields of view; ``"nfov_binned"`` and ``"wfov_binned"`` have
            half the width and height, and a longer range.

    Raises:
        ArrayError: If `mode` is unknown.
    """
    width, height, hfov, vfov, near, far = _AZURE_MODES[check_choice(mode, "mode", tuple(_AZURE_MODES))]
    white = _AZURE_SIGMA * math.sqrt(_AZURE_DARKEST) / far  # standard deviation at 1 m [m]
    return _profile(
        (200e6, 180e6),
        white,
        (width, height, hfov, vfov, near, far),
        min_signal=_AZURE_DARKEST / far**2 * math.cos(math.radians(80.0)),
        wiggle=0.0055,
    )


def kinect_v2() -> TimeOfFlight:
    """Return a Microsoft Kinect of 2013, for Xbox One: 512x424 pixels, 70.6 by 60 degrees, 0.5 to 4.5 m.

    The frequencies are from libfreenect2: 120, 80 and 16 MHz, unambiguous up to 18.7 m. The noise, 1.5 mm for a white
    surface at 1 m at normal incidence, has no source.
    """
    camera = (512, 424, 70.6, 60.0, 0.5, 4.5)
    return _profile((120e6, 80e6, 16e6), 0.0015, camera, min_signal=0.0015, wiggle=0.005)


def pmd_flexx2() -> TimeOfFlight:
    """Return a PMD flexx2: 224x172 pixels, 56 by 44 degrees, 0.1 to 7 m.

    Noise and frequencies have no source: 0.5 % of the range for a white surface at normal incidence, and 80 and 60 MHz,
    unambiguous up to 7.5 m.
    """
    return _profile((80e6, 60e6), 0.005, (224, 172, 56.0, 44.0, 0.1, 7.0), min_signal=0.002, wiggle=0.003)


def _profile(
    frequencies: Sequence[float],
    sigma: float,
    camera: tuple[int, int, float, float, float, float],
    *,
    min_signal: float,
    wiggle: float,
) -> TimeOfFlight:
    """Return a sensor whose standard deviation for a white surface at 1 m at normal incidence is `sigma` [m]."""
    width, height, hfov, vfov, near, far = camera
    fx, fy = (size / (2 * math.tan(math.radians(fov) / 2)) for size, fov in ((width, hfov), (height, vfov)))
    electrons = (SPEED_OF_LIGHT / (4 * math.sqrt(2) * math.pi * frequencies[0] * _CONTRAST * sigma)) ** 2
    return TimeOfFlight(
        frequencies,
        signal=electrons,
        contrast=_CONTRAST,
        wiggle=wiggle,
        min_coherence=_MIN_COHERENCE,
        min_signal=min_signal,
        native_camera=Camera(width, height, fx, fy, width / 2, height / 2, near, far),
    )
