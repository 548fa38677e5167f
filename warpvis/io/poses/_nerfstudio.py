# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of nerfstudio's ``transforms.json``: camera to world, OpenGL axes, 4x4.

Format: https://docs.nerf.studio/quickstart/data_conventions.html
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from warpvis.core.types import Json
from warpvis.core.user_warnings import warn_user
from warpvis.errors import FileFormatError
from warpvis.io._files import as_numbers, shorten
from warpvis.io.cameras._json import nerfstudio_camera, nerfstudio_lens_camera
from warpvis.io.cameras._pinhole import camera_of_poses
from warpvis.io.poses._file_poses import FilePoses


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
    read = nerfstudio_lens_camera if distortion else nerfstudio_camera
    camera = camera_of_poses(lambda: read(path, data))
    return FilePoses(poses, lambda index: f"{path}: frame {index}", "opengl", camera=camera)
