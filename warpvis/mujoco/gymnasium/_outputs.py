# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The entries that wrappers add to observations: images, and visible fractions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeAlias, get_args

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.cameras.pinhole import check_size
from warpvis.core.checks import as_items, check_choice, check_number
from warpvis.core.outputs import SENSOR_NAMES
from warpvis.errors import ArrayError, CameraError, SceneError
from warpvis.mujoco._batch_views import CameraChoice
from warpvis.mujoco._body_visibility import require_perspective
from warpvis.mujoco._cameras import camera_from_mujoco
from warpvis.mujoco._model_fields import shape_bodies, shape_count
from warpvis.mujoco._scene import check_patterns, class_of_geoms
from warpvis.rendering import DepthSensor, Fill, Output, check_fill, require_sensor
from warpvis.sensors import Reason

_COUNTS = {"rgb": 3, "rgbd": 4}  # channels of images

Segmentation: TypeAlias = Literal["geom", "body"] | Mapping[str, int]
"""Number of a pixel in segmentation: id of its geom or body, or the class of the last pattern that matches either."""

DEPTH, SEGMENTATION, FRACTION, REASONS = "depth", "segmentation", "visible_fraction", "reasons"
TRUE_DEPTH, RGB, RGBD, COLOR = "true_depth", "rgb", "rgbd", "color"
_NAMES = (RGB, DEPTH, RGBD, SEGMENTATION)

Channels: TypeAlias = Literal["last", "first"]
"""Position of the axis of red, green and blue: ``"last"``, as in Gymnasium, or ``"first"``, as in PyTorch."""


