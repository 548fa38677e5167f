# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""How far points must be raised to be seen."""

from __future__ import annotations

from typing import Literal

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_points, check_metres, empty
from warpvis.core.checks import check_choice
from warpvis.core.poses import QuaternionOrder, check_up, to_xyzw
from warpvis.core.threads import launch_points
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses
from warpvis.planning._free_space import corners_of, one_world
from warpvis.scene import Scene

# Of the greatest coordinate: more than the search for triangles loses to single precision.
_ROUNDING = 4e-6


def minimum_height(
    scene: Scene,
    eyes: ArrayInput,
    targets: ArrayInput,
    *,
    raises: Literal["target", "eye"] = "target",
    max_height: float = 10.0,
    tolerance: float = 1e-4,
    object_poses: ObjectPoses = None,
    quaternion: QuaternionOrder = "xyzw",
    exclude: Excluded = None,
    threads: int | None = None,
) -> wp.array:
    """Find the least height by which each target must be raised to be in each eye's line of sight.

    Lines of sight are straight, from point to point; there is no field of view. GDAL's viewshed asks the same of height
    fields (output mode ``GROUND``). Among triangle meshes a point may be hidden again when it is raised further, under
    a bridge for instance: the answer is the least height from which the line is free. It is exact, from an interval of
    heights for each triangle in the way (double precision), and not found by trying heights.

    A line that touches no more than an edge, or a surface edge-on, is free. Gaps between triangles through which the
    point would be seen over less than a micrometre of height count as closed.

    Args:
        scene: What may be in the way: the triangles, also of movable `warpvis.scene.solids.Solid` objects.
        eyes: Points to see from, in the world frame [m], shape ``(E, 3)``.
        targets: Points to be seen [m], shape ``(N, 3)``.
        raises: Which of the two is raised, along the scene's up axis: the ``"target"``, or the ``"eye"``.
        max_height: Greatest height looked for [m].
        tolerance: How far from its ends a line may be blocked and count as free [m], as targets lie on surfaces. It is
            measured before raising; of a line that gets longer, the same share at either end does not count.
            Points within twice the tolerance see each other.
        object_poses: Where the movable objects are, in one world: rows ``x y z qx qy qz qw``, shape ``(M, 7)``. By
            default where they were added.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        exclude: Names or indices of objects that are not in the way.
        threads: CPU threads to use; all cores of this process by default.

    Returns:
        Heights [m], shape ``(E, N)`` float32, on the scene's device: 0 where the line is free as it is, +inf where
        raising by `max_height` does not suffice, NaN where an input of a GPU was not finite.

    Raises:
        WarpvisError: An argument is not what it has to be.
    """
    from warpvis.kernels.heights import climb

    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    check_choice(raises, "raises", ("target", "eye"))
    max_height = check_metres(max_height, "max_height")
    tolerance = check_metres(tolerance, "tolerance", zero=False)
    vertices, excluded = one_world(scene, object_poses, exclude)
    device = scene.device
    viewers, points = as_points(eyes, "eyes", "E", device), as_points(targets, "targets", "N", device)
    heights = empty((len(viewers), len(points)), wp.float32, name="heights", device=device)
    chosen = np.flatnonzero(~excluded).tolist()
    if not chosen:
        heights.zero_()
        return heights
    blockers, _tree = _build_blockers(corners_of(scene, vertices, chosen), check_up(scene.up), device)
    given = [viewers, points, raises == "eye", wp.float64(max_height), wp.float64(tolerance), heights]
    launch_points(climb, heights.shape, lambda window: [blockers, window, *given], device=device, threads=threads)
    return heights


def _build_blockers(corners: NDArray[np.float32], up: int, device: wp.Device) -> tuple[wp.array, wp.Bvh]:
    """Build a `warpvis.kernels.heights.Blockers` and the tree that it refers to, in boxes with room for rounding."""
    from warpvis.kernels.heights import Blockers

    corners = corners[..., [(up + 1) % 3, (up + 2) % 3, up]]  # the kernel's third axis is up
    room = np.float32(_ROUNDING * (1 + np.abs(corners).max()))
    lows, highs = corners.min(axis=1) - room, corners.max(axis=1) + room
    tree = wp.Bvh(
        wp.array(lows, dtype=wp.vec3, device=device),
        wp.array(highs, dtype=wp.vec3, device=device),
        constructor="sah" if device.is_cpu else None,
        leaf_size=4 if device.is_cpu else 1,
    )
    blockers = Blockers()
    blockers.tree = tree.id
    blockers.corners = wp.array(corners, dtype=wp.vec3, device=device)
    blockers.low, blockers.high = wp.vec3d(*lows.min(axis=0).tolist()), wp.vec3d(*highs.max(axis=0).tolist())
    blockers.up = up
    return blockers, tree
