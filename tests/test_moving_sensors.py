# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Sensors and objects that move within a frame: closed forms, float64 references, single rows, clouds, and errors."""

import copy
import pickle

import numpy as np
import pytest
import reference_motion as twins
import trimesh
import warp as wp
from pose_samples import unit

import warpvis as wv
from warpvis.cameras import LensCamera, Rays, lenses
from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.errors import ArrayError, CameraError, PoseError
from warpvis.rendering import views_for
from warpvis.scene.acceleration import traversal_plan
from warpvis.sensors import Motion, RollingShutter, deskew, measure_incidence, point_clouds

import reference
from compare import assert_view_matches, hair, wrong_depth
from support.ray_patterns import few_origins, sphere_of_rays
from support.solids import build as build_solids
from support.worlds import ALL, assert_bits_equal, build, random_poses

STRAIGHT = np.array([0, 0, 0, 0, 0, 0, 1.0])
CAMERA = wv.Camera.from_fov(64, 48, hfov=1.1, near=0.1, far=20.0)
READOUT = 0.04
DIRECTIONS = ("top_to_bottom", "bottom_to_top", "left_to_right", "right_to_left")


def room_pose():
    return wv.look_at((0.1, 0.2, 0.9), (0.5, 0.4, 0.3))


def assert_same_images(one, other, device):
    """Compare bit for bit on CPU; a GPU compiler contracts operations per kernel, so compare within bounds there."""
    if device == "cpu":
        assert_bits_equal(one, other)
        return
    wrong = wrong_depth(one.depth.numpy(), other.depth.numpy().astype(np.float64))
    wrong |= one.segmentation.numpy() != other.segmentation.numpy()
    with np.errstate(invalid="ignore"):
        for name in ("points", "normals"):
            wrong |= (np.abs(getattr(one, name).numpy() - getattr(other, name).numpy()) > 1e-4).any(axis=-1)
    assert wrong.mean() <= 2e-3


def edge_scene(device, x):
    """Return a plate to the left of a vertical edge at `x`, 2 m in front of an OpenCV camera."""
    scene = wv.Scene(device=device)
    corners = [[x, -9, 2], [x, 9, 2], [-9, 9, 2], [-9, -9, 2.0]]
    scene.add((np.array(corners), [[0, 1, 2], [0, 2, 3]]), name="plate")
    return scene


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_translation_shears_vertical_edge(direction, device):
    """A camera moving sideways at 5 m/s shifts the edge in each line by 5 m/s times the line's time times f / z."""
    shutter = RollingShutter(CAMERA, READOUT, direction)
    end = STRAIGHT + np.array([5.0 * READOUT, 0, 0, 0, 0, 0, 0])
    depth = wv.render(edge_scene(device, 0.13), shutter, Motion([STRAIGHT, end], [0, READOUT])).depth.numpy()[0]
    y, x = np.mgrid[:48, :64]
    line = {"top_to_bottom": y / 48, "bottom_to_top": (47 - y) / 48, "left_to_right": x / 64}
    time = READOUT * line.get(direction, (63 - x) / 64)
    beyond = x + 0.5 - (32 + CAMERA.fx * (0.13 - 5.0 * time) / 2.0)
    sure = np.abs(beyond) > 1e-4
    np.testing.assert_array_equal(np.isinf(depth)[sure], beyond[sure] > 0)
    np.testing.assert_allclose(depth[np.isfinite(depth)], 2.0, atol=1e-6)
    if direction == "top_to_bottom":
        columns = np.isfinite(depth).sum(axis=1)
        shear = CAMERA.fx * 5.0 * READOUT / 2.0 * 47 / 48  # 5.3 px from the first to the last line
        assert abs((columns[0] - columns[-1]) - shear) <= 1


def test_rotation_shears_vertical_edge(device):
    """A rotation by the angle w t places the edge at column f tan(bearing - w t)."""
    rate, scene = 2.0, edge_scene(device, 0.0)
    motion = Motion.from_twist(STRAIGHT, (0, 0, 0), (0, rate, 0))
    depth = wv.render(scene, RollingShutter(CAMERA, READOUT), motion).depth.numpy()[0]
    y, x = np.mgrid[:48, :64]
    beyond = x + 0.5 - (32 - CAMERA.fx * np.tan(rate * READOUT * y / 48))
    sure = np.abs(beyond) > 1e-4
    np.testing.assert_array_equal(np.isinf(depth)[sure], beyond[sure] > 0)


