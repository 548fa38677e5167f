# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Packets of rays from moving sensors: a float64 reference, single rays, and sensors too fast for them."""

import numpy as np
import pytest
import trimesh
from pose_samples import unit

import warpvis as wv
from warpvis.cameras import LensCamera, Rays, lenses
from warpvis.rendering.casters import moving_packets_cuda
from warpvis.rendering.casters.moving import MovingCaster
from warpvis.scene import solids as shapes
from warpvis.sensors import Motion, RollingShutter

import reference
from compare import assert_view_matches, hair, wrong_depth
from support.ray_patterns import few_origins, sphere_of_rays
from support.worlds import ALL, assert_bits_equal, build, random_poses

TURN = 0.1
IMAGES = (*ALL, "faces")


@pytest.fixture(autouse=True)
def any_number_of_rays(monkeypatch):
    """Cast few rays in packets on a GPU, too."""
    monkeypatch.setattr(moving_packets_cuda, "_MIN_RAYS", 0)


def drive(rng, views, instants):
    """Return a motion along a path with `instants` poses, each a few degrees and centimeters from the last."""
    first = random_poses(rng, views, spread=0.3).astype(np.float64)
    steps = rng.normal(size=(instants, views, 7)) * np.repeat([0.02, 0.01], [3, 4])
    return Motion(unit(first + np.cumsum(steps, axis=0)), np.linspace(0, TURN, instants))


def twist(rng, views, speed=2.0, turns=1.0):
    first = random_poses(rng, views, spread=0.3)
    return Motion.from_twist(first, speed * rng.normal(size=3), turns * rng.normal(size=3))


def spinning(count, columns):
    """Return rays in columns around the z axis, one column after the other, with origins off the axis."""
    azimuth = -2 * np.pi * np.arange(columns) / columns
    elevation = np.radians(np.linspace(25, -25, count))[:, None]
    directions = np.stack(
        np.broadcast_arrays(
            np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
        ),
        axis=-1,
    )
    times = np.broadcast_to(np.arange(columns) * (TURN / columns), (count, columns))
    return directions, 0.03 * directions * (1, 1, 0), times


def remaining_views(renderer, motion):
    """Return which views of a motion the packets of a renderer cannot cast; on a GPU, they cast some rays of all."""
    caster = renderer._moving_caster()
    views = caster.parse(motion, None, None, None, None, None)
    if not renderer.scene.device.is_cpu:
        return np.zeros(views.count, dtype=bool)
    images = wv.rendering.views_for(("depth",), (views.count, *renderer.camera.shape), renderer.scene.device)
    return caster._packets.cast_motion(views.poses.sensor, None, views, {"depth": images.depth})[0]


@pytest.mark.parametrize("make", [lambda rng: drive(rng, 2, 9), lambda rng: twist(rng, 2)], ids=["path", "twist"])
def test_moving_packets_match_reference(make, device):
    rng = np.random.default_rng(0)
    scene, motion = build(device, random_poses(rng, 5, spread=1.5), movable=True), make(rng)
    directions, origins, times = spinning(24, 36)
    lidar = Rays(directions, origins, times, near=0.2, far=4.0)
    renderer = wv.Renderer(scene, lidar, outputs=ALL)
    assert not remaining_views(renderer, motion).any()
    views = renderer.render(motion)
    for view in range(2):
        poses = motion.at(times)[:, :, view]
        expected = reference.cast_moving_rays(scene, lidar.rays, poses, origins, near=lidar.near, far=lidar.far)

        def beside(x, y, poses=poses):
            rays = lidar.rays[y, x] + hair(1e-6, 3)
            around = np.broadcast_to(poses[y, x], (*rays.shape[:-1], 7))
            return reference.cast_moving_rays(scene, rays, around, origins[y, x] + 0 * rays, near=0.2, far=4.0).depth

        assert_view_matches(views, view, expected, beside)
        assert np.isfinite(expected.depth).mean() > 0.2


def sensors():
    """Return cameras with times: lidars, a list of rays in any order, and shutters, one with pixels without a ray."""
    lens = LensCamera(lenses.KannalaBrandt(60, 60, 80, 60, (0.02, 0.01, 0, 0)), 160, 120)
    return {
        "ouster": wv.sensors.lidars.ouster("OS1-128", mode="512x10"),
        "velodyne": wv.sensors.lidars.hdl64e(),
        "list": Rays(sphere_of_rays(20_000), 0.2 * few_origins(20_000), np.linspace(0, TURN, 20_000)),
        "camera": RollingShutter(wv.Camera.from_fov(150, 110, hfov=1.1), 0.03),
        "fisheye": RollingShutter(lens, 0.02, "right_to_left"),
    }


