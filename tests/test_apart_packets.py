# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rays that begin close beside each other, in packets: in closed form, by the float64 reference, by single rays."""

import pickle

import numpy as np
import pytest
import trimesh
from test_ray_patterns import assert_matches_reference, few_origins, sphere_of_rays
from test_solids import build as build_solids
from test_worlds import ALL, assert_bits_equal, random_poses

import warpvis as wv
from warpvis.rendering import casters
from warpvis.sensors import Rays

STRAIGHT = [0, 0, 0, 0, 0, 0, 1.0]


@pytest.fixture
def packets_only(monkeypatch):
    """No ray is cast alone but where a test asks for it."""

    def refuse(*_):
        raise AssertionError("cast ray by ray")

    monkeypatch.setattr(casters.RayTableCaster, "cast", refuse)


def outlets(height, width, radius=0.03, tall=0.5):
    """A lidar's rays, from origins as an Ouster's: through an outlet that turns, less that far along each ray."""
    turned, up = np.meshgrid(np.linspace(-np.pi, np.pi, width, endpoint=False), np.linspace(tall, -tall, height))
    looks = turned + np.radians(np.resize([3.2, 1.1, -1.1, -3.2], height))[:, None]
    directions = np.stack([np.cos(up) * np.cos(looks), np.cos(up) * np.sin(looks), np.sin(up)], axis=-1)
    outlet = radius * np.stack([np.cos(turned), np.sin(turned), np.ones_like(turned)], axis=-1)
    return directions, outlet - radius * directions


def spread_out(count, spread=0.03, seed=2):
    """Rays all around, from an origin each."""
    return sphere_of_rays(count), np.random.default_rng(seed).uniform(-spread, spread, (count, 3))


def soup(count, near, far, seed):
    """Triangles of all sizes around the origin, from so near on."""
    rng = np.random.default_rng(seed)
    middles = rng.normal(size=(count, 1, 3))
    away = np.exp(rng.uniform(np.log(near), np.log(far), (count, 1, 1)))
    middles *= away / np.linalg.norm(middles, axis=-1, keepdims=True)
    corners = middles + away * rng.uniform(0.02, 1.0, (count, 1, 1)) * rng.normal(size=(count, 3, 3))
    return trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), process=False)


@pytest.mark.parametrize("size", [0.05, 1.0, 40.0])
def test_inside_a_box(size, packets_only):
    """In closed form, from as near its walls as origins are from each other on, at a place far from the world's."""
    scene, away, half = wv.Scene(device="cpu"), np.array([50.0, -30.0, 20.0]), size * np.array([1.0, 1.5, 2.0])
    scene.add(trimesh.creation.box(2 * half), name="box", pose=(*away, 0, 0, 0, 1))
    for directions, origins in (outlets(40, 200), spread_out(3000)):
        views = wv.render(scene, Rays(directions, origins), [*away, 0, 0, 0, 1], outputs=ALL)
        lengths = np.where(directions > 0, half - origins, -half - origins) / directions
        # Corners of the box are single precision.
        error = np.abs(views.depth.numpy()[0] - lengths.min(axis=-1))
        assert error.max() <= 1e-5 * max(1, size) + 4e-6
        points = origins + lengths.min(axis=-1)[..., None] * directions
        np.testing.assert_allclose(views.points.numpy()[0] - away, points, atol=2e-5 * max(1, size))
        wall = lengths.argmin(axis=-1)
        normals = np.where(np.arange(3) == wall[..., None], -np.sign(directions), 0)
        apart = np.sort(lengths, axis=-1)
        sure = apart[..., 1] - apart[..., 0] > 1e-4
        np.testing.assert_allclose(views.normals.numpy()[0][sure], normals[sure], atol=1e-6)


