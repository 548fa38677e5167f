# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Features of the packet caster: trees, strips, back faces, sparse points, memory, and instruction sets."""

import os
import subprocess
import sys

import numpy as np
import pytest
import trimesh
import warp as wp
from pose_samples import unit

import warpvis as wv
from warpvis import scenes
from warpvis.core.poses import poses_to_matrices
from warpvis.rendering.casters.packets_cpu import split_rows
from warpvis.scenes import terrain

import reference
from compare import assert_matches_reference, wrong_depth
from support.packets import ALL

SMALL = wv.Camera.from_fov(120, 90, hfov=0.994837, near=0.05, far=100.0)
LEVEL = (0, 0, 0, 0.5, -0.5, 0.5, -0.5)  # at the origin, looking along -x


def assert_same(one, other):
    """Compare two renderings within the bounds that each has against the reference."""
    assert wrong_depth(one.depth.numpy(), other.depth.numpy().astype(np.float64)).mean() <= 1e-5
    if one.segmentation is not None:
        assert (one.segmentation.numpy() != other.segmentation.numpy()).mean() <= 1e-5


@pytest.mark.smoke("*-blobs_77k")
@pytest.mark.parametrize("name", ["blobs_77k", "blobs_1m"])
def test_large_scenes_match_ray_caster(name, device):
    preset = scenes.PRESETS[name]
    scene = preset.build(device)
    packets, rays = (wv.render(scene, preset.camera, preset.poses(3), caster=caster) for caster in ("packets", "rays"))
    assert_same(packets, rays)


