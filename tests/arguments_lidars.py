# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of lidar functions in `sensors` and `io`: ``name: (function, arguments)``."""

import numpy as np
from arguments_shared import CAMERA, MESSAGE, MOVED, POSE, scene

import warpvis as wv
from warpvis.sensors import lidars


def lidar_cases(folder):
    """Return the cases; write their files to `folder`."""
    seen = scene()
    path = folder / "out"
    laser = lidars.laser_scan(-1.0, 1.0, 0.25, time_increment=0.001, far=9.0)
    scanned = wv.render(seen, laser, POSE, outputs=("depth", "normals", "segmentation"))
    cloud = wv.sensors.point_clouds(scanned, laser)[0]
    met = wv.sensors.measure_incidence(scanned, laser, POSE)
    moves = wv.sensors.Motion([POSE, POSE], [0.0, 0.1])
    shutter = wv.sensors.RollingShutter(CAMERA, 0.03)
    noise = wv.sensors.LidarNoise(sigma=0.01, dropout=0.1, detection_range=10.0)
    returns = wv.sensors.gather_returns(scanned.depth, met, 1)
    return {
        "LidarNoise": (
            wv.sensors.LidarNoise,
            {
                "sigma": 0.01,
                "sigma_growth": 0.001,
                "weak_sigma": 0.01,
                "resolution": 0.01,
                "ring_sigma": 0.01,
                "ring_offsets": [0.01, 0.0],
                "dropout": 0.1,
                "detection_range": 10.0,
                "detection_reflectivity": 0.1,
                "power_sigma": 0.1,
                "reflectivity": {"box": 0.5},
                "rain": 1.0,
                "visibility": 50.0,
                "false_returns": 0.1,
                "false_range": 1.0,
                "glare": 0.001,
                "glare_angle": 0.01,
            },
        ),
        "LidarNoise.apply": (
            noise.apply,
            {
                "returns": returns,
                "rays": laser,
                "falls_off": True,
                "seed": 1,
                "frame": 2,
                "view_index": [3],
                "out": None,
            },
        ),
        "LidarNoise.depth_sigma": (noise.depth_sigma, {"depth": [1.0, 2.0], "camera": laser}),
        "Rays.with_range": (laser.with_range, {"near": 0.2, "far": 3.0}),
        "render of a lidar, sensor": (
            wv.render,
            {"scene": seen, "camera": laser, "camera_to_world": POSE, "sensor": noise, "seed": 1, "frame": 0},
        ),
        "Livox.frame": (
            lidars.livox("mid360", folder / "mid360.npy").frame,
            {"index": 0, "rate": 10.0, "samples": 2, "near": 0.1, "far": 9.0},
        ),
        "Motion": (
            wv.sensors.Motion,
            {"poses": [POSE, POSE], "times": [0.0, 0.1], "starts": [0.0], "quaternion": "xyzw"},
        ),
        "Motion.at": (moves.at, {"times": 0.05}),
        "Motion.from_twist": (
            wv.sensors.Motion.from_twist,
            {"poses": POSE, "linear": (1, 0, 0), "angular": (0, 0, 1), "starts": [0.0], "quaternion": "xyzw"},
        ),
        "Motion.per_ray": (wv.sensors.Motion.per_ray, {"poses": [POSE], "quaternion": "xyzw"}),
        "Motion of render": (
            wv.render,
            {
                "scene": seen,
                "camera": shutter,
                "camera_to_world": moves,
                "object_poses": wv.sensors.Motion([MOVED, MOVED], [0.0, 0.1]),
                "convention": None,
                "quaternion": "xyzw",
                "world_index": [0],
                "exclude": ["floor"],
            },
        ),
        "RollingShutter": (
            wv.sensors.RollingShutter,
            {"camera": CAMERA, "readout": 0.03, "direction": "left_to_right"},
        ),
        "RollingShutter.rays_at": (shutter.rays_at, {"pixels": [[1.0, 1.0]]}),
        "deskew": (
            wv.sensors.deskew,
            {"points": np.zeros((2, 3)), "motion": moves, "times": [0.0, 0.1], "target_time": 0.05},
        ),
        "deskew of clouds": (
            wv.sensors.deskew,
            {"points": [cloud], "motion": moves, "times": None, "target_time": 0.05},
        ),
        "bpearl": (lidars.bpearl, {"increment": 0.5, "rate": 10.0, "near": 0.1, "far": 9.0}),
        "even": (
            lidars.even,
            {
                "channels": 2,
                "elevation": (-0.1, 0.1),
                "azimuth": (0.0, 1.0),
                "increment": 0.5,
                "rate": 10.0,
                "near": 0.1,
                "far": 9.0,
            },
        ),
        "grid": (
            lidars.grid,
            {"size": (1.0, 1.0), "resolution": 0.5, "direction": (0, 0, -1), "near": 0.1, "far": 9.0},
        ),
        "hdl64e": (lidars.hdl64e, {"rate": 20.0, "near": 0.1, "far": 9.0, "calibration": None}),
        "vlp16": (lidars.vlp16, {"rate": 20.0, "near": 0.1, "far": 9.0, "calibration": None}),
        "hdl32e": (lidars.hdl32e, {"rate": 20.0, "near": 0.1, "far": 9.0, "calibration": None}),
        "vlp32c": (lidars.vlp32c, {"rate": 20.0, "near": 0.1, "far": 9.0, "calibration": None}),
        "vls128": (lidars.vls128, {"rate": 20.0, "near": 0.1, "far": 9.0, "calibration": None}),
        "pandar64": (lidars.pandar64, {"rate": 20.0, "near": 0.1, "far": 9.0}),
        "xt32": (lidars.xt32, {"rate": 20.0, "near": 0.1, "far": 9.0}),
        "qt128": (lidars.qt128, {"rate": 20.0, "near": 0.1, "far": 9.0}),
        "at128": (lidars.at128, {"near": 0.1, "far": 9.0}),
        "rplidar": (lidars.rplidar, {"model": "A3", "rate": 15.0, "near": 0.1, "far": 9.0}),
        "laser_scan": (
            lidars.laser_scan,
            {
                "angle_min": -1.0,
                "angle_max": 1.0,
                "angle_increment": 0.5,
                "time_increment": 0.1,
                "near": 0.1,
                "far": 9.0,
            },
        ),
        "livox": (lidars.livox, {"model": "mid360", "path": folder / "mid360.npy"}),
        "ouster": (lidars.ouster, {"sensor": "OS1-64", "mode": "512x10", "near": 0.1, "far": 9.0}),
        "gather_returns": (
            wv.sensors.gather_returns,
            {
                "depth": scanned.depth,
                "intensity": met,
                "count": 3,
                "keep": "dual",
                "separation": 0.5,
                "min_intensity": 0.0,
                "out": None,
            },
        ),
        "measure_incidence": (
            wv.sensors.measure_incidence,
            {
                "views": scanned,
                "rays": laser,
                "sensor_to_world": POSE,
                "convention": None,
                "quaternion": "xyzw",
                "out": None,
            },
        ),
        "point_clouds": (
            wv.sensors.point_clouds,
            {"views": scanned, "rays": laser, "intensity": met, "incidence": met, "organized": False},
        ),
        "reflect": (
            wv.sensors.reflect,
            {
                "scene": seen,
                "views": scanned,
                "incidence": met,
                "reflectivity": {"box": 0.5},
                "falls_off": False,
                "out": None,
            },
        ),
        "spread_beams": (wv.sensors.spread_beams, {"rays": laser, "divergence": 0.01, "count": 3}),
        "to_pointcloud2 of a cloud": (wv.io.to_pointcloud2, {"points": cloud, "layout": None, **MESSAGE}),
        "to_livox_msg": (wv.io.to_livox_msg, {"cloud": cloud, "lidar_id": 1, **MESSAGE}),
        "register_livox_types": (wv.io.register_livox_types, {"types": MESSAGE["types"]}),
        "to_laserscan": (
            wv.io.to_laserscan,
            {"ranges": np.ones(9), "rays": laser, "scan_time": 0.1, "intensities": np.ones(9), **MESSAGE},
        ),
        "save_cloud": (wv.io.save_cloud, {"path": path / "a.pcd", "cloud": cloud}),
        "save_clouds": (
            wv.io.save_clouds,
            {"folder": path / "clouds", "clouds": [cloud], "suffix": ".bin", "first": 0},
        ),
    }
