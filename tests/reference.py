# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Float64 NumPy references of every kernel, written for clarity: no tree, every ray against every triangle.

Each function has the name of its kernel. Arguments are plain arrays; poses are rows ``x y z qx qy qz qw``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from reference_body_visibility import (  # noqa: F401
    angle_to_image,
    body_centers,
    distance_to_free,
    exclude_others,
    shape_values,
)
from reference_building import (  # noqa: F401
    BINS,
    begin_tree,
    bound_centers,
    check_mesh,
    choose_bins,
    choose_places,
    clear_bins,
    count_ranges,
    fill_bins,
    find_costs,
    find_sides,
    fit_leaves,
    half_area,
    half_of,
    join_children,
    mark_owners,
    mark_ranges,
    move_items,
    must_halve,
    name_children,
    open_nodes,
    part_bins,
    part_small,
    rank_ranges,
    sort_small,
)
from reference_classify import (  # noqa: F401
    back_project,
    back_project_bundle,
    back_project_rays,
    back_project_rows,
    classify_depth,
    classify_rays,
    classify_rows,
    fill_depth,
    label_objects,
    label_objects_rows,
    pixel_rays,
)
from reference_clearance import find_free_poses, nearest_surface  # noqa: F401
from reference_coinciding import show_later, show_later_rows  # noqa: F401
from reference_color_gradients import interpolate_colors, sum_color_gradients  # noqa: F401
from reference_comparison import compare_depth  # noqa: F401
from reference_corruptions import corrupt_depth, place_rectangles  # noqa: F401
from reference_echoes import gather_returns, measure_incidence, reflect_rays  # noqa: F401
from reference_edges import average_samples, list_edges, place_samples  # noqa: F401
from reference_fattening import fatten_surfaces  # noqa: F401
from reference_floor_map import finish_map, mark_cells  # noqa: F401
from reference_found import find_objects_cuda, sort_into_tiles  # noqa: F401
from reference_fractions import (  # noqa: F401
    judge_fractions,
    measure_fractions,
    measure_fractions_packets,
    measure_fractions_packets_cuda,
)
from reference_gradients import (  # noqa: F401
    sum_moments,
    sum_parameter_gradients,
    sum_pose_strips,
    sum_rows,
    sum_vertex_gradients,
    write_ray_gradients,
)
from reference_heights import climb  # noqa: F401
from reference_inside import find_inside  # noqa: F401
from reference_kinect_noise import (  # noqa: F401
    measure_khoshelham,
    measure_nguyen,
)
from reference_latency import delay_images  # noqa: F401
from reference_layers import (  # noqa: F401
    blend_layer,
    blend_layer_rows,
    cast_layer,
    cast_layer_rows,
    find_opacity,
    find_transparent_rows,
    list_transparent_rows,
)
from reference_learned import report_learned_depth, rotate_to_cameras  # noqa: F401
from reference_lidar_noise import measure_lidar, measure_returns, receive_power  # noqa: F401
from reference_lines import hide_pixels, judge_lines, judge_unknown, render_map  # noqa: F401
from reference_margins import bound_depth_tiles, judge_margins, measure_margins, measure_point_margins  # noqa: F401
from reference_mirrors import (  # noqa: F401
    add_mirror_image,
    cast_beyond_mirror,
    flip_points,
    hide_unmirrored,
    mirror_lights,
    mirror_views,
)
from reference_motion import (  # noqa: F401
    back_project_moving,
    begin_legs,
    cast_at_moving_objects,
    cast_moving_rays,
    measure_moving_incidence,
)
from reference_moving_occluders import clear_hidden_worlds  # noqa: F401
from reference_moving_packets import mark_touched_rays, move_packet_rays, place_moving_packets  # noqa: F401
from reference_mujoco import (  # noqa: F401
    camera_transforms,
    geom_sizes,
    geom_transforms,
    geoms_of_objects,
    hidden_objects,
    pairs_of_objects,
    scale_sizes,
    viewer_transforms,
)
from reference_mujoco_appearances import light_shapes, light_switches, light_vectors, object_colors  # noqa: F401
from reference_occupancy import (  # noqa: F401
    bound_surface,
    bound_tiles,
    fade,
    fill_blocks,
    judge_blocks,
    list_blocks,
    mark_points,
    merge_tiles,
    rectify_depth,
    release_blocks,
    update_voxels,
    write_states,
    write_states_at,
)
from reference_orthographic import cast_parallel_rays, show_later_from_plane  # noqa: F401
from reference_pbr import shade_pbr_colors, shade_pbr_rows  # noqa: F401
from reference_point_order import clear_unused, count_points, measure_blocks, sort_points  # noqa: F401
from reference_points import (  # noqa: F401
    camera_frames,
    judge_points,
    judge_points_measured,
    judge_points_packets,
    project_points,
)
from reference_pose_groups import add_groups, move_views, spread_sums  # noqa: F401
from reference_poses import poses_from_matrices, poses_to_opencv, quaternions_to_xyzw  # noqa: F401
from reference_random import draw_normals, draw_uniforms  # noqa: F401
from reference_rangefinders import read_rangefinder_rows, read_rangefinders  # noqa: F401
from reference_ray_table import cast_ray_table
from reference_redwood import measure_redwood  # noqa: F401
from reference_registration import (  # noqa: F401
    add_strips,
    spread_object_poses,
    step_poses,
    sum_terms,
    sum_terms_rows,
    write_results,
)
from reference_shading import (  # noqa: F401
    find_planes,
    shade_base_colors,
    shade_color_rows,
    shade_lit_colors,
    write_entries,
    write_lights,
)
from reference_shadows import (  # noqa: F401
    cast_occlusion_packets,
    cast_occlusion_rays,
    cast_shadow_packets,
    cast_shadow_packets_cuda,
    cast_shadow_rays,
    cast_soft_shadow_packets,
    cast_soft_shadow_rays,
)
from reference_silhouettes import (  # noqa: F401
    judge_silhouettes,
    measure_silhouettes,
    measure_silhouettes_packets,
    measure_silhouettes_rays,
    spread_poses,
    spread_sizes,
)
from reference_simkinect import detect_dots, fill_from_dots, shift_to_levels  # noqa: F401
from reference_sky import paint_sky, paint_sky_rows  # noqa: F401
from reference_soft_visibility import (  # noqa: F401
    mark_silhouettes,
    sum_area_strips,
    sum_coverage,
    sum_coverage_gradients,
    write_masks,
)
from reference_stereo import (  # noqa: F401
    measure_stereo,
    place_in_other_eyes,
    place_other_eyes,
)
from reference_tendons import tendon_arcs, tendon_capsules  # noqa: F401
from reference_time_of_flight import (  # noqa: F401
    count_edges,
    find_axes,
    find_edges,
    list_sub_rays,
    measure_time_of_flight,
    mix_sub_rays,
    number_edges,
    place_sub_rays,
)
from reference_trees import (  # noqa: F401
    box_area,
    collapse_tree,
    fill_leaves,
    fit_nodes,
    load_items,
    refit_leaves,
    refit_nodes,
    rotate_corners,
    split_cost,
    split_range,
)
from reference_vertex_lighting import shade_vertex_color_rows, shade_vertex_lit_colors  # noqa: F401
from reference_voxels import (  # noqa: F401
    highest_labels,
    judge_voxels,
    judge_voxels_at,
    mark_surface_points,
    mark_surface_rays,
    merge_voxels,
    precedence,
    shown_depth,
)