def moving_box(device):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.4, 9, 0.5)), name="cart", movable=True)
    scene.add(trimesh.creation.box((20, 20, 0.2)), name="wall", pose=(0, 0, 6.1, 0, 0, 0, 1))
    return scene


def test_moving_object_is_hit_at_ray_time(device):
    """A box moves sideways at 3 m/s and approaches at 8 m/s: compare edges and depth line by line."""
    start = np.array([[-0.3, 0, 3.25, 0, 0, 0, 1.0]])
    end = start + np.array([3.0, 0, -8.0, 0, 0, 0, 0]) * READOUT
    shutter, motion = RollingShutter(CAMERA, READOUT), Motion([start, end], [0, READOUT])
    views = wv.render(moving_box(device), shutter, STRAIGHT, object_poses=motion, outputs=ALL)
    y, x = np.mgrid[:48, :64]
    time = READOUT * y / 48
    front = 3.0 - 8.0 * time
    across = (x + 0.5 - 32) / CAMERA.fx * front - (-0.3 + 3.0 * time)
    sure = np.abs(np.abs(across) - 0.2) > 0.02  # its sides are visible next to the front
    hit = views.segmentation.numpy()[0] == 0
    np.testing.assert_array_equal(hit[sure], (np.abs(across) < 0.2)[sure])
    middle = np.abs(across) < 0.18
    np.testing.assert_allclose(views.depth.numpy()[0][middle], front[middle], atol=1e-6)
    np.testing.assert_allclose(views.points.numpy()[0][middle][:, 2], front[middle], atol=1e-6)
    np.testing.assert_allclose(views.normals.numpy()[0][middle], np.tile([0, 0, -1.0], (middle.sum(), 1)), atol=1e-6)


def eyes_for_zero():
    """Return static cameras and their counterparts with times; some surfaces are nearer than `near`."""
    lens, ranges = lenses.OpenCVPinhole(52, 50, 32, 24, (-0.1, 0.02, 0, 0)), {"near": 1.6, "far": 4.0}
    camera, bent = wv.Camera.from_fov(64, 48, hfov=1.1, **ranges), LensCamera(lens, 64, 48, **ranges)
    rays, times = (sphere_of_rays(600), few_origins(600)), np.linspace(0, READOUT, 600)
    return {
        "camera": (camera, RollingShutter(camera, READOUT)),
        "lens": (bent, RollingShutter(bent, READOUT)),
        "lidar": (Rays(*rays, **ranges), Rays(*rays, times, **ranges)),
    }


@pytest.mark.smoke("*-occlude")
@pytest.mark.parametrize("near_plane", ["occlude", "clip"])
@pytest.mark.parametrize("eye", ["camera", "lens", "lidar"])
def test_zero_motion_matches_static_render(eye, near_plane, device, monkeypatch):
    """Scenes contain solids, meshes and static instances, some of them excluded or scaled."""
    for name, few in (("_MIN_USES", 10), ("_MIN_SAVED", 1000), ("_MIN_SAVED_CUDA", 1000)):
        monkeypatch.setattr(traversal_plan, name, few)
    rng = np.random.default_rng(5)
    scene = build_solids(device, random_poses(rng, 10), extra=[trimesh.creation.box((0.5, 0.3, 0.7))] * 2)
    grains = random_poses(rng, 40, spread=2.5)
    scene.add_instances(trimesh.creation.icosphere(2, 0.15), grains, names="grain", movable=False)
    assert len(traversal_plan.plan_traversal(scene._objects, scene.device).instances) == 40
    still, shutter = eyes_for_zero()[eye]
    poses = np.array([wv.look_at(place, (0, 0, 0.6)) for place in ((2.2, 0.3, 1.0), (-1.5, 1.2, 0.8))])
    there = np.array([scene.objects[index].pose for index in scene.movable])
    stays, twist = Motion([poses, poses], [0, READOUT]), Motion.from_twist(poses, (0, 0, 0), (0, 0, 0))
    moving = Motion([there, there], [0, READOUT]), Motion.from_twist(there, (0, 0, 0), (0, 0, 0))
    stretched = {"object_scales": rng.uniform(0.6, 1.4, (len(there), 3))}
    for more in ({}, {"exclude": ["sphere", "mesh_0", "grain_3"]}, stretched):
        options = {"outputs": ALL, "near_plane": near_plane, "cull_backfaces": eye == "lens", "caster": "rays", **more}
        expected = wv.render(scene, still, poses, **options)
        for sensor, objects in ((stays, None), (twist, None), (poses, moving[0]), (stays, moving[1])):
            views = wv.render(scene, shutter, sensor, object_poses=objects, **options)
            assert_same_images(views, expected, device)
    seen = set(np.unique(expected.segmentation.numpy()))
    assert len(seen & set(scene.movable)) >= 3 and len(seen) > len(seen & set(scene.movable)) + 4


