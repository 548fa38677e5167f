# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes with moving objects, multiple worlds, and checks of their images."""

import numpy as np
import trimesh
from pose_samples import unit

import warpvis as wv

from compare import assert_matches_reference

ALL = ("depth", "points", "normals", "labels", "segmentation")
SMALL = wv.Camera.from_fov(96, 72, hfov=0.994837, near=0.05, far=100.0)
STILL = (0, 0, 0, 0, 0, 0, 1)
OPEN_BOX = trimesh.creation.box((0.5, 0.4, 0.6))
MESHES = (
    trimesh.creation.box((0.5, 0.3, 0.7)),
    trimesh.creation.icosphere(subdivisions=2, radius=0.3),
    trimesh.creation.torus(0.35, 0.12, major_sections=12, minor_sections=8),
    (OPEN_BOX.vertices + [0.4, 0, -0.2], OPEN_BOX.faces[2:]),
    trimesh.creation.icosphere(subdivisions=2, radius=0.3),
)


def random_poses(rng, *shape, spread=1.2):
    turns = rng.normal(size=(*shape, 4))
    places = rng.uniform(-spread, spread, (*shape, 3)) + [0, 0, 0.6]
    return np.concatenate([places, turns / np.linalg.norm(turns, axis=-1, keepdims=True)], axis=-1).astype(np.float32)


def eyes(count, radius=2.8, height=1.1):
    angles = 2 * np.pi * np.arange(count) / count
    places = [(radius * np.cos(a), radius * np.sin(a), height) for a in angles]
    return np.array([wv.look_at(place, (0, 0, 0.5)) for place in places]).astype(np.float32)


def build(device, poses, *, movable, static=True, meshes=MESHES):
    """Return a scene with objects at the poses and, by default, a static floor and wall."""
    scene = wv.Scene(device=device)
    poses = iter(poses)
    for index, mesh in enumerate(meshes):
        if static and index == 0:
            scene.add(trimesh.creation.box((6, 6, 0.02)), name="floor", label="ground")
        if static and index == 2:
            scene.add(trimesh.creation.box((0.1, 1.5, 1.0)), name="wall", pose=unit((0.2, 0.1, 0.5, 0, 0, 0.3, 1)))
        label = ("object", "human", "robot", "obstacle")[index % 4]
        scene.add(mesh, name=f"moved_{index}", label=label, pose=next(poses), movable=movable)
    return scene


def far_away(rows, *gone):
    """Return the poses with some rows moved out of view, for static equivalents of excluded objects."""
    rows = np.array(rows)
    rows[..., list(gone), :] = (0, 0, -1e4, 0, 0, 0, 1)
    return rows


def assert_bits_equal(one, other):
    for name in ALL:
        if getattr(one, name) is not None:
            assert getattr(one, name).numpy().tobytes() == getattr(other, name).numpy().tobytes(), name


def view_of(views, index):
    """Return one view of several as a separate result."""
    images = {name: getattr(views, name) for name in ALL}
    return wv.Views(**{name: None if image is None else image[index : index + 1] for name, image in images.items()})


def assert_views_match_twins(views, camera, cameras, twins, **culling):
    for index, twin in enumerate(twins):
        assert_matches_reference(view_of(views, index), twin, camera, cameras[index : index + 1], **culling)
