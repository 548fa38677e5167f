# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of visible fractions, lines of sight and cameras watched live: ``name: (function, arguments)``."""

import mujoco
from arguments_shared import CAMERA, DEPTH, MODEL, MOVED, POSE, SCALES, VIEW, WORLDS, agents, scene

import warpvis as wv


def visibility_cases():
    """Return the cases."""
    seen = scene()
    options = {"objects": {"both": ["box", "cart"]}, "canvas": (1, 1, 1, 1), "min_samples": 4, "occluders": 2}
    options |= {"near_plane": "clip", "caster": "auto", "threads": 1}
    meter = wv.visibility.FractionMeter(seen, CAMERA, objects=["box"])
    margins = {"objects": ["box", "cart"], "reach": 4.0, "min_samples": 4, "near_plane": "clip", "threads": 1}
    margins |= {"cull_backfaces": False, "caster": "auto"}
    margin_meter = wv.visibility.MarginMeter(seen, CAMERA, objects=["box"])
    data = mujoco.MjData(MODEL)
    mujoco.mj_forward(MODEL, data)
    checker = wv.mujoco.VisibilityChecker(MODEL, data, width=8, height=6)
    watcher = wv.visibility.DepthWatcher(CAMERA, places={"mug": (2.0, 0.0, 1.0, 0.2)}, floor=-1.0, cell_size=0.1)
    watched = watcher.update(DEPTH, POSE, time=0.0)
    return {
        "VisibilityChecker": (
            wv.mujoco.VisibilityChecker,
            {"model": MODEL, "data": data, "width": 8, "height": 6, "device": "cpu"},
        ),
        "VisibilityChecker.check_visibility": (
            lambda camera_name: checker.check_visibility(camera_name, 1),
            {"camera_name": "eye"},
        ),
        "VisibilityChecker.visible_fractions": (
            lambda camera_name: checker.visible_fractions(camera_name, 1),
            {"camera_name": "eye"},
        ),
        "VisibilityChecker.get_visible_objects": (checker.get_visible_objects, {"camera_name": "eye"}),
        "VisibilityChecker.check_camera_visibility_constraints": (
            checker.check_camera_visibility_constraints,
            {"constraints": {"eye": {1: 0.1}}},
        ),
        "visible_fractions": (wv.visible_fractions, {"scene": seen, **VIEW, **WORLDS, **SCALES, **options}),
        "FractionMeter": (wv.visibility.FractionMeter, {"scene": seen, "camera": CAMERA, **options}),
        "FractionMeter.measure": (
            meter.measure,
            {"camera_to_world": POSE, **WORLDS, **SCALES, "convention": "opencv", "quaternion": "xyzw", "out": None},
        ),
        "visibility_margins": (
            wv.visibility.visibility_margins,
            {"scene": seen, **VIEW, **WORLDS, **SCALES, **margins},
        ),
        "MarginMeter": (wv.visibility.MarginMeter, {"scene": seen, "camera": CAMERA, **margins}),
        "MarginMeter.measure": (
            margin_meter.measure,
            {"camera_to_world": POSE, **WORLDS, **SCALES, "convention": "opencv", "quaternion": "xyzw"},
        ),
        "point_margins": (
            wv.visibility.point_margins,
            {"scene": seen, **VIEW, "points": [[0, 0, 1]], **WORLDS, **SCALES, "reach": 4.0, "tolerance": 0.01},
        ),
        "DepthWatcher": (
            wv.visibility.DepthWatcher,
            {
                "camera": CAMERA,
                "places": {"mug": (2.0, 0.0, 1.0, 0.2)},
                "floor": -1.0,
                "up": (0.0, 0.0, 1.0),
                "camera_height": 1.0,
                "cell_size": 0.1,
                "max_range": 3.0,
                "sigma": 0.01,
                "person_radius": 0.3,
                "robot": "robot",
                "model": wv.visibility.ReferenceModel(),
                "device": "cpu",
            },
        ),
        "DepthWatcher.update": (
            watcher.update,
            {"depth": DEPTH, "camera_to_world": POSE, "people": agents()[1:], "time": 1.0}
            | {"convention": "opencv", "quaternion": "xyzw"},
        ),
        "DepthWatcher.lines_of_sight": (watcher.lines_of_sight, {"point": (1.0, 0.0, 0.2)}),
        "DepthWatcher.turn_eyes": (watcher.turn_eyes, {"name": "human", "angles": (0.2, -0.1)}),
        "line_of_sight": (
            wv.visibility.line_of_sight,
            {"scene": seen, "agent": agents()[0], "point": (1.0, 0.0, 0.2), "tolerance": 0.001}
            | {"occupancy": None, "object_poses": MOVED},
        ),
        "Watched.floor_map": (watched.floor_map, {"cell_size": 0.1, "max_range": 3.0}),
    }
