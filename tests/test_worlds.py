# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of movable objects, worlds and exclusion: renders match static scenes built that way."""

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.rendering.casters.base import ViewBatch
from warpvis.scene import worlds as scene_worlds
from warpvis.scene.worlds import parse_worlds

from compare import assert_matches_reference, wrong_depth
from support.worlds import (
    ALL,
    MESHES,
    SMALL,
    STILL,
    assert_bits_equal,
    assert_views_match_twins,
    build,
    eyes,
    far_away,
    random_poses,
    view_of,
)


@pytest.mark.smoke("*packets*")
def test_unmoved_scene_equals_static_scene(device, caster):
    rows = random_poses(np.random.default_rng(0), 5)
    still, movable = (build(device, rows, movable=movable) for movable in (False, True))
    assert movable.movable == (1, 2, 4, 5, 6)
    one, other = (wv.render(scene, SMALL, eyes(3), outputs=ALL, caster=caster) for scene in (still, movable))
    assert wrong_depth(one.depth.numpy(), other.depth.numpy().astype(np.float64)).mean() <= 1e-4
    assert (one.segmentation.numpy() != other.segmentation.numpy()).mean() <= 1e-4
    assert len(np.unique(one.segmentation.numpy())) >= 7
    assert_matches_reference(other, still, SMALL, eyes(3))


@pytest.mark.smoke("*-packets-True-True", "*-rays-False-False")
@pytest.mark.parametrize("cull_backfaces", [False, True])
@pytest.mark.parametrize("static", [True, False])
def test_moved_objects_match_scene_built_there(static, cull_backfaces, device, caster):
    rows, world = random_poses(np.random.default_rng(1), 3, 5), np.array([2, 0, 1, 1, 2])
    scene = build(device, np.tile(STILL, (5, 1)), movable=True, static=static)
    renderer = wv.Renderer(scene, SMALL, outputs=ALL, caster=caster, cull_backfaces=cull_backfaces)
    views = renderer.render(eyes(5), object_poses=rows, world_index=world)
    twins = [build("cpu", rows[index], movable=False, static=static) for index in world]
    assert_views_match_twins(views, SMALL, eyes(5), twins, cull_backfaces=cull_backfaces)


@pytest.mark.parametrize("outputs", [("depth",), ("depth", "segmentation"), ("normals", "labels"), ("points",)])
def test_outputs_are_independent_of_each_other(outputs, device, caster):
    rows = random_poses(np.random.default_rng(2), 2, 5)
    scene = build(device, rows[0], movable=True)
    whole = wv.render(scene, SMALL, eyes(2), outputs=ALL, object_poses=rows, caster=caster)
    part = wv.render(scene, SMALL, eyes(2), outputs=outputs, object_poses=rows, caster=caster)
    for name in outputs:
        np.testing.assert_array_equal(getattr(part, name).numpy(), getattr(whole, name).numpy())


def test_moving_rebuilds_nothing(device, caster):
    rows = random_poses(np.random.default_rng(3), 2, 5)
    scene = build(device, rows[0], movable=True)
    renderer = wv.Renderer(scene, SMALL, caster=caster)
    first = renderer.render(eyes(1), object_poses=rows[:1])
    clusters, triangles = scene._trees._bvh, scene._trees._triangles
    moved = renderer.render(eyes(1), object_poses=rows[1:])
    assert scene._trees._bvh is clusters and scene._trees._triangles is triangles
    assert (first.depth.numpy() != moved.depth.numpy()).mean() > 0.1
    again = renderer.render(eyes(1), object_poses=rows[:1])
    assert_bits_equal(first, again)


@pytest.mark.smoke("*packets*")
def test_instances_share_one_tree(device, caster):
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.12)
    rows = random_poses(np.random.default_rng(4), 2, 40)
    scene = build(device, rows[0], movable=True, static=False, meshes=[ball] * 40)
    alone = build(device, rows[0, :1], movable=True, static=False, meshes=[ball])
    assert scene.bvh().struct.leaves.size == alone.bvh().struct.leaves.size
    assert len(scene.triangles().meshes) == 1
    views = wv.render(scene, SMALL, eyes(2), outputs=ALL, object_poses=rows, caster=caster)
    twins = [build("cpu", row, movable=False, static=False, meshes=[ball] * 40) for row in rows]
    assert_views_match_twins(views, SMALL, eyes(2), twins)
    assert len(np.unique(views.segmentation.numpy())) > 30


