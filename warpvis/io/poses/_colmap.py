# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of COLMAP's models: ``images.txt`` or ``images.bin``, world to camera, OpenCV axes.

Format: https://colmap.github.io/format.html
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from warpvis.core.checks import truncate
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import FileFormatError
from warpvis.io.cameras._colmap import colmap_camera, colmap_images, colmap_lens_camera
from warpvis.io.cameras._pinhole import camera_of_poses
from warpvis.io.poses._file_poses import FilePoses

FILES = ("images.txt", "images.bin")
"""File names of images in COLMAP models."""


def read_colmap(path: Path, *, distortion: bool = False) -> FilePoses:
    """Read the poses of a model's images, sorted by the images' names, and their camera if they share one."""
    images = colmap_images(path)
    turns = np.array([image.rotation for image in images]).reshape(-1, 4)
    lengths = np.linalg.norm(turns, axis=1, keepdims=True)
    bad = np.flatnonzero(~(lengths[:, 0] > 0) | ~np.isfinite(lengths[:, 0]))
    if len(bad):
        raise FileFormatError(f"{path}: image {truncate(images[bad[0]].name)!r} has no rotation")
    world_to_camera = np.zeros((len(images), 7))
    world_to_camera[:, 3:] = (turns / lengths)[:, [1, 2, 3, 0]]
    rotations = poses_to_matrices(world_to_camera)[:, :3, :3]
    translations = np.array([image.translation for image in images]).reshape(-1, 3)
    poses = np.tile(np.eye(4), (len(images), 1, 1))
    poses[:, :3, :3] = rotations.swapaxes(1, 2)
    with np.errstate(over="ignore", invalid="ignore"):  # overflow is reported with the frames
        poses[:, :3, 3] = -np.einsum("nji,nj->ni", rotations, translations)
    cameras_file = path.with_name("cameras" + path.suffix)
    used = {image.camera for image in images}
    read = colmap_lens_camera if distortion else colmap_camera
    camera = camera_of_poses(lambda: read(cameras_file, used)) if images and cameras_file.is_file() else None
    return FilePoses(poses, lambda index: f"{path}: image {truncate(images[index].name)!r}", camera=camera)
