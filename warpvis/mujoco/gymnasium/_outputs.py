# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What wrappers add to observations: its names, spaces, and how segmentation becomes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, TypeAlias

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from warpvis.core.camera import check_size
from warpvis.core.checks import as_items, check_choice
from warpvis.errors import ArrayError, CameraError, SceneError
from warpvis.mujoco._batch_cameras import CameraChoice
from warpvis.mujoco._cameras import camera_from_mujoco
from warpvis.mujoco._scene import check_patterns, class_of_geoms
from warpvis.mujoco._shapes import shape_bodies, shape_count
from warpvis.rendering import SENSOR_OUTPUTS, AnyCamera, DepthSensor, Fill, Output, check_fill, require_sensor
from warpvis.sensors import Reason

Segmentation: TypeAlias = Literal["geom", "body"] | Mapping[str, int]
"""Whose number a pixel has: its geom's, its body's, or the class of the last pattern that fits one of them."""

DEPTH, SEGMENTATION, FRACTION, REASONS = "depth", "segmentation", "visible_fraction", "reasons"
TRUE_DEPTH = "true_depth"
_NAMES = (DEPTH, SEGMENTATION)


class Outputs:
    """The entries that a wrapper adds, of one model."""

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        camera: CameraChoice | Sequence[CameraChoice],
        width: int,
        height: int,
        outputs: Sequence[str],
        objects: Sequence[str],
        segmentation: Segmentation,
        fill: Fill,
        sensor: DepthSensor | None,
    ) -> None:
        """Check the arguments of a wrapper.

        Raises:
            WarpvisError: One is not what it has to be.
        """
        single = isinstance(camera, str | int | np.integer | mujoco.MjvCamera)
        self.cameras: list[CameraChoice] = [camera] if single else as_items(camera, "camera", CameraError)
        if not self.cameras:
            raise CameraError("camera must be a camera or several, got none")
        self.shape = (check_size(height, "height"), check_size(width, "width"))
        self.sensor = None if sensor is None else require_sensor(sensor)
        known = _NAMES if sensor is None else (*_NAMES, *SENSOR_OUTPUTS)
        self.names = [check_choice(name, "outputs", known) for name in as_items(outputs, "outputs")]
        if not self.names or len(set(self.names)) < len(self.names):
            raise ArrayError(f"outputs must be one or more of {', '.join(known)}, each once, got {outputs!r}")
        patterns = check_patterns(objects, "objects")
        self.members = np.array([class_of_geoms(model, {name: 1}, "objects") == 1 for name in patterns], dtype=bool)
        """Which geoms and sites each of `objects` is, ``(objects, shapes)``."""
        self.members = self.members.reshape(len(patterns), shape_count(model))
        self.numbers, self._most_number = _numbers(model, segmentation)
        """The number of every geom and site in segmentation, and at last of none, which is shape -1."""
        self._axes = () if single else (len(self.cameras),)
        seen = [camera_from_mujoco(model, choice, width, height) for choice in self.cameras]
        self.fill, self._depths = fill, _depth_bounds(fill, seen, sensed=sensor is not None)

    @property
    def images(self) -> tuple[Output, ...]:
        """What has to be rendered."""
        wanted = {*self.names, SEGMENTATION} if len(self.members) else set(self.names)
        known: tuple[Output, ...] = ("depth", "segmentation", "reasons", "true_depth")
        return tuple(name for name in known if name in wanted)

    def members_of(self, shapes: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Say which of some geoms and sites, or of -1 for none, each of `objects` is, shape ``(objects, shapes)``."""
        return np.append(self.members, np.zeros((len(self.members), 1), dtype=bool), axis=1)[:, shapes]

    def spaces(self) -> dict[str, spaces.Space]:
        """Return the spaces of the entries."""
        size = (*self._axes, *self.shape)
        made: dict[str, spaces.Space] = {}
        if DEPTH in self.names:
            made[DEPTH] = spaces.Box(*self._depths, size, np.float32)
        if SEGMENTATION in self.names:
            made[SEGMENTATION] = spaces.Box(-1, self._most_number, size, np.int32)
        if REASONS in self.names:
            made[REASONS] = spaces.Box(0, max(Reason), size, np.uint8)
        if TRUE_DEPTH in self.names:
            made[TRUE_DEPTH] = spaces.Box(0.0, np.inf, size, np.float32)
        if len(self.members):
            made[FRACTION] = spaces.Box(0.0, 1.0, (*self._axes, len(self.members)), np.float32)
        return made

    def entries(self, images: Mapping[str, np.ndarray], *, axis: int = 0) -> dict[str, np.ndarray]:
        """Make an observation's entries, which the caller owns, of all cameras' images.

        Args:
            images: By their names, shape ``(C, ..., H, W)``: of segmentation, the geom or site of every pixel, or -1.
                Visible fractions are ``(C, ..., objects)``. What is not an entry is left out.
            axis: Where the cameras' axis goes, if there is one.
        """
        made = {name: images[name] for name in self.spaces()}
        if SEGMENTATION in made:
            made[SEGMENTATION] = self.numbers[made[SEGMENTATION]]
        return {name: (np.moveaxis(part, 0, axis) if self._axes else part[0]).copy() for name, part in made.items()}


def _numbers(model: mujoco.MjModel, segmentation: Segmentation) -> tuple[NDArray[np.int32], int]:
    if isinstance(segmentation, Mapping):
        numbers = class_of_geoms(model, segmentation, "segmentation")
        most = int(numbers.max(initial=-1))
    else:
        kind = check_choice(segmentation, "segmentation", ("geom", "body"), SceneError)
        geoms = np.r_[np.arange(model.ngeom), np.full(model.nsite, -1)]
        numbers = geoms if kind == "geom" else shape_bodies(model)
        most = (model.ngeom if kind == "geom" else model.nbody) - 1
    return np.append(numbers, -1).astype(np.int32), max(most, 0)


def _depth_bounds(fill: Fill, cameras: Sequence[AnyCamera], *, sensed: bool) -> tuple[float, float]:
    """Return the bounds of depth.

    Raises:
        ArrayError: `fill` leaves what is in no space.
    """
    far = max(camera.far for camera in cameras)
    fill = check_fill(fill)
    if fill == "inf" and sensed:
        raise ArrayError('fill="inf" leaves NaN where a sensor lost depth, which no space has: give "far" or a number')
    if isinstance(fill, str):
        return (0.0, np.inf) if fill == "inf" else (0.0, far)
    return min(fill, 0.0), max(fill, far)
