# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Point-in-solid tests."""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_points, empty
from warpvis.core.poses import check_up
from warpvis.core.threads import launch_points
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses
from warpvis.planning._free_space import build_mesh, one_world
from warpvis.scene import Scene
from warpvis.scene.closed import may_contain_points


def inside_solids(
    scene: Scene,
    points: ArrayInput,
    *,
    exclude: Excluded = None,
    object_poses: ObjectPoses = None,
    threads: int | None = None,
) -> NDArray[np.bool_]:
    """Return whether points are inside closed objects whose triangles face outward.

    A vertical ray from a point inside such objects crosses more triangles that face up than triangles that face down.
    Only objects whose triangles are watertight and enclose a positive volume are considered; objects that face inward,
    like the walls of a room, have no inside. Movable `warpvis.scene.solids.Solid` objects are represented by triangles.

    Args:
        scene: The scene.
        points: Points in the world frame [m], shape ``(N, 3)``.
        exclude: Names or indices of objects to ignore.
        object_poses: Poses of the movable objects in one world, rows ``x y z qx qy qz qw``, shape ``(M, 7)``. By
            default their initial poses.
        threads: Number of CPU threads; by default all cores available to the process.

    Returns:
        Whether each point is inside, shape ``(N,)``.
    """
    from warpvis.kernels.visibility.clearance import find_inside

    vertices, excluded = one_world(scene, object_poses, exclude)
    device = scene.device
    places = as_points(points, "points", "N", device)
    host = places.numpy()
    chosen = [
        i
        for i, item in enumerate(scene.objects)
        if not excluded[i] and may_contain_points(vertices[i], item.faces, host)
    ]
    if not chosen:
        return np.zeros(len(host), dtype=bool)
    mesh = build_mesh(scene, vertices, chosen)
    solid = wp.ones(sum(len(scene.objects[i].faces) for i in chosen), dtype=wp.uint8, device=device)
    inside = empty(places.shape, wp.uint8, name="inside", device=device)
    inputs = [mesh.id, solid, check_up(scene.up)]
    launch_points(
        find_inside,
        (1, len(places)),
        lambda window: [*inputs, window, places, inside],
        device=device,
        threads=threads,
    )
    return inside.numpy() != 0
