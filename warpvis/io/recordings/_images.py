# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Folders of depth images with a file of poses, joined by the times or names of the images."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.frames import Frames
from warpvis.core.file_content import is_file
from warpvis.errors import FileFormatError
from warpvis.io.poses._file_poses import FilePoses
from warpvis.io.poses._frames import COLMAP_PATHS, read_pose_file
from warpvis.io.recordings._datasets import color_images
from warpvis.io.recordings._found import Found, depth_images_in, existing
from warpvis.io.recordings._poses import TIME_TOLERANCE, numbers_of, poses_at, read_log, unknown_poses

_DEPTH_FOLDERS = ("depth", "depths")

# Maximum relative difference between the medians of the times of images and poses in other units.
_SAME_TIME = 0.01

# Pose files that a recording may have in its folder; the first existing one is read.
_POSE_FILES = ("groundtruth.txt", "trajectory.txt", "poses.txt", "transforms.json", *COLMAP_PATHS)


def read_images(path: Path, poses: Path | None) -> Found:
    """Read a folder of depth images, or with a folder ``depth``; by default in millimeters.

    Frames of COLMAP and nerfstudio are joined by the names of the images, poses with timestamps by times that are the
    names of the images [s], and other poses by order, if there is one for each image.
    """
    poses = poses or next((path / name for name in _POSE_FILES if is_file(path / name)), None)
    content = None
    if poses is not None and poses.suffix.lower() != ".log":
        content = read_pose_file(poses)
        frames, stored = content
        if stored.depth_names and all(stored.depth_names):
            return _read_listed(poses, frames, stored)
    folder = next((path / name for name in _DEPTH_FOLDERS if (path / name).is_dir()), path)
    depths = depth_images_in(folder)
    numbers = numbers_of([depth.stem for depth in depths])
    times = np.array(numbers) if numbers is not None else None
    found = Found(depths, unknown_poses(len(depths)), color_images(path, depths), times)
    return found if poses is None else join_poses(found, poses, content)


def join_poses(found: Found, poses: Path, content: tuple[Frames, FilePoses] | None = None) -> Found:
    """Return the recording with the poses of a file; its camera is used if the recording has none.

    Args:
        found: The recording.
        poses: The file.
        content: The content of the file, if it was read before.
    """
    depths, times = found.depths, found.timestamps
    if poses.suffix.lower() == ".log":
        rows = read_log(poses, len(depths))
        return _with_poses(found, rows, None, poses)
    frames, stored = content or read_pose_file(poses)
    if stored.image_names is not None:
        by_name = {Path(name).stem: row for row, name in enumerate(stored.image_names) if name}
        index = np.array([by_name.get(depth.stem, -1) for depth in depths])
        rows = np.where(index[:, None] >= 0, frames.camera_to_world[index], np.nan)
        problem = f"names no image as the depth images, such as {depths[0].name}"
    elif times is not None and frames.source["format"] != "npy" and _overlap(times, frames.timestamps):
        rows = poses_at(times, frames.timestamps, frames.camera_to_world)
        problem = f"has no pose within {TIME_TOLERANCE} s of the time of an image"
    elif times is not None and (problem := _other_unit(times, frames.timestamps)):
        raise FileFormatError(f"{poses}: {problem}")
    elif len(frames) == len(depths):
        rows, problem = frames.camera_to_world, ""
    else:
        raise FileFormatError(
            f"{poses}: must have a pose for each of the {len(depths)} depth images, or times that are those of the "
            f"images, got {len(frames)} poses from {frames.timestamps[0]:g} to {frames.timestamps[-1]:g} s"
        )
    if not np.isfinite(rows).all(axis=1).any():
        raise FileFormatError(f"{poses}: {problem}")
    return _with_poses(found, rows, frames, poses)


def _with_poses(found: Found, rows: NDArray[np.float64], frames: Frames | None, poses: Path) -> Found:
    camera, origin = found.camera, found.camera_source
    if camera is None and frames is not None and frames.camera is not None:
        camera, origin = frames.camera, poses.name
    return replace(found, camera_to_world=rows, camera=camera, camera_source=origin)


def _other_unit(times: NDArray[np.float64], pose_times: NDArray[np.float64]) -> str:
    """Return what is wrong if the times of images or poses are apparently not in seconds; else an empty string."""
    image_time, pose_time = float(np.median(times)), float(np.median(pose_times))
    for factor, unit in ((1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")):
        if abs(image_time - factor * pose_time) < _SAME_TIME * image_time:
            return f"times of images, their names, must be in seconds as those of the poses, got {unit}; rename them"
        if abs(pose_time - factor * image_time) < _SAME_TIME * pose_time:
            return f"times of poses must be in seconds as those of the images, got {unit}; divide them by {factor:g}"
    return ""


def _overlap(times: NDArray[np.float64], pose_times: NDArray[np.float64]) -> bool:
    return bool(times.min() <= pose_times.max() + TIME_TOLERANCE and pose_times.min() - TIME_TOLERANCE <= times.max())


def _read_listed(poses: Path, frames: Frames, stored: FilePoses) -> Found:
    """Return the frames of nerfstudio's file that names the depth images, in millimeters.

    Source: https://docs.nerf.studio/quickstart/data_conventions.html
    """
    listed = [poses.parent / name for name in stored.depth_names or () if name]
    colors = [poses.parent / name if name else None for name in stored.image_names or ()]
    rows = existing(poses, listed)
    return Found(
        [listed[row] for row in rows],
        frames.camera_to_world[rows],
        [colors[row] for row in rows],
        None,
        frames.camera,
        poses.name,
    )
