# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Groups of people that do not touch: in a circle, in a queue, and around a table."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_point
from warpvis.core.checks import check_angle, check_number
from warpvis.errors import PoseError
from warpvis.scene.solids import Solid
from warpvis.situations.people._person import Person, require_people
from warpvis.situations.people._postures import Posture, sitting
from warpvis.situations.people._solids import make_pieces, reach_of

_GAP = 0.1
"""Least distance between the boxes of two people [m]."""


def in_circle(
    people: Sequence[Person],
    *,
    center: ArrayLike = (0.0, 0.0),
    radius: float | None = None,
    start: float = 0.0,
) -> list[Person]:
    """Return people in a circle at equal angles, facing its center.

    Args:
        people: The people; their postures stay.
        center: Center on the floor, x and y [m].
        radius: Radius of the places [m]; by default 0.6 m, or what keeps the people apart.
        start: Direction of the first one from the center [rad].
    """
    found = _single(people)
    x, y = _place(center, "center")
    start = check_angle(start, "start", error=PoseError)
    boxes = [footprint(person) for person in found]
    least = _least_radius(boxes)
    if radius is None:
        radius = max(0.6, least)
    radius = check_number(radius, "radius", minimum=0.0, maximum=1e4, error=PoseError)
    if radius < least - 1e-9:
        raise PoseError(f"radius must be at least {least:.2f} m for {len(found)} people not to touch, got {radius:g}")
    angles = start + 2 * math.pi * np.arange(len(found)) / len(found)
    return [
        replace(person, pose=(x + radius * math.cos(angle), y + radius * math.sin(angle), _wrapped(angle + math.pi)))
        for person, angle in zip(found, angles, strict=True)
    ]


def in_queue(
    people: Sequence[Person], *, first: ArrayLike = (0.0, 0.0), heading: float = 0.0, spacing: float | None = None
) -> list[Person]:
    """Return people in a queue, all with the same heading.

    Args:
        people: The people, the first one at the front; their postures stay.
        first: Place of the first one, x and y [m].
        heading: Direction that all face [rad].
        spacing: Distance from one to the next [m]; by default 0.8 m, or what keeps the people apart.
    """
    found = _single(people)
    x, y = _place(first, "first")
    heading = check_angle(heading, "heading", error=PoseError)
    boxes = [footprint(person) for person in found]
    gaps = [behind[1, 0] - ahead[0, 0] + _GAP for ahead, behind in itertools.pairwise(boxes)]
    least = max(gaps, default=0.0)
    if spacing is None:
        spacing = max(0.8, least)
    spacing = check_number(spacing, "spacing", minimum=0.0, maximum=1e4, error=PoseError)
    if spacing < least - 1e-9:
        raise PoseError(f"spacing must be at least {least:.2f} m for people not to touch, got {spacing:g}")
    step = spacing * np.array([math.cos(heading), math.sin(heading)])
    places = [np.array([x, y]) - index * step for index in range(len(found))]
    return [
        replace(person, pose=(place[0], place[1], _wrapped(heading)))
        for person, place in zip(found, places, strict=True)
    ]


def at_table(
    people: Sequence[Person],
    *,
    size: ArrayLike = (1.6, 0.8),
    height: float = 0.74,
    seat_height: float = 0.45,
    center: ArrayLike = (0.0, 0.0),
    heading: float = 0.0,
) -> list[Person]:
    """Return people who sit at the long sides of a table with their hands on it, alternating between both sides.

    Args:
        people: The people; their postures are replaced.
        size: Length and width of the table [m].
        height: Height of its top [m].
        seat_height: Height of the seats [m].
        center: Center of the table, x and y [m].
        heading: Direction of its length [rad].
    """
    found = _single(people)
    x, y = _place(center, "center")
    heading = check_angle(heading, "heading", error=PoseError)
    length, width = _place(size, "size")
    if min(length, width) <= 0:
        raise PoseError(f"size must be a positive length and width [m], got {size!r}")
    posture: Posture = sitting(seat_height, table_height=height)
    seated = [replace(person, posture=posture) for person in found]
    boxes = [footprint(person) for person in seated]
    placed: list[Person] = [*seated]
    for side in (0, 1):
        members = list(range(side, len(seated), 2))
        breadths = [boxes[k][1, 1] - boxes[k][0, 1] + _GAP for k in members]
        if sum(breadths) > length + 1e-9:
            raise PoseError(
                f"size must give a length of at least {sum(breadths):.2f} m for {len(members)} people at a side, "
                f"got {length:g}"
            )
        free = (length - sum(breadths)) / max(1, len(members))
        along = -length / 2
        for k, breadth in zip(members, breadths, strict=True):
            middle = along + (breadth + free) / 2
            along += breadth + free
            # The belly is in front of the edge, and the feet are on the own side of the table.
            away = max(width / 2 + seated[k].body.measurement("waist_depth") / 2 + 0.05, boxes[k][1, 0] + 0.02)
            sign = -1 if side == 0 else 1
            across = sign * away
            turn = heading - sign * math.pi / 2
            place = (
                x + middle * math.cos(heading) - across * math.sin(heading),
                y + middle * math.sin(heading) + across * math.cos(heading),
            )
            placed[k] = replace(seated[k], pose=(*place, _wrapped(turn)))
    return placed


def footprint(person: Person) -> NDArray[np.float64]:
    """Return the box around a person on the floor, from above: minimum and maximum of x (forward) and y, ``(2, 2)``."""
    _, frames = replace(person, pose=(0.0, 0.0, 0.0), up="z").solved
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for piece in make_pieces(person.body):
        center = frames.points(piece.segment, piece.center)[0]
        rotation = (frames.rotations[piece.segment] @ piece.rotation)[0]
        extent = _extents(piece.solid, rotation)
        low = np.minimum(low, center[:2] - extent)
        high = np.maximum(high, center[:2] + extent)
    return np.stack([low, high])


def _extents(solid: Solid, rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    return reach_of(solid, rotation[:2])


def _least_radius(boxes: list[NDArray[np.float64]]) -> float:
    """Return the least radius of a circle of people facing its center that keeps neighbors apart [m]."""
    if len(boxes) == 1:
        return 0.0
    reach = max(box[1, 0] for box in boxes) + _GAP / 2
    half = max(max(-box[0, 1], box[1, 1]) for box in boxes) + _GAP / 2
    # The front corners of a person's box are within the person's sector.
    return reach + half / math.tan(math.pi / len(boxes)) if len(boxes) > 2 else reach


def _wrapped(angle: float) -> float:
    return math.remainder(angle, 2 * math.pi)


def _place(value: ArrayLike, name: str) -> tuple[float, float]:
    point = np.atleast_1d(np.asarray(value, dtype=object))
    if point.shape != (2,):
        raise PoseError(f"{name} must be two numbers [m], got {value!r}")
    x, y, _ = as_point((*point.tolist(), 0.0), name, PoseError)
    return float(x), float(y)


def _single(people: Sequence[Person]) -> list[Person]:
    found = require_people(people)
    if any(person.worlds > 1 for person in found):
        raise PoseError("people of a group must be in one world each; make a group for every world")
    if any(person.up != "z" for person in found):
        raise PoseError("people of a group must be in a world with z up")
    return found
