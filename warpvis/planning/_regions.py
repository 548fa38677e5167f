# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Regions of camera poses and of object poses, as functions of uniform random numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy, as_point, check_length
from warpvis.core.checks import degrees_hint, is_number
from warpvis.core.poses import check_up, poses_to_matrices, quaternion_product
from warpvis.errors import ArrayError, SceneError
from warpvis.planning._best_views import look_along
from warpvis.planning._check_constraints import place_objects
from warpvis.planning._free_space import one_world
from warpvis.scene import Scene
from warpvis.scene.worlds import pose_columns

Range = tuple[float, float]
Floats: TypeAlias = NDArray[np.float64]

# Horizontal distance relative to the vertical one, below which a camera looks straight up or down.
_STEEP = 1e-6

# Height above its support at which an object is tested for overlaps, because it touches the support [m].
_LIFT = 1e-3


@dataclass(frozen=True)
class BoxRegion:
    """Camera positions that are uniform in a box; the cameras look at a target."""

    bounds: ArrayLike
    """Lower and upper corner of the box in the world [m], ``(2, 3)``; its extents may be 0."""
    look_at: str | ArrayLike
    """Name of an object, for the center of its box wherever it is, or a point [m], ``(3,)``."""
    jitter: float = 0.0
    """The cameras look at a point up to this far from the target along each axis of the world [m]."""
    roll: Range = (0.0, 0.0)
    """Range of rotations about the viewing direction, clockwise as seen by the camera [rad]."""

    dimensions: ClassVar[int] = 7

    def __post_init__(self) -> None:
        _set(self, "bounds", _check_box(self.bounds, "bounds"))
        _check_target(self, self.look_at, "look_at")

    def place(self, numbers: Floats, targets: Floats, vertical: int) -> Floats:
        """Return poses ``(n, 7)`` from uniform numbers ``(n, 7)`` and targets ``(n, 3)``."""
        low, high = np.asarray(self.bounds)
        places = low + numbers[:, :3] * (high - low)
        return _look(places, targets, numbers[:, 3:], self.jitter, self.roll, vertical)


@dataclass(frozen=True)
class ShellRegion:
    """Camera positions between two spheres around a target that they look at; directions are uniform."""

    target: str | ArrayLike
    """Name of an object, for the center of its box wherever it is, or a point [m], ``(3,)``."""
    distance: Range
    """Range of distances from the target [m]; with `height`, of horizontal distances."""
    azimuth: Range = (-math.pi, math.pi)
    """Range of azimuths as seen from the target [rad], counterclockwise from the floor's first axis (x where z is up, z
    where y is up)."""
    elevation: Range = (0.0, math.pi / 3)
    """Range of elevations as seen from the target [rad]; ignored with `height`."""
    height: Range | None = None
    """Range of heights above the target [m], instead of elevations."""
    jitter: float = 0.0
    """As for `BoxRegion`."""
    roll: Range = (0.0, 0.0)
    """As for `BoxRegion`."""

    dimensions: ClassVar[int] = 7

    def __post_init__(self) -> None:
        _check_target(self, self.target, "target")
        _set(self, "distance", _check_range(self.distance, "distance", 0.0))
        if self.distance[1] <= 0:
            raise ArrayError(f"distance must reach above 0 m, got {self.distance}")
        _set(self, "azimuth", _check_range(self.azimuth, "azimuth", -2 * math.pi, 2 * math.pi))
        _set(self, "elevation", _check_range(self.elevation, "elevation", -math.pi / 2, math.pi / 2))
        if self.height is not None:
            _set(self, "height", _check_range(self.height, "height"))

    def place(self, numbers: Floats, targets: Floats, vertical: int) -> Floats:
        """Return poses ``(n, 7)`` from uniform numbers ``(n, 7)`` and targets ``(n, 3)``."""
        distance = _between(self.distance, numbers[:, 0])
        azimuth = _between(self.azimuth, numbers[:, 1])
        if self.height is None:
            low, high = (math.sin(angle) for angle in self.elevation)
            sine = low + numbers[:, 2] * (high - low)
            across, above = distance * np.sqrt(np.maximum(0.0, 1 - sine * sine)), distance * sine
        else:
            across, above = distance, _between(self.height, numbers[:, 2])
        places = targets.copy()
        places[:, (vertical + 1) % 3] += across * np.cos(azimuth)
        places[:, (vertical + 2) % 3] += across * np.sin(azimuth)
        places[:, vertical] += above
        return _look(places, targets, numbers[:, 3:], self.jitter, self.roll, vertical)


