# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Render depth and segmentation of a MuJoCo model without OpenGL: one world, then 256 at once."""

import mujoco  # noqa: TID253
import numpy as np

from warpvis.mujoco import BatchRenderer, Renderer  # instead of: from mujoco import Renderer

MJCF = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 .1"/>
    <body name="pendulum" pos="0 0 1.2">
      <joint name="swing" type="hinge" axis="0 1 0"/>
      <geom name="rod" type="capsule" size=".03" fromto="0 0 0 0 0 -.7"/>
      <geom name="bob" type="sphere" size=".15" pos="0 0 -.8"/>
    </body>
    <camera name="side" pos="0 -3 1" xyaxes="1 0 0 0 .1 1"/>
    <camera name="top" pos="0 0 3"/>
  </worldbody>
</mujoco>
"""

model = mujoco.MjModel.from_xml_string(MJCF)
data = mujoco.MjData(model)
data.joint("swing").qpos = 0.5
mujoco.mj_forward(model, data)

with Renderer(model, height=240, width=320) as renderer:
    renderer.update_scene(data, camera="side")
    renderer.enable_depth_rendering()
    depth = renderer.render()
    renderer.enable_segmentation_rendering()
    geoms = renderer.render()[..., 0]
bob = geoms == model.geom("bob").id
print(f"the bob shows on {bob.sum()} pixels, {depth[bob].min():.3f} m away at the nearest")

# The same model in 256 worlds, from both cameras, with joint positions as input. With device="cuda:0", the arrays of
# MuJoCo Warp's data are used without a copy.
batch = BatchRenderer(model, 256, height=64, width=64, outputs=("depth", "segmentation"))
views = batch.render(np.linspace(-1, 1, 256)[:, None], cameras=["side", "top"])
side, top = batch.geom_ids(views).numpy().reshape(2, 256, 64, 64) == model.geom("bob").id
print(f"of {views.depth.shape[0]} views the bob shows in {side.any(axis=(1, 2)).sum() + top.any(axis=(1, 2)).sum()}")
