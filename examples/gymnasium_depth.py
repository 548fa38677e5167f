# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Add depth and visible fractions to observations of Gymnasium environments: one, then four in workers.

Uses Fetch's PickAndPlace if gymnasium-robotics is installed, else Gymnasium's Pusher. Writes depth.png.
"""

import gymnasium as gym
import matplotlib  # noqa: TID253
import numpy as np
import warp as wp

from warpvis.mujoco.gymnasium import DepthObservation, PoseObservation, VectorDepthObservation

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: TID253


def choose_environment():
    """Return the environment's name, and options for camera and objects."""
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
    """Create an environment of the vector environment, which renders it."""
    if "Fetch" in name:
        import gymnasium_robotics

        gym.register_envs(gymnasium_robotics)  # in every worker
    return PoseObservation(gym.make(name))


wp.config.log_level = wp.LOG_WARNING
name, options = choose_environment()

env = DepthObservation(gym.make(name), width=128, height=128, outputs=("depth", "segmentation"), **options)
observation, _ = env.reset(seed=0)
print(f"{name}: observations have {', '.join(sorted(observation))}")
env.action_space.seed(0)
for _ in range(50):
    observation, *_ = env.step(env.action_space.sample())
shown = zip(options["objects"], observation["visible_fraction"], strict=True)
print("after 50 steps show", ", ".join(f"{fraction:.0%} of {what}" for what, fraction in shown))
segmentation = observation["segmentation"]
far = observation["depth"][segmentation >= 0].max()  # maximum depth of objects: empty pixels have the far plane's depth
figure, (left, right) = plt.subplots(1, 2, figsize=(8, 4), layout="constrained")
figure.colorbar(left.imshow(observation["depth"], vmax=far, cmap="turbo_r"), ax=left, shrink=0.8, label="depth [m]")
right.imshow(np.unique(segmentation, return_inverse=True)[1].reshape(segmentation.shape), cmap="tab20")
for axes, title in ((left, "depth"), (right, "geoms")):
    axes.set(title=title, xticks=[], yticks=[])
figure.savefig("depth.png", dpi=100)
env.close()

# Four environments in workers, whose images are rendered in this process by one call. Workers are forked; for spawned
# workers, the script must be guarded by `if __name__ == "__main__"`.
envs = gym.vector.AsyncVectorEnv([make] * 4, context="fork")
envs = VectorDepthObservation(envs, width=64, height=64, **options)
observations, _ = envs.reset(seed=0)
envs.action_space.seed(0)
for _ in range(20):
    observations, rewards, *_ = envs.step(envs.action_space.sample())
print(f"{envs.num_envs} environments: depth {observations['depth'].shape} {observations['depth'].dtype}")
envs.close()
