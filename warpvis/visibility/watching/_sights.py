# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What an agent sees of places of interest, through a map of measured depth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import Visibility
from warpvis.core.types import ArrayInput
from warpvis.maps import OccupancyMap
from warpvis.visibility._agents import Agent
from warpvis.visibility._measured_space import MeasuredSpace, find_stop
from warpvis.visibility._points import point_visibility, point_visibility_from_depth

# Lines of sight to an object.
_LINES = 24

# Part of the radius of an object up to which lines of sight end: lines to the rim would graze it.
_INSIDE = 0.9

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Target:
    """A place of interest: a sphere, or a point with diameter 0."""

    name: str
    center: Floats
    """Center in the world [m], ``(3,)``."""
    diameter: float
    """Diameter [m]."""

    def aims(self, eye: Floats) -> Floats:
        """Return where lines of sight from an eye meet the sphere, ``(N, 3)``; the center first.

        The lines are evenly distributed over the disc that faces the eye (Vogel's spiral).
        """
        offset = self.center - eye
        distance, radius = float(np.linalg.norm(offset)), self.diameter / 2
        if radius == 0 or distance <= radius:
            return self.center[None]
        axis = offset / distance
        side = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
        side /= np.linalg.norm(side)
        index = np.arange(_LINES)
        reach, angle = _INSIDE * radius * np.sqrt(index / _LINES), index * math.pi * (3 - math.sqrt(5))
        disc = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(axis, side)
        directions = offset + reach[:, None] * disc
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        nearest = directions @ offset
        lengths = nearest - np.sqrt(np.maximum(nearest**2 - distance**2 + radius**2, 0.0))
        return eye + lengths[:, None] * directions


@dataclass(frozen=True, eq=False)
class Sight:
    """What an agent sees of a place of interest: fractions of its lines of sight, from 0 to 1, which sum to 1."""

    status: Visibility
    """State of most lines; VISIBLE if any line is."""
    visible: float
    """Fraction that reaches the place through measured free space."""
    hidden: float
    """Fraction that a measured surface blocks."""
    unknown: float
    """Fraction that no surface blocks, but that crosses space which no image has measured; for the camera, which its
    image does not measure."""
    out_of_view: float
    """Fraction outside of the field of view or range."""
    unknown_length: float
    """Mean length of unmeasured space on lines in view [m]; NaN for the camera, whose image decides."""
    stop: tuple[float, float, float] | None
    """Where a surface or unmeasured space begins on the line to the center, in the floor's world [m]; None if it is
    visible, or out of view."""


def see_in_image(targets: Sequence[Target], agent: Agent, depth: ArrayInput, tolerance: float) -> dict[str, Sight]:
    """Return what an agent with a camera sees of each target, by its depth image ``(H, W)`` alone."""
    aims = [target.aims(agent.poses[0, :3]) for target in targets]
    if not aims:
        return {}
    (face,) = agent.faces
    points = np.concatenate(aims)
    found = point_visibility_from_depth(depth, face.camera, agent.poses, points, tolerance=tolerance).numpy()[0]
    parts = np.split(found, np.cumsum([len(part) for part in aims])[:-1])
    return {
        target.name: _summarize(part, np.full(len(part), math.nan), None)
        for target, part in zip(targets, parts, strict=True)
    }


def see_through_map(targets: Sequence[Target], agent: Agent, occupancy: OccupancyMap) -> dict[str, Sight]:
    """Return what an agent sees of each target through a map, with the limits of `MeasuredSpace`."""
    eye = agent.poses[0, :3]
    aims = [target.aims(eye) for target in targets]
    if not aims:
        return {}
    points = np.concatenate(aims)
    status, shares = np.zeros(len(points), dtype=np.uint8), np.full(len(points), np.nan)
    for face in agent.faces:  # each point is in the view of at most one
        found, unmeasured = point_visibility(occupancy, face.camera, agent.face_poses(face), points, unknown=True)
        status = np.maximum(status, found.numpy()[0])
        shares = np.fmax(shares, unmeasured.numpy()[0])
    space = MeasuredSpace(occupancy)
    margins = space.eye_clearance + (space.margin or 0.0)
    lengths = shares * np.maximum(np.linalg.norm(points - eye, axis=1) - margins, 0.0)
    sights, start = {}, 0
    for target, part in zip(targets, aims, strict=True):
        rows = slice(start, start + len(part))
        stop = find_stop(space, eye, part[0], Visibility(status[start]))
        sights[target.name] = _summarize(status[rows], lengths[rows], stop)
        start += len(part)
    return sights


def _summarize(status: NDArray[np.uint8], unknown: Floats, stop: Floats | None) -> Sight:
    """Summarize the states of an object's lines of sight."""
    counts = np.bincount(status, minlength=len(Visibility)) / len(status)
    visible, hidden, unmeasured = (
        float(counts[kind]) for kind in (Visibility.VISIBLE, Visibility.OCCLUDED, Visibility.UNKNOWN)
    )
    main = Visibility.VISIBLE if visible else Visibility(int(counts.argmax()))
    mean = math.nan if np.isnan(unknown).all() else float(np.nanmean(unknown))
    x, y, z = (math.nan,) * 3 if stop is None else stop.tolist()
    place = None if stop is None else (x, y, z)
    return Sight(main, visible, hidden, unmeasured, max(0.0, 1.0 - visible - hidden - unmeasured), mean, place)
