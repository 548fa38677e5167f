# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Names of depth cameras, as on the command line."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable

from warpvis.core.checks import check_text, truncate
from warpvis.errors import CameraError
from warpvis.rendering import DepthSensor
from warpvis.sensors.depth._profiles import (
    kinect_v1,
    oak_d,
    realsense_d415,
    realsense_d435,
    realsense_d455,
    structure,
)
from warpvis.sensors.depth._time_of_flight_profiles import azure_kinect, kinect_v2, pmd_flexx2

_VARIABLE_SIZE: dict[str, Callable[[int, int], DepthSensor]] = {
    "d415": realsense_d415,
    "d435": realsense_d435,
    "d455": realsense_d455,
    "oak-d": oak_d,
    "kinect-v1": kinect_v1,
    "structure": structure,
}
_FIXED_SIZE: dict[str, Callable[[], DepthSensor]] = {
    "azure-kinect": azure_kinect,
    "azure-kinect-binned": lambda: azure_kinect("nfov_binned"),
    "azure-kinect-wide": lambda: azure_kinect("wfov"),
    "azure-kinect-wide-binned": lambda: azure_kinect("wfov_binned"),
    "kinect-v2": kinect_v2,
    "flexx2": pmd_flexx2,
}
SENSOR_NAMES = (*_VARIABLE_SIZE, *_FIXED_SIZE)
"""Names of all depth cameras."""


def sensor_by_name(text: str) -> DepthSensor:
    """Create the model of a commercial depth camera from its name.

    Args:
        text: d415, d435, d455, oak-d, kinect-v1 or structure, optionally with a size, ``"d435@424x240"``; azure-kinect,
            azure-kinect-binned, azure-kinect-wide or azure-kinect-wide-binned; kinect-v2 or flexx2. Names of functions
            such as ``"realsense_d435"`` are accepted as well.

    Raises:
        CameraError: If the name is unknown, or if the camera does not have this size. The message suggests similar
            names.
    """
    name, separator, size = check_text(text, "sensor", CameraError).partition("@")
    key = name.strip().lower().replace("_", "-").removeprefix("realsense-").removeprefix("pmd-")
    if key not in SENSOR_NAMES:
        words = dict.fromkeys([key, key.rsplit("-", 1)[-1]])  # also without the manufacturer's name
        matches = [match for word in words for match in difflib.get_close_matches(word, SENSOR_NAMES, n=3, cutoff=0.5)]
        similar = list(dict.fromkeys(matches))
        hint = f"did you mean {' or '.join(similar)}?" if similar else f"there are {', '.join(SENSOR_NAMES)}"
        raise CameraError(f"there is no sensor {truncate(repr(name))}; {hint}")
    if not separator:
        return _VARIABLE_SIZE[key]() if key in _VARIABLE_SIZE else _FIXED_SIZE[key]()  # type: ignore[call-arg]
    pixels = re.fullmatch(r"([1-9][0-9]{0,4})x([1-9][0-9]{0,4})", size, re.ASCII)
    if key not in _VARIABLE_SIZE or pixels is None:
        hint = "a size must be given as in d435@424x240" if key in _VARIABLE_SIZE else f"{key} has a fixed size"
        raise CameraError(f"there is no sensor {truncate(repr(text))}: {hint}")
    return _VARIABLE_SIZE[key](int(pixels[1]), int(pixels[2]))