from warpvis import Camera, Label, Scene, SceneObject
from warpvis.core.poses import poses_to_matrices
from warpvis.scene.solids import SolidKind

# Number of triangles whose arrays fit a core's cache.
_TRIANGLES_AT_A_TIME = 64
_RAYS_AT_A_TIME = 512


@dataclass
class Images:
    """Images of one view, and the distance behind each pixel to the nearest surface of another object (`gap`)."""

    depth: NDArray[np.float64]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    labels: NDArray[np.uint8]
    objects: NDArray[np.int64]
    gap: NDArray[np.float64]
    faces: NDArray[np.int64] | None = None


def measure_slopes(camera):
    """Return x of the rays of columns and y of the rays of rows, for z = 1."""
    return (
        (np.arange(camera.width) + 0.5 - camera.cx) / camera.fx,
        (np.arange(camera.height) + 0.5 - camera.cy) / camera.fy,
    )


def triangles_in_camera(scene: Scene, pose: NDArray) -> tuple[NDArray, NDArray]:
    """Return vertices of all triangles in the camera frame, shape (T, 3, 3), and their objects, shape (T,)."""
    matrix = poses_to_matrices(np.asarray(pose, dtype=np.float32))
    corners = np.concatenate([item.vertices.astype(np.float64)[item.faces] for item in scene.objects])
    owner = np.repeat(np.arange(len(scene)), [len(item.faces) for item in scene.objects])
    return (corners - matrix[:3, 3]) @ matrix[:3, :3], owner


