# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Train a camera on a rail to look around boxes at a mug, rewarded by the visible fraction.

An episode begins with the mug hidden behind two boxes and the camera turned to a random direction. PPO of
Stable-Baselines3 learns to move and turn the camera so that the mug is visible. With the same number of steps and a
reward of 1 for episodes that end with a visible mug, it does not. Requires `pip install stable-baselines3 matplotlib`;
takes about a minute a run on two loaded CPU cores, and writes active_camera.png.
"""

import sys
import time

import gymnasium as gym
import matplotlib.pyplot as plt  # noqa: TID253
import mujoco  # noqa: TID253
import numpy as np
import torch  # noqa: TID253
import warp as wp
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv

import warpvis as wv
from warpvis.mujoco.gymnasium import VisibilityReward

STEPS = int(sys.argv[1]) if len(sys.argv) > 1 else 16_000
RUNS = [("shaped", 0), ("shaped", 1), ("fraction", 0), ("sparse", 0)]
COLORS = {"shaped": "tab:green", "fraction": "tab:blue", "sparse": "tab:red"}
LENGTH, SPEED, TURN = 24, 0.12, 0.35  # steps of an episode; m and rad of a step
EPISODES = 100  # of an evaluation
MJCF = """
<mujoco>
  <visual><map znear="0.01" zfar="10"/></visual>
  <statistic extent="1"/>
  <worldbody>
    <light pos="0 0 3" diffuse=".7 .7 .7"/>
    <geom name="floor" type="plane" size="4 4 .1" rgba=".8 .8 .75 1"/>
    <body name="mug" mocap="true" pos="0 1.5 .06">
      <geom type="cylinder" size=".05 .06" rgba=".8 .2 .2 1"/>
      <geom type="capsule" size=".01 .03" pos=".065 0 0" rgba=".8 .2 .2 1"/>
    </body>
    <body mocap="true" pos="0 .8 .2"><geom type="box" size=".16 .06 .2" rgba=".6 .45 .3 1"/></body>
    <body mocap="true" pos=".4 .8 .2"><geom type="box" size=".16 .06 .2" rgba=".4 .5 .6 1"/></body>
    <body pos="0 0 .2">
      <joint type="slide" axis="1 0 0"/>
      <geom type="box" size=".03 .03 .02" pos="0 -.05 -.03" mass="1"/>
      <body>
        <joint type="hinge" axis="0 0 1"/>
        <geom type="box" size=".02 .02 .02" pos="0 -.05 0" mass="1"/>
        <camera name="eye" xyaxes="1 0 0 0 0 1" fovy="35"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


class HiddenMug(gym.Env):
    """A camera that moves along a rail and turns; observations have no images, only positions and an angle."""

    def __init__(self):
        """Load the model."""
        self.model = mujoco.MjModel.from_xml_string(MJCF)
        self.data = mujoco.MjData(self.model)
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (9,), np.float32)
        self.action_space = gym.spaces.Box(-1, 1, (2,), np.float32)

    def reset(self, *, seed=None, options=None):
        """Hide the mug behind a box, and turn the camera."""
        super().reset(seed=seed)
        random = self.np_random
        mug = random.uniform([-0.5, 1.3], [0.5, 1.7])
        camera = np.array([mug[0] + random.uniform(-0.4, 0.4), 0])
        box = camera + random.uniform(0.45, 0.6) * (mug - camera)  # between the camera and the mug
        other = box + [random.choice([-1, 1]) * random.uniform(0.3, 0.34), random.uniform(-0.05, 0.05)]
        self.data.mocap_pos[:, :2] = mug, box, other
        self.data.qpos[:] = camera[0], random.uniform(-np.pi, np.pi)
        mujoco.mj_forward(self.model, self.data)
        self.steps = 0
        return self.positions(), {}

    def step(self, action):
        """Move and turn the camera."""
        self.data.qpos[:] += np.clip(action, -1, 1) * (SPEED, TURN)
        self.data.qpos[0] = np.clip(self.data.qpos[0], -1.2, 1.2)
        mujoco.mj_forward(self.model, self.data)
        self.steps += 1
        return self.positions(), 0.0, False, self.steps >= LENGTH, {}

    def positions(self):
        """Return the camera's joints, and where the mug and the boxes are relative to it."""
        rail, pan = self.data.qpos
        objects = self.data.mocap_pos[:, :2] - [rail, 0]
        return np.array([rail, np.sin(pan), np.cos(pan), *objects.ravel()], dtype=np.float32)


