# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Domain randomization of depth cameras: parameters drawn from ranges for each view."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, Literal, cast

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import as_items, check_choice, check_whole, describe_exception, is_number, is_whole, truncate
from warpvis.core.kernel_cache import launch
from warpvis.errors import ArrayError, WarpvisError
from warpvis.kernels.constants import STREAM_PARAMETERS
from warpvis.rendering import DepthSensor, Exposure, check_word
from warpvis.scene import Scene

Per = Literal["view", "image"]

_MAX_RANGES = 8  # all 2^n combinations of limits are checked
_OUTPUT_BYTES = 9  # true depth, depth and reason of a pixel


@dataclass(frozen=True)
class Randomized(DepthSensor):
    """A sensor with randomized parameters for each view, for domain randomization.

    Parameters are uniformly distributed between their limits; integer parameters are uniformly distributed integers,
    including both limits. A value depends only on the seed of the renderer, the index of the view, the name of the
    parameter, and with ``per="image"`` the frame. It does not depend on the split into batches or on other parameters.

    With ``kinds=16``, 16 sensors are drawn in this way, and each view has one of them.
    """

    of: DepthSensor
    """The sensor, which defines the other parameters."""
    ranges: Mapping[str, tuple[float, float]]
    """Minimum and maximum of parameters, by their names."""
    per: Per = "view"
    """``"view"``: the sensor of a view is the same in all frames; ``"image"``: it is different in each frame."""
    kinds: int | None = None
    """Number of different sensors. Views with the same sensor are simulated together, which is faster than one by one.
    By default, the sensor of each view is different."""

    def __post_init__(self) -> None:
        if not isinstance(self.of, DepthSensor) or not is_dataclass(self.of):
            raise ArrayError(f"of must be a model of warpvis.sensors, such as StereoDepth, got {self.of!r}")
        check_choice(self.per, "per", ("view", "image"))
        if self.kinds is not None:
            object.__setattr__(self, "kinds", check_whole(self.kinds, "kinds"))
            check_word(self.kinds, "kinds")
        if not isinstance(self.ranges, Mapping) or not 1 <= len(self.ranges) <= _MAX_RANGES:
            raise ArrayError(
                f"ranges must be a mapping of 1 to {_MAX_RANGES} parameters, got {truncate(repr(self.ranges))}"
            )
        limits = {name: self._check_range(name, ends) for name, ends in self.ranges.items()}
        object.__setattr__(self, "ranges", limits)
        self._corners  # noqa: B018 - validates all of them

    def _check_range(self, name: object, ends: object) -> tuple[float, float]:
        """Check a range, and return its limits with the type of the parameter."""
        kind = type(self.of).__name__
        known = {field.name: field.type for field in fields(cast(Any, self.of))}
        if name not in known:
            raise ArrayError(f"{kind} has no parameter {truncate(repr(name))}; it has {', '.join(known)}")
        value, limits = getattr(self.of, str(name)), [] if is_number(ends) else as_items(ends, str(name))
        is_integer = is_whole(value) and "float" not in str(known[str(name)]) and not isinstance(value, bool)
        if not is_number(value) and not (value is None and "float" in str(known[str(name)])):
            raise ArrayError(f"{name} of {kind} must be a number to have a range")
        fits = is_whole if is_integer else is_number
        if len(limits) != 2 or not all(fits(limit) and np.isfinite(limit) for limit in limits):
            expected = "whole numbers" if is_integer else "numbers"
            raise ArrayError(f"{name} must be two {expected}, minimum and maximum, got {truncate(repr(ends))}")
        low, high = (int(limit) if is_integer else float(limit) for limit in limits)
        if low > high:
            raise ArrayError(f"{name} must be a minimum and a maximum, got {low:g} and {high:g}")
        return low, high

    @cached_property
    def _corners(self) -> list[DepthSensor]:
        """The sensors for all combinations of limits."""
        return [self._with(values) for values in product(*self.ranges.values())]

    def _with(self, values: Iterable[float]) -> DepthSensor:
        pairs = zip(self.ranges.items(), values, strict=True)
        parameters = {name: type(low)(value) for (name, (low, _)), value in pairs}
        try:
            return cast(DepthSensor, replace(cast(Any, self.of), **parameters))
        except WarpvisError as error:
            values_text = ", ".join(f"{name} {value:g}" for name, value in parameters.items())
            raise ArrayError(f"ranges have {values_text}: {describe_exception(error)}") from None

    def camera(self) -> Camera:
        """Return the camera of the sensor."""
        return self.of.camera()

    @property
    def needs(self) -> tuple[Literal["normals", "segmentation"], ...]:
        """Exact images that are read by the sensor of any view."""
        needed = {name for corner in self._corners for name in corner.needs}
        known: tuple[Literal["normals", "segmentation"], ...] = ("normals", "segmentation")
        return tuple(name for name in known if name in needed)

    @property
    def bytes_per_pixel(self) -> int:
        """Maximum scratch memory per pixel [B], with copies of inputs and outputs of views that are not adjacent."""
        read = {"normals": 12, "segmentation": 4}
        copied = _OUTPUT_BYTES + sum(read[name] for name in self.needs)
        return copied + max(corner.bytes_per_pixel for corner in self._corners)

    @property
    def edge_shift(self) -> int:
        """Maximum distance by which any of the sensors displaces edges [px]."""
        return max(corner.edge_shift for corner in self._corners)

    def check(self, scene: Scene, camera: object) -> Camera:
        """Return the camera if it can be used with all sensors and the scene."""
        pinholes = [corner.check(scene, camera) for corner in self._corners]
        return pinholes[0]

    def drawn(self, *, seed: int = 0, view_index: int = 0, frame: int = 0) -> DepthSensor:
        """Return the sensor of a view.

        Args:
            seed: The seed, as in `warpvis.Renderer`.
            view_index: Index of the view, as in `warpvis.Renderer.render`; for world w and camera c of C in a
                `warpvis.mujoco.BatchRenderer` it is w C + c.
            frame: Number of the frame; only used with ``per="image"``.
        """
        numbers = [[check_word(view_index, "view_index"), check_word(frame, "frame")]]
        values = self._draw(np.array(numbers, dtype=np.uint32), check_word(seed, "seed"))
        return self._with(values[0])

    def _draw(self, numbers: NDArray[np.uint32], seed: int) -> NDArray[np.float64]:
        """Draw the parameters of views from their indices and frames, ``(V, 2)``, in the order of the ranges."""
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
        """Draw a number between 0 and 1 for each view and name, independent of all other draws."""
        from warpvis.kernels.sensors.random_numbers import draw_uniforms

        host, model = wp.get_device("cpu"), type(self.of).__name__
        draws = wp.array(keys, dtype=wp.vec2ui, device=host)
        words = wp.array([(_hash_name(model), _hash_name(name)) for name in names], dtype=wp.vec2i, device=host)
        uniforms = wp.empty((len(keys), len(names)), dtype=wp.float32, device=host)
        inputs = [draws, words, wp.uint32(seed), wp.uint32(STREAM_PARAMETERS), uniforms]
        launch(draw_uniforms, uniforms.shape, inputs, host)
        return uniforms.numpy()

    def depth_sigma(self, depth: ArrayLike, camera: Camera) -> NDArray[np.float64]:
        """Return the maximum of all sensors."""
        return np.max([corner.depth_sigma(depth, camera) for corner in self._corners], axis=0)

    def measure(self, exposure: Exposure) -> None:
        """Write the depth and reasons of all sensors; views with the same sensor are simulated together."""
        rows = self._draw(exposure.numbers, exposure.seed)
        different, sensor_of_view, counts = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
        order = np.argsort(sensor_of_view.ravel(), kind="stable")
        for values, views in zip(different, np.split(order, np.cumsum(counts)[:-1]), strict=True):
            exposure.measure_some(views, self._with(values))


def randomized(
    sensor: DepthSensor, *, per: Per = "view", kinds: int | None = None, **ranges: tuple[float, float]
) -> Randomized:
    """Return a sensor with randomized parameters for each view.

    Args:
        sensor: A model of a depth camera, such as `realsense_d435()`.
        per: ``"view"``: the sensor of a view is the same in all frames; ``"image"``: it is different in each frame.
        kinds: Number of different sensors; by default, the sensor of each view is different.
        ranges: Minimum and maximum of parameters, by their names: ``baseline=(0.049, 0.051)``.
    """
    return Randomized(sensor, ranges, per, kinds)


def _between(low: float, high: float, uniforms: NDArray[np.float32]) -> NDArray[np.float64]:
    """Scale uniform random numbers to limits; integer limits yield integers."""
    fractions = uniforms.astype(np.float64)
    if isinstance(low, int) and isinstance(high, int):
        return low + np.floor(fractions * (high - low + 1))
    return low + (high - low) * fractions


def _hash_name(name: str) -> int:
    """Return a hash of 31 bits that is the same in every process."""
    return zlib.crc32(name.encode()) >> 1
