# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lenses that are not the same all around: what decentering, thin prisms and tilted sensors do to the image plane."""

from __future__ import annotations

import math
from abc import abstractmethod
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.sensors.lenses._lens import RadialLens, rays_of
from warpvis.sensors.lenses._rising import Floats

_AZIMUTHS = 720
_ANGLES = 512  # along each, up to the limit
_CHUNK = 4096
_STEPS = 40
_HALVINGS = 10
_PROGRESS = 0.99  # a step that leaves more of the error is none
_PARTS = 64  # of the way from the centre, where Newton's steps from the undistorted point fail
_TOLERANCE = 1e-10
"""By how much a point that was found may be off in the image [px]."""


class Bent(NamedTuple):
    """Where points of a plane come to lie, and the derivatives of that."""

    x: Floats
    y: Floats
    xx: Floats  # dx / dx
    xy: Floats  # dx / dy
    yx: Floats
    yy: Floats

    @property
    def determinant(self) -> Floats:
        """By how much an area grows; not above 0 where the mapping has turned back."""
        return self.xx * self.yy - self.xy * self.yx


class BentLens(RadialLens):
    """A lens that bends the plane of ``tan(angle)`` or of ``angle`` around the axis; `_radius` is its radial part.

    It maps one to one as long as the determinant of the plane's derivatives is above 0 on all of the way from the axis.
    """

    _is_flat: ClassVar[bool] = True
    """Whether the plane's radius is the angle's tangent, as of a pinhole, and not the angle itself."""

    @property
    @abstractmethod
    def is_radial(self) -> bool:
        """Whether it is the same all around the axis, since all other coefficients are 0."""

    @abstractmethod
    def _bend(self, x: Floats, y: Floats) -> Bent: ...

    @property
    def max_angle(self) -> float:
        """The angle from the axis up to which the lens maps one to one, in every direction [rad]."""
        return self._rising.end if self.is_radial else float(self._reaches.min())

    @property
    def turns_back(self) -> bool:
        """Whether it ends there because the mapping turns back."""
        return self._rising.turns if self.is_radial else bool(self._reaches.min() < self._limit)

    def _project(self, points: Floats) -> Floats:
        if self.is_radial:
            return super()._project(points)
        x, y, z = points.T
        aside = np.hypot(x, y)
        angle = np.arctan2(aside, z)
        ahead = (angle < self._limit) if self._is_flat else (aside > 0) | (z > 0)
        radius = self._plane_radius(angle)
        scale = np.where(aside > 0, radius / np.where(aside > 0, aside, 1.0), 0.0)
        scale = np.where(ahead, 1 / z if self._is_flat else scale, np.nan)
        x, y = scale * x, scale * y
        bent = self._bend(x, y)
        there = self._maps_one_to_one(x, y)
        return self._to_pixels(np.where(there, bent.x, np.nan), np.where(there, bent.y, np.nan))

    def _unproject(self, pixels: Floats) -> Floats:
        if self.is_radial:
            return super()._unproject(pixels)
        given = np.stack(self._from_pixels(pixels))
        shown = np.flatnonzero(self._may_show(*given))
        wanted = given[:, shown]
        found = self._newton(wanted, self._undistorted(wanted))
        failed = np.flatnonzero(~self._solves(found, wanted))
        if len(failed):
            found[:, failed] = self._follow(wanted[:, failed])
        x, y = np.full_like(given, np.nan)
        x[shown], y[shown] = found
        radius = np.hypot(x, y)
        return rays_of(np.arctan(radius) if self._is_flat else radius, x, y, radius)

    def _plane_radius(self, angle: Floats) -> Floats:
        return np.tan(angle) if self._is_flat else angle

    def _undistorted(self, wanted: Floats) -> Floats:
        """Invert the radial part alone; where that has turned back, begin at its end."""
        radius = np.hypot(*wanted)
        angle = self._rising.inverse(np.minimum(radius, self._rising.most * (1 - 1e-6)))
        return np.where(radius > 0, wanted * (self._plane_radius(angle) / np.where(radius > 0, radius, 1.0)), 0.0)

    def _newton(self, wanted: Floats, start: Floats) -> Floats:
        """Take Newton's steps, halved until the error falls, as long as it does."""
        found, active = start.copy(), np.arange(wanted.shape[1])
        for _ in range(_STEPS):
            at, goal = found[:, active], wanted[:, active]
            bent = self._bend(*at)
            off_x, off_y = bent.x - goal[0], bent.y - goal[1]
            error, determinant = np.hypot(off_x, off_y), bent.determinant
            step = np.stack([bent.yy * off_x - bent.xy * off_y, bent.xx * off_y - bent.yx * off_x]) / determinant
            better = np.zeros(len(active), dtype=bool)
            for halving in range(_HALVINGS):
                tried = at - step * 0.5**halving
                now = self._bend(*tried)
                falls = ~better & (np.hypot(now.x - goal[0], now.y - goal[1]) < _PROGRESS * error)
                found[:, active[falls]] = tried[:, falls]
                better |= falls
                if better.all() or (halving == 0 and (error[~better] < 1e-15).all()):
                    break
            active = active[better]
            if not len(active):
                break
        return found

    def _follow(self, wanted: Floats) -> Floats:
        """Go from the centre to the points in small parts, each from the solution of the one before."""
        found, active = np.full_like(wanted, np.nan), np.arange(wanted.shape[1])
        at = np.zeros_like(wanted)
        for part in range(1, _PARTS + 1):
            goal = wanted[:, active] * (part / _PARTS)
            at = self._newton(goal, at)
            solved = self._solves(at, goal)
            at, active = at[:, solved], active[solved]
            if not len(active):
                break
        found[:, active] = at
        return found

    def _solves(self, found: Floats, wanted: Floats) -> NDArray[np.bool_]:
        bent = self._bend(*found)
        off = np.hypot(self.fx * (bent.x - wanted[0]), self.fy * (bent.y - wanted[1]))
        solves = off <= _TOLERANCE * np.maximum(1.0, 1e-4 * np.hypot(self.fx * wanted[0], self.fy * wanted[1]))
        solves[solves] = self._maps_one_to_one(*found[:, solves])
        return solves

    def _may_show(self, x: Floats, y: Floats) -> NDArray[np.bool_]:
        """Tell which points of the image are not clearly outside of where the mapping turns back."""
        azimuth, rim = self._rim
        most = np.interp(np.arctan2(y, x), azimuth, rim, period=2 * math.pi)
        return np.hypot(x, y) <= 1.02 * most

    @cached_property
    def _rim(self) -> tuple[Floats, Floats]:
        """The image of where the mapping turns back: azimuths [rad] and radii, endless where it never does."""
        azimuth = np.arange(_AZIMUTHS) * (2 * math.pi / _AZIMUTHS)
        radius = self._plane_radius(self._reaches)
        with np.errstate(all="ignore"):
            bent = self._bend(radius * np.cos(azimuth), radius * np.sin(azimuth))
        away = np.where(self._reaches < self._limit, np.hypot(bent.x, bent.y), 1e300)
        turned = np.isfinite(away)
        return np.arctan2(bent.y, bent.x)[turned], away[turned]

    def _maps_one_to_one(self, x: Floats, y: Floats) -> NDArray[np.bool_]:
        """Tell whether the mapping has not turned back on the way from the axis to points of the plane."""
        radius = np.hypot(x, y)
        angle = np.arctan(radius) if self._is_flat else radius
        azimuth = np.nan_to_num(np.arctan2(y, x)) % (2 * math.pi)
        low = np.minimum(np.floor(azimuth / (2 * math.pi) * _AZIMUTHS).astype(int), _AZIMUTHS - 1)
        before, after = self._reaches[low], self._reaches[(low + 1) % _AZIMUTHS]
        sure = angle < 0.97 * np.minimum(before, after)
        doubtful = np.flatnonzero(~sure & (angle <= 1.03 * np.maximum(before, after)) & (angle <= self._limit))
        for first in range(0, len(doubtful), _CHUNK):
            chunk = doubtful[first : first + _CHUNK]
            sure[chunk] = self._positive(azimuth[chunk], angle[chunk]).all(axis=1)
        return sure

    def _positive(self, azimuth: Floats, most: Floats) -> NDArray[np.bool_]:
        """Tell where the determinant is above 0 on ways from the axis, each up to an angle of its own."""
        angle = most[:, None] * np.linspace(0.0, 1.0, _ANGLES + 1)[1:]
        radius = self._plane_radius(angle)
        with np.errstate(all="ignore"):
            bent = self._bend(radius * np.cos(azimuth)[:, None], radius * np.sin(azimuth)[:, None])
            return bent.determinant > 0

    @cached_property
    def _reaches(self) -> Floats:
        """The angle at which the mapping turns back, at azimuths all around [rad]."""
        azimuth = np.arange(_AZIMUTHS) * (2 * math.pi / _AZIMUTHS)
        low, high = np.zeros(_AZIMUTHS), np.full(_AZIMUTHS, self._limit)
        for _ in range(6):  # each finds the first of 512 parts of what is left
            span = high - low
            angle = low[:, None] + span[:, None] * np.linspace(0.0, 1.0, _ANGLES + 1)[1:]
            radius = self._plane_radius(angle)
            with np.errstate(all="ignore"):
                bent = self._bend(radius * np.cos(azimuth)[:, None], radius * np.sin(azimuth)[:, None])
            positive = bent.determinant > 0
            turned, first = ~positive.all(axis=1), np.argmin(positive, axis=1)
            low = np.where(turned, low + span * first / _ANGLES, high)
            high = np.where(turned, np.minimum(low + span / _ANGLES, high), high)
        return low
