# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Twins of every kernel in float64 NumPy, written for clarity: no tree, every ray against every triangle.

Each function has the name of its kernel. Arguments are plain arrays; poses are rows ``x y z qx qy qz qw``.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from reference_building import (  # noqa: F401
    BINS,
    begin_tree,
    bound_centres,
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
from reference_clearance import find_room, nearest_surface  # noqa: F401
from reference_coinciding import show_later  # noqa: F401
from reference_echoes import gather_returns, measure_incidence, reflect_rays  # noqa: F401
from reference_found import find_objects_cuda, sort_into_tiles  # noqa: F401
from reference_heights import climb  # noqa: F401
from reference_inside import find_inside  # noqa: F401
from reference_orthographic import cast_parallel_rays, show_later_from_plane  # noqa: F401
from reference_panorama import cast_wide_rays  # noqa: F401
from reference_ray_table import cast_ray_table
from reference_silhouettes import (  # noqa: F401
    judge_silhouettes,
    measure_silhouettes,
    measure_silhouettes_packets,
    measure_silhouettes_rays,
    spread_poses,
)
from reference_voxels import (  # noqa: F401
    highest_labels,
    judge_voxels,
    mark_surface_points,
    merge_voxels,
    precedence,
    shown_depth,
)

from warpvis import Camera, Label, Scene, SceneObject, Visibility
from warpvis.core.poses import poses_to_matrices, quaternion_product
from warpvis.maps import Sphere
from warpvis.scene.solids import SolidKind
from warpvis.sensors import LensCamera

# Blocks that fit a core's cache.
_TRIANGLES_AT_A_TIME = 64
_RAYS_AT_A_TIME = 512


@dataclass
class Images:
    """What `cast_rays` sees of one view, and how far behind it the nearest surface of another object is."""

    depth: NDArray[np.float64]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    labels: NDArray[np.uint8]
    objects: NDArray[np.int64]
    gap: NDArray[np.float64]


def pixel_rays(camera: Camera) -> NDArray[np.float64]:
    """Camera-frame rays of all pixels with z = 1, shape (H, W, 3); of a lens, of depth 1, or NaN."""
    if isinstance(camera, LensCamera):
        rays = camera.lens.unproject(np.stack(np.mgrid[: camera.height, : camera.width][::-1], axis=-1) + 0.5)
        return rays / rays[..., 2:] if camera.kind == "z" else rays
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    return np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)


def triangles_in_camera(scene: Scene, pose: NDArray) -> tuple[NDArray, NDArray]:
    """Corners of all triangles in the camera frame, shape (T, 3, 3), and their objects, shape (T,)."""
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


# What an image shows does not depend on how it is cast.
cast_packets = cast_packets_cuda = cast_rays
cast_table_packets = cast_ray_table


def _cast(
    scene: Scene, camera: Camera, pose: NDArray, rays: NDArray, cull_backfaces: bool, near_plane: str = "occlude"
) -> Images:
    """What is seen along rays of the camera frame with z = 1, shape (..., 3)."""
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
        for start in range(0, len(rays), _RAYS_AT_A_TIME):
            part = slice(start, start + _RAYS_AT_A_TIME)
            found = _nearest_triangle(rays[part], corners[owner == index], cull_backfaces, clip)
            nearest_of[index, part], triangle_of[index, part] = found[0], first + found[1]
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
    )