def test_a_sphere(packets_only):
    """From inside and from outside, within the sagitta of its triangles."""
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
def test_triangles_as_near_as_origins_match_the_reference(near, cull_backfaces, packets_only):
    """Some lie between the origins, some are seen edge-on, and each side of some by other rays."""
    scene = wv.Scene(device="cpu")
    scene.add(soup(150, near, 20 * near, seed=3), name="soup")
    scene.add(soup(60, near, 3.0, seed=4), name="more")
    poses = random_poses(np.random.default_rng(5), 2, spread=0.01)
    poses[:, 2] -= 0.6  # in the middle of the triangles
    pattern = Rays(sphere_of_rays(1500), few_origins(1500, 0.04), near=near + 0.02, far=15 * near + 0.3)
    views = wv.render(scene, pattern, poses, outputs=ALL, cull_backfaces=cull_backfaces)
    assert np.isneginf(views.depth.numpy()).any() and np.isfinite(views.depth.numpy()).any()
    assert_matches_reference(views, scene, poses, pattern, cull_backfaces=cull_backfaces)


def test_rays_begin_on_either_side_of_a_plate(packets_only):
    scene = wv.Scene(device="cpu")
    scene.add(trimesh.Trimesh([[0.01, -9, -9], [0.01, 9, -9], [0.01, 0, 9]], [[0, 1, 2]]), name="plate")
    directions, origins = np.tile([1.0, 0, 0], (64, 1)), np.zeros((64, 3))
    origins[:, 0] = np.linspace(-0.03, 0.031, 64)  # none in it
    views = wv.render(scene, Rays(directions, origins), STRAIGHT, outputs=ALL)
    expected = np.where(origins[:, 0] < 0.01, 0.01 - origins[:, 0], np.inf)
    np.testing.assert_allclose(views.depth.numpy()[0], expected, rtol=0, atol=1e-7)
    seen = np.isfinite(expected)
    np.testing.assert_array_equal(views.normals.numpy()[0][seen], np.tile([-1, 0, 0], (seen.sum(), 1)))


def test_the_room_matches_the_reference(packets_only):
    scene = wv.scenes.PRESETS["room"].build("cpu")
    poses = np.array([wv.look_at(eye, (0.5, 0.4, 0.3)) for eye in ((0.1, 0.2, 0.9), (-0.8, 1.2, 1.5))])
    for shape in ((1500,), (30, 50)):
        pattern = Rays(sphere_of_rays(1500).reshape(*shape, 3), few_origins(1500).reshape(*shape, 3), near=0.4, far=2.0)
        views = wv.render(scene, pattern, poses, outputs=ALL)
        if len(shape) == 2:
            assert_matches_reference(views, scene, poses, pattern)
        assert np.isposinf(views.depth.numpy()).any()


@pytest.mark.parametrize("name", ["room", "blobs_77k"])
def test_a_turn_of_an_ouster_is_that_of_single_rays(name):
    scene, poses = (
        wv.scenes.PRESETS[name].build("cpu"),
        np.array([[0.4, 0.3, 0.8, 0, 0, 0, 1], [-1, 1, 0.4, 0, 0, 1, 0]]),
    )
    for kind in ("OS0-128", "OS1-64"):
        lidar = wv.sensors.lidars.ouster(kind, near=0.5, far=6.0)
        one, other = (wv.render(scene, lidar, poses, outputs=ALL, caster=caster) for caster in ("auto", "rays"))
        depth, expected = one.depth.numpy(), other.depth.numpy()
        with np.errstate(invalid="ignore"):
            same = (depth == expected) | (np.abs(depth - expected) <= 1e-5 * np.maximum(1, expected))
        assert same.mean() >= 0.9999
        for image in ("segmentation", "labels"):
            alike = getattr(one, image).numpy() == getattr(other, image).numpy()
            assert alike.mean() >= 0.9999
        hit = same & np.isfinite(depth)
        assert hit.mean() > 0.01
        np.testing.assert_allclose(one.points.numpy()[hit], other.points.numpy()[hit], atol=1e-4)
        turned = np.abs(one.normals.numpy()[hit] - other.normals.numpy()[hit]).max(axis=-1) > 1e-4
        assert turned.mean() <= 1e-3


