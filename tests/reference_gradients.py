# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Float64 twins of `warpvis.kernels.gradients.depth_gradients`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


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


def sum_pose_strips(sums: NDArray, rows: NDArray) -> NDArray[np.float64]:
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


def sum_vertex_gradients(camera, row, images, gradients, index, object_row, vertices, faces):
    """Return gradients with respect to the vertices of an object of a view, shape (n, 3)."""
    pixel, rotation = pixel_gradients(camera, row, images, gradients), rotation_matrix(object_row[3:])
    result = np.zeros((len(vertices), 3))
    for y, x in zip(*np.nonzero(pixel["hit"] & (images["segmentation"] == index)), strict=True):
        corners = faces[images["faces"][y, x]]
        a, b, c = vertices[corners]
        point = (pixel["world_points"][y, x] - object_row[:3]) @ rotation
        weights = np.linalg.lstsq(np.vstack([np.array([a, b, c]).T, np.ones(3)]), np.append(point, 1.0))[0]
        result[corners] += weights[:, None] * (pixel["surface"][y, x] @ rotation)
        normal, of_normal = pixel["normals"][y, x] @ rotation, pixel["of_normals"][y, x] @ rotation
        m = np.cross(b - a, c - a)
        sign, length = np.sign(m @ normal), np.linalg.norm(m)
        for corner, e in zip(corners, (b - c, c - a, a - b), strict=True):
            for k in range(3):  # m changes by e x (a unit vector along axis k), where e is the opposite edge
                change = np.cross(np.eye(3)[k], e)
                result[corner, k] += of_normal @ (sign * (change - normal * (normal @ change)) / length)
    return result


def sum_parameter_gradients(rays, origins, ray_jacobian, origin_jacobian):
    """Return gradients with respect to parameters for each row of the image, shape (P, H)."""
    result = np.einsum("vyxk,pyxk->py", rays.astype(np.float64), ray_jacobian)
    if origin_jacobian is not None:
        result = result + np.einsum("vyxk,pyxk->py", origins.astype(np.float64), origin_jacobian)
    return result


def sum_rows(rows):
    return rows.sum(axis=1)
