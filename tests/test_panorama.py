# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cylindrical and spherical images, compared with a float64 reference, a pinhole camera, and known positions."""

import numpy as np
import pytest
import trimesh
from pose_samples import unit
from reference_panorama import wide_rays

import warpvis as wv
from warpvis import scenes
from warpvis.cameras.rays import WideCamera
from warpvis.rendering import _panorama, render_wide

import reference
from compare import assert_view_matches, hair
from support.solids import build as build_solids
from support.worlds import ALL, assert_bits_equal, build, eyes, far_away, random_poses, view_of

AROUND = 2 * np.pi
STRAIGHT = np.array([[0, 0, 0, 0, 0, 0, 1]])
SIZES = {"cylindrical": (72, 36), "spherical": (48, 48)}


@pytest.fixture(params=["cylindrical", "spherical"])
def projection(request):
    return request.param


def assert_matches_reference(views, scene, poses, rays, **options):
    """Compare with the reference, except where a ray 1e-6 rad away hits another surface."""
    for view, pose in enumerate(poses):
        expected = reference.cast_ray_table(scene, rays, pose, **options)

        def depth_beside(x, y, pose=pose):
            return reference.cast_ray_table(scene, rays[y, x] + hair(1e-6, 3), pose, **options).depth

        assert_view_matches(views, view, expected, depth_beside)


@pytest.mark.smoke("cylindrical-*-3.0", "spherical-*-6.28*")
@pytest.mark.parametrize("hfov", [0.8, 3.0, AROUND])
def test_room_matches_reference(projection, hfov, device):
    preset = scenes.PRESETS["room"]
    scene, size = preset.build(device), SIZES[projection]
    poses = np.array([wv.look_at(eye, (0.5, 0.4, 0.3)) for eye in ((0.1, 0.2, 0.9), (-0.8, 1.2, 1.5))])
    views = render_wide(scene, *size, hfov, poses, projection=projection, outputs=ALL)
    assert np.isfinite(views.depth.numpy()).mean() > 0.1
    assert_matches_reference(views, scene, poses, wide_rays(*size, hfov, projection))


@pytest.mark.parametrize("cull_backfaces", [False, True])
def test_solids_and_moved_meshes_match_reference(projection, cull_backfaces, device):
    """The camera is among the objects, which are in front, to the sides and behind."""
    rng = np.random.default_rng(0)
    meshes = [trimesh.creation.box((0.5, 0.3, 0.7)), trimesh.creation.icosphere(subdivisions=1, radius=0.3)]
    rows = random_poses(rng, 10, spread=2.0)
    scene, size = build_solids(device, rows, extra=meshes), SIZES[projection]
    poses = random_poses(rng, 2, spread=0.3)
    options = {"cull_backfaces": cull_backfaces, "near": 0.4, "far": 2.0}
    views = render_wide(scene, *size, AROUND, poses, projection=projection, outputs=ALL, **options)
    depth, objects = views.depth.numpy(), views.segmentation.numpy()
    assert np.isneginf(depth).any() and np.isposinf(depth).any()
    assert len(np.unique(objects)) >= 7
    assert_matches_reference(views, scene, poses, wide_rays(*size, AROUND, projection), **options)


def test_floor_at_grazing_angle_matches_reference(projection, device):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((200, 200, 1)), name="floor", pose=(0, 0, -0.5, 0, 0, 0, 1))
    poses = wv.look_at((0, 0, 0.02), (1, 0.1, 0.0199))[None].astype(np.float32)
    views = render_wide(scene, 96, 96, 0.1, poses, projection=projection, outputs=ALL)
    assert_matches_reference(views, scene, poses, wide_rays(96, 96, 0.1, projection))


def test_hfov_is_at_most_two_pi(device):
    scene, poses = wv.scenes.PRESETS["room"].build(device), wv.scenes.PRESETS["room"].poses(1)
    assert render_wide(scene, 8, 4, 6.2832, poses).depth.shape == (1, 4, 8)
    with pytest.raises(wv.WarpvisError, match="radians"):
        render_wide(scene, 8, 4, 6.2834, poses)


@pytest.mark.parametrize("hfov", [1.5, AROUND])
def test_ranges_match_pinhole(projection, hfov, device):
    """Ranges equal planar depths in the same directions times the lengths of rays of depth 1."""
    preset = scenes.PRESETS["room"]
    scene, poses, size = preset.build(device), preset.poses(2), SIZES[projection]
    length = render_wide(scene, *size, hfov, poses, projection=projection).depth.numpy()
    camera = wv.Camera.from_fov(200, 200, hfov=1.9)
    rays = wide_rays(*size, hfov, projection)
    ahead = rays[..., 2] > 0.6
    pixels = np.where(ahead[..., None], camera.project(rays), np.nan).reshape(1, -1, 2)
    renderer = wv.Renderer(scene, camera, outputs=("depth",), caster="rays")
    depth = renderer.render_at(poses, np.tile(pixels, (2, 1, 1)).astype(np.float32)).depth.numpy()
    depth = depth.reshape(length.shape) / np.where(ahead, rays[..., 2], 1.0)
    assert ahead.mean() > 0.05
    # Image points are in single precision.
    close = np.isclose(depth, length, rtol=1e-4, atol=0)[:, ahead]
    assert close.mean() > 0.995


