# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Constraints on what a camera sees: ranges of visible fractions, pixels, distances and angles of objects."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeAlias

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera, require_image_camera
from warpvis.core.arrays import as_point
from warpvis.core.checks import as_items, check_mapping, check_whole, degrees_hint, is_number, is_whole
from warpvis.core.labels import Visibility
from warpvis.core.poses import Convention, QuaternionOrder, parse_poses, poses_to_matrices, quaternion_product, to_xyzw
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, PoseLike
from warpvis.errors import ArrayError, SceneError
from warpvis.scene import Scene, require_scene
from warpvis.scene.worlds import parse_worlds, pose_columns
from warpvis.visibility import Agent, choose_objects, see_objects

Bounds = tuple[float | None, float | None]
"""Minimum and maximum, both included; None for none."""

# Quantities that do not need images.
GEOMETRIC = ("distance", "angle")

_RANGES = {"fraction": 1.0, "image_fraction": 1.0, "pixels": math.inf, "distance": math.inf, "angle": math.pi}
_STATUS_NAMES = tuple(status.name.lower() for status in Visibility if status != Visibility.UNKNOWN)
_IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Constraint:
    """What must hold for one object in one view; only what is given must hold, and all of it.

    Ranges are pairs of a minimum and a maximum, both included; None for no limit.

    Example:
        >>> hidden = Constraint(status="occluded")  # behind something, not outside the image
        >>> close = Constraint(fraction=(0.6, 1.0), pixels=(50, None), distance=(0.3, 2.0), margin=10)
    """

    fraction: Bounds | None = None
    """Visible fraction of the object's silhouette, from 0 to 1, as `ObjectVisibility.fraction`."""
    pixels: Bounds | None = None
    """Number of its visible pixels."""
    image_fraction: Bounds | None = None
    """Its visible pixels as a fraction of the image, from 0 to 1."""
    distance: Bounds | None = None
    """Distance from the camera to the center of the object's bounding box [m]."""
    angle: Bounds | None = None
    """Angle at the center of the box between `direction` and the line to the camera [rad], from 0 to pi."""
    direction: tuple[float, float, float] | None = None
    """A direction of any length, for example the normal of a screen: in the object's frame if it is movable, else in
    the world."""
    margin: int | None = None
    """Minimum distance of the box of visible pixels from the image border [px]; the object must be visible."""
    status: str | Visibility | Collection[str | Visibility] | None = None
    """Allowed status, as `ObjectVisibility.status`: ``"visible"``, ``"occluded"``, ``"too_near"``, ``"too_far"``,
    ``"out_of_view"``, a `Visibility`, or several."""

    def __post_init__(self) -> None:
        for name, largest in _RANGES.items():
            if getattr(self, name) is not None:
                _set(self, name, _check_bounds(getattr(self, name), name, largest))
        if (self.angle is None) != (self.direction is None):
            raise ArrayError("angle and direction of a constraint must be given together")
        if self.direction is not None:
            direction = as_point(self.direction, "direction")
            if not 0 < float(np.linalg.norm(direction)) < math.inf:
                raise ArrayError(f"direction must not be zero, got {direction.tolist()}")
            _set(self, "direction", tuple(direction.tolist()))
        if self.margin is not None:
            check_whole(self.margin, "margin", minimum=0)
        if self.status is not None:
            _set(self, "status", _check_status(self.status))
        if all(getattr(self, item.name) is None for item in fields(self)):
            raise ArrayError("a constraint must have at least one condition, such as fraction=(0.6, 1.0)")


ConstraintLike: TypeAlias = Constraint | Sequence[float]
"""A `Constraint`, or the range of the visible fraction."""

Constraints: TypeAlias = Mapping[str, ConstraintLike | Sequence[ConstraintLike]]
"""Constraints by the names of objects."""


@dataclass(frozen=True)
class Term:
    """One condition of a constraint."""

    object: str
    """Name of the object."""
    quantity: str
    """``"fraction"``, ``"pixels"``, ``"image_fraction"``, ``"distance"``, ``"angle"``, ``"margin"`` or ``"status"``."""
    low: float
    """Minimum; -inf for none."""
    high: float
    """Maximum; inf for none."""
    statuses: tuple[int, ...] = ()
    """Allowed `Visibility`, for ``"status"``."""
    direction: tuple[float, float, float] | None = None
    """The direction of an angle."""

    def __str__(self) -> str:
        return f"{self.quantity} of {self.object!r}"


