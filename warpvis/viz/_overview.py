# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of one view: its depth, the scene from outside, the floor that it sees, and visible objects or points."""

from __future__ import annotations

import math
import os
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.cameras.pinhole import Camera, require_camera
from warpvis.core.arrays import as_numpy, check_shape
from warpvis.core.checks import as_items, check_text, format_fraction, is_number
from warpvis.core.labels import Visibility
from warpvis.core.poses import (
    Convention,
    QuaternionOrder,
    look_at,
    parse_poses,
    poses_to_matrices,
    poses_to_opencv,
    to_xyzw,
)
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, PoseLike
from warpvis.errors import ArrayError
from warpvis.maps import FloorMap, label_colors
from warpvis.rendering import Views, render
from warpvis.scene import Scene, require_scene
from warpvis.scene.worlds import parse_worlds
from warpvis.visibility import choose_objects, point_visibility, see_objects
from warpvis.viz._drawing import OUTSIDE_CAMERA, draw_lines, frustum, light_on, one_pose, shaded_picture, to_picture
from warpvis.viz._figures import draw_legend, draw_map, legend_height, new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_UNSEEN_TINT = np.array([0.60, 0.62, 0.66])

OBJECT_COLORS = (
    (31, 119, 180),
    (214, 39, 40),
    (44, 160, 44),
    (255, 127, 14),
    (148, 103, 189),
    (23, 190, 207),
    (227, 119, 194),
    (188, 189, 34),
    (140, 86, 75),
    (0, 60, 120),
    (255, 187, 120),
    (152, 223, 138),
)
"""RGB colors of objects, 0 to 255, used cyclically; see `STATUS_COLORS` for colors of points."""

STATUS_COLORS: dict[Visibility, tuple[int, int, int]] = {
    Visibility.VISIBLE: (17, 119, 51),
    Visibility.OCCLUDED: (120, 94, 240),
    Visibility.TOO_NEAR: (230, 159, 0),
    Visibility.TOO_FAR: (86, 180, 233),
}
"""RGB colors of points, 0 to 255, by their visibility; see also `STATE_COLORS`."""

