# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Parts that models of depth cameras share: reasons, the base class of devices, random images, pixels by distance."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera, require_camera
from warpvis.core.checks import check_number, is_number
from warpvis.core.kernel_cache import launch
from warpvis.core.threads import write_fields
from warpvis.errors import ArrayError
from warpvis.kernels import constants
from warpvis.rendering import DepthSensor, Exposure
from warpvis.scene import Scene
from warpvis.sensors._echoes import Reflectivity, reflectivities

if TYPE_CHECKING:
    from warpvis.kernels.sensors.noise import MeasuredImages, SensorInputs

RANDOM_WORDS = 4
"""Number of pixels that share random words (``native/shared/random.h``): on a GPU, a thread processes that many."""


class Reason(enum.IntEnum):
    """Why a pixel has no depth: the first condition that is true, in the order of the sensor model."""

    VALID = constants.REASON_VALID
    """The pixel has depth."""
    EMPTY = constants.REASON_EMPTY
    """The ray hits nothing; depth is +inf."""
    RANGE = constants.REASON_RANGE
    """The surface is out of range; depth is -inf or +inf. Depth is NaN for all reasons below."""
    SHADOW = constants.REASON_SHADOW
    """The other eye of the sensor, a projector or a second imager, does not see the surface."""
    BAND = constants.REASON_BAND
    """The surface is outside of the image of the other eye."""
    EDGE = constants.REASON_EDGE
    """Too many surrounding pixels have another depth, or the pixel sees several depths."""
    GRAZING = constants.REASON_GRAZING
    """Too little light is reflected because of the angle of incidence."""
    DROPOUT = constants.REASON_DROPOUT
    """The pixel was lost at random, or because the surface is dark or far."""
    SATURATED = constants.REASON_SATURATED
    """The reflected light saturates the pixel."""


@dataclass(frozen=True)
class Device(DepthSensor):
    """A model of a real device that measures reflected light."""

    reflectivity: Reflectivity = field(default=1.0, kw_only=True)
    """Reflectivity from 0 (black) to 1: one value for all objects, a mapping from object names to values (1 for
    others), or values in scene order."""
    native_camera: Camera | None = field(default=None, kw_only=True)
    """The camera of the device, returned by `camera`. Its range of depth also applies to any other camera."""

    def __post_init__(self) -> None:
        if self.native_camera is not None:
            require_camera(self.native_camera, "native_camera")

    @property
    def needs(self) -> tuple[Literal["normals", "segmentation"], ...]:
        """Exact images that are read to compute reflected light."""
        plain = is_number(self.reflectivity) and self.reflectivity == 1.0
        return ("normals",) if plain else ("normals", "segmentation")

    def check(self, scene: Scene, camera: object) -> Camera:
        """Return the camera with its range of depth limited to that of the device."""
        reflectivities(scene, self.reflectivity)
        return super().check(scene, camera)

    def inputs(self, exposure: Exposure) -> SensorInputs:
        """Return the inputs of kernels, with the reflectivity of objects if it is read."""
        inputs = kernel_inputs(exposure)
        if exposure.segmentation is not None:
            values = reflectivities(exposure.scene, self.reflectivity)
            inputs.reflectivity = wp.array(values, dtype=wp.float32, device=exposure.scene.device)
        return inputs


class ByValue:
    """Mixin for dataclasses with array fields; the generated `__eq__` would need the truth value of an array."""

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        pairs = [(getattr(self, field.name), getattr(other, field.name)) for field in fields(self)]  # type: ignore[arg-type]
        return all(np.array_equal(*pair) if isinstance(pair[0], np.ndarray) else pair[0] == pair[1] for pair in pairs)

    def __hash__(self) -> int:
        values = [getattr(self, field.name) for field in fields(self)]  # type: ignore[arg-type]
        return hash((type(self), *(value.shape if isinstance(value, np.ndarray) else value for value in values)))


