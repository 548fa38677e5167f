# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images of `mujoco.Renderer`, and their comparison with warpvis images."""

import mujoco
import mujoco.rollout
import numpy as np


def images(renderer, data, camera, option=None):
    """Return depth and segmentation by the calls that both renderers support."""
    renderer.update_scene(data, camera, option)
    renderer.enable_depth_rendering()
    depth = renderer.render()
    renderer.disable_depth_rendering()
    renderer.enable_segmentation_rendering()
    segmentation = renderer.render()
    renderer.disable_segmentation_rendering()
    return depth, segmentation


def away_from_silhouettes(depth, reach=2, step=0.03):
    padded = np.pad(depth, reach, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * reach + 1, 2 * reach + 1))
    return np.ptp(windows, axis=(2, 3)) < step * depth + step


def assert_same_images(ours, theirs, tolerance):
    """Check agreement by section 6 of the design: away from silhouettes, within tessellation tolerance."""
    (depth, segmentation), (expected, expected_segmentation) = ours, theirs
    assert (depth.dtype, depth.shape) == (expected.dtype, expected.shape)
    assert (segmentation.dtype, segmentation.shape) == (expected_segmentation.dtype, expected_segmentation.shape)
    seen, same = expected_segmentation[..., 0] >= 0, (segmentation == expected_segmentation).all(axis=-1)
    inside = away_from_silhouettes(expected) & away_from_silhouettes(depth)
    assert same.mean() >= 0.995 and same[inside].mean() >= 0.999 - 0.005 * (inside & seen).mean()
    assert np.array_equal(depth[same & ~seen], expected[same & ~seen])  # the background value, exactly
    if (compared := inside & seen & same).any():
        error = np.abs(depth - expected)[compared]
        assert np.median(error) < 1e-4 + tolerance
        assert np.quantile(error, 0.99) < 2e-3 + tolerance


def geoms_only():
    option = mujoco.MjvOption()
    option.sitegroup[:] = 0
    return option


def free_camera():
    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation, camera.distance, camera.lookat[:] = 60, -35, 2.5, (0.1, 0.2, 0.3)
    return camera
