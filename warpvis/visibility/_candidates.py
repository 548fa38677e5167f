# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Objects that a person may refer to, and the evidence for each: gaze, pointing, other people, and the last frame."""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy, as_point
from warpvis.core.checks import as_items, format_fraction, is_number
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError, SceneError
from warpvis.visibility._extents import ObjectBoxes, VisibleParts
from warpvis.visibility._reference_model import (
    Floats,
    ReferenceModel,
    log_densities,
    log_pursuit_densities,
    posterior_probabilities,
    prior_probabilities,
)


class State(enum.IntEnum):
    """Which of two agents see an object: the paper's four cases."""

    NEITHER = 0
    """Neither agent sees it."""
    FIRST = 1
    """Only the first agent sees it."""
    SECOND = 2
    """Only the second agent sees it."""
    BOTH = 3
    """Both agents see it."""


@dataclass(frozen=True)
class Candidate:
    """An object that a person sees and may refer to; ``str`` gives its name and probability, ``cup 0.71``."""

    object: str
    """Name of the object."""
    probability: float
    """Probability that the person means it rather than another candidate; see `ReferenceModel`."""
    fraction: float
    """Fraction of the object's silhouette that the person sees."""
    gaze_angle: float
    """Angle between the gaze and the nearest visible part of the object [rad], 0 if the gaze hits it."""
    pointing_angle: float | None
    """Angle between the pointing ray, or the nearest one, and the object's box, seen from the start of the ray [rad], 0
    if the ray hits it; None without a ray."""
    solid_angle: float
    """Solid angle of what the person sees of the object [sr]."""
    attended: bool
    """Whether the object is in the person's field of attention."""
    state: State | None
    """Whether the robot (first) and the person (second) see the object, as in ``states(robot, person)``: BOTH or
    SECOND; None without a robot."""
    robot_fraction: float | None
    """Fraction of the object's silhouette that the robot sees; None without a robot."""
    object_poses: NDArray[np.float32] | None = field(default=None, repr=False, compare=False)
    """Poses of the movable objects in the situation, rows ``x y z qx qy qz qw``, ``(M, 7)``; None if nothing is
    movable."""

    def __str__(self) -> str:
        return f"{self.object} {format_fraction(self.probability)}"