def test_ranges_inside_ball_equal_its_radius(projection, device):
    ball = trimesh.creation.icosphere(subdivisions=5, radius=2.0)
    scene = wv.Scene(device=device)
    scene.add(ball, pose=(1, 2, 3, 0, 0, 0, 1))
    nearest = np.linalg.norm(ball.triangles_center, axis=1).min()
    pose = unit((1, 2, 3, 0.1, 0.2, 0.3, 0.9))
    for size in ((64, 32), (33, 33), (5, 40)):
        views = render_wide(scene, *size, AROUND, pose, projection=projection, outputs=("depth", "points"))
        depth, points = views.depth.numpy()[0], views.points.numpy()[0]
        assert depth.min() >= nearest - 1e-6 and depth.max() <= 2 + 1e-6
        np.testing.assert_allclose(np.linalg.norm(points - [1, 2, 3], axis=-1), depth, rtol=2e-6)


def test_columns_are_azimuths_and_rows_elevations(device):
    """Boxes in six directions, the camera at the origin looking along z, y down: 90 degrees are 16 of 65 columns."""
    scene, size = wv.Scene(device=device), 0.8
    places = {"ahead": (0, 0, 1), "right": (2, 0, 0), "behind": (0, 0, -3), "left": (-4, 0, 0)}
    places |= {"below": (0, 5, 0), "above": (0, -6, 0)}
    for name, place in places.items():
        scene.add(trimesh.creation.box((size, size, size)), name=name, pose=(*place, 0, 0, 0, 1))
    views = render_wide(scene, 65, 33, AROUND, STRAIGHT, outputs=("depth", "segmentation"))
    objects, depth = views.segmentation.numpy()[0], views.depth.numpy()[0]
    for name, (y, x) in {"ahead": (16, 32), "right": (16, 48), "left": (16, 16), "behind": (16, 0)}.items():
        assert objects[y, x] == scene.index(name)
        assert depth[y, x] == pytest.approx(max(map(abs, places[name])) - size / 2, abs=5e-3)
    assert (objects[:, 64] == objects[:, 0]).sum() >= 32  # both sides of the seam behind the camera
    assert (objects[0] == scene.index("above")).all() == (objects[32] == scene.index("below")).all()


def test_spherical_image_is_equidistant(device):
    scene = wv.Scene(device=device)
    angles = {"middle": (0.0, 0.0), "right": (1.2, 0.0), "below": (1.2, np.pi / 2), "slanted": (2.0, np.pi / 4)}
    for name, (away, roll) in angles.items():
        place = 3 * np.array([np.sin(away) * np.cos(roll), np.sin(away) * np.sin(roll), np.cos(away)])
        scene.add(trimesh.creation.icosphere(radius=0.2), name=name, pose=(*place, 0, 0, 0, 1))
    for width, height in ((101, 101), (101, 51)):
        views = render_wide(scene, width, height, 5.0, STRAIGHT, projection="spherical", outputs=("segmentation",))
        objects = views.segmentation.numpy()[0]
        for name, (away, roll) in angles.items():
            x = int((0.5 + away / 5.0 * np.cos(roll)) * width)
            y = int((0.5 + away / 5.0 * np.sin(roll)) * height)
            assert objects[y, x] == scene.index(name)


def test_worlds_and_exclusion_match_reference(projection, device):
    rows, size = random_poses(np.random.default_rng(1), 2, 5), SIZES[projection]
    scene, rays = build(device, rows[0], movable=True), wide_rays(*size, AROUND, projection)
    arguments = {"projection": projection, "outputs": ALL}
    poses, world = eyes(3), [1, 0, 1]
    views = render_wide(scene, *size, AROUND, poses, object_poses=rows, world_index=world, **arguments)
    for view in range(3):
        twin = build("cpu", rows[world[view]], movable=False)
        assert_matches_reference(view_of(views, view), twin, poses[view : view + 1], rays)
    hidden = render_wide(scene, *size, AROUND, poses, exclude=["moved_1", "moved_3"], **arguments)
    assert_matches_reference(hidden, build("cpu", far_away(rows[0], 1, 3), movable=False), poses, rays)


