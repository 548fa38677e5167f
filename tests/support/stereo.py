# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes for stereo cameras, which tests of other depth cameras share."""

import numpy as np
import trimesh

import warpvis as wv
from warpvis.sensors import StereoDepth

CAMERA = wv.Camera.from_fov(160, 120, hfov=1.2, near=0.4, far=4.0)
OUTPUTS = ("depth", "reasons", "true_depth", "normals", "segmentation")
FULL = StereoDepth(
    0.06,
    max_disparity=20.0,
    sigma=0.1,
    noise_spacing=3,
    subpixel=8,
    locking=0.05,
    edge_window=5,
    edge_step=0.5,
    min_support=0.7,
    min_signal=0.05,
    full_signal=0.3,
    reflectivity={"ball": 0.15, "box": 0.5},
    dropout=0.02,
)


def box(scene, name, size, place):
    scene.add(trimesh.creation.box(size), name=name, pose=(*place, 0, 0, 0, 1))


def make_scene(device="cpu"):
    """Return a floor, a wall, a box and a ball in front of it, a post below the minimum range, and sky."""
    scene = wv.Scene(device=device)
    box(scene, "floor", (8, 8, 0.1), (0, 2, -0.05))
    box(scene, "wall", (3.0, 0.1, 1.2), (-0.5, 3.5, 0.6))
    box(scene, "box", (0.5, 0.5, 0.5), (0.3, 1.6, 0.25))
    scene.add(trimesh.creation.icosphere(3, radius=0.3), name="ball", pose=(-0.5, 2.0, 0.3, 0, 0, 0, 1))
    box(scene, "post", (0.02, 0.02, 2.0), (0.15, 0.35, 0.0))
    return scene


POSES = np.stack([wv.look_at((x, 0, 0.7), (0.3 * x, 2, 0.5)) for x in (-0.4, 0.0, 0.3)])


def wall_scene(*depths_and_sizes, device="cpu"):
    """Return upright plates in front of a camera along y: distance and half width, from the center to the right."""
    scene = wv.Scene(device=device)
    for number, (distance, left, right) in enumerate(depths_and_sizes):
        width = right - left
        box(scene, f"plate {number}", (width, 0.02, 8.0), ((left + right) / 2, distance + 0.01, 0))
    return scene


AHEAD = wv.look_at((0, 0, 0), (0, 1, 0))


def images(views, names=OUTPUTS):
    return {name: getattr(views, name).numpy() for name in names}
