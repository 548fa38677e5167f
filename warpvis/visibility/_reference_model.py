# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Probability that a person means an object, from gaze, pointing, size, other people and time, in double precision."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import check_angle, check_number

_SPHERE = 4 * math.pi
_MIN_SIGMA, _MAX_SIGMA = math.radians(0.1), math.pi / 2
# Variance of fixations on an object, (1/4)^2 of its squared width, over that of evenly distributed points, 1/12 of it.
_SPREAD = 12 / 16

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ReferenceModel:
    """Parameters of the probability that a person means one of the objects that the person sees.

    For object i, the probability is proportional to ``prior_i * p(gaze | i) * p(ray | i) * ...``, with one factor for
    each pointing ray:

    - Salience is ``s_i = solid_angle_i ** salience_exponent``, times `person_only_weight` if the robot does not see the
      object, divided by the sum over all objects. `solid_angle` is that of the object's visible part.
    - The prior is ``prior_i = (1 - joint_attention) s_i + joint_attention * mean_j(q_ij + (1 - sum_k q_kj) s_i)``,
      where ``q_ij`` is the probability that the other person j attends to object i: with probability `joint_attention`,
      the person attends to what one of the others attends to. Without others, it is ``s_i``.
    - A direction has the density ``p(direction | i) = (1 - lapse) N(direction; c_i, S_i) + lapse / (4 pi)`` [1/sr]. N
      is a Gaussian in the plane tangent to the unit sphere at ``c_i``, the center of the bounding rectangles of the
      object's visible pixels, with the distance on the sphere as radius. Its covariance is ``S_i = sigma^2 I + F_i``:
      the error of the direction, and the spread of fixations on the object. People look close to the center of objects
      (preferred viewing location: Nuthmann and Henderson, Journal of Vision 10(8):20, 2010, doi:10.1167/10.8.20), which
      predicts fixations better than a uniform distribution on them (Stoll et al., Vision Research 107, 2015, 36,
      doi:10.1016/j.visres.2014.11.006). The standard deviation of ``F_i`` is a quarter of the rectangles' width and of
      their height: 95 % of fixations are within each of them. The value is a choice. A direction therefore says less
      about a wall than about a cup. For rays, the center and the extent are those of the object's box.
    - Over time, the object that is meant is the state of a hidden Markov model. In `elapsed` seconds, the person moves
      on to another object, drawn from the prior, with probability ``1 - exp(-switch_rate * elapsed)``. Errors of
      successive frames are not independent: the density of a given gaze is raised to the power
      ``min(1, elapsed / fixation)``, and those of the head's axis and of rays to ``min(1, elapsed * switch_rate)``,
      since eyes and arm deviate by the same angle as long as the person attends to the object.
    - In `Perspective.track`, the gaze also moves as the object does, as in smooth pursuit: the change of the gaze since
      the first frame within `fixation` has the density ``(1 - lapse) N(change; change of the direction to the object's
      center, pursuit_sigma^2 I) + lapse / (4 pi)``, raised to the power of the gaze.

    Angles are in radians.
    """

    head_sigma: float = math.radians(10.0)
    """Standard deviation of the gaze around the head's axis, per axis, if no gaze direction is given. In 27 people at
    their daily activities, the eyes deviated by 8.4 degrees horizontally and 11.6 vertically, 10.1 degrees in root mean
    square (Zheng et al., Investigative Ophthalmology & Visual Science 66(3):20, 2025, doi:10.1167/iovs.66.3.20)."""
    gaze_sigma: float = math.radians(9.0)
    """Standard deviation of a given gaze direction, per axis. A mean error of 11 degrees, that of gaze estimation from
    images of people who face the camera (Kellnhofer et al., Gaze360, ICCV 2019, doi:10.1109/ICCV.2019.00701), is a
    standard deviation of ``11 / sqrt(pi / 2)``, 9 degrees; with eye tracking glasses it is 1 to 2 degrees."""
    pointing_sigma: float = math.radians(5.0)
    """Standard deviation of a pointing ray, per axis. People find the targets of others' pointing to about 3 degrees
    (Bangerter and Oppenheimer, Gesture 6(1), 2006, 85, doi:10.1075/gest.6.1.05ban); 5 degrees leave room for the error
    of a tracked finger. A forearm from a general body tracker deviates more: 28 degrees on average in Bamani et al.,
    arXiv:2307.02949."""
    lapse: float = 0.05
    """Probability that a direction has nothing to do with the object that is meant. Keeps one glance from excluding an
    object, like the lapse rate of psychometric functions (Wichmann and Hill, Perception & Psychophysics 63, 2001, 1293,
    doi:10.3758/BF03194544)."""
    salience_exponent: float = 0.1
    """Exponent of the visible solid angle in the prior: 10 times as large is 1.26 times as likely. Size guides
    attention (Wolfe and Horowitz, Five factors that guide attention in visual search, 2017,
    doi:10.1038/s41562-017-0058); the value is a choice. 0 ignores sizes."""
    person_only_weight: float = 1.0
    """Weight in the prior of an object that only the person sees, relative to one that the robot sees too. Above 1 if
    people are expected to ask for what the robot does not see. Objects that the person does not see are not
    candidates."""
    max_eye_angle: float = math.radians(55.0)
    """Maximum angle between a given gaze and the head's axis: the human oculomotor range (Guitton and Volle, Journal of
    Neurophysiology 58, 1987, 427, doi:10.1152/jn.1987.58.3.427)."""
    joint_attention: float = 0.27
    """Probability that the person attends to what another person attends to, if other people are given: 27 % of people
    who pass others looking at something look there too (Gallup et al., PNAS 109, 2012, 7245,
    doi:10.1073/pnas.1116141109). More among people who work on the same thing; 0 ignores others."""
    switch_rate: float = 0.3
    """Changes of the object that is meant [1/s]: actions on an object take 3.3 s on average (Land, Mennie and Rusted,
    Perception 28, 1999, 1311, doi:10.1068/p2935)."""
    fixation: float = 0.3
    """Duration of a fixation [s]: people who view a scene move their eyes every 200 to 350 ms (Rayner and Castelhano,
    Scholarpedia 2(10):3649, 2007, doi:10.4249/scholarpedia.3649)."""
    pursuit_sigma: float = math.radians(4.0)
    """Standard deviation of the change of a given gaze within `fixation` about the change of the direction to the
    object, per axis. Below `gaze_sigma`, since a constant error of the gaze cancels: movements identify objects without
    calibration of an eye tracker (Vidal, Bulling and Gellersen, Pursuits, UbiComp 2013, doi:10.1145/2493432.2493477).
    The value is a choice."""

    def __post_init__(self) -> None:
        for name in ("head_sigma", "gaze_sigma", "pointing_sigma", "pursuit_sigma"):
            check_angle(getattr(self, name), name, minimum=_MIN_SIGMA, maximum=_MAX_SIGMA)
        check_angle(self.max_eye_angle, "max_eye_angle", minimum=0.0, maximum=math.pi)
        for name in ("lapse", "salience_exponent", "joint_attention"):
            check_number(getattr(self, name), name, minimum=0.0, maximum=1.0)
        check_number(self.person_only_weight, "person_only_weight", minimum=1e-6, maximum=1e6)
        check_number(self.switch_rate, "switch_rate", minimum=0.0)
        check_number(self.fixation, "fixation", minimum=0.0)


