# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Packets of moving sensors on CUDA: tables, rays near objects, and images of an emulated warp."""

import numpy as np
import pytest
import trimesh
import warp as wp
from cuda_emulator import Emulator, Variant
from pose_samples import unit

import warpvis as wv
from warpvis.cameras import LensCamera, Rays, lenses
from warpvis.core.poses import poses_to_matrices
from warpvis.kernels.casting import packets_cuda
from warpvis.rendering import views_for
from warpvis.rendering.casters import moving_packets_cuda
from warpvis.rendering.casters.base import CastOptions
from warpvis.rendering.casters.moving import MovingCaster
from warpvis.rendering.casters.moving_packets_cuda import CudaMovingPackets, MovingRays
from warpvis.scene.acceleration.geometry import build_scene_bvh
from warpvis.sensors import Motion, RollingShutter

import reference
from compare import wrong_depth
from support.ray_patterns import sphere_of_rays
from support.worlds import ALL, build, random_poses

TURN = 0.1
IMAGES = (*ALL, "faces")


@pytest.fixture(autouse=True)
def any_number_of_rays(monkeypatch):
    """Cast few rays in packets, too."""
    monkeypatch.setattr(moving_packets_cuda, "_MIN_RAYS", 0)


@pytest.fixture(scope="module")
def emulator(tmp_path_factory):
    return Emulator(tmp_path_factory.mktemp("moving_emulator"))


class EmulatedPackets(CudaMovingPackets):
    """Runs the native kernel in the emulator and the others on the CPU."""

    def __init__(self, emulator, scene, camera, cull):
        super().__init__(scene, camera, CastOptions(cull_backfaces=cull))
        self.emulator, self.cast_share = emulator, []

    def _cast_packets(self, call, side, tables, poses):
        scene = build_scene_bvh(self._scene.objects, self._scene.device, lanes=32, faces="faces" in call.images).struct
        scene = self._without_movables(scene) if call.touched is not None else scene
        arguments = {
            "scene": scene,
            "camera": self._camera.ray_range(),
            "poses": poses,
            "worlds": call.views.worlds,
            "found": packets_cuda.FoundObjects(),
            "rays": tables,
            "cull_backfaces": self._options.cull_backfaces,
            "images": call.images_struct,
        }
        variant = Variant(side, True, scene.drawn_count > 0, ray_table=True, origins=True)
        self.emulator.launch(variant, (call.views.count, tables.per_view, 1), arguments)
        self.cast_share.append((tables.frame.numpy()[:, 24] > 0).mean())


def spinning(count, columns):
    """Return a lidar in columns around the z axis, one column after the other, with origins off the axis."""
    azimuth = -2 * np.pi * np.arange(columns) / columns
    elevation = np.radians(np.linspace(25, -25, count))[:, None]
    parts = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation) + 0 * azimuth
    directions = np.stack(parts, axis=-1)
    times = np.broadcast_to(np.arange(columns) * (TURN / columns), (count, columns))
    return Rays(directions, 0.03 * directions * (1, 1, 0), times, near=0.2, far=20.0)


def twist(rng, views, speed=2.0, turns=1.0):
    return Motion.from_twist(random_poses(rng, views, spread=0.3), speed * rng.normal(size=3), turns * np.eye(3)[2])


def path(rng, views, instants=9):
    """Return a motion with a start for each view along a path of poses a few centimeters and degrees apart."""
    steps = np.cumsum(rng.normal(size=(instants, 7)) * np.repeat([0.02, 0.01], [3, 4]), axis=0)
    poses = unit(random_poses(rng, spread=0.3).astype(np.float64) + steps)
    return Motion(poses, np.linspace(0, 2 * TURN, instants), starts=np.linspace(0, TURN, views))