def cast_rays(
    scene: Scene, camera: Camera, pose: NDArray, *, cull_backfaces: bool = False, near_plane: str = "occlude"
) -> Images:
    return _cast(scene, camera, pose, pixel_rays(camera), cull_backfaces, near_plane)


def cast_rays_at(
    scene: Scene, camera: Camera, pose: NDArray, pixels: NDArray, *, cull_backfaces: bool = False
) -> Images:
    inside = ((pixels >= 0) & (pixels < [camera.width, camera.height])).all(axis=-1)
    pixels = np.where(inside[..., None], pixels.astype(np.float64), np.nan)
    return _cast(scene, camera, pose, camera.back_project(pixels, np.ones(pixels.shape[:-1])), cull_backfaces)


# Images do not depend on the casting method.
cast_packets = cast_packets_cuda = cast_rays
cast_remapped_packets = cast_rays_at
cast_table_packets = cast_ray_origin_packets = cast_sorted_rays = cast_close_rays = cast_ray_table
cast_moving_ray_packets = cast_remaining_rays = cast_moving_rays
cast_touched_rays = cast_remaining_at_objects = cast_at_moving_objects


def _cast(
    scene: Scene, camera: Camera, pose: NDArray, rays: NDArray, cull_backfaces: bool, near_plane: str = "occlude"
) -> Images:
    """Return the images of rays of the camera frame with z = 1, shape (..., 3)."""
    clip = camera.near if near_plane == "clip" else 0.0
    shape = rays.shape[:-1]
    rays = rays.reshape(-1, 3)
    corners, owner = triangles_in_camera(scene, pose)
    round_normals: dict[int, NDArray] = {}
    nearest_of, triangle_of = np.full((len(scene), len(rays)), np.inf), np.full((len(scene), len(rays)), -1)
    for index in range(len(scene)):
        first = np.flatnonzero(owner == index)[0]
        round_surface = _meet_solid(scene.objects[index], pose, rays)
        if round_surface is not None and not (round_surface[0] < clip).any():
            nearest_of[index], round_normals[index] = round_surface
            continue
        near = np.flatnonzero(_may_hit(rays, corners[owner == index]))
        found = _nearest_triangle(rays[near], corners[owner == index], cull_backfaces, clip)
        nearest_of[index, near], triangle_of[index, near] = found[0], first + found[1]
    seen = nearest_of.argmin(axis=0)
    depth, triangle = nearest_of.min(axis=0), triangle_of[seen, np.arange(len(rays))]
    ordered = np.sort(nearest_of, axis=0)
    gap = np.full(len(rays), np.inf)
    if len(scene) > 1:
        both = np.isfinite(ordered[1])
        gap[both] = ordered[1, both] - ordered[0, both]
    hit = np.isfinite(depth)
    rounded = depth.astype(np.float32)
    too_near, too_far = hit & (rounded < np.float32(camera.near)), hit & (rounded > np.float32(camera.far))
    depth[too_near], depth[too_far] = -np.inf, np.inf
    hit &= ~(too_near | too_far)

    matrix = poses_to_matrices(np.asarray(pose, dtype=np.float32))
    points, normals = np.full((len(rays), 3), np.nan), np.full((len(rays), 3), np.nan)
    points[hit] = (depth[hit, None] * rays[hit]) @ matrix[:3, :3].T + matrix[:3, 3]
    a, b, c = corners[triangle[hit]].swapaxes(0, 1)
    facing = np.cross(b - a, c - a)
    facing *= -np.sign((facing * rays[hit]).sum(axis=1, keepdims=True))
    normals[hit] = facing / np.linalg.norm(facing, axis=1, keepdims=True) @ matrix[:3, :3].T
    for index, of_solid in round_normals.items():
        normals[hit & (seen == index)] = of_solid[hit & (seen == index)]
    objects = np.where(hit, seen, -1)
    label_of = np.array([item.label for item in scene.objects])
    labels = np.where(hit, label_of[objects], Label.EMPTY)
    return Images(
        depth.reshape(shape),
        points.reshape(*shape, 3),
        normals.reshape(*shape, 3),
        labels.reshape(shape).astype(np.uint8),
        objects.reshape(shape),
        gap.reshape(shape),
        _own_faces(owner, triangle, hit).reshape(shape),
    )


