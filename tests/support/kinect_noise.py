# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes for Kinect noise models."""

import math

import trimesh

import warpvis as wv

from support.stereo import box

CAMERA = wv.Camera.from_fov(96, 72, hfov=1.0, near=0.5, far=3.0)
OUTPUTS = ("depth", "reasons", "true_depth", "normals")


def make_scene(device="cpu"):
    """Return a floor, a wall, a ball in front of it, an object too near, and sky."""
    scene = wv.Scene(device=device)
    box(scene, "floor", (8, 6, 0.1), (0, 1, -0.05))
    box(scene, "wall", (2.0, 0.1, 1.2), (-0.5, 2.8, 0.6))
    scene.add(trimesh.creation.icosphere(3, radius=0.3), name="ball", pose=(-0.2, 1.8, 0.3, 0, 0, 0, 1))
    box(scene, "post", (0.02, 0.02, 2.0), (0.15, 0.35, 0.0))
    return scene


def wall(distance, angle=0.0, device="cpu"):
    """Return a wall at a distance on the optical axis, rotated about the vertical by an angle [deg]."""
    scene = wv.Scene(device=device)
    half = math.radians(angle) / 2
    scene.add(trimesh.Trimesh([[-60, 0, -60], [60, 0, -60], [60, 0, 60], [-60, 0, 60]], [[0, 1, 2], [0, 2, 3]]),
              name="wall", pose=(0, distance, 0, 0, 0, math.sin(half), math.cos(half)))  # fmt: skip
    return scene


def images(views, names=OUTPUTS):
    return {name: getattr(views, name).numpy() for name in names}