def test_rows_match_images_from_their_poses(device):
    scene, shutter = wv.scenes.PRESETS["room"].build(device), RollingShutter(CAMERA, READOUT)
    eyes = np.linspace((-1.6, -1.3, 1.6), (-1.4, -1.5, 1.5), 48)
    rows = np.array([wv.look_at(eye, (0.5, 0.4, 0.3)) for eye in eyes])
    whole = wv.render(scene, CAMERA, rows, caster="rays", outputs=ALL)
    by_time = wv.render(scene, shutter, Motion(rows, shutter.times[:, 0].tolist()), caster="rays", outputs=ALL)
    of_rows, of_rays = (
        wv.render(scene, CAMERA, Motion.per_ray(poses), caster="rays", outputs=ALL)
        for poses in (rows[:, None], np.repeat(rows[None, :, None], 64, axis=2))
    )
    index = np.arange(48)
    each = wv.Views(**{n: wp.array(getattr(whole, n).numpy()[index, index][None], device=device) for n in ALL})
    for views in (by_time, of_rows, of_rays):
        assert_same_images(views, each, device)


def test_per_ray_poses_match_motion_in_time(device):
    """Per-ray poses match a motion in time when each column, or ray, has a different time."""
    scene = wv.scenes.PRESETS["room"].build(device)
    shutter = RollingShutter(CAMERA, READOUT, "left_to_right")
    motion = Motion([room_pose(), unit(room_pose() + [0.2, -0.1, 0, 0, 0.05, 0, 0])], [0, READOUT])
    expected = wv.render(scene, shutter, motion, outputs=ALL)
    columns = wv.render(scene, CAMERA, Motion.per_ray(motion.at(shutter.times[:1])), outputs=ALL)
    lidar = Rays(sphere_of_rays(300), times=np.linspace(0, READOUT, 300))
    of_list = wv.render(scene, lidar, Motion.per_ray(motion.at(lidar.times)), outputs=ALL)
    for views, other in ((columns, expected), (of_list, wv.render(scene, lidar, motion, outputs=ALL))):
        # Poses per ray are rounded to single precision.
        assert wrong_depth(views.depth.numpy(), other.depth.numpy().astype(np.float64)).mean() < 2e-3


def paths(count, times, seed=0, spread=0.5):
    """Return random poses of `count` bodies at `times`."""
    rng = np.random.default_rng(seed)
    first = random_poses(rng, count, spread=spread).astype(np.float64)
    steps = rng.normal(size=(len(times), count, 7)) * 0.15
    return unit(first + np.cumsum(steps, axis=0))


def test_timed_rays_with_origins_match_reference(device):
    rng, times = np.random.default_rng(0), np.array([0.0, 0.01, 0.035, 0.04])
    scene = build_solids(device, random_poses(rng, 8, spread=2.0))
    moments = np.linspace(0, READOUT, 6)[rng.integers(6, size=500)]
    shape = (20, 25)
    origins = few_origins(500, 0.2).reshape(*shape, 3)
    directions, moments = sphere_of_rays(500).reshape(*shape, 3), moments.reshape(shape)
    lidar = Rays(directions, origins, moments, near=0.2, far=3.0)
    motion = Motion(paths(2, times, spread=0.3), times)
    views = wv.render(scene, lidar, motion, outputs=ALL)
    options = {"near": lidar.near, "far": lidar.far}
    for view in range(2):
        poses = motion.at(moments)[:, :, view]
        expected = reference.cast_moving_rays(scene, lidar.rays, poses, origins, **options)

        def beside(x, y, poses=poses):
            rays = lidar.rays[y, x] + hair(1e-6, 3)
            around = np.broadcast_to(poses[y, x], (*rays.shape[:-1], 7))
            return reference.cast_moving_rays(scene, rays, around, origins[y, x] + 0 * rays, **options).depth

        assert_view_matches(views, view, expected, beside)
    incidence = measure_incidence(views, lidar, motion)
    cosines = reference.measure_moving_incidence(motion.at(moments)[:, :, 1], directions, views.normals.numpy()[1])
    np.testing.assert_allclose(incidence.numpy()[1], cosines, atol=1e-6)