@dataclass(frozen=True)
class SupportRegion:
    """Positions of an object that stands on the top of a box; it keeps its initial tilt."""

    support: str | ArrayLike
    """Name of the object that it stands on, for the axis-aligned box of it in the world, or the box [m], ``(2, 3)``."""
    margin: float = 0.0
    """Minimum distance of the object's box from the edges of the top [m]."""
    yaw: Range = (0.0, 2 * math.pi)
    """Range of rotations about the vertical axis, relative to its initial pose [rad]."""

    dimensions: ClassVar[int] = 3

    def __post_init__(self) -> None:
        if not isinstance(self.support, str):
            _set(self, "support", _check_box(self.support, "support"))
        check_length(self.margin, "margin")
        _set(self, "yaw", _check_range(self.yaw, "yaw", -2 * math.pi, 2 * math.pi))


@dataclass(frozen=True, eq=False)
class MovedObject:
    """A movable object and the region in which it is placed."""

    name: str
    region: SupportRegion
    column: int
    """Its column in the object poses."""
    pose: Floats
    """Its initial pose, ``(7,)``."""
    box: Floats
    """Lower and upper corner of its box and of what is attached to it, in its frame [m], ``(2, 3)``."""
    lowest: float
    """Height of its lowest point above its origin at the initial pose [m]."""
    top: Floats
    """Lower and upper corner of the box that it stands on [m], ``(2, 3)``."""
    vertical: int

    @classmethod
    def parse(cls, scene: Scene, name: str, region: SupportRegion, rows: NDArray[np.float32]) -> MovedObject:
        """Check that the object can be moved; `rows` are the poses of the movable objects, ``(M, 7)``."""
        index = scene.index(name)
        item = scene.objects[index]
        if item.pose is None:
            if item.parent is None:
                raise SceneError(f"move must have movable objects, but {name!r} is static; add it with movable=True")
            parent = scene.objects[item.parent].name
            raise SceneError(
                f"move must have movable objects, but {name!r} is attached to {parent!r} and moves with it; "
                f"move {parent!r}"
            )
        if not isinstance(region, SupportRegion):
            raise ArrayError(f"move must have a SupportRegion for {name!r}, got {region!r}")
        attached = [child for child, parent in scene.attached().items() if parent == index]
        vertices = np.concatenate([scene.objects[i].frame_vertices for i in (index, *attached)]).astype(np.float64)
        column, vertical = int(pose_columns(scene)[index]), check_up(scene.up)
        pose = rows[column].astype(np.float64)
        lowest = float((vertices @ poses_to_matrices(pose)[vertical, :3]).min())
        top = region.support
        if isinstance(top, str):
            corners = one_world(scene, rows[None], None)[0][scene.index(top)]
            top = np.stack([corners.min(axis=0), corners.max(axis=0)])
        box = np.stack([vertices.min(axis=0), vertices.max(axis=0)])
        return cls(name, region, column, pose, box, lowest, np.asarray(top, dtype=np.float64), vertical)

    def place(self, numbers: Floats) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Return poses ``(n, 7)`` from uniform numbers ``(n, 3)``, and where the object's box fits on the support."""
        half = _between(self.region.yaw, numbers[:, 2]) / 2
        turns = np.zeros((len(numbers), 4))
        turns[:, self.vertical], turns[:, 3] = np.sin(half), np.cos(half)
        rows = np.zeros((len(numbers), 7))
        rows[:, 3:] = quaternion_product(turns, self.pose[3:])
        offsets = poses_to_matrices(rows)[:, :3, :3] @ _box_corners(self.box).T  # (n, 3, 8)
        margin = self.region.margin
        low, high = self.top[0] + margin - offsets.min(axis=2), self.top[1] - margin - offsets.max(axis=2)
        axes = [(self.vertical + 1) % 3, (self.vertical + 2) % 3]
        rows[:, axes] = low[:, axes] + numbers[:, :2] * (high - low)[:, axes]
        rows[:, self.vertical] = self.top[1, self.vertical] - self.lowest
        return rows.astype(np.float32), (low <= high)[:, axes].all(axis=1)

    def boxes(self, rows: NDArray[np.float32]) -> tuple[Floats, Floats, Floats]:
        """Return centers ``(n, 3)``, rotations ``(n, 3, 3)`` and half extents ``(3,)`` of its box, lifted."""
        matrices = poses_to_matrices(rows[:, self.column])
        low, high = self.box
        centers = matrices[:, :3, :3] @ ((low + high) / 2) + matrices[:, :3, 3]
        centers[:, self.vertical] += _LIFT
        return centers, matrices[:, :3, :3], (high - low) / 2