_STATUS_TEXTS = {
    Visibility.VISIBLE: "seen",
    Visibility.OCCLUDED: "hidden",
    Visibility.TOO_NEAR: "too near",
    Visibility.TOO_FAR: "too far",
    Visibility.OUT_OF_VIEW: "out of view",
}
_TINT = 0.5
_LEGEND_WIDTH = 90
_LEGEND_COLUMNS, _MAX_NAMED, _LONGEST_NAME = 3, 15, 20


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
    """Write one picture of a view: the scene from outside, the color image if rendered, the depth image and the map.

    In the picture from outside, surfaces that the camera sees have the colors of the map, and others are gray.

    Args:
        scene: The scene.
        camera: The camera of the view.
        camera_to_world: The camera's pose, ``x y z qx qy qz qw``.
        views: The view's depth and objects, and optionally its color.
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
    shown = ("depth", "segmentation") if views.color is None else ("depth", "segmentation", "color")
    for name in shown:
        check_shape(getattr(views, name).shape, ("V", camera.height, camera.width), name=name)
    if not isinstance(floor_map, FloorMap):
        raise ArrayError(f"floor_map must be a warpvis.FloorMap, got {type(floor_map).__name__}")
    legend = floor_map.legend
    has_color = views.color is not None
    widths = (1.27, 1.38, 1.42, 0.97) if has_color else (1.33, 1.45, 1.0)
    figure = new_figure(20.0 if has_color else 15.0, 4.79 + legend_height(legend, columns=6))
    outside, *image_axes, plan = figure.subplots(1, len(widths), width_ratios=widths)
    pose, seen = look_at(eye, target, up=scene.up), (views.depth.numpy()[0], views.segmentation.numpy()[0])
    outside.imshow(view_from_outside(scene, OUTSIDE_CAMERA, pose, camera, camera_to_world, *seen))
    draw_lines(outside, OUTSIDE_CAMERA, pose, frustum(camera, camera_to_world, reach=1.0))
    limits = {"xlim": (0, OUTSIDE_CAMERA.width), "ylim": (OUTSIDE_CAMERA.height, 0)}
    outside.set(**limits, title="From outside (colored: seen)")
    outside.set_axis_off()
    if has_color:
        image_axes[0].imshow(views.color.numpy()[0])
        image_axes[0].set(title="RGB image", xlabel="x [px]", ylabel="y [px]")
    _draw_depth(image_axes[-1], views.depth.numpy()[0], "Depth image", (camera.near, camera.far))
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


def save_sightings(
    scene: Scene,
    camera: ImageCamera,
    camera_to_world: PoseLike,
    path: str | os.PathLike[str],
    *,
    objects: Sequence[str | int] | None = None,
    title: str = "Visible parts of the objects",
    object_poses: ObjectPoses = None,
    exclude: Excluded = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
) -> None:
    """Write a picture of one view with depth in gray and colored objects.

    The visible part of an object is opaque, and its hidden part is a tint. The legend gives the visible fraction of
    each object, or the reason why it is not visible. Colors repeat after twelve objects.

    Args:
        scene: The scene.
        camera: The camera.
        camera_to_world: The camera's pose.
        path: Picture to write.
        objects: Names or indices of the colored objects; all by default.
        title: Title of the picture.
        object_poses: As for `Renderer.render`.
        exclude: As for `Renderer.render`.
        convention: Axes of the camera frame of the pose.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
    """
    from matplotlib.patches import Patch

    check_text(title, "title")
    pose = one_pose(camera_to_world, "camera_to_world", convention, quaternion)
    worlds = {"object_poses": to_xyzw(object_poses, quaternion, "object_poses"), "exclude": exclude}
    views = render(scene, camera, pose, outputs=("depth", "normals"), **worlds)
    depth, normals = views.depth.numpy()[0], views.normals.numpy()[0]
    parsed = parse_poses(pose, device=scene.device), parse_worlds(scene, 1, world_index=None, **worlds)
    found = see_objects(scene, camera, *parsed, choose_objects(scene, objects), masks=True)
    assert found.masks is not None  # requested above
    masks, statuses, fractions = (array.numpy()[0] for array in (found.masks, found.status, found.fraction))
    in_view = np.flatnonzero(statuses != Visibility.OUT_OF_VIEW)
    color_of = {
        k: np.array(OBJECT_COLORS[place % len(OBJECT_COLORS)]) / 255 for place, k in enumerate(in_view.tolist())
    }

    overlay = np.zeros((camera.height, camera.width, 4))
    for mask_value, opacity in ((1, _TINT), (2, 1.0)):  # hidden parts first, visible parts on top
        for k, color in color_of.items():
            overlay[masks[k] == mask_value] = [*color, opacity]
    overlay[..., :3] *= np.nan_to_num(light_on(normals, scene.up), nan=1.0)[..., None]
    figure, axes = _draw_view(depth, title, camera)
    axes.imshow(overlay)

    largest = sorted(color_of, key=lambda k: -int((masks[k] > 0).sum()))
    handles = []
    for k in largest[:_MAX_NAMED]:
        status = Visibility(statuses[k])
        share = f" {format_fraction(float(fractions[k]))}" if status == Visibility.VISIBLE else ""
        label = f"{_shorten_name(found.names[k])}: {_STATUS_TEXTS[status]}{share}"
        handles.append(Patch(facecolor=color_of[k], edgecolor="black", linewidth=0.5, label=label))
    figure.legend(handles=handles, loc="outside lower left", ncols=_LEGEND_COLUMNS, frameon=False, fontsize="small")
    missing = [name for name, status in zip(found.names, statuses, strict=True) if status == Visibility.OUT_OF_VIEW]
    notes = [f"{len(largest)} objects, of which {_MAX_NAMED} are named"] if len(largest) > _MAX_NAMED else []
    notes += [f"out of view: {', '.join(missing)}"] if missing else []
    if notes:
        axes.set_xlabel("x [px]\n" + textwrap.shorten("; ".join(notes), _LEGEND_WIDTH, placeholder=" ..."))
    save_figure(figure, path)


def save_point_sightings(
    scene: Scene,
    camera: ImageCamera,
    camera_to_world: PoseLike,
    points: ArrayInput,
    path: str | os.PathLike[str],
    *,
    tolerance: float = 1e-4,
    title: str = "Which points are seen",
    object_poses: ObjectPoses = None,
    exclude: Excluded = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
) -> None:
    """Write a picture of one view with depth in gray and the points in its image in `STATUS_COLORS`.

    Args:
        scene: The scene.
        camera: The camera.
        camera_to_world: The camera's pose.
        points: Points in the world frame [m], shape ``(N, 3)``.
        path: Picture to write.
        tolerance: As for `warpvis.point_visibility` [m].
        title: Title of the picture.
        object_poses: As for `Renderer.render`.
        exclude: As for `Renderer.render`.
        convention: Axes of the camera frame of the pose.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
    """
    from matplotlib.lines import Line2D

    check_text(title, "title")
    pose = one_pose(camera_to_world, "camera_to_world", convention, quaternion)
    worlds = {"object_poses": to_xyzw(object_poses, quaternion, "object_poses"), "exclude": exclude}
    found = point_visibility(scene, camera, pose, points, tolerance=tolerance, **worlds)
    assert not isinstance(found, tuple)  # occluders are not requested
    status = found.numpy()[0]
    positions = to_picture(camera, pose[0], as_numpy(points, name="points"))
    figure, axes = _draw_view(render(scene, camera, pose, outputs=("depth",), **worlds).depth.numpy()[0], title, camera)
    handles = []
    for kind, text in _STATUS_TEXTS.items():
        matches = status == kind
        color = np.array(STATUS_COLORS.get(kind, (255, 255, 255))) / 255
        if kind in STATUS_COLORS:
            x, y = positions[matches].T - 0.5  # in matplotlib, the center of a pixel is at its index
            axes.scatter(x, y, s=14, color=[color], edgecolors="white", linewidths=0.4)
        mark = Line2D([], [], marker="o", color="none", markerfacecolor=color, markeredgecolor="black")
        mark.set_label(f"{text}: {int(matches.sum())}")
        handles.append(mark)
    axes.set(xlim=(-0.5, camera.width - 0.5), ylim=(camera.height - 0.5, -0.5))
    figure.legend(handles=handles, loc="outside lower left", ncols=len(handles), frameon=False, fontsize="small")
    save_figure(figure, path)


def _shorten_name(name: str) -> str:
    """Shorten a long name in its middle, since names often differ at their ends."""
    half = (_LONGEST_NAME - 3) // 2
    return name if len(name) <= _LONGEST_NAME else f"{name[:half]}...{name[-half:]}"


def _draw_view(depth: NDArray[np.floating], title: str, camera: ImageCamera) -> tuple[Figure, Axes]:
    """Create a figure with a depth image in gray and its scale."""
    kind = "planar depth" if camera.kind == "z" else "range"
    figure = new_figure(7.2, 6.4)
    axes = figure.subplots()
    finite = depth[np.isfinite(depth)]
    white = 1.15 * float(finite.max()) if finite.size else 1.0  # beyond all depths, to distinguish missing depth
    image = axes.imshow(np.ma.masked_invalid(depth), cmap="gist_gray", vmin=0.0, vmax=white)
    axes.set(title=title, xlabel="x [px]", ylabel="y [px]")
    figure.colorbar(image, ax=axes, shrink=0.85, pad=0.02).set_label(f"{kind} [m], white: none")
    return figure, axes
