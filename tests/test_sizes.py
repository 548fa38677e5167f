# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of `object_scales`: renders match scenes built with the scaled meshes."""

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.scene.worlds import parse_worlds, part_of

import reference
from compare import assert_matches_reference, wrong_depth
from support import attached as attached_scenes, near_plane as near_plane_scenes
from support.sizes import NEAR, SHAPES, SURROUNDED, TURNED, assert_alike, build, random_scales, surrounded
from support.worlds import ALL, MESHES, SMALL, assert_bits_equal, assert_views_match_twins, eyes, random_poses


@pytest.mark.smoke("*-packets-True", "*-rays-False")
@pytest.mark.parametrize("cull_backfaces", [False, True])
def test_scaled_objects_match_scene_built_at_scale(device, caster, cull_backfaces):
    rng, world = np.random.default_rng(0), np.array([1, 0, 2, 1])
    rows, scales = random_poses(rng, 3, len(SHAPES)), random_scales(rng, 3, len(SHAPES))
    renderer = wv.Renderer(build(device, rows[0]), SMALL, outputs=ALL, caster=caster, cull_backfaces=cull_backfaces)
    views = renderer.render(eyes(4), object_poses=rows, object_scales=scales, world_index=world)
    twins = [build("cpu", rows[index], scales[index]) for index in world]
    assert_views_match_twins(views, SMALL, eyes(4), twins, cull_backfaces=cull_backfaces)


def test_scale_of_one_changes_no_bit(device, caster):
    rows = random_poses(np.random.default_rng(1), 2, len(SHAPES))
    renderer = wv.Renderer(build(device, rows[0]), SMALL, outputs=ALL, caster=caster)
    plain = renderer.render(eyes(2), object_poses=rows)
    assert_bits_equal(renderer.render(eyes(2), object_poses=rows, object_scales=np.ones((len(SHAPES), 3))), plain)


def test_extreme_scales_far_from_origin(device, caster):
    """A cube of 1 mm scaled to a wall, and a wall scaled to a cube of 1 cm, 1 km from the origin."""
    scene, twin = wv.Scene(device=device), wv.Scene()
    scales = np.array([(50.0, 2000.0, 3000.0), (0.002, 0.004, 0.01)])
    poses = np.round([(1003, 1000, 2, 0, 0, 0, 1), (1001, 1000, 2, 0, 0, 0, 1)])
    for shape, pose, scale in zip(((1e-3, 1e-3, 1e-3), (10, 5, 2)), poses, scales, strict=True):
        for one, factors in ((scene, 1.0), (twin, scale)):
            one.add(trimesh.creation.box(shape), pose=pose, scale=factors, movable=True)
    pose = wv.look_at((1000, 1000, 2), (1001, 1000, 2))[None]
    views = wv.render(scene, SMALL, pose, outputs=ALL, object_scales=scales, caster=caster)
    assert (np.unique(views.segmentation.numpy()) == [-1, 0, 1]).all()
    assert_matches_reference(views, twin, SMALL, pose)


@pytest.mark.parametrize("near_plane", ["occlude", "clip"])
@pytest.mark.parametrize("kind", [0, 1, 3, 4])
def test_scaled_solids_from_inside_and_clipped(device, caster, kind, near_plane):
    """The triangles of a solid are stretched with it; a capsule's ends become half ellipsoids."""
    shapes, row, scales = [SHAPES[kind]], [TURNED], [(1.5, 0.8, 1.2)]
    scene, twin = build(device, row, shapes=shapes), build(device, row, scales, shapes=shapes)
    camera = near_plane_scenes.CAMERA if near_plane == "clip" else SMALL
    for cull_backfaces in (False, True):
        options = {"outputs": ALL, "cull_backfaces": cull_backfaces, "near_plane": near_plane, "caster": caster}
        views = wv.render(scene, camera, NEAR, object_scales=scales, **options)
        assert_alike(views, wv.render(twin, camera, NEAR, **options))


