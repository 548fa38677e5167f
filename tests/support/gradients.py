# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A scene, cameras and central differences for tests of gradients."""

import numpy as np
import trimesh
from numpy.typing import NDArray
from reference_gradients import rotation_matrix

import warpvis as wv
from warpvis.cameras import LensCamera, OrthographicCamera, Rays, WideCamera

import reference
from support.lens_camera import SMALL, WIDE

ROW = np.array([0.1, -0.2, 0.3, *wv.look_at((0.1, -0.2, 0.3), (3.0, 0.1, 0.2)).reshape(-1)[3:7]])
OBJECT_ROWS = np.array([[2.5, 0.3, 0.1, 0.1, -0.2, 0.3, 0.9], [2.2, -0.6, 0.4, 0.5, 0.1, -0.3, 0.8]])
OBJECT_ROWS[:, 3:] /= np.linalg.norm(OBJECT_ROWS[:, 3:], axis=1, keepdims=True)
STEP = 1e-5
NAMES = ("depth", "points", "normals")


def _lidar():
    rng = np.random.default_rng(3)
    directions = rng.normal((0.0, 0.0, 2.0), 0.4, (300, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return Rays(directions, rng.uniform(-0.03, 0.03, (300, 3)), near=0.1, far=8.0)


CAMERAS = {
    "pinhole": wv.Camera.from_fov(36, 28, hfov=1.1, near=0.1, far=8.0),
    "distorted": LensCamera(SMALL, 64, 48, near=0.1, far=8.0),
    "fisheye": LensCamera(WIDE, 64, 48, near=0.1, far=8.0),
    "panorama": WideCamera(48, 24, 4.0, near=0.1, far=8.0),
    "orthographic": OrthographicCamera.from_extent(32, 24, across=3.0, far=8.0),
    "lidar": _lidar(),
}


def build_scene(device="cpu"):
    """Return a scene with two movable objects in front of a bent wall and a floor that does not fill every image."""
    scene = wv.Scene(device=device)
    wall = trimesh.creation.icosphere(subdivisions=2, radius=2.0)
    scene.add(wall, name="wall", pose=(4.5, 0, 0, 0, 0, 0, 1))
    scene.add(trimesh.creation.box(extents=(8, 8, 0.1)), name="floor", pose=(2, 0, -1.5, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(subdivisions=1, radius=0.5), name="stone", pose=OBJECT_ROWS[0], movable=True)
    scene.add(trimesh.creation.box(extents=(0.4, 0.5, 0.6)), name="box", pose=OBJECT_ROWS[1], movable=True)
    return scene


def flat_rays(camera):
    """Return rays and origins of a camera as lists, 0 instead of NaN, and the mask of pixels with a ray."""
    rays = np.asarray(camera.rays, dtype=np.float64).reshape(-1, 3)
    valid = np.isfinite(rays).all(axis=1)
    origins = None if camera.origins is None else np.asarray(camera.origins, dtype=np.float64).reshape(-1, 3)
    return np.where(valid[:, None], rays, 0.0), origins, valid


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


class Loss:
    """A weighted sum of depth, points and normals, computed in float64 by casting rays again.

    Its weights are 0 for pixels that see another triangle after one of the changes that it was created for.
    """

    def __init__(self, scene, camera, changes, seed=0):
        """Choose weights; `changes` are dicts of arguments of `images` for pairs of steps, up and down."""
        self.scene, self.camera = scene, camera
        rays, _, valid = flat_rays(camera)
        depth, triangle, *_ = self.images()
        steady = valid & np.isfinite(depth) & (depth < camera.far) & (depth > camera.near)
        self._changed = [self.images(**change) for change in changes]
        for images in self._changed:
            steady &= images[1] == triangle
        assert steady.sum() > 0.2 * len(rays)
        rng = np.random.default_rng(seed)
        self.weights = {
            "depth": rng.uniform(0.5, 1.5, len(rays)) * steady,
            "points": rng.uniform(-1, 1, (len(rays), 3)) * steady[:, None],
            "normals": rng.uniform(-1, 1, (len(rays), 3)) * steady[:, None],
        }

    def images(self, row=ROW, object_rows=OBJECT_ROWS, vertices=None, rays=None, origins=None):
        """Return depth, seen triangle, points and normals in float64."""
        own_rays, own_origins, _ = flat_rays(self.camera)
        rays = own_rays if rays is None else rays
        origins = own_origins if origins is None else origins
        depth, triangle = cast_depth(self.scene, rays, origins, row, object_rows, vertices)
        rotation = rotation_matrix(row[3:])
        z = np.where(np.isfinite(depth), depth, 0.0)
        points = (z[:, None] * rays + (0.0 if origins is None else origins)) @ rotation.T + row[:3]
        a, b, c = self.corners(object_rows, vertices)[triangle].swapaxes(0, 1)
        normals = np.cross(b - a, c - a)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        normals *= -np.sign((normals * (rays @ rotation.T)).sum(axis=1, keepdims=True))
        return depth, triangle, points, normals

    def corners(self, object_rows, vertices):
        """Return the corners of all triangles in the world."""
        corners = []
        for index, item in enumerate(self.scene.objects):
            points = item.vertices.astype(np.float64)
            if index in self.scene.movable:
                pose = object_rows[self.scene.movable.index(index)]
                local = (vertices or {}).get(item.name, np.asarray(item.mesh_vertices, dtype=np.float64))
                points = local @ rotation_matrix(pose[3:]).T + pose[:3]
            corners.append(points[item.faces])
        return np.concatenate(corners)

    def pixel_losses(self, images, names=NAMES):
        """Return the loss of each pixel, given the result of `images`."""
        depth, _, points, normals = images
        losses = {
            "depth": self.weights["depth"] * np.where(np.isfinite(depth), depth, 0.0),
            "points": (self.weights["points"] * points).sum(axis=1),
            "normals": (self.weights["normals"] * normals).sum(axis=1),
        }
        return sum(losses[name] for name in names)

    def differences(self, names=NAMES, step=STEP):
        """Return central differences of the pixels' losses for each pair of changes, shape ``(pairs, N)``."""
        values = np.array([self.pixel_losses(images, names) for images in self._changed])
        return (values[::2] - values[1::2]) / (2 * step)

    def image_gradients(self, names=NAMES):
        """Return the gradients of the loss with respect to images, float32 in the shape of one view."""
        shape = self.camera.shape
        return {
            name: self.weights[name].reshape(1, *shape, *self.weights[name].shape[1:]).astype(np.float32)
            for name in names
        }


def changes_of(name, base, step=STEP):
    """Return the arguments of `Loss` for a step up and down of every number of an array."""
    flat = np.asarray(base, dtype=np.float64).reshape(-1)
    return [
        {name: (flat + sign * step * np.eye(len(flat))[k]).reshape(base.shape)}
        for k in range(len(flat))
        for sign in (1, -1)
    ]