def test_coincident_instances_show_the_first(device, caster):
    scene = build(device, np.tile(STILL, (3, 1)), movable=True, static=False, meshes=[MESHES[1]] * 3)
    for outputs in (ALL, ("depth", "segmentation")):
        views = wv.render(scene, SMALL, eyes(1), outputs=outputs, caster=caster)
        assert set(np.unique(views.segmentation.numpy())) == {-1, 0}


def test_world_index_and_single_worlds(device, caster):
    """One world for all views, one per view, or by `world_index`; poses of one world need no leading axis."""
    rows = random_poses(np.random.default_rng(5), 3, 5)
    scene = build(device, rows[0], movable=True)
    renderer = wv.Renderer(scene, SMALL, outputs=ALL, caster=caster)
    each = renderer.render(eyes(3), object_poses=rows)
    for index in range(3):
        alone = renderer.render(eyes(3)[index], object_poses=rows[index])
        assert_bits_equal(view_of(each, index), alone)
    assert_bits_equal(renderer.render(eyes(3), object_poses=rows, world_index=[0, 1, 2]), each)
    turned = renderer.render(eyes(3), object_poses=rows[::-1], world_index=np.array([2, 1, 0], dtype=np.int64))
    assert_bits_equal(turned, each)
    default = renderer.render(eyes(3))
    assert_bits_equal(renderer.render(eyes(3), object_poses=rows[0]), default)
    assert_bits_equal(renderer.render(eyes(3), object_poses=rows, world_index=[0, 0, 0]), default)
    transforms = wp.array(rows, dtype=wp.transform, shape=(3, 5), device=device)
    numbers = wp.array([0, 1, 2], dtype=wp.int32, device=device)
    assert_bits_equal(renderer.render(eyes(3), object_poses=transforms, world_index=numbers), each)


def test_quaternions_need_not_be_exact(device, caster):
    rows = random_poses(np.random.default_rng(6), 5)
    scene = build(device, rows, movable=True)
    longer = rows * np.array([1, 1, 1, 1.0009, 1.0009, 1.0009, 1.0009], dtype=np.float32)
    one, other = (wv.render(scene, SMALL, eyes(1), object_poses=p, caster=caster) for p in (rows, longer))
    assert wrong_depth(one.depth.numpy(), other.depth.numpy().astype(np.float64)).mean() <= 1e-4


def test_invalid_world_index_on_device_is_empty(device, caster):
    """On a GPU, indices are not validated."""
    rows = random_poses(np.random.default_rng(7), 2, 5)
    scene = build(device, rows[0], movable=True)
    renderer = wv.Renderer(scene, SMALL, outputs=ALL, caster=caster)
    worlds = parse_worlds(scene, 4, rows, np.zeros(4, dtype=np.int32), None)
    worlds.world = wp.array([1, 2, -1, 0], dtype=wp.int32, device=device)
    views = renderer.render(eyes(4), object_poses=rows, world_index=[1, 0, 0, 0])
    poses = renderer._caster.parse_poses(eyes(4), "opencv")
    renderer._caster.cast(ViewBatch(poses, worlds), renderer._images_of(views))
    assert (views.segmentation.numpy()[1:3] == -1).all()
    assert np.isposinf(views.depth.numpy()[1:3]).all()
    assert_bits_equal(view_of(views, 0), renderer.render(eyes(4)[0], object_poses=rows[1]))
    assert_bits_equal(view_of(views, 3), renderer.render(eyes(4)[3], object_poses=rows[0]))


