# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of constraints, sampled poses and placed cameras: ``name: (function, arguments)``."""

from arguments_shared import CAMERA, MOVED, POSE, VIEW, WORLDS, agents, scene

import warpvis as wv


def planning_cases(folder):
    """Return the cases; they write to `folder`."""
    seen, planned, path = scene(), wv.planning, folder / "out"
    sampled = {
        "move": {"cart": planned.SupportRegion("floor")},
        "max_tries": 40,
        "refine": True,
        "partial": True,
        "object_poses": MOVED,
        "exclude": None,
        "quaternion": "xyzw",
        "threads": 1,
    }
    placed = planned.place_cameras(seen, CAMERA, POSE, [[3, 0, 0]], 1)
    one = {"object_poses": MOVED, "exclude": ["floor"], "threads": 1}
    return {
        "Constraint": (
            planned.Constraint,
            {
                "fraction": (0.0, 1.0),
                "pixels": (0, None),
                "image_fraction": (0.0, 1.0),
                "distance": (0.1, 9.0),
                "angle": (0.0, 1.0),
                "direction": (1.0, 0.0, 0.0),
                "margin": 1,
                "status": "visible",
            },
        ),
        "check_constraints": (
            planned.check_constraints,
            {
                "scene": seen,
                **VIEW,
                "constraints": {"box": (0.5, 1.0)},
                **WORLDS,
                "quaternion": "xyzw",
                "threads": 1,
            },
        ),
        "place_cameras": (
            planned.place_cameras,
            {
                "scene": seen,
                "camera": CAMERA,
                "candidates": [POSE],
                "targets": [[3, 0, 0]],
                "k": 1,
                "at_least": 1,
                "weights": [1.0],
                "fixed": [POSE],
                "method": "exact",
                "time_limit": 9.0,
                "occupancy": None,
                "tolerance": 0.1,
                "convention": "opencv",
                "quaternion": "xyzw",
                **one,
            },
        ),
        "Placement.blind_spots": (placed.blind_spots, {"at_least": 1}),
        "save_placement": (
            wv.viz.save_placement,
            {"scene": seen, "placement": placed, "path": path.with_suffix(".png"), "cell_size": 0.5, "title": "a map"},
        ),
        "unknown_targets": (
            planned.unknown_targets,
            {"occupancy": wv.OccupancyMap(cell_size=0.1), "bounds": [(0, 0, 0), (1, 1, 1)]},
        ),
        "BoxRegion": (
            planned.BoxRegion,
            {"bounds": [[0, -1, 0], [0.5, 1, 1]], "look_at": "box", "jitter": 0.1, "roll": (0.0, 0.1)},
        ),
        "ShellRegion": (
            planned.ShellRegion,
            {
                "target": "box",
                "distance": (0.5, 1.0),
                "azimuth": (0.0, 1.0),
                "elevation": (0.0, 0.5),
                "height": (0.1, 0.2),
                "jitter": 0.1,
                "roll": (0.0, 0.1),
            },
        ),
        "SupportRegion": (planned.SupportRegion, {"support": "floor", "margin": 0.1, "yaw": (0.0, 1.0)}),
        "sample_views": (
            planned.sample_views,
            {
                "scene": seen,
                "camera": CAMERA,
                "constraints": {"box": (0.5, 1.0)},
                "region": planned.ShellRegion("box", (0.5, 1.0)),
                "count": 1,
                "seed": 0,
                "agents": [(agents()[0], {"box": (0.0, 1.0)})],
                **sampled,
            },
        ),
        "sample_objects": (
            planned.sample_objects,
            {
                "scene": seen,
                "agents": [(agents()[0], {"cart": (0.0, 1.0)})],
                "count": 1,
                "seed": 0,
                **sampled,
            },
        ),
    }
