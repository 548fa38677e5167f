# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Float64 twins of `warpvis.kernels.gradients.depth_gradients`, and depth for central differences."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import reference


def rotation_matrix(q: NDArray) -> NDArray[np.float64]:
    """Return the rotation matrix of a quaternion ``x y z w`` of any length."""
    x, y, z, w = np.asarray(q, dtype=np.float64) / np.linalg.norm(q)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def pixel_gradients(camera, row, images, gradients):
    """Return what `pixel_gradient` of the kernels returns, for all pixels of a view.

    Args:
        camera: The camera.
        row: Its pose ``x y z qx qy qz qw``.
        images: Images of the view by name, float64.
        gradients: Gradients with respect to depth, points and normals, by name.
    """
    rotation, depth = rotation_matrix(row[3:]), images["depth"]
    hit = np.isfinite(depth)
    z, rays = np.where(hit, depth, 0.0), np.nan_to_num(camera.rays).reshape(*depth.shape, 3)
    points = z[..., None] * rays
    if camera.origins is not None:
        points = points + np.nan_to_num(camera.origins).reshape(points.shape)
    along, normals = rays @ rotation.T, np.where(hit[..., None], images["normals"], 1.0)
    of_point = gradients.get("points", np.zeros(points.shape)) * hit[..., None]
    of_depth = gradients.get("depth", np.zeros(depth.shape)) * hit + (of_point * along).sum(axis=-1)
    slope = np.where(hit, (normals * along).sum(axis=-1), 1.0)
    surface = (of_depth / slope)[..., None] * normals
    return {
        "hit": hit,
        "points": points,
        "world_points": points @ rotation.T + row[:3],
        "surface": surface,
        "camera": of_point - surface,
        "normals": normals,
        "of_normals": gradients.get("normals", np.zeros(points.shape)) * hit[..., None],
    }


def _moments(forces: NDArray, points: NDArray) -> NDArray[np.float64]:
    points = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)
    return forces.reshape(-1, 3).T @ points.reshape(-1, 4)


def sum_moments(camera, row, images, gradients, columns, object_rows):
    """Return gradients with respect to ``[R t]`` of the camera and of the movable objects, shape (1 + M, 3, 4)."""
    pixel = pixel_gradients(camera, row, images, gradients)
    sums = np.zeros((1 + len(object_rows), 3, 4))
    sums[0] = _moments(pixel["camera"], pixel["points"])
    seen = np.where(images["segmentation"] >= 0, np.asarray(columns)[images["segmentation"]], -1)
    for column, pose in enumerate(object_rows):
        mine, rotation = pixel["hit"] & (seen == column), rotation_matrix(pose[3:])
        local = (pixel["world_points"][mine] - pose[:3]) @ rotation
        sums[1 + column] = _moments(pixel["surface"][mine], local)
        sums[1 + column, :, :3] += np.einsum("ni,nk->ik", pixel["of_normals"][mine], pixel["normals"][mine] @ rotation)
    return sums


def sum_strips(sums: NDArray, rows: NDArray) -> NDArray[np.float64]:
    """Return gradients with respect to pose rows, by differences of the rotation matrix, shape (1 + M, 7)."""
    result, step = np.zeros((len(sums), 7)), 1e-6
    for index, (total, row) in enumerate(zip(sums, rows, strict=True)):
        result[index, :3] = total[:, 3]
        for k in range(4):
            change = step * np.eye(4)[k]
            slope = (rotation_matrix(row[3:] + change) - rotation_matrix(row[3:] - change)) / (2 * step)
            result[index, 3 + k] = (total[:, :3] * slope).sum()
    return result


def write_ray_gradients(camera, row, images, gradients):
    """Return gradients with respect to the rays and origins of pixels, shape (H, W, 3)."""
    pixel = pixel_gradients(camera, row, images, gradients)
    origins = pixel["camera"] @ rotation_matrix(row[3:])
    return np.where(pixel["hit"], images["depth"], 0.0)[..., None] * origins, origins


def cast_depth(scene, rays, origins, row, object_rows=(), vertices=None):
    """Return depth of rays and the seen triangle of all triangles of the scene, in float64 and without solids.

    Args:
        scene: A scene of meshes.
        rays: Rays in the camera frame, shape (N, 3), and their `origins`, (N, 3) or None.
        row: Pose of the camera.
        object_rows: Poses of the movable objects, in the order of `scene.movable`.
        vertices: Vertices of objects in their frames, by name, instead of those of the scene.
    """
    corners = []
    for index, item in enumerate(scene.objects):
        if index in scene.movable and len(object_rows):
            pose = np.asarray(object_rows[scene.movable.index(index)], dtype=np.float64)
            local = (vertices or {}).get(item.name, np.asarray(item.mesh_vertices, dtype=np.float64))
            points = local @ rotation_matrix(pose[3:]).T + pose[:3]
        else:
            points = item.vertices.astype(np.float64)
        corners.append(points[item.faces])
    rotation = rotation_matrix(row[3:])
    seen = (np.concatenate(corners) - np.asarray(row[:3], dtype=np.float64)) @ rotation
    if origins is None:
        return reference._nearest_triangle(rays, seen, False, 0.0)
    return _cast_from_origins(seen, rays, origins)


def _cast_from_origins(corners: NDArray, rays: NDArray, origins: NDArray) -> tuple[NDArray, NDArray]:
    """Return depth and triangle for rays of separate origins, for all pairs at once (Moeller and Trumbore, 1997)."""
    a, b, c = corners.swapaxes(0, 1)
    e1, e2, s = b - a, c - a, origins[:, None] - a
    h, q = np.cross(rays[:, None], e2), np.cross(s, e1)
    with np.errstate(divide="ignore", invalid="ignore"):
        f = 1 / (e1 * h).sum(axis=-1)
        u, v, z = f * (s * h).sum(axis=-1), f * (rays[:, None] * q).sum(axis=-1), f * (e2 * q).sum(axis=-1)
        z[~((u >= 0) & (v >= 0) & (u + v <= 1) & (z > 0))] = np.inf
    return z.min(axis=1), z.argmin(axis=1)


__all__ = ["cast_depth", "sum_moments", "sum_strips", "write_ray_gradients"]