@pytest.mark.smoke("*packets*")
def test_excluded_objects_are_not_rendered(device, caster):
    """By name or index, movable and static objects; equal to a scene where these are far away."""
    rows = random_poses(np.random.default_rng(8), 5)
    scene = build(device, rows, movable=True)
    renderer = wv.Renderer(scene, SMALL, outputs=ALL, caster=caster)
    views = renderer.render(eyes(3), exclude=["moved_1", "moved_3"])
    twin = build("cpu", far_away(rows, 1, 3), movable=False)
    assert_matches_reference(views, twin, SMALL, eyes(3))
    both = renderer.render(eyes(3), exclude=["floor", scene.index("moved_0"), np.int64(scene.index("wall"))])
    assert not np.isin(both.segmentation.numpy(), [0, 1, 3]).any()
    bare = build("cpu", far_away(rows, 0), movable=False, static=False)
    shifted = np.array([-1, 0, 0, 1, 0, 2, 3, 4])[both.segmentation.numpy() + 1]
    assert_matches_reference(wv.Views(depth=both.depth, points=both.points, normals=both.normals), bare, SMALL, eyes(3))
    expected = wv.render(bare, SMALL, eyes(3), outputs=("segmentation",), caster="rays").segmentation.numpy()
    assert (shifted != expected).mean() <= 1e-4


@pytest.mark.smoke("*packets*")
def test_exclude_in_a_static_scene(device, caster):
    rows = random_poses(np.random.default_rng(9), 5)
    scene = build(device, rows, movable=False)
    views = wv.render(scene, SMALL, eyes(3), outputs=ALL, exclude=["moved_0", "moved_1"], caster=caster)
    assert_matches_reference(views, build("cpu", far_away(rows, 0, 1), movable=False), SMALL, eyes(3))
    assert_bits_equal(
        wv.render(scene, SMALL, eyes(3), outputs=ALL, exclude=[], caster=caster),
        wv.render(scene, SMALL, eyes(3), outputs=ALL, caster=caster),
    )
    assert_bits_equal(
        wv.render(scene, SMALL, eyes(3), outputs=ALL, exclude="wall", caster=caster),
        wv.render(scene, SMALL, eyes(3), outputs=ALL, exclude=[scene.index("wall")], caster=caster),
    )