@pytest.mark.smoke("*-0", "*-3")
@pytest.mark.parametrize("seed", range(4))
def test_triangles_around_the_camera_match_reference(seed, device):
    """Triangles are in front of the camera, behind it, and intersect its plane."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-1.5, 0.7, (300, 1, 1))
    corners = rng.normal(0, 2, (300, 1, 3)) + size * rng.normal(0, 1, (300, 3, 3))
    scene = wv.Scene(device=device)
    scene.add((corners.reshape(-1, 3), np.arange(900).reshape(-1, 3)), name="soup")
    camera = wv.Camera.from_fov(96, 72, hfov=1.8)
    poses = np.array([wv.look_at((0, 0, 0), rng.normal(size=3)) for _ in range(3)]).astype(np.float32)
    assert_matches_reference(wv.render(scene, camera, poses, outputs=ALL), scene, camera, poses)
    culled = wv.render(scene, camera, poses, outputs=ALL, cull_backfaces=True)
    assert_matches_reference(culled, scene, camera, poses, cull_backfaces=True)


def leaf_by_leaf(vertices, faces, camera, poses, device):
    """Return the depth of a mesh rendered in parts whose trees have one leaf, and so no boxes."""
    nearest = np.full((len(poses), camera.height, camera.width), np.inf, dtype=np.float32)
    for some in np.array_split(faces, -(-len(faces) // 16)):
        alone = wv.Scene(device=device)
        alone.add((vertices, some))
        shown = wv.render(alone, camera, poses, outputs=("depth",), caster="packets").depth.numpy()
        nearest = np.minimum(nearest, shown)
    return nearest


@pytest.mark.parametrize("seed", range(2))
def test_boxes_do_not_hide_triangles(seed, device):
    """Depth is bit-identical without boxes; boxes of triangles smaller than a pixel often miss pixel centers."""
    rng = np.random.default_rng(seed)
    vertices, faces = terrain.ground(31)
    vertices = vertices @ np.linalg.qr(rng.normal(size=(3, 3)))[0] + rng.normal(size=3) * 10.0 ** rng.uniform(0, 4)
    camera = wv.Camera.from_fov(64, 48, hfov=rng.uniform(0.3, 1.5))
    middle = vertices.mean(axis=0)
    away = rng.normal(size=(4, 3))
    away *= 10.0 ** rng.uniform(2.5, 4, (4, 1)) / np.linalg.norm(away, axis=1, keepdims=True)
    poses = np.array([wv.look_at(middle + step, middle + rng.normal(size=3) * 50) for step in away]).astype(np.float32)
    scene = wv.Scene(device=device)
    scene.add((vertices, faces))
    depth = wv.render(scene, camera, poses, outputs=("depth",), caster="packets").depth.numpy()
    assert np.isfinite(depth).mean() > 0.01
    np.testing.assert_array_equal(depth, leaf_by_leaf(vertices, faces, camera, poses, device))


@pytest.mark.smoke("*-turn1")
@pytest.mark.parametrize("turn", [(0, 0, 0, 1), (1, 0, 0, 0), (0.5, -0.5, 0.5, -0.5), (0.5, 0.5, 0.5, 0.5)])
def test_boxes_ending_at_pixel_centers_do_not_hide_triangles(turn, device):
    """Every pixel center coincides with a vertex, and so with edges of boxes."""
    rng = np.random.default_rng(int(10 * sum(turn)))
    scale = 10.0 ** rng.uniform(-1, 1)
    x = np.arange(-12.0, 12.25, 0.5) * scale  # a pixel is 1 m at 100 m, times the scale
    corners = np.stack([*np.meshgrid(x, x, indexing="ij"), np.full((len(x), len(x)), 100.0 * scale)], -1)
    camera = wv.Camera(20, 20, 100.0, 100.0, 10.5, 10.5)
    pose = np.r_[rng.normal(size=3) * 10.0 ** rng.uniform(0, 2), turn].astype(np.float32)[None]
    placed = poses_to_matrices(pose)[0]
    vertices = (corners.reshape(-1, 3) @ placed[:3, :3].T + placed[:3, 3]).astype(np.float32)
    faces = terrain.grid_faces(len(x))
    scene = wv.Scene(device=device)
    scene.add((vertices, faces))
    depth = wv.render(scene, camera, pose, outputs=("depth",), caster="packets").depth.numpy()
    np.testing.assert_array_equal(depth, leaf_by_leaf(vertices, faces, camera, pose, device))
    np.testing.assert_allclose(depth, 100.0 * scale, rtol=1e-4)


@pytest.mark.smoke("*packets*")
def test_culled_back_faces_are_transparent(device, caster):
    """A camera is inside a ball, and another ball is outside: culling makes the first one invisible."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.icosphere(radius=1.0), name="around")
    scene.add(trimesh.creation.icosphere(radius=0.5), name="beyond", pose=(3, 0, 0, 0, 0, 0, 1))
    pose = wv.look_at((0, 0, 0), (1, 0, 0))[None].astype(np.float32)
    both = wv.render(scene, SMALL, pose, outputs=ALL, caster=caster)
    assert (both.segmentation.numpy() == 0).all()
    culled = wv.render(scene, SMALL, pose, outputs=ALL, caster=caster, cull_backfaces=True)
    assert set(np.unique(culled.segmentation.numpy())) == {-1, 1}
    assert_matches_reference(culled, scene, SMALL, pose, cull_backfaces=True)


def test_skipping_back_faces_of_closed_meshes_is_exact(monkeypatch, device):
    """Images are bit-identical from outside and inside closed meshes, inside their boxes, and for intersecting ones."""

    def build():
        scene = scenes.PRESETS["room"].build(device)
        dented = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
        dented.vertices += 0.03 * np.sin(20 * dented.vertices[:, [1, 2, 0]])
        scene.add(dented, name="dented", pose=(0.9, 0.1, 0.4, 0, 0, 0, 1))
        open_box = trimesh.creation.box((0.4, 0.4, 0.4))
        scene.add((open_box.vertices, open_box.faces[2:]), name="open", pose=unit((-0.5, 0, 0.6, 0.1, 0.2, 0.3, 0.9)))
        return scene

    poses = np.concatenate([scenes.PRESETS["room"].poses(8), np.zeros((3, 7), dtype=np.float32)])
    eyes = [(0.9, 0.1, 0.4), (0.9 + 0.29, 0.1 + 0.29, 0.4 + 0.29), (1.5, 0.5, 1.0)]
    poses[8:] = [wv.look_at(eye, (0, 0, 0.3)) for eye in eyes]
    scene = build()
    assert scene.bvh().struct.closed_count == 6  # all except the open box
    lean = wv.render(scene, SMALL, poses, outputs=ALL)
    monkeypatch.setattr("warpvis.scene.acceleration.tree_cache.provably_closed", lambda vertices, faces: False)
    scene = build()
    assert scene.bvh().struct.closed_count == 0
    whole = wv.render(scene, SMALL, poses, outputs=ALL)
    for name in ALL:
        np.testing.assert_array_equal(getattr(lean, name).numpy(), getattr(whole, name).numpy())