def _meet_solid(item: SceneObject, pose: NDArray, rays: NDArray) -> tuple[NDArray, NDArray] | None:
    """Depth of every ray on a solid's true surface, +inf where it misses, and the normals there in the world.

    None if the object is no solid, or the camera is not outside of it: then its triangles are seen.
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
    parts = []  # depth, and the slope of the surface where that is
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
    """Where rays ``o + z d`` first come as near to the origin as 1, from farther away; +inf where they do not."""
    a, b, c = (d * d).sum(axis=1), d @ o, o @ o - 1
    with np.errstate(divide="ignore", invalid="ignore"):
        z = c / (np.sqrt(b * b - a * c) - b)
    return np.where((z > 0) & (c > 0) & (b < 0), z, np.inf)


def near_silhouette(scene: Scene, camera: Camera, pose: NDArray, pixels: NDArray, distance: float) -> NDArray[np.bool_]:
    """Whether another object, or none, is seen within a distance [px] of pixel centres; pixels are rows (y, x)."""
    turns = 2 * np.pi * np.arange(8) / 8
    around = distance * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    at = pixels[:, None, ::-1] + 0.5 + np.concatenate([[[0.0, 0.0]], around])
    rays = camera.back_project(at, np.ones(at.shape[:-1]))
    objects = _cast(scene, camera, pose, rays, False).objects
    return (objects != objects[:, :1]).any(axis=1)


def _nearest_triangle(
    rays: NDArray, corners: NDArray, cull_backfaces: bool, clip: float = 0.0
) -> tuple[NDArray, NDArray]:
    """Least depth of every ray over the triangles, +inf where it misses them all, and which triangle that is.

    What is nearer than `clip` is not there.
    """
    depth, triangle = np.full(len(rays), np.inf), np.zeros(len(rays), dtype=np.int64)
    for start in range(0, len(corners), _TRIANGLES_AT_A_TIME):
        z = _depth_of_triangles(rays, corners[start : start + _TRIANGLES_AT_A_TIME], cull_backfaces)
        z[z < clip] = np.inf
        first = z.argmin(axis=1)
        z = z[np.arange(len(rays)), first]
        nearer = z < depth
        depth[nearer], triangle[nearer] = z[nearer], start + first[nearer]
    return depth, triangle


def _depth_of_triangles(rays: NDArray, corners: NDArray, cull_backfaces: bool) -> NDArray:
    """Planar depth of every ray (N) on every triangle (T), +inf where it misses, shape (N, T).

    A ray d meets the triangle a b c where d . (b x c), d . (c x a) and d . (a x b) have one sign, at the depth
    a . n / d . n of its plane.
    """
    a, b, c = corners.swapaxes(0, 1)
    sides = [rays @ np.cross(p, q).T for p, q in ((b, c), (c, a), (a, b))]
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = (normal * a).sum(axis=1) / (rays @ normal.T)
    least, greatest = np.minimum.reduce(sides), np.maximum.reduce(sides)
    hit = ((least >= 0) | (greatest <= 0)) & (least < greatest) & (z > 0)
    if cull_backfaces:
        hit &= (normal * a).sum(axis=1) < 0
    return np.where(hit, z, np.inf)


def edge_distance(scene: Scene, camera: Camera, pose: NDArray, pixels: NDArray) -> NDArray[np.float64]:
    """Distance [px] of pixel centres from the nearest edge of any triangle in the image; pixels are rows (y, x)."""
    corners, _ = triangles_in_camera(scene, pose)
    pairs = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    pairs = pairs[(pairs[..., 2] > 0).any(axis=1)]
    behind = pairs[..., 2] < 1e-9
    for end in (0, 1):  # cut edges that cross the camera plane
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


def back_project(camera: Camera, pose: NDArray, depth: NDArray) -> NDArray[np.float64]:
    return _points(camera, pose, shown_depth(camera, depth))


def back_project_rays(camera: LensCamera, pose: NDArray, depth: NDArray) -> NDArray[np.float64]:
    return back_project(camera, pose, depth)


def _points(camera: Camera, pose: NDArray, depth: NDArray) -> NDArray[np.float64]:
    """The same of finite depths, whatever the camera's range."""
    matrix = poses_to_matrices(np.asarray(pose, dtype=np.float32))
    with np.errstate(invalid="ignore"):
        local = pixel_rays(camera) * np.asarray(depth, dtype=np.float64)[..., None]
        points = local @ matrix[:3, :3].T + matrix[:3, 3]
    return np.where(np.isfinite(depth)[..., None], points, np.nan)


def fill_depth(depth: NDArray, empty: float, too_near: float) -> NDArray:
    return np.where(np.isposinf(depth), empty, np.where(np.isneginf(depth), too_near, depth))


def _has_depth(depth: NDArray, max_range: float, near: float = 0.0) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        return np.isfinite(depth) & (depth > 0) & (depth >= np.float32(near)) & (depth <= max_range)


