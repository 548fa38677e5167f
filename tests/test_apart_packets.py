# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Packets of rays with distinct origins against closed forms, the float64 reference and single rays."""

import pickle

import numpy as np
import pytest
import trimesh
import warp as wp
from apart_checks import (
    check_box,
    check_no_leaks,
    check_plate,
    check_soup,
    check_worlds,
    outlets,
    same_ranges,
    spread_out,
)

import warpvis as wv
from warpvis.cameras import Rays
from warpvis.rendering.casters import rays
from warpvis.rendering.casters.moving import MovingCaster

import reference
from support.ray_patterns import assert_matches_reference, few_origins, sphere_of_rays
from support.sizes import SHAPES, build as build_scaled, random_scales
from support.solids import build as build_solids
from support.worlds import ALL, assert_bits_equal, random_poses


@pytest.fixture
def packets_only(monkeypatch):
    """Fail if a ray is cast outside packets."""

    def refuse(*_):
        raise AssertionError("cast ray by ray")

    monkeypatch.setattr(rays.RayBundleCaster, "cast", refuse)


@pytest.mark.parametrize("size", [0.05, 1.0, 40.0])
def test_ranges_inside_a_box(size, packets_only):
    check_box(wv.render, size, (outlets(40, 200), spread_out(3000)))


def test_ranges_of_a_sphere(packets_only):
    """Seen from inside and outside, depth is within the sagitta of the triangles."""
    scene = wv.Scene(device="cpu")
    ball = trimesh.creation.icosphere(subdivisions=5, radius=3.0)
    scene.add(ball, name="ball")
    sagitta = 3 - np.linalg.norm(ball.triangles_center, axis=-1).min()
    for eye in ([0.4, -0.3, 0.2], [0.4, -0.3, 5.0]):
        directions, origins = spread_out(4000)
        depth = wv.render(scene, Rays(directions, origins), [*eye, 0, 0, 0, 1]).depth.numpy()[0]
        starts = origins + eye
        along = (directions * starts).sum(axis=-1)
        under = along**2 - (starts**2).sum(axis=-1) + 9
        inside = np.linalg.norm(eye) < 3
        expected = -along + np.sqrt(np.maximum(under, 0)) * (1 if inside else -1)
        hit = inside | ((under > 0.5) & (along < 0))
        assert hit.sum() > 100
        error = (expected - depth)[hit] * (1 if inside else -1)
        assert (error >= -2e-6).all() and (error <= 4 * sagitta).all()
        assert np.isposinf(depth[~inside & ((under < -1e-6) | (along > 0))]).all()


@pytest.mark.parametrize("cull_backfaces", [False, True])
@pytest.mark.parametrize("near", [0.004, 0.05, 1.0])
def test_triangles_near_the_origins_match_the_reference(near, cull_backfaces, packets_only):
    check_soup(wv.render, near, cull_backfaces, 1500)


def forward_rays(spread, reach=0.7):
    """Return directions of an image, and origins in a square of the image plane."""
    x, y = np.meshgrid(np.linspace(-reach, reach, 64), np.linspace(-reach, reach, 48))
    directions = np.stack([x, y, np.ones_like(x)], axis=-1)
    origins = np.random.default_rng(0).uniform(-spread, spread, (*x.shape, 3))
    origins[..., 2] = 0
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True), origins


def test_origins_at_negative_zero(packets_only):
    """Some rays begin at a depth of -0 m, others at 0 m."""
    scene = wv.Scene(device="cpu")
    scene.add(trimesh.creation.box((20, 20, 1)), name="wall", pose=(0, 0, 4.5, 0, 0, 0, 1))
    directions, origins = forward_rays(0.05)
    origins[::2, :, 2] = -0.0
    depth = wv.render(scene, Rays(directions, origins), [0, 0, 0, 0, 0, 0, 1]).depth.numpy()[0]
    np.testing.assert_allclose(depth * directions[..., 2], 4, rtol=1e-6)


@pytest.mark.parametrize("spread", [0.05, 0.0])
def test_the_first_of_coinciding_walls_is_shown(spread, packets_only):
    """Even if the other one, whose box is nearer, is rasterized first. All of a wall is at one depth."""
    wall = np.array([(-9, -9, 4), (9, -9, 4), (9, 9, 4), (-9, 9, 4)], dtype=np.float32)
    aside = np.array([(20, 0, 2), (21, 0, 2), (20, 1, 2)], dtype=np.float32)
    sides = np.array([(0, 2, 1), (0, 3, 2)])
    scene = wv.Scene(device="cpu")
    scene.add((wall, sides), name="first", movable=True)
    scene.add((np.concatenate([wall, aside]), np.array([*sides, (4, 6, 5)])), name="second", movable=True)
    rays = Rays(*forward_rays(spread))
    views = wv.render(scene, rays, [0, 0, 0, 0, 0, 0, 1], outputs=("depth", "segmentation"))
    assert (views.segmentation.numpy() == 0).all()


