# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Render depth of many worlds simulated by MuJoCo Warp, without copies to the host.

Needs `pip install mujoco-warp`. On a GPU, if available, stepping and rendering are captured in one CUDA graph.
"""

import mujoco  # noqa: TID253
import mujoco_warp as mjw
import numpy as np
import warp as wp

from warpvis.mujoco import BatchRenderer

MJCF = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 .1"/>
    <body name="ball" pos="0 0 1">
      <freejoint/>
      <geom name="ball" type="sphere" size=".15"/>
    </body>
    <camera name="side" pos="0 -3 1" xyaxes="1 0 0 0 .1 1"/>
  </worldbody>
</mujoco>
"""
WORLDS = 64

device = "cuda:0" if wp.is_cuda_available() else "cpu"
model = mujoco.MjModel.from_xml_string(MJCF)
with wp.ScopedDevice(device):
    m, data = mjw.put_model(model), mjw.make_data(model, nworld=WORLDS)
    qpos = data.qpos.numpy()
    qpos[:, 2] = np.linspace(0.5, 2.0, WORLDS)  # dropped from different heights
    data.qpos.assign(qpos)

    batch = BatchRenderer(model, WORLDS, height=64, width=64, outputs=("depth", "segmentation"), device=device)
    mjw.step(m, data)
    views = batch.render(data, cameras="side")

    def step_and_see() -> None:
        """Simulate fifty steps, and render one image of every world."""
        for _ in range(50):
            mjw.step(m, data)
        mjw.kinematics(m, data)
        mjw.camlight(m, data)
        batch.render(data, cameras="side", out=views)

    if device == "cpu":
        step_and_see()
    else:
        with wp.ScopedCapture() as capture:
            step_and_see()
        wp.capture_launch(capture.graph)

ball = batch.geom_ids(views).numpy() == model.geom("ball").id
rows = [np.flatnonzero(image.any(axis=1)) for image in ball]
print(f"the ball is seen in {sum(len(found) > 0 for found in rows)} of {WORLDS} worlds")
print(f"its top is in row {rows[0][0]} of the first, {rows[-1][0]} of the last")
