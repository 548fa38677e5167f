# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Choose the floor among planes, and judge how far the choice and the fit can be trusted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from warpvis.core.checks import format_percent
from warpvis.errors import ArrayError
from warpvis.maps._floor_candidates import Array, Cells, Plane
from warpvis.maps._floor_surface import Surface, horizontal_distances

# Areas of full confidence [m^2]: tables are smaller than the first; a known height of the camera excludes tables.
_FLOOR_AREA, _KNOWN_HEIGHT_AREA = 2.0, 0.3

# Width of a floor of full confidence [m].
_FLOOR_WIDTH = 0.4

# Share of area below the plane at which the confidence is zero.
_MAX_BELOW = 0.25

# Standard deviations of the normal [rad] and of the height [m] at which the confidence is halved.
_TILT_AT_HALF, _HEIGHT_AT_HALF = math.radians(1.0), 0.02

# Heights of steps [m]; lower ones are errors of the camera.
_MIN_STEP, _MAX_STEP = 0.04, 0.4

# Confidence is multiplied by this if the floor is seen only behind a higher level, as beyond a stair or a table.
_BEHIND = 0.5

# Angle of parallel planes, and slope that is reported [rad].
_PARALLEL, _SLOPE = math.radians(10.0), math.radians(2.0)

# Angle between the normal and the image's direction up from which the confidence decreases, and at which it is zero
# [rad]: a floor seen by a camera tilted down by 60 degrees looks like a wall seen by one tilted up by 30 degrees.
_SURE_ANGLE, _NO_ANGLE = math.radians(45.0), math.radians(65.0)


@dataclass(frozen=True, eq=False)
class Prior:
    """Knowledge about the floor before the measurement."""

    up: Array
    """Direction up, shape ``(3,)``."""
    tolerance: float
    """Largest angle of the normal to `up` [rad]."""
    is_up_given: bool
    """Whether the caller gave `up`; otherwise, it is the direction up in the image."""
    height: float | None
    """Height of the camera [m]."""
    height_tolerance: float
    """Largest difference from `height` [m]."""

    @property
    def knows_height(self) -> bool:
        """Whether the height of the camera is known."""
        return self.height is not None

    def angle(self, normal: Array) -> float:
        """Return the angle between a normal and `up` [rad]."""
        return math.acos(min(1.0, float(normal @ self.up)))

    def trust(self, plane: Plane) -> float:
        """Return the factor of a plane's confidence for what is below it, and for its direction."""
        if self.knows_height:
            return 1.0
        bottom = max(0.0, 1 - plane.below / _MAX_BELOW)
        if self.is_up_given:
            return bottom
        return bottom * min(1.0, max(0.0, (_NO_ANGLE - self.angle(plane.normal)) / (_NO_ANGLE - _SURE_ANGLE)))


@dataclass(frozen=True, eq=False)
class Choice:
    """The plane with the highest score, and the best of the others that are not a part of the same floor."""

    planes: list[Plane]
    floor: Plane
    rival: Plane | None
    share: float
    """Score of the rival relative to that of the floor."""


def choose_floor(planes: list[Plane], prior: Prior) -> Choice:
    """Choose the plane with the largest area, less if other surfaces are below it, or if it may be a wall."""
    height = prior.height
    allowed = [p for p in planes if height is None or abs(p.height - height) <= prior.height_tolerance]
    if not allowed:
        heights = ", ".join(f"{plane.height:.2f}" for plane in planes)
        raise ArrayError(
            f"camera_height must be within {prior.height_tolerance:g} m of the height above a plane, got {height:g}; "
            f"planes are {heights} m below the camera"
        )
    scores = [plane.area * prior.trust(plane) for plane in allowed]
    score = max(scores)
    floor = allowed[scores.index(score)]
    rivals = [(s, plane) for s, plane in zip(scores, allowed, strict=True) if not _is_same(plane, floor)]
    second, rival = max(rivals, key=lambda pair: pair[0], default=(0.0, None))
    return Choice(planes, floor, rival, second / max(score, 1e-12))


