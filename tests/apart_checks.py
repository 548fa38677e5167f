# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of rays with distinct origins: ray patterns, scenes and expected images.

`render` is `warpvis.render` or a function with the same arguments.
"""

import numpy as np
import trimesh

import warpvis as wv
from warpvis.cameras import Rays

from support.ray_patterns import assert_matches_reference, few_origins, sphere_of_rays
from support.worlds import ALL, random_poses

STRAIGHT = [0, 0, 0, 0, 0, 0, 1.0]


def outlets(height, width, radius=0.03, tall=0.5):
    """Return directions and origins of a lidar scan whose origins turn with the sensor, as an Ouster's do.

    Ranges start at the optical center: each origin is `radius` behind the outlet along its ray.
    """
    turned, up = np.meshgrid(np.linspace(-np.pi, np.pi, width, endpoint=False), np.linspace(tall, -tall, height))
    looks = turned + np.radians(np.resize([3.2, 1.1, -1.1, -3.2], height))[:, None]
    directions = np.stack([np.cos(up) * np.cos(looks), np.cos(up) * np.sin(looks), np.sin(up)], axis=-1)
    outlet = radius * np.stack([np.cos(turned), np.sin(turned), np.ones_like(turned)], axis=-1)
    return directions, outlet - radius * directions


def spread_out(count, spread=0.03, seed=2):
    """Return rays in all directions, each with a random origin."""
    return sphere_of_rays(count), np.random.default_rng(seed).uniform(-spread, spread, (count, 3))


def soup(count, near, far, seed):
    """Return triangles of random sizes at distances from `near` to `far` around the origin."""
    rng = np.random.default_rng(seed)
    middles = rng.normal(size=(count, 1, 3))
    away = np.exp(rng.uniform(np.log(near), np.log(far), (count, 1, 1)))
    middles *= away / np.linalg.norm(middles, axis=-1, keepdims=True)
    corners = middles + away * rng.uniform(0.02, 1.0, (count, 1, 1)) * rng.normal(size=(count, 3, 3))
    return trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), process=False)


def check_box(render, size, patterns):
    """Check depth, points and normals in a box far from the world's origin against the closed form."""
    scene, away, half = wv.Scene(device="cpu"), np.array([50.0, -30.0, 20.0]), size * np.array([1.0, 1.5, 2.0])
    scene.add(trimesh.creation.box(2 * half), name="box", pose=(*away, 0, 0, 0, 1))
    for directions, origins in patterns:
        views = render(scene, Rays(directions, origins), [*away, 0, 0, 0, 1], outputs=ALL)
        lengths = np.where(directions > 0, half - origins, -half - origins) / directions
        error = np.abs(views.depth.numpy()[0] - lengths.min(axis=-1))
        assert error.max() <= 1e-5 * max(1, size) + 4e-6
        points = origins + lengths.min(axis=-1)[..., None] * directions
        np.testing.assert_allclose(views.points.numpy()[0] - away, points, atol=2e-5 * max(1, size))
        wall, apart = lengths.argmin(axis=-1), np.sort(lengths, axis=-1)
        normals = np.where(np.arange(3) == wall[..., None], -np.sign(directions), 0)
        sure = apart[..., 1] - apart[..., 0] > 1e-4
        np.testing.assert_allclose(views.normals.numpy()[0][sure], normals[sure], atol=1e-6)


def check_soup(render, near, cull_backfaces, count):
    """Check images of triangles between the ray origins, edge-on triangles, and both sides of triangles."""
    scene = wv.Scene(device="cpu")
    scene.add(soup(150, near, 20 * near, seed=3), name="soup")
    scene.add(soup(60, near, 3.0, seed=4), name="more")
    poses = random_poses(np.random.default_rng(5), 2, spread=0.01)
    poses[:, 2] -= 0.6  # amid the triangles
    pattern = Rays(sphere_of_rays(count), few_origins(count, 0.04), near=near + 0.02, far=15 * near + 0.3)
    views = render(scene, pattern, poses, outputs=ALL, cull_backfaces=cull_backfaces)
    assert np.isneginf(views.depth.numpy()).any() and np.isfinite(views.depth.numpy()).any()
    assert_matches_reference(views, scene, poses, pattern, cull_backfaces=cull_backfaces)


def check_plate(render):
    """Check rays that start on either side of a plate."""
    scene = wv.Scene(device="cpu")
    scene.add(trimesh.Trimesh([[0.01, -9, -9], [0.01, 9, -9], [0.01, 0, 9]], [[0, 1, 2]]), name="plate")
    directions, origins = np.tile([1.0, 0, 0], (64, 1)), np.zeros((64, 3))
    origins[:, 0] = np.linspace(-0.03, 0.031, 64)  # no origin lies in the plate
    views = render(scene, Rays(directions, origins), STRAIGHT, outputs=ALL)
    expected = np.where(origins[:, 0] < 0.01, 0.01 - origins[:, 0], np.inf)
    np.testing.assert_allclose(views.depth.numpy()[0], expected, rtol=0, atol=1e-7)
    seen = np.isfinite(expected)
    np.testing.assert_array_equal(views.normals.numpy()[0][seen], np.tile([-1, 0, 0], (seen.sum(), 1)))


def check_no_leaks(render, subdivisions):
    """Check that no ray passes between the triangles of a closed mesh, at vertices and edges included."""
    ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.7)
    scene = wv.Scene(device="cpu")
    scene.add(ball, name="ball")
    middles = ball.vertices[ball.edges_unique].mean(axis=1)
    targets = np.concatenate([ball.vertices, middles, ball.triangles_center]).astype(np.float32).astype(np.float64)
    for spread in (0.001, 0.04):
        origins = np.random.default_rng(1).uniform(-spread, spread, targets.shape)
        directions = targets - origins
        lengths = np.linalg.norm(directions, axis=-1)
        depth = render(scene, Rays(directions / lengths[:, None], origins), STRAIGHT).depth.numpy()[0]
        np.testing.assert_allclose(depth, lengths, atol=2e-6)


def check_worlds(render, pattern, least):
    """Check worlds and exclusions against single rays."""
    meshes = [trimesh.creation.icosphere(subdivisions=2, radius=0.3), soup(40, 0.05, 0.4, seed=1)]
    scene = wv.Scene(device="cpu")
    places = random_poses(np.random.default_rng(2), 12)
    for number in range(6):
        scene.add(meshes[number % 2], name=f"item_{number}", movable=True)
    for number in range(6, 12):
        scene.add(meshes[number % 2], name=f"item_{number}", pose=places[number])
    rows = np.stack([random_poses(np.random.default_rng(seed), 6, spread=1.2) for seed in (0, 1)])
    poses = random_poses(np.random.default_rng(3), 2, spread=0.4)
    options = {"object_poses": rows, "world_index": [1, 0], "exclude": ["item_1", "item_7"]}
    one = render(scene, pattern, poses, outputs=ALL, **options)
    other = wv.render(scene, pattern, poses, outputs=ALL, caster="rays", **options)
    assert len(np.unique(other.segmentation.numpy())) > 5
    assert (one.segmentation.numpy() == other.segmentation.numpy()).mean() >= least
    assert same_ranges(one.depth.numpy(), other.depth.numpy()).mean() >= least


def same_ranges(depth, expected):
    """Return where ranges agree within rounding."""
    with np.errstate(invalid="ignore"):
        return (depth == expected) | (np.abs(depth - expected) <= 1e-5 * np.maximum(1, expected))
