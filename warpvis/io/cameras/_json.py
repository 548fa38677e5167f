# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras from JSON files: ``transforms.json`` of nerfstudio and instant-ngp, BOP's two files, and Open3D's.

Formats: https://docs.nerf.studio/quickstart/data_conventions.html,
https://github.com/NVlabs/instant-ngp/blob/master/src/nerf_loader.cu,
https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md,
https://www.open3d.org/docs/release/python_api/open3d.camera.PinholeCameraIntrinsic.html
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path, PurePath

from warpvis.cameras import ImageCamera
from warpvis.cameras.lenses import NERF_PINHOLES, Lens, lens_from_nerfstudio, lens_from_opencv, nerfstudio_model
from warpvis.core.checks import truncate
from warpvis.core.file_content import read_json
from warpvis.core.types import Json
from warpvis.core.user_warnings import warn_user
from warpvis.errors import FileFormatError, IntrinsicsWarning
from warpvis.io._files import as_numbers, shorten
from warpvis.io.cameras._making import (
    NoPinholeError,
    checked,
    choose,
    image_size,
    make_camera,
    make_pinhole,
    one_camera,
    only_camera,
)

_NERF_NUMBERS = ("fl_x", "fl_y", "cx", "cy", "w", "h")
_NERF_ANGLES = ("camera_angle_x", "camera_angle_y", "x_fov", "y_fov")
_NERF_LENS = ("camera_model", "distortion_params", "k1", "k2", "k3", "k4", "p1", "p2")
_NGP_LENS = ("is_fisheye", "latlong", "equirectangular", *(f"ftheta_p{power}" for power in range(5)))
_BOP_CAMERA = {"fx", "fy", "cx", "cy", "width", "height"}
_BOP_IMAGES = ("depth", "rgb", "gray")


def is_nerfstudio(fields: Mapping[str, Json]) -> bool:
    """Return whether a JSON object is a ``transforms.json``."""
    return "frames" in fields or any(name in fields for name in ("fl_x", *_NERF_ANGLES))


def is_bop(fields: Mapping[str, Json]) -> bool:
    """Return whether a JSON object is BOP's ``camera.json``."""
    return fields.keys() >= _BOP_CAMERA


def nerfstudio_camera(
    path: Path, fields: Mapping[str, Json], name: str | None, *, distortion: bool
) -> ImageCamera | None:
    """Read the camera of all frames, or that of one frame by its ``file_path`` or the name of its file.

    If `name` is None, poses are read: frames without a camera, or with several, are no error, and the result is None.
    """
    frames = fields.get("frames")
    listed = [frame for frame in frames if isinstance(frame, dict)] if isinstance(frames, list) else []
    chosen = [_find_frame(path, listed, name)] if name else listed
    kinds: dict[tuple[Lens, tuple[float, float]], None] = {}  # a set in the order of the file
    for entry in _nerfstudio_entries(fields, chosen):
        model = checked(str(path), partial(nerfstudio_model, entry))
        try:
            numbers = _nerfstudio_numbers(path, entry, chosen)
        except _MissingSizeError as error:
            if name is not None:
                raise
            warn_user(f"{error}: the frames have no camera", IntrinsicsWarning)
            numbers = None
        if model not in NERF_PINHOLES and not distortion:
            raise NoPinholeError(f"{path}: camera_model {shorten(model)} is not a pinhole")
        if numbers is not None:
            kinds[checked(str(path), partial(lens_from_nerfstudio, entry, *numbers)), numbers[0]] = None
    if not kinds and name is not None:
        raise FileFormatError(f"{path}: defines no focal length: fl_x [px], camera_angle_x [rad] or x_fov [degrees]")

    def make(lens: Lens, size: tuple[float, float]) -> ImageCamera:
        return make_camera(str(path), size, lambda: lens, distortion=distortion)

    example = "" if name is None else next((_frame_name(frame) for frame in listed if _frame_name(frame)), "FRAME")
    return one_camera((make(*kind) for kind in kinds), str(path), example)


