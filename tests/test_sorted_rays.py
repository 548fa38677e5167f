# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Single rays that are sorted for a GPU: the same bits as rays in the order of the table."""

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.kernels.casting.worlds import Worlds
from warpvis.rendering.casters import rays, single_rays_cuda
from warpvis.rendering.casters.base import CastOptions, ViewBatch
from warpvis.rendering.casters.ray_order_cuda import curve_order, sorted_order
from warpvis.rendering.casters.single_rays_cuda import PackedRays, sorted_rays, takes_sorted_rays

from support.table_packets import PATTERNS
from support.worlds import ALL, assert_bits_equal

OUTPUTS = (*ALL, "faces")
ORIGINS = wv.cameras.Rays(PATTERNS["lidar"].table, origins=0.04 * PATTERNS["lidar"].table[..., [1, 2, 0]])


def sorted_views(scene, camera, poses):
    """Return the images that a GPU makes for a large call."""
    expected = wv.render(scene, camera, poses, outputs=OUTPUTS, caster="rays")
    views = wv.Views(**{name: wp.zeros_like(getattr(expected, name)) for name in OUTPUTS})
    rows = wp.array(np.asarray(poses), dtype=wp.transform, device=scene.device)
    images = {name: getattr(views, name) for name in OUTPUTS}
    triangles = scene.triangles(faces=True).struct
    PackedRays(sorted_rays(camera, scene.device), camera, len(rows), scene.device).run(
        triangles, rows, Worlds(), images
    )
    return views, expected


def assert_same(scene, camera, poses):
    views, expected = sorted_views(scene, camera, poses)
    assert_bits_equal(views, expected)
    assert views.faces.numpy().tobytes() == expected.faces.numpy().tobytes()
    return expected


@pytest.mark.parametrize("name", [*PATTERNS, "origins"])
def test_sorted_rays_have_the_bits_of_the_table(name, device):
    preset = wv.scenes.PRESETS["room"]
    assert_same(preset.build(device), ORIGINS if name == "origins" else PATTERNS[name], preset.pose_rows(3))


@pytest.mark.parametrize("max_close", [1 << 14, 5])
def test_rays_that_start_on_a_surface(max_close, device, monkeypatch):
    """In the plane of a triangle, it is ignored, and coincident ones as well, as for rays of the table."""
    monkeypatch.setattr(single_rays_cuda, "_MAX_CLOSE", max_close)
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((2, 2, 1)), name="box")
    scene.add(trimesh.creation.box((2, 2, 1)), name="twin")
    scene.add(trimesh.creation.icosphere(subdivisions=2, radius=0.4), name="ball", pose=[0.3, 0, 0.9, 0, 0, 0, 1.0])
    poses = np.array(
        [[x, y, z, 0, 0, 0, 1.0] for x, y, z in ((0.2, 0.1, 0.5), (1, 1, 0.5), (1, 0.3, 0), (0.1, 0, 0.5005))]
    )
    for camera in (PATTERNS["lidar"], ORIGINS):
        assert np.isfinite(assert_same(scene, camera, poses).depth.numpy()).any()


def test_calls_that_may_ignore_hits_are_cast_in_the_order_of_the_table():
    views = ViewBatch(np.zeros((1, 7), dtype=np.float32), Worlds())
    excluding = ViewBatch(np.zeros((1, 7), dtype=np.float32), Worlds())
    excluding.worlds.excluded = wp.zeros((1, 1), dtype=wp.uint8, device="cpu")
    assert takes_sorted_rays(CastOptions(), views, 100)
    assert not takes_sorted_rays(CastOptions(), views, 2**31 - single_rays_cuda._CLOSE_THREADS)
    assert not takes_sorted_rays(CastOptions(), excluding, 100)
    assert not takes_sorted_rays(CastOptions(cull_backfaces=True), views, 100)
    assert not takes_sorted_rays(CastOptions(clip_near=True), views, 100)


def test_order_keeps_neighbors_together():
    rays = np.concatenate([PATTERNS["no order"].table.reshape(-1, 3), np.full((3, 3), np.nan)])
    order = curve_order(rays)
    np.testing.assert_array_equal(np.sort(order), np.arange(len(rays)))
    assert np.isnan(rays[order[:3]]).all()
    steps = np.linalg.norm(np.diff(rays[order[3:]], axis=0), axis=1)
    assert np.median(steps) < 3 * np.sqrt(4 * np.pi / 1500)


def test_order_without_rays():
    for shape in ((1, 1, 3), (3, 37, 3), (20, 33, 3)):
        order = sorted_order(np.full(shape, np.nan), None)
        np.testing.assert_array_equal(np.sort(order), np.arange(shape[0] * shape[1]))


def test_order_of_a_lidar_follows_its_table():
    """Lasers left and right of its axis are in different warps."""
    lidar = wv.sensors.lidars.hdl64e()
    shape = (lidar.height, lidar.width, 3)
    order = sorted_order(lidar.rays.reshape(shape), lidar.origins.reshape(shape))
    np.testing.assert_array_equal(np.sort(order), np.arange(lidar.height * lidar.width))
    rays, origins = lidar.rays.reshape(-1, 3)[order], lidar.origins.reshape(-1, 3)[order]
    left = (rays[:, 0] * origins[:, 1] - rays[:, 1] * origins[:, 0] > 0).reshape(-1, 32)
    assert (left.all(axis=1) | ~left.any(axis=1)).mean() > 0.95
    scattered = PATTERNS["no order"].table
    np.testing.assert_array_equal(sorted_order(scattered, None), curve_order(scattered.reshape(-1, 3)))


def test_large_calls_are_sorted_on_a_gpu(cuda, monkeypatch):
    scene, poses = wv.scenes.PRESETS["room"].build(cuda), wv.scenes.PRESETS["room"].poses(2)
    plain = wv.render(scene, ORIGINS, poses, outputs=ALL, caster="rays")
    monkeypatch.setattr(rays, "MIN_RAYS", 1)
    assert_bits_equal(wv.render(scene, ORIGINS, poses, outputs=ALL, caster="rays"), plain)