@dataclass(frozen=True, eq=False)
class ConstraintCheck:
    """Conditions of constraints in V views, as NumPy arrays: one column for each of T conditions."""

    terms: tuple[Term, ...]
    """The conditions, in the order of the constraints."""
    values: NDArray[np.float64]
    """Measured values, ``(V, T)``: in the units of `Constraint`; a `Visibility` for a status; -inf for the margin of an
    object without a visible pixel."""
    slack: NDArray[np.float64]
    """Distance of a value to the nearer limit of its range, ``(V, T)``, in the same units: negative where the condition
    is violated, by how much. 1 or -1 for a status."""

    @property
    def satisfied(self) -> NDArray[np.bool_]:
        """Whether each condition holds, ``(V, T)``."""
        return self.slack >= 0

    @property
    def accepted(self) -> NDArray[np.bool_]:
        """Whether all conditions hold in a view, ``(V,)``."""
        return np.asarray(self.satisfied.all(axis=1))


def check_constraints(
    scene: Scene,
    camera: ImageCamera,
    camera_to_world: PoseLike,
    constraints: Constraints,
    *,
    object_poses: ObjectPoses = None,
    world_index: ArrayInput | None = None,
    exclude: Sequence[str | int] | str | None = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    threads: int | None = None,
) -> ConstraintCheck:
    """Check what many views see of objects against constraints.

    Args:
        scene: The scene.
        camera: The camera.
        camera_to_world: Poses, as for `Renderer.render`.
        constraints: For each object, by name, the range of its visible fraction, ``(0.6, 1.0)``, a `Constraint`, or a
            list of these.
        object_poses: As for `Renderer.render`.
        world_index: As for `Renderer.render`.
        exclude: Names or indices of objects that are invisible to the camera.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        threads: Number of CPU threads; by default all cores available to the process.
    """
    require_scene(scene).require_objects()
    require_image_camera(camera)
    terms = parse_constraints(scene, constraints)
    poses = parse_poses(to_xyzw(camera_to_world, quaternion, "camera_to_world"), convention=convention)
    worlds = parse_worlds(scene, len(poses), to_xyzw(object_poses, quaternion, "object_poses"), world_index, exclude)
    rows = np.zeros((len(poses), 0, 7), dtype=np.float32)
    if scene.movable:
        rows = worlds.object_poses.numpy().reshape(-1, len(scene.movable), 7)
        index = worlds.world.numpy() if worlds.world is not None and worlds.world.size else np.arange(len(poses))
        rows = rows[index % len(rows)]
    observer = Observer("camera", as_faces(camera), poses.numpy().reshape(-1, 7), terms, check_excluded(exclude))
    if not len(poses):
        return ConstraintCheck(terms, np.zeros((0, len(terms))), np.zeros((0, len(terms))))
    return observer.check(scene, rows, threads=threads)


def as_faces(camera: ImageCamera) -> tuple[Any, ...]:
    """Return the only face of a camera."""
    return Agent("camera", require_image_camera(camera), _IDENTITY).faces


