# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visibility on a 2D floor plan, the baseline of the paper.

On the floor plan, every object is its outline from above, without a height, so nearer objects always occlude.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera, require_image_camera
from warpvis.core.checks import as_items
from warpvis.core.poses import Convention, QuaternionOrder, check_up, poses_to_matrices, poses_to_opencv, to_xyzw
from warpvis.core.types import PoseLike
from warpvis.errors import PoseError, SceneError
from warpvis.scene import Scene, require_scene

_EDGES_AT_A_TIME = 20_000


@dataclass(frozen=True)
class PlanVisibility:
    """Lines of sight on the floor plan, one per image column."""

    unoccluded: NDArray[np.int64]
    """Number of columns whose line hits the object's outline in range, ignoring occlusion, shape ``(V, objects)``."""
    first: NDArray[np.int64]
    """Number of columns whose line hits the object's outline first, shape ``(V, objects)``."""

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Whether any line of sight hits the object first, shape ``(V, objects)``; False for ground."""
        return self.first > 0


def plan_visibility(
    scene: Scene,
    camera: ImageCamera,
    camera_to_world: PoseLike,
    *,
    exclude: Sequence[str] = (),
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
) -> PlanVisibility:
    """Find the objects that 2D lines of sight on the floor plan reach.

    One line per image column starts at the camera's position on the plan, in the horizontal direction of the column, up
    to the camera's maximum depth. Outlines are the edges of all triangles seen from above; ground
    (`Scene.ground_labels`) has none. For a lens, the direction of a column is that of its pixel in the row of the
    lens's center; a column without a ray in that row has no line.

    Args:
        scene: The scene.
        camera: The camera, a pinhole or a `warpvis.cameras.LensCamera`. Only its columns and `far` are used.
        camera_to_world: Poses of the camera, shape ``(V, 7)`` or ``(V, 4, 4)``.
        exclude: Names of objects that are ignored, like the robot that carries the camera.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.

    Raises:
        PoseError: If a camera looks straight up or down, where columns have no direction on the plan.
    """
    camera_to_world = to_xyzw(camera_to_world, quaternion, "camera_to_world")
    require_scene(scene)
    require_image_camera(camera)
    vertical = check_up(scene.up)
    floor = [axis for axis in range(3) if axis != vertical]
    poses = poses_to_matrices(poses_to_opencv(camera_to_world, convention, name="camera_to_world"))
    excluded = {scene.index(name) for name in as_items(exclude, "exclude", SceneError)}
    outlines = [_edges(item.vertices[:, floor], item.faces) for item in scene.objects]

    shape = (len(poses), len(outlines))
    unoccluded, first = np.zeros(shape, dtype=np.int64), np.zeros(shape, dtype=np.int64)
    for view, pose in enumerate(poses):
        directions = _column_directions(camera, pose[:3, :3], floor, view)
        distance = np.full((len(outlines), camera.width), np.inf)
        for index, (item, edges) in enumerate(zip(scene.objects, outlines, strict=True)):
            if item.label not in scene.ground_labels and index not in excluded:
                distance[index] = _nearest_edge(pose[floor, 3], directions, edges)
        distance[distance > camera.far] = np.inf
        met = np.isfinite(distance)
        nearest = distance.argmin(axis=0)
        unoccluded[view] = met.sum(axis=1)
        first[view] = np.bincount(nearest[met.any(axis=0)], minlength=len(outlines))
    return PlanVisibility(unoccluded, first)


def _edges(corners: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return the unique edges of all triangles on the plan, shape ``(n, 2, 2)``."""
    pairs = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges = corners[np.unique(pairs, axis=0)].astype(np.float64)
    return edges[(edges[:, 0] != edges[:, 1]).any(axis=1)]


def _column_directions(
    camera: ImageCamera, rotation: NDArray[np.float64], floor: list[int], view: int
) -> NDArray[np.float64]:
    """Compute directions on the plan, ``(W, 2)``: unit vectors, or of length 1 along the heading if depth is planar."""
    heading = rotation[floor, 2]
    if np.linalg.norm(heading) < 1e-6:
        raise PoseError(f"camera_to_world must not look straight up or down on a floor plan: view {view} does")
    x = np.arange(camera.width) + 0.5
    rays = camera.depth_rays(np.stack([x, np.full_like(x, camera.project([0.0, 0.0, 1.0])[1])], axis=1))
    rays[:, 1] = 0  # in the row of the camera's center
    directions = (rays @ rotation.T)[:, floor]
    if camera.kind == "z":
        return directions / np.linalg.norm(heading)
    with np.errstate(invalid="ignore"):  # vertical rays have no direction
        return directions / np.linalg.norm(directions, axis=1)[:, None]


def _nearest_edge(
    origin: NDArray[np.float64], directions: NDArray[np.float64], edges: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Compute the parameter of each ray's first intersection with a segment, +inf for none, shape ``(rays,)``."""
    nearest = np.full(len(directions), np.inf)
    for start in range(0, len(edges), _EDGES_AT_A_TIME):
        a = edges[start : start + _EDGES_AT_A_TIME, 0] - origin
        ab = edges[start : start + _EDGES_AT_A_TIME, 1] - origin - a
        with np.errstate(divide="ignore", invalid="ignore"):
            # origin + t d = a + s ab, by Cramer's rule.
            determinant = directions[:, :1] * ab[:, 1] - directions[:, 1:] * ab[:, 0]
            t = (a[:, 0] * ab[:, 1] - a[:, 1] * ab[:, 0]) / determinant
            s = (a[:, 0] * directions[:, 1:] - a[:, 1] * directions[:, :1]) / determinant
        crossing = np.where((t > 0) & (s >= 0) & (s <= 1), t, np.inf)
        nearest = np.minimum(nearest, crossing.min(axis=1, initial=np.inf))
    return nearest