def sensors():
    lens = LensCamera(lenses.KannalaBrandt(30, 30, 40, 30, (0.02, 0.01, 0, 0)), 80, 60)
    return {
        "lidar": spinning(32, 96),
        "few": spinning(3, 40),
        "line": spinning(1, 40),
        "shutter": RollingShutter(wv.Camera.from_fov(70, 50, hfov=1.1), 0.03),
        "fisheye": RollingShutter(lens, 0.02, "right_to_left"),
    }


def tables_of(camera, motion, device):
    """Return a camera's packets, their tables in each view, and the terms of the motion."""
    scene = wv.scenes.PRESETS["room"].build(device)
    caster = MovingCaster(scene, camera, CastOptions())
    packets = CudaMovingPackets(scene, camera, CastOptions())
    views = caster.parse(motion, None, None, None, None, None)
    (kind, *_), _ = packets._prepared
    sensor = views.poses.sensor
    tables = kind.make_tables(views.count, 1 if sensor.is_screw else 4)
    packets._fill(MovingRays(caster._rays, views, {}, None), kind, tables)
    return kind, tables


def rays_of(camera):
    """Return a camera's rays, origins and times, shape (N, 3) and (N,)."""
    rays = camera.rays.reshape(-1, 3)
    return rays, np.zeros_like(rays) if camera.origins is None else camera.origins.reshape(-1, 3), camera.times.ravel()


def motions(rng):
    """Return motions of two views; the last one rotates so fast that few packets are cast."""
    return {
        "rest": twist(rng, 2, 0, 0),
        "twist": twist(rng, 2),
        "path": path(rng, 2),
        "spin": twist(rng, 2, 20, 100),
    }


TABLES = ["lidar", "few", "shutter", "fisheye"]


@pytest.mark.parametrize("move", motions(np.random.default_rng(1)))
@pytest.mark.parametrize("name", TABLES)
def test_terms_of_motion_match_reference(name, move, device):
    """A packet may take several legs of a path."""
    camera, motion = sensors()[name], motions(np.random.default_rng(1))[move]
    kind, tables = tables_of(camera, motion, device)
    terms, common, times = tables.terms.legs.numpy(), tables.terms.packets.numpy(), kind.times.numpy()
    images, legs_taken = kind.packets.frame.numpy()[:, :9].reshape(-1, 3, 3), set()
    for view in range(2):
        for packet, (first, last) in enumerate(kind.spans.numpy()):
            row = view * len(kind) + packet
            if not common["is_cast"][row]:
                continue
            middle = motion.at((first + last) / 2)[view]
            since = np.array([first, last, *(times[packet, ::7] + (first + last) / 2)]) - (first + last) / 2
            turns, ways = reference.place_moving_packets(
                images[packet], middle, motion.at(since + (first + last) / 2)[:, view]
            )
            number = (since[:, None] >= terms["since"][row, 1:]).sum(axis=1)
            legs_taken |= set(number.tolist())
            leg = terms[row, number]
            share = (since + leg["offset"]) * leg["rate"]
            angle = share * np.sqrt(leg["square"]) + 1e-9
            once, twice = np.sin(angle) / angle * share, (1 - np.cos(angle)) / angle**2 * share**2
            thrice = np.where(angle > 1e-2, (angle - np.sin(angle)) / angle**3, 1 / 6) * share**3
            turn = leg["still"] + once[:, None, None] * leg["turn"] + twice[:, None, None] * leg["twice"]
            shares = np.stack([share, twice, thrice], axis=1)[:, None]
            way = leg["begin"] + (shares @ np.stack([leg["path"], leg["across"], leg["along"]], axis=1))[:, 0]
            scale = np.abs(images[packet]).max()
            np.testing.assert_allclose(turn, turns, atol=1e-6 * scale * max(np.abs(turns).max(), 1e-3))
            np.testing.assert_allclose(way, ways, atol=1e-6 * scale)
    assert len(legs_taken) > 1 or (name, move) != ("lidar", "path")


