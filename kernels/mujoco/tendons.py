# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tendons as capsules: for the segments of paths, arcs around wrapped geoms, and curves of slack tendons."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fuse_fp": False})

PULLEY = wp.constant(-2)
"""The object of a path point at which another branch begins, in `wrap_obj` of `mujoco.MjData`."""

_STEPS = 50  # of Newton's method; 10 suffice in most cases
_BEAD = wp.constant(wp.float64(100.0))  # slack lengths above this multiple of the horizontal distance
_TAUT = wp.constant(wp.float64(1.0e-12))  # of the relative excess of the length


@wp.struct
class Paths:
    """Paths of tendons in all worlds: arrays of MuJoCo's data."""

    wrap_xpos: wp.array2d[wp.spatial_vector]
    wrap_obj: wp.array2d[wp.vec2i]
    ten_wrapadr: wp.array2d[wp.int32]
    ten_wrapnum: wp.array2d[wp.int32]


@wp.func
def path_count(paths: Paths, world: int, tendon: int) -> int:
    """Return the number of points of a tendon's path; 0 if it is not valid."""
    first, count = paths.ten_wrapadr[world, tendon], paths.ten_wrapnum[world, tendon]
    if first < 0 or count < 2 or first + count > 2 * paths.wrap_xpos.shape[1]:
        return 0
    return count


