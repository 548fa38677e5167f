# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of balls, ellipsoids, capsules and cylinders: rays hit the exact surface of movable solids with all casters."""

import numpy as np
import pytest
import trimesh
from pose_samples import unit

import warpvis as wv
from warpvis.scene import solids

import reference
from compare import assert_matches_reference, wrong_depth
from support.solids import SHAPES, build
from support.worlds import ALL, SMALL, assert_bits_equal, eyes, random_poses, view_of


def render(scene, camera, cameras, caster, **options):
    return wv.render(scene, camera, cameras, outputs=ALL, caster=caster, **options)


@pytest.mark.smoke("*-packets-*")
@pytest.mark.parametrize("name", SHAPES)
def test_surfaces_match_reference(device, caster, name):
    rng = np.random.default_rng(len(name))
    scene = build(device, random_poses(rng, 1, spread=0.2), names=[name])
    cameras = np.array([wv.look_at(place, (0, 0, 0.6)) for place in rng.normal(size=(6, 3)) * 1.5 + [0, 0, 1]])
    assert_matches_reference(render(scene, SMALL, cameras, caster), scene, SMALL, cameras)


@pytest.mark.smoke("*packets*")
def test_intersecting_solids_and_meshes(device, caster):
    rng = np.random.default_rng(0)
    meshes = [trimesh.creation.box((0.5, 0.3, 0.7)), trimesh.creation.icosphere(subdivisions=2, radius=0.3)]
    scene, cameras = build(device, random_poses(rng, 10), extra=meshes), eyes(5)
    assert_matches_reference(render(scene, SMALL, cameras, caster), scene, SMALL, cameras)
    culled = render(scene, SMALL, cameras, caster, cull_backfaces=True)
    assert_matches_reference(culled, scene, SMALL, cameras, cull_backfaces=True)


@pytest.mark.smoke("*-packets-*")
@pytest.mark.parametrize("gap", [1e-4, 1e-3, 0.05])
@pytest.mark.parametrize("name", ["sphere", "capsule", "cylinder"])
def test_solids_at_close_range(device, caster, name, gap):
    """Half a millimeter of tessellation error would be much along these rays."""
    scene = build(device, [(0, 0, 2, 0, 0, 0, 1)], names=[name])
    reach = scene.objects[1].solid.extent
    places = [(reach[0] + gap, 0, 2), (0, -reach[1] - gap, 2.01), (0.01, 0.02, 2 + reach[2] + gap)]
    targets = [(0, 1, 2), (0.3, 0, 2.5), (0, 1, 2)]
    cameras = np.array([wv.look_at(place, target) for place, target in zip(places, targets, strict=True)])
    camera = wv.Camera.from_fov(96, 72, hfov=1.4, near=1e-6, far=100.0)
    assert_matches_reference(render(scene, camera, cameras, caster), scene, camera, cameras)


@pytest.mark.parametrize(("distance", "offset"), [(80.0, 0.0), (2.0, 1e4), (300.0, 1e5)])
def test_solids_far_away_and_far_from_origin(device, caster, distance, offset):
    place = np.array([offset, -offset, 1.0])
    scene = wv.Scene(device=device)
    for index, name in enumerate(SHAPES):
        shape, scale = SHAPES[name]
        at = np.round(place + [0, 1.5 * (index - 3.5), 0])
        scene.add(shape, name=name, scale=scale, pose=unit((*at, 0.1, 0.2, 0.3, 0.9)), movable=True)
    camera = wv.Camera.from_fov(192, 48, hfov=2 * np.arctan(6.5 / distance), near=0.05, far=1000.0)
    cameras = np.array([wv.look_at(np.round(place) - [distance, 0, 0], np.round(place))])
    assert_matches_reference(render(scene, camera, cameras, caster), scene, camera, cameras)


def test_rays_through_symmetry_points_are_exact(device, caster):
    """Through the pole along the axis, and perpendicular to the side."""
    scene = build(device, [(0, 0, 2, 0, 0, 0, 1)], names=["capsule"])
    camera = wv.Camera(33, 33, 60, 60, 16.5, 16.5, near=0.01, far=10.0)
    cameras = np.array([wv.look_at((0, 0, 4), (0, 0, 2), up="y"), wv.look_at((3, 0, 2), (0, 0, 2))])
    depth = render(scene, camera, cameras, caster).depth.numpy()
    np.testing.assert_allclose(depth[:, 16, 16], [1.3, 2.8], rtol=1e-6)


@pytest.mark.parametrize("cull_backfaces", [False, True])
def test_triangles_are_rendered_from_inside(device, caster, cull_backfaces):
    poses = np.array([[0, 0, 2, 0, 0, 0, 1]] * 4, dtype=np.float32)
    names = ["sphere", "ellipsoid", "capsule", "cylinder"]
    scene, twin = build(device, poses, names=names), build(device, poses, names=names)
    for item in twin.objects[1:]:
        twin.update_vertices(item.name, item.mesh_vertices)
    assert all(item.solid is None for item in twin.objects)
    cameras = np.array([wv.look_at((0.01, 0.02, 2.05), (1, 0.1, 2.4)), wv.look_at((0.1, 0.02, 2), (0, 0, -1))])
    assert_bits_equal(*(render(one, SMALL, cameras, caster, cull_backfaces=cull_backfaces) for one in (scene, twin)))