@pytest.mark.parametrize("move", motions(np.random.default_rng(1)))
@pytest.mark.parametrize("name", TABLES)
def test_tables_match_reference(name, move, device):
    """Tables contain the rays at their times, and their bounds."""
    camera, motion = sensors()[name], motions(np.random.default_rng(1))[move]
    kind, tables = tables_of(camera, motion, device)
    rays, origins, times = rays_of(camera)
    place, cells = kind.packets.place.numpy(), kind.cells.numpy()
    there = (place >= 0) & np.isfinite(rays[place]).all(axis=-1)
    found = {}
    for word in ("frame", "eyes", "points", "rests", "scale", "asides", "begins"):
        rows = getattr(tables.packets, word).numpy().astype(np.float64)
        found[word] = rows.reshape(2, len(kind), *rows.shape[1:])
    for view in range(2):
        directions, starts = reference.move_packet_rays(rays, origins, motion.at(times)[:, view])
        frame, eyes, scale, asides, begins = (
            found[word][view] for word in ("frame", "eyes", "scale", "asides", "begins")
        )
        points = found["points"][view] + found["rests"][view]
        cast = frame[:, 24] > 0
        assert cast.all() or move == "spin" or name in ("few", "fisheye")
        rows, columns = frame[:, :9].reshape(-1, 3, 3), frame[:, 9:18].reshape(-1, 3, 3)
        np.testing.assert_allclose(rows @ columns.swapaxes(1, 2), np.tile(np.eye(3), (len(kind), 1, 1)), atol=1e-9)
        along = np.concatenate([points, np.ones((*points.shape[:2], 1))], axis=-1) @ columns
        begin = eyes[:, None, :3] + asides @ columns[:, :2] + begins[..., None] * along
        is_ray = there & cast[:, None]
        np.testing.assert_allclose(
            (along / np.where(there, scale, 1)[..., None])[is_ray], directions[place][is_ray], atol=1e-6
        )
        np.testing.assert_allclose(begin[is_ray], starts[place][is_ray], atol=1e-6)
        assert (scale[~there] == 0).all()
        # Bounds hold, and are tight but for the reach.
        error = np.moveaxis(np.abs(points - frame[:, None, 18:20] - cells), -1, 0)
        moment = np.abs(points[..., 0] * asides[..., 1] - points[..., 1] * asides[..., 0])
        reach = np.linalg.norm(starts[place] - eyes[:, None, :3], axis=-1)
        values = *error, 1 / np.where(there, scale, 1e9), *np.moveaxis(np.abs(asides), -1, 0), moment, reach, begins
        for word, value in zip((*frame[:, 20:22].T, frame[:, 24], *eyes[:, 3:].T), values, strict=True):
            most = np.where(there, value, 0).max(axis=1)[cast]
            assert (word[cast] >= most).all()
            if value is not reach:
                assert (word[cast] <= 1.001 * most + 2e-3).all()
        assert (begins[is_ray] >= -1e-7).all()
        np.testing.assert_allclose(frame[:, 22:24], np.linalg.norm(rows[:, :2], axis=-1))
        np.testing.assert_array_equal(frame[:, 25], 16)


def test_tables_at_rest_are_those_of_the_host(device):
    """The pose of a view at rest is the identity; a packet keeps the image and the eye of a static sensor."""
    for lidar in (spinning(32, 96), wv.sensors.lidars.vlp16()):
        still = Motion.from_twist([0, 0, 0, 0, 0, 0, 1.0], (0, 0, 0), (0, 0, 0))
        kind, tables = tables_of(lidar, still, device)
        for name in ("frame", "eyes", "points", "rests", "scale", "asides", "begins"):
            expected, found = getattr(kind.packets, name).numpy(), getattr(tables.packets, name).numpy()
            np.testing.assert_allclose(found, expected, rtol=2e-5, atol=1e-7, err_msg=name)