@pytest.mark.parametrize("axis", range(3))
def test_front_faces_in_a_long_box_of_mostly_back_faces(axis, device):
    """The bases of two long cones, 2 m apart along their common normal: a camera is in between, off to a side."""
    angle, next_one = np.arange(8) * np.pi / 4, np.roll(np.arange(8), -1)
    ring = np.stack([np.zeros(8), 0.05 * np.cos(angle), 0.05 * np.sin(angle)], axis=1)
    cone = np.concatenate([ring, [(0, 0, 0), (-30, 0, 0)]])
    faces = [(8, k, next_one[k]) for k in range(8)] + [(9, next_one[k], k) for k in range(8)]
    bases = np.array([(-1, 0, 0), (1, 0, 0.12)])
    scene = wv.Scene(device=device)
    for base in bases:
        scene.add((np.roll(cone + base, axis, axis=1), np.array(faces)))
    assert scene.bvh().struct.closed_count == 2
    eye, target, up = np.roll([(-0.7, -1, 0), bases[0], (0, 0, 1)], axis, axis=1)
    pose = wv.look_at(eye, target, up=up)[None].astype(np.float32)
    camera = wv.Camera.from_fov(120, 90, hfov=0.3)
    views = wv.render(scene, camera, pose, outputs=ALL)
    toward = np.nan_to_num(views.normals.numpy()[0, ..., axis])
    assert (toward > 0.99).sum() > 200
    assert_matches_reference(views, scene, camera, pose)


@pytest.mark.slow
def test_million_triangles_in_one_pixel(device):
    """A finely meshed ball, much smaller than a pixel, is exactly at the pixel center."""
    ball = trimesh.creation.icosphere(subdivisions=8, radius=0.1)
    assert len(ball.faces) > 1_000_000
    scene = wv.Scene(device=device)
    scene.add(ball, pose=(1000, 0, 0, 0, 0, 0, 1))
    camera = wv.Camera.from_fov(65, 49, hfov=0.99)
    depth = wv.render(scene, camera, wv.look_at((0, 0, 0), (1, 0, 0))).depth.numpy()[0]
    assert depth[24, 32] == pytest.approx(999.9, abs=1e-3)
    assert np.isinf(np.delete(depth.ravel(), 24 * 65 + 32)).all()


@pytest.mark.slow
def test_large_image_matches_ray_caster(device):
    """4096 x 4096 pixels of the room are compared with the ray caster."""
    preset = scenes.PRESETS["room"]
    camera = wv.Camera.from_fov(4096, 4096, hfov=0.994837, near=0.05, far=100.0)
    packets, rays = (
        wv.render(preset.build(device), camera, preset.poses(1), caster=caster, outputs=("depth", "segmentation"))
        for caster in ("packets", "rays")
    )
    assert_same(packets, rays)


def test_triangle_that_covers_the_image(device):
    scene = wv.Scene(device=device)
    scene.add((np.array([[5, -1e4, -1e4], [5, 1e4, -1e4], [5, 0, 1e4]]), np.array([[0, 1, 2]])))
    depth = wv.render(scene, wv.Camera.from_fov(333, 217, hfov=1.0), wv.look_at((0, 0, 0), (1, 0, 0))).depth.numpy()
    np.testing.assert_allclose(depth, 5.0, rtol=3e-7)


