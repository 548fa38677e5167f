# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of BOP's ``scene_camera.json``, nerfstudio's ``transforms.json``, and COLMAP's models.

Formats: https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md,
https://docs.nerf.studio/quickstart/data_conventions.html, https://colmap.github.io/format.html
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import truncate
from warpvis.core.poses import poses_to_matrices
from warpvis.core.types import Json
from warpvis.core.user_warnings import warn_user
from warpvis.errors import FileFormatError
from warpvis.io._files import as_numbers, shorten
from warpvis.io.cameras._colmap import colmap_camera, colmap_images
from warpvis.io.cameras._json import bop_images_camera, nerfstudio_camera
from warpvis.io.cameras._making import camera_of_poses
from warpvis.io.poses._file_poses import FilePoses

_MILLIMETERS = 1000.0

FILES = ("images.txt", "images.bin")
"""File names of images in COLMAP models."""


def parse_bop(path: Path, data: Json) -> FilePoses:
    """Read poses in the order of image ids, which are the timestamps."""
    if not isinstance(data, dict):
        raise FileFormatError(f"{path}: must be an object of images by their ids, got {shorten(data)}")
    keys = _keys_by_id(path, data)
    images = sorted(keys)
    rotations, translations = np.empty((len(images), 3, 3)), np.empty((len(images), 3))
    for index, image in enumerate(images):
        camera = data[keys[image]]
        entry = camera if isinstance(camera, dict) else {}
        missing = [name for name in ("cam_R_w2c", "cam_t_w2c") if name not in entry]
        if missing:
            raise FileFormatError(f"{path}: image {image} has no {' and no '.join(missing)}, so no pose")
        rotation = as_numbers(entry["cam_R_w2c"], (9,), f"{path}: cam_R_w2c of image {image}")
        rotations[index] = rotation.reshape(3, 3)
        translations[index] = as_numbers(entry["cam_t_w2c"], (3,), f"{path}: cam_t_w2c of image {image}")
    poses = _inverse(rotations, translations / _MILLIMETERS)
    times = np.array(images, dtype=np.float64)
    camera = bop_images_camera(path, data)
    return FilePoses(poses, lambda index: f"{path}: image {images[index]}", timestamps=times, camera=camera)


def _keys_by_id(path: Path, data: dict[str, Json]) -> dict[int, str]:
    keys: dict[int, str] = {}
    for key in data:
        if not (key.isascii() and key.isdigit() and len(key) < 16):
            raise FileFormatError(f"{path}: image ids must be whole numbers, got {shorten(key)}")
        if int(key) in keys:
            raise FileFormatError(f"{path}: image {int(key)} occurs twice, as {keys[int(key)]!r} and {key!r}")
        keys[int(key)] = key
    return keys


def parse_nerfstudio(path: Path, data: Json, *, distortion: bool = False) -> FilePoses:
    """Read the poses of the file's ``frames``, in the file's order and world frame."""
    if isinstance(data, dict) and "frames" not in data:
        raise FileFormatError(f'{path}: has no list "frames", which holds the poses of nerfstudio\'s files')
    frames = data.get("frames") if isinstance(data, dict) else data
    if not isinstance(data, dict) or not isinstance(frames, list):
        raise FileFormatError(f'{path}: must be an object with a list "frames", got {shorten(frames)}')
    poses = np.empty((len(frames), 4, 4))
    for index, frame in enumerate(frames):
        if not isinstance(frame, dict) or "transform_matrix" not in frame:
            raise FileFormatError(f'{path}: frame {index} must be an object with a "transform_matrix"')
        poses[index] = as_numbers(frame["transform_matrix"], (4, 4), f"{path}: transform_matrix of frame {index}")
    shutters = [entry.get("rolling_shutter") for entry in (data, *frames)]
    if any(isinstance(shutter, list) and any(shutter) for shutter in shutters):
        warn_user(
            f"{path}: rolling_shutter is not read: each frame has the one pose of its transform_matrix", UserWarning
        )
    camera = camera_of_poses(lambda: nerfstudio_camera(path, data, distortion=distortion))
    return FilePoses(poses, lambda index: f"{path}: frame {index}", "opengl", camera=camera)


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
    poses = _inverse(rotations, translations)
    cameras_file = path.with_name("cameras" + path.suffix)
    used = {image.camera for image in images}
    camera = None
    if images and cameras_file.is_file():
        camera = camera_of_poses(lambda: colmap_camera(cameras_file, used, distortion=distortion))
    return FilePoses(poses, lambda index: f"{path}: image {truncate(images[index].name)!r}", camera=camera)


def _inverse(rotations: NDArray[np.float64], translations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert poses world to camera, to matrices ``(n, 4, 4)``; overflow is reported with the frames."""
    poses = np.tile(np.eye(4), (len(rotations), 1, 1))
    poses[:, :3, :3] = rotations.swapaxes(1, 2)
    with np.errstate(over="ignore", invalid="ignore"):
        poses[:, :3, 3] = -np.einsum("nji,nj->ni", rotations, translations)
    return poses
