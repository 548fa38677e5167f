# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Ray bundles cast in packets, and checks of their images."""

import itertools
from dataclasses import dataclass

import numpy as np

from warpvis.cameras.rays import RayCamera

import reference
from compare import assert_view_matches, hair


@dataclass(frozen=True)
class Table(RayCamera):
    """A camera of arbitrary rays."""

    table: np.ndarray
    kind: str = "range"
    near: float = 0.0
    far: float = np.inf

    @property
    def height(self):
        return self.table.shape[0]

    @property
    def width(self):
        return self.table.shape[1]

    @property
    def rays(self):
        return self.table

    def rays_at(self, pixels):
        raise AssertionError("nobody asks")


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def scan(height, width, tall):
    """Return rays of a 360-degree lidar in a camera frame."""
    azimuth, up = np.meshgrid(np.linspace(-np.pi, np.pi, width, endpoint=False), np.linspace(-tall, tall, height))
    return np.stack([np.cos(up) * np.sin(azimuth), np.sin(up), np.cos(up) * np.cos(azimuth)], axis=-1)


def wide(height, width, reach):
    """Return forward rays of depth 1 that span more than one cube face."""
    x, y = np.meshgrid(np.linspace(-reach, reach, width), np.linspace(-reach, reach, height))
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def borders():
    """Return rays through corners, edges and face centers of a cube: on the borders of up to three faces."""
    steps = np.array(list(itertools.product(np.linspace(-1, 1, 9), repeat=3)))
    return unit(steps[np.abs(steps).max(axis=1) == 1])[None]


def with_gaps(rays):
    rays = rays.copy()
    rays[np.random.default_rng(2).random(rays.shape[:2]) < 0.1] = np.nan
    return rays


PATTERNS = {
    "lidar": Table(scan(20, 72, 0.4)),
    "few rows": Table(scan(4, 300, 0.3)),
    "dome": Table(scan(40, 50, np.pi / 2)),
    "no order": Table(unit(np.random.default_rng(1).normal(size=(1, 1500, 3)))),
    "planar, wide": Table(wide(32, 40, 6.0), kind="z"),
    "planar": Table(wide(33, 45, 0.7), kind="z"),
    "gaps": Table(with_gaps(scan(30, 60, 0.7))),
    "column": Table(scan(200, 1, 1.5)),
    "borders": Table(borders()),
    "one": Table(np.array([[[0.0, 0.0, 1.0]]])),
}


def assert_views_match(views, scene, camera, poses, **options):
    for view, pose in enumerate(poses):
        ranges = options | {"near": camera.near, "far": camera.far}
        expected = reference.cast_ray_table(scene, camera.rays, pose, **ranges)

        def depth_beside(x, y, pose=pose, ranges=ranges):
            return reference.cast_ray_table(scene, camera.rays[y, x] + hair(1e-6, 3), pose, **ranges).depth

        assert_view_matches(views, view, expected, depth_beside)
