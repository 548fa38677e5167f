# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Time-of-flight depth cameras that measure the phase of continuously modulated light."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.checks import as_floats
from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import empty
from warpvis.core.checks import as_items, check_angle, check_flag, check_number, is_number
from warpvis.core.kernel_cache import launch
from warpvis.errors import ArrayError
from warpvis.rendering import Exposure
from warpvis.sensors.depth._base import RANDOM_WORDS, Device, check_positive, kernel_images

if TYPE_CHECKING:
    from warpvis.kernels.sensors.noise import SensorInputs
    from warpvis.kernels.sensors.time_of_flight import FlightModel

SPEED_OF_LIGHT = 299792458.0
"""Speed of light in vacuum [m/s]."""

_MAX_FREQUENCIES, _MAX_LAPS = 3, 1000
# Sub-rays are processed in parts to limit memory. Parts are multiples of _TREE_PIXELS, the number of pixels per tree of
# image points on the CPU, so that results do not depend on the batch.
_TREE_PIXELS, _TILE_PIXELS, _SIDE = 640, 16, 4
# Minimum size of a part on a GPU [px], so that sub-rays are always cast in packets, and parts are few.
_GPU_PIXELS = 8 * _TREE_PIXELS
# Approximate number of threads for edge pixels whose number the host does not know.
_GPU_THREADS = 1 << 19
_PART_BYTES = 2**28


