# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Define registration problems, and methods that solve them, `wv.register` and its peers, behind one interface.

A problem is one depth image of a known scene. A method is prepared for a problem, which is not timed: it builds
acceleration structures and, for point-cloud methods, samples the surfaces. It returns a function of initial poses
``(N, 4, 4)`` and a number of iterations that returns refined poses, all camera to world.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

import warpvis as wv
from warpvis.core.poses import parse_poses, poses_to_matrices
from warpvis.core.threads import core_count

Refine = Callable[[NDArray[np.float64], int], NDArray[np.float64]]
"""A function of initial poses and a number of iterations that returns refined poses, ``(N, 4, 4)``."""

MAX_TRANSLATION, MAX_ROTATION = 0.01, 1.0
"""Errors [m] and [degrees] below which a registration is a success."""


@dataclass(frozen=True)
class Problem:
    """A depth image of a scene, whose camera pose is to be found."""

    scene: wv.Scene
    camera: wv.Camera
    depth: NDArray[np.float32]
    """Measured planar depth [m], ``(H, W)``; not finite where nothing was measured."""
    truth: NDArray[np.float64]
    """True pose, camera to world, ``(4, 4)``."""
    distance: float
    """Maximum distance of a measured point from the surface that it is compared with [m]."""
    sigma: float = 0.01
    """Standard deviation of depth [m]."""
    moving: str = "camera"
    """``"camera"``, or the name of the only object, whose frame is then the world of all poses here."""

    @cached_property
    def cloud(self) -> NDArray[np.float64]:
        """Measured points in the camera frame [m], ``(N, 3)``."""
        y, x = np.nonzero(np.isfinite(self.depth) & (self.depth > 0))
        return self.camera.back_project(np.stack([x, y], axis=-1) + 0.5, self.depth[y, x])

    @cached_property
    def triangles(self) -> NDArray[np.float64]:
        """Corners of all triangles in the world frame [m], ``(T, 3, 3)``."""
        return np.concatenate([item.vertices[item.faces] for item in self.scene]).astype(np.float64)

    def sample(self, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points that are uniformly distributed on all surfaces, and the normals of their triangles."""
        rng, corners = np.random.default_rng(0), self.triangles
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(normals, axis=-1)
        chosen = rng.choice(len(area), count, p=area / area.sum())
        u, v = rng.random((2, count, 1))
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        a, b, c = corners[chosen].transpose(1, 0, 2)
        return a + u * (b - a) + v * (c - a), normals[chosen] / area[chosen, None]


def synthetic(
    name: str, size: tuple[int, int], view: int = 0, distance: float = 0.5, device: str = "cpu", sensor: Any = None
) -> Problem:
    """Return a problem with rendered depth of a preset, optionally with a sensor's errors."""
    preset = wv.scenes.PRESETS[name]
    scene, pose = preset.build(device), preset.poses(view + 1)[view]
    camera = wv.Camera.from_fov(*size, hfov=0.994837, near=0.05, far=100.0)
    depth = wv.render(scene, camera, pose, outputs=("depth",), sensor=sensor).depth.numpy()[0]
    return Problem(scene, camera, depth, poses_to_matrices(pose[None])[0], distance)


def rotations(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrices of rotation vectors [rad] by Rodrigues' formula, ``(N, 3, 3)``."""
    angle = np.linalg.norm(vectors, axis=-1)[:, None, None]
    x, y, z = (vectors / np.maximum(angle[:, 0], 1e-12)).T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def perturb(
    pose: NDArray[np.float64], count: int, degrees: float, meters: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return poses that are rotated about their origin and displaced by these amounts in random directions."""
    axes, directions = rng.normal(size=(2, count, 3))
    result = np.repeat(pose[None].astype(np.float64), count, axis=0)
    result[:, :3, :3] = rotations(np.radians(degrees) * _units(axes)) @ pose[:3, :3]
    result[:, :3, 3] += meters * _units(directions)
    return result


def _units(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def errors(poses: NDArray[np.float64], truth: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
    """Return distances of the origins [m], and angles between the orientations [degrees]."""
    chord = np.linalg.norm(poses[..., :3, :3] - truth[:3, :3], axis=(-2, -1))
    angles = 2 * np.degrees(np.arcsin(np.clip(chord / np.sqrt(8), 0, 1)))
    return np.linalg.norm(poses[..., :3, 3] - truth[:3, 3], axis=-1), angles


def successes(poses: NDArray[np.float64], truth: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether poses are within 1 cm and 1 degree."""
    translation, rotation = errors(poses, truth)
    return (translation < MAX_TRANSLATION) & (rotation < MAX_ROTATION)


def warpvis(problem: Problem, **options: Any) -> Refine:
    """Return `wv.register`, all poses in one call."""
    options = {"sigma": problem.sigma, "max_distance": problem.distance, **options}

    def refine(starts: NDArray[np.float64], iterations: int) -> NDArray[np.float64]:
        if problem.moving == "camera":
            found = wv.register(problem.scene, problem.camera, problem.depth, starts, iterations=iterations, **options)
            return poses_to_matrices(found.poses.numpy())
        found = wv.register(
            problem.scene,
            problem.camera,
            problem.depth,
            np.eye(4),
            moving=problem.moving,
            object_poses=parse_poses(np.linalg.inv(starts), convention="opencv").numpy()[:, None],
            iterations=iterations,
            **options,
        )
        return np.linalg.inv(poses_to_matrices(found.poses.numpy()))

    return refine


def open3d(problem: Problem, points: int = 50_000) -> Refine:
    """Return Open3D's point-to-plane ICP of the measured points and points on all surfaces, on all cores."""
    import open3d as o3d

    source, target = o3d.geometry.PointCloud(), o3d.geometry.PointCloud()
    source.points = o3d.utility.Vector3dVector(problem.cloud)
    target.points, target.normals = map(o3d.utility.Vector3dVector, problem.sample(points))
    icp = o3d.pipelines.registration
    estimation = icp.TransformationEstimationPointToPlane()

    def refine(starts: NDArray[np.float64], iterations: int) -> NDArray[np.float64]:
        criteria = icp.ICPConvergenceCriteria(0.0, 0.0, iterations)
        found = (
            icp.registration_icp(source, target, problem.distance, start, estimation, criteria) for start in starts
        )
        return np.stack([result.transformation for result in found])

    return refine


def small_gicp(problem: Problem, points: int = 50_000) -> Refine:
    """Return small_gicp's point-to-plane ICP of the same points, on all cores.

    The tree of the target is built once. Its normals are estimated from neighbors, because they cannot be passed.
    """
    import small_gicp as peer

    threads = core_count()
    source, target = peer.PointCloud(problem.cloud), peer.PointCloud(problem.sample(points)[0])
    tree = peer.KdTree(target, num_threads=threads)
    peer.estimate_normals(target, tree, num_neighbors=10, num_threads=threads)

    def refine(starts: NDArray[np.float64], iterations: int) -> NDArray[np.float64]:
        found = (
            peer.align(
                target,
                source,
                tree,
                init_T_target_source=start,
                registration_type="PLANE_ICP",
                max_correspondence_distance=problem.distance,
                num_threads=threads,
                max_iterations=iterations,
                rotation_epsilon=1e-12,
                translation_epsilon=1e-12,
            )
            for start in starts
        )
        return np.stack([result.T_target_source for result in found])

    return refine


METHODS: dict[str, Callable[..., Refine]] = {
    "`wv.register`": warpvis,
    "Open3D `registration_icp`, point to plane": open3d,
    "small_gicp `PLANE_ICP`": small_gicp,
}
