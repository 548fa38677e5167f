# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of depth images, scenes from outside, and overviews of both with a floor map."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.pinhole import Camera, require_camera
from warpvis.core.arrays import as_numpy, check_shape
from warpvis.core.checks import as_items, check_text, is_number
from warpvis.core.poses import QuaternionOrder, look_at, poses_to_matrices, poses_to_opencv
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.maps import FloorMap, label_colors
from warpvis.rendering import Views
from warpvis.scene import Scene, require_scene
from warpvis.viz._drawing import OUTSIDE_CAMERA, draw_lines, frustum, one_pose, shaded_picture
from warpvis.viz._figures import draw_legend, draw_map, legend_height, new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_UNSEEN_TINT = np.array([0.60, 0.62, 0.66])


def save_depth(
    depth: ArrayInput,
    path: str | os.PathLike[str],
    *,
    title: str = "Depth",
    depth_range: tuple[float, float] | None = None,
) -> None:
    """Write a picture of a depth image with a color bar in meters.

    Args:
        depth: Planar depth [m], shape ``(H, W)``; pixels without depth are gray.
        path: Picture to write.
        title: Title of the picture.
        depth_range: Depths at the ends of the color bar [m]; the range of the image by default.
    """
    check_text(title, "title")
    figure = new_figure(5.4, 4.2)
    _draw_depth(figure.subplots(), as_numpy(depth, name="depth"), title, depth_range)
    save_figure(figure, path)


def save_overview(
    scene: Scene,
    camera: Camera,
    camera_to_world: ArrayLike,
    views: Views,
    floor_map: FloorMap,
    path: str | os.PathLike[str],
    *,
    title: str,
    eye: Sequence[float],
    target: Sequence[float],
    quaternion: QuaternionOrder = "xyzw",
) -> None:
    """Write one picture of a view: the scene from outside, the depth image and the floor map.

    In the picture from outside, surfaces that the camera sees have the colors of the map, and others are gray.

    Args:
        scene: The scene.
        camera: The camera of the view.
        camera_to_world: The camera's pose, ``x y z qx qy qz qw``.
        views: The view's depth and objects.
        floor_map: The view's map.
        path: Picture to write.
        title: Title of the picture.
        eye: Viewpoint of the picture from outside [m].
        target: Point at the center of the picture from outside [m].
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
    """
    camera_to_world = one_pose(camera_to_world, "camera_to_world", quaternion=quaternion)
    check_text(title, "title")
    require_scene(scene)
    require_camera(camera)
    if not isinstance(views, Views) or views.depth is None or views.segmentation is None:
        raise ArrayError("views must be warpvis.Views with depth and segmentation")
    for name in ("depth", "segmentation"):
        check_shape(getattr(views, name).shape, ("V", camera.height, camera.width), name=name)
    if not isinstance(floor_map, FloorMap):
        raise ArrayError(f"floor_map must be a warpvis.FloorMap, got {type(floor_map).__name__}")
    legend = floor_map.legend
    figure = new_figure(15.0, 4.79 + legend_height(legend, columns=6))
    outside, image, plan = figure.subplots(1, 3, width_ratios=(1.33, 1.45, 1.0))
    pose, seen = look_at(eye, target, up=scene.up), (views.depth.numpy()[0], views.segmentation.numpy()[0])
    outside.imshow(view_from_outside(scene, OUTSIDE_CAMERA, pose, camera, camera_to_world, *seen))
    draw_lines(outside, OUTSIDE_CAMERA, pose, frustum(camera, camera_to_world, reach=1.0))
    limits = {"xlim": (0, OUTSIDE_CAMERA.width), "ylim": (OUTSIDE_CAMERA.height, 0)}
    outside.set(**limits, title="From outside (colored: seen)")
    outside.set_axis_off()
    _draw_depth(image, views.depth.numpy()[0], "Depth image", (camera.near, camera.far))
    draw_map(plan, floor_map.rgb()[0], floor_map.bounds, floor_map.axes, "Seen floor")
    draw_legend(figure, legend, columns=6)
    figure.suptitle(title, fontsize=14, fontweight="bold")
    save_figure(figure, path)


