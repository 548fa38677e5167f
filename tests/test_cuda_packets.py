# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The CUDA packet caster: packet sizes, split batches, streams and graphs."""

from typing import NamedTuple

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis import scenes
from warpvis.rendering.casters import packed_launch_cuda, packets_cuda
from warpvis.rendering.casters.base import CastOptions, ViewBatch
from warpvis.rendering.casters.packets_cuda import CudaPacketsCaster, packet_side
from warpvis.scene.worlds import parse_worlds

from compare import assert_matches_reference
from support.worlds import random_poses

ALL = ("depth", "points", "normals", "labels", "segmentation")


def assert_identical(one, other):
    for name in ALL:
        image = getattr(one, name)
        if image is not None:
            assert image.numpy().tobytes() == getattr(other, name).numpy().tobytes(), name


class Recorded(NamedTuple):
    """Stand-in for a recorded launch that notes when it is launched."""

    launched: list
    what: object

    def launch(self):
        self.launched.append(self.what)


def test_packet_side_by_number_of_pixels():
    """There are enough packets for every multiprocessor, and they are as large as that allows."""
    assert packet_side(512, 320, 240, 132) == 32
    assert packet_side(8192, 64, 64, 132) == 32
    assert [packet_side(views, 64, 64, 132) for views in (1, 2, 3, 12, 13, 65, 66)] == [1, 1, 2, 2, 4, 4, 8]
    assert [packet_side(views, 64, 64, 132, moving=True) for views in (1, 32, 33)] == [4, 4, 8]
    assert [packet_side(512, 64, 64, 132, least) for least in (64, 12)] == [16, 32]
    sides = [packet_side(views, 640, 480, 132) for views in range(1, 64)]
    assert sides == sorted(sides)


def test_launched_kernels_and_sizes(monkeypatch):
    """The kernel of the requested outputs is launched with 32 threads per packet, and never for zero views."""
    scene, camera, launched = scenes.PRESETS["room"].build("cpu"), wv.Camera.from_fov(100, 40, hfov=1.0), []
    scene.bvh()  # building trees launches kernels too
    monkeypatch.setattr(packets_cuda, "_kernel", lambda *key: key)
    monkeypatch.setattr(packed_launch_cuda, "launch", lambda kernel, dim, *_, **__: Recorded(launched, (kernel, dim)))
    depth, ids = wp.zeros((3, 40, 100)), wp.zeros((3, 40, 100), dtype=wp.int32)
    worlds, poses = parse_worlds(scene, 3, None, None, None), wp.zeros(3, dtype=wp.transform)
    for clip_near in (False, True):
        caster = CudaPacketsCaster(scene, camera, CastOptions(clip_near=clip_near))
        caster.cast(ViewBatch(poses, worlds), {"depth": depth})
        caster.cast(ViewBatch(poses, worlds), {"depth": depth, "segmentation": ids})
        caster.cast(ViewBatch(wp.zeros(0, dtype=wp.transform), worlds), {})
    size = (2, 3, 4, 32)  # packet rows of all views in sequence
    assert launched == [((32, ids, False, clip, False), size) for clip in (False, True) for ids in (False, True)]


def test_launched_kernel_with_object_scales(monkeypatch):
    """The kernel with scale support is used only if scales are given."""
    scene, camera, launched = wv.Scene(), wv.Camera.from_fov(100, 40, hfov=1.0), []
    scene.add(trimesh.creation.box(), movable=True)
    scene.bvh()
    monkeypatch.setattr(packets_cuda, "_kernel", lambda *key: key)
    monkeypatch.setattr(packed_launch_cuda, "launch", lambda kernel, *_, **__: Recorded(launched, kernel[2:]))
    caster = CudaPacketsCaster(scene, camera, CastOptions())
    for scales in (None, np.ones((1, 1, 3))):
        worlds = parse_worlds(scene, 1, None, None, None, scales)
        views = ViewBatch(wp.zeros(1, dtype=wp.transform), worlds)
        caster.cast(views, {"depth": wp.zeros((1, 40, 100))})
    assert launched == [(True, False, False), (True, False, True)]


@pytest.mark.parametrize("name", ["room", "blobs_77k"])
@pytest.mark.parametrize("outputs", [("depth",), ALL])
def test_images_do_not_depend_on_the_packet_size(name, outputs, cuda, monkeypatch):
    preset = scenes.PRESETS[name]
    scene = preset.build(cuda)
    camera = wv.Camera.from_fov(133, 77, hfov=0.994837, near=0.05, far=4.0)
    images = []
    for side in (32, 16, 8, 4, 2, 1):
        monkeypatch.setattr("warpvis.rendering.casters.packets_cuda.packet_side", lambda *_, side=side, **__: side)
        images.append(wv.render(scene, camera, preset.poses(3), outputs=outputs))
    for other in images[1:]:
        assert_identical(images[0], other)


