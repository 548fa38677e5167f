# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of functions that measure visible fractions: ``name: (function, arguments)``."""

from arguments_shared import CAMERA, POSE, VIEW, WORLDS, scene

import warpvis as wv


def visibility_cases():
    """Return the cases."""
    seen = scene()
    options = {"objects": {"both": ["box", "cart"]}, "canvas": (1, 1, 1, 1), "min_samples": 4, "occluders": 2}
    options |= {"caster": "auto", "threads": 1}
    meter = wv.visibility.FractionMeter(seen, CAMERA, objects=["box"])
    return {
        "visible_fractions": (wv.visible_fractions, {"scene": seen, **VIEW, **WORLDS, **options}),
        "FractionMeter": (wv.visibility.FractionMeter, {"scene": seen, "camera": CAMERA, **options}),
        "FractionMeter.measure": (
            meter.measure,
            {"camera_to_world": POSE, **WORLDS, "convention": "opencv", "quaternion": "xyzw"},
        ),
    }
