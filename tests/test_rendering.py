# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of `Renderer` apart from its casters: batches in parts, placement of images, loading of modules, buffers."""

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
import warp as wp
from pose_samples import unit

import warpvis as wv
from warpvis.core import threads

OUTPUTS = ("depth", "points", "normals", "labels", "segmentation")
CAMERA = wv.Camera.from_fov(20, 12, hfov=1.2)
BYTES_PER_VIEW = 20 * 12 * (4 + 12 + 12 + 1 + 4)
VIEWS = 5


def movable_boxes() -> wv.Scene:
    scene = wv.Scene(device="cpu")
    scene.add(trimesh.creation.box((4, 4, 0.02)), name="floor", label="ground")
    for index in range(3):
        scene.add(trimesh.creation.box((0.5, 0.4, 0.3)), name=f"box_{index}", movable=True, pose=(0, 0, 1, 0, 0, 0, 1))
    return scene


def poses_of_worlds(count: int) -> np.ndarray:
    rng = np.random.default_rng(count)
    return np.array([[unit((*rng.uniform(-1, 1, 3), *rng.normal(size=4))) for _ in range(3)] for _ in range(count)])


def cameras() -> np.ndarray:
    return np.array([wv.look_at((2.5 * np.cos(a), 2.5 * np.sin(a), 1.0), (0, 0, 0)) for a in range(VIEWS)])


ARRANGEMENTS = {
    "one world": {},
    "each view its own": {"object_poses": poses_of_worlds(VIEWS)},
    "worlds by index": {"object_poses": poses_of_worlds(3), "world_index": np.array([2, 0, 1, 1, 2], dtype=np.int32)},
    "left out of all views": {"exclude": ["box_1"]},
    "left out of some views": {"exclude": np.random.default_rng(1).integers(0, 2, (VIEWS, 4)).astype(np.uint8)},
}


@pytest.mark.parametrize("caster", ["packets", "rays"])
@pytest.mark.parametrize("views_at_a_time", [0.5, 1, 2, 3.7, 5, 100])
@pytest.mark.parametrize("name", ARRANGEMENTS)
def test_rendering_in_parts_equals_rendering_at_once(monkeypatch, name, views_at_a_time, caster):
    """A GPU renders in parts that fit its memory; simulate this on the CPU, which has no stream."""
    device_bytes = int(views_at_a_time * BYTES_PER_VIEW)
    renderer = wv.Renderer(movable_boxes(), CAMERA, outputs=OUTPUTS, caster=caster, device_bytes=device_bytes)
    expected = renderer.render(cameras(), **ARRANGEMENTS[name])
    sizes, cast = [], renderer._caster.cast
    monkeypatch.setattr(renderer._caster, "cast", lambda part, *others: (sizes.append(part.count), cast(part, *others)))
    monkeypatch.setattr(renderer, "_on_host", lambda shape, out: True)
    monkeypatch.setattr(type(wp.get_device("cpu")), "stream", property(lambda device: None))
    monkeypatch.setattr(wp, "synchronize_stream", lambda stream: None)
    got = renderer.render(cameras(), **ARRANGEMENTS[name])
    for output in OUTPUTS:
        np.testing.assert_array_equal(getattr(got, output).numpy(), getattr(expected, output).numpy(), err_msg=output)
    step = max(1, min(int(views_at_a_time), VIEWS))
    assert sizes == [min(step, VIEWS - first) for first in range(0, VIEWS, step)]


def test_images_beyond_device_bytes_go_to_host():
    """Images larger than `device_bytes`, and images for which the caller passes a Warp array on the host."""
    on_host, on_gpu = wp.zeros((1, 12, 20), device="cpu"), SimpleNamespace(is_cpu=False)
    renderer = SimpleNamespace(scene=SimpleNamespace(device=on_gpu), _outputs=("depth",), device_bytes=1000)
    renderer._bytes_per_pixel = lambda: 4
    decide = wv.Renderer._on_host
    assert decide(renderer, (1, 10, 25), None) is False
    assert decide(renderer, (1, 10, 26), None) is True
    assert decide(renderer, (1, 12, 20), wv.Views(depth=on_host)) is True
    assert decide(renderer, (1, 12, 20), wv.Views()) is False
    assert decide(renderer, (1, 12, 20), wv.Views(depth=np.zeros((1, 12, 20)))) is False


def test_modules_are_loaded_before_launch(monkeypatch):
    """Two threads must not load a module at once: `load_module` holds a lock, a launch does not."""
    steps = []
    load, launch = threads.load_module, wp.launch
    monkeypatch.setattr(threads, "load_module", lambda kernel: (steps.append("load"), load(kernel)))
    monkeypatch.setattr(wp, "launch", lambda *inputs, **options: (steps.append("pack"), launch(*inputs, **options))[1])
    scene = movable_boxes()
    scene.bvh()  # launches kernels itself
    steps.clear()
    renderer = wv.Renderer(scene, CAMERA, threads=1)  # the number of threads adapts to measured times
    for _ in range(3):
        renderer.render(cameras())
    assert steps == ["load", "pack"]


def test_jobs_are_reused(monkeypatch):
    made = []
    renderer = wv.Renderer(movable_boxes(), CAMERA, threads=1)
    make = renderer._caster._make_strips
    monkeypatch.setattr(renderer._caster, "_make_strips", lambda *key: (made.append(key), make(*key))[1])
    for _ in range(3):
        renderer.render(cameras())
    assert len(made) == 1
    renderer.render(cameras()[:2])
    assert len(made) == 2
