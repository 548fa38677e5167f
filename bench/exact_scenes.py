# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Make scenes of few triangles for `exact_pixels.py`, random and adversarial ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import trimesh
from numpy.random import Generator
from numpy.typing import NDArray

import warpvis as wv
from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.scenes.terrain import grid_faces

Mesh = tuple[NDArray[np.float32], NDArray[np.int32]]


@dataclass
class Case:
    """A scene, a camera and its poses, with movable objects in one world."""

    camera: wv.Camera
    poses: NDArray[np.float32]
    still: list[Mesh] = field(default_factory=list)
    moving: list[Mesh] = field(default_factory=list)
    object_poses: NDArray[np.float32] | None = None  # (moving objects, 7)
    object_scales: NDArray[np.float32] | None = None  # (moving objects, 3)

    def scene(self, device: str) -> wv.Scene:
        """Build the scene on a device."""
        scene = wv.Scene(device=device)
        for mesh in self.still:
            scene.add(mesh)
        for mesh in self.moving:
            scene.add(mesh, movable=True)
        return scene

    @property
    def corners(self) -> NDArray[np.float64]:
        """Return the triangles in the world frame, shape ``(T, 3, 3)``, from the numbers that the scene receives."""
        parts = [vertices.astype(np.float64)[faces] for vertices, faces in self.still]
        for k, (vertices, faces) in enumerate(self.moving):
            matrix = poses_to_matrices(self.object_poses[k])
            scaled = vertices.astype(np.float64)
            if self.object_scales is not None:
                scaled = scaled * self.object_scales[k]
            parts.append((scaled @ matrix[:3, :3].T + matrix[:3, 3])[faces])
        return np.concatenate(parts)


def camera_of(rng: Generator, width: int, height: int) -> wv.Camera:
    """Return a camera of 20 to 130 degrees, with an off-center principal point in half of all cases."""
    camera = wv.Camera.from_fov(width, height, hfov=np.radians(rng.uniform(20, 130)))
    if rng.random() < 0.5:
        return camera
    shift = rng.uniform(-0.1, 0.1, 2) * (width, height)
    return wv.Camera(width, height, camera.fx, camera.fy * rng.uniform(0.9, 1.1), *(shift + (camera.cx, camera.cy)))


def turned(rng: Generator, count: int) -> NDArray[np.float64]:
    """Return uniformly distributed unit quaternions."""
    q = rng.normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1)[:, None]