@wp.func
def path_point(points: wp.array2d[wp.spatial_vector], world: int, index: int) -> wp.vec3:
    """Return a point of `wrap_xpos`, which has two in each element."""
    pair = points[world, index // 2]
    if index % 2 == 0:
        return wp.vec3(pair[0], pair[1], pair[2])
    return wp.vec3(pair[3], pair[4], pair[5])


@wp.func
def path_object(objects: wp.array2d[wp.vec2i], world: int, index: int) -> int:
    """Return the object of a path point: a geom, -1 for a site, or `PULLEY`."""
    return objects[world, index // 2][index % 2]


@wp.func
def catenary_scale(length: wp.float64, across: wp.float64, upward: wp.float64) -> wp.float64:
    """Return the parameter a of the catenary a cosh(x / a) with the given length and extents between its ends [m].

    With u = across / (2 a), sinh(u) / u = s = sqrt(length^2 - upward^2) / across. The logarithm of the left side is
    convex, and u is at most sqrt(6 (s - 1)), so that Newton's method converges from there. 0 for a straight line.
    """
    ratio = wp.sqrt(length * length - upward * upward) / across
    if ratio <= wp.float64(1.0) + _TAUT:
        return wp.float64(0.0)
    target = wp.log(ratio)
    u = wp.sqrt(wp.float64(6.0) * (ratio - wp.float64(1.0)))
    for _ in range(_STEPS):
        value = wp.log(wp.sinh(u) / u) - target
        step = value / (wp.float64(1.0) / wp.tanh(u) - wp.float64(1.0) / u)
        if step < wp.float64(1.0e-12) * u:
            break
        u -= step
    return across / (wp.float64(2.0) * u)


@wp.func
def slack_point(start: wp.vec3d, end: wp.vec3d, up: wp.vec3d, length: wp.float64, index: int, count: int) -> wp.vec3d:
    """Return a point of a tendon that hangs between two points; the last one repeats behind the end of the curve.

    As in `mjv_catenary` of src/engine/engine_vis_visualize.c, the curve is a catenary of `count` points, whose
    horizontal distances are 1 / `count` of that of the ends, except before the last point; or two straight lines if the
    ends are nearly above each other.
    """
    between = end - start
    upward = wp.dot(between, up)
    level = between - up * upward
    across = wp.length(level)
    if index == 0:
        return start
    side = wp.vec3d()
    if across > wp.float64(1.0e-15):
        side = level / across
    if length > _BEAD * across:
        if index > 1:
            return end
        down = wp.float64(-0.5) * (wp.sqrt(length * length - across * across) - upward)
        return start + up * down + side * (across * down / (wp.float64(2.0) * down - upward))
    scale = catenary_scale(length, across, upward)
    if index >= count - 1 or scale == wp.float64(0.0):
        return end
    x = across * wp.float64(index) / wp.float64(count)
    lowest = across / wp.float64(2.0) - scale * wp.float64(0.5) * wp.log((length + upward) / (length - upward))
    half = wp.float64(0.5) / scale
    height = wp.float64(2.0) * scale * wp.sinh((x - wp.float64(2.0) * lowest) * half) * wp.sinh(x * half)
    return start + side * x + up * height


@wp.func
def rotation_to(direction: wp.vec3) -> wp.quat:
    """Return the shortest rotation from z to a unit vector."""
    if direction[2] < -0.9999999:
        return wp.quat(1.0, 0.0, 0.0, 0.0)
    return wp.normalize(wp.quat(-direction[1], direction[0], 0.0, 1.0 + direction[2]))


@wp.func
def capsule_pose(start: wp.vec3, end: wp.vec3) -> wp.transform:
    """Return the pose of a capsule between two points."""
    distance = wp.length(end - start)
    rotation = wp.quat_identity(wp.float32)
    if distance > 0.0:
        rotation = rotation_to((end - start) / distance)
    return wp.transform(0.5 * (start + end), rotation)


@wp.func
def capsule_size(start: wp.vec3, end: wp.vec3, radius: float) -> wp.vec4:
    """Return the size of a capsule between two points, as in `warpvis.kernels.casting.worlds.Worlds`."""
    return wp.vec4(radius, radius, radius, 0.5 * wp.length(end - start) / radius)


@wp.kernel
def tendon_capsules(
    # In:
    paths: Paths,
    worlds: wp.array[wp.int32],
    segments: wp.array[wp.vec2i],
    sizes: wp.array[wp.vec2],
    up: wp.vec3,
    curve_points: int,
    # Out:
    poses_out: wp.array2d[wp.transform],
    sizes_out: wp.array2d[wp.vec4],
    hidden_out: wp.array2d[wp.uint8],
):
    """Write poses, sizes and visibility of the straight parts of tendons in selected worlds.

    `segments` has the tendon of each capsule and the number of its segment, and `sizes` the radius of each tendon and
    the length at which it is taut [m], 0 if it is always straight. Views of `hidden_out` are ordered by camera, then by
    world. The rules are those of `addSpatialTendonGeoms` in src/engine/engine_vis_visualize.c: no segment leads to a
    pulley. Segments within a wrapped geom are hidden, since arcs replace them.
    """
    row, column = wp.tid()
    world, tendon, segment = worlds[row], segments[column][0], segments[column][1]
    first, count = paths.ten_wrapadr[world, tendon], path_count(paths, world, tendon)
    slack_length = sizes[tendon][1]
    start, end = wp.vec3(), wp.vec3()
    shown = False
    if count > 0:
        is_slack = False
        if slack_length > 0.0:
            start, end = path_point(paths.wrap_xpos, world, first), path_point(paths.wrap_xpos, world, first + 1)
            is_slack = wp.length(end - start) < slack_length
        if is_slack:
            low, high, upward = wp.vec3d(start), wp.vec3d(end), wp.vec3d(up)
            length = wp.float64(slack_length)
            start = wp.vec3(slack_point(low, high, upward, length, segment, curve_points))
            end = wp.vec3(slack_point(low, high, upward, length, segment + 1, curve_points))
            shown = segment == 0 or not (start == end)
        elif segment < count - 1:
            start = path_point(paths.wrap_xpos, world, first + segment)
            end = path_point(paths.wrap_xpos, world, first + segment + 1)
            before = path_object(paths.wrap_obj, world, first + segment)
            after = path_object(paths.wrap_obj, world, first + segment + 1)
            shown = before != PULLEY and after != PULLEY and not (before >= 0 and after >= 0)
    poses_out[row, column] = capsule_pose(start, end)
    sizes_out[row, column] = capsule_size(start, end, sizes[tendon][0])
    for view in range(row, hidden_out.shape[0], worlds.shape[0]):
        hidden_out[view, column] = wp.uint8(0) if shown else wp.uint8(1)


@wp.func
def find_arc(paths: Paths, world: int, tendon: int, number: int) -> int:
    """Return the index of the first point of the arc with a number in a path; -1 if it has fewer."""
    first, found = paths.ten_wrapadr[world, tendon], int(0)
    for index in range(first, first + path_count(paths, world, tendon) - 1):
        if path_object(paths.wrap_obj, world, index) >= 0 and path_object(paths.wrap_obj, world, index + 1) >= 0:
            if found == number:
                return index
            found += 1
    return -1


TWO_PI = wp.constant(6.283185307179586)


@wp.kernel
def tendon_arcs(
    # In:
    paths: Paths,
    geom_xpos: wp.array2d[wp.vec3],
    geom_xmat: wp.array2d[wp.mat33],
    is_cylinder: wp.array[wp.int32],
    worlds: wp.array[wp.int32],
    arcs: wp.array[wp.vec3i],
    sizes: wp.array[wp.vec2],
    slices: float,
    max_pieces: int,
    # Out:
    poses_out: wp.array2d[wp.transform],
    sizes_out: wp.array2d[wp.vec4],
    hidden_out: wp.array2d[wp.uint8],
):
    """Write poses, sizes and visibility of the arcs of tendons around spheres and cylinders in selected worlds.

    `arcs` has the tendon of each capsule, the number of its arc in the path, and the number of its piece in the arc.
    An arc continues the direction of the path; on a cylinder, it is a helix. As in MuJoCo 4, a full turn has twice
    `slices` pieces; arcs of more than `max_pieces` have longer ones.
    """
    row, column = wp.tid()
    world, tendon, piece = worlds[row], arcs[column][0], arcs[column][2]
    start, end = wp.vec3(), wp.vec3()
    shown = False
    index = find_arc(paths, world, tendon, arcs[column][1])
    if index > 0:
        geom = path_object(paths.wrap_obj, world, index)
        before = path_point(paths.wrap_xpos, world, index - 1)
        point = path_point(paths.wrap_xpos, world, index)
        low = point - geom_xpos[world, geom]
        high = path_point(paths.wrap_xpos, world, index + 1) - geom_xpos[world, geom]
        axis, rise = wp.vec3(), float(0.0)
        if is_cylinder[geom] != 0:
            frame = geom_xmat[world, geom]
            axis = wp.vec3(frame[0, 2], frame[1, 2], frame[2, 2])
            rise = wp.dot(axis, high - low)
        else:
            axis = wp.normalize(wp.cross(low, high))
        base = axis * wp.dot(axis, low)
        side = low - base
        across = wp.cross(axis, side)
        angle = wp.atan2(wp.dot(across, high), wp.dot(side, high - axis * wp.dot(axis, high)))
        turn = float(1.0)
        if wp.dot(across, point - before) < 0.0:
            turn = -1.0
        angle *= turn
        if angle < 0.0:
            angle += TWO_PI
        pieces = wp.min(wp.max(int(wp.round(angle * slices / (0.5 * TWO_PI))), 1), max_pieces)
        shown = piece < pieces and angle > 0.0
        if shown:
            center = geom_xpos[world, geom] + base
            low_share, high_share = float(piece) / float(pieces), float(piece + 1) / float(pieces)
            start = center + side * wp.cos(angle * low_share) + turn * across * wp.sin(angle * low_share)
            end = center + side * wp.cos(angle * high_share) + turn * across * wp.sin(angle * high_share)
            start += axis * (rise * low_share)
            end += axis * (rise * high_share)
    poses_out[row, column] = capsule_pose(start, end)
    sizes_out[row, column] = capsule_size(start, end, sizes[tendon][0])
    for view in range(row, hidden_out.shape[0], worlds.shape[0]):
        hidden_out[view, column] = wp.uint8(0) if shown else wp.uint8(1)
