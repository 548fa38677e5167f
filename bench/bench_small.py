# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure small calls: one image of a few pixels, as in a step of one environment, where the overhead dominates.

more.py has Open3D's times for the same images, and gpu.py those of a GPU (`--cases small-room-1 ...`).
"""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.mujoco import BatchRenderer, Renderer, WorldPoses

# A round takes about 0.1 s.
_CALLS = 2000
_MODEL = """<mujoco><worldbody><geom type="plane" size="4 4 .1"/>
<body pos="0 0 1"><freejoint/><geom type="box" size=".2 .2 .2"/>
<camera name="eye" pos="-2 0 1" xyaxes="0 -1 0 .3 0 1"/></body>
<body pos="1 0 1"><joint type="hinge"/><geom type="capsule" size=".1 .3"/></body>
<body pos="1 1 1"><joint type="hinge"/><geom type="sphere" size=".2"/></body>
<body pos="-1 1 1"><joint type="hinge"/><geom type="cylinder" size=".2 .2"/></body></worldbody></mujoco>"""


@pytest.mark.benchmark(group="small calls, room, depth")
@pytest.mark.parametrize("memory", ["new", "out"])
@pytest.mark.parametrize("side", [8, 32, 64, 84])
def test_one_view(measure: Any, scene_of: Callable[[str], wv.Scene], side: int, memory: str) -> None:
    """Render into new memory, and into the memory of the previous call."""
    preset = wv.scenes.PRESETS["room"]
    camera = wv.Camera.from_fov(side, side, hfov=preset.camera.hfov, near=preset.camera.near, far=preset.camera.far)
    renderer, pose = wv.Renderer(scene_of("room"), camera, outputs=("depth",)), preset.poses(1)
    options = {"out": renderer.render(pose)} if memory == "out" else {}
    measure(lambda: renderer.render(pose, **options), 1, _CALLS)


@pytest.mark.benchmark(group="small calls, room, depth")
@pytest.mark.parametrize("form", ["row", "matrix"])
def test_one_pose(measure: Any, scene_of: Callable[[str], wv.Scene], form: str) -> None:
    """Render from a single pose in double precision, the most common input."""
    preset = wv.scenes.PRESETS["room"]
    camera = wv.Camera.from_fov(64, 64, hfov=preset.camera.hfov, near=preset.camera.near, far=preset.camera.far)
    renderer, row = wv.Renderer(scene_of("room"), camera, outputs=("depth",)), preset.poses(1)[0].astype(np.float64)
    pose = poses_to_matrices(row) if form == "matrix" else row
    measure(lambda: renderer.render(pose), 1, _CALLS)


@pytest.mark.benchmark(group="small calls, a MuJoCo model, 64x64")
@pytest.mark.parametrize("mode", ["depth", "segmentation"])
def test_mujoco_renderer(measure: Any, mode: str) -> None:
    """Render one environment, as with `mujoco.Renderer`."""
    model = mujoco.MjModel.from_xml_string(_MODEL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with Renderer(model, 64, 64) as renderer:
        getattr(renderer, f"enable_{mode}_rendering")()

        def step() -> None:
            renderer.update_scene(data, "eye")
            renderer.render()

        step()
        measure(step, 1, _CALLS // 2)


@pytest.mark.benchmark(group="small calls, a MuJoCo model, 64x64")
@pytest.mark.parametrize("worlds", [1, 16])
def test_batch_renderer(measure: Any, worlds: int) -> None:
    """Render several environments at once."""
    model = mujoco.MjModel.from_xml_string(_MODEL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer, poses = BatchRenderer(model, worlds, height=64, width=64), WorldPoses.of([data] * worlds)
    views = renderer.render(poses)
    measure(lambda: renderer.render(poses, out=views), worlds, _CALLS // 8)