def looking(eyes: NDArray[np.float64], targets: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return many poses as `wv.look_at` does, with one `up` or one for each."""
    forward = targets - eyes
    right = np.cross(forward, up)
    axes = np.stack([right, np.cross(forward, right), forward], axis=-1)
    matrices = np.tile(np.eye(4), (len(eyes), 1, 1))
    matrices[:, :3, :3] = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    matrices[:, :3, 3] = eyes
    return poses_to_opencv(matrices).astype(np.float32)


def around(rng: Generator, center: NDArray[np.float64], distance: float, views: int) -> NDArray[np.float32]:
    """Return poses that look at points near a center, from about a distance."""
    eyes = center + rng.normal(size=(views, 3)) * distance
    targets = center + rng.normal(size=(views, 3)) * 0.3 * distance
    return looking(eyes, targets, rng.normal(size=3))


def soup(rng: Generator, count: int, size: float) -> Mesh:
    """Return unrelated random triangles."""
    corners = rng.normal(size=(count, 1, 3)) * size
    corners = corners + rng.normal(size=(count, 3, 3)) * size * 10.0 ** rng.uniform(-2, 0.3, (count, 1, 1))
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def as_mesh(mesh: trimesh.Trimesh, scale: float = 1.0, offset: NDArray[np.float64] | float = 0.0) -> Mesh:
    """Return a mesh scaled and moved."""
    return (mesh.vertices * scale + offset).astype(np.float32), mesh.faces.astype(np.int32)


def random(rng: Generator, width: int, height: int, views: int) -> Case:
    """Make triangles of all sizes."""
    scale = 10.0 ** rng.uniform(-2, 2)
    poses = around(rng, np.zeros(3), scale * 10.0 ** rng.uniform(-0.5, 1), views)
    return Case(camera_of(rng, width, height), poses, [soup(rng, 150, scale)])


def closed(rng: Generator, width: int, height: int, views: int) -> Case:
    """Make balls and boxes, seen from outside and from inside."""
    scale = 10.0 ** rng.uniform(-2, 2)
    meshes = [as_mesh(trimesh.creation.icosphere(subdivisions=2), scale * rng.uniform(0.5, 1))]
    for _ in range(3):
        box = trimesh.creation.box(rng.uniform(0.2, 2, 3))
        box.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
        meshes.append(as_mesh(box, scale, rng.normal(size=3) * 1.5 * scale))
    return Case(camera_of(rng, width, height), around(rng, np.zeros(3), 2 * scale, views), meshes)


def corners(rng: Generator, width: int, height: int, views: int) -> Case:
    """Make a wall with corners at pixel centers, up to rounding, and another wall behind it."""
    scale, f = 10.0 ** rng.uniform(-1, 1), 100.0
    step = rng.choice([0.5, 1.0, 3.0])
    x = (np.arange(13) - 6) * step * scale
    plane = np.stack([*np.meshgrid(x, x, indexing="ij"), np.full((13, 13), f * scale)], -1).reshape(-1, 3)
    tilt = rng.choice([0.0, 1.0]) * rng.uniform(-1, 1)
    plane *= 1 + tilt * plane[:, :1] / (f * scale)  # along the rays
    pose = np.r_[rng.normal(size=3) * 10.0 ** rng.uniform(0, 2), turned(rng, 1)[0]].astype(np.float32)
    if rng.random() < 0.3:
        pose[3:] = rng.choice([[0, 0, 0, 1], [1, 0, 0, 0], [0.5, -0.5, 0.5, -0.5]])
    matrix = poses_to_matrices(pose)
    wall = (plane @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32)
    camera = wv.Camera(width, height, f, f, width // 2 + 0.5, height // 2 + 0.5)
    behind = ((plane * 2) @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32)
    poses = np.tile(pose, (views, 1))
    poses[1:, :3] += (rng.integers(-20, 20, (views - 1, 2)) * scale / 4) @ matrix[:3, :2].T.astype(np.float32)
    faces = grid_faces(13).astype(np.int32)
    return Case(camera, poses.astype(np.float32), [(wall, faces), (behind, faces)])


def grazing(rng: Generator, width: int, height: int, views: int) -> Case:
    """Make planes seen at less than a degree, in one piece and as tiles."""
    scale = 10.0 ** rng.uniform(-1, 2)
    count = int(rng.choice([2, 9]))
    x = np.linspace(-1, 1, count) * scale
    grid = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((count, count))], -1).reshape(-1, 3)
    rotation = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
    offset = rng.normal(size=3) * scale
    heights = scale * np.radians(10.0 ** rng.uniform(-3, 0.3, views)) * rng.choice([-1, 1], views)
    angle = rng.uniform(0, 2 * np.pi, views)
    away = rng.uniform(0.1, 1.5, views) * scale
    eyes = np.stack([np.cos(angle) * away, np.sin(angle) * away, heights], -1)
    targets = np.stack([*(rng.normal(size=(2, views)) * 0.3 * scale), np.zeros(views)], -1)
    up = rotation @ np.array([rng.normal() * 0.3, rng.normal() * 0.3, 1.0])
    poses = looking(eyes @ rotation.T + offset, targets @ rotation.T + offset, up)
    mesh = (grid @ rotation.T + offset).astype(np.float32), grid_faces(count).astype(np.int32)
    return Case(camera_of(rng, width, height), poses, [mesh])


def slivers(rng: Generator, width: int, height: int, views: int) -> Case:
    """Make a surface of triangles that are 1,000 to 1,000,000 times as long as wide, and needles in front of it."""
    scale = 10.0 ** rng.uniform(-1, 1)
    rows = np.cumsum(10.0 ** rng.uniform(-6, -0.5, 40))
    rows = (rows / rows[-1] - 0.5) * 2 * scale
    columns = np.array([-1.0, rng.uniform(-1, 1), 1.0]) * scale
    grid = np.stack([*np.meshgrid(rows, columns, indexing="ij"), np.zeros((40, 3))], -1).reshape(-1, 3)
    grid[:, 2] = rng.normal(size=len(grid)) * scale * 10.0 ** rng.uniform(-4, -1)
    first = (3 * np.arange(39)[:, None] + np.arange(2)).reshape(-1, 1)
    faces = np.concatenate([first + (0, 3, 4), first + (0, 4, 1)]).astype(np.int32)
    ends = rng.normal(size=(60, 2, 3)) * scale
    third = ends[:, 0] + (ends[:, 1] - ends[:, 0]) * rng.random((60, 1))
    third = third + rng.normal(size=(60, 3)) * scale * 10.0 ** rng.uniform(-6, -2, (60, 1))
    needles = np.concatenate([ends, third[:, None]], 1).reshape(-1, 3).astype(np.float32)
    poses = around(rng, np.zeros(3), scale, views)
    meshes = [(grid.astype(np.float32), faces), (needles, np.arange(180, dtype=np.int32).reshape(-1, 3))]
    return Case(camera_of(rng, width, height), poses, meshes)


def far_away(rng: Generator, width: int, height: int, views: int) -> Case:
    """Place camera and surface 10 km and more from the origin, where coordinates are coarse."""
    inner = FAMILIES[str(rng.choice(["random", "closed", "slivers"]))](rng, width, height, views)
    offset = rng.normal(size=3) * 10.0 ** rng.uniform(3, 5)
    still = [((vertices + offset).astype(np.float32), faces) for vertices, faces in inner.still]
    poses = inner.poses.astype(np.float64)
    poses[:, :3] += offset
    return Case(inner.camera, poses.astype(np.float32), still)


def moved(rng: Generator, width: int, height: int, views: int) -> Case:
    """Make moving objects, some with vertices far from their frame's origin, scaled or not."""
    scale = 10.0 ** rng.uniform(-1, 1.5)
    center = rng.normal(size=3) * scale * rng.choice([1.0, 1e4])
    meshes = [as_mesh(trimesh.creation.icosphere(subdivisions=1), scale), soup(rng, 40, scale)]
    meshes.append(as_mesh(trimesh.creation.box((1, 2, 0.5)), scale, rng.choice([0.0, 1000.0]) * scale))
    meshes.append(as_mesh(trimesh.creation.cylinder(0.5, 2.0, sections=24), scale))
    poses = np.concatenate([center + rng.normal(size=(4, 3)) * 2 * scale, turned(rng, 4)], -1).astype(np.float32)
    if np.abs(meshes[2][0]).max() > 100 * scale:  # back to the other objects
        poses[2, :3] -= (poses_to_matrices(poses[2])[:3, :3] @ np.full(3, 1000.0 * scale)).astype(np.float32)
    scales = (10.0 ** rng.uniform(-0.5, 0.5, (4, 3))).astype(np.float32) if rng.random() < 0.5 else None
    still = [as_mesh(trimesh.creation.box((8, 8, 0.1)), scale, center)]
    views_of = around(rng, center, 3 * scale, views)
    return Case(camera_of(rng, width, height), views_of, still, meshes, poses, scales)


def edge_on(rng: Generator, width: int, height: int, views: int) -> Case:
    """Make axis-aligned boxes, seen from within the planes of their sides, with edges through pixel centers."""
    scale = 2.0 ** rng.integers(-3, 4)
    boxes = [as_mesh(trimesh.creation.box((2, 2, 2)), scale, rng.integers(-3, 4, 3) * scale) for _ in range(8)]
    eyes = rng.integers(-4, 5, (views, 3)) * scale
    directions = np.concatenate([np.eye(3), -np.eye(3), [[1, 1, 0], [0, 1, 1], [1, 0, 1], [1, 1, 1]]])
    chosen = directions[rng.integers(0, len(directions), views)]
    poses = looking(eyes, eyes + chosen, np.eye(3)[np.abs(chosen).argmin(axis=1)])
    f = float(rng.choice([50.0, 64.0, 100.0]))
    camera = wv.Camera(width, height, f, f, width // 2 + 0.5, height // 2 + 0.5)
    return Case(camera, poses, boxes)


def far_corners(rng: Generator, width: int, height: int, views: int) -> Case:
    """Make walls of up to kilometers, seen from about a meter from their one near corner: the others are coarse."""
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    near = rng.normal(size=3) * rng.choice([0.3, 300.0])
    angles = rng.uniform(0, 2 * np.pi, 2)
    along = np.cos(angles)[:, None] * axes[0] + np.sin(angles)[:, None] * axes[1]
    corners = np.stack([near, *(near + along * 10.0 ** rng.uniform(2, 3.5))])
    corners = np.roll(corners, rng.integers(3), axis=0).astype(np.float32)
    eyes = near + axes[2] * rng.uniform(0.3, 3, (views, 1))
    tilt = rng.normal(size=(views, 1)) * rng.choice([0.0, 1e-6, 1e-4, 1e-2, 0.3], (views, 1))
    poses = looking(eyes, near + axes[0] * tilt, turned(rng, views)[:, :3])
    return Case(camera_of(rng, width, height), poses, [(corners, np.array([[0, 1, 2]], np.int32))])


def posts(rng: Generator, width: int, height: int, views: int) -> Case:
    """Make cylinders of many sides, seen from between their ends: slivers that reach behind the camera."""
    scale = 10.0 ** rng.uniform(-1, 1)
    meshes = []
    for _ in range(3):
        sides = int(rng.choice([12, 100, 400]))
        post = trimesh.creation.cylinder(rng.uniform(0.01, 0.1), rng.uniform(1, 4), sections=sides)
        post.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
        meshes.append(as_mesh(post, scale, rng.normal(size=3) * 0.5 * scale))
    poses = around(rng, np.zeros(3), 0.5 * scale, views)
    if rng.random() < 0.5:
        return Case(camera_of(rng, width, height), poses, meshes)
    places = np.concatenate([rng.normal(size=(3, 3)) * 0.3 * scale, turned(rng, 3)], -1).astype(np.float32)
    return Case(camera_of(rng, width, height), poses, [], meshes, places)


FAMILIES: dict[str, Callable[[Generator, int, int, int], Case]] = {
    "random": random,
    "closed": closed,
    "corners": corners,
    "grazing": grazing,
    "slivers": slivers,
    "far_away": far_away,
    "moved": moved,
    "edge_on": edge_on,
    "far_corners": far_corners,
    "posts": posts,
}