def test_depth_does_not_depend_on_other_outputs(cuda):
    preset = scenes.PRESETS["blobs_77k"]
    scene = preset.build(cuda)
    alone = wv.render(scene, preset.camera, preset.poses(4), outputs="depth")
    with_all = wv.render(scene, preset.camera, preset.poses(4), outputs=ALL)
    assert alone.depth.numpy().tobytes() == with_all.depth.numpy().tobytes()
    for name in ALL[1:]:
        one = wv.render(scene, preset.camera, preset.poses(4), outputs=name)
        assert getattr(one, name).numpy().tobytes() == getattr(with_all, name).numpy().tobytes()


@pytest.mark.parametrize("movable", [True, False])
@pytest.mark.parametrize("scales", [False, True])
def test_found_objects_do_not_change_images(movable, scales, cuda, monkeypatch):
    """Bit-identical to testing all objects in every packet: movable objects and instances, in several worlds."""
    rng, count = np.random.default_rng(0), 900
    scene = wv.Scene(device=cuda)
    for index in range(3):  # around a camera, and covering many tiles
        scene.add(trimesh.creation.box((1, 2, 3)), pose=(9 * index, 0, 0, 0, 0, 0, 1), movable=True)
    scene.add_instances(trimesh.creation.icosphere(3, 0.3), random_poses(rng, count, spread=20.0), movable=movable)
    camera = wv.Camera.from_fov(133, 77, hfov=1.2, near=0.05, far=30.0)
    rows = np.repeat(scene.movable_poses().numpy(), 2, axis=0).astype(np.float32)
    rows[1, :, :3] += 0.5
    options = {"object_poses": rows, "world_index": [0, 1, 1]}
    if scales:
        options["object_scales"] = rng.uniform(0.7, 1.4, (2, len(scene.movable), 3))
    # Two cameras that look at many objects, and one inside a box.
    poses = [wv.look_at((-15, -12, 6), (0, 0, 0)), wv.look_at((4, 16, -8), (0, 0, 0)), [9.5, 0, 0, 0, 0, 0, 1]]
    poses = np.array(poses, dtype=np.float32)
    renderer = wv.Renderer(scene, camera, outputs=ALL)
    seen = renderer.render(poses, **options).segmentation.numpy()
    options["exclude"] = [seen[0].max(), seen[1].max(), 5]
    found = renderer.render(poses, **options)
    seen = found.segmentation.numpy()
    for view in range(2):
        assert len(np.unique(seen[view])) > 100
        assert options["exclude"][view] not in seen[view]
    assert (seen[2] == 1).all()
    monkeypatch.setattr("warpvis.rendering.casters.packets_cuda.MANY_OBJECTS", 10_000)
    assert_identical(found, renderer.render(poses, **options))


def test_captured_graph_finds_objects_at_launch(cuda):
    """Objects are found at their poses at launch time."""
    scene = wv.Scene(device=cuda)
    scene.add_instances(trimesh.creation.box((0.1, 0.1, 0.1)), np.zeros((300, 7)) + [0, 0, 0, 0, 0, 0, 1], movable=True)
    camera = wv.Camera.from_fov(64, 48, hfov=1.0)
    rows = [random_poses(np.random.default_rng(seed), 1, 300).astype(np.float32) for seed in range(2)]
    poses = wp.array(wv.look_at((0, -5, 0), (0, 0, 0))[None].astype(np.float32), dtype=wp.transform, device=cuda)
    places = wp.array(rows[0], dtype=wp.transform, device=cuda)
    renderer = wv.Renderer(scene, camera, outputs="depth")
    expected = [renderer.render(poses, object_poses=row).depth.numpy() for row in rows]
    assert (expected[0] != expected[1]).any()
    out = renderer.render(poses, object_poses=places)
    with wp.ScopedCapture(cuda) as capture:
        renderer.render(poses, object_poses=places, out=out)
    for row, depth in zip(rows[::-1], expected[::-1], strict=True):
        places.assign(wp.array(row, dtype=wp.transform, device=cuda))
        wp.capture_launch(capture.graph)
        assert (out.depth.numpy() == depth).all()


def test_runs_are_bit_identical(cuda):
    preset = scenes.PRESETS["blobs_1m"]
    renderer = wv.Renderer(preset.build(cuda), preset.camera, outputs=ALL)
    first = renderer.render(preset.poses(16))
    for _ in range(3):
        assert_identical(first, renderer.render(preset.poses(16)))