def _own_faces(owner: NDArray, triangle: NDArray, hit: NDArray) -> NDArray[np.int64]:
    """Return triangle indices as numbered by their objects, -1 for no hit."""
    first = np.searchsorted(owner, owner[triangle])
    return np.where(hit & (triangle >= 0), triangle - first, -1)


def _meet_solid(item: SceneObject, pose: NDArray, rays: NDArray) -> tuple[NDArray, NDArray] | None:
    """Return the depth of every ray on a solid's exact surface, +inf for a miss, and the world normals there.

    Return None for a mesh, or if the camera is inside the solid, where its triangles are rendered.
    """
    if item.solid is None:
        return None
    camera, place = (poses_to_matrices(np.asarray(row, dtype=np.float32)) for row in (pose, item.pose))
    radii, half = item.solid.radii.astype(np.float32).astype(np.float64), float(np.float32(item.solid.half))
    into = place[:3, :3].T / radii[:, None]
    o = into @ (camera[:3, 3] - place[:3, 3])
    d = rays @ camera[:3, :3].T @ into.T
    middle = np.array([0, 0, np.clip(o[2], -half, half)])
    flat = item.solid.kind == SolidKind.CYLINDER
    if (np.hypot(o[0], o[1]) <= 1 and abs(o[2]) <= half) if flat else np.linalg.norm(o - middle) <= 1:
        return None
    upright = np.array([1.0, 1.0, 0.0])
    parts = []  # depth and the slope of the surface there
    if item.solid.kind != SolidKind.BALL:
        z = _first_root(o * upright, d * upright)
        with np.errstate(invalid="ignore"):
            p = o + z[:, None] * d
            parts.append((np.where(np.abs(p[:, 2]) <= half, z, np.inf), p * upright))
    for end in (0.0,) if item.solid.kind == SolidKind.BALL else (half, -half):
        center = np.array([0, 0, end])
        if flat:
            with np.errstate(divide="ignore", invalid="ignore"):
                z = (end - o[2]) / d[:, 2]
                p = o + z[:, None] * d
                parts.append((np.where((z > 0) & (np.hypot(p[:, 0], p[:, 1]) <= 1), z, np.inf), center + 0 * p))
        else:
            z = _first_root(o - center, d)
            parts.append((z, o + z[:, None] * d - center))
    depths = np.array([depth for depth, _ in parts])
    first = depths.argmin(axis=0)
    with np.errstate(invalid="ignore"):
        slopes = np.array([slope for _, slope in parts])[first, np.arange(len(rays))] / radii
        normals = slopes / np.linalg.norm(slopes, axis=1, keepdims=True) @ place[:3, :3].T
    return depths.min(axis=0), normals


def _first_root(o: NDArray, d: NDArray) -> NDArray:
    """Return the smallest z at which rays ``o + z d`` enter the unit sphere, +inf for a miss."""
    a, b, c = (d * d).sum(axis=1), d @ o, o @ o - 1
    with np.errstate(divide="ignore", invalid="ignore"):
        z = c / (np.sqrt(b * b - a * c) - b)
    return np.where((z > 0) & (c > 0) & (b < 0), z, np.inf)