@pytest.mark.parametrize("kind", ["meshes", "solids"])
def test_moving_objects_match_reference(kind, device):
    rng, instants = np.random.default_rng(1), np.array([0.0, 0.02, 0.05])
    make, count = {
        "meshes": (lambda where, rows: build(where, rows, movable=True), 5),
        "solids": (lambda where, rows: build_solids(where, rows, extra=[trimesh.creation.box((0.5, 0.3, 0.7))]), 9),
    }[kind]
    way = Motion(paths(count, instants, seed=2, spread=1.2), instants)
    moments = np.linspace(0.001, 0.049, 5)[rng.integers(5, size=300)].reshape(15, 20)
    lidar = Rays(sphere_of_rays(300).reshape(15, 20, 3), times=moments, near=0.2, far=6.0)
    sensor = Motion.from_twist(random_poses(rng, 1, spread=0.2)[0], (1.0, 2.0, 0), (0, 1.0, 2.0))
    scene = make(device, way.at(0.0))
    views = wv.render(scene, lidar, sensor, object_poses=way, outputs=ALL)
    poses, options = sensor.at(moments), {"near": lidar.near, "far": lidar.far}
    scenes = {moment: make("cpu", way.at(moment)) for moment in np.unique(moments)}
    expected = reference.cast_at_moving_objects(scenes.__getitem__, lidar.rays, poses, moments, **options)

    def beside(x, y):
        rays = lidar.rays[y, x] + hair(1e-6, 3)
        around = np.broadcast_to(poses[y, x], (*rays.shape[:-1], 7))
        return reference.cast_moving_rays(scenes[moments[y, x]], rays, around, **options).depth

    assert_view_matches(views, 0, expected, beside)
    assert len(np.unique(views.segmentation.numpy())) > 4


def test_batched_worlds_match_single_calls(device):
    """Each view matches a separate call."""
    instants = [0.0, READOUT]
    rows = np.stack([paths(5, instants, seed=seed, spread=1.5) for seed in (0, 1)], axis=1)  # (T, W, M, 7)
    scene, shutter = build(device, rows[0, 0], movable=True), RollingShutter(CAMERA, READOUT)
    sensor = np.array([wv.look_at(place, (0, 0, 0.6)) for place in ((2.2, 0.3, 1.0), (-2.0, 1.2, 0.8))])
    sensor = np.stack([sensor, unit(sensor + [0.1, 0, 0, 0.05, 0, 0, 0])])  # (T, V, 7)
    scales = np.random.default_rng(3).uniform(0.7, 1.3, (2, 5, 3))
    options = {"outputs": ALL, "exclude": ["moved_1"]}
    both = wv.render(
        scene,
        shutter,
        Motion(sensor, instants),
        object_poses=Motion(rows, instants),
        object_scales=scales,
        world_index=[1, 0],
        **options,
    )
    of_each = wv.render(
        scene,
        shutter,
        Motion(sensor, instants),
        object_poses=Motion(rows[:, ::-1], instants),
        device_bytes=1,
        **options,
    )
    shown = scene.index("moved_1")
    assert not (both.segmentation.numpy() == shown).any()
    for view, world in enumerate((1, 0)):
        still = Motion(sensor[:, view], instants), Motion(rows[:, world], instants)
        for views, scale in ((both, scales[world]), (of_each, None)):
            alone = wv.render(scene, shutter, still[0], object_poses=still[1], object_scales=scale, **options)
            for name in ALL:
                np.testing.assert_array_equal(getattr(alone, name).numpy()[0], getattr(views, name).numpy()[view])


