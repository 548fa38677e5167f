# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Minimum heights for visibility."""

from __future__ import annotations

from typing import Literal

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_points, check_length, empty
from warpvis.core.checks import check_choice
from warpvis.core.poses import QuaternionOrder, check_up, to_xyzw
from warpvis.core.threads import launch_points
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses
from warpvis.planning._free_space import corners_of, one_world
from warpvis.scene import Scene

# Relative to the largest coordinate; exceeds the single-precision error of the search for triangles.
_ROUNDING = 4e-6


def minimum_height(
    scene: Scene,
    eyes: ArrayInput,
    targets: ArrayInput,
    *,
    raises: Literal["target", "eye"] = "target",
    max_height: float = 10.0,
    end_tolerance: float = 1e-4,
    object_poses: ObjectPoses = None,
    quaternion: QuaternionOrder = "xyzw",
    exclude: Excluded = None,
    threads: int | None = None,
) -> wp.array:
    """Find the minimum height by which each target must be raised to be in each eye's line of sight.

    Lines of sight are straight, from point to point, without a field of view. GDAL's viewshed computes the same for
    height fields (output mode ``GROUND``). Among triangle meshes, a point may be hidden again when it is raised
    further,
    for example under a bridge; the result is the lowest height with a free line. It is exact: each occluding triangle
    gives an interval of heights (in double precision); heights are not sampled.

    A line that only touches an edge, or an edge-on surface, is free. Gaps between triangles count as closed if the
    point is visible through them over less than a micrometer of height.

    Args:
        scene: The scene. Occluders are triangles, also those of movable `warpvis.scene.solids.Solid` objects.
        eyes: Viewpoints in the world frame [m], shape ``(E, 3)``.
        targets: Target points in the world frame [m], shape ``(N, 3)``.
        raises: Which of the two is raised along the scene's up axis: the ``"target"``, or the ``"eye"``.
        max_height: Maximum height of the search [m].
        end_tolerance: Distance from the ends of a line within which occluders are ignored [m], since targets lie on
            surfaces. It applies before raising; for a line that becomes longer, the same fraction at either end is
            ignored. Points within twice `end_tolerance` see each other.
        object_poses: Poses of the movable objects in one world, rows ``x y z qx qy qz qw``, shape ``(M, 7)``. By
            default their initial poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        exclude: Names or indices of objects that do not occlude.
        threads: Number of CPU threads; by default all cores available to the process.

    Returns:
        Heights [m], shape ``(E, N)`` float32, on the scene's device: 0 where the line is free without raising, +inf
        where raising by `max_height` does not suffice, NaN where an input on a GPU is not finite.
    """
    from warpvis.kernels.visibility.heights import climb

    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    check_choice(raises, "raises", ("target", "eye"))
    max_height = check_length(max_height, "max_height")
    end_tolerance = check_length(end_tolerance, "end_tolerance", zero=False)
    vertices, excluded = one_world(scene, object_poses, exclude)
    device = scene.device
    viewers, points = as_points(eyes, "eyes", "E", device), as_points(targets, "targets", "N", device)
    heights = empty((len(viewers), len(points)), wp.float32, name="heights", device=device)
    chosen = np.flatnonzero(~excluded).tolist()
    if not chosen:
        heights.zero_()
        return heights
    blockers, _tree = _build_blockers(corners_of(scene, vertices, chosen), check_up(scene.up), device)
    inputs = [viewers, points, raises == "eye", wp.float64(max_height), wp.float64(end_tolerance), heights]
    launch_points(climb, heights.shape, lambda window: [blockers, window, *inputs], device=device, threads=threads)
    return heights


def _build_blockers(corners: NDArray[np.float32], up: int, device: wp.Device) -> tuple[wp.array, wp.Bvh]:
    """Build a `kernels.visibility.heights.Blockers` and the tree of it, with boxes enlarged for rounding."""
    from warpvis.kernels.visibility.heights import Blockers

    corners = corners[..., [(up + 1) % 3, (up + 2) % 3, up]]  # the kernel's third axis is up
    margin = np.float32(_ROUNDING * (1 + np.abs(corners).max()))
    lows, highs = corners.min(axis=1) - margin, corners.max(axis=1) + margin
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
