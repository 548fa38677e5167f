# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A picture of one view's depth and of what it sees of objects, and where the others would be."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Sequence

import numpy as np

from warpvis.core.camera import Camera
from warpvis.core.checks import check_text
from warpvis.core.labels import Visibility
from warpvis.core.poses import Convention, QuaternionOrder, poses_to_opencv, to_xyzw
from warpvis.core.types import Excluded, ObjectPoses, PoseLike
from warpvis.errors import ArrayError
from warpvis.rendering import render
from warpvis.scene import Scene
from warpvis.visibility import object_visibility
from warpvis.viz._drawing import light_on
from warpvis.viz._figures import new_figure, save_figure

STATUS_COLORS: dict[Visibility, tuple[int, int, int]] = {
    Visibility.VISIBLE: (17, 119, 51),
    Visibility.OCCLUDED: (120, 94, 240),
    Visibility.TOO_NEAR: (230, 159, 0),
    Visibility.TOO_FAR: (86, 180, 233),
}
"""Colours (red, green, blue; 0 to 255) of what is seen of an object, or why it is not; see `STATE_COLORS`."""

_WORDS = {
    Visibility.VISIBLE: "seen",
    Visibility.OCCLUDED: "hidden",
    Visibility.TOO_NEAR: "too near",
    Visibility.TOO_FAR: "too far",
    Visibility.OUT_OF_VIEW: "out of view",
}
_TINT = 0.5
_LEGEND_WIDTH = 80


def save_sightings(
    scene: Scene,
    camera: Camera,
    camera_to_world: PoseLike,
    path: str | os.PathLike[str],
    *,
    objects: Sequence[str | int] | None = None,
    title: str = "What is seen of the objects",
    object_poses: ObjectPoses = None,
    exclude: Excluded = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
) -> None:
    """Write a picture of one view: its depth in grey, and objects in the colour of their status, `STATUS_COLORS`.

    What the view shows of an object is in full colour; where the rest of it would be, there is a tint.

    Args:
        scene: The world.
        camera: The camera.
        camera_to_world: Its one pose.
        path: Picture to write.
        objects: Names or indices of the objects that are coloured; all by default.
        title: Heading.
        object_poses: As for `Renderer.render`.
        exclude: As for `Renderer.render`.
        convention: Axes of the camera frame of the pose.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.

    Raises:
        WarpvisError: An argument is not what it has to be, or the picture cannot be written.
    """
    from matplotlib.patches import Patch

    camera_to_world = to_xyzw(camera_to_world, quaternion, "camera_to_world")
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    check_text(title, "title")
    pose = poses_to_opencv(camera_to_world, convention, name="camera_to_world")
    if len(pose) != 1:
        raise ArrayError(f"camera_to_world must be one pose for one picture, got {len(pose)}")
    worlds = {"object_poses": object_poses, "exclude": exclude}
    views = render(scene, camera, pose, outputs=("depth", "normals"), **worlds)
    depth, normals = views.depth.numpy()[0], views.normals.numpy()[0]
    found = object_visibility(scene, camera, pose, objects=objects, masks=True, **worlds)
    assert found.masks is not None  # asked for
    masks, statuses, fractions = (array.numpy()[0] for array in (found.masks, found.status, found.fraction))

    overlay = np.zeros((camera.height, camera.width, 4))
    for part, opacity in ((1, _TINT), (2, 1.0)):  # what is hidden first, and what is seen on top of it
        for mask, status in zip(masks, statuses, strict=True):
            if status in STATUS_COLORS:
                overlay[mask == part] = [*np.array(STATUS_COLORS[Visibility(status)]) / 255, opacity]
    overlay[..., :3] *= np.nan_to_num(light_on(normals, scene.up), nan=1.0)[..., None]
    figure = new_figure(7.2, 6.4)
    axes = figure.subplots()
    shown = axes.imshow(np.ma.masked_invalid(depth), cmap="gist_gray", vmin=0.0, vmax=_farthest(depth))
    axes.imshow(overlay)
    axes.set(title=title, xlabel="x [px]", ylabel="y [px]")
    figure.colorbar(shown, ax=axes, shrink=0.85, pad=0.02).set_label("planar depth [m], white: none")

    handles = []
    for status, word in _WORDS.items():
        its = np.flatnonzero(statuses == status)
        shares = [f" {fractions[k]:.2f}" if status == Visibility.VISIBLE else "" for k in its]
        names = ", ".join(found.names[k] + share for k, share in zip(its, shares, strict=True))
        label = textwrap.shorten(f"{word}: {names or 'nothing'}", _LEGEND_WIDTH, placeholder=" ...")
        color = np.array(STATUS_COLORS.get(status, (255, 255, 255))) / 255
        handles.append(Patch(facecolor=color, edgecolor="black", linewidth=0.5, label=label))
    figure.legend(handles=handles, loc="outside lower left", frameon=False)
    save_figure(figure, path)


def _farthest(depth: np.ndarray) -> float:
    """Return depth that is nearly white [m]; the greatest in the image is a little darker, to differ from none."""
    finite = depth[np.isfinite(depth)]
    return 1.15 * float(finite.max()) if finite.size else 1.0
