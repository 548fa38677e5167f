# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lidars of ``warpvis render``: their names, noise, and revolutions."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from warpvis.cli._inputs import split_pairs
from warpvis.errors import ArrayError, CameraError, PoseError

if TYPE_CHECKING:
    from warpvis.cameras import Rays
    from warpvis.cameras.frames import Frames
    from warpvis.sensors import LidarNoise
    from warpvis.sensors.lidars import Livox


def find_lidar(name: str) -> Rays | Livox:
    """Return a lidar by name, Ouster metadata file, or Livox name with its file, ``mid360:FILE``."""
    from warpvis.sensors import lidars

    spinning: dict[str, Callable[[], Rays]] = {
        "vlp16": lidars.vlp16,
        "vlp32c": lidars.vlp32c,
        "hdl32e": lidars.hdl32e,
        "hdl64e": lidars.hdl64e,
        "vls128": lidars.vls128,
        "pandar64": lidars.pandar64,
        "xt32": lidars.xt32,
        "qt128": lidars.qt128,
        "at128": lidars.at128,
        "bpearl": lidars.bpearl,
    }
    plain = name.lower().replace("-", "")
    if plain in spinning:
        return spinning[plain]()
    model, mode = (name.partition("@")[0], name.partition("@")[2] or None)
    try:
        if plain.startswith("rplidar"):
            return lidars.rplidar(plain.removeprefix("rplidar"))
        if model.lower().endswith(".json") or plain.startswith("os"):
            return lidars.ouster(model, mode)
    except CameraError as error:  # which names the parameter of a function
        raise CameraError(re.sub(r"^(sensor|model) must be", "lidar must be", str(error))) from None
    livox, _, file = name.partition(":")
    if livox.lower().replace("-", "") in ("mid360", "avia", "horizon", "tele", "mid40", "mid70", "hap"):
        return lidars.livox(livox, file or None)
    raise CameraError(
        f"--lidar must be {', '.join(spinning)}, rplidar-a2, os1-128 or the metadata of an Ouster (with @1024x10 for a "
        f"mode), or mid360:FILE, got {name!r}"
    )


def parse_noise(words: Sequence[str]) -> LidarNoise | None:
    """Create the noise of a lidar from ``name=number``; None without words."""
    from warpvis.sensors import LidarNoise

    if not words:
        return None
    known = [name for name, value in vars(LidarNoise()).items() if value is not None]
    parameters: dict[str, Any] = {}
    for word in split_pairs(words):
        name, _, value = word.partition("=")
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if name not in known or name in parameters or math.isnan(number):
            raise ArrayError(f"--lidar-noise takes each NAME=NUMBER once, of {', '.join(known)}, got {word!r}")
        parameters[name] = number
    return LidarNoise(**parameters)


def choose_turns(frames: Frames, lidar: Rays | Livox) -> Frames:
    """Return the frames from which a whole revolution ends before the last pose."""
    import numpy as np

    from warpvis.cameras import Rays

    rays = lidar if isinstance(lidar, Rays) else lidar.frame(0)
    if rays.times is None:
        raise CameraError(f"--moving requires a lidar whose rays have times, and {type(rays).__name__} have none")
    if not (np.diff(frames.timestamps) > 0).all():
        raise PoseError("--moving requires timestamps that increase from pose to pose")
    lasts, known = float(rays.times.max()), float(frames.timestamps[-1] - frames.timestamps[0])
    if known < lasts:
        raise PoseError(f"--moving requires poses for a revolution of the lidar, {lasts:.6g} s, got {known:.6g} s")
    return frames[: int(np.searchsorted(frames.timestamps, frames.timestamps[-1] - lasts, side="right"))]
