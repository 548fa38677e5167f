# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measurement of exact images by sensor models, and the numbers of views and frames that seed it."""

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
from warpvis.cameras.rays import Rays
from warpvis.core.arrays import as_numpy
from warpvis.core.checks import check_whole, is_number
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.rendering._depth_kernels import launch_back_project
from warpvis.rendering._depth_sensor import DepthSensor, Exposure, require_sensor
from warpvis.rendering._views import pixel_type
from warpvis.rendering.casters.base import Caster, CastOptions, ImagesByName, Scratch, ViewBatch, as_image
from warpvis.rendering.casters.moving import MovingCaster

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds
    from warpvis.scene import Scene

_MAX_WORD = 2**32 - 1


class Sensing:
    """A sensor model in a renderer: the stage that measures exact images."""

    def __init__(
        self,
        sensor: DepthSensor,
        scene: Scene,
        camera: Any,
        make_caster: Callable[[Camera], Caster],
        options: CastOptions,
        seed: int,
    ) -> None:
        """Check the sensor; `make_caster` creates casters for other cameras of the scene.

        Raises:
            WarpvisError: If `sensor` is not a sensor model, or does not support the camera.
        """
        self.sensor = require_sensor(sensor)
        self.camera = sensor.check(scene, camera)
        # The range applies to the measured depth; the exact depth includes nearer and farther surfaces.
        near = camera.near if options.clip_near else 0.0
        self.clean_camera = _with_range(self.camera, near, math.inf)
        self._scene = scene
        self._seed = seed
        self._threads = options.threads
        self._make_caster = make_caster
        self._casters: dict[Camera, Caster] = {}

    @property
    def needs(self) -> tuple[str, ...]:
        """Images that the model reads, and the depth that it writes."""
        return "depth", "true_depth", *self.sensor.needs

    def measure(
        self, views: ViewBatch, images: ImagesByName, scratch: Scratch, moving: MovingCaster | None = None
    ) -> None:
        """Write depth, reasons and points of all views from exact images.

        Args:
            views: The views, with the numbers of `view_numbers`.
            images: Images by name: those in `needs`, and those requested.
            scratch: Memory for further images.
            moving: The caster of the images, if poses are a motion.
        """
        device = self._scene.device
        assert views.numbers is not None  # a renderer with a sensor always numbers its views
        needs, words = self.sensor.needs, views.numbers.astype(np.uint32)
        images = {name: as_image(image) for name, image in images.items()}
        incidence = None
        if moving is None:
            poses = views.poses_on(device)
        else:
            poses = wp.empty(0, dtype=wp.transform, device=device)
            if "normals" in needs:
                incidence = scratch.array("incidence", images["normals"].shape, wp.float32)
                moving.measure_incidence(views, images["normals"], incidence)
        exposure = Exposure(
            scene=self._scene,
            camera=self.camera,
            clip_near=self.clean_camera.near,
            poses=poses,
            worlds=views.worlds,
            draws=wp.array(words, dtype=wp.vec2ui, device=device),
            numbers=words,
            seed=self._seed,
            threads=self._threads,
            true_depth=images["true_depth"],
            normals=images["normals"] if "normals" in needs else None,
            segmentation=images["segmentation"] if "segmentation" in needs else None,
            incidence=incidence,
            depth_out=images["depth"],
            reasons_out=images.get("reasons"),
            scratch=scratch.array,
            cast=partial(self._cast_at, scratch),
        )
        if views.count:
            self.sensor.measure(exposure)
        if "points" in images and moving is not None:
            moving.back_project(views, images["depth"], images["points"])
        elif "points" in images:
            launch_back_project(self.camera, poses, images["depth"], images["points"], self._threads)

    def _cast_at(
        self,
        scratch: Scratch,
        worlds: Worlds,
        camera: Camera,
        poses: wp.array,
        points: wp.array,
        names: tuple[str, ...],
        limits: wp.array | None = None,
        used: wp.array | None = None,
    ) -> dict[str, wp.array]:
        """Implement `Exposure.cast`."""
        if camera not in self._casters:
            self._casters[camera] = self._make_caster(camera)
        caster = self._casters[camera]
        seen = {name: scratch.array(f"seen {name}", points.shape, pixel_type(name)) for name in names}
        views = ViewBatch(caster.parse_poses(poses, "opencv"), worlds, pixels=points, limits=limits, used=used)
        caster.cast(views, seen)
        return seen


def _with_range(camera: Any, near: float, far: float) -> Any:
    """Return a camera with another range of depth."""
    return camera.with_range(near, far) if isinstance(camera, Rays) else dataclasses.replace(camera, near=near, far=far)


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
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= _MAX_WORD:
        return value
    if check_whole(value, name, minimum=0) > _MAX_WORD:
        raise ArrayError(f"{name} must be below 2^32, got {value}")
    return int(value)  # type: ignore[call-overload]


def _check_words(value: ArrayInput | int, name: str, views: int) -> NDArray[np.int64]:
    numbers = as_numpy(value, name=name)
    if numbers.shape != (views,) or numbers.dtype.kind not in "iu":
        raise ArrayError(f"{name} must be whole numbers, one for each of {views} views, got {_kind(numbers)}")
    wrong = (numbers < 0) | (numbers > _MAX_WORD)
    if wrong.any():
        raise ArrayError(f"{name} must be from 0 to 2^32 - 1, got {numbers[wrong][0]}")
    return numbers


def _kind(numbers: np.ndarray) -> str:
    return f"{numbers.dtype} of shape {numbers.shape}"