@dataclass(frozen=True, eq=False)
class Judgment:
    """How far a floor can be trusted: `confidence` from 0 to 1, and `problems` in words, as in `FloorFit`."""

    cells: Cells
    choice: Choice
    surface: Surface
    prior: Prior

    @cached_property
    def size(self) -> float:
        """Factor of the confidence for the size of the floor."""
        area = _KNOWN_HEIGHT_AREA if self.prior.knows_height else _FLOOR_AREA
        return min(1.0, self.choice.floor.area / area) * min(1.0, self.surface.width / _FLOOR_WIDTH)

    @cached_property
    def levels(self) -> list[Plane]:
        """Other planes that are parallel to the floor."""
        limit = math.cos(_PARALLEL)
        planes = (plane for plane in self.choice.planes if plane is not self.choice.floor)
        return [plane for plane in planes if plane.normal @ self.surface.normal > limit]

    @cached_property
    def before(self) -> list[Plane]:
        """Levels in front of everything that is visible of the floor."""
        if self.prior.knows_height:
            return []
        return [level for level in self.levels if _is_behind(self.cells, self.choice.floor, level)]

    @property
    def confidence(self) -> float:
        """The product of the factors that `FloorFit.confidence` lists."""
        errors = (self.surface.tilt_sigma / _TILT_AT_HALF) ** 2 + (self.surface.height_sigma / _HEIGHT_AT_HALF) ** 2
        distinction = min(1.0, 2 * max(0.0, 1 - self.choice.share))
        order = _BEHIND if self.before else 1.0
        return float(self.size * self.prior.trust(self.choice.floor) * order * distinction / (1 + errors))

    @property
    def problems(self) -> tuple[str, ...]:
        """What may be wrong."""
        return (*self._of_levels(), *self._of_choice(), *self._of_fit())

    def _of_levels(self) -> list[str]:
        """Describe steps, and levels that may be the floor."""
        problems, floor = [], self.choice.floor
        for level in self.levels:
            rise = floor.height - level.height
            text = f"{abs(rise):.2f} m {'above' if rise > 0 else 'below'} it, {level.height:.2f} m below the camera"
            if any(level is other for other in self.before):
                problems.append(
                    f"the floor is visible only behind a level of {level.area:.2f} m^2, {text}, which may be a table, "
                    "or the floor in front of a stair; pass camera_height"
                )
            elif max(_MIN_STEP, 4 * self.surface.sigma) < abs(rise) < _MAX_STEP and level.area > 0.03 * floor.area:
                problems.append(f"there are steps or furniture: a level of {level.area:.2f} m^2 is {text}")
        return problems

    def _of_choice(self) -> list[str]:
        """Describe reasons why another plane, or none, may be the floor."""
        problems, floor, normal = [], self.choice.floor, self.surface.normal
        angle = self.prior.angle(normal)
        rival, knows_height = self.choice.rival, self.prior.knows_height
        if rival is not None and self.choice.share > 0.5:
            turn = math.degrees(math.acos(min(1.0, float(rival.normal @ normal))))
            problems.append(
                f"another plane may be the floor: {rival.height:.2f} m from the camera instead of "
                f"{self.surface.height:.2f} m, turned by {turn:.0f} degrees"
            )
        if self.prior.is_up_given and angle > _SLOPE:
            problems.append(f"the floor slopes by {math.degrees(angle):.1f} degrees against up")
        if not knows_height and not self.prior.is_up_given and angle > _SURE_ANGLE:
            problems.append(
                f"the normal is {math.degrees(angle):.0f} degrees from up in the image: it may be a wall; pass up"
            )
        if not knows_height and floor.below > 0.02:
            problems.append(f"{format_percent(floor.below)} of the area is below the plane, as for a table")
        if self.size < 0.75:
            problems.append(
                f"only {floor.area:.2f} m^2 are visible, {self.surface.width:.2f} m wide, as of a table; pass "
                "camera_height"
            )
        return problems

    def _of_fit(self) -> list[str]:
        """Describe errors of the plane."""
        problems, surface = [], self.surface
        if surface.bend > _TILT_AT_HALF / 2:
            problems.append(
                f"parts of the floor differ by {math.degrees(surface.bend):.1f} degrees, as with a camera that is not "
                "calibrated, or a floor that is not flat"
            )
        if surface.tilt_sigma > _TILT_AT_HALF / 2 or surface.height_sigma > _HEIGHT_AT_HALF / 2:
            problems.append(
                f"the standard deviation is {math.degrees(surface.tilt_sigma):.1f} degrees and "
                f"{100 * surface.height_sigma:.1f} cm at the camera"
            )
        return problems


def _is_same(plane: Plane, floor: Plane) -> bool:
    """Return whether a plane is a part of the floor that errors of the camera separate from it."""
    return plane is floor or (
        abs(plane.height - floor.height) < _MIN_STEP and float(plane.normal @ floor.normal) > math.cos(_PARALLEL / 2)
    )


def _is_behind(cells: Cells, floor: Plane, level: Plane) -> bool:
    """Return whether a large level is above the floor, and all that is visible of the floor is farther away."""
    if level.height > floor.height - _MIN_STEP or level.area < min(0.1 * floor.area, 0.3):
        return False
    nearest, farthest = (horizontal_distances(cells.centers[p.members], floor.normal) for p in (floor, level))
    return bool(np.quantile(nearest, 0.02) > np.quantile(farthest, 0.8))