def closest_first(reach: int, max_squared: int | None = None) -> NDArray[np.int32]:
    """Return offsets (column, row) to the pixels of a window by increasing distance, then by rows, shape ``(N, 2)``.

    `reach` is half the side of the window [px], and `max_squared` the maximum squared distance [px^2].
    """
    offsets = np.arange(-reach, reach + 1, dtype=np.int32)
    row, column = (grid.ravel() for grid in np.meshgrid(offsets, offsets, indexing="ij"))
    squared = row * row + column * column
    order = np.argsort(squared, kind="stable")
    if max_squared is not None:
        order = order[squared[order] <= max_squared]
    return np.stack([column, row], axis=-1)[order]


def kernel_inputs(exposure: Exposure) -> SensorInputs:
    """Return the inputs of an exposure as a struct for kernels."""
    from warpvis.kernels.sensors.noise import SensorInputs

    camera = exposure.camera
    inputs: Any = SensorInputs()
    inputs.seed = exposure.seed
    slopes = _slopes_of(camera, exposure) if isinstance(camera, Camera) else (None, None)
    fields = {
        "column_slopes": slopes[0],
        "row_slopes": slopes[1],
        "camera": camera.device_struct() if isinstance(camera, Camera) else exposure.image_range,
        "true_depth": exposure.true_depth,
        "draws": exposure.draws,
        "normals": exposure.normals,
        "segmentation": exposure.segmentation,
    }
    write_fields(inputs, **{name: value for name, value in fields.items() if value is not None})
    return inputs


def _slopes_of(camera: Camera, exposure: Exposure) -> tuple[wp.array, wp.array]:
    """Return the slopes of rays, cached on a CPU; on a GPU in memory of the call, which a captured graph keeps."""
    from warpvis.kernels.pinhole import measure_slopes

    if exposure.scene.device.is_cpu:
        columns, rows = (camera.width, camera.fx, camera.cx), (camera.height, camera.fy, camera.cy)
        return _slopes(*columns), _slopes(*rows)
    slopes = (
        exposure.scratch("column slopes", (camera.width,), wp.float64),
        exposure.scratch("row slopes", (camera.height,), wp.float64),
    )
    inputs = [camera.device_struct(), *slopes]
    launch(measure_slopes, max(camera.width, camera.height), inputs, exposure.scene.device)
    return slopes


@lru_cache(maxsize=64)
def _slopes(count: int, focal_length: float, center: float) -> wp.array:
    """Return x of the rays of columns, or y of the rays of rows, for z = 1."""
    return wp.array((np.arange(count) + 0.5 - center) / focal_length, dtype=wp.float64, device="cpu")


def kernel_images(exposure: Exposure) -> MeasuredImages:
    """Return the outputs of an exposure as a struct for kernels."""
    from warpvis.kernels.sensors.noise import MeasuredImages

    images = MeasuredImages()
    write_fields(images, depth=exposure.depth_out)
    if exposure.reasons_out is not None:
        write_fields(images, reasons=exposure.reasons_out)
    return images


def draw_normal_image(
    exposure: Exposure, stream: int, name: str, shape: tuple[int, int, int] | None = None
) -> wp.array:
    """Draw normal random numbers of a stream into scratch memory called `name`: by default one for each pixel."""
    from warpvis.kernels.sensors.random_numbers import draw_normals

    normals = exposure.scratch(name, shape or exposure.true_depth.shape, wp.float32)
    inputs = exposure.draws, wp.uint32(exposure.seed), wp.uint32(stream), normals
    exposure.launch(draw_normals, *inputs, shape=normals.shape, rows=RANDOM_WORDS)
    return normals


def check_positive(value: object, name: str, unit: str = "") -> float:
    """Check that `value` is a finite number above 0, and return it."""
    if (number := check_number(value, name, minimum=0.0)) == 0.0:
        raise ArrayError(f"{name} must be above 0{unit and f' {unit}'}")
    return number
