# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Small batch rendering jobs."""

import hashlib
from pathlib import Path

import numpy as np
import trimesh

import warpvis as wv
from warpvis.batch import render_batch
from warpvis.cameras.frames import Frames

FORMATS = ("npz", "zarr", "png", "tum", "bop", "nerfstudio", "colmap", "ply", "ros2")
CAMERA = wv.Camera.from_fov(32, 24, hfov=1.0, near=0.3, far=4.5)


def make_scene(*, movable=False):
    """Return a scene with a floor, a box and a ball."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((6, 6, 0.1)), name="floor", label="ground")
    scene.add(trimesh.creation.box((0.5, 0.5, 1.0)), name="box", pose=(0.6, 0, 0.5, 0, 0, 0, 1))
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.4)
    scene.add(ball, name="ball", label="object", pose=(-0.5, 0.3, 0.5, 0, 0, 0, 1), movable=movable)
    return scene


def make_poses(count):
    """Return cameras on a circle that look at the center."""
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.array([wv.look_at((3 * np.cos(a), 3 * np.sin(a), 1.0), (0, 0, 0.4)) for a in angles])


def make_frames(count=20):
    return Frames.from_poses(make_poses(count), source={"generator": "circle", "seed": 3})


def run(out, *, scene=None, frames=None, camera=CAMERA, shard_frames=3, threads=2, **options):
    """Run a job of seven shards by default."""
    scene, frames = make_scene() if scene is None else scene, frames or make_frames()
    return render_batch(scene, camera, frames, out, shard_frames=shard_frames, threads=threads, **options)


def tree(folder):
    """Return the checksum of every file in a folder by name."""
    paths = sorted(path for path in Path(folder).rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}