class Outputs:
    """The entries that a wrapper adds, for one model."""

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        camera: CameraChoice | Sequence[CameraChoice],
        width: int,
        height: int,
        outputs: Sequence[str],
        channels: Channels,
        depth_range: Sequence[float] | None,
        objects: Sequence[str],
        segmentation: Segmentation,
        fill: Fill,
        sensor: DepthSensor | None,
    ) -> None:
        """Check the arguments of a wrapper."""
        single = isinstance(camera, str | int | np.integer | mujoco.MjvCamera)
        self.cameras: list[CameraChoice] = [camera] if single else as_items(camera, "camera", CameraError)
        if not self.cameras:
            raise CameraError("camera must be one or more cameras, got none")
        self.shape = (check_size(height, "height"), check_size(width, "width"))
        self.sensor = None if sensor is None else require_sensor(sensor)
        known = _NAMES if sensor is None else (*_NAMES, *SENSOR_NAMES)
        self.names = [check_choice(name, "outputs", known) for name in as_items(outputs, "outputs")]
        if not self.names or len(set(self.names)) < len(self.names):
            raise ArrayError(f"outputs must be one or more of {', '.join(known)}, each once, got {outputs!r}")
        patterns = check_patterns(objects, "objects")
        self.members = np.array([class_of_geoms(model, {name: 1}, "objects") == 1 for name in patterns], dtype=bool)
        """Whether each geom and site is part of each of `objects`, ``(objects, shapes)``."""
        self.members = self.members.reshape(len(patterns), shape_count(model))
        self.numbers, highest = _numbers(model, segmentation)
        """The number of every geom and site in segmentation, with a last one for no shape (index -1)."""
        self._axes = () if single else (len(self.cameras),)
        self._channels = check_choice(channels, "channels", get_args(Channels))
        self._range = _check_range(model, depth_range)
        seen = [camera_from_mujoco(model, choice, width, height) for choice in self.cameras]
        for lens in seen if len(self.members) else ():
            require_perspective(lens)
        self.fill, size = fill, (*self._axes, *self.shape)
        bounds: dict[str, tuple[Any, Any, type]] = {
            RGB: (0, 255, np.uint8),
            RGBD: (0, 255, np.uint8),
            DEPTH: (*_depth_bounds(fill, seen, sensed=sensor is not None), np.float32),
            SEGMENTATION: (-1, highest, np.int32),
            REASONS: (0, max(Reason), np.uint8),
            TRUE_DEPTH: (0.0, np.inf, np.float32),
        }
        self.spaces: dict[str, spaces.Space] = {
            name: spaces.Box(low, high, self._size(name, size), dtype)
            for name, (low, high, dtype) in bounds.items()
            if name in self.names
        }
        """The spaces of the entries."""
        if len(self.members):
            self.spaces[FRACTION] = spaces.Box(0.0, 1.0, (*self._axes, len(self.members)), np.float32)

    @property
    def images(self) -> tuple[Output, ...]:
        """The outputs to render."""
        requested = set(self.names)
        requested |= {COLOR} if {RGB, RGBD} & requested else set()
        requested |= {DEPTH} if RGBD in requested else set()
        known: tuple[Output, ...] = ("depth", "color", "segmentation", "reasons", "true_depth")
        return tuple(name for name in known if name in requested)

    def members_of(self, shapes: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Return whether geoms and sites (-1 for none) are part of each of `objects`, shape ``(objects, shapes)``."""
        return np.append(self.members, np.zeros((len(self.members), 1), dtype=bool), axis=1)[:, shapes]

    def entries(self, images: Mapping[str, np.ndarray], *, axis: int = 0) -> dict[str, np.ndarray]:
        """Return an observation's entries, owned by the caller, from the images ``(C, ..., H, W)`` of all cameras.

        In segmentation, pixels have the number of their geom or site, or -1. Other images than entries are ignored.
        `axis` is the position of the axis for cameras, if there is one.
        """
        chosen = {name: self._image(name, images) for name in self.spaces}
        if SEGMENTATION in chosen:
            chosen[SEGMENTATION] = self.numbers[chosen[SEGMENTATION]]
        return {name: (np.moveaxis(part, 0, axis) if self._axes else part[0]).copy() for name, part in chosen.items()}

    def _size(self, name: str, size: tuple[int, ...]) -> tuple[int, ...]:
        """Return the shape of an image of ``(..., H, W)`` pixels with its channels."""
        if name not in _COUNTS:
            return size
        return (*size, _COUNTS[name]) if self._channels == "last" else (*size[:-2], _COUNTS[name], *size[-2:])

    def _image(self, name: str, images: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return an entry's image."""
        if name not in _COUNTS:
            return images[name]
        image = images[COLOR]
        if name == RGBD:
            near, far = self._range
            scaled = np.clip((images[DEPTH] - near) * (255 / (far - near)), 0, 255)
            image = np.concatenate([image, np.rint(scaled).astype(np.uint8)[..., None]], axis=-1)
        return image if self._channels == "last" else np.moveaxis(image, -1, -3)


def _check_range(model: mujoco.MjModel, given: Sequence[float] | None) -> tuple[float, float]:
    """Return the depths of the values 0 and 255 [m]."""
    if given is None:
        return 0.0, 2.0 * float(model.stat.extent)
    ends = [check_number(end, "depth_range") for end in as_items(given, "depth_range")]
    if len(ends) != 2 or not 0 <= ends[0] < ends[1]:
        raise ArrayError(f"depth_range must be two increasing depths of at least 0 m, got {given!r}")
    return ends[0], ends[1]


def _numbers(model: mujoco.MjModel, segmentation: Segmentation) -> tuple[NDArray[np.int32], int]:
    if isinstance(segmentation, Mapping):
        numbers = class_of_geoms(model, segmentation, "segmentation")
        highest = int(numbers.max(initial=-1))
    else:
        kind = check_choice(segmentation, "segmentation", ("geom", "body"), SceneError)
        geoms = np.r_[np.arange(model.ngeom), np.full(model.nsite, -1)]
        numbers = geoms if kind == "geom" else shape_bodies(model)
        highest = (model.ngeom if kind == "geom" else model.nbody) - 1
    return np.append(numbers, -1).astype(np.int32), max(highest, 0)


def _depth_bounds(fill: Fill, cameras: Sequence[PlanarCamera], *, sensed: bool) -> tuple[float, float]:
    """Return the bounds of depth."""
    far = max(camera.far for camera in cameras)
    fill = check_fill(fill)
    if fill == "inf" and sensed:
        raise ArrayError('fill must be "far" or a number with a sensor, got "inf", which leaves NaN for lost depth')
    if isinstance(fill, str):
        return (0.0, np.inf) if fill == "inf" else (0.0, far)
    return min(fill, 0.0), max(fill, far)
