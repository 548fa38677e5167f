# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of objects from given vertex colors or textures, and their gradients.

The color of a pixel is a sum ``sum w_k c_k`` of at most four given colors: of the corners of the seen triangle, with
the barycentric weights of the seen point, or of the texels around its texture coordinates, with bilinear weights (mip
level 0). Its gradients with respect to the ``c_k`` are the weights. Colors are interpolated as they are given.
"""

import warp as wp

from warpvis.kernels.casting.worlds import Worlds, world_of
from warpvis.kernels.gradients.vertex_gradients import barycentric_weights
from warpvis.kernels.pinhole import Window, frame_of, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

REPEAT, MIRROR, CLAMP = (wp.constant(mode) for mode in range(3))

vec2d = wp.types.vector(length=2, dtype=wp.float64)


@wp.struct
class ColoredObject:
    """An object with given colors."""

    index: int  # in the scene's objects
    column: int  # in the object poses; -1 for a static object
    vertices: wp.array[wp.vec3]  # in the frame of the movable object, or in the world [m]
    faces: wp.array2d[wp.int32]  # (triangle, corner)
    uv: wp.array2d[wp.vec2]  # (triangle, corner), v upwards; None for vertex colors
    wrap_u: int
    wrap_v: int


@wp.struct
class SeenPoints:
    """Images of a render, ``[view, y, x]``."""

    points: wp.array3d[wp.vec3]
    segmentation: wp.array3d[wp.int32]
    faces: wp.array3d[wp.int32]


@wp.struct
class Samples:
    """The given colors that the color of a pixel is a weighted sum of."""

    count: int  # 0 for a pixel that does not see the object, 3 for vertex colors, 4 for texels
    rows: wp.vec4i
    columns: wp.vec4i
    weights: wp.vec4d


@wp.func
def wrapped(coordinate: wp.float64, mode: int) -> wp.float64:
    """Return a texture coordinate from 0 to 1."""
    half, one, two = wp.float64(0.5), wp.float64(1.0), wp.float64(2.0)
    if mode == REPEAT:
        return coordinate - wp.floor(coordinate)
    if mode == MIRROR:
        twice = coordinate - two * wp.floor(half * coordinate)
        return wp.min(twice, two - twice)
    return wp.clamp(coordinate, wp.float64(0.0), one)


@wp.func
def texel_index(index: int, size: int, mode: int) -> int:
    """Return the index of a texel, that before the first or after the last one being -1 or `size`."""
    if mode == REPEAT:
        return wp.where(index < 0, size - 1, wp.where(index < size, index, 0))
    return wp.clamp(index, 0, size - 1)


@wp.func
def texel_samples(uv: vec2d, colored: ColoredObject, height: int, width: int) -> Samples:
    """Return the four texels around texture coordinates; the first row of a texture is its top."""
    half, one = wp.float64(0.5), wp.float64(1.0)
    x = wrapped(uv[0], colored.wrap_u) * wp.float64(width) - half
    y = wrapped(one - uv[1], colored.wrap_v) * wp.float64(height) - half
    left, upper = int(wp.floor(x)), int(wp.floor(y))
    right_share, lower_share = x - wp.floor(x), y - wp.floor(y)
    samples = Samples()
    samples.count = 4
    for k in range(4):
        dx, dy = k % 2, k // 2
        samples.columns[k] = texel_index(left + dx, width, colored.wrap_u)
        samples.rows[k] = texel_index(upper + dy, height, colored.wrap_v)
        across, down = (
            wp.where(dx == 1, right_share, one - right_share),
            wp.where(dy == 1, lower_share, one - lower_share),
        )
        samples.weights[k] = across * down
    return samples


@wp.func
def pixel_samples(
    colored: ColoredObject, worlds: Worlds, seen: SeenPoints, height: int, width: int, view: int, y: int, x: int
) -> Samples:
    """Return the given colors, of a table of `height` rows, that a pixel shows."""
    samples = Samples()
    if seen.segmentation[view, y, x] != colored.index:
        return samples
    face = seen.faces[view, y, x]
    point = wp.vec3d(seen.points[view, y, x])
    if face < 0 or not wp.isfinite(point[0]):
        return samples
    if colored.column >= 0:
        pose = frame_of(worlds.object_poses[wp.max(world_of(worlds, view), 0), colored.column])
        point = wp.quat_rotate_inv(pose.rotation, point - pose.origin)
    i, j, k = colored.faces[face, 0], colored.faces[face, 1], colored.faces[face, 2]
    a, b, c = wp.vec3d(colored.vertices[i]), wp.vec3d(colored.vertices[j]), wp.vec3d(colored.vertices[k])
    weights = barycentric_weights(point, a, b, c)
    if colored.uv:
        uv = vec2d()
        for corner in range(3):
            at = colored.uv[face, corner]
            uv += weights[corner] * vec2d(wp.float64(at[0]), wp.float64(at[1]))
        return texel_samples(uv, colored, height, width)
    samples.count = 3
    samples.columns = wp.vec4i(i, j, k, 0)
    samples.weights = wp.vec4d(weights[0], weights[1], weights[2], wp.float64(0.0))
    return samples


@wp.kernel
def interpolate_colors(
    # Scene:
    worlds: Worlds,
    colored: ColoredObject,
    # Cameras:
    window: Window,
    # In:
    seen_in: SeenPoints,
    given_in: wp.array2d[wp.vec3],
    # Out:
    colors_out: wp.array3d[wp.vec3],
):
    """Write the colors of pixels that see an object, and keep those of others.

    `given_in` is a texture, or one row of the colors of vertices.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    samples = pixel_samples(colored, worlds, seen_in, given_in.shape[0], given_in.shape[1], view, y, x)
    if samples.count == 0:
        return
    color = wp.vec3d()
    for k in range(samples.count):
        color += samples.weights[k] * wp.vec3d(given_in[samples.rows[k], samples.columns[k]])
    colors_out[view, y, x] = wp.vec3(color)


@wp.kernel
def sum_color_gradients(
    # Scene:
    worlds: Worlds,
    colored: ColoredObject,
    # Cameras:
    window: Window,
    # In:
    seen_in: SeenPoints,
    gradients_in: wp.array3d[wp.vec3],
    # Out:
    given_out: wp.array2d[wp.vec3d],
):
    """Add gradients with respect to the given colors of an object over all pixels that see it."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    samples = pixel_samples(colored, worlds, seen_in, given_out.shape[0], given_out.shape[1], view, y, x)
    gradient = wp.vec3d(gradients_in[view, y, x])
    for k in range(samples.count):
        wp.atomic_add(given_out, samples.rows[k], samples.columns[k], samples.weights[k] * gradient)
