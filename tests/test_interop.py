# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Array interchange with NumPy, lists, PyTorch and JAX, without copies where memory is shared."""

import numpy as np
import pytest
import warp as wp

import warpvis as wv
from warpvis import scenes

EXPERIMENT = scenes.EXPERIMENTS[0]


@pytest.fixture
def views(device):
    return wv.render(EXPERIMENT.build(device), EXPERIMENT.camera, EXPERIMENT.poses())


def test_numpy_shares_cpu_memory():
    views = wv.render(EXPERIMENT.build(), EXPERIMENT.camera, EXPERIMENT.poses())
    for image in (views.depth, views.points, views.labels, views.segmentation):
        assert np.shares_memory(np.from_dlpack(image), image.numpy())
    assert np.from_dlpack(views.points).shape == (1, 240, 320, 3)


def test_float32_host_depth_is_not_copied():
    """A float32 array on the host is not copied for a CPU kernel."""
    from warpvis.core.arrays import as_warp

    depth = np.ones((1, 2, 3), dtype=np.float32)
    assert as_warp(depth, wp.float32, (1, 2, 3), name="depth", device=wp.get_device("cpu")).ptr == depth.ctypes.data


def test_lists_and_doubles_are_accepted():
    pose = [0.0, 0, 1, 0, 0, 0, 1]
    depth = [[1.0, 2.0]]
    camera = wv.Camera(2, 1, 1, 1, 1, 0.5)
    points = wv.back_project(depth, camera, pose).numpy()
    np.testing.assert_allclose(points, [[[[-0.5, 0, 2], [1, 0, 3]]]])


@pytest.mark.parametrize("form", ["rows", "matrices"])
def test_torch_tensors_are_exchanged(views, device, form):
    torch = pytest.importorskip("torch")
    from warpvis.core.poses import poses_to_matrices

    place = device.replace("cpu:0", "cpu")
    poses = EXPERIMENT.poses() if form == "rows" else poses_to_matrices(EXPERIMENT.poses()).astype(np.float32)
    again = wv.render(EXPERIMENT.build(device), EXPERIMENT.camera, torch.tensor(poses, device=place))
    np.testing.assert_allclose(again.depth.numpy(), views.depth.numpy(), rtol=1e-5)
    depth = torch.from_dlpack(views.depth)
    assert depth.data_ptr() == views.depth.ptr
    labels = wv.classify(depth, EXPERIMENT.camera, EXPERIMENT.poses())
    assert str(labels.device) == device
    np.testing.assert_array_equal(
        labels.numpy(), wv.classify(views.depth, EXPERIMENT.camera, EXPERIMENT.poses()).numpy()
    )


def test_jax_poses_are_accepted(views, device):
    jax = pytest.importorskip("jax")
    try:
        place = jax.devices("cpu" if device == "cpu" else "gpu")[0]
    except RuntimeError:
        pytest.skip(f"jax has no {device}")
    poses = jax.device_put(EXPERIMENT.poses(), place)
    again = wv.render(EXPERIMENT.build(device), EXPERIMENT.camera, poses)
    np.testing.assert_allclose(again.depth.numpy(), views.depth.numpy(), rtol=1e-5)


def test_cpu_and_cuda_agree(cuda):
    from compare import wrong_depth

    preset = scenes.PRESETS["room"]
    here, there = (wv.render(preset.build(name), preset.camera, preset.poses(8)) for name in ("cpu", cuda))
    wrong = wrong_depth(there.depth.numpy(), here.depth.numpy().astype(np.float64))
    assert wrong.mean() <= 1e-4
    assert (here.segmentation.numpy() != there.segmentation.numpy()).mean() <= 1e-4


def test_rendering_is_captured_in_cuda_graph(cuda):
    """With poses and outputs on the device, rendering neither allocates, copies back nor synchronizes."""
    preset = scenes.PRESETS["room"]
    renderer = wv.Renderer(preset.build(cuda), preset.camera)
    poses = wp.array(preset.poses(4), dtype=wp.transform, device=cuda)
    views = renderer.render(poses)
    expected = views.depth.numpy()
    with wp.ScopedCapture(cuda) as capture:
        renderer.render(poses, out=views)
    views.depth.zero_()
    wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(views.depth.numpy(), expected)
    poses.assign(preset.poses(8)[4:])
    wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(views.depth.numpy(), renderer.render(preset.poses(8)[4:]).depth.numpy())
