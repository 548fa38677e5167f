# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth cameras by their names, as the command line has them."""

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

_OF_ANY_SIZE: dict[str, Callable[[int, int], DepthSensor]] = {
    "d415": realsense_d415,
    "d435": realsense_d435,
    "d455": realsense_d455,
    "oak-d": oak_d,
    "kinect-v1": kinect_v1,
    "structure": structure,
}
_OF_ONE_SIZE: dict[str, Callable[[], DepthSensor]] = {
    "azure-kinect": azure_kinect,
    "azure-kinect-binned": lambda: azure_kinect("nfov_binned"),
    "azure-kinect-wide": lambda: azure_kinect("wfov"),
    "azure-kinect-wide-binned": lambda: azure_kinect("wfov_binned"),
    "kinect-v2": kinect_v2,
    "flexx2": pmd_flexx2,
}
SENSOR_NAMES = (*_OF_ANY_SIZE, *_OF_ONE_SIZE)
"""All names."""


def sensor_by_name(text: str) -> DepthSensor:
    """Make a depth camera that one can buy, by its name.

    Args:
        text: One of d415, d435, d455, oak-d, kinect-v1 and structure, which may have a size, ``"d435@424x240"``; of
            azure-kinect, azure-kinect-binned, azure-kinect-wide and azure-kinect-wide-binned; or of kinect-v2 and
            flexx2. ``"realsense_d435"``, the function's name, is d435.

    Raises:
        CameraError: There is none of that name, or it has no such size; names are told that are near.
    """
    name, at, size = check_text(text, "sensor", CameraError).partition("@")
    key = name.strip().lower().replace("_", "-").removeprefix("realsense-").removeprefix("pmd-")
    if key not in SENSOR_NAMES:
        words = dict.fromkeys([key, key.rsplit("-", 1)[-1]])  # what is behind a maker's name
        found = [match for word in words for match in difflib.get_close_matches(word, SENSOR_NAMES, n=3, cutoff=0.5)]
        near = list(dict.fromkeys(found))
        meant = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(SENSOR_NAMES)}"
        raise CameraError(f"there is no sensor {truncate(repr(name))}; {meant}")
    if not at:
        return _OF_ANY_SIZE[key]() if key in _OF_ANY_SIZE else _OF_ONE_SIZE[key]()  # type: ignore[call-arg]
    pixels = re.fullmatch(r"([1-9][0-9]{0,4})x([1-9][0-9]{0,4})", size, re.ASCII)
    if key not in _OF_ANY_SIZE or pixels is None:
        has = "its size is as in d435@424x240" if key in _OF_ANY_SIZE else f"{key} has one size"
        raise CameraError(f"there is no sensor {truncate(repr(text))}: {has}")
    return _OF_ANY_SIZE[key](int(pixels[1]), int(pixels[2]))
