# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A desk, and cameras that view its objects."""

import numpy as np
import trimesh
from pose_samples import unit

import warpvis as wv

COUNTS = ("visible_pixels", "image_pixels", "silhouette_pixels", "too_near_pixels", "too_far_pixels")


def desk(device="cpu"):
    """Return a floor, a wall, static and movable objects, attached objects and round objects."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((6, 6, 0.02)), name="floor", label="ground")
    scene.add(trimesh.creation.box((0.05, 1.5, 0.8)), name="wall", pose=(1.0, 0.6, 0.4, 0, 0, 0, 1))
    scene.add(
        trimesh.creation.icosphere(subdivisions=2, radius=0.3),
        name="ball",
        label="object",
        pose=(1.6, 0, 0.3, 0, 0, 0, 1),
    )
    scene.add(trimesh.creation.torus(0.3, 0.1, 16, 8), name="ring", pose=(0.6, -0.4, 0.5, 0.5, 0.5, 0.5, 0.5))
    scene.add(
        trimesh.creation.box((0.2, 0.3, 0.4)), name="cart", movable=True, pose=unit((0.3, 0.7, 0.2, 0, 0, 0.38, 0.92))
    )
    scene.add(trimesh.creation.box((0.1, 0.1, 0.6)), name="mast", attach_to="cart", pose=(0.3, 0.7, 0.7, 0, 0, 0, 1))
    scene.add(
        wv.scene.solids.capsule(0.15, 0.4), name="arm", movable=True, pose=unit((0.9, 0.1, 0.6, 0.3, 0.1, 0, 0.95))
    )
    scene.add(trimesh.creation.box((0.02, 0.3, 0.3)), name="sheet", pose=(1.29, 0, 0.3, 0, 0, 0, 1))
    return scene


def room(seed, count=8, device="cpu"):
    """Return a floor with objects at random places, half of them movable."""
    rng, scene = np.random.default_rng(seed), wv.Scene(device=device)
    scene.add(trimesh.creation.box((4, 4, 0.1)), name="floor", pose=(0, 0, -0.05, 0, 0, 0, 1))
    for number in range(count):
        turn = rng.normal(size=4)
        kind = number % 4
        shape = (
            trimesh.creation.box(rng.uniform(0.1, 0.6, 3)),
            trimesh.creation.icosphere(1, rng.uniform(0.05, 0.3)),
            trimesh.creation.cylinder(rng.uniform(0.05, 0.2), rng.uniform(0.1, 0.6), sections=12),
            wv.scene.solids.sphere(rng.uniform(0.05, 0.3)),
        )[kind]
        place = (*rng.uniform(-1, 1, 2), rng.uniform(0.1, 0.8), *(turn / np.linalg.norm(turn)))
        scene.add(shape, name=f"thing {number}", movable=kind == 3 or number % 2 == 0, pose=place)
    return scene, rng


def cameras():
    places = [
        ((-2, 0, 1.0), (1, 0, 0.3)),
        ((0.3, -2.5, 0.4), (0.8, 0, 0.4)),
        ((-0.4, 0.2, 0.5), (0.9, 0.6, 0.4)),
        ((3, 2, 2), (1, 0, 0)),
    ]
    return np.array([wv.look_at(eye, target) for eye, target in places], dtype=np.float32)