def _frame_name(frame: Mapping[str, Json]) -> str:
    name = frame.get("file_path")
    return name if isinstance(name, str) else ""


def _find_frame(path: Path, frames: Sequence[dict[str, Json]], name: str) -> dict[str, Json]:
    """Find a frame by its ``file_path``, with or without ``./``, or by the name of that file."""
    names = [_frame_name(frame) for frame in frames]
    exact = [index for index, text in enumerate(names) if name in (text, text.removeprefix("./"))]
    found = exact or [index for index, text in enumerate(names) if name in (PurePath(text).name, PurePath(text).stem)]
    if len(found) != 1:
        number = "several frames" if found else "no frame"
        raise FileFormatError(
            f"{path}: has {number} with the file_path {truncate(name)!r}; the first of {len(frames)} is "
            f"{truncate(names[0] if names else '')!r}"
        )
    return frames[found[0]]


def _nerfstudio_entries(fields: Mapping[str, Json], frames: Sequence[dict[str, Json]]) -> list[dict[str, Json]]:
    """List the objects that may describe a camera: frames with their own intrinsics, or else the file."""
    names = (*_NERF_NUMBERS, *_NERF_ANGLES, *_NERF_LENS, *_NGP_LENS)
    cameras = [{**fields, **frame} for frame in frames if any(name in frame for name in names)]
    return cameras or [dict(fields)]


class _MissingSizeError(FileFormatError):
    """A file defines a field of view or a focal length, but no image size."""


def _nerfstudio_numbers(
    path: Path, fields: Mapping[str, Json], frames: Sequence[Mapping[str, Json]]
) -> tuple[tuple[float, float], tuple[float, ...]] | None:
    """Read width and height, and ``fx fy cx cy`` [px]; None if no focal length is given."""
    given = any(fields.get(name) is not None for name in ("fl_x", "fl_y", *_NERF_ANGLES))
    size = _nerfstudio_size(path, fields, frames) if given else None
    if size is None and given:
        raise _MissingSizeError(
            f"{path}: defines a field of view but not the image size, w and h [px], and there is no picture next to it"
        )
    if size is None:
        return None
    focal = [_nerfstudio_focal(path, fields, axis, side) for axis, side in zip("xy", size, strict=True)]
    fx, fy = (one if one is not None else other for one, other in (focal, focal[::-1]))
    if fx is None or fy is None:
        return None
    center = [_number(path, fields, name) for name in ("cx", "cy")]
    return size, (fx, fy, *(side / 2 if value is None else value for value, side in zip(center, size, strict=True)))


def _nerfstudio_focal(path: Path, fields: Mapping[str, Json], axis: str, side: float) -> float | None:
    """Return a focal length [px]; as in instant-ngp, its field of view in degrees has precedence."""
    degrees, focal = (_number(path, fields, name) for name in (f"{axis}_fov", f"fl_{axis}"))
    angle = _number(path, fields, f"camera_angle_{axis}")
    if degrees is None and (focal is not None or angle is None):
        return focal
    fov, name, limit = (angle, f"camera_angle_{axis}", "pi radians") if degrees is None else (
        math.radians(degrees), f"{axis}_fov", "180 degrees"
    )  # fmt: skip
    if fov is None or not 0 < fov < math.pi:
        raise NoPinholeError(f"{path}: {name} must be between 0 and {limit}, got {fields[name]!r}")
    return side / 2 / math.tan(fov / 2)


def _nerfstudio_size(
    path: Path, fields: Mapping[str, Json], frames: Sequence[Mapping[str, Json]]
) -> tuple[float, float] | None:
    """Return width and height; those of the first picture if not given, as in Blender's files."""
    width, height = (_number(path, fields, name) for name in ("w", "h"))
    if width is not None and height is not None:
        return width, height
    name = frames[0].get("file_path") if frames else None
    if not isinstance(name, str) or "\0" in name:
        return None
    return image_size(path.parent, [name, f"{name}.png"])


