# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Gymnasium wrappers that add color, depth, segmentation and visible fractions to observations on MuJoCo.

>>> env = DepthObservation(gym.make("Ant-v5"), camera="track", width=84, height=84)
>>> observation, info = env.reset(seed=0)
>>> observation["depth"].shape
(84, 84)
"""

from __future__ import annotations

try:
    import gymnasium
except ImportError as error:
    raise ImportError(
        "warpvis.mujoco.gymnasium needs Gymnasium, which is missing: pip install 'warpvis[gymnasium]'"
    ) from error

from warpvis.mujoco.gymnasium._environments import PoseObservation
from warpvis.mujoco.gymnasium._frames import RenderFrames
from warpvis.mujoco.gymnasium._observation import DepthObservation
from warpvis.mujoco.gymnasium._vector import VectorDepthObservation
from warpvis.mujoco.gymnasium._vector_visibility import VectorVisibilityReward, VectorVisibleFractions
from warpvis.mujoco.gymnasium._visibility import VisibilityReward, VisibleFractions

del gymnasium

__all__ = [
    "DepthObservation",
    "PoseObservation",
    "RenderFrames",
    "VectorDepthObservation",
    "VectorVisibilityReward",
    "VectorVisibleFractions",
    "VisibilityReward",
    "VisibleFractions",
]