def _box_corners(box: Floats) -> Floats:
    """Return the corners of a box from its lower and upper one, ``(8, 3)``."""
    return np.stack(np.meshgrid(*box.T, indexing="ij"), axis=-1).reshape(8, 3)


def find_targets(scene: Scene, target: str | ArrayLike, rows: NDArray[np.float32]) -> Floats:
    """Return the target of a region in each of V worlds [m], ``(V, 3)``; poses of movable objects are ``(V, M, 7)``."""
    if isinstance(target, str):
        return np.array(place_objects(scene, [scene.index(target)], rows)[0])
    return np.tile(np.asarray(target, dtype=np.float64), (len(rows), 1))


def _look(places: Floats, targets: Floats, numbers: Floats, jitter: float, roll: Range, vertical: int) -> Floats:
    """Return poses that look at targets, from uniform numbers ``(n, 4)`` for the jitter and the roll."""
    forward = targets + (2 * numbers[:, :3] - 1) * jitter - places
    axes = [(vertical + 1) % 3, (vertical + 2) % 3]
    steep = np.linalg.norm(forward[:, axes], axis=1) <= _STEEP * np.abs(forward[:, vertical])
    forward[steep, axes[0]] += _STEEP * np.maximum(np.abs(forward[steep, vertical]), 1.0)
    rows = look_along(places, forward, vertical)
    half = _between(roll, numbers[:, 3]) / 2
    turns = np.zeros((len(rows), 4))
    turns[:, 2], turns[:, 3] = np.sin(half), np.cos(half)
    rows[:, 3:] = quaternion_product(rows[:, 3:], turns)
    return rows


def _between(limits: Range, numbers: Floats) -> Floats:
    return limits[0] + numbers * (limits[1] - limits[0])


def _check_target(region: BoxRegion | ShellRegion, target: str | ArrayLike, name: str) -> None:
    """Check what the cameras of a region look at, the jitter and the roll."""
    if not isinstance(target, str):
        _set(region, name, tuple(as_point(target, name).tolist()))
    check_length(region.jitter, "jitter")
    _set(region, "roll", _check_range(region.roll, "roll", -2 * math.pi, 2 * math.pi))


def _check_box(value: ArrayLike, name: str) -> Floats:
    corners = as_numpy(value, name=name).astype(np.float64)
    if corners.shape != (2, 3) or not np.isfinite(corners).all() or (corners[1] < corners[0]).any():
        raise ArrayError(f"{name} must be the lower and upper corner of a box, shape (2, 3), got {corners.tolist()}")
    return corners


def _check_range(value: object, name: str, low: float = -math.inf, high: float = math.inf) -> Range:
    """Check a minimum and a maximum within limits; those with an upper limit are angles."""
    units, is_angle = ("radians", True) if high < math.inf else ("meters", False)
    items = value if isinstance(value, Sequence | np.ndarray) and not isinstance(value, str | bytes) else ()
    if len(items) != 2 or not all(is_number(item) and math.isfinite(item) for item in items):
        raise ArrayError(f"{name} must be a minimum and a maximum in {units}, got {value!r}")
    for item in items:
        if not low <= item <= high:
            limits = f"{low:.6g} to {high:.6g}" if is_angle else f"{low:g} up"
            hint = degrees_hint(item) if is_angle else ""
            raise ArrayError(f"{name} must be from {limits} {units}, got {item!r}{hint}")
    if items[0] > items[1]:
        raise ArrayError(f"{name} must have its minimum first, got {value!r}")
    return float(items[0]), float(items[1])


def _set(instance: object, name: str, value: object) -> None:
    object.__setattr__(instance, name, value)