def choose_likeliest(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return one candidate for each object, that with the highest probability, most likely first.

    `candidates` are those of several people; among equally probable ones, the first one counts.
    """
    likeliest: dict[str, Candidate] = {}
    for item in sorted(candidates, key=lambda item: -item.probability):
        likeliest.setdefault(item.object, item)
    return list(likeliest.values())


@dataclass(frozen=True, eq=False)
class Evidence:
    """Quantities of N candidates, ``(N,)`` each; `pointing_angles` is None without a ray."""

    probabilities: Floats
    gaze_angles: Floats
    pointing_angles: Floats | None
    solid_angles: Floats


@dataclass(frozen=True, eq=False)
class Query:
    """A person, optionally a robot, and what both see of K objects in V situations."""

    objects: tuple[str, ...]
    """Names of the objects."""
    seen: NDArray[np.bool_]
    """Whether the person sees the object and it may be a candidate, ``(V, K)``."""
    fraction: NDArray[np.float32]
    """Fraction of the object's silhouette that the person sees, ``(V, K)``."""
    attended: NDArray[np.bool_]
    """Whether the object is in the person's field of attention, ``(V, K)``."""
    robot: tuple[NDArray[np.bool_], NDArray[np.float32]] | None
    """Whether the robot sees the object, and which fraction of it, ``(V, K)`` each; None without a robot."""
    object_poses: NDArray[np.float32] | None
    """Poses of the movable objects, ``(V or 1, M, 7)``; None if nothing is movable."""
    person: VisibleParts
    boxes: ObjectBoxes
    model: ReferenceModel

    def candidates(
        self,
        view: int,
        gaze: ArrayInput | None,
        pointing: ArrayInput | None,
        others: Sequence[Sequence[Candidate]],
        previous: Sequence[Candidate] | None,
        elapsed: float | None,
        pursuit: Floats | None = None,
    ) -> list[Candidate]:
        """Return the candidates of a situation, most likely first; see `Perspective.candidates`.

        `pursuit` is the change of the gaze minus that of the direction to each object, ``(K, 3)``.
        """
        found = np.flatnonzero(self.seen[view])
        names = [self.objects[k] for k in found]
        fractions = self.fraction[view, found].astype(np.float64)
        by_robot = None if self.robot is None else tuple(values[view, found] for values in self.robot)
        poses = self.object_poses
        object_poses = None if poses is None else poses[view if len(poses) > 1 else 0]
        evidence = weigh_candidates(
            self.model,
            self.person,
            self.boxes,
            found,
            view,
            fractions=fractions,
            person_only=np.zeros(len(found), dtype=bool) if by_robot is None else ~by_robot[0],
            object_poses=object_poses,
            gaze=gaze,
            pointing=pointing,
            others=parse_others(others, names),
            previous=parse_previous(previous, elapsed, names),
            pursuit=None if pursuit is None or np.isnan(pursuit[found]).any() else pursuit[found],
        )
        angles = evidence.pointing_angles
        return [
            Candidate(
                object=names[n],
                probability=float(evidence.probabilities[n]),
                fraction=float(fractions[n]),
                gaze_angle=float(evidence.gaze_angles[n]),
                pointing_angle=None if angles is None else float(angles[n]),
                solid_angle=float(evidence.solid_angles[n]),
                attended=bool(self.attended[view, found[n]]),
                state=None if by_robot is None else State.BOTH if by_robot[0][n] else State.SECOND,
                robot_fraction=None if by_robot is None else float(by_robot[1][n]),
                object_poses=object_poses,
            )
            for n in np.argsort(-evidence.probabilities, kind="stable")
        ]


def require_model(model: ReferenceModel | None) -> ReferenceModel:
    """Return the model, or the default one for None."""
    if model is None:
        return ReferenceModel()
    if not isinstance(model, ReferenceModel):
        raise SceneError(f"model must be a warpvis.visibility.ReferenceModel, got {type(model).__name__}")
    return model


def parse_gaze(gaze: ArrayInput | None, axis: Floats, model: ReferenceModel) -> tuple[Floats, float]:
    """Return the gaze as a unit vector, and its standard deviation [rad]: those of the head for None."""
    if gaze is None:
        return axis, model.head_sigma
    direction = as_point(gaze, "gaze")
    length = np.linalg.norm(direction)
    if length == 0:
        raise ArrayError("gaze must be a direction in the world, three numbers that are not all 0, got [0, 0, 0]")
    direction = direction / length
    angle = math.atan2(float(np.linalg.norm(np.cross(axis, direction))), float(axis @ direction))
    if angle > model.max_eye_angle:
        raise ArrayError(
            f"gaze must be within {math.degrees(model.max_eye_angle):.0f} degrees of the axis of the person's pose, "
            f"got {math.degrees(angle):.0f} degrees; the pose must be the head's, and gaze a direction in the world"
        )
    return direction, model.gaze_sigma


def parse_rays(pointing: ArrayInput | None) -> Floats:
    """Return pointing rays as origins and unit vectors, ``(R, 6)``; no row for None."""
    if pointing is None:
        return np.empty((0, 6))
    rays = as_numpy(pointing, name="pointing").astype(np.float64)
    shape = rays.shape
    rays = rays[None] if rays.ndim == 1 else rays
    expected = "pointing must be rays x y z dx dy dz in the world, shape (6,) or (R, 6)"
    if rays.ndim != 2 or rays.shape[1] != 6:
        raise ArrayError(f"{expected}, got shape {shape}")
    lengths = np.linalg.norm(rays[:, 3:], axis=1, keepdims=True)
    if not np.isfinite(rays).all() or not (lengths > 0).all():
        raise ArrayError(f"{expected}, of finite numbers and directions that are not 0, got {rays.tolist()}")
    return np.hstack([rays[:, :3], rays[:, 3:] / lengths])


def parse_previous(
    previous: Sequence[Candidate] | None, elapsed: float | None, names: Sequence[str]
) -> tuple[Floats | None, float]:
    """Return the previous probabilities of the named objects, 0 for others, and the time since then [s]."""
    if previous is None:
        if elapsed is not None:
            raise ArrayError("elapsed must be given with previous, the candidates of the previous frame")
        return None, 0.0
    before = _parse_candidates(previous, "previous")
    if not is_number(elapsed) or not 0 <= elapsed < math.inf:
        raise ArrayError(f"elapsed must be the seconds since previous, a number from 0 up, got {elapsed!r}")
    return np.array([before.get(name, 0.0) for name in names]), float(elapsed)


def parse_others(others: Sequence[Sequence[Candidate]], names: Sequence[str]) -> Floats:
    """Return the probabilities that P other people attend to N named objects, ``(P, N)``."""
    people = [_parse_candidates(one, "others") for one in as_items(others, "others", SceneError)]
    return np.array([[one.get(name, 0.0) for name in names] for one in people]).reshape(len(people), len(names))


def _parse_candidates(candidates: Sequence[Candidate], name: str) -> dict[str, float]:
    """Return the probabilities of candidates by object name."""
    expected = "Candidate objects" if name == "previous" else "a list of Candidate objects for each person"
    if isinstance(candidates, Candidate | str):
        raise SceneError(f"{name} must be {expected} from Perspective.candidates, got {type(candidates).__name__}")
    items = as_items(candidates, name, SceneError)
    wrong = [type(item).__name__ for item in items if not isinstance(item, Candidate)]
    if wrong:
        raise SceneError(f"{name} must be {expected} from Perspective.candidates, got {wrong[0]}")
    return {item.object: item.probability for item in items}


def weigh_candidates(
    model: ReferenceModel,
    person: VisibleParts,
    boxes: ObjectBoxes,
    k: NDArray[np.intp],
    view: int,
    *,
    fractions: Floats,
    person_only: NDArray[np.bool_],
    object_poses: NDArray[np.float32] | None,
    gaze: ArrayInput | None,
    pointing: ArrayInput | None,
    others: Floats,
    previous: tuple[Floats | None, float],
    pursuit: Floats | None = None,
) -> Evidence:
    """Return the probabilities of N candidates with indices `k`, and what they are computed from.

    `pursuit` is the change of the gaze minus that of the direction to each candidate, ``(N, 3)``.
    """
    eyes, axis = person.axis(view)
    direction, sigma = parse_gaze(gaze, axis, model)
    rays = parse_rays(pointing)
    if not len(k):
        return Evidence(*(np.empty(0),) * 4)
    seen = person.measure(k, view, direction)
    if seen is None:
        seen = boxes.measure(k, object_poses, eyes, direction)
        seen = replace(seen, solid_angles=seen.solid_angles * fractions)
    before, elapsed = previous
    of_gaze = of_hold = 1.0
    if before is not None:
        of_gaze = min(1.0, elapsed / model.fixation) if model.fixation > 0 else 1.0
        of_hold = min(1.0, elapsed * model.switch_rate)
    log_density = (of_hold if gaze is None else of_gaze) * log_densities(model, direction, seen, sigma)
    pointing_angles = None
    for ray in rays:
        extents = boxes.measure(k, object_poses, ray[:3], ray[3:])
        log_density += of_hold * log_densities(model, ray[3:], extents, model.pointing_sigma)
        pointing_angles = extents.angles if pointing_angles is None else np.minimum(pointing_angles, extents.angles)
    if pursuit is not None:
        log_density += of_gaze * log_pursuit_densities(model, pursuit)
    prior = prior_probabilities(model, seen.solid_angles, person_only, others)
    probabilities = posterior_probabilities(model, prior, log_density, before, elapsed)
    return Evidence(probabilities, seen.angles, pointing_angles, seen.solid_angles)