def classify_depth(
    camera: Camera,
    pose: NDArray,
    depth: NDArray,
    spheres: tuple[Sphere, ...] = (),
    *,
    sigma: float = 0.01,
    ground_height: float = 0.0,
    up: int = 2,
    max_range: float | None = None,
) -> tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.float64]]:
    """Labels, spheres, and how far each pixel is from changing its label [m]."""
    valid = _has_depth(depth, camera.far if max_range is None else max_range, camera.near)
    points = _points(camera, pose, np.where(valid, depth, np.nan))
    height = points[..., up] - ground_height
    margin = np.abs(height - sigma)
    ratio = np.full((len(spheres) + 1, *depth.shape), np.inf)
    ratio[-1] = 1.0  # the outside
    for i, sphere in enumerate(spheres):
        distance = np.linalg.norm(points - np.array(sphere.center), axis=-1)
        ratio[i] = distance / (sphere.diameter / 2)
        margin = np.minimum(margin, np.abs(distance - sphere.diameter / 2))
    sphere = np.argmin(np.where(np.isnan(ratio), np.inf, ratio), axis=0)
    sphere = np.where(sphere == len(spheres), -1, sphere)
    with np.errstate(invalid="ignore"):
        ground = height < sigma
    sphere = np.where(valid & ~ground, sphere, -1)
    label_of = np.array([*(item.label for item in spheres), Label.OBSTACLE])
    labels = np.where(ground, Label.GROUND, label_of[sphere])
    return np.where(valid, labels, Label.EMPTY).astype(np.uint8), sphere, np.where(valid, margin, np.inf)


def classify_rays(camera: LensCamera, pose: NDArray, depth: NDArray, *spheres, **options):
    """The same where pixels without a ray have no point."""
    return classify_depth(camera, pose, np.where(camera.mask, np.nan, depth), *spheres, **options)


def label_objects(object_label: NDArray, depth: NDArray, objects: NDArray, max_range: float) -> NDArray[np.uint8]:
    known = (objects >= 0) & (objects < len(object_label)) & _has_depth(depth, max_range)
    return np.where(known, object_label[np.where(known, objects, 0)], Label.EMPTY).astype(np.uint8)


def mark_cells(
    points: NDArray,
    labels: NDArray,
    low: NDArray,
    cell: float,
    shape: tuple[int, int],
    sigma: float,
    ground: Collection[int] = (1,),
) -> NDArray[np.int64]:
    """Cells of one view's map, z up, by the definition: points first, then level quadrilaterals of four pixels."""
    cells = np.zeros(shape, dtype=np.int64)
    order = precedence(np.arange(256), ground)
    at = (points[..., :2].astype(np.float64) - low) / cell

    def mark(row: int, column: int, label: int) -> None:
        if 0 <= row < shape[0] and 0 <= column < shape[1]:
            cells[row, column] = max(cells[row, column], label, key=lambda number: order[number])

    def in_triangle(a: NDArray, b: NDArray, c: NDArray, p: NDArray) -> bool:
        sides = [(q - o)[0] * (p - o)[1] - (q - o)[1] * (p - o)[0] for o, q in ((a, b), (b, c), (c, a))]
        return min(sides) >= 0 or max(sides) <= 0

    for y, x in np.argwhere((labels != Label.EMPTY) & np.isfinite(points).all(axis=-1)):
        label = labels[y, x]
        mark(*np.floor(at[y, x, ::-1]).astype(int), label)
        quad = [(y, x), (y, x + 1), (y + 1, x + 1), (y + 1, x)]
        if y + 1 >= labels.shape[0] or x + 1 >= labels.shape[1] or any(labels[q] != label for q in quad):
            continue
        heights = np.array([points[q][2] for q in quad])
        level = label in ground or (np.abs(heights - heights[0]) < sigma).all()
        if not level or not np.isfinite([points[q] for q in quad]).all():
            continue
        a, b, c, d = (at[q] for q in quad)
        low_cell = np.maximum(np.floor(np.min([a, b, c, d], axis=0)), 0).astype(int)
        high_cell = np.minimum(np.floor(np.max([a, b, c, d], axis=0)) + 1, shape[::-1]).astype(int)
        for row in range(low_cell[1], high_cell[1]):
            for column in range(low_cell[0], high_cell[0]):
                center = np.array([column + 0.5, row + 0.5])
                if in_triangle(a, b, c, center) or in_triangle(a, c, d, center):
                    mark(row, column, label)
    return cells


