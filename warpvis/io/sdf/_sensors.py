# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras and lidars of SDF files, as cameras and ray patterns with poses."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras import Rays
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import as_items, as_path, truncate
from warpvis.core.file_content import is_file
from warpvis.core.poses import poses_to_opencv
from warpvis.errors import CameraError, FileFormatError, SceneError
from warpvis.io._readers import MODEL_CONFIG
from warpvis.io.sdf._load import load_document
from warpvis.io.sdf._scopes import Matrix
from warpvis.io.sdf._xml import Node, raw_pose
from warpvis.sensors.lidars import directions_at

_CAMERAS = (
    *("camera", "depth_camera", "depth", "rgbd_camera", "rgbd", "multicamera", "thermal_camera", "thermal"),
    *("segmentation_camera", "segmentation", "boundingbox_camera", "boundingbox"),
)
_WIDE = ("wideanglecamera", "wide_angle_camera")
_LIDARS = ("gpu_lidar", "lidar", "gpu_ray", "ray")
_MAX_PIXELS = 2**26
_DEFAULT_FOV = 1.047

# Functions of the angle t to the axis, r = c1 f fun(t / c2 + c3), by the type of a lens (camera.sdf).
_LENSES: dict[str, tuple[float, float, str]] = {
    "gnomonical": (1.0, 1.0, "tan"),
    "stereographic": (2.0, 2.0, "tan"),
    "equidistant": (1.0, 1.0, "id"),
    "equisolid_angle": (2.0, 2.0, "sin"),
    "orthographic": (1.0, 1.0, "sin"),
}
_INVERSES: dict[str, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {
    "tan": np.arctan,
    "sin": np.arcsin,
    "id": np.asarray,
}
_FORWARD: dict[str, Callable[[float], float]] = {"tan": math.tan, "sin": math.sin, "id": float}


@dataclass(frozen=True, eq=False)
class SdfSensor:
    """A camera or a lidar of an SDF file, from `read_sensors`."""

    name: str
    """Name with those of its model and link: ``"robot::head::camera"``; a multicamera has one for each camera."""
    kind: str
    """Its type in the file: ``"camera"``, ``"depth_camera"``, ``"gpu_lidar"``, ..."""
    camera: Camera | Rays
    """A pinhole camera without its lens distortion, with the range of its images; or the rays of a wide-angle camera
    (x right, y down, z forward) or a lidar (x forward, y left, z up), shape ``(rows, columns)``."""
    pose: NDArray[np.float64]
    """Camera to world with OpenCV axes, or lidar to world, ``x y z qx qy qz qw``, shape ``(7,)``."""
    link: str
    """Name of its link, as in `scene.joints`."""
    rate: float
    """Updates per second [Hz]; 0 for as often as possible."""

    @property
    def is_lidar(self) -> bool:
        """Whether it is a lidar."""
        return self.kind in _LIDARS


def read_sensors(
    path: str | os.PathLike[str], *, search_path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] = ()
) -> dict[str, SdfSensor]:
    """Read the cameras and lidars of Gazebo's SDF file, and of everything that it includes.

    Args:
        path: The file, or the folder of a model.
        search_path: Folders to search for models, as for `Scene.load`.

    Returns:
        Sensors by name. `Renderer` accepts their `camera`, and renders it at their `pose` in the scene of the same
        file.

    Raises:
        FileFormatError: If the file is invalid.
    """
    path = as_path(path)
    folders = (
        [search_path] if isinstance(search_path, os.PathLike) else as_items(search_path, "search_path", SceneError)
    )
    if is_file(path / MODEL_CONFIG):
        path = path / MODEL_CONFIG
    if not path.is_file():
        raise FileFormatError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}")
    found: dict[str, SdfSensor] = {}
    try:
        document = load_document(path, [as_path(folder, "search_path") for folder in folders])
        for scope in document.scopes:
            for model in scope.all_models():
                above = model.world_pose()
                for link in model.links:
                    for node in link.node.children("sensor"):
                        name = f"{model.prefix}{link.name}"
                        for sensor in _read(node, name, above @ model.element_pose(node, link)):
                            found.setdefault(sensor.name, sensor)
    except RecursionError:
        raise FileFormatError(f"{path}: must not be nested that deeply") from None
    return found


def _read(node: Node, link: str, pose: Matrix) -> list[SdfSensor]:
    kind = (node.get("type") or "").strip()
    name, rate = f"{link}::{node.get('name', kind).strip()}", node.number("update_rate", 0.0, minimum=0.0)
    try:
        if kind in _LIDARS:
            scan = node.child("lidar") if node.child("lidar") is not None else node.child("ray")
            rays = _lidar(node if scan is None else scan)
            return [SdfSensor(name, kind, rays, poses_to_opencv(pose)[0], link, rate)]
        if kind not in _CAMERAS and kind not in _WIDE:
            return []
        cameras = node.children("camera")
        several = len(cameras) > 1
        return [
            SdfSensor(
                f"{name}::{camera.get('name', number)}" if several else name,
                kind,
                _wide_camera(camera) if kind in _WIDE else _camera(camera),
                poses_to_opencv(pose @ raw_pose(camera), "ros_body")[0],
                link,
                rate,
            )
            for number, camera in enumerate(cameras)
        ]
    except CameraError as error:
        node.fail(f"is no valid sensor: {error}")


