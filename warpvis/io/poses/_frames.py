# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reader of frames from pose files of all supported formats.

Formats of datasets: https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md (BOP),
https://docs.nerf.studio/quickstart/data_conventions.html (nerfstudio), https://colmap.github.io/format.html (COLMAP).
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.frames import Frames
from warpvis.core.checks import as_path, check_flag, truncate
from warpvis.core.file_content import read_json, require_content
from warpvis.core.numpy_files import read_archive, read_array
from warpvis.core.poses import Convention, QuaternionOrder, check_convention, check_quaternion, poses_to_matrices
from warpvis.core.types import Json
from warpvis.core.user_warnings import warn_user
from warpvis.errors import FileFormatError
from warpvis.io._bag_files import BAG_SUFFIXES
from warpvis.io._files import as_numbers, shorten
from warpvis.io.cameras._colmap import colmap_camera, colmap_images
from warpvis.io.cameras._json import bop_images_camera, nerfstudio_camera
from warpvis.io.cameras._making import camera_of_poses
from warpvis.io.poses._file_poses import FilePoses
from warpvis.io.poses._tables import read_csv, read_parquet, read_poses

_MILLIMETERS = 1000.0
_COLMAP_FILES = ("images.txt", "images.bin")

COLMAP_PATHS = tuple(f"{folder}images.{kind}" for folder in ("", "sparse/0/", "sparse/") for kind in ("bin", "txt"))
"""Pose files of COLMAP in a folder; the first existing one is read."""

# Pose files in a folder, one format per line; the first existing one of a line is read.
_IN_FOLDERS = (
    COLMAP_PATHS,
    ("transforms.json",),
    ("scene_camera.json",),
)

PoseFormat = Literal["tum", "npy", "npz", "csv", "parquet", "nerfstudio", "bop", "colmap", "ros"]

_SUFFIXES: dict[str, PoseFormat] = {
    ".npy": "npy",
    ".npz": "npz",
    ".csv": "csv",
    ".parquet": "parquet",
    ".pq": "parquet",
    **dict.fromkeys(BAG_SUFFIXES, "ros"),
}


def read_frames(
    path: str | os.PathLike[str],
    *,
    convention: Convention | None = None,
    quaternion: QuaternionOrder = "xyzw",
    file_format: PoseFormat | None = None,
    topic: str | None = None,
    distortion: bool = True,
) -> Frames:
    """Read camera poses and other data of frames from a pose file.

    - ``tum``: text of lines ``timestamp tx ty tz qx qy qz qw``; the default for all suffixes not listed below.
    - ``npy``: an array ``(V, 7)``, rows ``x y z qx qy qz qw``, or ``(V, 4, 4)``.
    - ``npz``: such an array, ``camera_to_world``, and optionally ``timestamps`` (or ``timestamp``) ``(V,)``,
      ``object_poses`` ``(W, M, 7)`` and ``world_index`` ``(V,)``, see `Frames`; other arrays are not read. Outputs of
      ``warpvis render`` have this format.
    - ``csv``, ``parquet``: columns ``x y z qx qy qz qw`` (``tx ty tz``), optionally ``timestamp`` (``time``, ``t``);
      in any order, among others.
    - ``nerfstudio``: ``transforms.json``. The frames are in the file's order and in its world frame
      (``applied_transform`` is not undone), and their timestamps are 0, 1, 2, ...
    - ``bop``: ``scene_camera.json`` with world-to-camera poses in millimeters. The frames are in the order of image
      ids, which are their timestamps.
    - ``colmap``: ``images.txt`` or ``images.bin``, sorted by the images' names.
    - ``ros``: a topic of a ROS bag: ``.bag``, ``.mcap``, ``.db3``, or a folder; see
      `warpvis.io.poses._ros_bags.read_bag`.

    Poses are camera to world [m], timestamps seconds. If the file defines one camera for all of them (nerfstudio;
    BOP, with a picture or ``camera.json`` that gives the image size; COLMAP; a bag's CameraInfo), it is returned as
    `Frames.camera`, without a range.

    Args:
        path: The file, the folder of a ROS 2 bag, or a folder with a file of COLMAP, nerfstudio or BOP.
        convention: Axes of the camera frame of the poses. By default that of the format: ``"opengl"`` for
            nerfstudio; for ROS ``"opencv"`` if the frame's name ends in ``_optical_frame``, else ``"ros_body"``;
            ``"opencv"`` for all others.
        quaternion: Order of the quaternions of ``npy`` and ``npz``, of cameras and objects: ``"xyzw"`` or ``"wxyz"``.
            The other formats define the order.
        file_format: The file's format; by default determined from its suffix, or the content of JSON files.
        topic: For ROS bags, the topic to read.
        distortion: Whether the frames' camera has its lens, as for `warpvis.io.load_camera`; for a bag, it is then the
            camera of the raw images, otherwise of the rectified ones. If False, it is a pinhole, and a warning is
            issued if distortion was dropped.

    Returns:
        The frames, in the file's order; their `source` contains the file's name, its format and the convention.

    Raises:
        FileFormatError: If the file is missing, contains no poses, or is malformed; the message names the file and the
            line, row, frame, image or message. Or if `topic` or `quaternion` does not apply to such a file.
    """
    return read_pose_file(path, convention, quaternion, file_format, topic, distortion)[0]


