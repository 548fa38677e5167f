# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth cameras of which no two are quite the same: parameters that are drawn for every view, from ranges."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, Literal, cast

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.camera import Camera
from warpvis.core.checks import as_items, check_choice, check_whole, describe_exception, is_number, is_whole, truncate
from warpvis.core.kernel_cache import launch
from warpvis.errors import ArrayError, WarpvisError
from warpvis.kernels.constants import STREAM_PARAMETERS
from warpvis.rendering import DepthSensor, Exposure, check_word
from warpvis.scene import Scene

Per = Literal["view", "image"]

_MAX_RANGES = 8  # of which all corners are tried
_SAID = 9  # bytes of a pixel's true depth, depth and reason


@dataclass(frozen=True)
class Randomized(DepthSensor):
    """A sensor of which every view has one of its own, with parameters between limits: for domain randomisation.

    A parameter is drawn evenly between its limits, or where the sensor has a whole number there, from the whole numbers
    up to and including both. It follows from the renderer's seed, the view's number, the parameter's name, and with
    ``per="image"`` the frame; neither from how views are split, nor from which other parameters have ranges.

    With ``kinds=16``, sensors 0 to 15 are drawn so, and of each view, one of these.
    """

    of: DepthSensor
    """The sensor, which has the other parameters."""
    ranges: Mapping[str, tuple[float, float]]
    """The least and the greatest value of parameters, by their names."""
    per: Per = "view"
    """``"view"``: a view's sensor is the same in all frames, as a device is; ``"image"``: it is another in each."""
    kinds: int | None = None
    """How many sensors there are, of which each view has one: those of many views are modelled together, which is
    faster than one by one. By default every view has one of its own."""

    def __post_init__(self) -> None:
        if not isinstance(self.of, DepthSensor) or not is_dataclass(self.of):
            raise ArrayError(f"of must be a model of warpvis.sensors, such as StereoDepth, got {self.of!r}")
        check_choice(self.per, "per", ("view", "image"))
        if self.kinds is not None:
            object.__setattr__(self, "kinds", check_whole(self.kinds, "kinds"))
            check_word(self.kinds, "kinds")
        if not isinstance(self.ranges, Mapping) or not 1 <= len(self.ranges) <= _MAX_RANGES:
            raise ArrayError(f"ranges must be of 1 to {_MAX_RANGES} parameters, got {truncate(repr(self.ranges))}")
        limits = {name: self._check_range(name, given) for name, given in self.ranges.items()}
        object.__setattr__(self, "ranges", limits)
        self._corners  # noqa: B018 - which are all tried

    def _check_range(self, name: object, given: object) -> tuple[float, float]:
        """Return a range's limits, of the type that the parameter has."""
        kind = type(self.of).__name__
        known = {field.name: field.type for field in fields(cast(Any, self.of))}
        if name not in known:
            raise ArrayError(f"{kind} has no parameter {truncate(repr(name))}; it has {', '.join(known)}")
        value, limits = getattr(self.of, str(name)), [] if is_number(given) else as_items(given, str(name))
        whole = is_whole(value) and "float" not in str(known[str(name)]) and not isinstance(value, bool)
        if not is_number(value) and not (value is None and "float" in str(known[str(name)])):
            raise ArrayError(f"{name} of {kind} is no number, and cannot have a range")
        fits = is_whole if whole else is_number
        if len(limits) != 2 or not all(fits(limit) and np.isfinite(limit) for limit in limits):
            wanted = "whole numbers" if whole else "numbers"
            raise ArrayError(f"{name} must be two {wanted}, the least and the greatest, got {truncate(repr(given))}")
        least, greatest = (int(limit) if whole else float(limit) for limit in limits)
        if least > greatest:
            raise ArrayError(f"{name} must be from a number to one no less, got {least:g} and {greatest:g}")
        return least, greatest

    @cached_property
    def _corners(self) -> list[DepthSensor]:
        """The sensors of all limits.

        Raises:
            WarpvisError: One is no sensor.
        """
        return [self._with(values) for values in product(*self.ranges.values())]

    def _with(self, values: Iterable[float]) -> DepthSensor:
        pairs = zip(self.ranges.items(), values, strict=True)
        given = {name: type(least)(value) for (name, (least, _)), value in pairs}
        try:
            return cast(DepthSensor, replace(cast(Any, self.of), **given))
        except WarpvisError as error:
            said = ", ".join(f"{name} {value:g}" for name, value in given.items())
            raise ArrayError(f"ranges have {said}: {describe_exception(error)}") from None

    def camera(self) -> Camera:
        """Return the camera of the sensor.

        Raises:
            CameraError: It was made without one.
        """
        return self.of.camera()

    @property
    def needs(self) -> tuple[Literal["normals", "segmentation"], ...]:
        """Which images of the first surface are read, by any view's sensor."""
        asked = {name for corner in self._corners for name in corner.needs}
        known: tuple[Literal["normals", "segmentation"], ...] = ("normals", "segmentation")
        return tuple(name for name in known if name in asked)

    @property
    def bytes_per_pixel(self) -> int:
        """How much room a pixel takes, at most: views of one sensor that are apart are copied, and what it says."""
        read = {"normals": 12, "segmentation": 4}
        copied = _SAID + sum(read[name] for name in self.needs)
        return copied + max(corner.bytes_per_pixel for corner in self._corners)

    def check(self, scene: Scene, camera: object) -> Camera:
        """Return the camera, if all sensors are models of it in a scene.

        Raises:
            WarpvisError: One is not.
        """
        pinholes = [corner.check(scene, camera) for corner in self._corners]
        return pinholes[0]

    def drawn(self, *, seed: int = 0, view_index: int = 0, frame: int = 0) -> DepthSensor:
        """Return the sensor of a view.

        Args:
            seed: As for `warpvis.Renderer`.
            view_index: The view's number, as for `warpvis.Renderer.render`; of world w and camera c of C in a
                `warpvis.mujoco.BatchRenderer` it is w C + c.
            frame: The frame, which counts with ``per="image"``.

        Raises:
            ArrayError: They are no whole numbers from 0 up and below 2^32.
        """
        numbers = [[check_word(view_index, "view_index"), check_word(frame, "frame")]]
        values = self._draw(np.array(numbers, dtype=np.uint32), check_word(seed, "seed"))
        return self._with(values[0])

    def _draw(self, numbers: NDArray[np.uint32], seed: int) -> NDArray[np.float64]:
        """Draw the parameters of views by their numbers and frames, ``(V, 2)``, in the order of the ranges."""
        keys = np.array(numbers)
        if self.per == "view":
            keys[:, 1] = 0
        if self.kinds is not None:
            kinds = _between(0, self.kinds - 1, self._uniforms(keys, seed, ["kinds"])[:, 0])
            keys = np.stack([kinds, np.zeros_like(kinds)], axis=1).astype(np.uint32)
        uniforms = self._uniforms(keys, seed, list(self.ranges))
        columns = [_between(*limits, part) for limits, part in zip(self.ranges.values(), uniforms.T, strict=True)]
        return np.stack(columns, axis=1)

    def _uniforms(self, keys: NDArray[np.uint32], seed: int, names: list[str]) -> NDArray[np.float32]:
        """Draw a number between 0 and 1 for each view and name: what else is drawn does not change it."""
        from warpvis.kernels.random_numbers import draw_uniforms

        host, model = wp.get_device("cpu"), type(self.of).__name__
        draws = wp.array(keys, dtype=wp.vec2ui, device=host)
        places = wp.array([(_word_of(model), _word_of(name)) for name in names], dtype=wp.vec2i, device=host)
        uniforms = wp.empty((len(keys), len(names)), dtype=wp.float32, device=host)
        inputs = [draws, places, wp.uint32(seed), wp.uint32(STREAM_PARAMETERS), uniforms]
        launch(draw_uniforms, uniforms.shape, inputs, host)
        return uniforms.numpy()

    def measure(self, exposure: Exposure) -> None:
        """Write the sensors' depth and reasons, of all views that have the same one together."""
        rows = self._draw(exposure.numbers, exposure.seed)
        different, sensor_of_view, counts = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
        order = np.argsort(sensor_of_view.ravel(), kind="stable")
        for values, views in zip(different, np.split(order, np.cumsum(counts)[:-1]), strict=True):
            exposure.measure_some(views, self._with(values))


def randomized(
    sensor: DepthSensor, *, per: Per = "view", kinds: int | None = None, **ranges: tuple[float, float]
) -> Randomized:
    """Make a sensor of which every view has one of its own, with parameters between limits.

    Args:
        sensor: A model of a depth camera, such as `realsense_d435()`.
        per: ``"view"``: a view's sensor is the same in all frames, as a device is; ``"image"``: another in each.
        kinds: How many sensors there are, of which each view has one; by default every view has one of its own.
        ranges: Limits of parameters by their names, the least and the greatest: ``baseline=(0.049, 0.051)``.

    Raises:
        ArrayError: The sensor has no such parameter, or it cannot have these values.
    """
    return Randomized(sensor, ranges, per, kinds)


def _between(least: float, greatest: float, uniforms: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return numbers between limits, whole ones between whole ones."""
    parts = uniforms.astype(np.float64)
    if isinstance(least, int) and isinstance(greatest, int):
        return least + np.floor(parts * (greatest - least + 1))
    return least + (greatest - least) * parts


def _word_of(name: str) -> int:
    """Return a number of 31 bits for a name, the same in every process."""
    return zlib.crc32(name.encode()) >> 1
