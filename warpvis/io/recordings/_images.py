# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Folders of depth images with a file of poses, joined by the times or names of the images."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.frames import Frames
from warpvis.core.file_content import is_file, read_json
from warpvis.errors import FileFormatError
from warpvis.io.cameras._colmap import colmap_images
from warpvis.io.poses._frames import read_frames
from warpvis.io.recordings._datasets import color_images
from warpvis.io.recordings._found import Found, depth_images_in, existing
from warpvis.io.recordings._poses import TIME_TOLERANCE, numbers_of, poses_at, read_log, unknown_poses

_DEPTH_FOLDERS = ("depth", "depths")

# Pose files that a recording may have in its folder; the first existing one is read.
_POSE_FILES = (
    "groundtruth.txt",
    "trajectory.txt",
    "poses.txt",
    "transforms.json",
    "images.bin",
    "images.txt",
    "sparse/0/images.bin",
    "sparse/0/images.txt",
    "sparse/images.bin",
    "sparse/images.txt",
)


def read_images(path: Path, poses: Path | None) -> Found:
    """Read a folder of depth images, or with a folder ``depth``; by default in millimeters.

    Frames of COLMAP and nerfstudio are joined by the names of the images, poses with timestamps by times that are the
    names of the images [s], and other poses by order, if there is one for each image.
    """
    poses = poses or next((path / name for name in _POSE_FILES if is_file(path / name)), None)
    listed = _listed_depths(poses) if poses is not None else None
    if listed is not None and poses is not None:
        return _read_listed(poses, listed)
    folder = next((path / name for name in _DEPTH_FOLDERS if (path / name).is_dir()), path)
    depths = depth_images_in(folder)
    colors = color_images(path, depths)
    numbers = numbers_of([depth.stem for depth in depths])
    times = np.array(numbers) if numbers is not None and np.isfinite(numbers).all() else None
    if poses is None:
        return Found(depths, unknown_poses(len(depths)), colors, times)
    return join_poses(Found(depths, unknown_poses(len(depths)), colors, times), poses)


def join_poses(found: Found, poses: Path) -> Found:
    """Return the recording with the poses of a file; its camera is used if the recording has none."""
    depths, times = found.depths, found.timestamps
    if poses.suffix.lower() == ".log":
        rows = read_log(poses, len(depths))
        return _with_poses(found, rows, None, poses)
    frames = read_frames(poses, distortion=True)
    names = _image_names(poses, frames)
    if names is not None:
        by_name = {Path(name).stem: row for row, name in enumerate(names)}
        index = np.array([by_name.get(depth.stem, -1) for depth in depths])
        rows = np.where(index[:, None] >= 0, frames.camera_to_world[index], np.nan)
        problem = f"names no image as the depth images, such as {depths[0].name}"
    elif times is not None and frames.source["format"] != "npy" and _overlap(times, frames.timestamps):
        rows = poses_at(times, frames.timestamps, frames.camera_to_world)
        problem = f"has no pose within {TIME_TOLERANCE} s of the time of an image"
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


def _overlap(times: NDArray[np.float64], pose_times: NDArray[np.float64]) -> bool:
    return bool(times.min() <= pose_times.max() + TIME_TOLERANCE and pose_times.min() - TIME_TOLERANCE <= times.max())


def _image_names(poses: Path, frames: Frames) -> list[str] | None:
    """Return the names of the images of a pose file, in the order of its frames; None if it has none."""
    if frames.source["format"] == "colmap":
        return [image.name for image in colmap_images(poses)]
    if frames.source["format"] != "nerfstudio":
        return None
    return [name or "" for name in _names_of_frames(poses, "file_path")]


def _names_of_frames(poses: Path, key: str) -> list[str | None]:
    """Return a name of every frame of ``transforms.json``, None if it has none."""
    data = read_json(poses)
    entries = data.get("frames") if isinstance(data, dict) else None
    names = (
        [entry.get(key) if isinstance(entry, dict) else None for entry in entries] if isinstance(entries, list) else []
    )
    return [name if isinstance(name, str) and name else None for name in names]


def _listed_depths(poses: Path) -> list[Path] | None:
    """Return the depth images that ``transforms.json`` of nerfstudio lists, one for each frame; None if it does not."""
    if poses.suffix.lower() != ".json":
        return None
    names = _names_of_frames(poses, "depth_file_path")
    return [poses.parent / name for name in names if name] if names and all(names) else None


def _read_listed(poses: Path, listed: list[Path]) -> Found:
    """Read the frames of nerfstudio's file that names the depth images, in millimeters.

    Source: https://docs.nerf.studio/quickstart/data_conventions.html
    """
    frames = read_frames(poses, distortion=True)
    names = _names_of_frames(poses, "file_path")
    colors = [poses.parent / name if name else None for name in names]
    rows = existing(poses, listed)
    return Found(
        [listed[row] for row in rows],
        frames.camera_to_world[rows],
        [colors[row] for row in rows],
        None,
        frames.camera,
        poses.name,
    )
