# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Queries of the surfaces of one world: distances, free space for a robot, points inside solids, minimum heights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_points, check_length, empty, surely_finite
from warpvis.core.checks import as_items, check_choice, is_whole
from warpvis.core.poses import QuaternionOrder, check_up, parse_poses, poses_to_matrices, to_xyzw
from warpvis.core.threads import launch_points
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, PoseLike
from warpvis.errors import ArrayError, PoseError
from warpvis.scene import Scene, require_scene
from warpvis.scene.closed import may_contain_points
from warpvis.scene.worlds import parse_worlds, pose_columns
from warpvis.visibility import choose_objects

# Exceeds all distances in a scene, and its square is finite in single precision.
_FARTHEST = 1e19

# Relative to the largest coordinate; exceeds the single-precision error of the search for triangles.
_ROUNDING = 4e-6


def clearance(
    scene: Scene,
    points: ArrayInput,
    *,
    max_distance: float = math.inf,
    objects: Sequence[str | int] | None = None,
    exclude: Excluded = None,
    object_poses: ObjectPoses = None,
    quaternion: QuaternionOrder = "xyzw",
    threads: int | None = None,
) -> wp.array:
    """Compute the unsigned distance from points to the nearest surface.

    Surfaces are triangles, also those of movable `warpvis.scene.solids.Solid` objects. Degenerate triangles may be
    ignored. The nearest triangle is found in single precision, and its distance is computed in double precision.

    Args:
        scene: The scene.
        points: Points in the world frame [m], shape ``(N, 3)``.
        max_distance: Maximum distance of the search [m]; lower values are faster.
        objects: Names or indices of the objects to search; all by default.
        exclude: Names or indices of objects to ignore.
        object_poses: Poses ``x y z qx qy qz qw`` of the movable objects, ``(M, 7)``; their initial poses by default.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        threads: Number of CPU threads; by default all cores available to the process.

    Returns:
        Distances [m], shape ``(N,)`` float32, on the scene's device; +inf where no surface is nearer than
        `max_distance`, NaN where a point on a GPU is not finite.
    """
    from warpvis.kernels.visibility.clearance import nearest_surface

    max_distance = check_length(max_distance, "max_distance", infinite=True)
    vertices, excluded = one_world(scene, object_poses, exclude, quaternion)
    chosen = [index for index in choose_objects(scene, objects) if not excluded[index]]
    device = scene.device
    places = as_points(points, "points", "N", device)
    distance = empty(places.shape, wp.float32, name="distances", device=device)
    if not chosen:
        distance.fill_(math.inf)
        return distance
    mesh = build_mesh(scene, vertices, chosen)
    outputs = [places, min(max_distance, _FARTHEST), distance]
    launch_points(
        nearest_surface, (1, len(places)), lambda window: [mesh.id, window, *outputs], device=device, threads=threads
    )
    return distance


def standing_room(
    scene: Scene,
    camera_to_world: PoseLike,
    *,
    radius: float,
    floor: float = 0.0,
    step: float = 0.01,
    exclude: Excluded = None,
    object_poses: ObjectPoses = None,
    quaternion: QuaternionOrder = "xyzw",
    threads: int | None = None,
) -> NDArray[np.bool_]:
    """Return whether an upright robot has room at each of its camera's poses.

    The robot is an upright cylinder around the camera, from `step` above the floor up to the camera's height. It has
    room if no triangle intersects the cylinder and its top is not inside a closed object whose triangles face outward.
    The computation uses double precision, so it is exact up to the rounding of the input to single precision. Objects
    of the scene's `ground_labels` are not obstacles.

    Args:
        scene: The scene. Obstacles are triangles, also those of movable `warpvis.scene.solids.Solid` objects.
        camera_to_world: Poses as for `Renderer.render`; only the positions are used.
        radius: The robot's radius [m].
        floor: Height of the floor along the scene's up axis [m].
        step: Height above the floor up to which geometry is ignored [m], such as a threshold, or a floor with another
            label.
        exclude: Names or indices of objects that are not obstacles, such as the robot's body.
        object_poses: Poses ``x y z qx qy qz qw`` of the movable objects, ``(M, 7)``; their initial poses by default.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        threads: Number of CPU threads; by default all cores available to the process.

    Returns:
        Whether there is room, shape ``(V,)``; False for a camera that is not higher than `step` above the floor.
    """
    from warpvis.kernels.visibility.clearance import find_free_poses

    camera_to_world = to_xyzw(camera_to_world, quaternion, "camera_to_world")
    radius = check_length(radius, "radius", zero=False)
    low = check_length(floor, "floor", signed=True) + check_length(step, "step")
    vertices, excluded = one_world(scene, object_poses, exclude, quaternion)
    device, up = scene.device, check_up(scene.up)
    poses = parse_poses(camera_to_world, device=device)
    hinders = [i for i, item in enumerate(scene.objects) if item.label not in scene.ground_labels and not excluded[i]]
    mesh = build_mesh(scene, vertices, hinders) if hinders else None
    cameras = poses.numpy().reshape(-1, 7)[:, :3]
    solid = [may_contain_points(vertices[i], scene.objects[i].faces, cameras) for i in hinders]
    flags = np.repeat(np.array(solid, dtype=np.uint8), [len(scene.objects[i].faces) for i in hinders])
    inputs = [mesh.id if mesh else 0, wp.array(flags, dtype=wp.uint8, device=device), up, poses]
    is_free = empty(poses.shape, wp.uint8, name="room", device=device)
    outputs = [wp.float64(low), wp.float64(radius), is_free]
    launch_points(
        find_free_poses, (1, len(poses)), lambda window: [*inputs, window, *outputs], device=device, threads=threads
    )
    return is_free.numpy() != 0