def boxes_on_a_floor(device, places):
    """Return boxes whose bottom faces coincide with the floor's top face."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((6, 6, 0.1)), name="floor", label="ground", pose=(0, 0, -0.05, 0, 0, 0, 1))
    for i, (x, y) in enumerate(places):
        scene.add(trimesh.creation.box((0.5, 0.5, 0.5)), name=f"box_{i}", pose=(x, y, 0.25, 0, 0, 0, 1))
    return scene


def test_surfaces_below_excluded_objects_are_rendered(device, caster):
    """Surfaces that coincide with excluded ones, in images and with `render_at`."""
    eight = np.concatenate([eyes(4), eyes(4, radius=1.3, height=2.0)])
    scene = boxes_on_a_floor(device, [(0, 0), (0.9, 0.1), (-0.4, 0.8)])
    renderer = wv.Renderer(scene, SMALL, outputs=("depth", "segmentation"), caster=caster)
    expected = wv.render(boxes_on_a_floor("cpu", [(0.9, 0.1)]), SMALL, eight, outputs=("depth",), caster="packets")
    y, x = np.mgrid[: SMALL.height, : SMALL.width] + 0.5
    centers = np.tile(np.stack([x, y], axis=-1).reshape(1, -1, 2), (8, 1, 1)).astype(np.float32)
    for views in (
        renderer.render(eight, exclude=["box_0", "box_2"]),
        renderer.render_at(eight, centers, exclude=["box_0", "box_2"]),
    ):
        depth = views.depth.numpy().reshape(expected.depth.shape)
        np.testing.assert_allclose(depth, expected.depth.numpy(), rtol=2e-6)
        assert set(np.unique(views.segmentation.numpy())) == {-1, 0, 2}


def test_surfaces_behind_culled_faces_are_rendered(device, caster):
    """From inside a box, through its back faces."""
    pose = np.array([wv.look_at((0.1, 0.05, 0.3), (0.3, 0, -0.3))], dtype=np.float32)
    options = {"outputs": ("depth", "segmentation"), "caster": caster, "cull_backfaces": True}
    views = wv.render(boxes_on_a_floor(device, [(0, 0)]), SMALL, pose, **options)
    expected = wv.render(boxes_on_a_floor("cpu", []), SMALL, pose, outputs=("depth",), caster="packets")
    np.testing.assert_allclose(views.depth.numpy(), expected.depth.numpy(), rtol=2e-6)
    assert (views.segmentation.numpy() <= 0).all()


@pytest.mark.parametrize("movable", [False, True])
def test_camera_inside_an_excluded_body(movable, device, caster):
    """Rays pass through the closed body around the camera, and hit other objects from outside."""
    rows = np.array([(2.0, 0, 1.0, 0, 0, 0, 1), (0, 0, 0.5, 0, 0, 0, 1)])
    meshes = [trimesh.creation.box((1, 1, 1)), MESHES[1]]
    scene = build(device, rows, movable=movable, meshes=meshes)
    pose = wv.look_at((2.1, 0, 1.1), (0, 0, 0.5))[None].astype(np.float32)
    inside = wv.render(scene, SMALL, pose, outputs=ALL, caster=caster)
    assert (inside.segmentation.numpy() == scene.index("moved_0")).all()
    assert_matches_reference(inside, build("cpu", rows, movable=False, meshes=meshes), SMALL, pose)
    outside = wv.render(scene, SMALL, pose, outputs=ALL, exclude=["moved_0"], caster=caster)
    assert_matches_reference(outside, build("cpu", far_away(rows, 0), movable=False, meshes=meshes), SMALL, pose)


def test_views_are_independent_of_other_worlds(device, caster):
    """Each of many views, with a separate world and exclusions, equals its own rendering."""
    rng = np.random.default_rng(10)
    rows, world = random_poses(rng, 4, 5), rng.integers(0, 4, 9)
    scene = build(device, rows[0], movable=True)
    flags = rng.uniform(size=(9, len(scene))) < 0.4
    renderer = wv.Renderer(scene, SMALL, outputs=ALL, caster=caster)
    views = renderer.render(eyes(9), object_poses=rows, world_index=world, exclude=flags)
    for index, pose in enumerate(eyes(9)):
        alone = renderer.render(pose, object_poses=rows[world[index]], exclude=np.flatnonzero(flags[index]).tolist())
        assert_bits_equal(view_of(views, index), alone)
        assert not np.isin(views.segmentation.numpy()[index], np.flatnonzero(flags[index])).any()


def test_render_at_with_worlds_and_exclude(device, caster):
    rows = random_poses(np.random.default_rng(11), 2, 5)
    scene = build(device, rows[0], movable=True)
    renderer = wv.Renderer(scene, SMALL, outputs=ALL, caster=caster)
    y, x = np.mgrid[: SMALL.height, : SMALL.width] + 0.5
    pixels = np.tile(np.stack([x, y], axis=-1).reshape(1, -1, 2), (2, 1, 1)).astype(np.float32)
    flags = np.zeros((2, len(scene)), dtype=bool)
    flags[0, [1, 3]], flags[1, 0] = True, True
    arguments = {"object_poses": rows, "world_index": [1, 0], "exclude": flags}
    image = renderer.render(eyes(2), **arguments)
    points = renderer.render_at(eyes(2), pixels, **arguments)
    assert wrong_depth(points.depth.numpy(), image.depth.numpy().reshape(2, -1).astype(np.float64)).mean() <= 2e-4
    same = points.segmentation.numpy() == image.segmentation.numpy().reshape(2, -1)
    assert same.mean() >= 1 - 2e-4
    seen = same & (points.segmentation.numpy() >= 0)
    apart = np.abs(points.normals.numpy() - image.normals.numpy().reshape(2, -1, 3))[seen].max(axis=-1) > 1e-4
    assert apart.mean() <= 1e-2
    np.testing.assert_allclose(points.points.numpy()[seen], image.points.numpy().reshape(2, -1, 3)[seen], atol=1e-4)


@pytest.mark.smoke("*packets*", "*-rays-outputs1-3")
@pytest.mark.parametrize("views", [1, 3])
@pytest.mark.parametrize("outputs", [ALL, ("depth", "points", "labels", "segmentation"), ("depth",)])
def test_results_are_bit_identical_for_any_thread_count(outputs, views, device, caster):
    rng = np.random.default_rng(12)
    rows = random_poses(rng, views, 60)
    scene = build(device, rows[0], movable=True, meshes=[MESHES[i % 5] for i in range(60)])
    camera = wv.Camera.from_fov(123, 90, hfov=1.2)
    flags = rng.uniform(size=(views, len(scene))) < 0.1
    first = None
    for threads in (1, 1, 2, 7):
        renderer = wv.Renderer(scene, camera, outputs=outputs, threads=threads, caster=caster)
        again = renderer.render(eyes(views), object_poses=rows, exclude=flags)
        first = again if first is None else first
        assert_bits_equal(again, first)
        assert_bits_equal(renderer.render(eyes(views), object_poses=rows, exclude=flags), first)


@pytest.mark.smoke("*packets*")
def test_camera_plane_crosses_objects(device, caster):
    """The camera is inside closed objects, and in front of, next to and behind others."""
    rng = np.random.default_rng(13)
    meshes = [trimesh.creation.box((3, 2, 1)), *MESHES, trimesh.creation.icosphere(subdivisions=2, radius=4.0)]
    rows = random_poses(rng, 6, 7, spread=0.8)
    scene = build(device, rows[0], movable=True, meshes=meshes, static=False)
    camera = wv.Camera.from_fov(80, 60, hfov=1.8)
    poses = np.array([wv.look_at((0, 0, 0.6), rng.normal(size=3)) for _ in range(6)]).astype(np.float32)
    twins = [build("cpu", row, movable=False, meshes=meshes, static=False) for row in rows]
    for culling in ({}, {"cull_backfaces": True}):
        renderer = wv.Renderer(scene, camera, outputs=ALL, caster=caster, **culling)
        views = renderer.render(poses, object_poses=rows)
        assert_views_match_twins(views, camera, poses, twins, **culling)
        assert culling or np.isfinite(views.depth.numpy()).all()


def test_objects_behind_the_camera_or_out_of_range(device, caster):
    scene = build(device, np.tile(STILL, (3, 1)), movable=True, static=False, meshes=[MESHES[0]] * 3)
    camera = wv.Camera.from_fov(64, 48, hfov=0.9, near=0.5, far=10.0)
    rows = np.array([(-1, 0, 0, 0, 0, 0, 1), (11, 0, 0, 0, 0, 0, 1), (3, 6, 0, 0, 0, 0, 1)])
    pose = wv.look_at((0, 0, 0), (1, 0, 0))
    views = wv.render(scene, camera, pose, outputs=ALL, object_poses=rows, caster=caster)
    assert np.isposinf(views.depth.numpy()).all()
    near = rows.copy()
    near[0, 0] = 0.6  # its face is nearer than near, and hides the one behind it
    near[1, 0] = 5.0
    depth = wv.render(scene, camera, pose, object_poses=near, caster=caster).depth.numpy()
    assert np.isneginf(depth[0, 24, 32])
    assert not np.isfinite(depth).any()


def test_depth_is_exact_far_from_the_origin(device, caster):
    """Camera and objects 8 km away, by powers of two: not a bit of depth changes."""
    rng = np.random.default_rng(14)
    rows, poses = random_poses(rng, 5), eyes(2)
    rows[:, :3], poses[:, :3] = np.round(rows[:, :3] * 64) / 64, np.round(poses[:, :3] * 64) / 64
    scene = build(device, rows, movable=True, static=False)
    renderer = wv.Renderer(scene, SMALL, outputs=("depth", "normals", "segmentation"), caster=caster)
    here = renderer.render(poses, object_poses=rows)
    offset = np.array([8192, -8192, 4096, 0, 0, 0, 0])
    assert_bits_equal(renderer.render(poses + offset, object_poses=rows + offset), here)
    assert np.isfinite(here.depth.numpy()).any()


@pytest.mark.parametrize("offset", [100.0, 1e4])
def test_mesh_far_from_its_own_origin(offset, device):
    """Vertices in site coordinates, which the object's pose moves back in front of the camera."""
    turn = np.array([0.1, 0.2, 0.3, 0.9]) / np.linalg.norm([0.1, 0.2, 0.3, 0.9])
    ball = trimesh.creation.icosphere(subdivisions=3)
    ball.vertices += offset * np.array([1, -0.7, 0.4])
    vertices = ball.vertices.astype(np.float32).astype(np.float64)
    matrix = poses_to_matrices(np.concatenate([np.zeros(3), turn]))[:3, :3]
    row = np.concatenate([-matrix @ vertices.mean(axis=0), turn]).astype(np.float32)
    scene, twin = wv.Scene(device=device), wv.Scene()
    scene.add((vertices, ball.faces), movable=True)
    twin.add((vertices, ball.faces), pose=row.astype(np.float64))
    poses = wv.look_at((2, 1, 0.5), (0, 0, 0))[None].astype(np.float32)
    views = wv.render(scene, SMALL, poses, outputs=ALL, object_poses=row[None])
    assert_matches_reference(views, twin, SMALL, poses)