def test_deep_trees_do_not_overflow(device):
    """Size and distance of triangles double, which yields a tree of maximum depth."""
    size = 2.0 ** np.linspace(-30, 30, 20_000)[:, None, None]
    corners = size * np.array([[[1, -0.1, -0.1], [1, 0.1, -0.1], [1, 0, 0.1]]])
    scene = wv.Scene(device=device)
    scene.add((corners.reshape(-1, 3), np.arange(60_000).reshape(-1, 3)))
    pose = wv.look_at((0, 0, 0), (1, 0, 0))
    camera = wv.Camera.from_fov(64, 48, hfov=0.4)
    packets, rays = (wv.render(scene, camera, pose, caster=caster) for caster in ("packets", "rays"))
    assert np.isfinite(packets.depth.numpy()).any()
    assert_same(packets, rays)


def test_one_view_in_strips_is_bit_identical():
    preset = scenes.PRESETS["room"]
    scene = preset.build()
    for size in ((640, 480), (123, 77)):
        camera = wv.Camera.from_fov(*size, hfov=0.994837, near=0.05, far=100.0)
        first = wv.render(scene, camera, preset.poses(1), outputs=ALL, threads=1)
        for threads in (2, 3, 7):
            again = wv.render(scene, camera, preset.poses(1), outputs=ALL, threads=threads)
            for name in ALL:
                assert getattr(again, name).numpy().tobytes() == getattr(first, name).numpy().tobytes()


