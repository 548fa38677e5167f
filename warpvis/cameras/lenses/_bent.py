# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lenses without rotational symmetry: decentering, thin prisms and tilted sensors."""

from __future__ import annotations

import math
from abc import abstractmethod
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.lenses._lens import Floats, RadialLens, radial_jacobian, rays_of

_AZIMUTHS = 720
_ANGLES = 512  # per azimuth, up to the limit
_CHUNK = 4096
_STEPS = 40
_HALVINGS = 10
_PROGRESS = 0.99  # a Newton step is accepted only if it reduces the error by this factor
_PARTS = 64  # continuation steps from the center, used where Newton's method from the undistorted point fails
_PIXEL_TOLERANCE = 1e-10
"""Maximum reprojection error of a solution [px]."""


class Bent(NamedTuple):
    """Distorted points of a plane, and the Jacobian of the distortion."""

    x: Floats
    y: Floats
    xx: Floats  # dx / dx
    xy: Floats  # dx / dy
    yx: Floats
    yy: Floats

    @property
    def determinant(self) -> Floats:
        """Determinant of the Jacobian; positive until the mapping turns back."""
        return self.xx * self.yy - self.xy * self.yx


class BentLens(RadialLens):
    """A lens that distorts a plane whose radius is a function of the angle; `_radius` is its radial part.

    A point is in the injective domain if the determinant of the Jacobian is positive all the way from the axis to it.
    """

    _is_flat: ClassVar[bool] = True
    """Whether the radius in the plane is the tangent of the angle, as in a pinhole camera, or else the angle itself."""
    _has_rim: ClassVar[bool] = False
    """Whether the image ends at the limit of the angle even if the mapping does not turn back before."""

    @property
    @abstractmethod
    def is_radial(self) -> bool:
        """Whether the lens is rotationally symmetric because all other coefficients are 0."""

    @abstractmethod
    def _bend(self, x: Floats, y: Floats) -> Bent: ...

    @abstractmethod
    def _bend_slopes(self, x: Floats, y: Floats) -> Floats:
        """Return derivatives of the bent points for all parameters after ``fx fy cx cy``, shape ``(n, 2, C)``."""

    def _plane_slopes(self, angle: Floats) -> tuple[Floats, Floats]:
        """Return derivatives of `_plane_radius` for the angle, ``(n,)``, and parameters as above, ``(n, 1 or C)``."""
        slope = 1 / np.cos(angle) ** 2 if self._is_flat else np.ones_like(angle)
        return slope, np.zeros((len(angle), 1))

    def _direction_jacobian(self, pixels: Floats, directions: Floats) -> Floats:
        sine = np.hypot(directions[:, 0], directions[:, 1])
        angle = np.arctan2(sine, directions[:, 2])
        scale = np.where(sine > 0, self._plane_radius(angle) / np.where(sine > 0, sine, 1.0), 0.0)
        x, y = scale * directions[:, 0], scale * directions[:, 1]
        # At a fixed pixel, J dx + (derivative of the bent point) = (derivative of the point of the pixel).
        off = np.concatenate([self._intrinsic_slopes(pixels), -self._bend_slopes(x, y)], axis=2)
        bent = Bent(*(part[:, None] for part in self._bend(x, y)))
        solved = bent.yy * off[:, 0] - bent.xy * off[:, 1], bent.xx * off[:, 1] - bent.yx * off[:, 0]
        moved = np.stack(solved, axis=1) / bent.determinant[:, None]
        slope, widened = self._plane_slopes(angle)
        widened = np.concatenate([np.zeros((len(angle), 4)), widened + np.zeros(off[:, 0, 4:].shape)], axis=1)
        return radial_jacobian(angle, x, y, slope, moved, widened)

    @property
    def max_angle(self) -> float:
        """Angle from the axis up to which the lens is injective, at every azimuth [rad]."""
        return self._rising.end if self.is_radial else float(self._turning_angles.min())

    @property
    def turns_back(self) -> bool:
        """Whether the mapping turns back at `max_angle`."""
        return self._rising.turns if self.is_radial else bool(self._turning_angles.min() < self._limit)

    def _project(self, points: Floats) -> Floats:
        if self.is_radial:
            return super()._project(points)
        x, y, z = points.T
        sine_radius = np.hypot(x, y)
        angle = np.arctan2(sine_radius, z)
        ahead = (angle < self._limit) & (self._is_flat | (sine_radius > 0) | (z > 0))
        radius = self._plane_radius(angle)
        scale = np.where(sine_radius > 0, radius / np.where(sine_radius > 0, sine_radius, 1.0), 0.0)
        scale = np.where(ahead, 1 / z if self._is_flat else scale, np.nan)
        x, y = scale * x, scale * y
        bent = self._bend(x, y)
        injective = self._is_injective(x, y)
        return self._to_pixels(np.where(injective, bent.x, np.nan), np.where(injective, bent.y, np.nan))

    def _unproject(self, pixels: Floats) -> Floats:
        if self.is_radial:
            return super()._unproject(pixels)
        targets = np.stack(self._from_pixels(pixels))
        candidates = np.flatnonzero(self._may_have_direction(*targets))
        target = targets[:, candidates]
        solution = self._newton(target, self._undistorted(target))
        failed = np.flatnonzero(~self._solves(solution, target))
        if len(failed):
            solution[:, failed] = self._continue_from_center(target[:, failed])
        x, y = np.full_like(targets, np.nan)
        x[candidates], y[candidates] = solution
        radius = np.hypot(x, y)
        return rays_of(self._plane_angle(radius), x, y, radius)

    def _plane_radius(self, angle: Floats) -> Floats:
        return np.tan(angle) if self._is_flat else angle

    def _plane_angle(self, radius: Floats) -> Floats:
        """Invert `_plane_radius`; NaN for radii beyond its range."""
        return np.arctan(radius) if self._is_flat else radius

    def _undistorted(self, target: Floats) -> Floats:
        """Invert the radial part only; use the end of its domain beyond the maximum radius."""
        radius = np.hypot(*target)
        angle = self._rising.inverse(np.minimum(radius, self._rising.max_value * (1 - 1e-6)))
        return np.where(radius > 0, target * (self._plane_radius(angle) / np.where(radius > 0, radius, 1.0)), 0.0)

    def _newton(self, target: Floats, start: Floats) -> Floats:
        """Solve for `target` by Newton's method with step halving, until the error no longer decreases."""
        solution, active = start.copy(), np.arange(target.shape[1])
        for _ in range(_STEPS):
            point, goal = solution[:, active], target[:, active]
            bent = self._bend(*point)
            off_x, off_y = bent.x - goal[0], bent.y - goal[1]
            error, determinant = np.hypot(off_x, off_y), bent.determinant
            step = np.stack([bent.yy * off_x - bent.xy * off_y, bent.xx * off_y - bent.yx * off_x]) / determinant
            better = np.zeros(len(active), dtype=bool)
            for halving in range(_HALVINGS):
                trial = point - step * 0.5**halving
                image = self._bend(*trial)
                decreases = ~better & (np.hypot(image.x - goal[0], image.y - goal[1]) < _PROGRESS * error)
                solution[:, active[decreases]] = trial[:, decreases]
                better |= decreases
                if better.all() or (halving == 0 and (error[~better] < 1e-15).all()):
                    break
            active = active[better]
            if not len(active):
                break
        return solution

    def _continue_from_center(self, target: Floats) -> Floats:
        """Solve by continuation: move the target from the center outward, starting from the previous solution."""
        solution, active = np.full_like(target, np.nan), np.arange(target.shape[1])
        point = np.zeros_like(target)
        for part in range(1, _PARTS + 1):
            goal = target[:, active] * (part / _PARTS)
            point = self._newton(goal, point)
            solved = self._solves(point, goal)
            point, active = point[:, solved], active[solved]
            if not len(active):
                break
        solution[:, active] = point
        return solution

    def _solves(self, solution: Floats, target: Floats) -> NDArray[np.bool_]:
        bent = self._bend(*solution)
        off = np.hypot(self.fx * (bent.x - target[0]), self.fy * (bent.y - target[1]))
        solves = off <= _PIXEL_TOLERANCE * np.maximum(1.0, 1e-4 * np.hypot(self.fx * target[0], self.fy * target[1]))
        solves[solves] = self._is_injective(*solution[:, solves])
        return solves

    def _may_have_direction(self, x: Floats, y: Floats) -> NDArray[np.bool_]:
        """Return which image points may be within the image of the injective domain, with a margin."""
        azimuth, rim = self._rim
        max_radius = np.interp(np.arctan2(y, x), azimuth, rim, period=2 * math.pi)
        return np.hypot(x, y) <= 1.02 * max_radius

    @cached_property
    def _rim(self) -> tuple[Floats, Floats]:
        """Image of the boundary of the injective domain: azimuths [rad] and radii; 1e300 where it never turns back."""
        azimuth = np.arange(_AZIMUTHS) * (2 * math.pi / _AZIMUTHS)
        radius = self._plane_radius(self._turning_angles)
        with np.errstate(all="ignore"):
            bent = self._bend(radius * np.cos(azimuth), radius * np.sin(azimuth))
        rim = np.where(self._has_rim | (self._turning_angles < self._limit), np.hypot(bent.x, bent.y), 1e300)
        finite = np.isfinite(rim)
        if not finite.any():  # coefficients that overflow
            return np.zeros(1), np.full(1, 1e300)
        return np.arctan2(bent.y, bent.x)[finite], rim[finite]

    def _is_injective(self, x: Floats, y: Floats) -> NDArray[np.bool_]:
        """Return whether points of the plane are in the injective domain."""
        radius = np.hypot(x, y)
        angle = self._plane_angle(radius)
        azimuth = np.nan_to_num(np.arctan2(y, x)) % (2 * math.pi)
        low = np.minimum(np.floor(azimuth / (2 * math.pi) * _AZIMUTHS).astype(int), _AZIMUTHS - 1)
        before, after = self._turning_angles[low], self._turning_angles[(low + 1) % _AZIMUTHS]
        inside = angle < 0.97 * np.minimum(before, after)
        uncertain = np.flatnonzero(~inside & (angle <= 1.03 * np.maximum(before, after)) & (angle <= self._limit))
        for first in range(0, len(uncertain), _CHUNK):
            chunk = uncertain[first : first + _CHUNK]
            inside[chunk] = self._has_positive_determinant(azimuth[chunk], angle[chunk]).all(axis=1)
        return inside

    def _has_positive_determinant(self, azimuth: Floats, max_angle: Floats) -> NDArray[np.bool_]:
        """Return where the determinant is positive, at samples from the axis to `max_angle` at each azimuth."""
        angle = max_angle[:, None] * np.linspace(0.0, 1.0, _ANGLES + 1)[1:]
        radius = self._plane_radius(angle)
        with np.errstate(all="ignore"):
            bent = self._bend(radius * np.cos(azimuth)[:, None], radius * np.sin(azimuth)[:, None])
            return bent.determinant > 0

    @cached_property
    def _turning_angles(self) -> Floats:
        """Angles at which the mapping turns back, at `_AZIMUTHS` equally spaced azimuths [rad]."""
        azimuth = np.arange(_AZIMUTHS) * (2 * math.pi / _AZIMUTHS)
        low, high = np.zeros(_AZIMUTHS), np.full(_AZIMUTHS, self._limit)
        for _ in range(6):  # each iteration narrows the interval by a factor of _ANGLES
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
