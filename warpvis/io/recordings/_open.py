# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Opening of recordings of all supported formats."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from warpvis.cameras.image_cameras import ImageCamera, require_image_camera
from warpvis.core.checks import as_path, check_choice, check_number, check_text, check_whole
from warpvis.core.types import Json
from warpvis.errors import ArrayError, FileFormatError
from warpvis.io._bag_files import BAG_SUFFIXES, is_bag
from warpvis.io.recordings._bags import read_bag_images
from warpvis.io.recordings._datasets import (
    read_icl,
    read_redwood,
    read_scannet,
    read_seven_scenes,
    read_tum,
    seven_scenes_folder,
)
from warpvis.io.recordings._found import Found
from warpvis.io.recordings._images import join_poses, read_images
from warpvis.io.recordings._lerobot import is_lerobot, read_lerobot
from warpvis.io.recordings._recording import Recording

RecordingFormat = Literal["tum", "icl", "7scenes", "scannet", "redwood", "images", "ros", "lerobot"]

# Formats of options that are for these only, and their name in a message.
_OPTIONS = {
    "topic": (("ros", "lerobot"), "bags and LeRobot datasets"),
    "world_frame": (("ros",), "bags"),
    "episode": (("lerobot",), "LeRobot datasets"),
}


def open_recording(
    path: str | os.PathLike[str],
    *,
    file_format: RecordingFormat | None = None,
    camera: ImageCamera | None = None,
    unit: float | None = None,
    poses: str | os.PathLike[str] | None = None,
    topic: str | None = None,
    world_frame: str | None = None,
    episode: int | None = None,
) -> Recording:
    """Open a recording of a depth camera. Images are read when they are accessed.

    - ``tum``: TUM RGB-D, ``depth.txt``, ``rgb.txt`` and ``groundtruth.txt``, 5000 units per meter. The camera is
      ``calibration.txt``, or that which TUM documents for freiburg1, 2 and 3: without a lens, as TUM recommends.
    - ``icl``: the TUM-compatible folders of ICL-NUIM, with ``associations.txt`` and ``*.gt.freiburg``. Their world is
      left-handed, with y up; it is mirrored in y.
    - ``7scenes``: 7-Scenes and 3DMatch, ``frame-000000.{depth,color}.png`` and ``.pose.txt``, in millimeters.
    - ``scannet``: exported ScanNet, ``depth``, ``color``, ``pose`` and ``intrinsic``, in millimeters.
    - ``redwood``: Redwood and Open3D, ``depth``, ``color`` or ``image``, and a trajectory ``.log``, in millimeters.
    - ``images``: a folder of depth images, or with a folder ``depth``, and optionally ``color`` (``rgb``, ``image``):
      PNG, TIFF or PGM of 16 bits in millimeters, float TIFF or ``.npy`` in meters.
    - ``ros``: a ROS 1 bag, ``.bag``, a ROS 2 bag, a folder or one ``.mcap`` or ``.db3`` file, or a recording of the
      RealSense SDK: Image of 16UC1, 32FC1 or mono16, or compressedDepth (PNG or RVL). The camera is the CameraInfo
      beside the images, with its lens for raw images; poses are those of tf, interpolated between transforms within
      1 s. Color images are those with the same frame.
    - ``lerobot``: an episode of a LeRobot dataset v3, a video of 12 bits or TIFF. Depth that the video's quantization
      clips, by default below 0.01 m and above 10 m, is NaN. The camera is not in the dataset: pass it.

    Depth is NaN where a file has 0, NaN or an infinity, or 65535 in 16 bits. Images and poses with times are joined
    within 0.02 s; poses are interpolated between those before and after an image. ``images`` are joined with poses of
    COLMAP and nerfstudio by name. Color images have the pixels of the depth images; those of ScanNet are resampled.

    Args:
        path: Folder of the recording, or file of a bag.
        file_format: The format; by default determined from the files in the folder.
        camera: The camera of the depth images; by default that of the recording.
        unit: Length of one unit of the depth images [m], by default that of the format.
        poses: A file of poses of any format of `read_frames`, or a ``.log`` of Redwood. By default those of the format;
            for ``images`` a file ``groundtruth.txt``, ``trajectory.txt``, ``poses.txt``, ``transforms.json``, or
            COLMAP's ``images.txt`` or ``images.bin`` in the folder, if there is one.
        topic: The topic of the depth images of a bag, or their feature in a LeRobot dataset; not needed if there is
            only one.
        world_frame: The tf frame that is the world of a bag's poses, by default the root of the tree. Without it, no
            pose is known if all transforms to the root are static, unless that is ``world``, ``map``, ``odom`` or
            ``earth``.
        episode: Index of the episode of a LeRobot dataset; not needed if there is only one.

    Returns:
        The recording; frames without a pose have NaN.

    Raises:
        FileFormatError: If the folder is missing, has no recording of this format, or a file is malformed; the message
            names the file. Or if the camera is not known.
        CameraError: If `camera` is not a camera of images.
    """
    path = as_path(path)
    if file_format is not None:
        check_choice(file_format, "file_format", get_args(RecordingFormat), FileFormatError)
    if camera is not None:
        require_image_camera(camera)
    if unit is not None and not 0 < check_number(unit, "unit", minimum=0.0) <= 1:
        remedy = f"; for {unit:g} units per meter, pass 1 / {unit:g}" if unit > 1 else ""
        raise ArrayError(f"unit must be the length of a unit, above 0 and at most 1 m, got {unit!r}{remedy}")
    pose_file = None if poses is None else as_path(poses, "poses")
    if pose_file is not None and pose_file.is_dir() and not (pose_file / "metadata.yaml").is_file():
        raise FileFormatError(f"{pose_file}: must be a file of poses, got a folder")
    for name, text in (("topic", topic), ("world_frame", world_frame)):
        if text is not None:
            check_text(text, name, FileFormatError)
    if episode is not None:
        check_whole(episode, "episode", minimum=0, error=FileFormatError)
    if not path.exists():
        raise FileFormatError(f"{path}: no such file or folder")
    kind = file_format or ("ros" if is_bag(path) else "images" if path.is_file() else _detect(path))
    if kind != "ros" and not path.is_dir():
        raise FileFormatError(f"{path}: must be the folder of a recording, or a bag ({', '.join(BAG_SUFFIXES)})")
    for name, value in (("topic", topic), ("world_frame", world_frame), ("episode", episode)):
        kinds, described = _OPTIONS[name]
        if value is not None and kind not in kinds:
            raise FileFormatError(f"{path}: {name}= is for {described}, which this is not")
    found = _read(path, kind, pose_file, topic, world_frame, episode, chosen=file_format is not None)
    if pose_file is not None and kind != "images":
        found = join_poses(found, pose_file)
    if camera is None and found.camera is None:
        raise FileFormatError(f"{path}: does not define the camera; pass that of the depth images as camera=")
    chosen = camera or found.camera
    assert chosen is not None  # for type checkers: one of the two is given
    source: dict[str, Json] = {"file": path.absolute().name, "format": kind, **found.details}
    source["camera"] = "given" if camera is not None else found.camera_source
    count = len(found.depths)
    times = np.arange(count, dtype=np.float64) if found.timestamps is None else found.timestamps
    return Recording(chosen, times, found.camera_to_world, source, found.reader(chosen, unit), np.arange(count))


def _detect(path: Path) -> RecordingFormat:
    """Return the format of a folder by the files in it."""
    if is_lerobot(path):
        return "lerobot"
    if any(path.glob("*.gt.freiburg")) and (path / "associations.txt").is_file():
        return "icl"
    if (path / "depth.txt").is_file():
        return "tum"
    if seven_scenes_folder(path) is not None:
        return "7scenes"
    if (path / "depth").is_dir() and (path / "pose").is_dir():
        return "scannet"
    if (path / "depth").is_dir() and any(path.glob("*.log")):
        return "redwood"
    return "images"


def _read(
    path: Path,
    kind: RecordingFormat,
    poses: Path | None,
    topic: str | None,
    world_frame: str | None,
    episode: int | None,
    *,
    chosen: bool,
) -> Found:
    if kind == "ros":
        return read_bag_images(path, topic, world_frame)
    if kind == "lerobot":
        return read_lerobot(path, topic, episode)
    if kind == "images":
        return read_images(path, poses)
    if kind == "7scenes":
        return read_seven_scenes(path, chosen=chosen)
    readers = {"tum": read_tum, "icl": read_icl, "scannet": read_scannet, "redwood": read_redwood}
    return readers[kind](path)
