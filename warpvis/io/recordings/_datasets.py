# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Folders of datasets: TUM RGB-D, ICL-NUIM, 7-Scenes, ScanNet and Redwood.

Cameras are those that the datasets document, for images of the documented size.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import truncate
from warpvis.core.file_content import is_file, read_json
from warpvis.errors import FileFormatError
from warpvis.io._files import as_numbers, read_rows, shorten
from warpvis.io.cameras._files import load_camera
from warpvis.io.cameras._making import checked, image_size
from warpvis.io.poses._tables import read_poses
from warpvis.io.recordings._found import Found, depth_images_in, depth_size, existing, match_colors
from warpvis.io.recordings._poses import (
    nearest,
    numbers_of,
    poses_at,
    read_log,
    read_matrix,
    read_pose_files,
    unknown_poses,
)

_VGA = (640, 480)

# Principal point of a Kinect and of PrimeSense's cameras in the middle of 640 x 480 pixels with centers at integers.
# Source: Open3D's PrimeSenseDefault, cpp/open3d/camera/PinholeCameraIntrinsic.cpp of github.com/isl-org/Open3D
_PRIMESENSE = (525.0, 525.0, 319.5, 239.5)

# Without a lens, as TUM recommends: "the conversion from the 2D images to 3D point clouds is the same for all
# datasets", except freiburg3, whose images were undistorted with its own calibration.
# Source: https://cvg.cit.tum.de/data/datasets/rgbd-dataset/intrinsic_calibration and its page on file formats; of
# freiburg3 also Examples/RGB-D/TUM3.yaml of github.com/raulmur/ORB_SLAM2
_FREIBURG = {
    "freiburg1": _PRIMESENSE,
    "freiburg2": _PRIMESENSE,
    "freiburg3": (535.4, 539.2, 320.1, 247.6),
}
_TUM_UNIT = 1 / 5000

# Source: https://www.doc.ic.ac.uk/~ahanda/VaFRIC/codes.html, where fy is -480: y of its cameras points up. fx is
# greater since POV-Ray's aspect ratio is 1.33, not 4/3: https://github.com/mp3guy/ElasticFusion/issues/99
_ICL = (481.2, 480.0, 319.5, 239.5)

# Source: https://www.microsoft.com/en-us/research/project/rgb-d-dataset-7-scenes/; also data/camera-intrinsics.txt of
# github.com/andyzeng/tsdf-fusion-python. The principal point is the middle of the image, so that pixel centers are at
# +0.5.
_SEVEN_SCENES = (585.0, 585.0, 320.0, 240.0)


def read_tum(path: Path) -> Found:
    """Read ``depth.txt``, ``rgb.txt`` and ``groundtruth.txt`` of TUM RGB-D; images and poses are joined by time.

    Source: https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats
    """
    times, depths = _read_list(path / "depth.txt")
    rows = existing(path / "depth.txt", depths)
    times, depths = times[rows], [depths[row] for row in rows]
    colors: list[Path | None] | None = None
    if is_file(path / "rgb.txt"):
        color_times, files = _read_list(path / "rgb.txt")
        colors = [files[index] if index >= 0 else None for index in nearest(times, color_times)]
    poses = unknown_poses(len(depths))
    if is_file(path / "groundtruth.txt"):
        poses = poses_at(times, *read_poses(path / "groundtruth.txt"))
    camera, origin = _tum_camera(path, depths[0])
    return Found(depths, poses, colors, times, camera, origin, _TUM_UNIT)


def _tum_camera(path: Path, depth: Path) -> tuple[ImageCamera | None, str]:
    if is_file(path / "calibration.txt"):
        return load_camera(str(path / "calibration.txt")), "calibration.txt"
    # The lists begin with the name of the bag that they were made from, "# file: 'rgbd_dataset_freiburg1_rpy.bag'".
    comments = [line for line in (path / "depth.txt").read_text(errors="replace").splitlines()[:5] if line[:1] == "#"]
    text = " ".join([path.absolute().name, *comments])
    found = [name for name in _FREIBURG if name in text]
    if len(found) != 1 or depth_size(depth) != _VGA:
        return None, ""
    return _camera(_FREIBURG[found[0]], _VGA, path), f"documented for {found[0]}"