def read_pose_file(
    path: str | os.PathLike[str],
    convention: Convention | None = None,
    quaternion: QuaternionOrder = "xyzw",
    file_format: PoseFormat | None = None,
    topic: str | None = None,
    distortion: bool = True,
) -> tuple[Frames, FilePoses]:
    """Read frames as `read_frames` does; return also the content of the file, with the names of its images."""
    path = as_path(path)
    if convention is not None:
        check_convention(convention)
    check_quaternion(quaternion)
    if file_format is not None and not (isinstance(file_format, str) and file_format in get_args(PoseFormat)):
        raise FileFormatError(f"file_format must be one of {', '.join(get_args(PoseFormat))}, got {file_format!r}")
    if not os.path.exists(path):
        raise FileFormatError(f"{path}: no such file")
    if quaternion != "xyzw" and not leaves_order_open(path, file_format):
        raise FileFormatError(f"{path}: quaternion= is for .npy and .npz; other formats define the order")
    if path.is_dir() and file_format != "ros" and not (path / "metadata.yaml").is_file():
        path = _file_in(path)
    require_content(path, "a file of poses", images=False)
    kind, poses = _read(path, file_format, topic, check_flag(distortion, "distortion", FileFormatError))
    return poses.to_frames(path, kind, convention, quaternion), poses


def _file_in(folder: Path) -> Path:
    """Find the pose file in a folder of COLMAP, nerfstudio or BOP."""
    kinds = [[folder / name for name in names if (folder / name).is_file()] for names in _IN_FOLDERS]
    found = [files[0] for files in kinds if files]
    if len(found) > 1:
        names = " and ".join(file.relative_to(folder).as_posix() for file in found)
        raise FileFormatError(f"{folder}: holds {names}; give one of them")
    if not found:
        raise FileFormatError(
            f"{folder}: is a folder without poses: it holds no metadata.yaml (a ROS 2 bag), images.txt or images.bin "
            "(COLMAP, also in sparse/0), transforms.json or scene_camera.json; give a pose file"
        )
    return found[0]


def leaves_order_open(path: Path, file_format: PoseFormat | None = None) -> bool:
    """Return whether a pose file has a format that does not define the order of quaternions."""
    return _known_kind(path, file_format) in ("npy", "npz")


def _known_kind(path: Path, file_format: PoseFormat | None) -> PoseFormat | None:
    """Return the format given by the caller or the file name; None if it depends on the content."""
    if file_format is None and path.name in _COLMAP_FILES:
        return "colmap"
    return file_format or ("ros" if os.path.isdir(path) else _SUFFIXES.get(path.suffix.lower()))


