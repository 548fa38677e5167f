# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Picture from outside of two agents in their scene."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import as_point
from warpvis.core.poses import check_up, look_at, poses_to_matrices
from warpvis.planning import best_views
from warpvis.pose_generators import fitting_distance
from warpvis.visibility import FieldOfView
from warpvis.viz._drawing import OUTSIDE_CAMERA, draw_arrow, draw_lines, draw_name, frustum, shaded_picture, to_picture
from warpvis.viz._states import PanelData

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_OUTSIDE_AZIMUTHS, _OUTSIDE_HEIGHTS = 12, (0.6, 0.9)
_MARGIN_SHARE = 0.03
# Margins around the drawn content [px]; agents' names need space above it.
_MARGIN, _MARGIN_ABOVE = 12, 45


def draw_outside(axes: Axes, data: PanelData, eye: ArrayLike | None, target: ArrayLike | None) -> None:
    """Draw the scene, the agents' gazes and the frustums of their cameras or fields of attention."""
    pose = _outside_pose(data, eye, target)
    camera, scene = OUTSIDE_CAMERA, data.scene
    picture = shaded_picture(
        scene, camera, pose, lambda points, objects, labels: data.colors[objects], object_poses=data.object_poses
    )
    axes.imshow(picture)
    reach = 0.17 * float(np.linalg.norm(np.subtract(*data.bounds)))
    rows, columns = np.nonzero((picture < 1).any(axis=2))
    drawn = [np.stack([columns, rows], axis=1).astype(np.float64)]
    starts = to_picture(camera, pose, [data.pose(k)[:3] for k in (0, 1)])
    for k, agent in enumerate(data.agents):
        agent_pose = data.pose(k)
        narrow = agent.attention if isinstance(agent.camera, FieldOfView) else agent.camera
        matrix = poses_to_matrices(agent_pose)
        gaze = matrix[:3, 3] + [[0, 0, 0], 1.25 * reach * matrix[:3, 2]]
        lines = [] if narrow is None else frustum(narrow, agent_pose, reach)
        draw_lines(axes, camera, pose, lines)
        start, end = to_picture(camera, pose, gaze)
        if np.isfinite([start, end]).all():
            draw_arrow(axes, start, end)
        drawn += [to_picture(camera, pose, line) for line in [gaze, *lines]]
        is_left = starts[k, 0] <= starts[1 - k, 0]
        draw_name(axes, agent.name, starts[k], (-9 if is_left else 9, 9), "right" if is_left else "left")
    _crop(axes, np.concatenate(drawn), camera)
    axes.set(title="From outside")
    axes.set_axis_off()


def _crop(axes: Axes, drawn: NDArray[np.float64], camera: Camera) -> None:
    """Crop the picture to the positions of drawn content, ``(n, 2)``."""
    size = np.array([camera.width, camera.height])
    inside = drawn[np.isfinite(drawn).all(axis=1) & ((drawn >= 0) & (drawn <= size)).all(axis=1)]
    if len(inside):
        low, high = inside.min(axis=0) - [_MARGIN, _MARGIN_ABOVE], inside.max(axis=0) + _MARGIN
        axes.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]))


def _outside_pose(data: PanelData, eye: ArrayLike | None, target: ArrayLike | None) -> NDArray[np.float64]:
    """Return the pose of the picture from outside: at `eye`, or one from which most objects of interest are visible."""
    scene = data.scene
    low, high = data.bounds
    center = (low + high) / 2 if target is None else as_point(target, "target")
    if eye is not None:
        return look_at(eye, center, up=scene.up)
    poses, distances = [], []
    for direction in _directions(check_up(scene.up)):
        pose = look_at(center + direction, center, up=scene.up)
        pose[:3] = center + direction * fitting_distance(OUTSIDE_CAMERA, pose, center, low, high, margin=_MARGIN_SHARE)
        poses.append(pose)
        places = to_picture(OUTSIDE_CAMERA, pose, [data.pose(agent)[:3] for agent in (0, 1)])
        distances.append(np.linalg.norm(places[0] - places[1]))
    interesting = sorted({*data.states, *data.bodies}) or list(range(len(scene)))
    small = Camera.from_fov(160, 120, hfov=OUTSIDE_CAMERA.hfov)
    # Among poses that show about as much, prefer the one with the agents farthest apart in the picture.
    weights = 1 / np.maximum(distances, 1.0)
    order = best_views(
        scene, small, poses, objects=interesting, object_poses=data.object_poses, path_lengths=weights, tie=0.1
    )
    return order.pose()


def _directions(vertical: int) -> list[NDArray[np.float64]]:
    """Return unit vectors from the center of the scene to the candidate viewpoints."""
    found = []
    for height in _OUTSIDE_HEIGHTS:
        for angle in (np.arange(_OUTSIDE_AZIMUTHS) + 0.5) * (2 * math.pi / _OUTSIDE_AZIMUTHS):
            horizontal = math.cos(height)
            # Components along the floor's axes and up; rolled to x, y and z.
            found.append(
                np.roll([horizontal * math.cos(angle), horizontal * math.sin(angle), math.sin(height)], vertical + 1)
            )
    return found
