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
    from warpvis.camera import Camera
    from warpvis.classification import Sphere, back_project, classify, classify_rendered
    from warpvis.errors import ArrayError, CameraError, FileFormatError, PoseError, SceneError, WarpvisError
    from warpvis.floor_plan import PlanVisibility, plan_visibility
    from warpvis.labels import Label, Visibility
    from warpvis.points import check_points, check_points_measured
    from warpvis.pose import look_at, parse_poses
    from warpvis.renderer import Renderer, Views, render
    from warpvis.scene import Scene, SceneObject
    from warpvis.visibility import FloorMap, visibility_map

# Where each public name lives. It is imported when first used: `import warpvis` stays quick, and so does the CLI.
_HOME = {
    "ArrayError": "errors",
    "Camera": "camera",
    "CameraError": "errors",
    "FileFormatError": "errors",
    "FloorMap": "visibility",
    "Label": "labels",
    "PlanVisibility": "floor_plan",
    "PoseError": "errors",
    "Renderer": "renderer",
    "Scene": "scene",
    "SceneError": "errors",
    "SceneObject": "scene",
    "Sphere": "classification",
    "Views": "renderer",
    "Visibility": "labels",
    "WarpvisError": "errors",
    "back_project": "classification",
    "check_points": "points",
    "check_points_measured": "points",
    "classify": "classification",
    "classify_rendered": "classification",
    "look_at": "pose",
    "parse_poses": "pose",
    "plan_visibility": "floor_plan",
    "render": "renderer",
    "visibility_map": "visibility",
}

_SUBPACKAGES = ("io", "mujoco", "scenes", "solids", "viz")

__all__ = [
    "ArrayError",
    "Camera",
    "CameraError",
    "FileFormatError",
    "FloorMap",
    "Label",
    "PlanVisibility",
    "PoseError",
    "Renderer",
    "Scene",
    "SceneError",
    "SceneObject",
    "Sphere",
    "Views",
    "Visibility",
    "WarpvisError",
    "__version__",
    "back_project",
    "check_points",
    "check_points_measured",
    "classify",
    "classify_rendered",
    "look_at",
    "parse_poses",
    "plan_visibility",
    "render",
    "visibility_map",
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