@pytest.mark.smoke("*packets*")
def test_thousand_objects(device, caster):
    rng = np.random.default_rng(15)
    meshes = [trimesh.creation.box((0.1, 0.2, 0.15)), trimesh.creation.icosphere(subdivisions=1, radius=0.1)] * 500
    rows = random_poses(rng, 2, 1000, spread=6.0)
    scene = build(device, rows[0], movable=True, meshes=meshes)
    outputs = ("depth", "labels", "segmentation")
    views = wv.render(scene, SMALL, eyes(2), outputs=outputs, object_poses=rows, caster=caster)
    assert len(np.unique(views.segmentation.numpy())) > 50
    for index, row in enumerate(rows):
        twin = build(device, row, movable=False, meshes=meshes)
        expected = wv.render(twin, SMALL, eyes(2)[index], outputs=outputs, caster="rays")
        wrong = wrong_depth(views.depth.numpy()[index], expected.depth.numpy()[0].astype(np.float64))
        assert wrong.mean() <= 2e-3  # at silhouettes: vertices of the twin are rounded differently
        assert (views.segmentation.numpy()[index] != expected.segmentation.numpy()[0]).mean() <= 2e-3


def test_added_objects_are_rendered(device, caster):
    scene = build(device, np.tile(STILL, (1, 1)), movable=True, meshes=MESHES[:1])
    renderer = wv.Renderer(scene, SMALL, caster=caster)
    renderer.render(eyes(1))
    index = scene.add(MESHES[1], name="later", movable=True)
    rows = np.array([STILL, (0.6, 0.3, 1.0, 0, 0, 0, 1)])
    assert (renderer.render(eyes(1), object_poses=rows).segmentation.numpy() == index).any()


def test_zero_dimensional_exclude_raises():
    scene = build("cpu", random_poses(np.random.default_rng(0), len(MESHES)), movable=False)
    with pytest.raises(wv.WarpvisError, match="exclude must be"):
        wv.render(scene, SMALL, STILL, exclude=np.array("floor"))


@pytest.mark.parametrize("worlds", [1, 2])
def test_device_rows_of_one_or_several_worlds(worlds, monkeypatch):
    """Floats on a GPU are accepted as rows, as on the host; arrays on the CPU stand for those on a GPU."""
    monkeypatch.setattr(scene_worlds, "on_gpu", lambda value: isinstance(value, wp.array))
    scene = wv.Scene()
    for _ in range(5):
        scene.add(trimesh.creation.box(), movable=True)
    rows = random_poses(np.random.default_rng(0), worlds, 5)
    given = wp.array(rows if worlds > 1 else rows[0], dtype=wp.float32, device="cpu")
    found = parse_worlds(scene, 1, given, np.zeros(1, dtype=np.int32), None).object_poses
    assert found.dtype == wp.transform
    np.testing.assert_array_equal(found.numpy(), rows)
