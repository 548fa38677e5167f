# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of pose generators: ``name: (function, arguments)``."""

from arguments_shared import CAMERA, scene

import warpvis as wv


def pose_cases(folder):
    """Return the cases; write their files to `folder`."""
    generated = wv.pose_generators
    seen = scene()
    return {
        "along": (generated.along, {"path": [[0, 0, 0], [1, 0, 0]], "count": 2, "look": "forward", "up": "z"}),
        "frames_from_spec": (
            generated.frames_from_spec,
            {"text": "orbit target=0,0,0 radius=1 height=1 count=2", "scene": seen, "up": "z"},
        ),
        "grid": (
            generated.grid,
            {
                "bounds": [[0, 0, 0], [1, 1, 1]],
                "step": 1.0,
                "headings": 2,
                "pitch": 0.1,
                "look_at": (9, 9, 9),
                "up": "z",
            },
        ),
        "looks_like_spec": (generated.looks_like_spec, {"text": "orbit:"}),
        "framing": (
            generated.framing,
            {"scene": seen, "camera": CAMERA, "azimuth": 0.0, "elevation": 0.5},
        ),
        "orbit": (
            generated.orbit,
            {"target": (0, 0, 0), "radius": 1.0, "height": 1.0, "count": 2, "up": "z", "start": 0.0},
        ),
        "random_poses": (
            generated.random_poses,
            {
                "scene_or_bounds": seen,
                "count": 2,
                "seed": 0,
                "bounds": [[-1, -1, 0], [1, 1, 1]],
                "clearance": 0.01,
                "look": "level",
                "up": None,
                "exclude": ["box"],
                "threads": 1,
            },
        ),
        "sphere": (
            generated.sphere,
            {
                "target": (0, 0, 0),
                "radius": 1.0,
                "count": 2,
                "up": "z",
                "min_elevation": -1.0,
                "max_elevation": 1.0,
            },
        ),
    }
