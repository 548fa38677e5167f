# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Patterns of rays, and checks of their images."""

import numpy as np

import reference
from compare import assert_view_matches, hair


def sphere_of_rays(count, seed=0):
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def few_origins(count, spread=0.03, seed=1):
    """Return origins from a few distinct positions: the reference casts rays of equal origin together."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-spread, spread, (8, 3))[rng.integers(8, size=count)]


def assert_matches_reference(views, scene, poses, pattern, **options):
    """Check views against the reference, except where a ray perturbed by 1e-6 gives another result."""
    options |= {"near": pattern.near, "far": pattern.far}
    for view, pose in enumerate(poses):
        expected = reference.cast_ray_table(scene, pattern.rays, pose, origins=pattern.origins, **options)

        def depth_beside(x, y, pose=pose):
            start = None if pattern.origins is None else pattern.origins[y, x] + 0 * hair(1, 3)
            rays = pattern.rays[y, x] + hair(1e-6, 3)
            return reference.cast_ray_table(scene, rays, pose, origins=start, **options).depth

        assert_view_matches(views, view, expected, depth_beside)