@pytest.mark.smoke("*ouster*")
@pytest.mark.parametrize("name", sensors())
def test_moving_packets_match_single_rays(name, device):
    """Each world has separate poses of objects, and excludes one; a motion has starts and several instants."""
    rng, camera = np.random.default_rng(1), sensors()[name]
    rows = np.stack([random_poses(rng, 5, spread=1.5) for _ in range(3)])
    scene = build(device, rows[0], movable=True)
    room = wv.scenes.PRESETS["room"].build(device)
    path = drive(rng, 1, 40)
    starting = Motion(path.at(np.linspace(0, TURN, 40))[:, 0], np.linspace(0, 0.4, 40), starts=[0.0, 0.1, 0.25])
    worlds, seen = {"object_poses": rows, "exclude": ["moved_1"]}, set()
    per_ray = Motion.per_ray(np.moveaxis(twist(rng, 3).at(camera.times), -2, 0))
    for there, motion, more in (
        (room, twist(rng, 3), {"cull_backfaces": True}),
        (scene, per_ray, worlds),
        (scene, twist(rng, 3), worlds),
        (scene, starting, {**worlds, "world_index": [2, 0, 1]}),
    ):
        packets = wv.render(there, camera, motion, outputs=IMAGES, **more)
        rays = wv.render(there, camera, motion, outputs=IMAGES, caster="rays", **more)
        differ = wrong_depth(packets.depth.numpy(), rays.depth.numpy().astype(np.float64))
        for image in ("segmentation", "labels", "faces"):
            differ |= getattr(packets, image).numpy() != getattr(rays, image).numpy()
        for image in ("points", "normals"):
            one, other = getattr(packets, image).numpy(), getattr(rays, image).numpy()
            differ |= ~np.isclose(one, other, atol=1e-4, equal_nan=True).all(axis=-1)
        assert differ.mean() <= 1e-4
        seen.update(packets.segmentation.numpy().ravel().tolist())
        assert not remaining_views(wv.Renderer(there, camera), motion).all()  # a view is at the floor
    assert len(seen) > 3


@pytest.mark.parametrize("shared", ["rows", "columns", "view"])
def test_packets_share_poses_of_rays(shared, monkeypatch):
    """Poses of columns, of rows, and one for each view, of a camera without times."""
    scene, camera = wv.scenes.PRESETS["room"].build(), wv.Camera.from_fov(150, 110, hfov=1.1)
    shape = {"rows": (110, 1), "columns": (1, 150), "view": (1, 1)}[shared]
    poses = [wv.look_at((0, 0, 1.0), (2, 0.5, 0.9)), wv.look_at((0.5, 0.2, 0.8), (-1, 1, 1))]
    path = Motion.from_twist(poses, (1, 0, 2), (0, 1, 0)).at(np.linspace(0, TURN, max(shape)))
    motion = Motion.per_ray(np.moveaxis(path, 1, 0).reshape(2, *shape, 7))
    rays = wv.render(scene, camera, motion, outputs=IMAGES, caster="rays")
    monkeypatch.setattr(MovingCaster, "_cast_single_rays", refuse)
    packets = wv.render(scene, camera, motion, outputs=IMAGES)
    assert not wrong_depth(packets.depth.numpy(), rays.depth.numpy().astype(np.float64)).any()
    assert (packets.faces.numpy() != rays.faces.numpy()).mean() <= 1e-4


def crowd(rng, solids, device):
    """Return a room with 40 movable objects, more than there are bits, some of several parts."""
    scene = wv.scenes.PRESETS["room"].build(device)
    for index, pose in enumerate(random_poses(rng, 40, spread=2.0)):
        mesh = trimesh.creation.icosphere(2, 0.1) if index % 2 else trimesh.creation.box((0.2, 0.1, 0.3))
        scene.add(mesh, name=f"thing_{index}", pose=pose, movable=True)
    if solids:
        for index, pose in enumerate(random_poses(rng, 4, spread=1.5)):
            scene.add(shapes.sphere(0.1 + 0.05 * index), name=f"ball_{index}", pose=pose, movable=True)
    return scene


def refuse(*_):
    raise AssertionError("cast ray by ray")


