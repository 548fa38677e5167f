# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of labels and maps from depth: ``name: (function, arguments)``."""

import numpy as np
from arguments_shared import CAMERA, DEPTH, POSE, RENDERED, SPACE, VIEW, WORLDS, scene

import warpvis as wv

NEAR_CAMERA = wv.Camera.from_fov(8, 6, hfov=1.0, near=0.1, far=3.0)
POSE_ABOVE = wv.look_at((0, 0, 1), (1, 0, 0.5))
FLOOR_POINTS = np.stack([*np.meshgrid(np.arange(0.5, 2.5, 0.02), np.arange(-1, 1, 0.02)), np.zeros((100, 100))], -1)
FLOOR = wv.fit_floor(FLOOR_POINTS, camera_to_world=POSE_ABOVE, up=(0, 0, 1))
COMPARED = wv.compare_depth(scene(), CAMERA, POSE, DEPTH, sigma=0.01)


SLIDE = """<robot name="slide"><link name="base"/>
  <link name="cart"><visual><geometry><box size=".2 .2 .2"/></geometry></visual></link>
  <joint name="slide" type="prismatic"><parent link="base"/><child link="cart"/><origin xyz="2 0 0"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def map_cases(folder):
    """Return the cases; write their files to `folder`."""
    seen = scene()
    path = folder / "out"
    (folder / "slide.urdf").write_text(SLIDE)
    robot = wv.Scene.load(folder / "slide.urdf", movable=True)
    floor_map = wv.floor_map(RENDERED.points, RENDERED.labels, bounds=[[-1, -1], [1, 1]])
    voxels = wv.voxel_map(DEPTH, CAMERA, POSE, bounds=SPACE["bounds"])
    occupancy = wv.OccupancyMap(0.1, bounds=[(-2, -2, -1), (2, 2, 1)])
    occupancy.integrate(DEPTH, CAMERA, POSE)
    occupancy.save(folder / "occupancy.npz")
    return {
        "FloorMap.area": (floor_map.area, {"label": "ground"}),
        "OccupancyMap": (
            wv.OccupancyMap,
            {
                "cell_size": 0.1,
                "bounds": [(0, 0, 0), (1, 1, 1)],
                "hit": 0.7,
                "miss": 0.4,
                "minimum": 0.1,
                "maximum": 0.9,
                "up": "z",
                "device": "cpu",
            },
        ),
        "OccupancyMap.integrate": (
            occupancy.integrate,
            {"depth": DEPTH, **VIEW, "sigma": 0.01, "max_range": 2.0, "threads": 1},
        ),
        "OccupancyMap.decay": (occupancy.decay, {"factor": 0.5}),
        "OccupancyMap.states": (occupancy.states, {"points": [(0.0, 0.0, 0.0)], "threads": 1}),
        "OccupancyMap.probabilities": (occupancy.probabilities, {"points": [(0.0, 0.0, 0.0)], "threads": 1}),
        "OccupancyMap.render_depth": (
            occupancy.render_depth,
            {**VIEW, "camera": NEAR_CAMERA, "threads": 1},
        ),
        "OccupancyMap.voxel_map": (
            occupancy.voxel_map,
            {"bounds": [(0, 0, 0), (1, 1, 1)], "ground_height": 0.0, "ground_tolerance": 0.03, "threads": 1},
        ),
        "OccupancyMap.occupancy_grid": (
            occupancy.occupancy_grid,
            {
                "bounds": [(0, 0), (1, 1)],
                "ground_height": 0.0,
                "min_height": 0.1,
                "max_height": 1.0,
                "max_unknown": 0.5,
                "threads": 1,
            },
        ),
        "OccupancyMap.mesh": (occupancy.mesh, {}),
        "OccupancyMap.from_tsdf": (
            wv.OccupancyMap.from_tsdf,
            {
                "distance": np.linspace(-0.1, 0.1, 27).reshape(3, 3, 3),
                "weight": np.ones((3, 3, 3)),
                "cell_size": 0.05,
                "origin": (0.1, 0.0, -0.05),
                "up": "z",
                "device": "cpu",
            },
        ),
        "OccupancyMap.save": (occupancy.save, {"path": path.with_suffix(".bt")}),
        "OccupancyMap.load": (
            wv.OccupancyMap.load,
            {"path": folder / "occupancy.npz", "bounds": [(0, 0, 0), (1, 1, 1)], "device": "cpu"},
        ),
        "VoxelMap.volume": (voxels.volume, {"state": "free"}),
        "VoxelMap.floor_map": (voxels.floor_map, {"robots": [(0, 0, 0.1)]}),
        "VoxelMap.merge": (voxels.merge, {"other": voxels}),
        "VoxelMap.save": (voxels.save, {"path": path / "voxels.npz"}),
        "back_project": (wv.back_project, {"depth": DEPTH, **VIEW, "device": "cpu", "threads": 1, "out": None}),
        "classify": (
            wv.classify,
            {
                "depth": DEPTH,
                **VIEW,
                "spheres": [wv.maps.Sphere((1, 0, 0), 0.1)],
                "ground_tolerance": 0.01,
                "ground_height": -1.0,
                "up": "z",
                "floor": None,
                "sigma": 0.002,
                "threshold": 2.0,
                "below_label": 9,
                "max_range": 3.0,
                "device": "cpu",
                "threads": 1,
                "out": None,
                "spheres_out": None,
            },
        ),
        "DepthComparison.changes": (
            COMPARED.changes,
            {"objects": ["box"], "min_pixels": 2, "gap": 0.1, "min_displacement": 0.02, "max_displacement": 1.0},
        ),
        "compare_depth with a map": (
            wv.compare_depth,
            {"scene": occupancy, **VIEW, "camera": NEAR_CAMERA, "depth": DEPTH, "sigma": 0.01, "tolerance": 0.1},
        ),
        "compare_depth": (
            wv.compare_depth,
            {
                "scene": seen,
                **VIEW,
                "depth": DEPTH,
                "sigma": 0.01,
                "threshold": 3.0,
                "tolerance": 0.01,
                "edge": 1,
                "complete": True,
                **WORLDS,
                "quaternion": "xyzw",
                "threads": 1,
            },
        ),
        "register": (
            wv.register,
            {
                "scene": seen,
                **VIEW,
                "depth": DEPTH,
                "sigma": 0.01,
                "moving": "cart",
                **WORLDS,
                "groups": [0],
                "huber": 2.0,
                "max_distance": 0.2,
                "min_cosine": 0.1,
                "max_jump": 0.1,
                "iterations": 2,
                "tolerance": 1e-4,
                "quaternion": "xyzw",
                "threads": 1,
            },
        ),
        "register with joints": (
            wv.register,
            {"scene": seen, **VIEW, "depth": DEPTH, "sigma": 0.01, "iterations": 1, "joint_positions": {}},
        ),
        "register of joints": (
            wv.register,
            {
                "scene": robot,
                **VIEW,
                "depth": DEPTH,
                "sigma": 0.01,
                "moving": ["slide"],
                "iterations": 1,
                "joint_positions": {"slide": 0.1},
            },
        ),
        "FloorFit.heights": (FLOOR.heights, {"points": [[0.0, 0.0, 1.0]]}),
        "fit_floor": (
            wv.fit_floor,
            {
                "measured": FLOOR_POINTS,
                "camera_to_world": POSE_ABOVE,
                "up": (0, 0, 1),
                "up_tolerance": 0.3,
                "camera_height": 1.0,
                "height_tolerance": 0.2,
                "noise": 0.003,
                "convention": "opencv",
                "quaternion": "xyzw",
                "seed": 0,
            },
        ),
        "floor_map": (
            wv.floor_map,
            {
                "points": RENDERED.points,
                "labels": RENDERED.labels,
                "bounds": [[-1, -1], [1, 1]],
                "label_names": {9: "shelf"},
                "ground_labels": ["ground"],
                "cell_size": 0.1,
                "up": "z",
                "level_tolerance": 0.01,
                "robots": [(0, 0, 0.1)],
                "threads": 1,
            },
        ),
        "voxel_map": (
            wv.voxel_map,
            {"depth": DEPTH, **VIEW, **SPACE, "cell_size": 0.5, "labels": None, "device": "cpu", "out": None},
        ),
        "voxel_map of classes": (
            wv.voxel_map,
            {"depth": DEPTH, **VIEW, **SPACE, "label_names": {9: "shelf"}, "ground_labels": ["ground"]},
        ),
        "voxel_map_from_scene": (
            wv.voxel_map_from_scene,
            {"scene": seen, **VIEW, **WORLDS, "bounds": SPACE["bounds"], "cell_size": 0.5, "threads": 1, "out": None},
        ),
    }