@dataclass(frozen=True)
class TimeOfFlight(Device):
    """A depth camera that illuminates the scene with modulated light, and measures the phase of the reflected light.

    A surface at range r [m] with an angle of incidence theta and `reflectivity` rho returns
    A = `signal` rho cos(theta) / r^2 electrons. The phase at frequency f is 2 pi 2 f r / c. For the highest of
    `frequencies`, the standard deviation of range is (Lange, "3D Time-of-flight distance measurement with custom
    solid-state image sensors in CMOS/CCD-technology", 2000)::

        c / (4 sqrt(2) pi f) sqrt(A + B) / (c_d A)

    with the `background` B and the `contrast` c_d. The measured range along the ray is r + `offset` + `wiggle`
    sin(4 phase + `wiggle_phase`) + noise, modulo `unambiguous_range`; depth is its projection on the axis.

    With `mixing`, 4 x 4 rays are cast through each pixel next to another surface, and their phasors A exp(i phase) are
    summed for each frequency. This creates flying pixels between the depths of two surfaces. A pixel has no depth if
    one of these conditions is true; the first gives its `Reason`: the ray hits nothing (EMPTY); for some frequency, the
    magnitude of the sum is less than `min_coherence` of the sum of magnitudes (EDGE); the signal exceeds
    `max_signal` (SATURATED); it is below `min_signal` because of the angle (GRAZING), or because the surface is dark
    or far (DROPOUT); measured depth is outside of `near` and `far` of the camera (RANGE).

    By default, a sensor has no noise, and only flying pixels have errors. Light reflected by a second surface
    (multipath) and light scattered in the lens are not modeled.
    """

    frequencies: float | Sequence[float]
    """Modulation frequencies: one to three integers [Hz]. Depth wraps where all phases return to 0."""
    signal: float = math.inf
    """Electrons returned by a white surface at 1 m at normal incidence; infinite for no noise."""
    background: float = 0.0
    """Electrons from ambient light and dark current."""
    contrast: float = 1.0
    """Demodulation contrast, greater than 0 and at most 1."""
    offset: float = 0.0
    """Constant error of range [m]."""
    wiggle: float = 0.0
    """Amplitude of the systematic error that has four periods in one period of the highest frequency's phase [m]; it is
    caused by harmonics of the modulation."""
    wiggle_phase: float = 0.0
    """Phase of that error at range 0 [rad]."""
    mixing: bool = True
    """Whether pixels at edges mix the light of several surfaces."""
    edge_step: float = 0.01
    """Minimum distance of one of the eight neighbors from the plane of a pixel for mixing [m]."""
    min_coherence: float = 0.0
    """Minimum coherence of the phasors in a pixel, from 0 to 1; pixels below it have no depth."""
    min_signal: float = 0.0
    """Minimum measured signal, relative to a white surface at 1 m at normal incidence."""
    max_signal: float = math.inf
    """Signal above which a pixel is saturated, relative to the same surface."""

    def __post_init__(self) -> None:
        super().__post_init__()
        numbers = [self.frequencies] if is_number(self.frequencies) else as_items(self.frequencies, "frequencies")
        if not 1 <= len(numbers) <= _MAX_FREQUENCIES or not all(
            is_number(number) and 1 <= number <= 1e12 and number == int(number) for number in numbers
        ):
            raise ArrayError(f"frequencies must be 1 to 3 whole numbers of Hz from 1 to 1e12, got {self.frequencies!r}")
        frequencies = tuple(sorted({int(number) for number in numbers}, reverse=True))
        object.__setattr__(self, "frequencies", tuple(float(number) for number in frequencies))
        if frequencies[0] // reduce(math.gcd, frequencies) > _MAX_LAPS:
            raise ArrayError(
                f"frequencies must have a common divisor of at least 1/{_MAX_LAPS} of the highest, got {frequencies}"
            )
        _check_positive(self.signal, "signal")
        check_number(self.background, "background", minimum=0.0)
        if check_number(self.contrast, "contrast", minimum=0.0, maximum=1.0) == 0.0:
            raise ArrayError("contrast must be above 0")
        check_angle(self.wiggle_phase, "wiggle_phase")
        for name in ("offset", "wiggle"):
            check_number(getattr(self, name), name)
        check_flag(self.mixing, "mixing")
        check_positive(self.edge_step, "edge_step", "m")
        check_number(self.min_coherence, "min_coherence", minimum=0.0, maximum=1.0)
        min_signal = check_number(self.min_signal, "min_signal", minimum=0.0)
        _check_positive(self.max_signal, "max_signal")
        if min_signal >= self.max_signal:
            raise ArrayError(f"max_signal must be above min_signal, got {self.max_signal:g} and {min_signal:g}")

    @property
    def unambiguous_range(self) -> float:
        """Range at which measured range wraps to 0 [m]: c / (2 f), f being the greatest common divisor."""
        return SPEED_OF_LIGHT / (2 * reduce(math.gcd, self._integers))

    @property
    def bytes_per_pixel(self) -> int:
        """Scratch memory per pixel, without memory of constant size [B]."""
        return 28 if self.mixing else 0

    @property
    def _integers(self) -> tuple[int, ...]:
        return tuple(int(number) for number in self.frequencies)  # type: ignore[union-attr]

    def depth_sigma(self, depth: ArrayLike, camera: Camera) -> NDArray[np.float64]:
        """Return the standard deviation of range at the image center, for the darkest surface; with `offset`, `wiggle`.

        Surfaces at an angle of incidence theta return as much light as a surface of reflectivity rho cos(theta).
        """
        values = self.reflectivity.values() if isinstance(self.reflectivity, Mapping) else self.reflectivity
        darkest = float(np.min([*values] if isinstance(values, Iterable) else values, initial=1.0))
        z = as_floats(depth, "depth")
        noise = np.zeros_like(z)
        if math.isfinite(self.signal):
            electrons = np.maximum(self.signal * darkest / np.maximum(z, 1e-6) ** 2, 1e-30)
            scale = SPEED_OF_LIGHT / (4 * math.sqrt(2) * math.pi * self._integers[0] * self.contrast)
            noise = scale * np.sqrt(electrons + self.background) / electrons
        return np.sqrt(noise**2 + self.offset**2 + self.wiggle**2 / 2)

    def measure(self, exposure: Exposure) -> None:
        """Write the depth and reasons of the sensor."""
        from warpvis.kernels.sensors.sub_rays import find_axes
        from warpvis.kernels.sensors.time_of_flight import measure_time_of_flight

        model, inputs = self._model(), self.inputs(exposure)
        axes = exposure.scratch("axes", exposure.poses.shape, wp.mat33)
        launch(find_axes, len(exposure.poses), [exposure.poses, axes], exposure.scene.device)
        if self.mixing:
            model.slots, model.mixes = self._mix(exposure, axes, model, inputs)
        images = kernel_images(exposure)
        exposure.launch(measure_time_of_flight, model, inputs, images, cameras=[axes], rows=RANDOM_WORDS)

    def _model(self) -> FlightModel:
        """Return the parameters as a struct for kernels, without the results of sub-rays."""
        from warpvis.kernels.sensors.time_of_flight import FlightModel

        model, frequencies = FlightModel(), self._integers
        model.frequencies = len(frequencies)
        turns = [2 * frequency / SPEED_OF_LIGHT for frequency in frequencies]
        model.turns = wp.vec3d(*turns, *[0.0] * (_MAX_FREQUENCIES - len(turns)))
        model.unambiguous, model.laps = self.unambiguous_range, frequencies[0] // reduce(math.gcd, frequencies)
        one = SPEED_OF_LIGHT / (4 * math.sqrt(2) * math.pi * frequencies[0])
        model.noise_scale = one / (self.contrast * math.sqrt(self.signal))
        model.background = self.background / self.signal
        model.min_signal, model.max_signal = self.min_signal, self.max_signal
        model.min_coherence = self.min_coherence
        model.offset, model.wiggle, model.wiggle_turns = self.offset, self.wiggle, self.wiggle_phase / (2 * math.pi)
        return model

    def _mix(
        self, exposure: Exposure, axes: wp.array, model: FlightModel, inputs: SensorInputs
    ) -> tuple[wp.array, wp.array]:
        """Return the slots of pixels at edges, -1 elsewhere, and the mixed signals of their sub-rays by slot."""
        from warpvis.kernels.sensors.sub_rays import find_edges, list_sub_rays, place_sub_rays
        from warpvis.kernels.sensors.time_of_flight import mix_sub_rays

        (views, _, width), device = exposure.true_depth.shape, exposure.scene.device
        slots = exposure.scratch("edges", exposure.true_depth.shape, wp.int32)  # not negative at edges
        exposure.launch(find_edges, inputs, self.edge_step, slots, cameras=[axes], rows=RANDOM_WORDS)
        counts = used = None
        if _counts_on_host(device):
            pixels, part = _pixels_in_parts(slots)
            points = exposure.scratch("sub-rays", (views, _TILE_PIXELS, part), wp.vec2)
        else:
            pixels, counts, part = _number_edges(exposure, slots)
            points = exposure.scratch("sub-rays", (views, 1, part * _SIDE**2), wp.vec2)
            used = exposure.scratch("number of sub-rays", (views,), wp.int32)
        mixes = empty(pixels.shape, wp.vec4, name="mixes", device=device)
        ideal = dataclasses.replace(exposure.camera, near=exposure.clip_near, far=math.inf)
        tiles = part // _TILE_PIXELS
        if counts is not None:
            tiles = min(tiles, -(-_GPU_THREADS // (views * _TILE_PIXELS)))
        for first in range(0, pixels.shape[1], part):
            if counts is None:
                exposure.launch(place_sub_rays, pixels, first, width, points, shape=points.shape, rows=1)
            else:
                places = points.reshape((views, -1))
                step = min(places.shape[1], -(-_GPU_THREADS // views))
                launch(list_sub_rays, (views, step), [pixels, counts, first, width, step, places, used], device)
            seen = exposure.cast_images_at(ideal, exposure.poses, points, ("depth", *self.needs), used)
            images = seen["depth"], seen["normals"], seen.get("segmentation")
            arguments = model, inputs, pixels, counts, *images, first, tiles, mixes
            exposure.launch(mix_sub_rays, *arguments, cameras=[axes], shape=(views, tiles, _TILE_PIXELS), rows=1)
        return slots, mixes


def _counts_on_host(device: wp.Device) -> bool:
    """Return whether the host reads which pixels are at edges. It does not wait for a GPU."""
    return device.is_cpu


def _part_size(views: int, count: int, min_part: int) -> int:
    """Return the number of pixels of each view whose sub-rays are cast together, of at most `count`."""
    max_part = _PART_BYTES // (28 * _SIDE * _SIDE * max(views, 1)) // _TREE_PIXELS * _TREE_PIXELS
    return min(max(-(-count // _TILE_PIXELS), 1) * _TILE_PIXELS, max(max_part, min_part))


def _pixels_in_parts(slots: wp.array) -> tuple[wp.array, int]:
    """Enumerate the pixels at edges in each view; return the pixel of each number, and the size of parts."""
    views = len(slots)
    edges = slots.numpy().reshape(views, -1)
    found = [np.flatnonzero(view_slots >= 0) for view_slots in edges]
    count = max(map(len, found), default=0)
    part = _part_size(views, count, _TREE_PIXELS)
    numbers = np.full((views, -(-count // part) * part), -1, dtype=np.int32)
    for view, (view_slots, pixels) in enumerate(zip(edges, found, strict=True)):
        numbers[view, : len(pixels)] = pixels
        view_slots[pixels] = np.arange(len(pixels))
    return wp.array(numbers, dtype=wp.int32, device=slots.device), part


def _number_edges(exposure: Exposure, slots: wp.array) -> tuple[wp.array, wp.array, int]:
    """Enumerate the pixels at edges in each view in place; return the pixel of each number, counts, the size of parts.

    The host does not wait for the counts: parts cover all pixels, of which kernels skip those that are not at edges.
    """
    from warpvis.kernels.sensors.sub_rays import TILE_SIDE, EdgeTiles, count_edges, number_edges

    (views, height, width), device = slots.shape, slots.device
    strips = -(-height // int(TILE_SIDE))
    tiles = EdgeTiles()
    tiles.bits = (max(strips, -(-width // int(TILE_SIDE))) - 1).bit_length()
    number = views << 2 * tiles.bits
    tiles.counts, tiles.ends = (
        exposure.scratch(f"{name} of tiles", (number,), wp.int32) for name in ("counts", "ends")
    )
    counts = exposure.scratch("number of edges", (views,), wp.int32)
    pixels = exposure.scratch("pixels at edges", (views, height * width), wp.int32)
    tiles.counts.zero_()
    launch(count_edges, (views, strips, width), [slots, tiles], device)
    wp.utils.array_scan(tiles.counts, tiles.ends, inclusive=True)
    launch(number_edges, (views, strips, width), [tiles, slots, pixels, counts], device)
    return pixels, counts, _part_size(views, height * width, _GPU_PIXELS)


def _check_positive(value: object, name: str) -> None:
    if not is_number(value) or not value > 0:
        raise ArrayError(f"{name} must be a number above 0, got {value!r}")