def test_only_rays_beside_the_eye_see_near_ends(packets_only):
    """Triangles outside the image of the eye, whose near ends are in the image of rays with other origins."""
    spike = np.array([(0.315, -0.2, 0.3), (0.315, 0.2, 0.3), (9, 0, 8)])
    turns = [np.array([(c, -s, 0), (s, c, 0), (0, 0, 1)]) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    scene = wv.Scene(device="cpu")
    for turn in turns:
        scene.add((spike @ turn.T, np.array([(0, 1, 2)])))
    rays, pose = Rays(*forward_rays(0.05, reach=0.99)), (0, 0, 0, 0, 0, 0, 1)
    views = wv.render(scene, rays, pose, outputs=("depth", "segmentation"))
    some = np.s_[::3, ::5]
    given = rays.rays[some], np.array(pose, dtype=np.float64)
    expected = reference.cast_ray_table(scene, *given, origins=rays.origins[some])
    assert same_ranges(views.depth.numpy()[0][some], expected.depth).mean() > 0.99
    assert set(np.unique(views.segmentation.numpy())) == {-1, 0, 1, 2, 3}


def test_rays_start_on_either_side_of_a_plate(packets_only):
    check_plate(wv.render)


def test_room_matches_the_reference(packets_only):
    scene = wv.scenes.PRESETS["room"].build("cpu")
    poses = np.array([wv.look_at(eye, (0.5, 0.4, 0.3)) for eye in ((0.1, 0.2, 0.9), (-0.8, 1.2, 1.5))])
    for shape in ((1500,), (30, 50)):
        pattern = Rays(sphere_of_rays(1500).reshape(*shape, 3), few_origins(1500).reshape(*shape, 3), near=0.4, far=2.0)
        views = wv.render(scene, pattern, poses, outputs=ALL)
        if len(shape) == 2:
            assert_matches_reference(views, scene, poses, pattern)
        assert np.isposinf(views.depth.numpy()).any()


@pytest.mark.smoke("room")
@pytest.mark.parametrize("name", ["room", "blobs_77k"])
def test_ouster_scan_matches_single_rays(name):
    scene, poses = (
        wv.scenes.PRESETS[name].build("cpu"),
        np.array([[0.4, 0.3, 0.8, 0, 0, 0, 1], [-1, 1, 0.4, 0, 0, 1, 0]]),
    )
    for kind in ("OS0-128", "OS1-64"):
        lidar = wv.sensors.lidars.ouster(kind, near=0.5, far=6.0)
        one, other = (wv.render(scene, lidar, poses, outputs=ALL, caster=caster) for caster in ("auto", "rays"))
        depth = one.depth.numpy()
        same = same_ranges(depth, other.depth.numpy())
        assert same.mean() >= 0.9999
        for image in ("segmentation", "labels"):
            alike = getattr(one, image).numpy() == getattr(other, image).numpy()
            assert alike.mean() >= 0.9999
        hit = same & np.isfinite(depth)
        assert hit.mean() > 0.01
        np.testing.assert_allclose(one.points.numpy()[hit], other.points.numpy()[hit], atol=1e-4)
        turned = np.abs(one.normals.numpy()[hit] - other.normals.numpy()[hit]).max(axis=-1) > 1e-4
        assert turned.mean() <= 1e-3


def test_no_ray_passes_between_triangles(packets_only):
    check_no_leaks(wv.render, 3)


def test_worlds_and_exclude_match_single_rays():
    check_worlds(wv.render, Rays(*outlets(48, 160)), 0.9999)


def test_results_do_not_depend_on_batching_or_threads(packets_only):
    scene, poses = wv.scenes.PRESETS["room"].build("cpu"), wv.scenes.PRESETS["room"].poses(5)
    pattern = Rays(*outlets(64, 256))
    one = wv.render(scene, pattern, poses, outputs=ALL, threads=1)
    assert_bits_equal(one, wv.render(scene, pattern, poses, outputs=ALL, threads=2))
    assert_bits_equal(one, wv.render(scene, pickle.loads(pickle.dumps(pattern)), poses, outputs=ALL, threads=3))
    for view in range(5):
        alone = wv.render(scene, pattern, poses[view : view + 1], outputs=ALL)
        for name in ALL:
            np.testing.assert_array_equal(getattr(alone, name).numpy()[0], getattr(one, name).numpy()[view])
    depth = wv.render(scene, pattern, poses, outputs="depth")  # uses a separate code path
    np.testing.assert_array_equal(depth.depth.numpy(), one.depth.numpy())


def test_depth_along_z_and_common_origin(packets_only):
    """Depth along z; rays with one common origin equal those of a sensor at that origin."""
    scene, pose = wv.scenes.PRESETS["room"].build("cpu"), wv.look_at((0.1, 0.2, 0.9), (0.5, 0.4, 0.3))
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, 48), np.linspace(-0.6, 0.6, 32))
    directions = np.stack([x, y, np.ones_like(x)], axis=-1)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    origins = np.random.default_rng(0).uniform(-0.02, 0.02, directions.shape)
    ranges = wv.render(scene, Rays(directions, origins), pose).depth.numpy()
    along = wv.render(scene, Rays(directions, origins, kind="z"), pose).depth.numpy()
    np.testing.assert_allclose(along, ranges * directions[..., 2], rtol=1e-6)
    shift = np.array([0.02, -0.01, 0.03])
    beside = wv.render(scene, Rays(directions, np.broadcast_to(shift, directions.shape)), pose).depth.numpy()
    there = np.asarray(pose, dtype=np.float64).copy()
    there[:3] += wv.core.poses.poses_to_matrices(pose)[:3, :3] @ shift
    plain = wv.render(scene, Rays(directions), there).depth.numpy()
    np.testing.assert_allclose(np.nan_to_num(beside, posinf=9), np.nan_to_num(plain, posinf=9), atol=1e-5)


