# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images of sensor models in a renderer: exact images are cast first, into cached memory, and passed to the model."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import as_numpy, empty
from warpvis.core.checks import check_whole, is_number
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.rendering._depth_kernels import launch_back_project
from warpvis.rendering._depth_sensor import DepthSensor, Exposure, require_sensor
from warpvis.rendering._prepared import FreeList
from warpvis.rendering._views import ALL_OUTPUTS, OUTPUTS

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds
    from warpvis.scene import Scene

_MAX_WORD = 2**32 - 1
# Maximum number of kinds of calls (number of views and stream) with cached memory for exact images.
_MAX_KINDS = 3


class Sensing:
    """A sensor model in a renderer."""

    def __init__(
        self,
        sensor: DepthSensor,
        scene: Scene,
        camera: Any,
        make_caster: Callable[[Camera], Any],
        *,
        seed: int,
        clip_near: bool,
        threads: int,
    ) -> None:
        """Check the sensor; `make_caster` creates casters for other cameras of the scene.

        Raises:
            WarpvisError: If `sensor` is not a sensor model, or does not support the camera.
        """
        self.sensor = require_sensor(sensor)
        self.camera = sensor.check(scene, camera)
        # The range applies to the measured depth; the exact depth includes nearer and farther surfaces.
        near = camera.near if clip_near else 0.0
        self.clean_camera = dataclasses.replace(self.camera, near=near, far=math.inf)
        self._scene = scene
        self._seed = seed
        self._threads = threads
        self._make_caster = make_caster
        self._casters: dict[Camera, Any] = {}
        self._free = FreeList[dict[str, wp.array]](_MAX_KINDS)

    @property
    def _needed(self) -> tuple[str, ...]:
        return "depth", "true_depth", *self.sensor.needs

    def bytes_per_pixel(self, outputs: tuple[str, ...]) -> int:
        """Return the memory used per pixel in addition to the outputs [bytes]."""
        lacking = [name for name in self._needed if name not in outputs]
        images = sum(wp.types.type_size_in_bytes(ALL_OUTPUTS[name]) for name in lacking)
        return images + self.sensor.bytes_per_pixel

    def expose(
        self, caster: Any, poses: Any, worlds: Worlds, images: list[wp.array | None], numbers: NDArray[np.int64]
    ) -> None:
        """Write images of poses, in the order of `ALL_OUTPUTS`; skip images that are None.

        `caster` must be a caster for `clean_camera`, and `numbers` the result of `view_numbers`.
        """
        device = self._scene.device
        reuses = device.is_cpu or not device.is_capturing  # a captured graph must not share its memory
        kind = (len(poses), device.is_cuda and device.stream)
        arrays = (self._free.take(kind) if reuses else None) or {}
        needed = self._with_scratch(dict(zip(ALL_OUTPUTS, images, strict=True)), arrays, len(poses))
        clean = needed | {"depth": needed["true_depth"], "points": None}
        caster.cast(poses, worlds, [clean[name] for name in OUTPUTS])
        device_poses = poses if isinstance(poses, wp.array) else wp.array(poses, dtype=wp.transform, device=device)
        needs, depth, words = self.sensor.needs, needed["depth"], numbers.astype(np.uint32)
        assert depth is not None  # for type checkers: depth is always among the needed images
        exposure = Exposure(
            scene=self._scene,
            camera=self.camera,
            clip_near=self.clean_camera.near,
            poses=device_poses,
            worlds=worlds,
            draws=wp.array(words, dtype=wp.vec2ui, device=device),
            numbers=words,
            seed=self._seed,
            threads=self._threads,
            true_depth=needed["true_depth"],
            normals=needed["normals"] if "normals" in needs else None,
            segmentation=needed["segmentation"] if "segmentation" in needs else None,
            depth_out=depth,
            reasons_out=needed["reasons"],
            scratch=partial(self._scratch, arrays),
            cast=partial(self._cast_at, arrays),
        )
        self.sensor.measure(exposure)
        if needed["points"] is not None:
            launch_back_project(self.camera, device_poses, depth, needed["points"], self._threads)
        if reuses:
            self._free.give_back(kind, arrays)

    def _with_scratch(
        self, images: dict[str, wp.array | None], arrays: dict[str, wp.array], views: int
    ) -> dict[str, wp.array | None]:
        """Return the images, with scratch memory for images that the model needs and that were not requested."""
        shape = (views, self.camera.height, self.camera.width)
        lacking = [name for name in self._needed if images[name] is None]
        return images | {name: self._scratch(arrays, name, shape, ALL_OUTPUTS[name]) for name in lacking}

    def _scratch(self, arrays: dict[str, wp.array], name: str, shape: tuple[int, ...], dtype: type) -> wp.array:
        """Return memory of an earlier call of the same kind, or allocate it."""
        array = arrays.get(name)
        if array is None or array.shape != shape:
            array = arrays[name] = empty(shape, dtype, name=name, device=self._scene.device)
        return array

    def _cast_at(
        self,
        arrays: dict[str, wp.array],
        worlds: Worlds,
        camera: Camera,
        poses: wp.array,
        points: wp.array,
        names: tuple[str, ...],
    ) -> dict[str, wp.array]:
        """Implement `Exposure.cast`."""
        if camera not in self._casters:
            self._casters[camera] = self._make_caster(camera)
        caster = self._casters[camera]
        seen = {name: self._scratch(arrays, f"seen {name}", points.shape, ALL_OUTPUTS[name]) for name in names}
        caster.cast_at(caster.parse_poses(poses, "opencv"), worlds, points, [seen.get(name) for name in OUTPUTS])
        return seen


def next_frame(seed: int) -> int:
    """Return the number of the next frame without an explicit number in this process, per seed, counting from 0."""
    return next(_frames_of(seed))


@lru_cache(maxsize=2**16)
def _frames_of(seed: int) -> Iterator[int]:
    return itertools.count()


def view_numbers(views: int, frame: int | ArrayInput, view_index: ArrayInput | None) -> NDArray[np.int64]:
    """Return the number and the frame of each view from the arguments of `Renderer.render`, shape ``(V, 2)``.

    Raises:
        ArrayError: If a value is not an unsigned 32-bit integer, or an array does not have one value per view.
    """
    numbers = np.empty((views, 2), dtype=np.int64)
    numbers[:, 0] = np.arange(views) if view_index is None else _check_words(view_index, "view_index", views)
    numbers[:, 1] = check_word(frame, "frame") if is_number(frame) else _check_words(frame, "frame", views)
    return numbers


def check_word(value: object, name: str) -> int:
    """Return `value` as an int.

    Raises:
        ArrayError: If `value` is not an unsigned 32-bit integer.
    """
    if check_whole(value, name, minimum=0) > _MAX_WORD:
        raise ArrayError(f"{name} must be below 2^32, got {value}")
    return int(value)  # type: ignore[call-overload]


def _check_words(value: ArrayInput | int, name: str, views: int) -> NDArray[np.int64]:
    numbers = as_numpy(value.numpy() if isinstance(value, wp.array) else value, name=name)
    if numbers.shape != (views,) or numbers.dtype.kind not in "iu":
        raise ArrayError(f"{name} must be whole numbers, one for each of {views} views, got {_kind(numbers)}")
    wrong = (numbers < 0) | (numbers > _MAX_WORD)
    if wrong.any():
        raise ArrayError(f"{name} must be from 0 to 2^32 - 1, got {numbers[wrong][0]}")
    return numbers


def _kind(numbers: np.ndarray) -> str:
    return f"{numbers.dtype} of shape {numbers.shape}"
