# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of `render_at` with maps: images whose pixels sample given positions of the camera's image, cast in packets."""

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis import scenes
from warpvis.rendering.casters.packets_cpu import are_coherent
from warpvis.scene import solids

import reference
from compare import wrong_depth
from support.packets import ALL
from support.worlds import assert_bits_equal, eyes, random_poses

# Non-square pixels, and a principal point that is not exact in single precision.
CAMERA = wv.Camera(96, 72, 80.3, 77.9, 47.3, 35.1, near=0.3, far=6.0)
SHAPES = {
    "ball": solids.ellipsoid((0.3, 0.2, 0.4)),
    "post": solids.capsule(0.15, 0.4),
    "box": trimesh.creation.box((0.5, 0.4, 0.3)),
    "knot": trimesh.creation.torus(0.4, 0.1),
}


def build(device, rows):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((9, 9, 0.2)), name="floor", label="ground", pose=(0, 0, -0.4, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(3, 0.5), name="rock", pose=(0, 0, 0.4, 0, 0, 0, 1))
    for (name, shape), row in zip(SHAPES.items(), rows, strict=True):
        scene.add(shape, name=name, pose=row, movable=True)
    return scene


def warped(rows, columns, views, seed=0, camera=CAMERA, noise=0.4):
    """Return maps that rotate, shrink and jitter the image, reach beyond its sides, and contain NaN."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:rows, :columns]
    y, x = (y + 0.5) / rows - 0.5, (x + 0.5) / columns - 0.5
    turn = rng.uniform(-0.5, 0.5, (views, 1, 1))
    u = (0.5 + 1.15 * (np.cos(turn) * x - np.sin(turn) * y)) * camera.width
    v = (0.5 + 1.15 * (np.sin(turn) * x + np.cos(turn) * y)) * camera.height
    places = np.stack([u, v], axis=-1) + rng.normal(0, noise, (views, rows, columns, 2))
    places[:, rows // 2 : rows // 2 + 6, 3:9, rng.integers(2)] = np.nan
    return places.astype(np.float32)


def assert_map_matches(views, scene, camera, poses, places, **options):
    for view, pose in enumerate(poses):
        expected = reference.cast_rays_at(scene, camera, pose, places[view], **options)
        depth = views.depth.numpy()[view]
        wrong = wrong_depth(depth, expected.depth)
        assert wrong.mean() <= 3e-4
        same = ~wrong & (expected.gap > 1e-5)
        np.testing.assert_array_equal(views.segmentation.numpy()[view][same], expected.objects[same])
        np.testing.assert_array_equal(views.labels.numpy()[view][same], expected.labels[same])
        hit = same & np.isfinite(expected.depth)
        np.testing.assert_allclose(views.points.numpy()[view][hit], expected.points[hit], atol=1e-4)
        assert np.isnan(views.points.numpy()[view][~np.isfinite(depth)]).all()
        apart = np.abs(views.normals.numpy()[view][hit] - expected.normals[hit]).max(axis=-1) > 2e-4
        assert apart.mean() <= 1e-2  # at edges between triangles, either normal is right


# Whole tiles; partial blocks; less than a block; several trees side by side and one above another.
@pytest.mark.smoke("*-packets-shape1", "*-shape3")
@pytest.mark.parametrize("shape", [(64, 64), (75, 90), (3, 70), (2, 2), (9, 700), (260, 150)])
def test_maps_match_reference(shape, device, caster):
    scene, cameras = build(device, random_poses(np.random.default_rng(1), len(SHAPES))), eyes(2)
    places = warped(*shape, 2, noise=0.02 if shape[0] < 10 else 0.4)
    views = wv.Renderer(scene, CAMERA, outputs=ALL, caster=caster).render_at(cameras, places)
    assert views.depth.shape == (2, *shape) and views.normals.shape == (2, *shape)
    assert_map_matches(views, scene, CAMERA, cameras, places)


@pytest.mark.smoke("*-packets-False")
@pytest.mark.parametrize("cull_backfaces", [False, True])
def test_square_pixels_in_a_room(cull_backfaces, device, caster):
    preset = scenes.PRESETS["room"]
    scene, cameras = preset.build(device), preset.poses(2)
    camera = wv.Camera.from_fov(160, 120, hfov=0.994837, near=0.3, far=4.5)
    places = warped(60, 80, 2, camera=camera)  # brute force in double precision is slow in the room
    renderer = wv.Renderer(scene, camera, outputs=ALL, caster=caster, cull_backfaces=cull_backfaces)
    views = renderer.render_at(cameras, places)
    assert_map_matches(views, scene, camera, cameras, places, cull_backfaces=cull_backfaces)


@pytest.mark.parametrize("outputs", [("depth",), ("depth", "points"), ("segmentation",), ("labels", "depth"), ALL])
def test_maps_match_lists_of_their_positions(outputs, device, caster):
    rows = random_poses(np.random.default_rng(2), 2, len(SHAPES))
    scene, cameras, places = build(device, rows[0]), eyes(2), warped(75, 90, 2)
    flags = np.zeros((2, len(scene)), dtype=bool)
    flags[0, [0, 3]] = True
    arguments = {"object_poses": rows, "world_index": [1, 0], "exclude": flags}
    renderer = wv.Renderer(scene, CAMERA, outputs=outputs, caster=caster)
    image = renderer.render_at(cameras, places, **arguments)
    points = renderer.render_at(cameras, places.reshape(2, -1, 2), **arguments)
    for name in outputs:
        one, other = getattr(image, name).numpy(), getattr(points, name).numpy()
        same = np.isclose(one, other.reshape(one.shape), rtol=1e-5, atol=1e-5, equal_nan=True)
        assert same.mean() >= 1 - 2e-4


def test_near_surfaces_are_clipped(device, caster):
    scene, cameras, places = (
        build(device, random_poses(np.random.default_rng(3), len(SHAPES))),
        eyes(2),
        warped(60, 80, 2),
    )
    camera = wv.Camera(96, 72, 80.3, 77.9, 47.3, 35.1, near=2.6, far=6.0)
    renderer = wv.Renderer(scene, camera, outputs=("depth",), caster=caster, near_plane="clip")
    image = renderer.render_at(cameras, places).depth.numpy()
    points = renderer.render_at(cameras, places.reshape(2, -1, 2)).depth.numpy().reshape(image.shape)
    assert not np.isneginf(image).any() and np.isfinite(image).any()
    hidden = wv.Renderer(scene, camera, outputs=("depth",), caster=caster).render_at(cameras, places).depth.numpy()
    assert np.isneginf(hidden).any()
    assert wrong_depth(image, points.astype(np.float64)).mean() <= 3e-3  # packets differ where solids are clipped


def test_incoherent_maps_are_cast_as_lists():
    """Packets of scattered positions would span the whole image; lists are sorted."""
    rng = np.random.default_rng(4)
    scene, cameras = build("cpu", random_poses(rng, len(SHAPES))), eyes(2)
    places = rng.uniform((0, 0), (CAMERA.width, CAMERA.height), (2, 40, 50, 2)).astype(np.float32)
    renderer = wv.Renderer(scene, CAMERA, outputs=ALL)
    assert not are_coherent(wp.array(places, dtype=wp.vec2, device="cpu"))
    image, points = renderer.render_at(cameras, places), renderer.render_at(cameras, places.reshape(2, -1, 2))
    for name in ALL:
        one = getattr(image, name).numpy()
        np.testing.assert_array_equal(one, getattr(points, name).numpy().reshape(one.shape))


def test_positions_outside_the_image_are_empty(device, caster):
    places = np.full((1, 20, 30, 2), -5.0, dtype=np.float32)
    places[0, 10:] = np.nan
    scene = build(device, random_poses(np.random.default_rng(5), len(SHAPES)))
    views = wv.Renderer(scene, CAMERA, outputs=ALL, caster=caster).render_at(eyes(1), places)
    assert np.isposinf(views.depth.numpy()).all() and np.isnan(views.normals.numpy()).all()
    assert (views.segmentation.numpy() == -1).all() and (views.labels.numpy() == wv.Label.EMPTY).all()


def test_results_are_independent_of_threads():
    rows = random_poses(np.random.default_rng(6), len(SHAPES))
    scene, cameras, places = build("cpu", rows), eyes(3), warped(150, 200, 3)
    first = wv.Renderer(scene, CAMERA, outputs=ALL, threads=1).render_at(cameras, places)
    for threads in (2, 7):
        renderer = wv.Renderer(scene, CAMERA, outputs=ALL, threads=threads)
        for _ in range(2):
            assert_bits_equal(renderer.render_at(cameras, places), first)
    alone = wv.Renderer(scene, CAMERA, outputs=ALL).render_at(cameras[1:2], places[1:2])
    np.testing.assert_array_equal(alone.depth.numpy()[0], first.depth.numpy()[1])


def test_map_forms_out_and_fill(device):
    scene = build(device, random_poses(np.random.default_rng(7), len(SHAPES)))
    renderer, places = wv.Renderer(scene, CAMERA, outputs=("depth",)), warped(20, 30, 1)
    expected = renderer.render_at(eyes(1), places).depth.numpy()
    on_device = wp.array(places, dtype=wp.vec2, device=device)
    for given in (on_device, places.astype(np.float64), places.tolist()):
        np.testing.assert_array_equal(renderer.render_at(eyes(1), given).depth.numpy(), expected)
    out = renderer.render_at(eyes(1), places)
    assert renderer.render_at(eyes(1), places, out=out) is out
    with pytest.raises(wv.WarpvisError, match=r"pixels must have shape \(1, Y, X, 2\), got \(2, 20, 30, 2\)"):
        renderer.render_at(eyes(1), np.concatenate([places, places]))
    with pytest.raises(wv.WarpvisError, match=r"out\.depth"):
        renderer.render_at(eyes(1), places[:, :10], out=out)
    filled = wv.Renderer(scene, CAMERA, outputs=("depth",), fill=0.0).render_at(eyes(1), places)
    assert np.isfinite(filled.depth.numpy()).all()


def test_lens_camera_accepts_maps(device, caster):
    scene = build(device, random_poses(np.random.default_rng(8), len(SHAPES)))
    lens = wv.Camera.from_opencv([[80, 0, 48], [0, 80, 36], [0, 0, 1]], [-0.2, 0.05, 0, 0], 96, 72)
    renderer, places = wv.Renderer(scene, lens, outputs=("depth",), caster=caster), warped(20, 30, 1)
    image = renderer.render_at(eyes(1), places).depth.numpy()
    points = renderer.render_at(eyes(1), places.reshape(1, -1, 2)).depth.numpy()
    np.testing.assert_array_equal(image, points.reshape(image.shape))