@pytest.mark.parametrize("moves", ["path", "twist"])
def test_marked_rays_include_all_near_objects(moves, device):
    """Bits contain every ray that passes the sphere around an object's box at its time, and few others."""
    from warpvis.kernels.casting.moving_packets_cuda import mark_touched_rays

    rng, lidar, count = np.random.default_rng(2), spinning(32, 96), 40
    scene = wv.Scene(device=device)
    boxes = rng.uniform(0.05, 0.3, (count, 3))
    for index, size in enumerate(boxes):
        scene.add(trimesh.creation.box(size), name=f"thing_{index}", movable=True)
    start = random_poses(rng, 2, count, spread=2.0).astype(np.float64)
    objects = Motion.from_twist(start, rng.normal(size=(2, count, 3)), 3 * rng.normal(size=(2, count, 3)))
    if moves == "path":
        objects = Motion(
            unit(start + np.cumsum(rng.normal(scale=0.02, size=(4, 2, count, 7)), axis=0)), np.linspace(0, TURN, 4)
        )
    sensor = twist(rng, 2)
    caster = MovingCaster(scene, lidar, CastOptions())
    views = caster.parse(sensor, objects, None, [1, 0], None, None)
    kind, tables = tables_of(lidar, sensor, device)
    touched = wp.zeros((2, lidar.height, lidar.width), dtype=wp.int32, device=device)
    lanes = 1 if device == "cpu" else 32
    inputs = [scene.bvh().struct, views.poses.sensor, views.worlds, views.poses.objects, tables.packets, kind.spans]
    inputs += [lidar.width, lanes, touched]
    wp.launch(mark_touched_rays, (2, len(kind), lanes), inputs, device=device, block_dim=lanes)
    times = lidar.times.ravel()
    for view in range(2):
        turns = poses_to_matrices(sensor.at(times)[:, view])
        directions, starts = (
            np.einsum("nij,nj->ni", turns[:, :3, :3], part.reshape(-1, 3)) for part in (lidar.rays, lidar.origins)
        )
        centers = objects.at(times)[:, 1 - view, :, :3]
        radii = np.linalg.norm(boxes, axis=1) / 2
        expected = reference.mark_touched_rays(starts + turns[:, :3, 3], directions, centers, radii)
        bits = touched.numpy()[view].ravel()
        marked = (bits[:, None] >> np.arange(32)) & 1 != 0
        shared = expected[:, :32].copy()
        shared[:, : count - 32] |= expected[:, 32:]
        assert shared.any(axis=0).mean() > 0.3
        assert not (shared & ~marked).any()
        assert marked.mean() < 1.4 * shared.mean()


def emulated(emulator, scene, camera, motion, *, cull_backfaces=False, **more):
    """Return images by the emulator and by single rays, and the fractions of packets that were cast."""
    renderer = wv.Renderer(scene, camera, outputs=IMAGES, cull_backfaces=cull_backfaces)
    caster = renderer._moving_caster()
    caster._packets = EmulatedPackets(emulator, scene, camera, cull_backfaces)
    views = renderer.render(motion, **more)
    rays = wv.render(scene, camera, motion, outputs=IMAGES, caster="rays", cull_backfaces=cull_backfaces, **more)
    return views, rays, caster._packets.cast_share


def share_that_differs(views, rays):
    differ = wrong_depth(views.depth.numpy(), rays.depth.numpy().astype(np.float64))
    for image in ("segmentation", "labels", "faces"):
        differ |= getattr(views, image).numpy() != getattr(rays, image).numpy()
    for image in ("points", "normals"):
        one, other = getattr(views, image).numpy(), getattr(rays, image).numpy()
        differ |= ~np.isclose(one, other, atol=1e-4, equal_nan=True).all(axis=-1)
    return differ.mean()


