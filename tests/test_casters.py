# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Both casters against the float64 reference: accuracy, ranges, and no leaks through edges or vertices."""

import gc
import weakref

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis import scenes

from compare import assert_matches_reference

ALL = ("depth", "points", "normals", "labels", "segmentation")
SMALL = wv.Camera.from_fov(120, 90, hfov=0.994837, near=0.05, far=100.0)


@pytest.mark.smoke("*-packets-experiment_2", "*-rays-experiment_3", "*-packets-experiment_4")
@pytest.mark.parametrize("name", [preset.name for preset in scenes.EXPERIMENTS])
def test_experiments_match_the_reference(name, device, caster):
    preset = scenes.PRESETS[name]
    scene = preset.build(device)
    camera = wv.Camera.from_fov(128, 96, hfov=0.994837, near=0.3, far=4.5)
    views = wv.render(scene, camera, preset.poses(), outputs=ALL, caster=caster)
    assert_matches_reference(views, scene, camera, preset.poses())


@pytest.mark.smoke("*packets*")
def test_room_matches_the_reference_from_several_views(device, caster):
    preset = scenes.PRESETS["room"]
    scene = preset.build(device)
    views = wv.render(scene, SMALL, preset.poses(3), outputs=ALL, caster=caster)
    assert_matches_reference(views, scene, SMALL, preset.poses(3))


def test_linear_vertical_pixels_match_the_reference(device, caster):
    preset = scenes.EXPERIMENTS[0]
    scene = preset.build(device)
    camera = wv.Camera.from_fov(96, 72, hfov=0.994837, vertical="linear")
    views = wv.render(scene, camera, preset.poses(), outputs=ALL, caster=caster)
    assert_matches_reference(views, scene, camera, preset.poses())


@pytest.mark.parametrize("size", [(1, 1), (7, 5), (3, 64)])
def test_odd_image_sizes(size, device, caster):
    preset = scenes.PRESETS["room"]
    scene = preset.build(device)
    camera = wv.Camera.from_fov(*size, hfov=0.8)
    views = wv.render(scene, camera, preset.poses(2), outputs=ALL, caster=caster)
    assert views.depth.shape == (2, size[1], size[0])
    assert_matches_reference(views, scene, camera, preset.poses(2))


@pytest.mark.smoke("*-packets-*", "*-rays-1000.0-10000.0")
@pytest.mark.parametrize(("scale", "offset"), [(1e-3, 0.0), (1.0, 0.0), (1e3, 0.0), (1.0, 1e4), (1e3, 1e4)])
def test_scales_and_positions_match_the_reference(scale, offset, device, caster):
    """A ball with a radius of 1 mm to 1 km, at the origin and 10 km away."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=scale)
    place = offset * np.array([1.0, -0.7, 0.4])
    scene = wv.Scene(device=device)
    scene.add(ball, name="ball", pose=(*place, 0, 0, 0, 1))
    camera = wv.Camera.from_fov(120, 90, hfov=0.994837)
    pose = wv.look_at(place + scale * np.array([2.0, 1.0, 0.5]), place)[None].astype(np.float32)
    views = wv.render(scene, camera, pose, outputs=ALL, caster=caster)
    assert np.isfinite(views.depth.numpy()).mean() > 0.2
    assert_matches_reference(views, scene, camera, pose)


def test_floor_at_a_grazing_angle(device, caster):
    """The camera is 2 cm above a floor of 200 m: naive single precision loses millimeters here."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((200, 200, 1)), name="floor", pose=(0, 0, -0.5, 0, 0, 0, 1))
    pose = wv.look_at((0, 0, 0.02), (1, 0.1, 0.0199))[None].astype(np.float32)
    views = wv.render(scene, SMALL, pose, outputs=ALL, caster=caster)
    assert_matches_reference(views, scene, SMALL, pose)


def test_wall_has_constant_planar_depth(device, caster):
    """Depth is z, not the ray's length."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((1, 20, 20)), pose=(3.5, 0, 0, 0, 0, 0, 1))
    depth = wv.render(scene, SMALL, wv.look_at((0, 0, 0), (1, 0, 0)), caster=caster).depth.numpy()
    np.testing.assert_allclose(depth, 3.0, rtol=2e-7)


def test_ranges_follow_rep_117(device, caster):
    """Beyond far is +inf; closer than near is -inf and still occludes; both have no object."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.1, 6, 6)), name="wall", pose=(5.05, 0, 0, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.1, 0.02, 4)), name="pole", pose=(0.25, 0, 0, 0, 0, 0, 1))
    pose = wv.look_at((0, 0, 0), (1, 0, 0))
    seen = wv.render(scene, wv.Camera.from_fov(64, 48, hfov=0.9, near=0.3, far=5.0), pose, outputs=ALL, caster=caster)
    depth = seen.depth.numpy()[0]
    assert depth[24, 32] == -np.inf
    assert depth[24, 2] == 5.0  # far itself is in range
    hidden = ~np.isfinite(depth)
    assert (seen.labels.numpy()[0][hidden] == wv.Label.EMPTY).all()
    assert (seen.segmentation.numpy()[0][hidden] == -1).all()
    assert np.isnan(seen.points.numpy()[0][hidden]).all()
    assert np.isnan(seen.normals.numpy()[0][hidden]).all()
    assert (seen.segmentation.numpy()[0][~hidden] == scene.index("wall")).all()
    farther = wv.render(scene, wv.Camera.from_fov(64, 48, hfov=0.9, far=4.99), pose, caster=caster).depth.numpy()[0]
    assert farther[24, 2] == np.inf
    assert farther[24, 32] == pytest.approx(0.2, abs=1e-6)