@dataclass(frozen=True, eq=False)
class Extents:
    """Directions in which N objects appear from a point."""

    angles: Floats
    """Angles between a given direction and the nearest directions of the objects [rad], 0 inside, ``(N,)``."""
    solid_angles: Floats
    """Solid angles [sr], ``(N,)``."""
    centers: Floats
    """Unit vectors to the centers, ``(N, 3)``."""
    covariances: Floats
    """Covariance of a unit vector to a point of the object, evenly distributed over it, ``(N, 3, 3)``."""


def prior_probabilities(
    model: ReferenceModel, solid_angles: Floats, person_only: NDArray[np.bool_], others: Floats
) -> Floats:
    """Return the prior of N objects, which sums to 1, ``(N,)``; see `ReferenceModel`.

    Args:
        model: Parameters.
        solid_angles: Solid angles of the objects' visible parts [sr], ``(N,)``.
        person_only: Whether the robot does not see the object, ``(N,)``.
        others: Probabilities that other people attend to these objects, ``(P, N)``.
    """
    weights = np.where(person_only, model.person_only_weight, 1.0) * solid_angles**model.salience_exponent
    salience = weights / weights.sum()
    if not len(others):
        return salience
    rest = np.maximum(1 - others.sum(axis=1, keepdims=True), 0)
    joint = (others + rest * salience).mean(axis=0)
    prior = (1 - model.joint_attention) * salience + model.joint_attention * joint
    return prior / prior.sum()


