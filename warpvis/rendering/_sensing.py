# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""How a renderer has a sensor's model make images: clean ones are cast first, into memory that waits for this."""

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

from warpvis.core.arrays import as_numpy, empty
from warpvis.core.camera import Camera
from warpvis.core.checks import check_whole, is_number
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.rendering._depth_kernels import launch_back_project
from warpvis.rendering._depth_sensor import DepthSensor, Exposure, require_sensor
from warpvis.rendering._prepared import Idle
from warpvis.rendering._views import ALL_OUTPUTS, OUTPUTS

if TYPE_CHECKING:
    from warpvis.kernels.worlds import Worlds
    from warpvis.scene import Scene

_MAX_WORD = 2**32 - 1
# So many numbers of views, on so many streams, have memory for clean images.
_MAX_KINDS = 3


class Sensing:
    """A sensor's model in a renderer."""

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
        """Check it; `make_caster` makes casters of other cameras of the scene.

        Raises:
            WarpvisError: It is no model, or one of another camera.
        """
        self.sensor = require_sensor(sensor)
        self.camera = sensor.check(scene, camera)
        # The range is judged by what is measured, and a surface counts that is nearer or farther.
        near = camera.near if clip_near else 0.0
        self.clean_camera = dataclasses.replace(self.camera, near=near, far=math.inf)
        self._scene = scene
        self._seed = seed
        self._threads = threads
        self._make_caster = make_caster
        self._casters: dict[Camera, Any] = {}
        self._idle = Idle[dict[str, wp.array]](_MAX_KINDS)

    @property
    def _needed(self) -> tuple[str, ...]:
        return "depth", "true_depth", *self.sensor.needs

    def bytes_per_pixel(self, outputs: tuple[str, ...]) -> int:
        """Count what a pixel takes beside the outputs."""
        lacking = [name for name in self._needed if name not in outputs]
        images = sum(wp.types.type_size_in_bytes(ALL_OUTPUTS[name]) for name in lacking)
        return images + self.sensor.bytes_per_pixel

    def expose(
        self, caster: Any, poses: Any, worlds: Worlds, images: list[wp.array | None], numbers: NDArray[np.int64]
    ) -> None:
        """Write images of poses, in the order of `ALL_OUTPUTS`; None is not made.

        `caster` is of `clean_camera`, and `numbers` are what `view_numbers` returned.
        """
        device = self._scene.device
        keeps = device.is_cpu or not device.is_capturing  # a graph has to have memory of its own
        kind = (len(poses), device.is_cuda and device.stream)
        room = (self._idle.take(kind) if keeps else None) or {}
        made = self._with_room(dict(zip(ALL_OUTPUTS, images, strict=True)), room, len(poses))
        clean = made | {"depth": made["true_depth"], "points": None}
        caster.cast(poses, worlds, [clean[name] for name in OUTPUTS])
        places = poses if isinstance(poses, wp.array) else wp.array(poses, dtype=wp.transform, device=device)
        needs, depth, words = self.sensor.needs, made["depth"], numbers.astype(np.uint32)
        assert depth is not None  # for type checkers: there is room for it
        exposure = Exposure(
            scene=self._scene,
            camera=self.camera,
            clip_near=self.clean_camera.near,
            poses=places,
            worlds=worlds,
            draws=wp.array(words, dtype=wp.vec2ui, device=device),
            numbers=words,
            seed=self._seed,
            threads=self._threads,
            true_depth=made["true_depth"],
            normals=made["normals"] if "normals" in needs else None,
            segmentation=made["segmentation"] if "segmentation" in needs else None,
            depth_out=depth,
            reasons_out=made["reasons"],
            room=partial(self._room, room),
            cast=partial(self._cast_at, room),
        )
        self.sensor.measure(exposure)
        if made["points"] is not None:
            launch_back_project(self.camera, places, depth, made["points"], self._threads)
        if keeps:
            self._idle.give_back(kind, room)

    def _with_room(
        self, images: dict[str, wp.array | None], room: dict[str, wp.array], views: int
    ) -> dict[str, wp.array | None]:
        """Return the images and, of those that a model needs and nobody asked for, memory."""
        shape = (views, self.camera.height, self.camera.width)
        lacking = [name for name in self._needed if images[name] is None]
        return images | {name: self._room(room, name, shape, ALL_OUTPUTS[name]) for name in lacking}

    def _room(self, room: dict[str, wp.array], name: str, shape: tuple[int, ...], dtype: type) -> wp.array:
        """Return memory of an earlier call of the kind, or new."""
        known = room.get(name)
        if known is None or known.shape != shape:
            known = room[name] = empty(shape, dtype, name=name, device=self._scene.device)
        return known

    def _cast_at(
        self,
        room: dict[str, wp.array],
        worlds: Worlds,
        camera: Camera,
        poses: wp.array,
        points: wp.array,
        names: tuple[str, ...],
    ) -> dict[str, wp.array]:
        """Do what `Exposure.cast` says."""
        if camera not in self._casters:
            self._casters[camera] = self._make_caster(camera)
        caster = self._casters[camera]
        seen = {name: self._room(room, f"seen {name}", points.shape, ALL_OUTPUTS[name]) for name in names}
        caster.cast_at(caster.parse_poses(poses, "opencv"), worlds, points, [seen.get(name) for name in OUTPUTS])
        return seen


def next_frame(seed: int) -> int:
    """Return the number of the next frame of this process that has this seed and no number of its own, from 0 up."""
    return next(_frames_of(seed))


@lru_cache(maxsize=2**16)
def _frames_of(seed: int) -> Iterator[int]:
    return itertools.count()


def view_numbers(views: int, frame: int | ArrayInput, view_index: ArrayInput | None) -> NDArray[np.int64]:
    """Return the number and the frame of every view, as `Renderer.render` takes them, shape ``(V, 2)``.

    Raises:
        ArrayError: They are none.
    """
    numbers = np.empty((views, 2), dtype=np.int64)
    numbers[:, 0] = np.arange(views) if view_index is None else _check_words(view_index, "view_index", views)
    numbers[:, 1] = check_word(frame, "frame") if is_number(frame) else _check_words(frame, "frame", views)
    return numbers


def check_word(value: object, name: str) -> int:
    """Return `value` as a whole number of 32 bits.

    Raises:
        ArrayError: It is none.
    """
    if check_whole(value, name, least=0) > _MAX_WORD:
        raise ArrayError(f"{name} must be below 2^32, got {value}")
    return int(value)  # type: ignore[call-overload]


def _check_words(value: ArrayInput | int, name: str, views: int) -> NDArray[np.int64]:
    numbers = as_numpy(value.numpy() if isinstance(value, wp.array) else value, name=name)
    if numbers.shape != (views,) or numbers.dtype.kind not in "iu":
        raise ArrayError(f"{name} must be whole numbers, one for each of {views} views, got {_kind(numbers)}")
    wrong = (numbers < 0) | (numbers > _MAX_WORD)
    if wrong.any():
        raise ArrayError(f"{name} must be from 0 up and below 2^32, got {numbers[wrong][0]}")
    return numbers


def _kind(numbers: np.ndarray) -> str:
    return f"{numbers.dtype} of shape {numbers.shape}"