def read_icl(path: Path) -> Found:
    """Read a TUM-compatible folder of ICL-NUIM: ``associations.txt`` and ``*.gt.freiburg``.

    Its cameras have y up, so that their frame and the world are left-handed. Both are mirrored in y here, which makes
    right-handed frames with OpenCV axes: ``T = S T_file S``, ``S = diag(1, -1, 1, 1)``. Times are the numbers of the
    images; image 0 has no pose.
    """
    place = path / "associations.txt"
    times, depths, colors = [], [], []
    for location, line in read_rows(place, "number depth number color"):
        words = line.split()
        time = numbers_of(words[:1])
        if len(words) != 4 or time is None:
            raise FileFormatError(f"{location}: expected 'number depth number color', got {truncate(line, 60)!r}")
        first, second = path / words[1], path / words[3]
        swapped = "depth" in words[3] and "depth" not in words[1]
        depths.append(second if swapped else first)
        colors.append(first if swapped else second)
        times += time
    rows = existing(place, depths)
    trajectories = sorted(path.glob("*.gt.freiburg"))
    if len(trajectories) != 1:
        raise FileFormatError(f"{path}: must have one trajectory, *.gt.freiburg, got {len(trajectories)}")
    pose_times, poses = read_poses(trajectories[0])
    stamps = np.array(times)[rows]
    camera = _camera(_ICL, _VGA, path) if depth_size(depths[rows[0]]) == _VGA else None
    return Found(
        [depths[row] for row in rows],
        poses_at(stamps, pose_times, poses * [1, -1, 1, -1, 1, -1, 1]),
        [colors[row] for row in rows],
        stamps,
        camera,
        "documented for ICL-NUIM",
        _TUM_UNIT,
    )


def read_seven_scenes(path: Path, *, chosen: bool) -> Found:
    """Read ``frame-000000.depth.png``, ``.color.png`` and ``.pose.txt`` of 7-Scenes and 3DMatch, in millimeters.

    The camera is ``camera-intrinsics.txt``, or in a folder ``seq-01``, or if the format was `chosen`, that of 7-Scenes.
    """
    folder = seven_scenes_folder(path)
    if folder is None:
        raise FileFormatError(f"{path}: has no frames of 7-Scenes, *.depth.png")
    depths = sorted(folder.glob("*.depth.png"))
    stems = [path.name.removesuffix(".depth.png") for path in depths]
    colors = [_first(folder / f"{stem}.color.png", folder / f"{stem}.color.jpg") for stem in stems]
    poses = read_pose_files([folder / f"{stem}.pose.txt" for stem in stems])
    size = depth_size(depths[0])
    camera, origin = None, ""
    intrinsics = _first(folder / "camera-intrinsics.txt", folder.absolute().parent / "camera-intrinsics.txt")
    if intrinsics is not None:
        camera, origin = _camera_of_matrix(intrinsics, size), intrinsics.name
    elif size == _VGA and (chosen or folder.absolute().name.startswith("seq-")):
        camera, origin = _camera(_SEVEN_SCENES, size, folder, pixel_center=0.5), "documented for 7-Scenes"
    return Found(depths, poses, colors if any(colors) else None, camera=camera, camera_source=origin)


def seven_scenes_folder(path: Path) -> Path | None:
    """Return the folder of the frames, this one or the only one in it; None without frames."""
    if any(path.glob("*.depth.png")):
        return path
    found = sorted({file.parent for file in path.glob("*/*.depth.png")})
    if len(found) > 1:
        raise FileFormatError(f"{path}: has several sequences; give one of {', '.join(f.name for f in found[:5])}")
    return found[0] if found else None


def read_scannet(path: Path) -> Found:
    """Read a scene that ScanNet's SensReader or its 25k frames made: depth in millimeters, ``pose`` and ``intrinsic``.

    Poses that ScanNet marks as lost, -inf, are unknown. Color images have more pixels than depth images.
    Source: https://github.com/ScanNet/ScanNet/tree/master/SensReader/python
    """
    depths = depth_images_in(path / "depth")
    colors = match_colors(depths, path / "color" if (path / "color").is_dir() else None)
    poses = read_pose_files([path / "pose" / f"{depth.stem}.txt" for depth in depths])
    names = [path / "intrinsic/intrinsic_{}.txt", path / "intrinsics_{}.txt"]
    cameras: dict[str, Camera | None] = {"depth": None, "color": None}
    for kind, images in (("depth", depths), ("color", colors or [])):
        file = _first(*(Path(str(name).format(kind)) for name in names))
        size = next(filter(None, (image_size(image.parent, [image.name]) for image in images if image)), None)
        if file is not None and size is not None:
            cameras[kind] = _camera_of_matrix(file, size)
    origin = "intrinsic_depth.txt" if cameras["depth"] else ""
    return Found(depths, poses, colors, None, cameras["depth"], origin, color_camera=cameras["color"])


