# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of public functions of `planning`: ``name: (function, arguments)``."""

from arguments_shared import CAMERA, MOVED, POSE, SEEN, VIEW, WORLDS, agents, scene

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
    found = SEEN.candidates("human", "robot", labels=None)
    room = {"radius": 0.1, "floor": -1.0, "step": 0.1}
    best = planned.best_views(seen, CAMERA, POSE, objects=["box"])
    covered = planned.coverage(seen, CAMERA, POSE)
    return {
        "BestViews.pose": (best.pose, {"rank": 0}),
        "Coverage.best": (covered.best, {"count": 1}),
        "best_views": (
            planned.best_views,
            {
                "scene": seen,
                "camera": CAMERA,
                "candidates": [POSE],
                "objects": ["box"],
                "weights": [1.0],
                "measure": "fraction",
                "count": 1,
                "start": (0, 0, 0),
                "path_lengths": None,
                "tie": 0.1,
                "radius": 0.1,
                "floor": -2.0,
                "delta": 0.1,
                "convention": "opencv",
                **one,
            },
        ),
        "clearance": (
            planned.clearance,
            {"scene": seen, "points": [[0, 0, 0]], "max_distance": 9.0, "objects": ["box"], **one},
        ),
        "coverage": (
            planned.coverage,
            {"scene": seen, **VIEW, "samples": None, "weights": None, "count": 1, "tolerance": 0.1, **one},
        ),
        "minimum_height": (
            planned.minimum_height,
            {
                "scene": seen,
                "eyes": [[0, 0, 0]],
                "targets": [[3, 0, 0]],
                "raises": "eye",
                "max_height": 9.0,
                "end_tolerance": 0.1,
                **one,
            },
        ),
        "pose_grid": (
            planned.pose_grid,
            {"center": (0, 0, 0), "radius": 1.0, "step": 1.0, "height": 1.0, "look_at": (0, 0, 0), "up": "z"},
        ),
        "pose_grid of headings": (
            planned.pose_grid,
            {"center": (0, 0, 0), "radius": 1.0, "step": 1.0, "height": 1.0, "headings": 2, "pitch": 0.1},
        ),
        "propose_view": (
            planned.propose_view,
            {
                "scene": seen,
                "robot": agents()[0],
                "candidates": found,
                "max_distance": 1.0,
                "object_poses": MOVED,
                **room,
            },
        ),
        "standing_room": (planned.standing_room, {"scene": seen, "camera_to_world": POSE, **room, **one}),
        "surface_samples": (
            planned.surface_samples,
            {
                "scene": seen,
                "spacing": 0.5,
                "objects": ["box"],
                "object_poses": MOVED,
                "seed": 0,
            },
        ),
        "surface_samples of labels": (planned.surface_samples, {"scene": seen, "spacing": 0.5, "labels": ["object"]}),
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
