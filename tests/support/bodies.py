# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth of intersection between the solids of bodies."""

import numpy as np

from warpvis.core.poses import poses_to_matrices
from warpvis.situations.people._skeleton import PARENTS
from warpvis.situations.people._solids import make_pieces


def surface_points(solid):
    """Return points on the true surface of a ball or capsule, and just as far inside."""
    count = 14
    angle = np.linspace(0, 2 * np.pi, 2 * count, endpoint=False)
    height = np.linspace(-np.pi / 2, np.pi / 2, count)
    a, b = (grid.ravel() for grid in np.meshgrid(angle, height))
    unit = np.stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)], axis=1)
    shifts = np.linspace(-solid.half, solid.half, 7 if solid.half else 1)
    return np.concatenate([unit + [0, 0, shift] for shift in shifts]) * solid.radii


def depth_inside(solid, points):
    """Return about how far points are inside a solid [m]; negative outside."""
    unit = points / solid.radii
    unit[:, 2] -= np.clip(unit[:, 2], -solid.half, solid.half)
    length = np.linalg.norm(unit, axis=1)
    return (1 - length) * solid.radii.min()


def penetration(first, second):
    """Return the greatest depth of one placed solid in another [m]; each is a solid and its matrix."""
    worst = -np.inf
    for (inner, inner_pose), (outer, outer_pose) in ((first, second), (second, first)):
        to_outer = np.linalg.inv(outer_pose) @ inner_pose
        points = surface_points(inner) @ to_outer[:3, :3].T + to_outer[:3, 3]
        worst = max(worst, depth_inside(outer, points).max())
    return worst


def placed(person, world=0):
    """Return the solids of a person with their matrices, and their segments."""
    pieces = make_pieces(person.body)
    return list(zip(pieces, poses_to_matrices(person.object_poses()[world]), strict=True))


def steps_between(first, second):
    """Return the number of joints between two segments."""

    def chain(segment):
        found = [segment]
        while PARENTS[found[-1]] is not None:
            found.append(PARENTS[found[-1]])
        return found

    ups, downs = chain(first), chain(second)
    common = next(segment for segment in ups if segment in downs)
    return ups.index(common) + downs.index(common)


def self_penetrations(person):
    """Return the depths of solids in each other by pair and number of joints between them [m]."""
    parts = placed(person)
    found = {}
    for i, (one, at) in enumerate(parts):
        for other, there in parts[i + 1 :]:
            if one.segment != other.segment:
                depth = penetration((one.solid, at), (other.solid, there))
                found[one.name, other.name] = (steps_between(one.segment, other.segment), depth)
    return found
