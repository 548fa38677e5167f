# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Which place of interest a person means, from what the person may see, over time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from warpvis.core.labels import Visibility
from warpvis.core.poses import poses_to_matrices
from warpvis.visibility._agents import Agent
from warpvis.visibility._reference_model import (
    Extents,
    ReferenceModel,
    log_densities,
    posterior_probabilities,
    prior_probabilities,
)
from warpvis.visibility.watching._sights import Sight, Target

# Smallest angular radius, that of a point [rad].
_MIN_RADIUS = math.radians(0.25)


def probabilities(
    model: ReferenceModel,
    person: Agent,
    targets: Sequence[Target],
    sights: Mapping[str, Sight],
    robot: Mapping[str, Sight],
    previous: Mapping[str, float] | None,
    elapsed: float | None,
    *,
    gazing: bool = False,
) -> dict[str, float]:
    """Return the probability that a person means each place that the person sees or may see; see `ReferenceModel`.

    Args:
        model: Parameters.
        person: The person, who looks along the axis of the pose.
        targets: The places.
        sights: What the person sees, by name.
        robot: What the robot sees, by name.
        previous: Probabilities in the last frame; None in the first one.
        elapsed: Time since the last frame [s]; None if it is not known: then `previous` is ignored.
        gazing: Whether the axis is that of the eyes, rather than of the head.
    """
    shares = {item.name: sights[item.name].visible + sights[item.name].unknown for item in targets}
    seen = [item for item in targets if shares[item.name] > 0]
    if not seen:
        return {}
    extents = _extents(person, seen)
    person_only = np.array([robot[item.name].status != Visibility.VISIBLE for item in seen])
    solid_angles = extents.solid_angles * np.array([shares[item.name] for item in seen])
    prior = prior_probabilities(model, solid_angles, person_only, np.zeros((0, len(seen))))
    axis = poses_to_matrices(person.poses)[0, :3, 2]
    log_density = log_densities(model, axis, extents, model.gaze_sigma if gazing else model.head_sigma)
    if previous is None or elapsed is None:
        found = posterior_probabilities(model, prior, log_density)
    else:
        last = np.array([previous.get(item.name, 0.0) for item in seen])
        rate = 1 / max(model.fixation, 1e-9) if gazing else model.switch_rate
        power = min(1.0, elapsed * rate)
        found = posterior_probabilities(model, prior, power * log_density, last, elapsed)
    return {item.name: float(value) for item, value in zip(seen, found, strict=True)}


def _extents(person: Agent, targets: Sequence[Target]) -> Extents:
    """Return how spheres appear from a person's eyes."""
    offsets = np.array([item.center for item in targets]) - person.poses[0, :3]
    distances = np.maximum(np.linalg.norm(offsets, axis=1), 1e-9)
    centers = offsets / distances[:, None]
    sizes = np.array([item.diameter / 2 for item in targets])
    radii = np.maximum(np.arcsin(np.minimum(sizes / distances, 1.0)), _MIN_RADIUS)
    across = np.eye(3) - centers[:, :, None] * centers[:, None]
    covariances = (np.sin(radii) ** 2 / 4)[:, None, None] * across  # of a disc, evenly covered
    angles = np.maximum(person.angles_to(offsets[None] + person.poses[0, :3])[0] - radii, 0.0)
    return Extents(angles, 2 * math.pi * (1 - np.cos(radii)), centers, covariances)
