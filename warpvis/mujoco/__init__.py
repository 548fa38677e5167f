# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth and segmentation of MuJoCo models without OpenGL, for one world or thousands.

>>> from warpvis.mujoco import Renderer  # instead of: from mujoco import Renderer
>>> with Renderer(model, 240, 320) as renderer:
...     renderer.update_scene(data, camera="wrist")
...     renderer.enable_depth_rendering()
...     depth = renderer.render()
"""

from __future__ import annotations

from warpvis.mujoco._batch import BatchRenderer
from warpvis.mujoco._batch_views import BatchViews
from warpvis.mujoco._body_visibility import BodyVisibility
from warpvis.mujoco._cameras import camera_from_mujoco
from warpvis.mujoco._lights import lights_from_mujoco
from warpvis.mujoco._model_files import read_model
from warpvis.mujoco._poses import WorldPoses, camera_poses, geom_poses
from warpvis.mujoco._rangefinders import Rangefinders
from warpvis.mujoco._renderer import Renderer
from warpvis.mujoco._scene import MujocoScene, scene_from_mujoco
from warpvis.mujoco._visibility_checker import VisibilityChecker
from warpvis.mujoco._worlds import Kinematics

__all__ = [
    "BatchRenderer",
    "BatchViews",
    "BodyVisibility",
    "Kinematics",
    "MujocoScene",
    "Rangefinders",
    "Renderer",
    "VisibilityChecker",
    "WorldPoses",
    "camera_from_mujoco",
    "camera_poses",
    "geom_poses",
    "lights_from_mujoco",
    "read_model",
    "scene_from_mujoco",
]