def view_from_outside(
    scene: Scene,
    outside: Camera,
    outside_to_world: ArrayLike,
    camera: Camera,
    camera_to_world: ArrayLike,
    depth: ArrayInput,
    segmentation: ArrayInput,
    *,
    quaternion: QuaternionOrder = "xyzw",
) -> NDArray[np.float64]:
    """Render a shaded picture of a scene in which only surfaces that a camera sees are colored.

    Args:
        scene: The scene.
        outside: The camera of the picture.
        outside_to_world: Pose of `outside`.
        camera: The camera whose view is shown.
        camera_to_world: Pose of `camera`.
        depth: Planar depth of `camera` [m], shape ``(h, w)``.
        segmentation: Objects seen by `camera`, shape ``(h, w)``, -1 for none.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.

    Returns:
        RGB image from 0 to 1, shape ``(H, W, 3)``.
    """
    outside_to_world = one_pose(outside_to_world, "outside_to_world", quaternion=quaternion)
    camera_to_world = one_pose(camera_to_world, "camera_to_world", quaternion=quaternion)
    require_scene(scene)
    require_camera(outside)
    require_camera(camera)
    palette = label_colors() / 255
    image = (as_numpy(depth, name="depth"), as_numpy(segmentation, name="segmentation"))
    for name, array in zip(("depth", "segmentation"), image, strict=True):
        check_shape(array.shape, (camera.height, camera.width), name=name)

    def colors(
        points: NDArray[np.float32], objects: NDArray[np.int32], labels: NDArray[np.uint8]
    ) -> NDArray[np.float64]:
        seen = _seen_from(points, objects, camera, camera_to_world, *image)
        return np.where(seen[..., None], palette[labels], 0.25 * palette[labels] + 0.75 * _UNSEEN_TINT)

    return shaded_picture(scene, outside, outside_to_world, colors)


def _seen_from(
    points: NDArray[np.float32],
    objects: NDArray[np.int32],
    camera: Camera,
    camera_to_world: ArrayLike,
    depth: NDArray[np.float32],
    segmentation: NDArray[np.int32],
) -> NDArray[np.bool_]:
    """Return whether points are visible in a camera's image: a pixel at most one away has their depth and object."""
    matrix = poses_to_matrices(poses_to_opencv(camera_to_world))[0]
    local = (points.astype(np.float64) - matrix[:3, 3]) @ matrix[:3, :3]
    z = local[..., 2]
    pixels = np.floor(np.nan_to_num(camera.project(local), nan=-9)).clip(-9, 1e6).astype(np.int64)
    # Depth may have an integer type, without infinity, and objects an unsigned type, without -1.
    depth = np.pad(depth.astype(np.float64), 1, constant_values=np.inf)
    objects_seen = np.pad(segmentation.astype(np.int64), 1, constant_values=-1)
    inside = ((pixels >= 0) & (pixels < [camera.width, camera.height])).all(axis=-1) & (z > 0)
    columns, rows = np.where(inside[..., None], pixels + 1, 0)[..., 0], np.where(inside, pixels[..., 1] + 1, 0)
    seen = np.zeros(z.shape, dtype=bool)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            row, column = np.maximum(rows + dy, 0), np.maximum(columns + dx, 0)
            near = np.abs(depth[row, column] - z) < 0.03 + 0.02 * z
            seen |= inside & near & (objects_seen[row, column] == objects)
    return seen


def _draw_depth(axes: Axes, depth: NDArray[np.float32], title: str, depth_range: tuple[float, float] | None) -> None:
    import matplotlib

    check_shape(depth.shape, ("H", "W"), name="depth")
    finite = depth[np.isfinite(depth)]
    if depth_range is not None:
        ends = as_items(depth_range, "depth_range")
        if len(ends) != 2 or not all(is_number(end) and not math.isnan(end) for end in ends):
            raise ArrayError(f"depth_range must be two numbers of meters, got {depth_range!r}")
        depth_range = (float(ends[0]), float(ends[1]))
    low, high = depth_range or ((finite.min(), finite.max()) if finite.size else (0, 1))
    if not np.isfinite(high):
        high = finite.max() if finite.size else low + 1
    colors = matplotlib.colormaps["turbo_r"].with_extremes(bad="#d9d9d9")
    image = axes.imshow(np.ma.masked_invalid(depth), cmap=colors, vmin=low, vmax=high)
    axes.set(title=title, xlabel="x [px]", ylabel="y [px]")
    bar = axes.figure.colorbar(image, ax=axes, shrink=0.85, pad=0.02)
    bar.set_label("planar depth [m], gray: none")
