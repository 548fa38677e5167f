# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Point visibility with packets: partitioning of work, concurrency, and agreement with the ray caster."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import Visibility, scenes
from warpvis.kernels.constants import COUNTER_DONE, COUNTER_NEXT_UNIT
from warpvis.scene import solids
from warpvis.visibility import _point_packets as point_packets

import reference

CAMERA = wv.Camera.from_fov(320, 240, hfov=1.0, near=0.6, far=4.0)


@pytest.fixture(scope="module")
def room():
    """Return a scene with a movable object, poses, and points in the whole scene."""
    preset = scenes.PRESETS["room"]
    scene = preset.build()
    scene.add(trimesh.creation.torus(0.3, 0.1), name="ring", pose=(0.3, 0.2, 0.5, 0, 0, 0, 1), movable=True)
    low, high = scene.bounds
    return scene, preset.poses(9), np.random.default_rng(0).uniform(low, high, (100_000, 3)).astype(np.float32)


def judge(room, count, views=1, **options):
    """Return statuses and occluders as bytes."""
    scene, poses, points = room
    arrays = wv.point_visibility(scene, CAMERA, poses[:views], points[:count], occluders=True, **options)
    return [array.numpy().tobytes() for array in arrays]


@pytest.mark.parametrize(("count", "views"), [(0, 2), (1, 1), (15, 9), (17, 3), (5000, 9), (100_000, 1), (50_000, 2)])
def test_thread_count_does_not_change_results(room, count, views):
    one, two, three = (judge(room, count, views, threads=threads) for threads in (1, 2, 3))
    assert one == two == three
    scene, poses, points = room
    for threads in (1, 2):
        alone = wv.point_visibility(scene, CAMERA, poses[:views], points[:count], threads=threads)
        assert alone.numpy().tobytes() == one[0]


def test_partitioning_does_not_change_results(room, monkeypatch):
    wanted = judge(room, 50_000, 2, threads=2)
    for name, value in (("_MAX_POINTS", 16384), ("_STRIPS", 3), ("_MAX_WHOLE", 0)):
        monkeypatch.setattr(point_packets, name, value)
        assert judge(room, 50_000, 2, threads=2) == wanted
    monkeypatch.setattr(point_packets, "_MAX_WHOLE", 10**6)
    assert judge(room, 50_000, 5, threads=2) == judge(room, 50_000, 5, threads=1)


def test_cell_size_does_not_change_statuses(room, monkeypatch):
    statuses = []
    for scale in (1 / 64, 0.25, 1.0, 4.0):
        monkeypatch.setattr(point_packets, "_scale", lambda *_, scale=scale: scale)
        statuses.append(np.frombuffer(judge(room, 20_000, 2, threads=2)[0], dtype=np.uint8))
    for other in statuses[1:]:
        assert (other != statuses[0]).sum() <= 1


@pytest.mark.parametrize("name", ["experiment_2", "blobs_77k"])
def test_packets_match_ray_caster(name):
    preset = scenes.PRESETS[name]
    scene, rng = preset.build(), np.random.default_rng(1)
    points = rng.uniform(*scene.bounds, (50_000, 3)).astype(np.float32)
    given = (scene, CAMERA, preset.poses(2), points)
    (packets, hides), (rays, hid) = (wv.point_visibility(*given, caster=c, occluders=True) for c in ("packets", "rays"))
    assert (packets.numpy() != rays.numpy()).sum() <= 1
    assert (hides.numpy() != hid.numpy()).mean() <= 1e-4
    assert {Visibility.OUT_OF_VIEW, Visibility.OCCLUDED, Visibility.VISIBLE} <= set(np.unique(packets.numpy()))


def test_occluder_output_does_not_change_statuses(room):
    scene, poses, points = room
    without = wv.point_visibility(scene, CAMERA, poses, points[:20_000], tolerance=0.0).numpy()
    status, occluders = wv.point_visibility(scene, CAMERA, poses, points[:20_000], tolerance=0.0, occluders=True)
    assert (status.numpy() == without).all()
    assert ((occluders.numpy() >= 0) == (without == Visibility.OCCLUDED)).all()


@pytest.mark.parametrize("offset", [0.0, 1e-6, 1e-4])
def test_statuses_are_exact_near_surfaces(offset):
    """Points on a ball, or slightly in front of or behind it, which single precision cannot always distinguish."""
    rng, scene = np.random.default_rng(5), wv.Scene()
    scene.add(trimesh.creation.icosphere(subdivisions=2, radius=2.0), name="ball", pose=(5, 0, 0, 0, 0, 0, 1))
    pose, camera = wv.look_at((0, 0, 0), (1, 0.1, 0)).astype(np.float32), wv.Camera.from_fov(320, 240, hfov=0.8)
    corners = scene["ball"].vertices[scene["ball"].faces].astype(np.float64)
    shares = rng.dirichlet((1, 1, 1), 5000)
    points = np.einsum("nc,ncx->nx", shares, corners[rng.integers(0, len(corners), 5000)])
    points *= 1 + rng.choice([-offset, offset], (5000, 1))
    points = points.astype(np.float32)
    for tolerance in (0.0, offset):
        expected, _, margin = reference.judge_points(scene, camera, pose, points, tolerance)
        status = wv.point_visibility(scene, camera, pose, points, tolerance=tolerance).numpy()[0]
        assert (status == expected)[margin > 1e-12].all()
        first = wv.point_visibility(scene, camera, pose, points, tolerance=tolerance, occluders=True)[0].numpy()[0]
        assert (first == status).all()


