# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes of scaled objects."""

import numpy as np
import trimesh
from pose_samples import unit

import warpvis as wv
from warpvis.scene import solids

from compare import wrong_depth
from support.worlds import MESHES

SHAPES = (
    solids.sphere(0.4),
    solids.ellipsoid((0.6, 0.2, 0.4)),
    solids.capsule(0.2, 0.5),
    solids.cylinder(0.3, 0.5),
    *MESHES[:3],
)
TURNED = unit((0, 0, 2, 0.1, 0.2, 0.3, 0.9))
# Views from inside an object, and so close that the near plane clips it.
NEAR = np.array(
    [wv.look_at((0.02, 0.01, 2.05), (1, 0.3, 2.2)), wv.look_at((0.75, 0.1, 2.1), (0, 0, 2))], dtype=np.float32
)


def build(device, poses, scales=None, *, shapes=SHAPES):
    """Return a scene with a static floor and movable objects."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((6, 6, 0.02)), name="floor", label="ground")
    for index, shape in enumerate(shapes):
        scale = (1, 1, 1) if scales is None else scales[index]
        label = ("object", "human", "robot", "obstacle")[index % 4]
        scene.add(shape, name=f"object_{index}", label=label, pose=poses[index], scale=scale, movable=True)
    return scene


def assert_alike(views, expected):
    """Check that depth agrees within tolerance, and objects exactly."""
    wrong = wrong_depth(views.depth.numpy(), expected.depth.numpy().astype(np.float64))
    assert wrong.mean() <= 1e-4
    np.testing.assert_array_equal(views.segmentation.numpy()[~wrong], expected.segmentation.numpy()[~wrong])


def random_scales(rng, *shape):
    return np.exp(rng.uniform(-0.9, 0.7, (*shape, 3)))


# Closed shapes, scale factors, and positions inside the scaled shape: outside the original shape if scaled up, outside
# the shape scaled twice if scaled down.
SURROUNDED = ((0, 3.0, 0.6), (4, 3.0, 0.6), (0, 0.5, 0.15), (4, 0.5, 0.11))


def surrounded(factor, x):
    """Return the scale of one object and a camera near its center that looks through it."""
    return [(factor,) * 3], wv.look_at((x, 0.01, 2), (-1, 0.1, 2.05))[None].astype(np.float32)
