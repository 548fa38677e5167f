# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Simulate rollouts of several worlds with MuJoCo on all cores, and render depth of every tenth state."""

import mujoco  # noqa: TID253
import numpy as np
from mujoco import rollout  # noqa: TID253

from warpvis.mujoco import BatchRenderer

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
  </worldbody>
</mujoco>
"""
WORLDS, STEPS = 8, 200

model = mujoco.MjModel.from_xml_string(MJCF)
data = mujoco.MjData(model)
size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
start = np.zeros((WORLDS, size))
start[:, 1] = np.linspace(-1.5, 1.5, WORLDS)  # the state is time, position, velocity

states, _ = rollout.rollout(model, data, start, nstep=STEPS)  # (worlds, steps, state)
rendered = states[:, ::10]

batch = BatchRenderer(model, WORLDS * rendered.shape[1], height=64, width=64, outputs=("depth", "segmentation"))
views = batch.render(batch.kinematics.from_states(rendered), cameras="side")
bob = batch.geom_ids(views).numpy().reshape(WORLDS, -1, 64, 64) == model.geom("bob").id
columns = [[int(np.flatnonzero(image.any(axis=0)).mean()) for image in world] for world in bob]
print(f"{views.depth.shape[0]} depth images of {WORLDS} rollouts")
print("where the bob is in the first rollout, in columns:", columns[0])