def finish_map(cells: NDArray, low: NDArray, cell: float, robots: NDArray) -> NDArray[np.uint8]:
    rows, columns = np.indices(cells.shape)
    centers = low + cell * np.stack([columns + 0.5, rows + 0.5], axis=-1)
    out = cells.copy()
    for x, y, radius in robots:
        out[np.linalg.norm(centers - [x, y], axis=-1) <= radius] = Label.ROBOT
    return out.astype(np.uint8)


def poses_to_opencv(poses: NDArray, opencv_to_given: NDArray) -> NDArray[np.float64]:
    rows = np.asarray(poses, dtype=np.float64)
    unit = rows[:, 3:] / np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
    return np.concatenate([rows[:, :3], quaternion_product(unit, opencv_to_given)], axis=1)


def quaternions_to_xyzw(rows: NDArray) -> NDArray:
    return np.asarray(rows)[:, [0, 1, 2, 4, 5, 6, 3]]


def poses_from_matrices(matrices: NDArray, opencv_to_given: NDArray) -> NDArray[np.float64]:
    """Matrices of the OpenCV frame, shape (V, 4, 4): quaternions are compared through them, since q and -q are one."""
    turn = poses_to_matrices(np.concatenate([np.zeros(3), opencv_to_given]))
    return np.asarray(matrices, dtype=np.float64) @ turn


def load_items(vertices: NDArray, faces: NDArray) -> NDArray[np.float64]:
    """Boxes of the triangles: rows min x y z, max x y z."""
    corners = np.asarray(vertices, dtype=np.float64)[faces]
    return np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)


def box_area(boxes: NDArray) -> float:
    """Half the surface area of the box around boxes, rows as `load_items` makes them."""
    x, y, z = boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0)
    return x * y + y * z + z * x


