# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes the presets are made of, in metres, z up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh


def standing_box(size: Sequence[float], x: float, y: float) -> trimesh.Trimesh:
    """A box of that size (x, y, z) that stands on the floor around (x, y)."""
    box = trimesh.creation.box(size)
    box.apply_translation((x, y, size[2] / 2))
    return box


def floor(width: float, depth: float, thickness: float = 0.02) -> trimesh.Trimesh:
    """A slab whose upper side is at height 0, around the origin."""
    slab = trimesh.creation.box((width, depth, thickness))
    slab.apply_translation((0, 0, -thickness / 2))
    return slab


def ball(diameter: float, x: float, y: float) -> trimesh.Trimesh:
    """A ball that lies on the floor at (x, y)."""
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=diameter / 2)
    sphere.apply_translation((x, y, diameter / 2))
    return sphere


PERSON_HEAD = (0.93, 0.07)
"""Height of a head's middle, and its radius: shares of a person's height."""
PERSON_LIMBS: tuple[tuple[tuple[float, float, float], tuple[float, float, float], float], ...] = (
    ((0, 0, 0.55), (0, 0, 0.74), 0.085),
    ((0, 0, 0.8), (0, 0, 0.88), 0.035),
    ((0, -0.05, 0.045), (0, -0.05, 0.5), 0.045),
    ((-0.01, -0.12, 0.45), (0, -0.1, 0.77), 0.028),
    ((0, 0.05, 0.045), (0, 0.05, 0.5), 0.045),
    ((-0.01, 0.12, 0.45), (0, 0.1, 0.77), 0.028),
)
"""Trunk, neck, and of each side leg and arm: a capsule's two ends and its radius, shares of a person's height."""


def person(height: float, x: float, y: float) -> trimesh.Trimesh:
    """A standing person of capsules that faces -x: legs, trunk, arms and head; 0.3 of their height wide."""

    def limb(start: Sequence[float], end: Sequence[float], radius: float) -> trimesh.Trimesh:
        segment = height * np.array([start, end])
        # Cut as Webots cuts a Capsule, so that the same person stands in `examples/webots`.
        capsule = trimesh.creation.capsule(
            height=float(np.linalg.norm(segment[1] - segment[0])), radius=height * radius, count=[6, 12]
        )
        capsule.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], segment[1] - segment[0]))
        capsule.apply_translation(segment.mean(axis=0))
        return capsule

    middle, radius = PERSON_HEAD
    head = trimesh.creation.icosphere(subdivisions=2, radius=height * radius)
    head.apply_translation((0, 0, height * middle))
    whole = trimesh.util.concatenate([head, *(limb(*item) for item in PERSON_LIMBS)])
    whole.apply_translation((x, y, 0))
    return whole


ROBOT_BASE = (0.2, 0.3, 0.17)
"""Radius and height of a robot's body, and the height of its middle [m]."""


def robot_boxes(height: float) -> tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...]:
    """The size and the middle of the mast and the head of a robot whose camera is at `height` [m]."""
    mast = (0.04, 0.04, height - 0.32), (-0.02, 0.0, (height + 0.28) / 2)
    return mast, ((0.06, 0.24, 0.06), (-0.035, 0.0, height))


def robot(height: float, x: float, y: float) -> trimesh.Trimesh:
    """A round mobile robot, 0.4 m across, with a mast at its front that carries a camera at `height`."""
    radius, tall, middle = ROBOT_BASE
    parts = [trimesh.creation.cylinder(radius=radius, height=tall, sections=32)]
    parts[0].apply_translation((0, 0, middle))
    for size, place in robot_boxes(height):
        parts.append(trimesh.creation.box(size))
        parts[-1].apply_translation(place)
    whole = trimesh.util.concatenate(parts)
    whole.apply_translation((x, y, 0))
    return whole