def _size(node: Node, tags: tuple[str, str], defaults: tuple[int, int]) -> tuple[int, int]:
    width, height = (int(node.positive(tag, default)) for tag, default in zip(tags, defaults, strict=True))
    if width < 1 or height < 1 or width * height > _MAX_PIXELS:
        node.fail(f"must have 1 to {_MAX_PIXELS} pixels or rays, got {width} x {height}")
    return width, height


def _camera(node: Node) -> Camera:
    """Return a pinhole camera: by its intrinsics if the file has them, else by its field of view."""
    width, height = _size(node, ("image/width", "image/height"), (320, 240))
    clip = "depth_camera/clip" if node.child("depth_camera/clip") is not None else "clip"
    near, far = node.number(f"{clip}/near", 0.1, minimum=0.0), node.number(f"{clip}/far", 100.0, minimum=0.0)
    intrinsics = node.child("lens/intrinsics")
    if intrinsics is not None:
        fx, fy = (intrinsics.positive(tag, 277.0) for tag in ("fx", "fy"))
        cx, cy = intrinsics.number("cx", 160.0), intrinsics.number("cy", 120.0)
        return Camera(width, height, fx, fy, cx, cy, near, far)
    return Camera.from_fov(width, height, hfov=node.positive("horizontal_fov", _DEFAULT_FOV), near=near, far=far)


def _wide_camera(node: Node) -> Rays:
    """Return the rays of a wide-angle camera; pixels outside of the image circle look along the axis of its edge."""
    width, height = _size(node, ("image/width", "image/height"), (320, 240))
    kind = node.string("lens/type", "stereographic")
    if kind == "custom":
        c1, c2 = (node.positive(f"lens/custom_function/{tag}", 1.0) for tag in ("c1", "c2"))
        c3, function = node.number("lens/custom_function/c3", 0.0), node.string("lens/custom_function/fun", "tan")
    elif kind in _LENSES:
        (c1, c2, function), c3 = _LENSES[kind], 0.0
    else:
        node.nearest("lens/type").fail(f"must be {', '.join(_LENSES)} or custom, got {truncate(kind)!r}")
    if function not in _INVERSES:
        node.fail(f"must have a lens with fun {', '.join(_INVERSES)}, got {truncate(function)!r}")
    hfov = node.positive("horizontal_fov", _DEFAULT_FOV)
    cutoff = min(node.positive("lens/cutoff_angle", 1.5707), math.pi)
    # The image's width is `horizontal_fov`.
    scale = c1 * _FORWARD[function](hfov / 2 / c2 + c3)
    if not node.flag("lens/scale_to_hfov", True):
        scale = 1 / node.positive("lens/custom_function/f", 1.0)
    u, v = np.meshgrid(
        (np.arange(width) + 0.5 - width / 2) * 2 / width, (np.arange(height) + 0.5 - height / 2) * 2 / width
    )
    radius = np.hypot(u, v)
    with np.errstate(invalid="ignore"):
        angle = c2 * (_INVERSES[function](radius * scale / c1) - c3)
    angle = np.clip(np.nan_to_num(angle, nan=cutoff), 0.0, cutoff)
    side = np.sin(angle) / np.where(radius > 0, radius, 1.0)
    rays = np.stack([u * side, v * side, np.cos(angle)], axis=-1)
    near, far = node.number("clip/near", 0.1, minimum=0.0), node.number("clip/far", 100.0, minimum=0.0)
    return Rays(rays, near=near, far=far)


def _lidar(node: Node) -> Rays:
    """Return the rays of a lidar, the lowest row first; columns go from the minimum to the maximum angle."""
    spans = []
    for axis, default in (("horizontal", 640), ("vertical", 1)):
        count = node.positive(f"scan/{axis}/samples", default) * node.positive(f"scan/{axis}/resolution", 1.0)
        low, high = (node.number(f"scan/{axis}/{tag}_angle", 0.0) for tag in ("min", "max"))
        spans.append((low, high, max(1, int(count))))
    if spans[0][2] * spans[1][2] > _MAX_PIXELS:
        node.fail(f"must have at most {_MAX_PIXELS} rays, got {spans[0][2]} x {spans[1][2]}")
    azimuth, elevation = (np.linspace(low, high, count) for low, high, count in spans)
    rings = np.repeat(np.arange(len(elevation))[:, None], len(azimuth), axis=1)
    near, far = node.number("range/min", 0.0, minimum=0.0), node.number("range/max", math.inf)
    return Rays(directions_at(azimuth, elevation[:, None]), rings=rings, near=near, far=far, axes="ros_body")