def test_solids_occlude_points(room):
    scene = wv.Scene()
    scene.add(solids.sphere(0.5), name="ball", pose=(2, 0, 0, 0, 0, 0, 1), movable=True)
    points = [(3, 0, 0), (3, 0.7, 0), (3, 0.8, 0), (1.6, 0, 0), (1.49, 0, 0)]
    status = wv.point_visibility(scene, CAMERA, wv.look_at((0, 0, 0), (1, 0, 0)), points).numpy()[0]
    behind, seen = int(Visibility.OCCLUDED), int(Visibility.VISIBLE)
    assert status.tolist() == [behind, behind, seen, behind, seen]  # the limit is at 3 * 0.5 / sqrt(2^2 - 0.5^2)


def test_nearest_of_several_occluders_is_returned():
    """A wall, and behind it a slope that extends behind the camera, whose depth needs double precision."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((0.2, 1, 1)), name="wall", pose=(2, 0, 0, 0, 0, 0, 1))
    slope = np.array([(3, -50, 0), (3, 50, 0), (-97, 0, 50)]), np.array([(0, 1, 2)])  # x = 3 - 2 z
    scene.add(slope, name="slope", movable=True)
    points = np.array([(3.5, y, 0.02) for y in np.linspace(-0.8, 0.8, 33)])
    status, occluders = wv.point_visibility(scene, CAMERA, wv.look_at((0, 0, 0), (1, 0, 0)), points, occluders=True)
    assert (status.numpy() == Visibility.OCCLUDED).all()
    assert occluders.numpy()[0].tolist() == [0] * 33


def test_concurrent_callers_get_equal_results(room):
    wanted = [judge(room, count) for count in (1000, 20_000, 1000, 20_000)]
    with ThreadPoolExecutor(4) as pool:
        for _ in range(3):
            found = pool.map(lambda count: judge(room, count), (1000, 20_000, 1000, 20_000))
            assert list(found) == wanted


def test_scene_changes_affect_visibility(room):
    scene = wv.Scene()
    scene.add(trimesh.creation.box((0.2, 1, 1)), name="wall", pose=(2, 0, 0, 0, 0, 0, 1), movable=True)
    pose, points = wv.look_at((0, 0, 0), (1, 0, 0)), [(3, 0, 0), (3, 1.2, 0)]
    assert wv.point_visibility(scene, CAMERA, pose, points).numpy()[0].tolist() == [3, 4]
    scene.update_vertices("wall", scene["wall"].mesh_vertices + [0, 1, 0])
    assert wv.point_visibility(scene, CAMERA, pose, points).numpy()[0].tolist() == [4, 3]
    scene.add(trimesh.creation.box((0.2, 0.1, 0.1)), name="post", pose=(1, 0, 0, 0, 0, 0, 1))
    assert wv.point_visibility(scene, CAMERA, pose, points).numpy()[0].tolist() == [3, 3]


@pytest.mark.parametrize("size", [(1, 1), (7, 5), (4000, 3), (3, 4000)])
def test_unusual_image_sizes_match_ray_caster(size):
    preset = scenes.PRESETS["room"]
    scene, camera = preset.build(), wv.Camera(*size, 0.9 * size[0], 0.9 * size[1], size[0] / 2, size[1] / 2)
    points = np.random.default_rng(2).uniform(*scene.bounds, (20_000, 3)).astype(np.float32)
    packets, rays = (wv.point_visibility(scene, camera, preset.poses(2), points, caster=c) for c in ("packets", "rays"))
    assert (packets.numpy() != rays.numpy()).sum() <= 1


def test_waiting_worker_returns_instead_of_spinning(room, monkeypatch):
    """The first strip waits for a chunk that was claimed but is never completed: workers must return, not spin."""
    held = []
    monkeypatch.setattr(point_packets, "run_together", lambda work, *_: held.append(work))
    judge(room, 5000, threads=2)  # one chunk, then strips
    launch, counter, units, _ = held[0].args
    launch.launch()  # so that the points of the chunk are binned
    counter[:] = 0
    counter[COUNTER_NEXT_UNIT] = 1
    worker = threading.Thread(target=launch.launch, daemon=True)
    worker.start()
    worker.join(20)
    assert not worker.is_alive()
    assert counter.tolist() == [1, 0, 0, 0]  # the strip is unclaimed, and no worker is active
    counter[COUNTER_DONE] = 1
    launch.launch()
    assert counter.tolist() == [units, 1, 1, units]


def test_idle_workers_sleep_and_resume(room, monkeypatch):
    """While one of eight workers is busy, the others sleep, then take the remaining work."""
    launches, lock = [], threading.Lock()

    class OneChunk:
        def __init__(self, launch, counter):
            self.launch_now, self.counter = launch.launch, counter

        def launch(self):
            with lock:
                launches.append(threading.get_ident())
                first = len(launches) == 1
            if first:  # has claimed the chunk, and is slow
                self.counter[COUNTER_NEXT_UNIT] = 1
                time.sleep(0.3)
                self.counter[COUNTER_NEXT_UNIT] = 0
            self.launch_now()

    run_together = point_packets.run_together

    def together(work, workers, all_finished):
        launch, counter, units, event = work.args
        run_together(partial(work.func, OneChunk(launch, counter), counter, units, event), workers, all_finished)

    wanted = judge(room, 5000, threads=1)
    monkeypatch.setattr(point_packets, "run_together", together)
    assert judge(room, 5000, threads=8) == wanted
    most = 8 * (0.3 / point_packets._LONGEST_PAUSE + 20)
    assert 8 < len(launches) < most  # workers returned after pauses
