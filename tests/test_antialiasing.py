# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Anti-aliasing of the output "color" at edges, compared with single rays and a double-precision reference."""

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.cameras import OrthographicCamera
from warpvis.errors import ArrayError, CameraError, WarpvisError
from warpvis.rendering._antialiasing import _PATTERNS
from warpvis.scene.lights import Background, Light

import reference

CAMERA = wv.Camera.from_fov(48, 36, hfov=0.9)
POSES = np.stack([wv.look_at(eye, (0.0, 0.0, 0.0)) for eye in ((2.2, -2.6, 1.8), (-3.0, 0.4, 0.7))])
OUTPUTS = ("color", "depth", "segmentation", "points", "normals")


def things(device):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((1.5, 1.2, 0.9)), name="box", appearance=(0.8, 0.3, 0.2))
    scene.add(trimesh.creation.icosphere(subdivisions=3, radius=0.5), name="ball", pose=(0, -1.2, 0.2, 0, 0, 0, 1))
    scene.add(
        trimesh.creation.box((4, 4, 0.1)), name="floor", pose=(0, 0, -0.6, 0, 0, 0, 1), appearance=(0.2, 0.6, 0.3)
    )
    scene.lights = [Light("directional", direction=(0.3, 0.5, -1.0)), Light("ambient", ambient=(0.3, 0.3, 0.3))]
    scene.background = Background(color=(0.4, 0.6, 0.9))
    return scene


@pytest.mark.parametrize(
    "samples", [4, pytest.param(16, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)]
)
def test_edges_show_the_mean_of_their_samples(samples, device):
    scene = things(device)
    plain = wv.render(scene, CAMERA, POSES, outputs=OUTPUTS)
    smooth = wv.render(scene, CAMERA, POSES, outputs=OUTPUTS, samples=samples)
    for name in OUTPUTS[1:]:
        np.testing.assert_array_equal(getattr(smooth, name).numpy(), getattr(plain, name).numpy())
    pattern = np.array(_PATTERNS[samples]) / 16
    renderer = wv.Renderer(scene, CAMERA, outputs=("color",))
    for view, pose in enumerate(POSES):
        images = (getattr(plain, name).numpy()[view] for name in ("segmentation", "points", "normals"))
        edges = reference.list_edges(*images)
        assert 0.02 < edges.mean() < 0.4
        points = reference.place_samples(edges, pattern)
        colors = renderer.render_at(pose[None], points.reshape(1, -1, 2).astype(np.float32)).color.numpy()
        expected = plain.color.numpy()[view].copy()
        expected[edges] = reference.average_samples(colors.reshape(*points.shape[:2], 3))
        np.testing.assert_array_equal(smooth.color.numpy()[view], expected)


def test_colors_approach_the_mean_over_pixels(device):
    """Of 8 x 8 rays per pixel, without shadows, whose edges are not smoothed."""
    scene = things(device)
    fine = wv.Camera(48 * 8, 36 * 8, *(8 * value for value in (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)))
    exact = wv.render(scene, fine, POSES, outputs="color", shadows=False).color.numpy().astype(np.float64)
    exact = exact.reshape(2, 36, 8, 48, 8, 3).mean(axis=(2, 4))
    errors = []
    for samples in (1, 4, 16):
        color = wv.render(scene, CAMERA, POSES, outputs="color", shadows=False, samples=samples).color.numpy()
        errors.append(np.abs(color - exact).mean())
    assert errors[1] < 0.5 * errors[0]
    assert errors[2] < 0.35 * errors[0]


def test_renderer_smooths_views_of_other_numbers_of_edges(device):
    """Views without edges, and calls with more of them than before, into the same memory."""
    scene = things(device)
    away = wv.look_at((2.2, -2.6, 1.8), (5.0, -6.0, 3.0))
    renderer = wv.Renderer(scene, CAMERA, outputs=("color",), samples=4)
    alone = [renderer.render(pose).color.numpy()[0] for pose in (POSES[0], POSES[1], away)]
    both = renderer.render(np.stack([away, POSES[1], POSES[0]])).color.numpy()
    for view, expected in zip(both, alone[::-1], strict=True):
        np.testing.assert_array_equal(view, expected)
    assert len(np.unique(alone[2].reshape(-1, 3), axis=0)) == 1


def test_depth_is_not_smoothed_without_color(device):
    scene = things(device)
    depth = [wv.render(scene, CAMERA, POSES, outputs="depth", samples=samples).depth.numpy() for samples in (1, 4)]
    np.testing.assert_array_equal(*depth)


def test_refused_samples():
    scene = things("cpu")
    with pytest.raises(ArrayError, match="samples must be 1, 2, 4, 8, 16 per pixel, got 3"):
        wv.Renderer(scene, CAMERA, outputs="color", samples=3)
    with pytest.raises(ArrayError, match="samples must be"):
        wv.Renderer(scene, CAMERA, outputs="color", samples="4")
    with pytest.raises(CameraError, match="samples must be 1 for a OrthographicCamera"):
        wv.Renderer(scene, OrthographicCamera(8, 8, 4.0, 4.0, 4.0, 4.0), outputs="color", samples=4)


def test_samples_are_refused_in_a_graph(cuda):
    renderer = wv.Renderer(things(cuda), CAMERA, outputs=("color",), samples=4)
    poses = wp.array(POSES.astype(np.float32), dtype=wp.transform, device=cuda)
    views = renderer.render(poses)
    with pytest.raises(WarpvisError, match="CUDA graph"), wp.ScopedCapture(device=cuda):
        renderer.render(poses, out=views)
