# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What a camera at a pose sees, and which points and objects of the world are visible from it.

>>> import trimesh, warpvis as wv
>>> scene = wv.Scene()
>>> scene.add(trimesh.creation.icosphere(radius=0.1), name="ball", label="object", pose=(2, 0, 0, 0, 0, 0, 1))
0
>>> views = wv.render(scene, wv.Camera.kinect(), wv.look_at((0, 0, 0), (2, 0, 0)))
>>> views.depth.shape
(1, 240, 320)
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

# In a checkout, `kernels/` and `scenes/` stand beside this folder; installed, they are inside it. This lets a checkout
# that shadows an installation (`python -m pytest` in its root) find its own.
_root = Path(__file__).resolve().parent.parent
if (_root / "pyproject.toml").is_file() and (_root / "kernels").is_dir():
    __path__.append(str(_root))

if TYPE_CHECKING:
    from warpvis.agents import Agent, Field
    from warpvis.batch.api import BatchSummary, render_batch
    from warpvis.batch.frame_renderer import FrameRenderer
    from warpvis.camera import Camera
    from warpvis.classification import Sphere, back_project, classify, classify_rendered
    from warpvis.errors import ArrayError, CameraError, FileFormatError, PoseError, SceneError, WarpvisError
    from warpvis.floor_plan import PlanVisibility, plan_visibility
    from warpvis.frames import Frames
    from warpvis.free_space import clearance, standing_room
    from warpvis.heights import minimum_height
    from warpvis.io.pose_files import read_frames
    from warpvis.labels import Label, Visibility
    from warpvis.objects import BOP_DELTA, ObjectVisibility, object_visibility
    from warpvis.perspectives import Candidate, Perspective, State, perspective
    from warpvis.placement import BestViews, best_views, pose_grid
    from warpvis.points import check_points, check_points_measured
    from warpvis.pose import look_at, parse_poses
    from warpvis.proposals import Proposal, propose_view
    from warpvis.renderer import Renderer, Views, render
    from warpvis.scene import Scene
    from warpvis.scene_object import SceneObject
    from warpvis.surfaces import Coverage, Samples, coverage, surface_samples
    from warpvis.visibility import FloorMap, visibility_map
    from warpvis.voxels import Voxel, VoxelMap, voxel_map, voxel_map_of

# Where each public name lives. It is imported when first used: `import warpvis` stays quick, and so does the CLI.
_HOME = {
    "Agent": "agents",
    "ArrayError": "errors",
    "BOP_DELTA": "objects",
    "BatchSummary": "batch.api",
    "BestViews": "placement",
    "Camera": "camera",
    "CameraError": "errors",
    "Candidate": "perspectives",
    "Coverage": "surfaces",
    "Field": "agents",
    "FileFormatError": "errors",
    "FloorMap": "visibility",
    "FrameRenderer": "batch.frame_renderer",
    "Frames": "frames",
    "Label": "labels",
    "ObjectVisibility": "objects",
    "Perspective": "perspectives",
    "PlanVisibility": "floor_plan",
    "PoseError": "errors",
    "Proposal": "proposals",
    "Renderer": "renderer",
    "Samples": "surfaces",
    "Scene": "scene",
    "SceneError": "errors",
    "SceneObject": "scene_object",
    "Sphere": "classification",
    "State": "perspectives",
    "Views": "renderer",
    "Visibility": "labels",
    "Voxel": "voxels",
    "VoxelMap": "voxels",
    "WarpvisError": "errors",
    "back_project": "classification",
    "best_views": "placement",
    "check_points": "points",
    "check_points_measured": "points",
    "classify": "classification",
    "classify_rendered": "classification",
    "clearance": "free_space",
    "coverage": "surfaces",
    "look_at": "pose",
    "minimum_height": "heights",
    "object_visibility": "objects",
    "parse_poses": "pose",
    "perspective": "perspectives",
    "plan_visibility": "floor_plan",
    "pose_grid": "placement",
    "propose_view": "proposals",
    "read_frames": "io.pose_files",
    "render": "renderer",
    "render_batch": "batch.api",
    "standing_room": "free_space",
    "surface_samples": "surfaces",
    "visibility_map": "visibility",
    "voxel_map": "voxels",
    "voxel_map_of": "voxels",
}

_SUBPACKAGES = ("batch", "io", "mujoco", "pose_generators", "scenes", "solids", "viz", "webots")

__all__ = [
    "BOP_DELTA",
    "Agent",
    "ArrayError",
    "BatchSummary",
    "BestViews",
    "Camera",
    "CameraError",
    "Candidate",
    "Coverage",
    "Field",
    "FileFormatError",
    "FloorMap",
    "FrameRenderer",
    "Frames",
    "Label",
    "ObjectVisibility",
    "Perspective",
    "PlanVisibility",
    "PoseError",
    "Proposal",
    "Renderer",
    "Samples",
    "Scene",
    "SceneError",
    "SceneObject",
    "Sphere",
    "State",
    "Views",
    "Visibility",
    "Voxel",
    "VoxelMap",
    "WarpvisError",
    "__version__",
    "back_project",
    "best_views",
    "check_points",
    "check_points_measured",
    "classify",
    "classify_rendered",
    "clearance",
    "coverage",
    "look_at",
    "minimum_height",
    "object_visibility",
    "parse_poses",
    "perspective",
    "plan_visibility",
    "pose_grid",
    "propose_view",
    "read_frames",
    "render",
    "render_batch",
    "standing_room",
    "surface_samples",
    "visibility_map",
    "voxel_map",
    "voxel_map_of",
]


def __getattr__(name: str) -> Any:
    if name in _SUBPACKAGES:
        return importlib.import_module(f"warpvis.{name}")
    if name not in _HOME:
        raise AttributeError(f"module 'warpvis' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"warpvis.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