def split_cost(left: NDArray, right: NDArray, lanes: int) -> float:
    """Cost of two children by the surface area heuristic, each with leaves of `lanes` boxes."""
    return sum(box_area(boxes) * -(-len(boxes) // lanes) for boxes in (left, right))


def split_range(boxes: NDArray, lanes: int) -> float:
    """Least cost of any split of boxes in the order of their centres along an axis."""
    centres = boxes[:, :3] + boxes[:, 3:]
    orders = [np.argsort(centres[:, axis], kind="stable") for axis in range(3)]
    return min(split_cost(boxes[o[:i]], boxes[o[i:]], lanes) for o in orders for i in range(1, len(boxes)))


def collapse_tree(splits: dict[int, tuple], root: int, lanes: int) -> float:
    """Least area of all nodes but the root, over all trees of nodes with at most `lanes` children.

    `splits` holds the binary tree: ``(left, right, left area, right area)``, where 0 stands for a leaf.
    """
    memory: dict[tuple[int, int], float] = {}

    def as_parts(split: int, most: int) -> float:
        left, right, *areas = splits[split]
        return min(subtree(left, areas[0], k) + subtree(right, areas[1], most - k) for k in range(1, most))

    def subtree(split: int, area: float, most: int) -> float:
        if split == 0:
            return 0.0
        if (split, most) not in memory:
            as_node = area + as_parts(split, lanes)
            memory[split, most] = as_node if most == 1 else min(as_node, as_parts(split, most))
        return memory[split, most]

    return as_parts(root, lanes) if root else 0.0


def fill_leaves(vertices: NDArray, faces: NDArray, triangles: NDArray) -> NDArray[np.float32]:
    """Rows ax ay az bx by bz cx cy cz of the leaves, shape (L, 9, lanes); `triangles` has shape (L, lanes)."""
    used = np.where(triangles >= 0, triangles, triangles[:, :1])
    corners = vertices[faces[used]]
    corners[triangles < 0] = corners[triangles < 0][:, :1]
    return corners.reshape(*triangles.shape, 9).swapaxes(1, 2)


def fit_nodes(vertices: NDArray, faces: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What bounds must hold: the triangles' corners, shape (n, 3, 3), and unit normals, NaN where there is no area."""
    corners = np.asarray(vertices, dtype=np.float64)[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    return corners, normals / np.where(lengths > 0, lengths, np.nan)[:, None]


def geom_transforms(geom_xpos: NDArray, geom_xmat: NDArray, worlds: NDArray, geoms: NDArray) -> NDArray[np.float64]:
    """Geom to world of every pair of a world and a geom, matrices of shape (W, M, 4, 4)."""
    return _matrices(geom_xpos, geom_xmat)[np.asarray(worlds)[:, None], np.asarray(geoms)]


def camera_transforms(cam_xpos: NDArray, cam_xmat: NDArray, cameras: NDArray, worlds: NDArray) -> NDArray[np.float64]:
    """OpenCV camera to world of every pair of a camera and a world, matrices of shape (C, W, 4, 4)."""
    turn = np.diag([1.0, -1, -1, 1])
    return _matrices(cam_xpos, cam_xmat)[np.asarray(worlds), np.asarray(cameras)[:, None]] @ turn


def _matrices(position: NDArray, rotation: NDArray) -> NDArray[np.float64]:
    matrices = np.zeros((*np.shape(position)[:2], 4, 4))
    matrices[..., :3, :3] = np.reshape(rotation, (*np.shape(position), 3))
    matrices[..., :3, 3], matrices[..., 3, 3] = position, 1
    return matrices


def viewer_transforms(
    subtree_com: NDArray, cameras: NDArray, bodies: NDArray, poses: NDArray, worlds: NDArray
) -> NDArray[np.float64]:
    """Rows of every pair of a camera and a world, (C, W, 7), of which those of the model's cameras are NaN."""
    rows = np.full((len(cameras), len(worlds), 7), np.nan)
    for row, (camera, body) in enumerate(zip(cameras, bodies, strict=True)):
        if camera < 0:
            rows[row] = poses[row]
            rows[row, :, :3] += subtree_com[worlds, body] if body >= 0 else 0
    return rows


def hidden_objects(
    geom_rgba: NDArray, geom_matid: NDArray, mat_rgba: NDArray, worlds: NDArray, geoms: NDArray, views: int
) -> NDArray[np.uint8]:
    hidden = np.zeros((views, len(geoms)), dtype=np.uint8)
    for view, column in np.ndindex(hidden.shape):
        world, geom = worlds[view % len(worlds)], geoms[column]
        rgba, material = geom_rgba[world % len(geom_rgba), geom], geom_matid[world % len(geom_matid), geom]
        if material >= 0 and rgba.tolist() == [0.5, 0.5, 0.5, 1]:
            rgba = mat_rgba[world % len(mat_rgba), material]
        hidden[view, column] = geom >= 0 and rgba[3] == 0
    return hidden


def scale_sizes(made: NDArray, scales: NDArray, worlds: int) -> NDArray[np.float64]:
    """Sizes of movable objects, (worlds, M, 4), of those that they were made with and of factors, (1 or W, M, 3)."""
    factors = np.concatenate([scales, np.ones((*scales.shape[:2], 1))], axis=-1).astype(np.float64)
    return made * factors[np.arange(worlds) % len(factors)]


def geom_sizes(
    sizes: NDArray, rows: NDArray, geoms: NDArray, kinds: NDArray, own: NDArray, made: NDArray
) -> NDArray[np.float64]:
    """Sizes of what moves in some worlds: of MuJoCo's spheres, capsules, ellipsoids, cylinders (2 to 5) and boxes."""
    found = np.tile(made.astype(np.float64), (len(rows), 1, 1))
    for (row, world), (column, geom) in product(enumerate(rows), enumerate(geoms)):
        now = sizes[world % len(sizes), geom].astype(np.float64)
        if geom < 0 or (now == own[geom]).all():
            continue
        kind = kinds[geom]
        radii = {4: now, 6: now / own[geom]}.get(kind, now[[0, 0, 0]])
        found[row, column] = [*radii, now[1] / now[0] if kind in (3, 5) else made[column, 3]]
    return found


def geoms_of_objects(objects: NDArray, geom_ids: NDArray) -> NDArray[np.int32]:
    return np.where(objects < 0, -1, np.asarray(geom_ids)[objects]).astype(np.int32)


def refit_leaves(vertices: NDArray, leaf_vertices: NDArray) -> tuple[NDArray, NDArray]:
    """Rows of the leaves, shape (L, 9, lanes), and their boxes, shape (L, 6); `leaf_vertices` is (L, 3, lanes)."""
    corners = vertices[leaf_vertices]
    boxes = np.concatenate([corners.min(axis=(1, 2)), corners.max(axis=(1, 2))], axis=1)
    return corners.swapaxes(2, 3).reshape(len(leaf_vertices), 9, -1), boxes


def refit_nodes(boxes: NDArray, children: NDArray) -> tuple[NDArray, NDArray]:
    """Boxes of the children, shape (N, 6, lanes), and of the root, by the leaves' boxes; `children` is (N, lanes)."""
    rows = np.empty((len(children), 6, children.shape[1]), dtype=boxes.dtype)
    rows[:, :3], rows[:, 3:] = 3e38, -3e38
    box = np.empty((len(children), 6), dtype=boxes.dtype)
    for node in reversed(range(len(children))):
        for lane in np.flatnonzero(children[node]):
            child = children[node, lane]
            rows[node, :, lane] = box[child] if child > 0 else boxes[~child]
        box[node] = [*rows[node, :3].min(axis=1), *rows[node, 3:].max(axis=1)]
    return rows, box[0]


def camera_frames(poses: NDArray) -> tuple[NDArray, NDArray]:
    matrices = poses_to_matrices(np.asarray(poses, dtype=np.float32)).reshape(-1, 4, 4)
    return matrices[:, :3, 3], matrices[:, :3, :3].swapaxes(1, 2)


def project_points(camera: Camera, pose: NDArray, points: NDArray) -> tuple[NDArray, NDArray]:
    """Pixels of points, NaN where they are not in the image, and their depths, shapes (N, 2) and (N,)."""
    matrix = poses_to_matrices(np.asarray(pose, dtype=np.float32))
    local = (np.asarray(points, dtype=np.float32).astype(np.float64) - matrix[:3, 3]) @ matrix[:3, :3]
    with np.errstate(divide="ignore", invalid="ignore"):
        at = camera.project(local)
        inside = (local[:, 2] > 0) & (at >= 0).all(axis=1) & (at < [camera.width, camera.height]).all(axis=1)
    return np.where(inside[:, None], at, np.nan), local[:, 2]


def judge_points(
    scene: Scene, camera: Camera, pose: NDArray, points: NDArray, tolerance: float
) -> tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.float64]]:
    """Every point's status, what hides it, and how far along its ray it is from being hidden, or seen [m]."""
    at, depth = project_points(camera, pose, points)
    rays = camera.back_project(at, np.ones(len(at)))
    seen = _cast(scene, replace(camera, near=0.0, far=np.inf), pose, rays, False)
    margin = (depth - seen.depth) * np.linalg.norm(rays, axis=1) - tolerance
    status = _judge(camera, at, depth, margin)
    return status, np.where(status == Visibility.OCCLUDED, seen.objects, -1), np.abs(margin)


judge_points_packets = judge_points


def judge_points_measured(
    camera: Camera, pose: NDArray, depth: NDArray, points: NDArray, tolerance: float
) -> NDArray[np.uint8]:
    at, distance = project_points(camera, pose, points)
    x, y = np.where(np.isfinite(at), at, 0).astype(int).T
    surface = shown_depth(camera, depth)[y, x]
    length = np.linalg.norm(camera.back_project(at, np.ones(len(at))), axis=1)
    with np.errstate(invalid="ignore"):
        status = _judge(camera, at, distance, (distance - surface) * length - tolerance)
    in_range = (status == Visibility.VISIBLE) | (status == Visibility.OCCLUDED)
    return np.where(in_range & np.isnan(surface), Visibility.UNKNOWN, status).astype(np.uint8)


def _judge(camera: Camera, at: NDArray, depth: NDArray, margin: NDArray) -> NDArray[np.uint8]:
    status = np.where(margin > 0, Visibility.OCCLUDED, Visibility.VISIBLE)
    rounded = depth.astype(np.float32)
    status = np.where(rounded > np.float32(camera.far), Visibility.TOO_FAR, status)
    status = np.where(rounded < np.float32(camera.near), Visibility.TOO_NEAR, status)
    return np.where(np.isnan(at[:, 0]), Visibility.OUT_OF_VIEW, status).astype(np.uint8)
