# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""All public callables and valid arguments for them."""

import importlib
import inspect
import types

import numpy as np
import trimesh
from arguments_cameras import camera_cases
from arguments_data import data_cases
from arguments_depth import depth_sensor_cases
from arguments_lidars import lidar_cases
from arguments_maps import map_cases
from arguments_people import people_cases
from arguments_planning import planning_cases
from arguments_poses import pose_cases
from arguments_shared import CAMERA, POSE, WORLD, scene
from arguments_situations import situation_cases
from arguments_top import top_cases
from arguments_viewer import viewer_cases
from arguments_visibility import visibility_cases
from arguments_webots import webots_cases

import warpvis as wv

from support.bop_scene import write_identity


def cases(folder):
    """Return valid arguments of all public callables."""
    makers = [top_cases, camera_cases, map_cases, data_cases, lidar_cases, depth_sensor_cases]
    makers += [people_cases, planning_cases, pose_cases, situation_cases, viewer_cases, webots_cases]
    tables = [make(folder) for make in makers]
    tables.append(visibility_cases())
    return {name: case for table in tables for name, case in table.items()}


def files_for_cases(folder):
    """Write the files that the valid arguments name, and return their folder."""
    (folder / "out").mkdir()
    (folder / "lab.wbt").write_text(WORLD)
    (folder / "walk.txt").write_text("0 0 0 0 0 0 0 1\n")
    write_identity(folder / "bop")
    (folder / "stage.usda").write_text('#usda 1.0\ndef Camera "eye"\n{\n}\n')
    (folder / "robot.sdf").write_text('<sdf version="1.9"><model name="m"><link name="l"/></model></sdf>')
    (folder / "box.xml").write_text('<mujoco><worldbody><geom name="ball" size="0.1"/></worldbody></mujoco>')
    (folder / "points.txt").write_text("1 2 3\n")
    wv.io.save_depth_png(np.ones((6, 8)), folder / "recording.png")
    (folder / "recording").mkdir()
    (folder / "recording.png").rename(folder / "recording/0.png")
    np.save(folder / "mid360.npy", np.zeros((4, 2), dtype=np.float32))
    trimesh.creation.box().export(folder / "box.ply")
    wv.render_batch(scene(), CAMERA, wv.Frames.from_poses([POSE]), folder / "set", threads=1)
    return folder


def public_callables():
    """Return names of public functions and classes with parameters, and of their methods: ``Scene.add``."""
    modules = [importlib.import_module("warpvis.mujoco.gymnasium")]
    modules += [getattr(wv, name) for name in wv.__all__ if isinstance(getattr(wv, name), types.ModuleType)]
    found = {}
    for module in [wv, *modules]:
        for name in getattr(module, "__all__", ()):
            item = getattr(module, name)
            if inspect.isclass(item) and not issubclass(item, Exception | Warning):
                methods = {key: getattr(item, key) for key in vars(item) if not key.startswith("_")}
                if "EnumType" not in type(item).__name__:
                    found[name] = item
                for key, method in methods.items():
                    if callable(method) and not inspect.isclass(method):
                        found[f"{name}.{key}"] = method
            elif inspect.isfunction(item):
                found[name] = item
    return {
        name: item
        for name, item in found.items()
        if {"self", "cls"} | set(inspect.signature(item).parameters) > {"self", "cls"}
    }