def test_wide_lidars_are_cast_in_packets(packets_only):
    """The lasers of an HDL-64E start 0.14 m apart, but those of a packet start close to each other."""
    scene, lidar = wv.scenes.PRESETS["room"].build("cpu"), wv.sensors.lidars.hdl64e()
    assert np.ptp(lidar.origins.reshape(-1, 3), axis=0).max() > rays.MAX_ORIGIN_EXTENT
    part = np.s_[::4, ::50]
    few = Rays(lidar.directions[part], lidar.origins[part], near=lidar.near, far=lidar.far, axes=lidar.axes)
    poses = np.array([[0.1, 0.2, 1.1, 0, 0, 0, 1.0]])
    views = wv.render(scene, lidar, poses, outputs=ALL)
    some = wv.Views(**{name: wp.array(getattr(views, name).numpy()[:, *part]) for name in ALL})
    assert_matches_reference(some, scene, poses, few)


def test_movable_solids_are_cast_beside_packets(monkeypatch):
    """Packets mark the rays that may hit a solid; no view is cast ray by ray as a whole."""
    for caster in (rays.RayBundleCaster, MovingCaster):
        name = "cast" if caster is rays.RayBundleCaster else "_cast_single_rays"
        monkeypatch.setattr(caster, name, lambda *_: pytest.fail("cast ray by ray"))
    rng = np.random.default_rng(0)
    scene = build_solids("cpu", random_poses(rng, 10, spread=2.0), extra=[trimesh.creation.box((0.5, 0.3, 0.7))] * 2)
    pattern = Rays(*spread_out(1500, 0.01), near=0.2, far=4.0)
    poses = np.array([wv.look_at(place, (0, 0, 0.6)) for place in ((2.2, 0.3, 1.0), (-1.5, 1.2, 0.8))])
    views = wv.render(scene, pattern, poses, outputs=ALL)
    assert_matches_reference(views, scene, poses, pattern)
    assert len(np.unique(views.segmentation.numpy())) > 6


@pytest.mark.parametrize("reason", ["far apart", "clip", "sizes"])
def test_unsupported_inputs_are_cast_as_single_rays(reason):
    poses = random_poses(np.random.default_rng(3), 2, spread=0.3)
    scene = wv.scenes.PRESETS["room"].build("cpu")
    options, spread = {"outputs": ALL}, 0.5 if reason == "far apart" else 0.03
    if reason == "clip":
        options["near_plane"] = "clip"
    if reason == "sizes":
        scene = build_scaled("cpu", random_poses(np.random.default_rng(1), 3, spread=2.0), shapes=SHAPES[4:])
        options["object_scales"] = random_scales(np.random.default_rng(2), 2, 3)
    pattern = Rays(*spread_out(600, spread), near=0.5)
    one, other = (wv.render(scene, pattern, poses, caster=caster, **options) for caster in ("auto", "rays"))
    assert_bits_equal(one, other)