class SparseReward(gym.Wrapper):
    """A reward of 1 for an episode at whose end the mug is completely visible."""

    def step(self, action):
        """Replace the reward."""
        observation, _, terminated, truncated, info = self.env.step(action)
        return observation, float(truncated and info["visible_fraction"][0] == 1), terminated, truncated, info


def make(reward):
    """Return the environment with a reward."""
    env = VisibilityReward(HiddenMug(), ["mug"], camera="eye", width=48, height=36, shaped=reward == "shaped")
    return SparseReward(env) if reward == "sparse" else env


class Curve(BaseCallback):
    """The visible fraction at the end of each episode of a training."""

    def __init__(self):
        """Begin with no episodes."""
        super().__init__()
        self.steps, self.fractions = [], []

    def _on_step(self):
        for done, info in zip(self.locals["dones"], self.locals["infos"], strict=True):
            if done:
                self.steps.append(self.num_timesteps)
                self.fractions.append(float(info["visible_fraction"][0]))
        return True


def evaluate(policy, seed=1000):
    """Return the visible fraction at the end of new episodes."""
    env, fractions = make("fraction"), []
    for episode in range(EPISODES):
        observation, truncated = env.reset(seed=seed + episode)[0], False
        while not truncated:
            action = policy.predict(observation, deterministic=True)[0]
            observation, _, _, truncated, info = env.step(action)
        fractions.append(float(info["visible_fraction"][0]))
    return np.array(fractions)


def pictures(policy, seed):
    """Return what the camera sees in an episode, each 6 steps."""
    env = HiddenMug()
    observation, images = env.reset(seed=seed)[0], []
    renderer = wv.mujoco.BatchRenderer(env.model, width=160, height=120, outputs=("color",), samples=4)
    for step in range(LENGTH):
        if step % 6 == 0 or step == LENGTH - 1:
            images.append(renderer.render(env.data, cameras="eye").color.numpy()[0])
        observation = env.step(policy.predict(observation, deterministic=True)[0])[0]
    return np.concatenate(images, axis=1)


def smooth(values, count=50):
    """Return running means of the last values."""
    sums = np.cumsum(np.r_[0.0, values])
    ends = np.arange(1, len(values) + 1)
    begins = np.maximum(ends - count, 0)
    return (sums[ends] - sums[begins]) / (ends - begins)


wp.config.log_level = wp.LOG_WARNING
torch.set_num_threads(1)
figure, (curves, film) = plt.subplots(2, 1, figsize=(7, 5), height_ratios=(2.2, 1), layout="constrained")
options = {"n_steps": 64, "batch_size": 128, "n_epochs": 10, "learning_rate": 1e-3, "gamma": 0.9, "gae_lambda": 0.9}
for reward, seed in RUNS:
    start, curve = time.perf_counter(), Curve()
    envs = DummyVecEnv([lambda reward=reward: make(reward)] * 8)
    policy = PPO("MlpPolicy", envs, seed=seed, policy_kwargs={"log_std_init": -0.5}, **options)
    policy.learn(STEPS, callback=curve)
    seconds, fractions = time.perf_counter() - start, evaluate(policy)
    print(
        f"{reward}, seed {seed}: {fractions.mean():.0%} of the mug visible at the end, completely in "
        f"{np.mean(fractions == 1):.0%} of {EPISODES} episodes; {policy.num_timesteps} steps, {seconds:.0f} s",
        flush=True,
    )
    style = "-" if seed == 0 else "--"
    label = f"{reward}, seed {seed}: {fractions.mean():.0%} after training"
    curves.plot(curve.steps, smooth(curve.fractions), style, color=COLORS[reward], label=label)
    if (reward, seed) == RUNS[0]:
        film.imshow(pictures(policy, seed=1007))
curves.set(xlabel="environment steps", ylabel="visible fraction at the end", ylim=(-0.02, 1.02))
curves.legend(fontsize=8)
film.set_title("an episode of the trained policy, each 6 steps", fontsize=9)
film.axis("off")
figure.savefig("active_camera.png", dpi=110)