@pytest.mark.parametrize("near_plane", ["occlude", "clip"])
@pytest.mark.parametrize(("kind", "factor", "x"), SURROUNDED)
def test_inside_of_grown_or_shrunk_object(device, caster, kind, factor, x, near_plane):
    scales, pose = surrounded(factor, x)
    scene, twin = (build(device, [(0, 0, 2, 0, 0, 0, 1)], some, shapes=[SHAPES[kind]]) for some in (None, scales))
    options = {"outputs": ALL, "near_plane": near_plane, "caster": caster}
    views = wv.render(scene, SMALL, pose, object_scales=scales, **options)
    assert (views.segmentation.numpy() == 1).mean() > 0.9
    assert_alike(views, wv.render(twin, SMALL, pose, **options))


def test_attached_objects_scale_with_their_parent(device, caster):
    table, ball = random_poses(np.random.default_rng(2), 2)
    scene = attached_scenes.build(device, table, ball, attached=True)
    factors = np.array([(0.7, 1.4, 1.2), (1, 1, 1)])
    views = wv.render(scene, SMALL, eyes(2), outputs=ALL, caster=caster, object_scales=factors)
    twin = wv.Scene()
    for item in scene.objects:
        if item.pose is None and item.parent is None:
            twin.add((item.vertices, item.faces), name=item.name, label=item.label)
            continue
        parent = item if item.parent is None else scene.objects[item.parent]
        scale = factors[scene.movable.index(scene.index(parent.name))]
        twin.add((item.mesh_vertices * scale, item.faces), name=item.name, label=item.label, pose=parent.pose)
    assert_matches_reference(views, twin, SMALL, eyes(2))


def test_render_at_with_scales(device, caster):
    rng = np.random.default_rng(3)
    rows, scales = random_poses(rng, 2, len(SHAPES)), random_scales(rng, 2, len(SHAPES))
    pixels = rng.uniform(-2, [98, 74], (2, 2000, 2)).astype(np.float32)
    renderer = wv.Renderer(build(device, rows[0]), SMALL, outputs=ALL, caster=caster)
    views = renderer.render_at(eyes(2), pixels, object_poses=rows, object_scales=scales)
    for view in range(2):
        expected = reference.cast_rays_at(build("cpu", rows[view], scales[view]), SMALL, eyes(2)[view], pixels[view])
        wrong = wrong_depth(views.depth.numpy()[view], expected.depth)
        assert wrong.mean() <= 1e-3
        same = ~wrong & (expected.gap > 1e-5)
        assert (views.segmentation.numpy()[view][same] == expected.objects[same]).all()
        hit = same & np.isfinite(expected.depth)
        apart = np.abs(views.normals.numpy()[view][hit] - expected.normals[hit]).max(axis=-1) > 2e-4
        assert apart.mean() <= 1e-2  # at edges between triangles, either normal is valid


def test_orthographic_camera_with_scales(device):
    row, scale = [(0, 0, 1, 0, 0, 0, 1)], [(2.0, 0.5, 1.5)]
    camera = wv.cameras.OrthographicCamera(40, 30, 10, 10, 20, 15, far=10.0)
    pose = wv.look_at((3, 1, 2), (0, 0, 1))[None]
    for shape in (SHAPES[1], SHAPES[4]):
        scene, twin = build(device, row, shapes=[shape]), build(device, row, scale, shapes=[shape])
        views = wv.render(scene, camera, pose, object_scales=scale).depth.numpy()
        np.testing.assert_allclose(views, wv.render(twin, camera, pose).depth.numpy(), atol=2e-6)


