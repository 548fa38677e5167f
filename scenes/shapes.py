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


def person(height: float, x: float, y: float) -> trimesh.Trimesh:
    """A standing person of capsules that faces -x: legs, trunk, arms and head; 0.3 of their height wide."""

    def limb(start: Sequence[float], end: Sequence[float], radius: float) -> trimesh.Trimesh:
        segment = height * np.array([start, end])
        capsule = trimesh.creation.capsule(
            height=float(np.linalg.norm(segment[1] - segment[0])), radius=height * radius, count=[12, 12]
        )
        capsule.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], segment[1] - segment[0]))
        capsule.apply_translation(segment.mean(axis=0))
        return capsule

    parts = [trimesh.creation.icosphere(subdivisions=2, radius=height * 0.07)]
    parts[0].apply_translation((0, 0, height * 0.93))
    parts.append(limb((0, 0, 0.55), (0, 0, 0.74), 0.085))
    parts.append(limb((0, 0, 0.8), (0, 0, 0.88), 0.035))
    for side in (-1, 1):
        parts.append(limb((0, 0.05 * side, 0.045), (0, 0.05 * side, 0.5), 0.045))
        parts.append(limb((0, 0.1 * side, 0.77), (-0.01, 0.12 * side, 0.45), 0.028))
    whole = trimesh.util.concatenate(parts)
    whole.apply_translation((x, y, 0))
    return whole


def robot(height: float, x: float, y: float) -> trimesh.Trimesh:
    """A round mobile robot, 0.4 m across, with a mast at its front that carries a camera at `height`."""
    base = trimesh.creation.cylinder(radius=0.2, height=0.3, sections=32)
    base.apply_translation((0, 0, 0.17))
    mast = trimesh.creation.box((0.04, 0.04, height - 0.32))
    mast.apply_translation((-0.02, 0, (height + 0.28) / 2))
    head = trimesh.creation.box((0.06, 0.24, 0.06))
    head.apply_translation((-0.035, 0, height))
    whole = trimesh.util.concatenate([base, mast, head])
    whole.apply_translation((x, y, 0))
    return whole