def near_silhouette(scene: Scene, camera: Camera, pose: NDArray, pixels: NDArray, distance: float) -> NDArray[np.bool_]:
    """Return whether another object or the background lies within a distance [px] of pixel centers, rows (y, x)."""
    turns = 2 * np.pi * np.arange(8) / 8
    around = distance * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    at = pixels[:, None, ::-1] + 0.5 + np.concatenate([[[0.0, 0.0]], around])
    rays = camera.back_project(at, np.ones(at.shape[:-1]))
    objects = _cast(scene, camera, pose, rays, False).objects
    return (objects != objects[:, :1]).any(axis=1)


def _may_hit(rays: NDArray, corners: NDArray) -> NDArray[np.bool_]:
    """Return whether the line of each ray passes through the bounding sphere of the triangles."""
    center = (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))) / 2
    squared_radius = ((corners - center) ** 2).sum(axis=-1).max()
    squared_distance = center @ center - (rays @ center) ** 2 / (rays * rays).sum(axis=1)
    return squared_distance <= squared_radius + 1e-9 * (squared_radius + center @ center)


def _nearest_triangle(
    rays: NDArray, corners: NDArray, cull_backfaces: bool, clip: float = 0.0
) -> tuple[NDArray, NDArray]:
    """Return the smallest depth of every ray over the triangles, +inf for a miss, and the triangle's index.

    A ray d hits the triangle a b c if d . (b x c), d . (c x a) and d . (a x b) have the same sign, at the depth
    a . n / d . n of its plane. Hits nearer than `clip` are ignored.
    """
    a, b, c = corners.swapaxes(0, 1)
    sides = [_cross(b, c), _cross(c, a), _cross(a, b)]
    normal = _cross(b - a, c - a)
    offset = (normal * a).sum(axis=1)
    depth, triangle = np.full(len(rays), np.inf), np.zeros(len(rays), dtype=np.int64)
    for begin in range(0, len(rays), _RAYS_AT_A_TIME):
        part = slice(begin, begin + _RAYS_AT_A_TIME)
        for start in range(0, len(corners), _TRIANGLES_AT_A_TIME):
            some = slice(start, start + _TRIANGLES_AT_A_TIME)
            first, second, third = (rays[part] @ side[some].T for side in sides)
            least = np.minimum(np.minimum(first, second), third)
            greatest = np.maximum(np.maximum(first, second), third)
            with np.errstate(divide="ignore", invalid="ignore"):
                z = offset[some] / (rays[part] @ normal[some].T)
            hit = ((least >= 0) | (greatest <= 0)) & (least < greatest) & (z > 0) & (z >= clip)
            if cull_backfaces:
                hit &= offset[some] < 0
            z[~hit] = np.inf
            index = z.argmin(axis=1)
            z = z[np.arange(len(z)), index]
            nearer = z < depth[part]
            depth[part][nearer], triangle[part][nearer] = z[nearer], start + index[nearer]
    return depth, triangle


def _cross(p: NDArray, q: NDArray) -> NDArray:
    """Return cross products of rows; `np.cross` has a high cost per call."""
    return p[:, [1, 2, 0]] * q[:, [2, 0, 1]] - p[:, [2, 0, 1]] * q[:, [1, 2, 0]]


def edge_distance(scene: Scene, camera: Camera, pose: NDArray, pixels: NDArray) -> NDArray[np.float64]:
    """Return the distance [px] of pixel centers, rows (y, x), from the nearest edge of any triangle in the image."""
    corners, _ = triangles_in_camera(scene, pose)
    pairs = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    pairs = pairs[(pairs[..., 2] > 0).any(axis=1)]
    behind = pairs[..., 2] < 1e-9
    for end in (0, 1):  # clip edges that cross the camera plane
        cut = behind[:, end]
        p, q = pairs[cut, end], pairs[cut, 1 - end]
        pairs[cut, end] = p + (q - p) * ((1e-9 - p[:, 2:]) / (q[:, 2:] - p[:, 2:]))
    a, b = camera.project(pairs).swapaxes(0, 1)
    distance = np.empty(len(pixels))
    for i, (y, x) in enumerate(pixels):
        p = np.array([x + 0.5, y + 0.5])
        ab = b - a
        t = ((p - a) * ab).sum(axis=1) / np.maximum((ab * ab).sum(axis=1), 1e-300)
        distance[i] = np.linalg.norm(a + np.clip(t, 0, 1)[:, None] * ab - p, axis=1).min()
    return distance