def test_scales_without_object_poses(device):
    """Without poses, objects stay where they were added. A single world of scales applies to all views."""
    rng = np.random.default_rng(4)
    rows, scales = random_poses(rng, len(SHAPES)), random_scales(rng, 3, len(SHAPES))
    renderer = wv.Renderer(build(device, rows), SMALL, outputs=ALL)
    views = renderer.render(eyes(3), object_scales=scales)
    assert_bits_equal(renderer.render(eyes(3), object_poses=np.stack([rows] * 3), object_scales=scales), views)
    one = renderer.render(eyes(3), object_scales=scales[0])
    assert_bits_equal(renderer.render(eyes(3), object_scales=np.stack([scales[0]] * 3)), one)
    given = wp.array(scales, dtype=wp.vec3, device=device)
    assert_bits_equal(renderer.render(eyes(3), object_scales=given), views)
    if device != "cpu":
        small = wv.Renderer(build(device, rows), SMALL, outputs=ALL, device_bytes=1)
        assert_bits_equal(small.render(eyes(3), object_scales=scales), views)


def test_part_of_slices_scales():
    scene = build("cpu", random_poses(np.random.default_rng(5), len(SHAPES)))
    scales = random_scales(np.random.default_rng(6), 4, len(SHAPES))
    worlds = parse_worlds(scene, 4, None, None, None, scales)
    part = part_of(worlds, slice(1, 3))
    np.testing.assert_array_equal(part.object_sizes.numpy(), worlds.object_sizes.numpy()[1:3])
    shared = parse_worlds(scene, 4, None, [3, 0, 1, 1], None, scales)
    assert part_of(shared, slice(1, 3)).object_sizes is shared.object_sizes


def test_scale_kernel_matches_reference(device):
    from warpvis.kernels.casting.worlds import scale_sizes

    rng = np.random.default_rng(7)
    made, scales = rng.uniform(0.1, 2, (5, 4)).astype(np.float32), rng.uniform(0.1, 2, (2, 5, 3)).astype(np.float32)
    arrays = [wp.array(made, dtype=wp.vec4, device=device), wp.array(scales, dtype=wp.vec3, device=device)]
    sizes = wp.empty((4, 5), dtype=wp.vec4, device=device)
    wp.launch(scale_sizes, sizes.shape, [*arrays, sizes], device=device)
    np.testing.assert_allclose(sizes.numpy(), reference.scale_sizes(made, scales, 4), rtol=1e-6)


ONES = np.ones((2, 2, 3))
BAD = {
    "nothing moves": ({"movable": False}, ONES, "object_scales were given, but no object of the scene is movable"),
    "another shape": ({}, ONES[:, :1], "object_scales must be numbers of shape (W, 2, 3), factors along x, y and z"),
    "no worlds": ({}, ONES[:0], "object_scales must be numbers of shape (W, 2, 3), factors along x, y and z"),
    "flags": ({}, ONES > 0, "of the movable objects in W worlds, got bool of shape (2, 2, 3)"),
    "words": ({}, "large", "object_scales must be an array of numbers"),
    "zero": ({}, ONES * [1, 0, 1], "object_scales must be positive and finite: wrong in 4, of 'a' in world 0, 'b' in"),
    "negative": ({}, -ONES[0], "object_scales must be positive and finite: wrong in 2, of 'a' in world 0"),
    "NaN": ({}, ONES * np.nan, "object_scales must be positive and finite: wrong in 4"),
    "too large for single precision": ({}, ONES * 1e39, "object_scales must be positive and finite: wrong in 4"),
    "other worlds": ({}, np.ones((3, 2, 3)), "object_scales have 3 worlds, but object_poses have 2"),
}


@pytest.mark.parametrize("name", BAD)
def test_invalid_scales_raise(name):
    options, scales, said = BAD[name]
    scene = wv.Scene()
    for item in "ab":
        scene.add(MESHES[0], name=item, **{"movable": True, **options})
    poses = {"object_poses": np.tile([0, 0, 0, 0, 0, 0, 1], (2, 2, 1))} if scene.movable else {}
    with pytest.raises(wv.errors.ArrayError) as error:
        wv.Renderer(scene, SMALL).render(eyes(2), object_scales=scales, **poses)
    assert said in str(error.value)
    if name == "other worlds":
        with pytest.raises(wv.errors.ArrayError, match="object_scales have 3 worlds for 2 views; give world"):
            wv.Renderer(scene, SMALL).render(eyes(2), object_scales=scales)
