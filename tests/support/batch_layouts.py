# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A rendered scene, written in a format with one file per frame."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh
from PIL import Image

import warpvis as wv
from warpvis.batch import find_format, make_plan
from warpvis.batch.storage._output import ShardFiles
from warpvis.cameras.frames import Frames
from warpvis.core.threads import Crew
from warpvis.scene.lights import Light

# Asymmetric: an offset of half a pixel or swapped axes shift points by centimeters at the scene's distances.
CAMERA = wv.Camera(48, 36, fx=50.0, fy=47.0, cx=22.3, cy=19.1, near=0.5, far=6.0)
OUTPUTS = {
    "png": ("depth", "labels", "segmentation", "color", "albedo"),
    "tum": ("color", "depth"),
    "nerfstudio": ("color", "depth", "labels"),
    "colmap": ("color", "depth", "normals"),
    "ply": ("points", "normals", "color", "labels", "segmentation"),
}
FRAMES = 5
SHARD_FRAMES = 2
MILLIMETER = 1e-3


def make_scene(up="z"):
    """Return a floor, a ball and a box."""
    scene = wv.Scene(up=up)
    turn = np.eye(4) if up == "z" else np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
    for name, label, mesh, height, color in (
        ("floor", "ground", trimesh.creation.box(extents=(6, 6, 0.1)), -0.05, (0.8, 0.7, 0.5)),
        ("ball", "object", trimesh.creation.icosphere(subdivisions=2, radius=0.4), 0.4, (0.9, 0.1, 0.2)),
        ("box", "obstacle", trimesh.creation.box(extents=(0.4, 0.5, 1.2)), 0.6, (0.1, 0.4, 0.8)),
    ):
        mesh.apply_translation((0.8 if name == "ball" else -0.6 if name == "box" else 0, 0.1, height))
        mesh.apply_transform(turn)
        scene.add(mesh, name=name, label=label, appearance=color)
    scene.lights = Light("headlight", ambient=(0.3, 0.3, 0.3))
    return scene


def make_poses(up="z"):
    """Return five cameras around the scene; the last one points mostly at the sky."""
    eyes = [(2.5, 0.3, 1.1), (0.2, 2.8, 0.7), (-2.4, -1.0, 1.6), (1.0, -2.2, 0.9), (3.5, 0.0, 0.4)]
    targets = [(0, 0, 0.4)] * 4 + [(0, 0.3, 2.5)]
    if up == "y":
        eyes, targets = ([(x, z, -y) for x, y, z in points] for points in (eyes, targets))
    return np.array([wv.look_at(eye, target, up=up) for eye, target in zip(eyes, targets, strict=True)])


TIMES = [0.1, 0.2 + 1e-9, 1305031102.175304, 1305031102.2, 1305031103.0]


@pytest.fixture(scope="module")
def rendered():
    """Return scene, poses and images by the world's vertical axis."""

    def render(up):
        scene, poses = make_scene(up), make_poses(up)
        names = ("depth", "points", "normals", "labels", "segmentation", "color", "albedo")
        views = wv.render(scene, CAMERA, poses, outputs=names)
        images = {name: getattr(views, name).numpy() for name in names}
        return scene, poses, images

    return {up: render(up) for up in "zy"}


def plan_of(rendered, kind, *, up="z", outputs=None, options=None, timestamps=TIMES, **changes):
    scene, poses, _ = rendered[up]
    fields = {
        "frames": Frames.from_poses(poses, timestamps=timestamps),
        "camera": CAMERA,
        "outputs": OUTPUTS[kind] if outputs is None else outputs,
        "shard_frames": SHARD_FRAMES,
        "object_names": tuple(item.name for item in scene),
        "object_labels": tuple(int(item.label) for item in scene),
        "up": up,
        "options": options or {},
    }
    plan = make_plan(scene, CAMERA, fields["frames"], find_format("npz"))
    return dataclasses.replace(plan, **(fields | changes))


def write(folder, rendered, kind, *, up="z", threads=None, **changes):
    """Write a dataset shard by shard; return the warnings."""
    plan = plan_of(rendered, kind, up=up, **changes)
    layout = find_format(kind)(plan)
    layout.encoders = None if threads is None else Crew(threads, "encoder")
    folder.mkdir(exist_ok=True)
    files = ShardFiles(folder)
    units = []
    for shard in range(plan.shard_count):
        images = {name: image[plan.shard_slice(shard)] for name, image in rendered[up][2].items()}
        units += layout.write_shard(shard, {name: images[name] for name in plan.outputs}, files)
    units += layout.index(files) + layout.write_models(files, rendered[up][0])
    assert len(units) == len(set(units))
    written = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file()]
    assert written
    assert all(any(path.is_relative_to(unit) for unit in units) for path in written)
    return files.warnings


def bytes_of(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def frame_file(frame, suffix):
    return f"{frame // SHARD_FRAMES:06d}/{frame % SHARD_FRAMES:06d}{suffix}"


def read_image(path):
    with Image.open(path) as image:
        return image.mode, np.asarray(image)


def pixel_grid(offset):
    """Return coordinates (x, y) of all pixels, their indices + offset, shape (H, W, 2)."""
    return np.stack(np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height)), axis=-1) + offset


def seen_error(points, expected):
    """Return distances of points from the rendered ones, after checking that the same pixels are valid."""
    seen = np.isfinite(expected[..., 0])
    assert seen.any()
    assert (np.isfinite(points[..., 0]) == seen).all()
    return np.linalg.norm(points[seen] - expected[seen], axis=-1)