def log_densities(model: ReferenceModel, direction: Floats, extents: Extents, sigma: float) -> Floats:
    """Return the logarithm of a direction's density [1/sr] for N objects; see `ReferenceModel`.

    Args:
        model: Parameters.
        direction: Unit vector, ``(3,)``.
        extents: The objects as seen from the start of the direction.
        sigma: Standard deviation per axis [rad].
    """
    centers = extents.centers
    sines, cosines = np.linalg.norm(np.cross(centers, direction), axis=1), centers @ direction
    angles = np.arctan2(sines, cosines)
    # Any axis is right for a direction opposite to the center, where the tangent vanishes.
    first = np.cross(centers, np.eye(3)[np.abs(centers).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    tangents = np.stack([first, np.cross(centers, first)], axis=1)
    along = tangents @ direction
    lengths = np.linalg.norm(along, axis=1, keepdims=True)
    along = np.where(lengths > 0, along / np.where(lengths > 0, lengths, 1.0), (1.0, 0.0)) * angles[:, None]
    spread = _SPREAD * tangents @ extents.covariances @ tangents.swapaxes(1, 2) + sigma**2 * np.eye(2)
    squares = (along * np.linalg.solve(spread, along[..., None])[..., 0]).sum(axis=1)
    return _with_lapse(model, squares, np.sqrt(np.linalg.det(spread)))


def log_pursuit_densities(model: ReferenceModel, differences: Floats) -> Floats:
    """Return the logarithm of the density of a change of the gaze for N objects; see `ReferenceModel`.

    Args:
        model: Parameters.
        differences: Change of the gaze minus change of the direction to each object, ``(N, 3)``.
    """
    squares = (differences**2).sum(axis=1) / model.pursuit_sigma**2
    return _with_lapse(model, squares, np.full(len(squares), model.pursuit_sigma**2))


def _with_lapse(model: ReferenceModel, squares: Floats, area: Floats) -> Floats:
    """Return the logarithm of a Gaussian's density, at most spread over the whole sphere, mixed with lapses."""
    aimed = -0.5 * squares - np.log(np.minimum(2 * math.pi * area, _SPHERE))
    with np.errstate(divide="ignore"):  # a lapse of 0 or 1
        return np.logaddexp(np.log1p(-model.lapse) + aimed, np.log(model.lapse) - math.log(_SPHERE))


def posterior_probabilities(
    model: ReferenceModel, prior: Floats, log_density: Floats, previous: Floats | None = None, elapsed: float = 0.0
) -> Floats:
    """Return the probabilities of N objects after a frame, ``(N,)``, which sum to 1.

    Args:
        model: Parameters.
        prior: Prior of the objects, ``(N,)``.
        log_density: Logarithm of the density of all evidence of the frame, raised to its powers, ``(N,)``.
        previous: Probabilities of these objects after the last frame; None in the first frame. If their
            sum is below 1, the rest belongs to objects that are no longer candidates: the person has moved on.
        elapsed: Time since the last frame [s].
    """
    if previous is not None:
        stay = math.exp(-model.switch_rate * elapsed)
        prior = stay * previous + (1 - stay * min(1.0, previous.sum())) * prior
    with np.errstate(divide="ignore"):
        logarithm = np.log(prior) + log_density
    weights = np.exp(logarithm - logarithm.max())
    return weights / weights.sum()


def angles_to_quads(direction: Floats, quads: Floats) -> Floats:
    """Return the angles between a direction and the nearest direction of cones with four edges each [rad].

    Args:
        direction: Unit vector, ``(3,)``.
        quads: Directions of the edges, in order, of any length, ``(..., 4, 3)``; pi is returned for NaN.

    Returns:
        Angles from 0 to pi, 0 inside, ``(...)``.
    """
    here, there = quads, np.roll(quads, -1, axis=-2)
    normals = np.cross(here, there)
    sides = normals @ direction
    # All normals point inwards, or all outwards, depending on the order of the edges.
    orientation = np.sign((normals[..., 0, :] * quads[..., 2, :]).sum(axis=-1))
    inside = (orientation != 0) & (sides * orientation[..., None] >= 0).all(axis=-1)

    lengths = np.linalg.norm(normals, axis=-1)
    to_corners = np.arctan2(np.linalg.norm(np.cross(here, direction), axis=-1), here @ direction)
    to_corners = np.minimum(to_corners, np.roll(to_corners, -1, axis=-1))
    between = (np.cross(normals, here) @ direction >= 0) & (np.cross(there, normals) @ direction >= 0)
    to_circles = np.arcsin(np.clip(np.abs(sides) / np.where(lengths > 0, lengths, 1.0), 0.0, 1.0))
    angles = np.where(between & (lengths > 0), to_circles, to_corners).min(axis=-1)
    return np.where(np.isnan(angles), math.pi, np.where(inside, 0.0, angles))


def quad_solid_angles(quads: Floats) -> Floats:
    """Return the solid angles of cones with four edges [sr], ``(..., 4, 3)`` to ``(...)``; 0 for NaN.

    Sum of two triangles, by van Oosterom and Strackee, IEEE Transactions on Biomedical Engineering 30, 1983, 125.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = quads / np.linalg.norm(quads, axis=-1, keepdims=True)
    a, b, c, d = np.moveaxis(unit, -2, 0)
    return np.nan_to_num(np.abs(_signed_solid_angle(a, b, c) + _signed_solid_angle(a, c, d)))


def _signed_solid_angle(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return the signed solid angle of a triangle of unit vectors [sr]."""
    volume = (a * np.cross(b, c)).sum(axis=-1)
    cosines = (a * b).sum(axis=-1) + (b * c).sum(axis=-1) + (c * a).sum(axis=-1)
    return 2 * np.arctan2(volume, 1 + cosines)
