# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Textual specs of pose generators: ``"orbit target=0,0,0.5 radius=2 height=1 count=360"``."""

from __future__ import annotations

import math
import os
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.frames import Frames
from warpvis.core.checks import check_text
from warpvis.core.poses import check_up
from warpvis.core.types import Json
from warpvis.errors import PoseError
from warpvis.io import read_points
from warpvis.pose_generators import _generators

if TYPE_CHECKING:
    from warpvis.scene import Scene

_Value = float | str | list[str] | NDArray[np.float64]
"""Type of the parsed value of a key."""


def looks_like_spec(text: str) -> bool:
    """Return whether a text is a generator's spec rather than a file name.

    It is a spec if no such file exists, and it begins with a generator's name or continues with words ``key=value``.
    """
    check_text(text, "text", PoseError)
    try:
        words = shlex.split(text)
    except ValueError:
        words = text.split()
    named = bool(words) and words[0] in _GENERATORS
    keyed = len(words) > 1 and all("=" in word for word in words[1:])
    return (named or keyed) and not os.path.exists(text)


def frames_from_spec(text: str, scene: Scene | None = None, *, up: Literal["z", "y"] | None = None) -> Frames:
    """Generate frames from a spec ``NAME key=value ...``.

    - ``orbit target=X,Y,Z radius=R height=H count=N [start=A]``
    - ``sphere target=X,Y,Z radius=R count=N [min_elevation=A] [max_elevation=A]``
    - ``grid step=S [bounds=X,Y,Z,X,Y,Z] [headings=N] [pitch=A] [look_at=X,Y,Z]``
    - ``random count=N [seed=N] [bounds=X,Y,Z,X,Y,Z] [clearance=D] [look=level|any|X,Y,Z] [exclude=NAME,NAME]``
    - ``along path=FILE count=N [look=forward|X,Y,Z]``, a file of points; see `warpvis.io.read_points`

    Lengths are in meters and angles in radians; see `warpvis.pose_generators`. By default, bounds are the scene's and
    the seed is 0. Quote values with spaces.

    Args:
        text: The spec.
        scene: The scene, for its bounds and surfaces.
        up: The world's vertical axis; the scene's by default, else ``"z"``.

    Returns:
        The frames, at 0, 1, 2, ... seconds; their `source` contains the generator and its arguments.

    Raises:
        PoseError: If there is no such generator, or a key is unknown, missing, duplicate or invalid.
    """
    check_text(text, "text", PoseError)
    if scene is not None:
        from warpvis.scene import require_scene

        require_scene(scene)
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise PoseError(f"the spec {text!r} cannot be parsed: {error}") from None
    name = words[0] if words else ""
    if name not in _GENERATORS:
        raise PoseError(f"a pose spec must begin with one of {', '.join(_GENERATORS)}, got {name!r}")
    generator = _GENERATORS[name]
    values = _parse_keys(name, generator, words[1:])
    upright = up if up is not None else scene.up if scene is not None else "z"
    check_up(upright)
    if name in ("grid", "random") and "bounds" not in values:
        if scene is None:
            raise PoseError(f"{name} needs bounds=, or a scene")
        values["bounds"] = np.asarray(scene.bounds, dtype=np.float64)
    if name == "random":
        values.setdefault("seed", 0)
    source: dict[str, Json] = {"generator": name, "up": upright}
    source |= {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in values.items()}
    arguments: dict[str, object] = {**values, "up": upright}
    path = values.get("path")
    if isinstance(path, str):
        arguments["path"], source["path"] = read_points(path), Path(path).name
    if name == "random":
        arguments["scene_or_bounds"] = arguments.pop("bounds") if scene is None else scene
    make = getattr(_generators, "random_poses" if name == "random" else name)
    return Frames.from_poses(make(**arguments), source=source)


class _Generator(NamedTuple):
    """Keys of a generator, which are arguments of its function."""

    required: str
    optional: str
    looks: tuple[str, ...] = ()
    """Words that are values of ``look``."""


def _parse_keys(name: str, generator: _Generator, words: list[str]) -> dict[str, _Value]:
    required = generator.required.split()
    known = [*required, *generator.optional.split()]
    keys = ", ".join(key if key in required else f"[{key}]" for key in known)
    values: dict[str, _Value] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or key not in known:
            raise PoseError(f"{name} has no {key!r}; its keys are {keys}, each as key=value")
        if key in values:
            raise PoseError(f"{key} of {name} must be given once, got it twice")
        try:
            values[key] = _look(value, generator.looks) if key == "look" else _PARSERS[key](value)
        except ValueError as error:
            raise PoseError(f"{key} of {name} must be {error}, got {value!r}") from None
    missing = [key for key in required if key not in values]
    if missing:
        raise PoseError(f"{name} needs {', '.join(missing)}; its keys are {keys}")
    return values


def _number(text: str) -> float:
    return _numbers(text, 1, "a finite number")[0]


def _whole(text: str) -> int:
    if not text.removeprefix("-").isdecimal() or len(text) > 18:
        raise ValueError("a whole number")
    return int(text)


def _place(text: str) -> NDArray[np.float64]:
    return np.array(_numbers(text, 3, "three finite numbers X,Y,Z"))


def _box(text: str) -> NDArray[np.float64]:
    expected = "six finite numbers, the lower and upper corner, X,Y,Z,X,Y,Z"
    return np.array(_numbers(text, 6, expected)).reshape(2, 3)


def _look(text: str, words: tuple[str, ...]) -> str | NDArray[np.float64]:
    expected = f"{' or '.join(words)} or three finite numbers X,Y,Z"
    return text if text in words else np.array(_numbers(text, 3, expected))


def _numbers(text: str, count: int, expected: str) -> list[float]:
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise ValueError(expected)
    return values


_NUMBERS = ("radius", "height", "start", "min_elevation", "max_elevation", "step", "pitch", "clearance")
_PARSERS: dict[str, Callable[[str], _Value]] = {
    **dict.fromkeys(_NUMBERS, _number),
    **dict.fromkeys(("count", "headings", "seed"), _whole),
    **dict.fromkeys(("target", "look_at"), _place),
    "bounds": _box,
    "path": str,
    "exclude": lambda text: text.split(","),
}
_GENERATORS = {
    "orbit": _Generator("target radius height count", "start"),
    "sphere": _Generator("target radius count", "min_elevation max_elevation"),
    "grid": _Generator("step", "bounds headings pitch look_at"),
    "random": _Generator("count", "seed bounds clearance look exclude", ("level", "any")),
    "along": _Generator("path count", "look", ("forward",)),
}
