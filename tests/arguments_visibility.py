# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of functions that measure visible fractions: ``name: (function, arguments)``."""

import mujoco
from arguments_shared import CAMERA, MODEL, POSE, VIEW, WORLDS, scene

import warpvis as wv


def visibility_cases():
    """Return the cases."""
    seen = scene()
    options = {"objects": {"both": ["box", "cart"]}, "canvas": (1, 1, 1, 1), "min_samples": 4, "occluders": 2}
    options |= {"caster": "auto", "threads": 1}
    meter = wv.visibility.FractionMeter(seen, CAMERA, objects=["box"])
    data = mujoco.MjData(MODEL)
    mujoco.mj_forward(MODEL, data)
    checker = wv.mujoco.VisibilityChecker(MODEL, data, width=8, height=6)
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
        "visible_fractions": (wv.visible_fractions, {"scene": seen, **VIEW, **WORLDS, **options}),
        "FractionMeter": (wv.visibility.FractionMeter, {"scene": seen, "camera": CAMERA, **options}),
        "FractionMeter.measure": (
            meter.measure,
            {"camera_to_world": POSE, **WORLDS, "convention": "opencv", "quaternion": "xyzw"},
        ),
    }