@pytest.mark.smoke("*-packets")
def test_no_ray_leaves_a_closed_mesh(device, caster):
    """From inside closed meshes every ray hits, in all directions, near the origin and 10 km away."""
    camera = wv.Camera.from_fov(256, 256, hfov=np.pi / 2)
    directions = np.concatenate([np.eye(3), -np.eye(3), [[1, 1, 1], [-1, 1, 0.3]]]) + [1e-3, 0, 1e-3]
    for mesh in (trimesh.creation.icosphere(subdivisions=4), trimesh.creation.box((2, 2, 2))):
        for place in (np.zeros(3), np.array([1e4, -7e3, 300.0])):
            scene = wv.Scene(device=device)
            scene.add(mesh, pose=(*place, 0, 0, 0, 1))
            poses = np.array([wv.look_at(place, place + direction) for direction in directions])
            depth = wv.render(scene, camera, poses, outputs=("depth",), caster=caster).depth.numpy()
            assert np.isfinite(depth).all()


def test_rays_through_vertices_and_edges_hit(device, caster):
    """A grid of triangles with vertices exactly on pixel centers, viewed along an axis."""
    n = 33
    camera = wv.Camera(n, n, 32.0, 32.0, n / 2, n / 2)
    y, x = np.mgrid[:n, :n]
    vertices = np.stack([(x - 16) / 32, (y - 16) / 32, np.ones((n, n))], axis=-1).reshape(-1, 3)
    corner = (y * n + x)[:-1, :-1].ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 1, corner + n], axis=1), np.stack([corner + 1, corner + n + 1, corner + n], axis=1)]
    )
    scene = wv.Scene(device=device)
    scene.add((vertices, faces))
    depth = wv.render(scene, camera, (0, 0, 0, 0, 0, 0, 1), caster=caster).depth.numpy()
    assert (depth[0, 1:-1, 1:-1] == 1.0).all()


def test_axis_aligned_rays_on_box_faces_and_slabs(device, caster):
    """The center ray runs along an axis; faces of other boxes lie in planes through the origin."""
    camera = wv.Camera(5, 5, 100.0, 100.0, 2.5, 2.5)
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((1, 1, 1)), pose=(5, 0, 0, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((1, 1, 1)), pose=(0, 3, 0, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.5, 0.5, 0.5)), pose=(2, 0.25, 0.25, 0, 0, 0, 1))  # two faces contain the axis
    depth = wv.render(scene, camera, wv.look_at((0, 0, 0), (1, 0, 0)), caster=caster).depth.numpy()[0]
    assert depth[2, 2] == pytest.approx(1.75, abs=1e-6)
    assert np.isfinite(depth).all()


def test_back_faces_are_rendered(device, caster):
    """Surfaces are two-sided, and normals point toward the camera."""
    triangle = (np.array([[2.0, -1, -1], [2, 1, -1], [2, 0, 1]]), np.array([[0, 1, 2]]))
    scene = wv.Scene(device=device)
    scene.add(triangle)
    poses = np.array([wv.look_at((0, 0, 0), (1, 0, 0)), wv.look_at((4, 0, 0), (3, 0, 0))])
    views = wv.render(scene, wv.Camera.from_fov(9, 9, hfov=0.2), poses, outputs=("depth", "normals"), caster=caster)
    np.testing.assert_allclose(views.depth.numpy(), 2.0, rtol=1e-6)
    np.testing.assert_allclose(views.normals.numpy()[0, ..., 0], -1.0, atol=1e-6)
    np.testing.assert_allclose(views.normals.numpy()[1, ..., 0], 1.0, atol=1e-6)


@pytest.mark.parametrize("movable", [False, True])
def test_edge_on_surface_is_invisible(movable, device, caster):
    """The camera lies in the plane of a thin wall, which is edge-on and covers no pixel."""
    scene = wv.Scene(device=device)
    wall = ([(0, -1, 0), (0, 1, 0), (0, 1, 9), (0, -1, 9)], [(0, 1, 2), (0, 2, 3)])
    scene.add(trimesh.creation.box((4, 2, 0.02)), name="floor", pose=(0, 0, -0.01, 0, 0, 0, 1))
    scene.add(wall, name="wall", movable=movable)
    pose = np.array([[0, 0, 4, 1, 0, 0, 0]], dtype=np.float32)  # straight down
    camera = wv.Camera.from_fov(40, 20, hfov=0.9)
    views = wv.render(scene, camera, pose, outputs=ALL, caster=caster)
    assert_matches_reference(views, scene, camera, pose)
    assert (views.segmentation.numpy() == 0).all()
    seen = wv.object_visibility(scene, camera, pose, caster=caster)
    assert seen.silhouette_pixels.numpy()[0, 1] == 0


