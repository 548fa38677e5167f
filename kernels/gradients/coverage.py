# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Areas of objects in images with antialiased boundaries, soft masks, and their gradients.

The formulas are in `silhouette_edges`.
"""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.gradients.depth_gradients import RayTable, add_moment, mat34d, moment
from warpvis.kernels.gradients.silhouette_edges import (
    Boundary,
    Surfaces,
    boundary_between,
    has_boundary,
    is_target,
    object_frame,
)
from warpvis.kernels.pinhole import Frame, Window, frame_of, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.kernel
def sum_coverage(
    # Scene:
    surfaces: Surfaces,
    worlds: Worlds,
    targets: wp.array[wp.uint8],
    # Cameras:
    table: RayTable,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    images_in: Images,
    strip_rows: int,
    span: int,
    # Out:
    areas_out: wp.array2d[wp.float64],
):
    """Add the area of the chosen objects over strips of rows [px]; a thread has `span` pixels of each row."""
    view, strip, x = wp.tid()
    view, strip = locate(window, view, strip)
    camera = frame_of(camera_to_world[view])
    height, width = images_in.segmentation.shape[1], images_in.segmentation.shape[2]
    area = wp.float64(0.0)
    for y in range(strip * strip_rows, wp.min((strip + 1) * strip_rows, height)):
        for column in range(x * span, wp.min((x + 1) * span, width)):
            if is_target(targets, images_in, view, y, column):
                area += wp.float64(1.0)
            for axis in range(2):
                if has_boundary(targets, images_in, view, y, column, axis == 0):
                    edge = boundary_between(
                        surfaces, worlds, targets, table, camera, images_in, view, y, column, axis == 0
                    )
                    if edge.is_found:
                        area += edge.alpha - wp.float64(0.5)
    wp.atomic_add(areas_out, view, strip, area)


@wp.kernel
def sum_area_strips(
    # In:
    strips_in: wp.array2d[wp.float64],
    # Out:
    areas_out: wp.array[wp.float32],
):
    """Add the areas of the strips of each view [px]."""
    view = wp.tid()
    area = wp.float64(0.0)
    for strip in range(strips_in.shape[1]):
        area += strips_in[view, strip]
    areas_out[view] = wp.float32(area)


@wp.func
def is_second(edge: Boundary, is_inside: bool) -> bool:
    """Return whether the edge between two pixels is in the second one; `is_inside` if the first sees the object."""
    return (edge.alpha > wp.float64(0.5)) == is_inside


@wp.kernel
def write_masks(
    # Scene:
    surfaces: Surfaces,
    worlds: Worlds,
    targets: wp.array[wp.uint8],
    # Cameras:
    table: RayTable,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    images_in: Images,
    # Out:
    masks_out: wp.array3d[float],
):
    """Write the share of each pixel that the chosen objects cover; the sum is their area."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    camera = frame_of(camera_to_world[view])
    covered = wp.float64(wp.where(is_target(targets, images_in, view, y, x), 1.0, 0.0))
    for pair in range(4):
        is_row, is_first = pair % 2 == 0, pair < 2
        first_y = wp.where(is_first or is_row, y, y - 1)
        first_x = wp.where(is_first or not is_row, x, x - 1)
        if first_y >= 0 and first_x >= 0 and has_boundary(targets, images_in, view, first_y, first_x, is_row):
            edge = boundary_between(surfaces, worlds, targets, table, camera, images_in, view, first_y, first_x, is_row)
            is_inside = is_target(targets, images_in, view, first_y, first_x)
            if edge.is_found and is_second(edge, is_inside) != is_first:
                covered += edge.alpha - wp.float64(0.5)
    masks_out[view, y, x] = float(covered)


@wp.func
def add_force(
    surfaces: Surfaces,
    worlds: Worlds,
    camera: Frame,
    edge: Boundary,
    of_point: wp.vec3d,
    view: int,
    strip: int,
    sums_out: wp.array3d[mat34d],
    vertices_out: wp.array[wp.vec3d],
):
    """Add the gradients of camera, object and vertices, given that of a point of an edge in the camera frame."""
    force = wp.quat_rotate(camera.rotation, of_point)
    world = camera.origin + wp.quat_rotate(camera.rotation, edge.point)
    add_moment(sums_out, view, strip, 0, moment(-force, edge.point))
    frame = object_frame(surfaces, worlds, view, edge.index)
    column = surfaces.columns[edge.index]
    if column >= 0:
        local = wp.quat_rotate_inv(frame.rotation, world - frame.origin)
        add_moment(sums_out, view, strip, column + 1, moment(force, local))
    if vertices_out:
        local_force = wp.quat_rotate_inv(frame.rotation, force)
        wp.atomic_add(vertices_out, edge.start, (wp.float64(1.0) - edge.weight) * local_force)
        wp.atomic_add(vertices_out, edge.end, edge.weight * local_force)


@wp.kernel
def sum_coverage_gradients(
    # Scene:
    surfaces: Surfaces,
    worlds: Worlds,
    targets: wp.array[wp.uint8],
    # Cameras:
    table: RayTable,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    images_in: Images,
    weights_in: wp.array3d[wp.float64],
    strip_rows: int,
    span: int,
    # Out:
    sums_out: wp.array3d[mat34d],
    vertices_out: wp.array[wp.vec3d],
):
    """Add gradients of a weighted sum of masks with respect to poses and, if given, to all vertices.

    `weights_in` has a weight for each pixel, or one for a view. The sums are those of `sum_moments`.
    Gradients of vertices are in the frames of `Surfaces.vertices`.
    """
    view, strip, x = wp.tid()
    view, strip = locate(window, view, strip)
    camera = frame_of(camera_to_world[view])
    height, width = images_in.segmentation.shape[1], images_in.segmentation.shape[2]
    for y in range(strip * strip_rows, wp.min((strip + 1) * strip_rows, height)):
        for column in range(x * span, wp.min((x + 1) * span, width)):
            for axis in range(2):
                if has_boundary(targets, images_in, view, y, column, axis == 0):
                    edge = boundary_between(
                        surfaces, worlds, targets, table, camera, images_in, view, y, column, axis == 0
                    )
                    if edge.is_found:
                        is_inside = is_target(targets, images_in, view, y, column)
                        second = is_second(edge, is_inside)
                        row = wp.where(second and axis == 1, y + 1, y)
                        row = wp.min(row, weights_in.shape[1] - 1)
                        pixel = wp.where(second and axis == 0, column + 1, column)
                        pixel = wp.min(pixel, weights_in.shape[2] - 1)
                        force = weights_in[view, row, pixel] * edge.force
                        add_force(surfaces, worlds, camera, edge, force, view, strip, sums_out, vertices_out)