def test_split_batches_match_whole_batch():
    """Batches too large for a GPU are split."""
    instants = [0.0, READOUT]
    rows = np.stack([paths(5, instants, seed=seed, spread=1.5) for seed in (0, 1, 2)], axis=1)
    eyes = paths(3, instants, seed=4)
    scene, shutter = build("cpu", rows[0, 0], movable=True), RollingShutter(CAMERA, READOUT)
    renderer = wv.Renderer(scene, shutter, outputs=ALL)
    for sensor in (
        Motion(eyes, instants),
        Motion(eyes[:, 0], [5.0, 6.0], starts=[5.0, 5.5, 5.25]),
        Motion.from_twist(eyes[0], np.eye(3), (0, 0, 1.0)),
        Motion.per_ray(eyes[0][:, None, None]),
    ):
        way = Motion(rows, [0, 6.0])
        whole = renderer.render(sensor, object_poses=way)
        caster = renderer._moving_caster()
        views = caster.parse(sensor, way, None, None, None, None)
        part = slice(1, 3)
        some = views_for(ALL, (2, 48, 64), scene.device)
        caster.cast(views.part(part), {name: getattr(some, name) for name in ALL})
        for name in ALL:
            np.testing.assert_array_equal(getattr(some, name).numpy(), getattr(whole, name).numpy()[part])


def box_room(device):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((4, 6, 8)), name="box")
    return scene


def wall_errors(points):
    """Return the distances of points from the walls of the box."""
    return np.abs(np.abs(points) - [2, 3, 4]).min(axis=-1)


@pytest.mark.parametrize("kind", ["twist", "instants", "trajectory"])
def test_deskewing_restores_walls(kind, device):
    """A lidar moves at 5 m/s and rotates at 3 rad/s in a closed box: skew of decimeters is corrected to 1e-5 m."""
    times = np.linspace(0, 0.1, 2000, endpoint=False)
    lidar = Rays(sphere_of_rays(2000), few_origins(2000), times, np.arange(2000) % 16, axes="ros_body")
    poses = np.array([[0.1, -0.2, 0.3, 0, 0, 0, 1], *unit([[-0.2, 0.3, 0, 0.1, 0.2, -0.3, 1]])])
    twist = Motion.from_twist(poses, (5.0, 0.5, 0), (0.2, -0.1, 3.0))
    motion = {
        "twist": twist,
        "instants": Motion(twist.at([0.0, 0.1]), [0.0, 0.1]),
        "trajectory": Motion(twist.at(np.linspace(0, 0.3, 31))[:, 0], np.linspace(7, 7.3, 31), starts=[7.0, 7.17]),
    }[kind]
    views = wv.render(box_room(device), lidar, motion, outputs=("depth", "points", "segmentation"))
    clouds = point_clouds(views, lidar)
    assert clouds[0].dtype.names == ("x", "y", "z", "ring", "time", "range", "object")
    np.testing.assert_allclose(wall_errors(views.points.numpy()), 0, atol=1e-5)
    for at in (0.0, 0.06):
        restored = deskew(clouds, motion, target_time=at)
        for view, (cloud, pose) in enumerate(zip(restored, motion.at(at), strict=True)):
            matrix = poses_to_matrices(pose)
            points, skewed = (np.stack([c[n] for n in "xyz"], axis=-1) for c in (cloud, clouds[view]))
            assert wall_errors(skewed @ matrix[:3, :3].T + matrix[:3, 3]).max() > 0.1
            np.testing.assert_allclose(wall_errors(points @ matrix[:3, :3].T + matrix[:3, 3]), 0, atol=1e-5)
            np.testing.assert_array_equal(cloud["time"], clouds[view]["time"])
    local = lidar.origins + lidar.directions * views.depth.numpy().astype(np.float64)[..., None]
    plain = deskew(local, motion, times=times, target_time=0.06)
    world = poses_to_matrices(motion.at(0.06))
    world = np.einsum("vij,vnj->vni", world[:, :3, :3], plain) + world[:, None, :3, 3]
    np.testing.assert_allclose(world, views.points.numpy(), atol=2e-6)


def test_deskewing_arrays_and_organized_clouds():
    motion = Motion.from_twist(STRAIGHT, (1.0, 0, 0), (0, 0, 0))
    times = np.array([[0.0, 0.1], [0.2, 0.3]])
    points = np.random.default_rng(0).normal(size=(2, 2, 3))
    np.testing.assert_allclose(deskew(points, motion, times=times) - points, times[..., None] * [1.0, 0, 0], atol=1e-12)
    far = Rays(sphere_of_rays(4).reshape(2, 2, 3), times=times, far=3.9)
    cloud = point_clouds(wv.render(box_room("cpu"), far, motion), far, organized=True)[0]
    restored = deskew(cloud, motion, target_time=0.3)
    assert restored.shape == (2, 2)
    np.testing.assert_array_equal(np.isnan(restored["x"]), np.isnan(cloud["x"]))
    np.testing.assert_allclose(
        (restored["x"] - cloud["x"])[np.isfinite(cloud["x"])], (times - 0.3)[np.isfinite(cloud["x"])], atol=1e-6
    )