@pytest.mark.cxx
@pytest.mark.smoke("lidar", "shutter")
@pytest.mark.parametrize("name", ["lidar", "shutter", "fisheye"])
def test_emulated_packets_match_single_rays(name, emulator):
    """A room, and worlds whose objects do not move. All rays are in packets, which the emulator requires."""
    rng, camera = np.random.default_rng(3), sensors()[name]
    rows = np.stack([random_poses(rng, 5, spread=1.5) for _ in range(2)])
    scene = build("cpu", rows[0], movable=True)
    worlds = {"object_poses": rows, "exclude": ["moved_1"], "world_index": [1, 0]}
    for there, motion, more in (
        (wv.scenes.PRESETS["room"].build("cpu"), twist(rng, 2), {"cull_backfaces": True}),
        (scene, path(rng, 2), worlds),
    ):
        views, rays, cast = emulated(emulator, there, camera, motion, **more)
        assert share_that_differs(views, rays) <= 1e-4
        assert cast == [1.0] if name in ("lidar", "shutter") else min(cast, default=1) >= 0


@pytest.mark.cxx
@pytest.mark.parametrize("solids", [False, True], ids=["meshes", "solids"])
def test_emulated_objects_match_single_rays(solids, emulator, monkeypatch):
    """Objects that move, of which one is excluded, or movable solids at rest; one view after the other."""
    monkeypatch.setattr(moving_packets_cuda, "_MAX_TABLE_BYTES", 1)
    rng, lidar = np.random.default_rng(4), spinning(32, 96)
    scene, count = wv.scenes.PRESETS["room"].build("cpu"), 6
    for index in range(count):
        mesh = trimesh.creation.icosphere(2, 0.2) if index % 2 else trimesh.creation.box((0.3, 0.2, 0.5))
        scene.add(wv.scene.solids.sphere(0.3) if solids and index % 2 else mesh, name=f"thing_{index}", movable=True)
    ends = np.stack([random_poses(rng, count, spread=1.5) for _ in range(2)])
    way = Motion.from_twist(ends, rng.normal(size=(2, count, 3)), 3 * rng.normal(size=(2, count, 3)))
    objects = ends if solids else way
    views, rays, cast = emulated(emulator, scene, lidar, twist(rng, 2), object_poses=objects, exclude=["thing_2"])
    assert share_that_differs(views, rays) <= 1e-4
    assert len(np.unique(rays.segmentation.numpy())) > 5
    assert cast == [1.0, 1.0]


@pytest.mark.cxx
@pytest.mark.parametrize("moves", [False, True], ids=["sensor", "objects"])
def test_worlds_that_do_not_exist_are_empty(moves, emulator):
    rng, lidar, scene = (
        np.random.default_rng(5),
        spinning(16, 48),
        build("cpu", random_poses(np.random.default_rng(6), 5), movable=True),
    )
    caster = MovingCaster(scene, lidar, CastOptions())
    caster._packets = EmulatedPackets(emulator, scene, lidar, False)
    rows = random_poses(rng, 5)
    objects = Motion.from_twist(rows, np.ones((5, 3)), np.ones((5, 3))) if moves else rows[None]
    views = caster.parse(twist(rng, 2), objects, None, [0, 0], None, None)
    views.worlds.world = wp.array([0, -1], dtype=wp.int32, device="cpu")
    images = views_for(IMAGES, (2, *lidar.shape), scene.device)
    caster.cast(views, {name: getattr(images, name) for name in IMAGES})
    assert np.isfinite(images.depth.numpy()[0]).any()
    assert np.isposinf(images.depth.numpy()[1]).all()
    assert (images.segmentation.numpy()[1] == -1).all()


@pytest.mark.cxx
def test_packets_that_move_too_far_are_cast_as_single_rays(emulator):
    """By the fast view, every ray; images equal those of single rays bit for bit."""
    scene, lidar = wv.scenes.PRESETS["room"].build("cpu"), spinning(32, 96)
    poses = np.array([[0, 0, 1.0, 0, 0, 0, 1]] * 2)
    views, rays, cast = emulated(emulator, scene, lidar, Motion.from_twist(poses, [[1, 0, 0], [400, 0, 0]], (0, 0, 0)))
    assert cast == [0.5]
    for image in IMAGES:
        np.testing.assert_array_equal(getattr(views, image).numpy()[1], getattr(rays, image).numpy()[1])
    assert share_that_differs(views, rays) <= 1e-4


