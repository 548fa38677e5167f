# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of public functions of `webots`: ``name: (function, arguments)``."""

from arguments_shared import DEPTH, POSE, RangeFinder

import warpvis as wv
from warpvis.scene.lights import AmbientOcclusion


def webots_cases(folder):
    """Return the cases; write their files to `folder`."""
    world = wv.webots.load_webots(folder / "lab.wbt")
    eye = wv.webots.DepthEye(RangeFinder())
    return {
        "DepthEye": (
            wv.webots.DepthEye,
            {
                "range_finder": RangeFinder(),
                "node": None,
                "translation": (0, 0, 0),
                "rotation": (0, 0, 1, 0),
                "version": "R2023b",
                "near": 0.01,
            },
        ),
        "DepthEye.pose": (eye.pose, {"node_pose": POSE}),
        "DepthEye.points": (eye.points, {"node_pose": POSE}),
        "DepthEye.classify": (eye.classify, {"node_pose": POSE, "up": "z"}),
        "DepthEye.floor_map": (
            eye.floor_map,
            {"node_pose": POSE, "bounds": [[0, 0], [1, 1]], "cell_size": 0.1, "up": "z"},
        ),
        "Lens": (wv.webots.Lens, {"center": (0.5, 0.5), "radial": (0, 0), "tangential": (0, 0)}),
        "Version.parse": (wv.webots.Version.parse, {"text": "R2023b"}),
        "add_noise": (
            wv.webots.add_noise,
            {"values": DEPTH[0], "noise": 0.1, "max_range": 3.0, "version": world.version, "seed": 0},
        ),
        "WebotsWorld.device_poses": (
            world.device_poses,
            {"name": "range-finder", "values": {}, "check_limits": True},
        ),
        "distort_pixels": (
            wv.webots.distort_pixels,
            {"width": 8, "height": 6, "center": (0.5, 0.5), "radial": (0, 0), "tangential": (0, 0)},
        ),
        "Lidar.points": (wv.webots.find_lidar(world, "lidar").points, {"ranges": [[1.0] * 8]}),
        "find_device": (wv.webots.find_device, {"world": world, "name": "range-finder"}),
        "find_lidar": (wv.webots.find_lidar, {"world": world, "name": "lidar"}),
        "load_webots": (
            wv.webots.load_webots,
            {
                "path": folder / "lab.wbt",
                "device": "cpu",
                "labels": {"box": "human"},
                "label_names": {9: "shelf"},
                "search_path": [folder],
                "strict": False,
                "movable": ["box"],
            },
        ),
        "quantize": (wv.webots.quantize, {"values": DEPTH[0], "resolution": 0.1}),
        "range_values": (
            wv.webots.range_values,
            {
                "depth": DEPTH,
                "near": 0.1,
                "min_range": 0.1,
                "max_range": 3.0,
                "version": world.version,
                "projection": "planar",
                "near_bias": False,
            },
        ),
        "recognize": (wv.webots.recognize, {"world": world, "camera_name": "camera", "threads": 1}),
        "render_color": (
            wv.webots.render_color,
            {
                "world": world,
                "device_name": "camera",
                "exclude_body": False,
                "shadows": True,
                "reflections": True,
                "ambient_occlusion": AmbientOcclusion(0.5),
                "samples": 1,
                "threads": 1,
            },
        ),
        "render_lidar": (
            wv.webots.render_lidar,
            {
                "world": world,
                "lidar_name": "lidar",
                "webots_version": "header",
                "exclude_body": False,
                "seed": 0,
                "threads": 1,
            },
        ),
        "render_range": (
            wv.webots.render_range,
            {
                "world": world,
                "device_name": "range-finder",
                "webots_version": "header",
                "exclude_body": False,
                "seed": 0,
                "threads": 1,
            },
        ),
        "robot_agent": (wv.webots.robot_agent, {"world": world, "device_name": "range-finder", "name": "robot"}),
        "segmentation_image": (
            wv.webots.segmentation_image,
            {"world": world, "camera_name": "camera", "threads": 1},
        ),
    }
