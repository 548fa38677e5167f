# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras from Kalibr's camera chains.

Format: https://github.com/ethz-asl/kalibr/wiki/yaml-formats
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from warpvis.cameras import ImageCamera
from warpvis.cameras.lenses import lens_from_kalibr
from warpvis.io._files import as_numbers, shorten
from warpvis.io.cameras._making import choose, make_camera


def is_kalibr(data: Mapping[str, Any]) -> bool:
    """Return whether a file has a camera of a chain."""
    return bool(_cameras(data))


def kalibr_camera(path: Path, data: Mapping[str, Any], name: str, *, distortion: bool) -> ImageCamera:
    """Read the camera of a name such as ``cam0``, which is required if there are several."""
    cameras = _cameras(data)
    chosen = choose(path, list(cameras), name)
    place, entry = f"{path}: {chosen}", cameras[chosen]
    model = entry.get("camera_model", "pinhole")
    problem = "" if model == "pinhole" else f"camera_model {shorten(model)}"
    size = as_numbers(entry.get("resolution"), (2,), f"{place}: resolution [px]").tolist()
    return make_camera(place, size, partial(lens_from_kalibr, entry), distortion=distortion, model=problem)


def _cameras(data: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    return {str(key): value for key, value in data.items() if isinstance(value, dict) and "intrinsics" in value}
