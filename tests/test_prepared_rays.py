# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Data prepared from a camera's rays is computed once for all calls and threads, and lives as long as the camera."""

import copy
import dataclasses
import gc
import pickle
import threading
import time
import weakref

import numpy as np
import pytest

import warpvis as wv
from warpvis.cameras import LensCamera, Rays, lenses
from warpvis.cameras.rays import OnceCache
from warpvis.rendering.casters import ray_bundles_cpu

from support.worlds import ALL, assert_bits_equal

POSE = wv.look_at((0.1, 0.2, 0.9), (0.5, 0.4, 0.3))


@pytest.fixture
def made(monkeypatch):
    """Return weak references to data prepared for packets."""
    found, prepare = [], ray_bundles_cpu.prepare_rays

    def note(rays):
        prepared = prepare(rays)
        found.append(weakref.ref(prepared))
        time.sleep(0.05)  # long enough for concurrent requests
        return prepared

    monkeypatch.setattr(ray_bundles_cpu, "prepare_rays", note)
    return found


def lidar():
    directions = np.random.default_rng(0).normal(size=(20, 30, 3))
    return Rays(directions / np.linalg.norm(directions, axis=-1, keepdims=True), far=9.0)


def lens_camera(lens=None, **options):
    return LensCamera(lens or lenses.KannalaBrandt(30, 30, 32, 24, (0.01, 0, 0, 0)), 64, 48, **options)


@pytest.mark.parametrize("make", [lidar, lens_camera])
def test_rays_are_prepared_once_per_camera(make, made):
    scene, camera = wv.scenes.PRESETS["room"].build(), make()
    first = wv.render(scene, camera, POSE, outputs=ALL)
    assert len(made) == 1
    assert_bits_equal(first, wv.render(scene, camera, POSE, outputs=ALL))
    other = wv.scenes.PRESETS["experiment_1"].build()
    for renderer in (wv.Renderer(other, camera), wv.Renderer(scene, camera, near_plane="clip")):
        renderer.render([POSE, POSE])
    assert len(made) == 1
    assert_bits_equal(first, wv.render(scene, make(), POSE, outputs=ALL))
    assert len(made) == 2


def test_lens_cameras_of_different_range_share_rays(made):
    """Other functions create such cameras in every call."""
    scene, camera = wv.scenes.PRESETS["room"].build(), lens_camera(near=0.2, far=5.0)
    wv.render(scene, camera, POSE)
    for _ in range(2):
        wv.object_visibility(scene, camera, POSE)
        wv.render(scene, dataclasses.replace(camera, near=0.0), POSE)
    assert len(made) == 1
    wv.render(scene, dataclasses.replace(camera, width=32), POSE)
    wv.render(scene, dataclasses.replace(camera, kind="range"), POSE)
    assert len(made) == 3


def test_shared_rays_respect_range_of_each_camera():
    scene, camera = wv.scenes.PRESETS["room"].build(), lens_camera()
    everything = wv.render(scene, camera, POSE, outputs="depth").depth.numpy()
    middle = float(np.median(everything[np.isfinite(everything)]))
    for near, far in ((0.0, middle), (middle, np.inf), (0.0, np.inf)):
        seen = wv.render(scene, dataclasses.replace(camera, near=near, far=far), POSE, outputs="depth").depth.numpy()
        expected = np.where(everything < near, -np.inf, np.where(everything > far, np.inf, everything))
        np.testing.assert_array_equal(seen, expected)


def test_concurrent_threads_prepare_rays_once(made):
    scene, camera = wv.scenes.PRESETS["room"].build(), lidar()
    wv.render(scene, lidar(), POSE, outputs="depth")  # compile kernels and build trees first
    start, seen = threading.Barrier(4), []

    def render():
        start.wait()
        seen.append(wv.render(scene, camera, POSE, outputs="depth", threads=1).depth.numpy())

    threads = [threading.Thread(target=render) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(made) == 2
    assert len(seen) == 4 and all((one == seen[0]).all() for one in seen)


def test_prepared_rays_are_freed_with_the_camera(made):
    """Prepared data is freed even if the scene and the lens are still alive."""
    scene, lens = wv.scenes.PRESETS["room"].build(), lenses.KannalaBrandt(30, 30, 32, 24, (0.01, 0, 0, 0))
    camera, other = lens_camera(lens), lidar()
    renderer = wv.Renderer(scene, camera)
    renderer.render(POSE)
    wv.render(scene, other, POSE)
    del other
    gc.collect()
    assert made[0]() is not None and made[1]() is None
    copied = dataclasses.replace(camera, near=0.1)
    wv.render(scene, copied, POSE)
    del camera, renderer
    gc.collect()
    assert len(made) == 2 and made[0]() is not None
    del copied
    gc.collect()
    assert made[0]() is None


@pytest.mark.parametrize("make", [lidar, lens_camera])
@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda camera: pickle.loads(pickle.dumps(camera))])
def test_copies_do_not_contain_prepared_rays(make, again):
    scene, camera = wv.scenes.PRESETS["room"].build(), make()
    before = len(pickle.dumps(camera))
    first = wv.render(scene, camera, POSE, outputs=ALL)
    wv.render(scene, camera, POSE, outputs=ALL, caster="rays")
    assert len(pickle.dumps(camera)) == before
    assert_bits_equal(first, wv.render(scene, again(camera), POSE, outputs=ALL))


def test_scene_caches_rays_of_last_wide_images(made):
    here = [wv.scenes.PRESETS["room"].build()]

    def render(width, **options):
        return wv.rendering.render_wide(here[0], width, 16, 3.0, POSE, **options).depth.numpy()

    first = render(32)
    np.testing.assert_array_equal(first, render(32))
    assert np.isposinf(render(32, far=float(first.min()))).sum() >= first.size - 1
    assert len(made) == 1
    render(32, projection="spherical")
    render(32)
    assert len(made) == 2
    render(33)
    gc.collect()
    assert [one() is None for one in made] == [True, False, False]
    np.testing.assert_array_equal(first, render(32))
    here.clear()
    gc.collect()
    assert all(one() is None for one in made)


def test_device_rays_are_prepared_once(device):
    scene = wv.scenes.PRESETS["room"].build(device)
    directions = lidar().directions
    camera = Rays(directions, np.zeros_like(directions))
    wv.render(scene, camera, POSE, caster="rays")
    for name in ("rays", "origins"):
        table = camera.prepared((name, scene.device.alias), lambda: pytest.fail("it was not there"))
        np.testing.assert_array_equal(table.numpy(), getattr(camera, name).reshape(-1, 3))


def test_once_cache_retries_after_failure():
    kept = OnceCache()
    with pytest.raises(ZeroDivisionError):
        kept.get("one", lambda: 1 // 0)
    assert kept.get("one", lambda: 1) == 1
    assert kept.get("two", lambda: kept.get("three", lambda: 3) - 1) == 2
