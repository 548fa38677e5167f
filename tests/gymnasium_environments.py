# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Small MuJoCo environments that worker processes import."""

import gymnasium as gym
import mujoco
import numpy as np

# A cup of two geoms slides behind a wall; another body hangs from a hinge.
MJCF = """
<mujoco>
  <visual><map znear="0.01" zfar="20"/></visual>
  <statistic extent="1"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body name="shelf" pos="0 1 .2"><geom name="board" type="box" size=".8 .05 .2"/></body>
    <geom name="wall" type="box" size=".3 .02 .5" pos=".5 -.5 .5"/>
    <body name="cup" pos="-.5 0 .3">
      <joint name="slide" type="slide" axis="1 0 0" damping="1"/>
      <geom name="ball" type="sphere" size=".15"/>
      <site name="mark" pos="0 -.2 .1" size=".06"/>
      <geom name="handle" type="capsule" size=".04" fromto="0 0 0 0 0 .35"/>
    </body>
    <body name="lamp" pos="0 .4 1.2">
      <joint name="hinge" type="hinge" axis="0 1 0"/>
      <geom name="bulb" type="sphere" size=".1" pos="0 0 -.3"/>
    </body>
    <body name="stand" mocap="true" pos=".9 .3 .2"><geom name="foot" type="box" size=".1 .1 .2"/></body>
    <camera name="front" pos="0 -3 .6" xyaxes="1 0 0 0 .1 1" fovy="50"/>
    <camera name="chase" pos="0 -2 1" mode="targetbody" target="cup" fovy="60"/>
  </worldbody>
  <actuator><motor joint="slide" gear="5"/></actuator>
</mujoco>
"""


class Cup(gym.Env, gym.utils.EzPickle):
    """Pushes the cup; an episode has `length` steps."""

    def __init__(self, length=1000, dictionary=False, size=0.15):
        gym.utils.EzPickle.__init__(self, length, dictionary, size)
        self.model = mujoco.MjModel.from_xml_string(MJCF.replace('"sphere" size=".15"', f'"sphere" size="{size}"'))
        self.data = mujoco.MjData(self.model)
        self.length, self.steps, self.dictionary = length, 0, dictionary
        box = gym.spaces.Box(-np.inf, np.inf, (4,))
        self.observation_space = gym.spaces.Dict({"joints": box}) if dictionary else box
        self.action_space = gym.spaces.Box(-1, 1, (1,))

    def now(self):
        joints = np.concatenate([self.data.qpos, self.data.qvel])
        joints = np.clip(joints, -1e6, 1e6).astype(np.float32)
        return {"joints": joints} if self.dictionary else joints

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = self.np_random.uniform(-0.4, 0.4, 2)
        self.data.mocap_pos[0, 0] = self.np_random.uniform(0.7, 1.0)
        mujoco.mj_forward(self.model, self.data)
        self.steps = 0
        return self.now(), {}

    def step(self, action):
        self.data.ctrl[:] = action
        mujoco.mj_step(self.model, self.data, nstep=10)
        self.steps += 1
        return self.now(), 0.0, self.steps >= self.length, False, {}

    def set_model(self, name, row, value):
        """Change a row of the model, as domain randomization does."""
        getattr(self.model, name)[row] = value
        mujoco.mj_forward(self.model, self.data)


def make_cup(wrapper=None, **options):
    """Return the environment, in a warpvis wrapper if given."""
    import warp as wp

    import warpvis.mujoco.gymnasium as wrappers

    wp.config.log_level = wp.LOG_WARNING
    length = options.pop("length", 1000)
    size = options.pop("size", 0.15)
    env = Cup(length, size=size)
    return env if wrapper is None else getattr(wrappers, wrapper)(env, **options)