@pytest.mark.parametrize("size", [(1, 1), (7, 3), (33, 31), (640, 1)])
def test_images_smaller_than_packets(size, cuda):
    preset = scenes.PRESETS["room"]
    scene = preset.build(cuda)
    camera = wv.Camera.from_fov(*size, hfov=0.5, near=0.05, far=100.0)
    views = wv.render(scene, camera, preset.poses(2), outputs=ALL)
    assert_matches_reference(views, scene, camera, preset.poses(2))


def test_telephoto_camera_far_from_the_origin(cuda):
    """A focal length of 4,000 px, and a camera 14 km from the origin."""
    scene = wv.Scene(device=cuda)
    room = scenes.PRESETS["room"].build()
    for item in room:
        scene.add((item.vertices + [10_000, -10_000, 0], item.faces), name=item.name, label=item.label)
    eye = np.array([9_800, -10_000, 20])
    pose = wv.look_at(eye, (10_000.8, -10_000, 0.4))[None].astype(np.float32)
    camera = wv.Camera(96, 72, 4_000.0, 4_000.0, 48.0, 36.0, near=0.05, far=1000.0)
    views = wv.render(scene, camera, pose, outputs=ALL)
    assert (views.segmentation.numpy() >= 0).any()
    assert_matches_reference(views, scene, camera, pose)


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_split_batch_is_the_same(cuda, caster):
    """Seven views rendered in chunks of three: the images are on the host and equal those of a single batch."""
    preset = scenes.PRESETS["room"]
    scene = preset.build(cuda)
    whole = wv.Renderer(scene, preset.camera, outputs=ALL, caster=caster).render(preset.poses(7))
    assert whole.depth.device.is_cuda
    three_views = 3 * 320 * 240 * (4 + 12 + 12 + 1 + 4) + 1000
    renderer = wv.Renderer(scene, preset.camera, outputs=ALL, caster=caster, device_bytes=three_views)
    parts = renderer.render(preset.poses(7))
    assert parts.depth.device.is_cpu
    assert_identical(whole, parts)
    again = renderer.render(preset.poses(14)[7:], out=parts)
    assert again is parts
    assert_identical(wv.render(scene, preset.camera, preset.poses(14)[7:], outputs=ALL, caster=caster), parts)


def test_view_larger_than_device_bytes_is_rendered(cuda):
    preset = scenes.PRESETS["room"]
    renderer = wv.Renderer(preset.build(cuda), preset.camera, device_bytes=1)
    assert np.isfinite(renderer.render(preset.poses(2)).depth.numpy()).any()
    assert renderer.render(np.zeros((0, 7), dtype=np.float32)).depth.shape == (0, 240, 320)


def test_host_outputs_are_written(cuda):
    preset = scenes.PRESETS["room"]
    expected = wv.render(preset.build(cuda), preset.camera, preset.poses(2), outputs=("depth", "labels"))
    out = wv.Views(
        depth=wp.empty((2, 240, 320), dtype=wp.float32, device="cpu"),
        labels=wp.empty((2, 240, 320), dtype=wp.uint8, device="cpu"),
    )
    wv.render(preset.build(cuda), preset.camera, preset.poses(2), outputs=("depth", "labels"), out=out)
    assert_identical(expected, out)
    out.labels = out.labels.to(cuda)
    with pytest.raises(wv.errors.ArrayError, match=r"out\.depth must be on device cuda:0, got cpu"):
        wv.render(preset.build(cuda), preset.camera, preset.poses(2), outputs=("depth", "labels"), out=out)


def test_work_runs_on_the_callers_stream(cuda):
    preset = scenes.PRESETS["blobs_77k"]
    renderer = wv.Renderer(preset.build(cuda), preset.camera, outputs="depth")
    poses = wp.array(preset.poses(256), dtype=wp.transform, device=cuda)
    expected = renderer.render(poses).depth.numpy()
    out = wv.Views(depth=wp.zeros((256, 240, 320), dtype=wp.float32, device=cuda))
    stream = wp.Stream(cuda)
    with wp.ScopedStream(stream):
        renderer.render(poses, out=out)
        copied = wp.empty_like(out.depth)
        wp.copy(copied, out.depth)
    wp.synchronize_stream(stream)
    np.testing.assert_array_equal(copied.numpy(), expected)


def test_invalid_poses_render_nothing(cuda):
    """Poses on a GPU are not validated: NaNs and invalid rotations must be harmless."""
    preset = scenes.PRESETS["room"]
    rows = preset.poses(4)
    rows[1], rows[2, 3:], rows[3, 0] = np.nan, 0.0, np.inf
    renderer = wv.Renderer(preset.build(cuda), preset.camera, outputs=ALL)
    views = renderer.render(wp.array(rows, dtype=wp.transform, device=cuda))
    assert np.isfinite(views.depth.numpy()[0]).any()
    assert (views.segmentation.numpy()[1:] == -1).all()
    assert np.isinf(views.depth.numpy()[1:]).all()