def test_camera_sees_through_excluded_or_culled_housing(projection, device):
    """The housing is transparent if excluded or, as in Webots, if back faces are culled."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.icosphere(radius=0.05), name="housing")
    scene.add(_room(), name="room")
    inside = render_wide(scene, 32, 16, AROUND, STRAIGHT, projection=projection, outputs=ALL)
    assert (inside.segmentation.numpy() == 0).all()
    excluded = render_wide(scene, 32, 16, AROUND, STRAIGHT, projection=projection, outputs=ALL, exclude="housing")
    culled = render_wide(scene, 32, 16, AROUND, STRAIGHT, projection=projection, outputs=ALL, cull_backfaces=True)
    assert (excluded.segmentation.numpy() == 1).all()
    assert_bits_equal(excluded, culled)


def _room():
    room = trimesh.creation.box((2, 2, 2))
    room.invert()
    return room


def test_near_and_far_limit_range_along_ray(projection, device):
    """A wall 1 m ahead has range 1 m only in the center; at 60 degrees it has 2 m, irrespective of planar depth."""
    scene = wv.Scene(device=device)
    scene.add(([(-9, -9, 1), (9, -9, 1), (9, 9, 1), (-9, 9, 1)], [(0, 1, 2), (0, 2, 3)]))
    arguments = {"projection": projection, "outputs": ALL}
    hfov = 2 * np.pi / 3 * 101 / 100  # the last pixel's center is 60 degrees off the axis
    views = render_wide(scene, 101, 1, hfov, STRAIGHT, **arguments)
    np.testing.assert_allclose(views.depth.numpy()[0, 0, [0, 50, 100]], [2, 1, 2], rtol=1e-6)
    views = render_wide(scene, 101, 1, hfov, STRAIGHT, near=1.001, far=1.9, **arguments)
    depth = views.depth.numpy()[0, 0]
    assert np.isneginf(depth[50]) and np.isposinf(depth[[0, 100]]).all() and 1.001 <= depth[25] <= 1.9
    empty = ~np.isfinite(depth)
    assert (views.segmentation.numpy()[0, 0, empty] == -1).all() and (views.labels.numpy()[0, 0, empty] == 0).all()
    assert np.isnan(views.points.numpy()[0, 0, empty]).all()


def test_only_requested_outputs_are_rendered(device):
    preset = scenes.PRESETS["room"]
    scene = preset.build(device)
    views = render_wide(scene, 16, 8, 3.0, preset.poses(1))
    assert views.points is None and views.normals is None and views.labels is None and views.segmentation is None
    whole = render_wide(scene, 16, 8, 3.0, preset.poses(1), outputs=ALL)
    np.testing.assert_array_equal(views.depth.numpy(), whole.depth.numpy())
    labels = render_wide(scene, 16, 8, 3.0, preset.poses(1), outputs="labels").labels
    np.testing.assert_array_equal(labels.numpy(), whole.labels.numpy())
    assert render_wide(scene, 16, 8, 3.0, np.zeros((0, 7))).depth.shape == (0, 8, 16)


def test_pose_conventions_are_equivalent(projection, device):
    preset = scenes.PRESETS["room"]
    scene, pose = preset.build(device), preset.poses(1)
    turned = wv.core.poses.quaternion_product(pose[:, 3:], np.array([1.0, 0, 0, 0]))
    opengl = np.concatenate([pose[:, :3], turned], axis=1)
    one = render_wide(scene, 32, 16, AROUND, pose, projection=projection).depth.numpy()
    other = render_wide(scene, 32, 16, AROUND, opengl, projection=projection, convention="opengl").depth.numpy()
    np.testing.assert_allclose(other, one, rtol=1e-4)


def test_images_are_bit_identical_for_all_thread_counts(projection, device):
    preset = scenes.PRESETS["room"]
    scene = preset.build(device)
    arguments = {"projection": projection, "outputs": ALL}
    first = render_wide(scene, 160, 120, AROUND, preset.poses(3), threads=1, **arguments)
    for threads in (1, 2, 7):
        assert_bits_equal(first, render_wide(scene, 160, 120, AROUND, preset.poses(3), threads=threads, **arguments))


@pytest.mark.smoke("cylindrical-*-auto", "spherical-*-rays")
@pytest.mark.parametrize("caster", ["auto", "rays"])
def test_wide_camera_matches_render_wide(projection, caster, device):
    """Images and image points match the reference and `render_wide`."""
    preset, size = scenes.PRESETS["room"], SIZES[projection]
    scene, poses = preset.build(device), preset.poses(2)
    camera = WideCamera(*size, AROUND, projection, near=0.5, far=3.0)
    np.testing.assert_allclose(camera.rays, wide_rays(*size, AROUND, projection), atol=1e-15)
    renderer = wv.Renderer(scene, camera, outputs=ALL, caster=caster)
    views = renderer.render(poses)
    assert_matches_reference(views, scene, poses, camera.rays, near=0.5, far=3.0)
    if caster == "auto":
        arguments = {"projection": projection, "near": 0.5, "far": 3.0, "outputs": ALL}
        assert_bits_equal(views, render_wide(scene, *size, AROUND, poses, **arguments))
    columns, rows = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    pixels = np.stack([columns, rows], axis=-1).reshape(1, -1, 2).repeat(2, axis=0)
    pixels[:, :3] = [[-1, 3], [5, np.nan], [size[0], 0]]
    shown = renderer.render_at(poses, pixels).segmentation.numpy()
    assert (shown[:, :3] == -1).all()
    assert (shown[:, 3:] == views.segmentation.numpy().reshape(2, -1)[:, 3:]).mean() > 0.999


def test_images_too_large_for_the_ray_cache_are_equal(monkeypatch, projection, device):
    scene, poses, size = scenes.PRESETS["room"].build(device), scenes.PRESETS["room"].poses(1), SIZES[projection]
    kept = render_wide(scene, *size, AROUND, poses, projection=projection, outputs=ALL)
    monkeypatch.setattr(_panorama, "_MAX_CACHED_RAYS", size[0] * size[1] - 1)
    other = scenes.PRESETS["room"].build(device)
    alone = render_wide(other, *size, AROUND, poses, projection=projection, outputs=ALL)
    assert not other.cached_rays and scene.cached_rays
    assert (alone.segmentation.numpy() == kept.segmentation.numpy()).mean() > 0.999
    np.testing.assert_allclose(alone.depth.numpy(), kept.depth.numpy(), rtol=1e-5)


def test_full_panorama_matches_equirectangular_lens():
    camera = wv.cameras.LensCamera(wv.cameras.lenses.Equirectangular(64, 32), 64, 32)
    np.testing.assert_allclose(WideCamera(64, 32, AROUND).rays, camera.rays, atol=1e-15)


CASES = {
    "too many": ({"width": 2**14, "height": 2**13}, "width x height must be at most 67108864 rays, got 16384 x 8192"),
    "projection": ({"projection": "planar"}, 'projection must be "cylindrical" or "spherical", got \'planar\''),
    "width": ({"width": 0}, "width must be a whole number of pixels from 1 up, got 0"),
    "height": ({"height": 2.5}, "height must be a whole number of pixels from 1 up, got 2.5"),
    "degrees": ({"hfov": 180}, "at most 2 pi radians, got 180; angles are in radians: pass math.radians(180)"),
    "no field of view": ({"hfov": 0.0}, "hfov must be more than 0 and at most 2 pi radians, got 0.0"),
    "NaN": ({"hfov": np.nan}, "hfov must be more than 0 and at most 2 pi radians, got nan"),
    "text": ({"hfov": "wide"}, "hfov must be a number, got 'wide'"),
    "far before near": ({"near": 2.0, "far": 1.0}, "the depth range needs 0 <= near < far, got near=2.0, far=1.0"),
    "negative near": ({"near": -1.0}, "the depth range needs 0 <= near < far, got near=-1.0"),
    "outputs": (
        {"outputs": ("depth", "tint")},
        "outputs must be some of depth, points, normals, labels, segm",
    ),
    "no outputs": ({"outputs": ()}, "outputs must be some of"),
    "threads": ({"threads": 0}, "threads must be a whole number from 1 up, got 0"),
    "convention": ({"convention": "unity"}, "convention must be one of"),
    "pose": ({"camera_to_world": np.zeros(6)}, "camera_to_world must have shape"),
    "scene": ({"scene": "room"}, "scene must be a warpvis.Scene, got str"),
    "empty scene": ({"scene": wv.Scene()}, "the scene has no objects"),
    "exclude": ({"exclude": ["door"]}, "door"),
    "object poses": ({"object_poses": np.zeros((1, 1, 7))}, "no object of the scene is movable"),
}


@pytest.mark.parametrize("name", CASES)
def test_invalid_arguments_are_rejected(name):
    changed, said = CASES[name]
    scene = wv.Scene()
    scene.add(trimesh.creation.box((1, 1, 1)), name="box")
    arguments = {"scene": scene, "width": 8, "height": 4, "hfov": 3.0, "camera_to_world": STRAIGHT} | changed
    with pytest.raises(wv.WarpvisError) as error:
        render_wide(**arguments)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_points_outside_the_image_have_no_rays(projection):
    """Pixels include their left and upper borders; the right and lower ones are outside."""
    camera = WideCamera(64, 32, 2.0, projection)
    inside, outside = [(0, 0), (63.9, 0), (0, 31.9)], [(-0.1, 5), (64, 5), (5, -0.1), (5, 32), (-1, -1), (70, 40)]
    np.testing.assert_allclose(np.linalg.norm(camera.rays_at(inside), axis=-1), 1)
    assert np.isnan(camera.rays_at(outside)).all()
