# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes of the presets, in meters, with z up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh


def standing_box(size: Sequence[float], x: float, y: float) -> trimesh.Trimesh:
    """Build a box of the given size (x, y, z) on the floor at (x, y)."""
    box = trimesh.creation.box(size)
    box.apply_translation((x, y, size[2] / 2))
    return box


def floor(width: float, depth: float, thickness: float = 0.02) -> trimesh.Trimesh:
    """Build a slab around the origin whose upper side is at height 0."""
    slab = trimesh.creation.box((width, depth, thickness))
    slab.apply_translation((0, 0, -thickness / 2))
    return slab


def ball(diameter: float, x: float, y: float) -> trimesh.Trimesh:
    """Build a ball on the floor at (x, y)."""
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=diameter / 2)
    sphere.apply_translation((x, y, diameter / 2))
    return sphere


PERSON_HEAD = (0.93, 0.07)
"""Height of the head's center, and its radius, relative to a person's height."""
PERSON_LIMBS: tuple[tuple[tuple[float, float, float], tuple[float, float, float], float], ...] = (
    ((0, 0, 0.55), (0, 0, 0.74), 0.085),
    ((0, 0, 0.8), (0, 0, 0.88), 0.035),
    ((0, -0.05, 0.045), (0, -0.05, 0.5), 0.045),
    ((-0.01, -0.12, 0.45), (0, -0.1, 0.77), 0.028),
    ((0, 0.05, 0.045), (0, 0.05, 0.5), 0.045),
    ((-0.01, 0.12, 0.45), (0, 0.1, 0.77), 0.028),
)
"""Capsules of trunk, neck, legs and arms: two end points and radius, relative to a person's height."""


def person(height: float, x: float, y: float) -> trimesh.Trimesh:
    """Build a standing person of capsules that faces -x: legs, trunk, arms and head; 0.3 of the height wide."""

    def limb(start: Sequence[float], end: Sequence[float], radius: float) -> trimesh.Trimesh:
        segment = height * np.array([start, end])
        # Tessellated like a Webots Capsule, for the same person as in `examples/webots`.
        capsule = trimesh.creation.capsule(
            height=float(np.linalg.norm(segment[1] - segment[0])), radius=height * radius, count=[6, 12]
        )
        capsule.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], segment[1] - segment[0]))
        capsule.apply_translation(segment.mean(axis=0))
        return capsule

    middle, radius = PERSON_HEAD
    head = trimesh.creation.icosphere(subdivisions=2, radius=height * radius)
    head.apply_translation((0, 0, height * middle))
    mesh = trimesh.util.concatenate([head, *(limb(*item) for item in PERSON_LIMBS)])
    mesh.apply_translation((x, y, 0))
    return mesh


ROBOT_BASE = (0.2, 0.3, 0.17)
"""Radius and height of a robot's body, and the height of its center [m]."""


def robot_boxes(height: float) -> tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...]:
    """Return size and center of the mast and of the head of a robot whose camera is at `height` [m]."""
    mast = (0.04, 0.04, height - 0.32), (-0.02, 0.0, (height + 0.28) / 2)
    return mast, ((0.06, 0.24, 0.06), (-0.035, 0.0, height))


def robot(height: float, x: float, y: float) -> trimesh.Trimesh:
    """Build a round mobile robot, 0.4 m wide, with a mast at its front for a camera at `height` [m]."""
    radius, tall, middle = ROBOT_BASE
    parts = [trimesh.creation.cylinder(radius=radius, height=tall, sections=32)]
    parts[0].apply_translation((0, 0, middle))
    for size, place in robot_boxes(height):
        parts.append(trimesh.creation.box(size))
        parts[-1].apply_translation(place)
    mesh = trimesh.util.concatenate(parts)
    mesh.apply_translation((x, y, 0))
    return mesh
