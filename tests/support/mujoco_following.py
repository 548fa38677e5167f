# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A MuJoCo task in which cameras follow bodies."""

import mujoco
import numpy as np

# Similar to Meta-World's tasks: a table, a fixed body of several geoms with one inside, and a moving hand.
TASK = """
<mujoco>
  <statistic extent="2" center="0 0 .3"/>
  <visual><map znear="0.01" zfar="20"/><quality numslices="128" numstacks="64" offsamples="0"/></visual>
  <asset>
    <mesh name="wedge" vertex="0 0 0  .3 0 0  .3 .2 0  0 .2 0  0 .1 .2  .3 .1 .2"/>
    <mesh name="tetra" vertex="0 0 0  .2 0 0  0 .2 0  0 0 .2"/>
    <hfield name="hills" nrow="7" ncol="9" size=".3 .3 .2 .05"/>
    <material name="see" rgba="1 0 0 1"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 .1"/>
    <geom name="table" type="box" size=".7 .5 .05" pos="0 0 .2"/>
    <geom name="pole" type="cylinder" size=".03 .3" pos=".5 .3 .5" euler="5 0 0"/>
    <geom name="hills" type="hfield" hfield="hills" pos="-.4 -.1 .26"/>
    <geom name="spare" type="box" size=".1 .1 .1" pos="-.5 .4 .35" group="4"/>
    <body name="drawer" pos=".2 .2 .3">
      <geom name="case" type="box" size=".15 .1 .05"/>
      <geom name="handle" type="box" size=".03 .02 .02" pos="0 -.12 0"/>
      <geom name="knob" type="sphere" size=".03" pos="0 0 .08"/>
      <body name="lid" pos="0 0 .06"><geom name="lid" type="mesh" mesh="wedge" material="see"/></body>
    </body>
    <body name="hand" pos="0 -.2 .6">
      <freejoint/>
      <geom name="palm" type="box" size=".06 .04 .03" euler="0 0 5"/>
      <geom name="finger" type="box" size=".02 .02 .06" pos=".05 0 -.08"/>
      <geom name="ring" type="mesh" mesh="tetra" pos="-.1 0 0"/>
      <camera name="wrist" pos="0 0 .2" fovy="70"/>
    </body>
    <camera name="front" pos="0 -1.6 1.3" xyaxes="1 0 0 0 .6 .8" fovy="50"/>
  </worldbody>
</mujoco>"""


def task():
    model = mujoco.MjModel.from_xml_string(TASK)
    model.hfield_data[:] = np.random.default_rng(0).random(len(model.hfield_data))
    return model, mujoco.MjData(model)
