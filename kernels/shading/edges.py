# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Anti-aliasing: pixels at edges of surfaces, points within them, and the mean color of these points."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

CREASE = wp.constant(0.9)
"""Cosine of the angle between normals of neighbors from which on they are on both sides of an edge: 26 degrees."""
STEP = wp.constant(0.5)
"""Sine of the angle between a surface and the way to the neighbor's point, beyond which that is on another surface."""


@wp.func
def is_edge(
    segmentation: wp.array3d[wp.int32],
    points: wp.array3d[wp.vec3],
    normals: wp.array3d[wp.vec3],
    view: int,
    y: int,
    x: int,
    other_y: int,
    other_x: int,
) -> bool:
    """Return whether two neighbors show two surfaces; False if the second is outside of the image."""
    if other_y < 0 or other_y >= segmentation.shape[1] or other_x < 0 or other_x >= segmentation.shape[2]:
        return False
    shown = segmentation[view, y, x]
    if segmentation[view, other_y, other_x] != shown:
        return True
    if shown < 0:
        return False
    normal = normals[view, y, x]
    if wp.dot(normal, normals[view, other_y, other_x]) < CREASE:
        return True
    way = points[view, other_y, other_x] - points[view, y, x]
    return wp.abs(wp.dot(way, normal)) > STEP * wp.length(way)


@wp.kernel
def list_edges(
    # In:
    segmentation: wp.array3d[wp.int32],
    points: wp.array3d[wp.vec3],
    normals: wp.array3d[wp.vec3],
    # Out:
    count_out: wp.array[wp.int32],
    pixels_out: wp.array2d[wp.int32],
):
    """List the pixels of each view that show another surface than one of their four neighbors, as y width + x."""
    view, y, x = wp.tid()
    edge = is_edge(segmentation, points, normals, view, y, x, y, x - 1)
    edge = edge or is_edge(segmentation, points, normals, view, y, x, y, x + 1)
    edge = edge or is_edge(segmentation, points, normals, view, y, x, y - 1, x)
    edge = edge or is_edge(segmentation, points, normals, view, y, x, y + 1, x)
    if edge:
        pixels_out[view, wp.atomic_add(count_out, view, 1)] = y * segmentation.shape[2] + x


@wp.kernel
def place_samples(
    # In:
    pattern: wp.array[wp.vec2],
    width: int,
    count: wp.array[wp.int32],
    pixels: wp.array2d[wp.int32],
    # Out:
    samples_out: wp.array3d[wp.vec2],
):
    """Write the image points of a pattern within each listed pixel, (view, 0, pixel and sample); NaN after the last."""
    view, place = wp.tid()
    number, sample = place // pattern.shape[0], place % pattern.shape[0]
    point = wp.vec2(wp.nan, wp.nan)
    if number < count[view]:
        pixel = pixels[view, number]
        point = wp.vec2(float(pixel % width), float(pixel // width)) + pattern[sample]
    samples_out[view, 0, place] = point


@wp.kernel
def average_samples(
    # In:
    sample_count: int,
    count: wp.array[wp.int32],
    pixels: wp.array2d[wp.int32],
    samples: wp.array3d[wp.vec3ub],
    # Out:
    color_out: wp.array3d[wp.vec3ub],
):
    """Write the rounded mean of the colors of each listed pixel's samples."""
    view, number = wp.tid()
    if number >= count[view]:
        return
    total = wp.vec3i(0, 0, 0)
    for sample in range(sample_count):
        color = samples[view, 0, number * sample_count + sample]
        total += wp.vec3i(int(color[0]), int(color[1]), int(color[2]))
    half, pixel = sample_count // 2, pixels[view, number]
    color_out[view, pixel // color_out.shape[2], pixel % color_out.shape[2]] = wp.vec3ub(
        wp.uint8((total[0] + half) // sample_count),
        wp.uint8((total[1] + half) // sample_count),
        wp.uint8((total[2] + half) // sample_count),
    )
