# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth images without infinities, for learning."""

import numpy as np
import pytest
import trimesh

import warpvis as wv

import reference

CAMERA = wv.Camera.from_fov(40, 30, hfov=1.2, near=0.5, far=3.0)
POSES = np.array([wv.look_at((0, 0, 0), (4, 0, 0)), wv.look_at((0.9, 0, 0), (4, 0, 0))], dtype=np.float32)


def scene(device="cpu"):
    made = wv.Scene(device=device)
    made.add(trimesh.creation.box((0.2, 0.4, 0.4)), name="box", pose=(1.3, 0, 0, 0, 0, 0, 1))
    made.add(trimesh.creation.box((0.1, 3, 3)), name="far away", pose=(4, 1.4, 0, 0, 0, 0, 1))
    return made


NUMBERS = {"far": (3.0, 0.5), 0.0: (0.0, 0.0), 7: (7.0, 7.0), -1.5: (-1.5, -1.5)}


@pytest.mark.parametrize("fill", NUMBERS)
def test_pixels_without_depth_have_the_fill_value(fill, device, caster):
    options = {"caster": caster, "outputs": ("depth", "segmentation")}
    before = wv.render(scene(device), CAMERA, POSES, **options)
    views = wv.render(scene(device), CAMERA, POSES, fill=fill, **options)
    depth = before.depth.numpy()
    assert np.isposinf(depth).any() and np.isneginf(depth).any() and np.isfinite(depth).any()
    expected = reference.fill_depth(depth, *NUMBERS[fill])
    assert np.array_equal(views.depth.numpy(), expected.astype(np.float32))
    assert np.array_equal(views.segmentation.numpy(), before.segmentation.numpy())
    renderer = wv.Renderer(scene(device), CAMERA, fill=fill, **options)
    assert renderer.fill == fill
    assert renderer.render(POSES, out=views) is views and np.array_equal(views.depth.numpy(), expected)


def test_infinities_are_the_default(device):
    depth = wv.render(scene(device), CAMERA, POSES, outputs=("depth",)).depth.numpy()
    same = wv.render(scene(device), CAMERA, POSES, outputs=("depth",), fill="inf").depth.numpy()
    assert np.array_equal(depth, same) and np.isinf(depth).any()


def test_render_at_fills_depth(device):
    renderer = wv.Renderer(scene(device), CAMERA, outputs=("depth",), fill="far")
    pixels = np.array([[[20.0, 15.0], [-5.0, 3.0], [1.5, 1.5]]] * 2)
    depth = renderer.render_at(POSES, pixels).depth.numpy()
    assert depth == pytest.approx(np.array([[1.2, 3, 3], [0.5, 3, 0.5]]))


def test_unrequested_depth_is_not_filled():
    views = wv.render(scene(), CAMERA, POSES, outputs=("depth", "labels"))
    before = views.depth.numpy().copy()
    wv.Renderer(scene(), CAMERA, outputs=("labels",), fill=0.0).render(POSES, out=views)
    assert np.array_equal(views.depth.numpy(), before)


def test_images_copied_to_the_host_in_chunks_are_filled(device):
    if device == "cpu":
        pytest.skip("parts are of a GPU's images")
    whole = wv.Renderer(scene(device), CAMERA, outputs=("depth",), fill=0.0).render(POSES).depth.numpy()
    parts = wv.Renderer(scene(device), CAMERA, outputs=("depth",), fill=0.0, device_bytes=1).render(POSES).depth
    assert parts.device.is_cpu and np.array_equal(parts.numpy(), whole)


@pytest.mark.parametrize("fill", ["zero", "", None, True, np.nan, np.inf, [0.0], 1j])
def test_invalid_fill_raises(fill):
    with pytest.raises(wv.WarpvisError, match="fill must be"):
        wv.Renderer(scene(), CAMERA, fill=fill)


def test_fill_far_requires_a_finite_range():
    with pytest.raises(wv.WarpvisError, match='the camera\'s far must be finite for fill="far", got inf'):
        wv.Renderer(scene(), wv.Camera.from_fov(8, 6, hfov=1.0), fill="far")