@pytest.mark.parametrize("shape", [(1, 480), (1, 1), (3, 240), (100, 240), (1, 17)])
@pytest.mark.parametrize("threads", [1, 2, 8])
def test_strips_cover_the_image(shape, threads):
    views, height = shape
    rows = split_rows(views, height, threads)
    assert rows[0] == 0 and rows[-1] == height
    assert (np.diff(rows) > 0).all()
    assert (rows[:-1] % 16 == 0).all()
    assert views * (len(rows) - 1) >= min(threads, -(-height // 16))


def test_strips_shrink_with_remaining_rows():
    """For two threads, each strip is a quarter of the remaining rows, in whole tiles, so threads finish together."""
    assert split_rows(1, 480, 2).tolist() == [0, 128, 224, 288, 336, 384, 416, 432, 448, 464, 480]


def test_output_arrays_may_be_unaligned():
    """Images at unaligned addresses and of odd widths are written completely, and nothing outside of them."""
    preset = scenes.PRESETS["room"]
    scene = preset.build()
    for width in (77, 80):
        camera = wv.Camera.from_fov(width, 33, hfov=0.99)
        expected = wv.render(scene, camera, preset.poses(2), outputs=ALL)
        memory, images = {}, {}
        for name in ALL:
            array = getattr(expected, name)
            size = array.numpy().nbytes
            item = array.numpy().dtype.itemsize
            memory[name] = np.full(size + 64 + 4 * item, 0xA5, dtype=np.uint8)
            start = -memory[name].ctypes.data % 64 + item  # one element past a cache line
            host = memory[name][start : start + size].view(array.numpy().dtype).reshape(array.numpy().shape)
            images[name] = wp.array(host, dtype=array.dtype, shape=array.shape, device="cpu", copy=False)
        wv.Renderer(scene, camera, outputs=ALL).render(preset.poses(2), out=wv.Views(**images))
        for name in ALL:
            np.testing.assert_array_equal(images[name].numpy(), getattr(expected, name).numpy())
            written = memory[name].size - images[name].numpy().nbytes
            assert (memory[name] == 0xA5).sum() >= written
            assert (memory[name][-3 * images[name].numpy().dtype.itemsize - 1 :] == 0xA5).all()


@pytest.mark.smoke("*-experiment_3")
@pytest.mark.parametrize("name", ["experiment_3", "room"])
@pytest.mark.parametrize("cull_backfaces", [False, True])
def test_image_points_match_reference(name, cull_backfaces, device, caster):
    preset = scenes.PRESETS[name]
    scene = preset.build(device)
    camera = wv.Camera.from_fov(160, 120, hfov=0.994837, near=0.3, far=4.5)
    rng = np.random.default_rng(0)
    pixels = rng.uniform((-4, -4), (164, 124), (2, 3000, 2)).astype(np.float32)
    pixels[:, 0] = np.nan
    pixels[:, 1:500] = pixels[:, 500:501]  # many points at one position
    renderer = wv.Renderer(scene, camera, outputs=ALL, caster=caster, cull_backfaces=cull_backfaces)
    views = renderer.render_at(preset.poses(2), pixels)
    assert views.depth.shape == (2, 3000)
    for view, pose in enumerate(preset.poses(2)):
        expected = reference.cast_rays_at(scene, camera, pose, pixels[view], cull_backfaces=cull_backfaces)
        wrong = wrong_depth(views.depth.numpy()[view], expected.depth)
        assert wrong.mean() <= 1e-3
        right = ~wrong & (expected.gap > 1e-5)
        np.testing.assert_array_equal(views.segmentation.numpy()[view][right], expected.objects[right])
        np.testing.assert_array_equal(views.labels.numpy()[view][right], expected.labels[right])
        np.testing.assert_allclose(views.points.numpy()[view][right], expected.points[right], atol=1e-4)
        apart = np.abs(views.normals.numpy()[view][right] - expected.normals[right]).max(axis=-1) > 1e-4
        assert apart.mean() < 1e-2


def test_image_points_at_pixel_centers_match_image(device):
    preset = scenes.PRESETS["blobs_77k"]
    renderer = wv.Renderer(preset.build(device), SMALL, outputs=("depth", "segmentation"))
    y, x = np.mgrid[:90, :120] + 0.5
    pixels = np.tile(np.stack([x, y], axis=-1).reshape(1, -1, 2), (2, 1, 1))
    image, points = renderer.render(preset.poses(2)), renderer.render_at(preset.poses(2), pixels)
    assert wrong_depth(points.depth.numpy(), image.depth.numpy().reshape(2, -1).astype(np.float64)).mean() <= 1e-4
    assert (points.segmentation.numpy() != image.segmentation.numpy().reshape(2, -1)).mean() <= 1e-4


def test_image_points_do_not_depend_on_threads_or_order():
    preset = scenes.PRESETS["room"]
    pixels = np.random.default_rng(1).uniform((0, 0), (120, 90), (1, 5000, 2)).astype(np.float32)
    order = np.random.default_rng(2).permutation(5000)
    scene = preset.build()
    first = wv.Renderer(scene, SMALL, threads=1).render_at(preset.poses(1), pixels)
    for threads in (2, 5):
        again = wv.Renderer(scene, SMALL, threads=threads).render_at(preset.poses(1), pixels[:, order])
        assert again.depth.numpy().tobytes() == first.depth.numpy()[:, order].tobytes()
        assert again.segmentation.numpy().tobytes() == first.segmentation.numpy()[:, order].tobytes()


def test_auto_selects_packets(device):
    assert wv.Renderer(scenes.PRESETS["room"].build(device), SMALL).caster == "packets"


_ELSEWHERE = """
import sys
import numpy as np, warp as wp
wp.config.cpu_compiler_flags = sys.argv[1]
import warpvis as wv
from warpvis import scenes
from warpvis.core.poses import poses_to_matrices
camera = wv.Camera.from_fov(120, 90, hfov=0.994837, near=0.05, far=100.0)
images = {}
for name in ("experiment_3", "room", "blobs_77k"):
    preset = scenes.PRESETS[name]
    views = wv.render(preset.build(), camera, preset.poses(2))
    images |= {f"{name}_depth": views.depth.numpy(), f"{name}_objects": views.segmentation.numpy()}
np.savez(sys.argv[2], **images)
"""


@pytest.mark.slow
@pytest.mark.skipif(os.uname().machine != "x86_64", reason="names x86-64's instruction sets")
@pytest.mark.parametrize("flags", ["-target-cpu haswell", ""], ids=["AVX2", "generic"])
def test_narrower_instruction_sets_match_ray_caster(flags, tmp_path):
    """AVX2, and Warp's generic x86-64, which has AVX; `make test-lanes` runs the tests of all casters with both."""
    path = tmp_path / "images.npz"
    subprocess.run([sys.executable, "-c", _ELSEWHERE, flags, str(path)], check=True, capture_output=True)
    stored = np.load(path)
    for name in ("experiment_3", "room", "blobs_77k"):
        preset = scenes.PRESETS[name]
        views = wv.render(preset.build(), SMALL, preset.poses(2), caster="rays")
        assert wrong_depth(stored[f"{name}_depth"], views.depth.numpy().astype(np.float64)).mean() <= 1e-4
        assert (stored[f"{name}_objects"] != views.segmentation.numpy()).mean() <= 1e-4


@pytest.mark.smoke("*-packets-*-0.0001")
@pytest.mark.parametrize("thickness", [1e-4, 1e-3, 0.02])
@pytest.mark.parametrize("behind", [False, True])
def test_slivers_match_reference(device, caster, thickness, behind):
    """Long triangles between pixel centers, vertical, horizontal and oblique; some extend behind the camera."""
    rng = np.random.default_rng(7)
    count = 300
    start = rng.uniform([-2, -2, -1], [2, 2, 3], (count, 3))
    along = rng.normal(size=(count, 3)) * [1, 1, 1.5]
    along[::3], along[1::3] = along[::3] * [0.02, 0.02, 1], along[1::3] * [1, 1, 0.02]
    across = rng.normal(size=(count, 3)) * thickness
    corners = np.stack([start, start + along, start + along * rng.uniform(0, 1, (count, 1)) + across], axis=1)
    scene = wv.Scene(device=device)
    scene.add((corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)), name="slivers")
    places = [(0.1, 0.0, 1.0), (-0.5, 0.3, 0.8)] if behind else [(-6.0, 0.2, 1.0), (2.0, 7.0, 2.0)]
    cameras = np.array([wv.look_at(place, (1.0, 0.1, 1.1)) for place in places])
    camera = wv.Camera.from_fov(200, 150, hfov=1.0, near=0.01, far=100.0)
    views = wv.render(scene, camera, cameras, outputs=("depth", "segmentation"), caster=caster)
    assert_matches_reference(views, scene, camera, cameras)
    few = wv.render(scene, camera, cameras, outputs="depth", caster=caster, threads=3)
    assert few.depth.numpy().tobytes() == views.depth.numpy().tobytes()


@pytest.mark.parametrize("upright", [True, False], ids=["upright", "level"])
def test_pixel_centers_exactly_on_edges_of_slivers(device, caster, upright):
    """Edges belong to a triangle: 100 centers are on one edge, and none is inside if that edge is one ulp further."""
    camera = wv.Camera(128, 128, 64.0, 64.0, 64.5, 64.5)
    first = np.float32(9.0)  # in pixels from the principal point, at a depth of 64 m
    for offset, expected in ((first, 100), (np.nextafter(first, np.float32(10)), 0)):
        corners = np.array([(offset, -49.75, 64), (offset, 50.25, 64), (9.0078125, 0, 64)], dtype=np.float32)
        scene = wv.Scene(device=device)
        scene.add((corners[:, [0, 1, 2] if upright else [1, 0, 2]], np.array([[0, 1, 2]])), name="sliver")
        views = wv.render(scene, camera, (0, 0, 0, 0, 0, 0, 1), outputs=("depth", "segmentation"), caster=caster)
        seen = np.argwhere(views.segmentation.numpy()[0] == 0)
        assert len(seen) == expected
        assert (seen[:, 1 if upright else 0] == 64 + 9).all()
        np.testing.assert_array_equal(views.depth.numpy()[0][tuple(seen.T)], 64.0)