def test_object_poses_and_exclude(device, caster):
    rng = np.random.default_rng(3)
    poses = random_poses(rng, 4, len(SHAPES))
    scene, cameras = build(device, poses[0]), eyes(6)
    world = np.array([2, 0, 3, 1, 1, 0], dtype=np.int32)
    hidden = np.zeros((6, len(scene)), dtype=np.uint8)
    hidden[np.arange(6), 1 + np.arange(6)] = 1
    renderer = wv.Renderer(scene, SMALL, outputs=ALL, caster=caster)
    views = renderer.render(cameras, object_poses=poses, world_index=world, exclude=hidden)
    for view in range(6):
        names = [name for index, name in enumerate(SHAPES) if index != view]
        twin = build(device, poses[world[view]][[index for index in range(len(SHAPES)) if index != view]], names=names)
        expected = reference.cast_rays(twin, SMALL, cameras[view])
        wrong = wrong_depth(view_of(views, view).depth.numpy()[0], expected.depth)
        assert wrong.mean() <= 1e-4
        shown = np.array([-1, *(i for i in range(len(scene)) if i != 1 + view)])[expected.objects + 1]
        same = views.segmentation.numpy()[view] == shown
        assert (same | wrong | (expected.gap <= 1e-5)).all()


def test_depth_is_independent_of_other_outputs(device, caster):
    rng = np.random.default_rng(4)
    scene, cameras = build(device, random_poses(rng, len(SHAPES))), eyes(3)
    everything = render(scene, SMALL, cameras, caster)
    for outputs in (("depth",), ("depth", "points"), ("depth", "segmentation"), ("depth", "labels")):
        some = wv.render(scene, SMALL, cameras, outputs=outputs, caster=caster)
        for name in outputs:
            assert getattr(some, name).numpy().tobytes() == getattr(everything, name).numpy().tobytes()


def test_render_at_matches_reference(device, caster):
    rng = np.random.default_rng(5)
    scene, cameras = build(device, random_poses(rng, len(SHAPES))), eyes(2)
    pixels = rng.uniform(-2, [98, 74], (2, 3000, 2)).astype(np.float32)
    views = wv.Renderer(scene, SMALL, outputs=ALL, caster=caster).render_at(cameras, pixels)
    for view in range(2):
        expected = reference.cast_rays_at(scene, SMALL, cameras[view], pixels[view])
        wrong = wrong_depth(views.depth.numpy()[view], expected.depth)
        assert wrong.mean() <= 3e-4
        same = ~wrong & (expected.gap > 1e-5)
        assert (views.segmentation.numpy()[view][same] == expected.objects[same]).all()
        hit = same & np.isfinite(expected.depth)
        np.testing.assert_allclose(views.normals.numpy()[view][hit], expected.normals[hit], atol=2e-4)


def test_static_solid_equals_its_triangles(device, caster):
    scene, twin = wv.Scene(device=device), wv.Scene(device=device)
    shape = solids.capsule(0.2, 0.5)
    scene.add(shape, name="limb", pose=(0, 0, 1, 0, 0, 0, 1))
    twin.add((shape.vertices, shape.faces), name="limb", pose=(0, 0, 1, 0, 0, 0, 1))
    assert_bits_equal(*(render(one, SMALL, eyes(2), caster) for one in (scene, twin)))


@pytest.mark.smoke("*packets*")
def test_deformed_solid_becomes_triangles(device, caster):
    scene = build(device, [(0, 0, 1, 0, 0, 0, 1)], names=["sphere"])
    before = scene["sphere"].solid
    scene.update_vertices("sphere", before.vertices * [1.0, 1.0, 0.5])
    assert before is not None and scene["sphere"].solid is None
    assert_matches_reference(render(scene, SMALL, eyes(2), caster), scene, SMALL, eyes(2))


def test_solids_survive_moving_to_another_device(device):
    scene = build(device, [(0, 0, 1, 0, 0, 0, 1)], names=["sphere"])
    assert scene.to("cpu")["sphere"].solid.kind == solids.SolidKind.BALL


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: solids.sphere(0), "radius of a sphere must be a positive number of meters, got 0"),
        (lambda: solids.ellipsoid(3), "half_axes of an ellipsoid must be three finite numbers, got 3.0"),
        (lambda: solids.capsule(-1, 1), "radius of a capsule must be a positive number of meters, got -1"),
        (lambda: solids.capsule(1, np.nan), "half_length of a capsule must be a positive number of meters, got nan"),
        (lambda: solids.cylinder("wide", 1), "radius of a cylinder must be a positive number of meters, got 'wide'"),
        (lambda: solids.cylinder(1, 1, mesh_tolerance=0), "mesh_tolerance must be a positive number of meters, got 0"),
    ],
)
def test_invalid_sizes_raise(make, said):
    with pytest.raises(wv.errors.SceneError) as error:
        make()
    assert str(error.value) == said