@pytest.mark.parametrize("moves", [False, True], ids=["sensor", "objects"])
def test_motions_record_into_a_graph(moves, cuda):
    """A replay casts the images of the recorded motion, also after other calls."""
    rng, lidar, count = np.random.default_rng(7), spinning(32, 96), 5
    rows = random_poses(rng, count)
    scene = build(cuda, rows, movable=True)
    objects = Motion.from_twist(rows, np.ones((count, 3)), np.ones((count, 3))) if moves else rows[None]
    caster = wv.Renderer(scene, lidar, outputs=ALL)._moving_caster()
    views, others = (caster.parse(twist(rng, 2), objects, None, None, None, None) for _ in range(2))
    expected, replayed = (views_for(ALL, (2, *lidar.shape), scene.device) for _ in range(2))
    caster.cast(views, {name: getattr(expected, name) for name in ALL})
    with wp.ScopedCapture(cuda, force_module_load=False) as capture:
        caster.cast(views, {name: getattr(replayed, name) for name in ALL})
    scratch = views_for(ALL, (2, *lidar.shape), scene.device)
    caster.cast(others, {name: getattr(scratch, name) for name in ALL})
    wp.capture_launch(capture.graph)
    for name in ALL:
        np.testing.assert_array_equal(getattr(replayed, name).numpy(), getattr(expected, name).numpy())


def test_packets_are_used_where_they_are_faster(monkeypatch):
    """For many rays, or several objects; not for origins far apart, or if most rays are not in packets of neighbors."""
    monkeypatch.undo()
    rng, scene = np.random.default_rng(8), wv.scenes.PRESETS["room"].build("cpu")
    crowd = build("cpu", random_poses(rng, 5), movable=True)
    still = random_poses(rng, 5)
    moving = Motion.from_twist(still, np.ones((5, 3)), np.ones((5, 3)))
    ouster = wv.sensors.lidars.ouster("OS1-128")
    scattered = Rays(sphere_of_rays(3000).reshape(30, 100, 3), times=np.zeros((30, 100)))
    for there, camera, views, objects, expected in (
        (scene, ouster, 31, None, False),
        (scene, ouster, 32, None, True),
        (crowd, ouster, 12, still[None], False),
        (crowd, ouster, 1, moving, True),
        (crowd, wv.sensors.lidars.vlp16(), 1, moving, False),
        (scene, wv.sensors.lidars.hdl64e(), 100, None, False),
        (scene, scattered, 2000, None, False),
    ):
        made = MovingCaster(there, camera, CastOptions()).parse(twist(rng, views), objects, None, None, None, None)
        assert CudaMovingPackets(there, camera, CastOptions()).takes(made) == expected


def test_packets_at_the_seam_of_a_revolution_are_split():
    """Where rows are aligned, first and last columns of a revolution share packets; each ray stays in one packet."""
    lidar = wv.sensors.lidars.ouster("OS1-128", mode="512x10")
    kinds, points = moving_packets_cuda.prepare_moving_packets(lidar, wp.get_device("cpu"))
    (kind,) = kinds
    place, scale = kind.packets.place.numpy(), kind.packets.scale.numpy()
    assert points is None
    assert (np.sort(place[place >= 0]) == np.arange(lidar.height * lidar.width)).all()
    assert ((scale > 0) == (place >= 0)).all()
    spans = np.ptp(kind.spans.numpy(), axis=1)
    assert spans.max() < 4 * np.median(spans)
    assert len(kind) > lidar.height * lidar.width / 256  # some were split