@dataclass(frozen=True, eq=False)
class Observer:
    """A camera or the eyes of an agent, and their constraints."""

    name: str
    faces: tuple[Any, ...]
    """Images of the field of view, as `Agent.faces`."""
    poses: NDArray[np.float32]
    """One pose, or one for each view, OpenCV camera to world, ``(1 or V, 7)``."""
    terms: tuple[Term, ...]
    exclude: list[str | int]
    """Names or indices of the objects that it does not see."""

    def check(
        self,
        scene: Scene,
        rows: NDArray[np.float32],
        *,
        geometric: bool = True,
        visual: bool = True,
        threads: int | None = None,
    ) -> ConstraintCheck:
        """Check V views with poses of the movable objects, ``(V, M, 7)``; conditions that are left out are NaN."""
        values = np.full((len(rows), len(self.terms)), np.nan)
        seen = self._see(scene, rows, threads) if visual and self._visual else {}
        for column, term in enumerate(self.terms):
            if term.quantity in GEOMETRIC:
                if geometric:
                    values[:, column] = self._measure(scene, rows, term)
            elif visual:
                values[:, column] = seen[term.quantity][:, self._visual.index(term.object)]
        return ConstraintCheck(self.terms, values, _slack(self.terms, values))

    @property
    def _visual(self) -> list[str]:
        """Names of the objects that images are needed for."""
        return list(dict.fromkeys(term.object for term in self.terms if term.quantity not in GEOMETRIC))

    def _measure(self, scene: Scene, rows: NDArray[np.float32], term: Term) -> NDArray[np.float64]:
        """Return distances [m] or angles [rad] of one object, ``(V,)``."""
        center, rotation = place_object(scene, scene.index(term.object), rows)
        to_camera = self.poses[:, :3] - center
        if term.direction is None:
            return np.linalg.norm(to_camera, axis=-1)
        direction = np.broadcast_to(rotation @ np.array(term.direction), to_camera.shape)
        across = np.linalg.norm(np.cross(direction, to_camera), axis=-1)
        return np.arctan2(across, (direction * to_camera).sum(axis=-1))

    def _see(self, scene: Scene, rows: NDArray[np.float32], threads: int | None) -> dict[str, NDArray[Any]]:
        """Return the quantities that are measured in images, ``(V, K)`` each, summed over the agent's faces."""
        views, chosen = len(rows), choose_objects(scene, self._visual)
        worlds = parse_worlds(scene, views, rows if scene.movable else None, None, self.exclude or None)
        counts, found = np.zeros((5, views, len(chosen)), dtype=np.int64), None
        needed = any(term.quantity == "fraction" for term in self.terms)
        for face in self.faces:
            placed = np.repeat(self.poses.astype(np.float64), views // len(self.poses), axis=0)
            placed[:, 3:] = quaternion_product(placed[:, 3:], np.array(face.rotation))
            poses = wp.array(placed.astype(np.float32), dtype=wp.transform, device=scene.device)
            canvas = face.canvas if needed else (0, 0, 0, 0)
            found = see_objects(
                scene, face.camera, poses, worlds, chosen, canvas=canvas, skip_unseen=True, threads=threads
            )
            names = ("visible_pixels", "silhouette_pixels", "image_pixels", "too_near_pixels", "too_far_pixels")
            counts += np.stack([getattr(found, name).numpy() for name in names])
        assert found is not None  # there is at least one face
        visible, silhouette, image, near, far = counts
        size = sum(face.camera.width * face.camera.height for face in self.faces)
        seen = {"pixels": visible, "image_fraction": visible / size, "fraction": visible / np.maximum(silhouette, 1)}
        reasons = np.stack([image - visible - near - far, near, far])
        order = np.array([Visibility.OCCLUDED, Visibility.TOO_NEAR, Visibility.TOO_FAR])
        status = np.where(image > 0, order[reasons.argmax(axis=0)], Visibility.OUT_OF_VIEW)
        seen["status"] = np.where(visible > 0, Visibility.VISIBLE, status)
        if any(term.quantity == "margin" for term in self.terms):
            x, y, width, height = np.moveaxis(found.visible_box.numpy().astype(np.float64), -1, 0)
            camera = self.faces[0].camera
            gaps = np.stack([x, y, camera.width - x - width, camera.height - y - height])
            seen["margin"] = np.where(visible > 0, gaps.min(axis=0), -np.inf)
        return seen


def place_object(
    scene: Scene, index: int, rows: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return an object's box center [m], ``(V, 3)``, and rotation, ``(V, 3, 3)``, at poses of the movable objects.

    Boxes are aligned with the frame of a movable object, and with the world for static ones, whose rotation is the
    identity.
    """
    vertices, column = scene.objects[index].frame_vertices, int(pose_columns(scene)[index])
    middle = np.stack([vertices.min(axis=0), vertices.max(axis=0)]).astype(np.float64).mean(axis=0)
    if column < 0:
        return np.broadcast_to(middle, (len(rows), 3)), np.broadcast_to(np.eye(3), (len(rows), 3, 3))
    matrices = poses_to_matrices(rows[:, column])
    return matrices[:, :3, :3] @ middle + matrices[:, :3, 3], matrices[:, :3, :3]


def parse_constraints(scene: Scene, constraints: Constraints, name: str = "constraints") -> tuple[Term, ...]:
    """Check constraints by object, and return their conditions; raise a `SceneError` for unknown objects."""
    terms = []
    for key, value in check_mapping(constraints, name).items():
        if not isinstance(key, str):
            raise ArrayError(f"{name} must have names of objects as keys, got {key!r}")
        scene.index(key)
        for item in _as_constraints(value, key):
            terms += _terms_of(key, item)
    if not terms:
        raise ArrayError(f"{name} must have one or more objects, got none")
    return tuple(terms)


def _slack(terms: Sequence[Term], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the signed distance of values to the nearer limit; NaN for values that are NaN."""
    slack = np.empty_like(values)
    for column, term in enumerate(terms):
        value = values[:, column]
        if term.quantity == "status":
            slack[:, column] = np.where(np.isin(value, term.statuses), 1.0, -1.0)
            slack[np.isnan(value), column] = np.nan
        else:
            slack[:, column] = np.minimum(value - term.low, term.high - value)
    return slack


def _as_constraints(value: object, name: str) -> list[Constraint]:
    """Return the constraints of one object, given as a range, a `Constraint`, or a list of them."""
    if isinstance(value, Constraint):
        return [value]
    items = as_items(value, f"constraints of {name!r}")
    if len(items) == 2 and all(item is None or is_number(item) for item in items):
        try:
            return [Constraint(fraction=(items[0], items[1]))]
        except ArrayError as error:
            raise ArrayError(f"constraint of {name!r}: {error}") from None
    if not items or not all(isinstance(item, Constraint | tuple | list) for item in items):
        raise ArrayError(
            f"constraints of {name!r} must be a range such as (0.6, 1.0), a Constraint or a list of them, got {value!r}"
        )
    return [constraint for item in items for constraint in _as_constraints(item, name)]


def _terms_of(name: str, constraint: Constraint) -> list[Term]:
    terms = []
    for quantity in _RANGES:
        bounds = getattr(constraint, quantity)
        if bounds is not None:
            low, high = bounds
            low, high = -math.inf if low is None else low, math.inf if high is None else high
            direction = constraint.direction if quantity == "angle" else None
            terms.append(Term(name, quantity, low, high, direction=direction))
    if constraint.margin is not None:
        terms.append(Term(name, "margin", constraint.margin, math.inf))
    if constraint.status is not None:
        terms.append(Term(name, "status", -math.inf, math.inf, constraint.status))  # type: ignore[arg-type]
    return terms


def _check_bounds(value: object, name: str, largest: float) -> Bounds:
    """Check a range of a quantity from 0 to `largest`."""
    units = {"distance": " [m]", "angle": " [rad]", "pixels": " [px]"}.get(name, "")
    expected = f"{name} must be a range{units}, a minimum and a maximum or None"
    items = value if isinstance(value, Sequence | np.ndarray) and not isinstance(value, str | bytes) else ()
    if len(items) != 2:
        raise ArrayError(f"{expected}, got {value!r}")
    for item in items:
        if item is None:
            continue
        if not is_number(item) or math.isnan(item):
            raise ArrayError(f"{expected}, got {value!r}")
        if not 0 <= item <= largest:
            hint = degrees_hint(item) if name == "angle" else ""
            if "fraction" in name and 1 < item <= 100:
                hint = f"; for percent, pass {item / 100:g}"
            limit = "0 up" if largest == math.inf else f"0 to {largest:.6g}"
            raise ArrayError(f"{name} must be from {limit}{units}, got {item!r}{hint}")
    low, high = (None if item is None else float(item) for item in items)
    if low is not None and high is not None and low > high:
        raise ArrayError(f"{name} must have its minimum first, got {value!r}")
    return low, high


def _check_status(value: object) -> tuple[int, ...]:
    """Return the allowed `Visibility` of a constraint."""
    statuses = []
    for item in [value] if is_whole(value) else as_items(value, "status"):
        if isinstance(item, str) and item.lower() in _STATUS_NAMES:
            statuses.append(int(Visibility[item.upper()]))
        elif is_whole(item) and item in [status.value for status in Visibility if status != Visibility.UNKNOWN]:
            statuses.append(int(item))
        else:
            raise ArrayError(f"status must be one or more of {', '.join(map(repr, _STATUS_NAMES))}, got {item!r}")
    if not statuses:
        raise ArrayError("status must be one or more Visibility, got none")
    return tuple(statuses)


def check_excluded(exclude: Excluded) -> list[str | int]:
    """Return the names or indices of excluded objects."""
    items = [] if exclude is None else as_items(exclude, "exclude")
    if not all(isinstance(item, str | int | np.integer) for item in items):
        raise SceneError("exclude must be names or indices of objects, the same for all views")
    return items


def _set(instance: object, name: str, value: object) -> None:
    object.__setattr__(instance, name, value)