def test_nothing_leaks(packets_only):
    """Between triangles of a closed mesh no ray finds a way, at corners and edges neither."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.7)
    scene = wv.Scene(device="cpu")
    scene.add(ball, name="ball")
    middles = ball.vertices[ball.edges_unique].mean(axis=1)
    targets = np.concatenate([ball.vertices, middles, ball.triangles_center]).astype(np.float32).astype(np.float64)
    for spread in (0.001, 0.04):
        origins = np.random.default_rng(1).uniform(-spread, spread, targets.shape)
        directions = targets - origins
        lengths = np.linalg.norm(directions, axis=-1)
        depth = wv.render(scene, Rays(directions / lengths[:, None], origins), STRAIGHT).depth.numpy()[0]
        np.testing.assert_allclose(depth, lengths, atol=2e-6)


def test_worlds_and_exclude_are_those_of_single_rays():
    meshes = [trimesh.creation.icosphere(subdivisions=2, radius=0.3), soup(40, 0.05, 0.4, seed=1)]
    scene = wv.Scene(device="cpu")
    places = random_poses(np.random.default_rng(2), 12)
    for number in range(6):
        scene.add(meshes[number % 2], name=f"item_{number}", movable=True)
    for number in range(6, 12):
        scene.add(meshes[number % 2], name=f"item_{number}", pose=places[number])
    rows = np.stack([random_poses(np.random.default_rng(seed), 6, spread=1.2) for seed in (0, 1)])
    pattern, poses = Rays(*outlets(48, 160)), random_poses(np.random.default_rng(3), 3, spread=0.4)
    options = {"object_poses": rows, "world_index": [1, 0, 1], "exclude": ["item_1", "item_7"], "outputs": ALL}
    one, other = (wv.render(scene, pattern, poses, caster=caster, **options) for caster in ("auto", "rays"))
    assert len(np.unique(other.segmentation.numpy())) > 5
    assert (one.segmentation.numpy() == other.segmentation.numpy()).mean() >= 0.9999
    depth, expected = one.depth.numpy(), other.depth.numpy()
    with np.errstate(invalid="ignore"):
        same = (depth == expected) | (np.abs(depth - expected) <= 1e-5 * np.maximum(1, expected))
    assert same.mean() >= 0.9999


def test_splits_and_threads_give_the_same_bits(packets_only):
    scene, poses = wv.scenes.PRESETS["room"].build("cpu"), wv.scenes.PRESETS["room"].poses(5)
    pattern = Rays(*outlets(64, 256))
    one = wv.render(scene, pattern, poses, outputs=ALL, threads=1)
    assert_bits_equal(one, wv.render(scene, pattern, poses, outputs=ALL, threads=2))
    assert_bits_equal(one, wv.render(scene, pickle.loads(pickle.dumps(pattern)), poses, outputs=ALL, threads=3))
    for view in range(5):
        alone = wv.render(scene, pattern, poses[view : view + 1], outputs=ALL)
        for name in ALL:
            np.testing.assert_array_equal(getattr(alone, name).numpy()[0], getattr(one, name).numpy()[view])
    depth = wv.render(scene, pattern, poses, outputs="depth")  # by code of its own
    np.testing.assert_array_equal(depth.depth.numpy(), one.depth.numpy())


def test_along_an_axis_and_one_origin(packets_only):
    """Depth along z; and where all begin at one place beside the sensor's, it is that of a sensor there."""
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


@pytest.mark.parametrize("reason", ["far apart", "solids", "clip"])
def test_what_packets_do_not_take_goes_ray_by_ray(reason):
    poses = random_poses(np.random.default_rng(3), 2, spread=0.3)
    scene = wv.scenes.PRESETS["room"].build("cpu")
    options, spread = {"outputs": ALL}, 0.5 if reason == "far apart" else 0.03
    if reason == "solids":
        scene = build_solids("cpu", random_poses(np.random.default_rng(0), 10, spread=2.0))
    if reason == "clip":
        options["near_plane"] = "clip"
    pattern = Rays(*spread_out(600, spread), near=0.5)
    one, other = (wv.render(scene, pattern, poses, caster=caster, **options) for caster in ("auto", "rays"))
    assert_bits_equal(one, other)
