# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of the visibility of objects or points in one view."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.core.arrays import as_numpy
from warpvis.core.checks import check_text, format_fraction
from warpvis.core.labels import Visibility
from warpvis.core.poses import Convention, QuaternionOrder, parse_poses, to_xyzw
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, PoseLike
from warpvis.rendering import render
from warpvis.scene import Scene
from warpvis.scene.worlds import parse_worlds
from warpvis.visibility import choose_objects, point_visibility, see_objects
from warpvis.viz._drawing import light_on, one_pose, to_picture
from warpvis.viz._figures import new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
