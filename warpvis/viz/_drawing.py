# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Shared drawing functions: shaded scenes, lines in space, agents' names."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras import as_pinhole
from warpvis.cameras.image_cameras import ImageCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.poses import Convention, QuaternionOrder, poses_to_matrices, poses_to_opencv, to_xyzw
from warpvis.core.types import ObjectPoses, PoseLike
from warpvis.errors import ArrayError
from warpvis.rendering import Output, render
from warpvis.scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patheffects import withStroke

_BACKGROUND = np.array([1.0, 1.0, 1.0])
# Direction of the light, along the floor's two axes and up.
_LIGHT = (-0.45, -0.35, 0.82)
_SUPERSAMPLING = 2
# Maximum number of characters in a line of an agent's name.
_NAME_WIDTH = 12

OUTSIDE_CAMERA = Camera.from_fov(640, 480, hfov=0.88)
"""Camera of pictures from outside."""

Colors = Callable[[NDArray[np.float32], NDArray[np.int32], NDArray[np.uint8]], NDArray[np.float64]]


def one_pose(
    poses: PoseLike, name: str, convention: Convention = "opencv", quaternion: QuaternionOrder = "xyzw"
) -> NDArray[np.float64]:
    """Return a single pose as a row ``x y z qx qy qz qw`` in OpenCV axes, shape ``(1, 7)``."""
    rows = poses_to_opencv(to_xyzw(poses, quaternion, name), convention, name=name)
    if len(rows) != 1:
        raise ArrayError(f"{name} must be one pose for one picture, got {len(rows)}")
    return rows


def light_on(normals: NDArray[np.floating], up: str) -> NDArray[np.float64]:
    """Return the brightness of surfaces with given normals, shape ``(..., 3)``: from 0.55 in the shade to 1."""
    first, second, height = _LIGHT
    light = np.array([first, second, height] if up == "z" else [second, height, first])
    return 0.55 + 0.45 * np.clip(normals @ (light / np.linalg.norm(light)), 0, 1)


def shaded_picture(
    scene: Scene, camera: Camera, camera_to_world: ArrayLike, colors: Colors, *, object_poses: ObjectPoses = None
) -> NDArray[np.float64]:
    """Render a shaded, antialiased picture of a scene, RGB from 0 to 1, shape ``(H, W, 3)``.

    `colors` returns RGB colors, ``(h, w, 3)``, of points ``(h, w, 3)``, objects and labels ``(h, w)``.
    """
    fine = Camera.from_K(
        camera.to_K() * [[_SUPERSAMPLING], [_SUPERSAMPLING], [1]],
        camera.width * _SUPERSAMPLING,
        camera.height * _SUPERSAMPLING,
    )
    outputs: list[Output] = ["points", "normals", "segmentation", "labels"]
    picture = render(scene, fine, camera_to_world, outputs=outputs, object_poses=object_poses)
    points, normals = picture.points.numpy()[0], picture.normals.numpy()[0]
    objects, labels = picture.segmentation.numpy()[0], picture.labels.numpy()[0]
    color = colors(points, objects, labels) * light_on(normals, scene.up)[..., None]
    color = np.where((objects >= 0)[..., None], color, _BACKGROUND)
    blocks = color.reshape(camera.height, _SUPERSAMPLING, camera.width, _SUPERSAMPLING, 3)
    return blocks.mean(axis=(1, 3))


def frustum(camera: ImageCamera, camera_to_world: ArrayLike, reach: float) -> list[NDArray[np.float64]]:
    """Return lines in the world from the camera to the image's corners and around the image, at depth `reach`.

    For lenses, `reach` is a range, and the lines around the image follow its border.
    """
    matrix = poses_to_matrices(poses_to_opencv(camera_to_world))[0]
    w, h, pinhole = camera.width, camera.height, as_pinhole(camera)
    if pinhole is None:
        border = reach * border_rays(camera) @ matrix[:3, :3].T + matrix[:3, 3]
        border_corners = border[:: max(1, len(border) // 4)][:4]
        return [np.stack([matrix[:3, 3], place]) for place in border_corners] + [border]
    corners = pinhole.back_project([(0, 0), (w, 0), (w, h), (0, h)], np.full(4, reach))
    corners = corners @ matrix[:3, :3].T + matrix[:3, 3]
    return [np.stack([matrix[:3, 3], corner]) for corner in corners] + [corners[[0, 1, 2, 3, 0]]]


def border_rays(camera: ImageCamera) -> NDArray[np.float64]:
    """Return unit vectors along an image's border, ``(n, 3)``, from its first corner, skipping pixels without a ray."""
    w, h = camera.width, camera.height
    corners = np.array([(0, 0), (w, 0), (w, h), (0, h), (0, 0)], dtype=np.float64)
    steps = np.linspace(0, 1, 30)[:, None]
    pixels = np.concatenate([(1 - steps) * a + steps * b for a, b in itertools.pairwise(corners)])
    rays = camera.unproject(pixels)
    return rays[np.isfinite(rays[:, 0])]


def to_picture(camera: ImageCamera, camera_to_world: ArrayLike, points: ArrayLike) -> NDArray[np.float64]:
    """Project points in the world into a picture [px], shape ``(n, 2)``; NaN behind the camera."""
    to_camera = np.linalg.inv(poses_to_matrices(camera_to_world))
    return camera.project(np.asarray(points) @ to_camera[:3, :3].T + to_camera[:3, 3])


def draw_lines(
    axes: Axes,
    camera: Camera,
    camera_to_world: ArrayLike,
    lines: Sequence[NDArray[np.float64]],
    linestyle: str = "-",
) -> None:
    """Draw lines in the world, shapes ``(n, 3)``, into a picture."""
    for line in lines:
        points = to_picture(camera, camera_to_world, line)
        axes.plot(*points.T, color="#222222", linewidth=0.8, linestyle=linestyle)


def draw_arrow(axes: Axes, start: ArrayLike, end: ArrayLike, linestyle: str = "-") -> None:
    """Draw an arrow that is visible on any background."""
    style = {"arrowstyle": "-|>", "color": "black", "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
    style |= {"linestyle": linestyle, "path_effects": white_edge()}
    axes.annotate("", _xy(end), _xy(start), arrowprops=style)


def draw_name(
    axes: Axes, name: str, place: ArrayLike, offset: tuple[float, float], side: str, height: str = "bottom"
) -> None:
    """Write an agent's name at an offset [pt] from a position."""
    box = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}
    axes.annotate(
        textwrap.fill(name, _NAME_WIDTH),
        _xy(place),
        offset,
        textcoords="offset points",
        ha=side,
        va=height,
        bbox=box,
        fontweight="bold",
    )


def white_edge() -> list[withStroke]:
    """Return a path effect that makes black lines visible on a dark background."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=3.2, foreground="white")]


def _xy(place: ArrayLike) -> tuple[float, float]:
    x, y = np.asarray(place, dtype=np.float64)
    return float(x), float(y)