@pytest.mark.parametrize("solids", [False, True], ids=["meshes", "solids"])
@pytest.mark.parametrize("moves", ["objects", "twist", "sensor"])
def test_objects_in_packets_match_single_rays(solids, moves, device, monkeypatch):
    """Objects on a path, with a twist, or at rest before a moving sensor; those of each world move separately."""
    rng = np.random.default_rng(3)
    scene = crowd(rng, solids, device)
    count, instants = len(scene.movable), 3
    ends = np.stack([random_poses(rng, count, spread=1.5) for _ in range(2)])
    steps = np.cumsum(rng.normal(scale=0.02, size=(instants, 2, count, 7)), axis=0)
    way = Motion(unit(ends + steps), np.linspace(0, TURN, instants))
    if moves == "twist":
        way = Motion.from_twist(ends, rng.normal(size=(2, count, 3)), 3 * rng.normal(size=(2, count, 3)))
    poses = np.array([[0, 0, 1.0, 0, 0, 0, 1], [0.5, 0.2, 0.8, 0, 0, 0, 1]])
    motion = Motion.from_twist(poses, (3, 0, 0), (0, 0, 1)) if moves != "objects" else poses
    more = {"object_poses": ends if moves == "sensor" else way, "exclude": ["thing_2"], "world_index": [1, 0]}
    for camera, outputs in ((sensors()["ouster"], IMAGES), (sensors()["fisheye"], ("segmentation",))):
        with monkeypatch.context() as only_packets:
            if solids or moves != "sensor":  # else the sensor drives through an object, and that view is left
                only_packets.setattr(MovingCaster, "_cast_single_rays", refuse)
            packets = wv.render(scene, camera, motion, outputs=outputs, **more)
        rays = wv.render(scene, camera, motion, outputs=outputs, caster="rays", **more)
        differ = packets.segmentation.numpy() != rays.segmentation.numpy()
        if outputs == IMAGES:
            differ |= wrong_depth(packets.depth.numpy(), rays.depth.numpy().astype(np.float64))
            differ |= packets.faces.numpy() != rays.faces.numpy()
            for image in ("points", "normals"):
                one, other = getattr(packets, image).numpy(), getattr(rays, image).numpy()
                differ |= ~np.isclose(one, other, atol=1e-4, equal_nan=True).all(axis=-1)
        assert differ.mean() <= 1e-4
        assert len(np.unique(rays.segmentation.numpy())) > 12


def test_views_that_move_too_far_for_packets_are_cast_as_single_rays(device):
    scene, lidar = wv.scenes.PRESETS["room"].build(device), Rays(*spinning(32, 64))
    poses = np.array([[0, 0, 1.0, 0, 0, 0, 1]] * 4)
    motion = Motion.from_twist(poses, [[1, 0, 0], [400, 0, 0], [0, 0, 0], [2, 0, 0]], np.eye(4, 3) * [1, 1, 300])
    views, rays = (wv.render(scene, lidar, motion, outputs=IMAGES, caster=name) for name in ("auto", "rays"))
    assert wrong_depth(views.depth.numpy(), rays.depth.numpy().astype(np.float64)).mean() <= 1e-4
    if device != "cpu":  # where the last digits depend on the kernel
        return
    assert remaining_views(wv.Renderer(scene, lidar), motion).tolist() == [False, True, True, False]
    for view in (1, 2):
        for image in IMAGES:
            np.testing.assert_array_equal(getattr(views, image).numpy()[view], getattr(rays, image).numpy()[view])


def test_packets_of_moving_sensors_do_not_depend_on_threads_or_batches(device):
    rng, scene = np.random.default_rng(2), wv.scenes.PRESETS["room"].build(device)
    lidar, motion = wv.sensors.lidars.vlp16(), twist(rng, 3)
    whole = wv.render(scene, lidar, motion, outputs=IMAGES, threads=1)
    assert_bits_equal(wv.render(scene, lidar, motion, outputs=IMAGES, threads=2), whole)
    caster = wv.Renderer(scene, lidar, outputs=ALL)._moving_caster()
    views = caster.parse(motion, None, None, None, None, None)
    some = wv.rendering.views_for(ALL, (2, *lidar.shape), scene.device)
    caster.cast(views.part(slice(1, 3)), {image: getattr(some, image) for image in ALL})
    for image in ALL:
        np.testing.assert_array_equal(getattr(some, image).numpy(), getattr(whole, image).numpy()[1:3])
