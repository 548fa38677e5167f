# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo models: all types of geoms and cameras, and real robots whose packages are installed."""

import importlib.util
from pathlib import Path

import mujoco
import numpy as np
import pytest

SHAPES = """
<mujoco>
  <statistic extent="2" center="0 0 0.3"/>
  <visual>
    <map znear="0.005" zfar="20"/>
    <global offwidth="640" offheight="480"/>
    <quality numslices="192" numstacks="96" offsamples="0"/>
  </visual>
  <asset>
    <mesh name="wedge" vertex="0 0 0  .3 0 0  .3 .2 0  0 .2 0  0 .1 .2  .3 .1 .2" scale="1 1.2 1"/>
    <hfield name="hills" nrow="7" ncol="9" size=".4 .3 .2 .05"/>
    <material name="unseen" rgba="1 0 0 0"/>
    <material name="seen" rgba="1 0 0 1"/>
  </asset>
  <worldbody>
    <geom name="the_floor" type="plane" size="0 0 .1"/>
    <geom name="shelf" type="plane" size=".3 .2 .1" pos="-.9 .9 .4" euler="20 0 30"/>
    <geom name="hills" type="hfield" hfield="hills" pos=".9 .9 .1" euler="0 0 25"/>
    <geom name="fixed_box" type="box" size=".1 .15 .2" pos="0 1.1 .2" euler="0 0 20"/>
    <geom name="field" type="sdf" mesh="wedge" pos="-1 -.2 .1" euler="0 0 70"/>
    <geom name="hidden" type="sphere" size=".5" pos="0 0 .5" rgba="1 0 0 0"/>
    <geom name="hidden_by_material" type="sphere" size=".5" pos="0 0 .5" material="unseen"/>
    <geom name="own_color" type="sphere" size=".07" pos="-.2 -.9 .07" material="unseen" rgba="0 1 0 .4"/>
    <geom name="no_color" type="sphere" size=".6" pos="0 0 .5" material="seen" rgba="0 1 0 0"/>
    <geom name="collision" type="sphere" size=".7" pos="0 0 .5" group="3"/>
    <body name="ball" pos=".5 0 .3">
      <freejoint/>
      <geom name="ball" type="sphere" size=".15" contype="0" conaffinity="0"/>
      <geom type="sphere" size=".05" pos="0 0 .25"/>
      <geom type="sphere" size=".05" pos="0 .25 0"/>
    </body>
    <body name="arm" pos="-.4 .1 .5">
      <joint name="shoulder" type="hinge" axis="0 1 0"/>
      <geom name="upper" type="capsule" size=".06" fromto="0 0 0 .2 .1 .2"/>
      <body name="hand" pos=".2 .1 .2">
        <joint name="wrist" type="hinge" axis="1 0 0"/>
        <geom type="cylinder" size=".07 .12" euler="30 40 0"/>
        <camera name="wrist" pos="0 0 .3" fovy="70" xyaxes="1 0 0 0 1 0"/>
      </body>
    </body>
    <body name="egg" pos="-.7 -.5 .3"><freejoint/><geom type="ellipsoid" size=".2 .1 .15"/></body>
    <body name="wedge" pos=".1 -.6 .3"><freejoint/><geom type="mesh" mesh="wedge"/></body>
    <body name="brick" pos=".8 -.5 .2"><freejoint/><geom type="box" size=".1 .2 .05"/></body>
    <body name="target" mocap="true" pos=".2 .5 .3" quat="1 .2 .3 .4">
      <geom type="box" size=".05 .08 .1"/>
      <body name="under_target" pos="0 0 .3"><geom type="sphere" size=".06"/></body>
    </body>
    <camera name="front" pos="0 -2.2 1.2" xyaxes="1 0 0 0 .45 .9" fovy="50"/>
    <camera name="side" pos="2.4 .3 .9" xyaxes="-.1 1 0 -.3 0 1" fovy="60"/>
    <camera name="below" pos="0 0 -1.5" xyaxes="1 0 0 0 -1 0" fovy="60"/>
    <camera name="lens" pos="0 -2.2 1.2" xyaxes="1 0 0 0 .45 .9" resolution="200 120"
            sensorsize="4e-3 2.4e-3" focal="3e-3 2.5e-3" principal="5e-4 -3e-4"/>
    <camera name="follower" pos="1 -1.5 1.5" mode="targetbody" target="ball" fovy="45"/>
    <camera name="flat" pos="0 -2.2 1.2" xyaxes="1 0 0 0 .45 .9" fovy="2" projection="orthographic"/>
  </worldbody>
</mujoco>
"""


def shapes_model():
    """Return a model with every type of geom, and its data with everything slightly displaced."""
    model = mujoco.MjModel.from_xml_string(SHAPES)
    model.hfield_data[:] = np.random.default_rng(0).random(len(model.hfield_data))
    data = mujoco.MjData(model)
    data.qpos[:] += np.random.default_rng(1).normal(scale=0.1, size=model.nq)
    mujoco.mj_forward(model, data)
    return model, data


# Packages with MJCF files of real robots, and the files.
_ROBOTS = {
    "aloha": ("mujoco_warp", "test_data/aloha_pot/scene.xml"),
    "fetch": ("gymnasium_robotics", "envs/assets/fetch/pick_and_place.xml"),
    "humanoid": ("dm_control", "locomotion/walkers/assets/humanoid_CMU_V2020.xml"),
}
ROBOTS = tuple(_ROBOTS)


def robot_model(name):
    """Return a robot model and its data with MuJoCo's finest tessellation; skip the test if its package is missing."""
    package, path = _ROBOTS[name]
    found = importlib.util.find_spec(package)
    folders = list(found.submodule_search_locations or []) if found else []
    files = [Path(folder) / path for folder in folders if (Path(folder) / path).is_file()]
    if not files:
        pytest.skip(f"the package {package}, which has {path}, is not installed")
    spec = mujoco.MjSpec.from_file(str(files[0]))
    spec.visual.quality.numslices, spec.visual.quality.numstacks, spec.visual.quality.offsamples = 128, 64, 0
    model = spec.compile()
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return model, data