def test_motions_follow_convention(device):
    """Poses of a motion follow `convention`, and velocities are along the axes of its frame."""
    scene, body = wv.scenes.PRESETS["room"].build(device), unit([[0.1, 0.2, 0.9, 0.1, -0.2, 0.3, 0.9]] * 2)
    body[1] = unit(body[0] + [0.1, 0, 0, 0.05, 0, 0, 0])
    shutter = RollingShutter(CAMERA, READOUT)
    optical = poses_to_opencv(body, "ros_body")
    linear, angular = np.array([1.0, 2, 3]), np.array([-0.5, 1.0, 2.0])
    into = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0.0]])  # OpenCV axes from x forward, y left, z up
    for of_body, of_eye in (
        (Motion(body, [0, READOUT]), Motion(optical, [0, READOUT])),
        (Motion.from_twist(body[0], linear, angular), Motion.from_twist(optical[0], into @ linear, into @ angular)),
        (Motion.per_ray(body[[0] * 24 + [1] * 24, None]), Motion.per_ray(optical[[0] * 24 + [1] * 24, None])),
    ):
        one = wv.render(scene, shutter, of_body, convention="ros_body", outputs=ALL)
        other = wv.render(scene, shutter, of_eye, outputs=ALL)
        np.testing.assert_allclose(one.depth.numpy(), other.depth.numpy(), atol=2e-5)
        assert (one.segmentation.numpy() == other.segmentation.numpy()).mean() > 0.999
    rays = shutter.rays / np.linalg.norm(shutter.rays, axis=-1, keepdims=True)
    lidar = Rays(rays @ into, times=shutter.times, axes="ros_body")
    given = Motion(optical, [0, READOUT])
    seen = wv.render(scene, lidar, given, convention="opencv", outputs=ALL)
    expected = wv.render(scene, lidar, Motion(body, [0, READOUT]), outputs=ALL)
    np.testing.assert_allclose(seen.depth.numpy(), expected.depth.numpy(), atol=2e-5)
    cosines = [
        measure_incidence(expected, lidar, Motion(body, [0, READOUT])).numpy(),
        measure_incidence(expected, lidar, given, convention="opencv").numpy(),
    ]
    np.testing.assert_allclose(*cosines, atol=1e-6)


def test_device_arrays_match_host_arrays(device):
    scene, shutter = build(device, paths(5, [0.0])[0], movable=True), RollingShutter(CAMERA, READOUT)
    eyes, rows = np.float32(paths(2, [0, 1], seed=4)), np.float32(paths(5, [0, 1], spread=1.5))
    expected = wv.render(scene, shutter, Motion(eyes, [0, 1]), object_poses=Motion(rows, [0, 1]), outputs=ALL)

    def there(array, dtype=wp.transform):
        return wp.array(array, dtype=dtype, device=device)

    for sensor, objects in (
        ([there(eye) for eye in eyes], [there(row[None]) for row in rows]),
        (there(eyes), there(rows)),
        (there(eyes, wp.float32), there(rows, wp.float32)),
    ):
        views = wv.render(scene, shutter, Motion(sensor, [0, 1]), object_poses=Motion(objects, [0, 1]), outputs=ALL)
        assert_same_images(views, expected, device)
    one = wv.render(scene, shutter, Motion(there(eyes[:, 0]), [0, 1]), outputs=ALL)
    assert_same_images(one, wv.render(scene, shutter, Motion(eyes[:, 0], [0, 1]), outputs=ALL), device)


