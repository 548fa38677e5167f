# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth and visible fractions in the observations of Gymnasium's environments: one, then four in workers.

Fetch's PickAndPlace if gymnasium-robotics is installed, else Gymnasium's Pusher. Writes depth.png.
"""

import gymnasium as gym
import matplotlib  # noqa: TID253
import numpy as np
import warp as wp

from warpvis.mujoco.gymnasium import DepthObservation, PoseObservation, VectorDepthObservation

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: TID253


def choose_environment():
    """The environment's name, and what to look at."""
    try:
        import gymnasium_robotics

        gym.register_envs(gymnasium_robotics)
        gym.make("FetchPickAndPlace-v4").close()
        return "FetchPickAndPlace-v4", {"camera": "external_camera_0", "objects": ["object0", "robot0:*finger*"]}
    except ImportError:
        print("gymnasium-robotics is not installed: Pusher takes the place of Fetch")
    except AssertionError:
        print("this gymnasium-robotics does not work with this MuJoCo: Pusher takes the place of Fetch")
    return "Pusher-v5", {"camera": -1, "objects": ["object", "goal"]}


def make():
    """An environment of a vector: what it renders is asked for by the vector."""
    if "Fetch" in name:
        import gymnasium_robotics

        gym.register_envs(gymnasium_robotics)  # in every worker
    return PoseObservation(gym.make(name))


wp.config.log_level = wp.LOG_WARNING
name, look = choose_environment()

env = DepthObservation(gym.make(name), width=128, height=128, outputs=("depth", "segmentation"), **look)
observation, _ = env.reset(seed=0)
print(f"{name}: observations have {', '.join(sorted(observation))}")
env.action_space.seed(0)
for _ in range(50):
    observation, *_ = env.step(env.action_space.sample())
shown = zip(look["objects"], observation["visible_fraction"], strict=True)
print("after 50 steps show", ", ".join(f"{fraction:.0%} of {what}" for what, fraction in shown))
segmentation = observation["segmentation"]
far = observation["depth"][segmentation >= 0].max()  # of what there is: empty pixels have the far plane's depth
figure, (left, right) = plt.subplots(1, 2, figsize=(8, 4), layout="constrained")
figure.colorbar(left.imshow(observation["depth"], vmax=far, cmap="turbo_r"), ax=left, shrink=0.8, label="depth [m]")
right.imshow(np.unique(segmentation, return_inverse=True)[1].reshape(segmentation.shape), cmap="tab20")
for axes, title in ((left, "depth"), (right, "geoms")):
    axes.set(title=title, xticks=[], yticks=[])
figure.savefig("depth.png", dpi=100)
env.close()

# Four environments in workers, whose images are rendered here by one call. Workers are forked: a script whose workers
# are spawned has its work below `if __name__ == "__main__"`.
envs = gym.vector.AsyncVectorEnv([make] * 4, context="fork")
envs = VectorDepthObservation(envs, width=64, height=64, **look)
observations, _ = envs.reset(seed=0)
envs.action_space.seed(0)
for _ in range(20):
    observations, rewards, *_ = envs.step(envs.action_space.sample())
print(f"{envs.num_envs} environments: depth {observations['depth'].shape} {observations['depth'].dtype}")
envs.close()