def test_degenerate_triangles_are_ignored(device, caster):
    preset = scenes.PRESETS["room"]
    plain, spoiled = preset.build(device), preset.build(device)
    points = np.array([[0.0, 0, 0.5], [1, 0, 0.5], [2, 0, 0.5], [0, 0, 0.5]])
    spoiled.add((points, [[0, 1, 2], [0, 0, 0], [0, 3, 1]]), name="slivers")
    for name in ALL:
        one, other = (
            getattr(wv.render(s, SMALL, preset.poses(3), outputs=ALL, caster=caster), name).numpy()
            for s in (plain, spoiled)
        )
        np.testing.assert_array_equal(one, other)


def test_results_are_bit_identical_for_any_threads(device, caster):
    preset = scenes.PRESETS["room"]
    scene = preset.build(device)
    first = wv.render(scene, SMALL, preset.poses(5), outputs=ALL, threads=1, caster=caster)
    for threads in (1, 2, 3, 7):
        again = wv.render(scene, SMALL, preset.poses(5), outputs=ALL, threads=threads, caster=caster)
        for name in ALL:
            assert getattr(again, name).numpy().tobytes() == getattr(first, name).numpy().tobytes()


def test_only_requested_outputs_are_rendered(device, caster):
    preset = scenes.PRESETS["room"]
    scene = preset.build(device)
    views = wv.render(scene, SMALL, preset.poses(1), outputs=("labels",), caster=caster)
    assert views.depth is None and views.points is None and views.normals is None and views.segmentation is None
    whole = wv.render(scene, SMALL, preset.poses(1), caster=caster)
    np.testing.assert_array_equal(views.labels.numpy(), whole.labels.numpy())
    assert whole.normals is None
    assert (whole.labels.dtype, whole.segmentation.dtype, whole.points.dtype) == (wp.uint8, wp.int32, wp.vec3)


def test_out_is_written_in_place(device, caster):
    preset = scenes.PRESETS["room"]
    renderer = wv.Renderer(preset.build(device), SMALL, outputs=("depth", "segmentation"), caster=caster)
    views = renderer.render(preset.poses(4)[:2])
    memory = views.depth.ptr
    expected = renderer.render(preset.poses(4)[2:]).depth.numpy()
    assert renderer.render(preset.poses(4)[2:], out=views) is views
    assert views.depth.ptr == memory
    np.testing.assert_array_equal(views.depth.numpy(), expected)


def test_zero_views_return_empty_images(device, caster):
    views = wv.render(scenes.PRESETS["room"].build(device), SMALL, np.zeros((0, 7)), caster=caster)
    assert views.depth.shape == (0, 90, 120)


def test_objects_added_later_are_rendered(device, caster):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((1, 1, 1)), name="far", pose=(5, 0, 0, 0, 0, 0, 1))
    renderer = wv.Renderer(scene, SMALL, outputs=("segmentation",), caster=caster)
    pose = wv.look_at((0, 0, 0), (1, 0, 0))
    assert renderer.render(pose).segmentation.numpy()[0, 45, 60] == 0
    scene.add(trimesh.creation.box((1, 1, 1)), name="near", pose=(3, 0, 0, 0, 0, 0, 1))
    assert renderer.render(pose).segmentation.numpy()[0, 45, 60] == 1


@pytest.mark.smoke("*-packets-True", "*-rays-False")
@pytest.mark.parametrize("at_points", [False, True])
def test_renderer_keeps_no_references_to_caller_arrays(at_points, device, caster):
    """The recorded launch keeps no reference to the last images, object poses or pixels."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((1, 1, 1)), name="box", pose=(2, 0, 0, 0, 0, 0, 1), movable=True)
    renderer = wv.Renderer(scene, SMALL, outputs=ALL, caster=caster)
    poses = np.array([[0, 0, 0, -0.5, 0.5, -0.5, 0.5]], dtype=np.float32)
    placed = wp.array([[[2, 0, 0, 0, 0, 0, 1]]], dtype=wp.transform, device=device)
    if at_points:
        pixels = wp.array([[[60, 45], [3, 4]]], dtype=wp.vec2, device=device)
        views = renderer.render_at(poses, pixels, object_poses=placed)
        given = [pixels, placed]
    else:
        views = renderer.render(poses, object_poses=placed)
        given = [placed]
    watched = [weakref.ref(array) for array in (*given, *(getattr(views, name) for name in ALL))]
    assert np.isfinite(views.depth.numpy()).any()
    del views, placed, given
    if at_points:
        del pixels
    gc.collect()
    assert [reference() for reference in watched] == [None] * len(watched)