def test_renderers_can_be_reused_and_copied(device):
    scene, shutter = wv.scenes.PRESETS["room"].build(device), RollingShutter(CAMERA, READOUT)
    motions = [Motion([room_pose(), unit(room_pose() + 0.02 * k)], [0, READOUT]) for k in (1, 2)]
    renderer = wv.Renderer(scene, shutter, outputs=ALL, fill="far")
    views = renderer.render(motions[0])
    assert renderer.render(motions[1], out=views) is views
    assert np.isfinite(views.depth.numpy()).all()
    assert_bits_equal(views, wv.render(scene, shutter, motions[1], outputs=ALL, fill="far"))
    for convert in (copy.deepcopy, lambda given: pickle.loads(pickle.dumps(given))):
        assert_bits_equal(convert(renderer).render(motions[1]), views)
    still = wv.render(scene, CAMERA, room_pose(), caster="rays", outputs=ALL, fill="far")
    packets = renderer.render(room_pose()).depth.numpy()
    assert wrong_depth(packets, still.depth.numpy().astype(np.float64)).mean() <= 1e-3


def test_render_at_of_shutter_matches_its_camera(device):
    """With static poses, a rolling shutter matches its camera, also between pixel centers."""
    scene, pixels = wv.scenes.PRESETS["room"].build(device), np.float32([[[5.25, 9.5], [70.0, 3.0], [63.9, 47.9]]])
    lens = LensCamera(lenses.OpenCVPinhole(52, 50, 32, 24, (-0.1, 0.02, 0, 0)), 64, 48)
    for camera in (CAMERA, lens):
        one, other = (
            wv.Renderer(scene, eye, caster="rays").render_at(room_pose(), pixels).depth.numpy()
            for eye in (camera, RollingShutter(camera, READOUT))
        )
        np.testing.assert_array_equal(one, other)
        assert np.isinf(one[0, 1])


def lidar_of(*times):
    return Rays(sphere_of_rays(len(times)), times=times)