def _read(path: Path, file_format: PoseFormat | None, topic: str | None, distortion: bool) -> tuple[str, FilePoses]:
    kind = _known_kind(path, file_format)
    if topic is not None and kind != "ros":
        raise FileFormatError(f"{path}: topic= is for ROS bags, which this is not")
    if kind == "ros":
        from warpvis.io.poses._ros_bags import read_bag

        return kind, read_bag(path, topic=topic, distortion=distortion)
    if kind in ("nerfstudio", "bop") or (kind is None and path.suffix.lower() == ".json"):
        data = read_json(path)
        is_nerfstudio = path.name.startswith("transforms") or (isinstance(data, dict) and "frames" in data)
        kind = kind or ("nerfstudio" if is_nerfstudio else "bop")
        return kind, parse_bop(path, data) if kind == "bop" else parse_nerfstudio(path, data, distortion=distortion)
    if kind == "colmap":
        return kind, read_colmap(path, distortion=distortion)
    readers = {"npy": _read_npy, "npz": _read_npz, "csv": read_csv, "parquet": read_parquet}
    return kind or "tum", readers.get(kind or "tum", _read_tum)(path)


def _read_tum(path: Path) -> FilePoses:
    times, rows = read_poses(path)
    return FilePoses(rows, lambda index: f"{path}: pose {index}", timestamps=times)


def _read_npy(path: Path) -> FilePoses:
    return _row_poses(path, read_array(path), "the array")


def _read_npz(path: Path) -> FilePoses:
    names = ("camera_to_world", "timestamps", "timestamp", "object_poses", "world_index")
    arrays = read_archive(path, names, "camera_to_world")
    if "timestamp" in arrays and "timestamps" in arrays:
        raise FileFormatError(f"{path}: expected timestamps or timestamp, got both")
    poses = _row_poses(path, arrays["camera_to_world"], "camera_to_world")
    return FilePoses(
        poses.poses,
        poses.place,
        timestamps=arrays.get("timestamps", arrays.get("timestamp")),
        object_poses=arrays.get("object_poses"),
        world_index=arrays.get("world_index"),
    )


def _row_poses(path: Path, array: NDArray[np.generic], name: str) -> FilePoses:
    if array.dtype.kind not in "fiu" or not array.ndim or array.shape[1:] not in ((7,), (4, 4)):
        got = f"{array.dtype} of shape {array.shape}"
        raise FileFormatError(f"{path}: {name} must be numbers of shape (V, 7) or (V, 4, 4), got {got}")
    return FilePoses(array, lambda index: f"{path}: pose {index}")


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
    camera = bop_images_camera(path, data, None)
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


def parse_nerfstudio(path: Path, data: Json, *, distortion: bool) -> FilePoses:
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
    camera = camera_of_poses(lambda: nerfstudio_camera(path, data, None, distortion=distortion))
    names, depths = ([_text(entry.get(key)) for entry in frames] for key in ("file_path", "depth_file_path"))
    return FilePoses(
        poses,
        lambda index: f"{path}: frame {index}",
        "opengl",
        camera=camera,
        image_names=names,
        depth_names=depths,
    )


def _text(value: Json) -> str | None:
    return value if isinstance(value, str) and value else None


def read_colmap(path: Path, *, distortion: bool) -> FilePoses:
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
        camera = camera_of_poses(lambda: colmap_camera(cameras_file, used=used, distortion=distortion))
    return FilePoses(
        poses,
        lambda index: f"{path}: image {truncate(images[index].name)!r}",
        camera=camera,
        image_names=[image.name for image in images],
    )


def _inverse(rotations: NDArray[np.float64], translations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert poses world to camera, to matrices ``(n, 4, 4)``; overflow is reported with the frames."""
    poses = np.tile(np.eye(4), (len(rotations), 1, 1))
    poses[:, :3, :3] = rotations.swapaxes(1, 2)
    with np.errstate(over="ignore", invalid="ignore"):
        poses[:, :3, 3] = -np.einsum("nji,nj->ni", rotations, translations)
    return poses
