# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of BOP's ``scene_camera.json``: world to camera, OpenCV axes, in millimeters.

Format: https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from warpvis.core.types import Json
from warpvis.errors import FileFormatError
from warpvis.io._files import as_numbers, shorten
from warpvis.io.cameras._json import bop_images_camera
from warpvis.io.poses._file_poses import FilePoses

_MILLIMETERS = 1000.0


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
    poses = np.tile(np.eye(4), (len(images), 1, 1))
    poses[:, :3, :3] = rotations.swapaxes(1, 2)
    with np.errstate(over="ignore", invalid="ignore"):  # overflow is reported with the frames
        poses[:, :3, 3] = -np.einsum("nji,nj->ni", rotations, translations / _MILLIMETERS)
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
