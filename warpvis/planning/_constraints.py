# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Constraints on what a camera sees: ranges of visible fractions, pixels, distances and angles of objects."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import as_point
from warpvis.core.checks import as_items, check_mapping, check_whole, degrees_hint, is_number, is_whole
from warpvis.core.labels import Visibility
from warpvis.errors import ArrayError
from warpvis.scene import Scene
from warpvis.visibility import choose_objects

Bounds = tuple[float | None, float | None]
"""Minimum and maximum, both included; None for none."""

# Quantities that do not need images.
GEOMETRIC = ("distance", "angle")

_RANGES = {"fraction": 1.0, "image_fraction": 1.0, "pixels": math.inf, "distance": math.inf, "angle": math.pi}
_STATUS_NAMES = tuple(status.name.lower() for status in Visibility if status != Visibility.UNKNOWN)
_IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Constraint:
    """What must hold for one object, or a union of objects, in one view: all that is given.

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
    the world; for a union, in the frame with which all members move, else in the world."""
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

Constraints: TypeAlias = Mapping[str | tuple[str, ...], ConstraintLike | Sequence[ConstraintLike]]
"""Constraints by the names of objects; a tuple of names is constrained as one object, the union of its members."""


@dataclass(frozen=True)
class Term:
    """One condition of a constraint."""

    object: str
    """Name of the object; those of a union's members are joined by "+"."""
    members: tuple[str, ...]
    """The object, or the members of the union."""
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


def parse_constraints(scene: Scene, constraints: Constraints, name: str = "constraints") -> tuple[Term, ...]:
    """Check constraints by object, and return their conditions; raise a `SceneError` for unknown objects."""
    terms = []
    for key, value in check_mapping(constraints, name).items():
        members = (key,) if isinstance(key, str) else key
        if not isinstance(members, tuple) or not members or not all(isinstance(member, str) for member in members):
            raise ArrayError(f"{name} must have names of objects, or tuples of names, as keys, got {key!r}")
        choose_objects(scene, members)
        title = "+".join(members)
        for item in _as_constraints(value, title):
            terms += _terms_of(title, members, item)
    if not terms:
        raise ArrayError(f"{name} must have one or more objects, got none")
    return tuple(terms)


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


def _terms_of(name: str, members: tuple[str, ...], constraint: Constraint) -> list[Term]:
    terms = []
    for quantity in _RANGES:
        bounds = getattr(constraint, quantity)
        if bounds is not None:
            low, high = bounds
            low, high = -math.inf if low is None else low, math.inf if high is None else high
            direction = constraint.direction if quantity == "angle" else None
            terms.append(Term(name, members, quantity, low, high, direction=direction))
    if constraint.margin is not None:
        terms.append(Term(name, members, "margin", constraint.margin, math.inf))
    if constraint.status is not None:
        statuses: tuple[int, ...] = constraint.status  # type: ignore[assignment]
        terms.append(Term(name, members, "status", -math.inf, math.inf, statuses))
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


def _set(instance: object, name: str, value: object) -> None:
    object.__setattr__(instance, name, value)