def read_redwood(path: Path) -> Found:
    """Read folders ``depth`` and ``image`` or ``color``, a trajectory ``.log`` and a camera ``.json`` of Open3D.

    Depth is in millimeters. Without a JSON file the camera is Redwood's.
    Source: http://redwood-data.org/indoor/fileformat.html, and https://qianyi.info/scenedata.html of the same authors
    """
    depths = depth_images_in(path / "depth")
    logs = sorted(path.glob("*.log"))
    named = [log for log in logs if log.name == "trajectory.log"] or logs
    if len(named) > 1:
        raise FileFormatError(f"{path}: has {' and '.join(log.name for log in named[:3])}; pass one as poses=")
    poses = read_log(named[0], len(depths)) if named else unknown_poses(len(depths))
    size = depth_size(depths[0])
    for file in sorted(path.glob("*.json")):
        data = read_json(file)
        if isinstance(data, dict) and "intrinsic_matrix" in data:
            # Open3D stores the matrix by columns.
            matrix = as_numbers(data["intrinsic_matrix"], (9,), f"{file}: intrinsic_matrix").reshape(3, 3).T
            camera = checked(str(file), partial(Camera.from_K, matrix, *size, pixel_center=0.0))
            written = (data.get("width", size[0]), data.get("height", size[1]))
            if written != size:
                raise FileFormatError(
                    f"{file}: must be the camera of the depth images, {size[0]} x {size[1]} pixels, got "
                    f"{shorten(written[0])} x {shorten(written[1])}; give that as camera="
                )
            return Found(depths, poses, color_images(path, depths), None, camera, file.name)
    default = _camera(_PRIMESENSE, size, path) if size == _VGA else None
    return Found(depths, poses, color_images(path, depths), None, default, "documented for Redwood")


def color_images(path: Path, depths: list[Path]) -> list[Path | None] | None:
    """Return the color images in the folder ``color``, ``rgb``, ``image`` or ``images`` of a recording."""
    folders = [path / name for name in ("color", "rgb", "image", "images")]
    return match_colors(depths, next((folder for folder in folders if folder.is_dir()), None))


def _camera_of_matrix(path: Path, size: tuple[int, int]) -> Camera:
    """Read a matrix K, 3 x 3 or 4 x 4; pixel centers are at +0.5 if the principal point is exactly the middle."""
    matrix = read_matrix(path)
    if matrix.shape not in ((3, 3), (4, 4)):
        raise FileFormatError(f"{path}: intrinsics must be 3 x 3 or 4 x 4 numbers, got {matrix.shape}")
    middle = (2 * matrix[0, 2], 2 * matrix[1, 2]) == size
    return checked(str(path), lambda: Camera.from_K(matrix[:3, :3], *size, pixel_center=0.5 if middle else 0.0))


def _camera(intrinsics: tuple[float, ...], size: tuple[int, int], path: Path, *, pixel_center: float = 0.0) -> Camera:
    fx, fy, cx, cy = intrinsics
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    return checked(str(path), lambda: Camera.from_K(matrix, *size, pixel_center=pixel_center))


def _read_list(path: Path) -> tuple[NDArray[np.float64], list[Path]]:
    """Read lines ``timestamp filename``."""
    times, files = [], []
    for place, line in read_rows(path, "timestamp filename"):
        words = line.split(maxsplit=1)
        time = numbers_of(words[:1])
        if len(words) != 2 or time is None:
            raise FileFormatError(f"{place}: expected 'timestamp filename', got {truncate(line, 60)!r}")
        times += time
        files.append(path.parent / words[1].strip())
    if not files:
        raise FileFormatError(f"{path}: holds no lines 'timestamp filename'")
    return np.array(times), files


def _first(*paths: Path) -> Path | None:
    return next((path for path in paths if is_file(path)), None)
