# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Calls found by `fuzz_calls` that once raised something other than a `WarpvisError`, one of each kind."""

import mujoco
import numpy as np
import pytest
from arguments_shared import CAMERA, POSE, scene

import warpvis as wv


@pytest.mark.parametrize("dtype", [np.int64, np.int32, np.uint8])
def test_view_from_outside_accepts_integer_depth(dtype):
    """Integers have no infinity, and unsigned ones no -1."""
    outside = wv.Camera.from_fov(16, 12, hfov=1.0)
    world, depth = scene(), np.full((CAMERA.height, CAMERA.width), 2)
    objects = np.zeros(depth.shape)
    given = (world, outside, POSE, CAMERA, POSE)
    wanted = wv.viz.view_from_outside(*given, depth.astype(np.float32), objects.astype(np.int32))
    np.testing.assert_array_equal(wv.viz.view_from_outside(*given, depth.astype(dtype), objects.astype(dtype)), wanted)


@pytest.mark.parametrize("count", [3.15, None, 10**30, -1])
def test_invalid_numbers_of_mujoco_geoms_raise(count):
    model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size="1"/></worldbody></mujoco>')
    with pytest.raises(wv.WarpvisError, match=rf"max_geom must be .*, got {count}"):
        wv.mujoco.Renderer(model, 12, 16, max_geom=count)