def bop_camera(path: Path, fields: Mapping[str, Json], name: str = "", *, distortion: bool = True) -> ImageCamera:
    """Read BOP's ``camera.json``, a pinhole."""
    only_camera(path, name)
    width, height, *intrinsics = (
        as_numbers(fields[key], (), f"{path}: {key}").item() for key in ("width", "height", "fx", "fy", "cx", "cy")
    )
    return make_pinhole(str(path), (width, height), intrinsics)


def is_open3d(fields: Mapping[str, Json]) -> bool:
    """Return whether a JSON object is Open3D's ``PinholeCameraIntrinsic``."""
    return "intrinsic_matrix" in fields


def open3d_camera(path: Path, fields: Mapping[str, Json], name: str = "", *, distortion: bool = True) -> ImageCamera:
    """Read Open3D's pinhole, whose matrix is stored by columns."""
    only_camera(path, name)
    missing = next((key for key in ("width", "height") if key not in fields), None)
    if missing is not None:
        raise FileFormatError(f"{path}: {missing} [px] is missing")
    width, height = (as_numbers(fields[key], (), f"{path}: {key} [px]").item() for key in ("width", "height"))
    k = as_numbers(fields["intrinsic_matrix"], (9,), f"{path}: intrinsic_matrix").reshape(3, 3).T
    return make_camera(str(path), (width, height), partial(lens_from_opencv, k, None), distortion=distortion)


def is_bop_images(fields: Mapping[str, Json]) -> bool:
    """Return whether a JSON object is BOP's ``scene_camera.json``."""
    return any(isinstance(entry, dict) and "cam_K" in entry for entry in fields.values())


def bop_images_camera(
    path: Path, images: Mapping[str, Json], name: str | None, *, distortion: bool = True
) -> ImageCamera | None:
    """Read the camera of all images of a ``scene_camera.json``, or that of an image by its id.

    The image size is that of a picture next to it, or that of the dataset's ``camera.json``. If `name` is None, poses
    are read: images without a size, or with several cameras, are no error, and the result is None.
    """
    entries = {key: entry["cam_K"] for key, entry in images.items() if isinstance(entry, dict) and "cam_K" in entry}
    if name:
        entries = {name: entries[choose(path, list(entries), name)]}
    size = _bop_size(path, images) if entries else None
    if size is None:
        if name is not None:
            raise FileFormatError(
                f"{path}: must have a picture or the dataset's camera.json next to it, which has the image size [px]"
            )
        return None
    matrices = {tuple(as_numbers(matrix, (9,), f"{path}: cam_K").tolist()) for matrix in entries.values()}
    cameras = (make_pinhole(str(path), size, (fx, fy, cx, cy)) for fx, _, cx, _, fy, cy, *_ in sorted(matrices))
    return one_camera(cameras, str(path), "" if name is None else next(iter(entries)))


def _bop_size(path: Path, images: Mapping[str, Json]) -> tuple[float, float] | None:
    first = min((int(key) for key in images if key.isascii() and key.isdigit() and len(key) < 16), default=0)
    names = [f"{folder}/{first:06d}{suffix}" for folder in _BOP_IMAGES for suffix in (".png", ".jpg", ".tif")]
    found = image_size(path.parent, names)
    dataset_file = path.absolute().parent.parent.parent / "camera.json"
    if found is None and dataset_file.is_file():
        fields = read_json(dataset_file)
        if isinstance(fields, dict) and is_bop(fields):
            camera = bop_camera(dataset_file, fields)
            return camera.width, camera.height
    return found


def _number(path: Path, fields: Mapping[str, Json], name: str) -> float | None:
    if fields.get(name) is None:
        return None
    return float(as_numbers(fields[name], (), f"{path}: {name}"))