def check_exclude(exclude: Excluded) -> list[str | int]:
    """Check names or indices of objects that are excluded in all views, and return them."""
    items = [] if exclude is None else as_items(exclude, "exclude")
    if not all(isinstance(item, str) or is_whole(item) for item in items):
        raise ArrayError("exclude must be names or indices of objects, the same for all views")
    return items


def one_world(
    scene: Scene, object_poses: ObjectPoses, exclude: Excluded, quaternion: QuaternionOrder = "xyzw"
) -> tuple[list[NDArray[np.float32]], NDArray[np.bool_]]:
    """Return the vertices of all objects in one world [m], ``(n, 3)`` each, and flags of the excluded objects."""
    require_scene(scene)
    objects = scene.require_objects()
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    worlds = parse_worlds(scene, 1, object_poses, np.zeros(1, dtype=np.int32), exclude)
    if worlds.object_poses.shape[0] != 1:
        raise PoseError(f"object_poses must be of one world, got {worlds.object_poses.shape[0]}")
    rows = worlds.object_poses.numpy().reshape(-1, 7)
    with np.errstate(invalid="ignore"):  # poses from a GPU are not validated
        matrices = poses_to_matrices(rows)
    vertices = []
    for item, column in zip(objects, pose_columns(scene).tolist(), strict=True):
        if column < 0:
            vertices.append(item.vertices)
            continue
        matrix = matrices[column]
        vertices.append((item.frame_vertices @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32))
        if not surely_finite(vertices[-1]) and not np.isfinite(vertices[-1]).all():
            raise PoseError(
                f"object_poses must be finite, have a rotation, and keep {item.name!r} at finite coordinates"
            )
    excluded = np.zeros(len(objects), dtype=bool)
    if worlds.excluded is not None and worlds.excluded.size:
        excluded[:] = worlds.excluded.numpy()[0] != 0
    return vertices, excluded


def corners_of(scene: Scene, vertices: Sequence[NDArray[np.float32]], chosen: Sequence[int]) -> NDArray[np.float32]:
    """Gather the triangles of the chosen objects, shape ``(T, 3, 3)``, in the order of `chosen`."""
    return np.concatenate([vertices[index][scene.objects[index].faces] for index in chosen])


def build_mesh(scene: Scene, vertices: Sequence[NDArray[np.float32]], chosen: Sequence[int]) -> wp.Mesh:
    """Build one `wp.Mesh` of some of the scene's objects, with vertices from `one_world`."""
    device = scene.device
    corners = corners_of(scene, vertices, chosen).reshape(-1, 3)
    return wp.Mesh(
        points=wp.array(corners, dtype=wp.vec3, device=device),
        indices=wp.array(np.arange(len(corners), dtype=np.int32), dtype=wp.int32, device=device),
        bvh_constructor="sah" if device.is_cpu else "cubql",
    )


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
        object_poses: Poses ``x y z qx qy qz qw`` of the movable objects, ``(M, 7)``; their initial poses by default.
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
    further, for example under a bridge; the result is the lowest height with a free line. It is exact: each occluding
    triangle gives an interval of heights (in double precision); heights are not sampled.

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
        object_poses: Poses ``x y z qx qy qz qw`` of the movable objects, ``(M, 7)``; their initial poses by default.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        exclude: Names or indices of objects that do not occlude.
        threads: Number of CPU threads; by default all cores available to the process.

    Returns:
        Heights [m], shape ``(E, N)`` float32, on the scene's device: 0 where the line is free without raising, +inf
        where raising by `max_height` does not suffice, NaN where an input on a GPU is not finite.
    """
    from warpvis.kernels.visibility.heights import climb

    check_choice(raises, "raises", ("target", "eye"))
    max_height = check_length(max_height, "max_height")
    end_tolerance = check_length(end_tolerance, "end_tolerance", zero=False)
    vertices, excluded = one_world(scene, object_poses, exclude, quaternion)
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