MOVES = Motion([STRAIGHT, STRAIGHT], [0.0, 0.1])
REFUSED = {
    "no times": (
        lambda s: wv.render(s, CAMERA, MOVES),
        "camera must have times of rays for a Motion. Set times of Rays, or use a",
    ),
    "rays without times": (
        lambda s: wv.render(s, Rays(sphere_of_rays(2)), MOVES),
        "camera must have times of rays for a Motion",
    ),
    "objects without times": (
        lambda s: wv.render(s, CAMERA, STRAIGHT, object_poses=Motion(np.tile(STRAIGHT, (2, 5, 1)), [0, 1])),
        "camera must have times of rays for a Motion",
    ),
    "late rays": (
        lambda s: wv.render(s, lidar_of(0.0, 0.2), MOVES),
        "times must be within those of the motion, 0 to 0.1 s, got 0 to 0.2 s",
    ),
    "early rays": (
        lambda s: wv.render(s, lidar_of(-0.01, 0.0), MOVES),
        "times must be within those of the motion, 0 to 0.1 s, got -0.01 to 0 s",
    ),
    "late rays for objects": (
        lambda s: wv.render(s, lidar_of(0.2), STRAIGHT, object_poses=Motion(np.tile(STRAIGHT, (2, 5, 1)), [0, 0.1])),
        "of the motion, 0 to 0.1 s, got 0 to 0.2 s|of the motion, 0 to 0.1 s, got 0.2 to 0.2 s",
    ),
    "packets": (
        lambda s: wv.render(s, RollingShutter(CAMERA, 0.1), MOVES, caster="packets"),
        'caster must be "rays" or "auto" for a Motion, got "packets"',
    ),
    "parallel rays": (
        lambda s: wv.render(s, wv.cameras.OrthographicCamera.from_extent(8, 6, across=2.0), MOVES),
        "camera must be a pinhole, a lens or Rays for a Motion, got OrthographicCamera",
    ),
    "shape": (
        lambda s: wv.render(s, lidar_of(0.0), Motion(np.tile(STRAIGHT, (2, 3, 5, 1)), [0, 1])),
        r"camera_to_world must be a motion of views, with poses of shape \(T, 7\) or \(T, V, 7\), got \(2, 3, 5, 7\)",
    ),
    "objects": (
        lambda s: wv.render(s, lidar_of(0.0), STRAIGHT, object_poses=MOVES),
        r"object_poses must have shape \(W, 5, 7\)",
    ),
    "worlds": (
        lambda s: wv.render(s, lidar_of(0), STRAIGHT, object_poses=Motion(np.tile(STRAIGHT, (2, 3, 5, 1)), [0, 1])),
        "object_poses have 3 worlds for 1 view",
    ),
    "starts of objects": (
        lambda s: wv.render(
            s, lidar_of(0), STRAIGHT, object_poses=Motion(np.tile(STRAIGHT, (2, 5, 1)), [0, 1], starts=np.zeros(5))
        ),
        "starts must be given to the motion of camera_to_world, not to that of object_poses",
    ),
    "objects per ray": (
        lambda s: wv.render(s, lidar_of(0), STRAIGHT, object_poses=Motion.per_ray(np.tile(STRAIGHT, (5, 1)))),
        "object_poses must be a motion in time, got poses of rays",
    ),
    "per ray": (
        lambda s: wv.render(s, CAMERA, Motion.per_ray(np.tile(STRAIGHT, (47, 1, 1)))),
        r"poses of rays must have shape \(V, 48, 64, 7\), where an axis of rays may be 1, got \(47, 1, 7\)",
    ),
    "render_at": (
        lambda s: wv.Renderer(s, CAMERA).render_at(MOVES, [[[1.0, 1.0]]]),
        "camera_to_world must be an array of numbers: a Motion cannot be converted to an array",
    ),
    "readout": (lambda s: RollingShutter(CAMERA, -0.1), "readout must be a finite number from 0 up, got -0.1"),
    "direction": (lambda s: RollingShutter(CAMERA, 0.1, "down"), "direction must be \"top_to_bottom\", .* got 'down'"),
    "no camera": (lambda s: RollingShutter(lidar_of(0.0), 0.1), "camera must be a warpvis.Camera or a"),
    "no motion": (lambda s: deskew(np.zeros((1, 3)), STRAIGHT, times=[0]), "motion must be a warpvis.sensors.Motion"),
    "cloud": (lambda s: deskew(np.zeros(2, dtype=[("x", "f4")]), MOVES), "points must have the fields x, y, z, time"),
    "clouds": (
        lambda s: deskew([np.zeros(2, dtype=[(n, "f4") for n in ("x", "y", "z", "time")])] * 2, MOVES),
        "points must be one cloud for each of the 1 views of the motion, got 2",
    ),
    "points without times": (lambda s: deskew(np.zeros((2, 3)), MOVES), "times must be given for points without a"),
    "points": (
        lambda s: deskew(np.zeros((2, 3)), MOVES, times=[0.0]),
        r"points must have shape \(1, 3\), .* got \(2, 3\)",
    ),
    "times of points": (lambda s: deskew(np.zeros((1, 3)), MOVES, times=[np.nan]), "times must be finite"),
    "moment": (
        lambda s: deskew(np.zeros((1, 3)), MOVES, times=[0.0], target_time=1.0),
        "times must be within those of the motion, 0 to 0.1 s, got 1 to 1 s",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_invalid_motions_and_sensors_are_rejected(name):
    scene = build("cpu", paths(5, [0.0])[0], movable=True)
    call, message = REFUSED[name]
    with pytest.raises((ArrayError, CameraError, PoseError), match=message):
        call(scene)


def test_gpu_poses_are_not_read_back(cuda):
    motion = Motion([wp.array(STRAIGHT[None], dtype=wp.transform, device=cuda)] * 2, [0, 0.1])
    assert "on a GPU" in repr(motion)
    with pytest.raises(PoseError, match="are on a GPU, and are not read back"):
        motion.at(0.0)
    with pytest.raises(PoseError, match="must be in the host's memory"):
        Motion.from_twist(wp.array(STRAIGHT[None], dtype=wp.transform, device=cuda), (0, 0, 0), (0, 0, 0))


def test_shutters_compare_hash_and_copy_by_value():
    shutter = RollingShutter(CAMERA, READOUT, "bottom_to_top")
    assert shutter == RollingShutter(CAMERA, READOUT, "bottom_to_top") and hash(shutter)
    again = pickle.loads(pickle.dumps(shutter))
    assert again == shutter and np.array_equal(again.times, shutter.times)
    assert (shutter.shape, shutter.kind, shutter.near, shutter.far) == ((48, 64), "z", 0.1, 20.0)
    assert shutter.times[47, 0] == 0 and np.isclose(shutter.times[0, 5], READOUT * 47 / 48)
    lens = LensCamera(lenses.KannalaBrandt(20, 20, 32, 24, (0, 0, 0, 0)), 64, 48, kind="range")
    assert RollingShutter(lens, 0.0).kind == "range"
    assert twins.exponential(np.zeros((4, 4))).trace() == 4
