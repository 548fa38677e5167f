# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of depth-camera models: ``name: (function, arguments)``."""

import numpy as np
import trimesh
from arguments_shared import CAMERA, POSE, scene
from reference_redwood import make_table, write_table

import warpvis as wv

_PROFILES = (
    "realsense_d405", "realsense_d415", "realsense_d435", "realsense_d455", "realsense_d457", "gemini_335", "zed_2i",
    "oak_d", "kinect_v1", "structure",
)  # fmt: skip


def _picture(path):
    wv.io.save_depth_png(np.ones((4, 5)), path / "depth_read.png")
    return path / "depth_read.png"


def depth_sensor_cases(path):
    """Return the cases; write their files to `path`."""
    sensor = wv.sensors.StereoDepth(0.05, sigma=0.1, native_camera=CAMERA)
    seen = scene()
    used = wv.sensors.Latency(2)
    used(wv.render(seen, CAMERA, POSE, outputs="depth"))
    cases = {name: (getattr(wv.sensors, name), {"width": 8, "height": 6}) for name in _PROFILES}
    for model in (
        sensor,
        wv.sensors.TimeOfFlight(1e8, signal=1e4),
        wv.sensors.NguyenNoise(),
        wv.sensors.KhoshelhamNoise(),
        wv.sensors.SimKinect(),
        wv.sensors.RedwoodNoise(np.ones((80, 80, 5))),
        wv.sensors.Corruptions(of=sensor),
        wv.sensors.randomized(sensor, sigma=(0.1, 0.2)),
    ):
        cases[f"{type(model).__name__}.depth_sigma"] = model.depth_sigma, {"depth": [1.0, 2.0], "camera": CAMERA}
    wall = wv.sensors.StereoDepth(0.05, sigma=0.1, subpixel=8)
    far = wv.Scene()
    far.add(trimesh.creation.box((40, 0.1, 40)), pose=(0, 2.0, 0, 0, 0, 0.1, 0.995))
    wide = wv.Camera.from_fov(64, 48, hfov=1.2)
    pictures = wv.render(far, wide, wv.look_at((0, 0, 0), (0, 1, 0)), sensor=wall, outputs="depth").depth.numpy()
    return cases | {
        "fit": (
            wv.sensors.fit,
            {
                "depth_images": pictures,
                "camera": wide,
                "baseline": 0.05,
                "subpixel": 8,
                "depth_step": 0.0,
                "region": 0.9,
            },
        ),
        "save_sensor_fit": (
            wv.viz.save_sensor_fit,
            {"fit": wv.sensors.fit(pictures, wide, baseline=0.05), "path": path / "fit.png"},
        ),
        "read_depth": (wv.io.read_depth, {"path": _picture(path), "unit": 0.001}),
        "MatchedStereo": (
            wv.sensors.MatchedStereo,
            {
                "baseline": 0.05,
                "max_disparity": 64,
                "window": 5,
                "dots": 100,
                "ambient": 0.1,
                "noise": 0.01,
                "min_contrast": 0.1,
                "uniqueness": 5,
                "reflectivity": {"box": 0.5},
                "native_camera": CAMERA,
            },
        ),
        "StereoDepth": (
            wv.sensors.StereoDepth,
            {
                "baseline": 0.05,
                "other_eye": "left",
                "focal_length": 9.0,
                "max_disparity": 9.0,
                "sigma": 0.1,
                "noise_spacing": 2,
                "subpixel": 8,
                "locking": 0.1,
                "shadow": True,
                "band": True,
                "fattening": 2,
                "edge_window": 3,
                "edge_step": 0.5,
                "min_support": 0.5,
                "min_signal": 0.1,
                "full_signal": 0.2,
                "reflectivity": {"box": 0.5},
                "dropout": 0.1,
                "hole_spacing": 2,
                "native_camera": CAMERA,
            },
        ),
        "Randomized": (
            wv.sensors.Randomized,
            {"of": sensor, "ranges": {"sigma": (0.1, 0.2)}, "per": "image", "kinds": 2},
        ),
        "Randomized.drawn": (
            wv.sensors.randomized(sensor, sigma=(0.1, 0.2)).drawn,
            {"seed": 1, "view_index": 2, "frame": 3},
        ),
        "randomized": (wv.sensors.randomized, {"sensor": sensor, "per": "view", "kinds": None, "sigma": (0.1, 0.2)}),
        "sensor_by_name": (wv.sensors.sensor_by_name, {"text": "d435@8x6"}),
        "azure_kinect": (wv.sensors.azure_kinect, {"mode": "nfov_binned"}),
        "femto_bolt": (wv.sensors.femto_bolt, {"mode": "nfov_binned"}),
        "realsense_l515": (wv.sensors.realsense_l515, {}),
        "kinect_v2": (wv.sensors.kinect_v2, {}),
        "pmd_flexx2": (wv.sensors.pmd_flexx2, {}),
        "TimeOfFlight": (
            wv.sensors.TimeOfFlight,
            {
                "frequencies": (80e6, 60e6),
                "signal": 1e4,
                "background": 10.0,
                "contrast": 0.5,
                "reflectivity": {"box": 0.5},
                "offset": 0.01,
                "wiggle": 0.01,
                "wiggle_phase": 1.0,
                "mixing": True,
                "edge_step": 0.02,
                "min_coherence": 0.9,
                "min_signal": 0.01,
                "max_signal": 5.0,
                "native_camera": CAMERA,
            },
        ),
        "NguyenNoise": (
            wv.sensors.NguyenNoise,
            {
                "min_axial": 0.001,
                "axial_growth": 0.002,
                "best_depth": 0.4,
                "grazing_axial": 0.0001,
                "grazing_angle": 1.0,
                "lateral": 0.8,
                "lateral_growth": 0.04,
                "max_angle": 1.4,
            },
        ),
        "KhoshelhamNoise": (wv.sensors.KhoshelhamNoise, {"step": 3e-3, "sigma": 0.4, "rounds": True}),
        "SimKinect": (
            wv.sensors.SimKinect,
            {
                "shift": 0.5,
                "baseline": 0.075,
                "focal_length": 480.0,
                "units": 100.0,
                "sigma": 0.2,
                "pattern": np.full((12, 12), 255, dtype=np.uint8),
            },
        ),
        "RedwoodNoise": (
            wv.sensors.RedwoodNoise,
            {"distortion": write_table(path / "dist-model.txt", make_table()), "multiplier": 1.0},
        ),
        "Corruptions": (
            wv.sensors.Corruptions,
            {
                "added": 0.01,
                "multiplied": 0.01,
                "dropout": 0.1,
                "rectangles": (0, 2),
                "sides": (1, 3),
                "of": sensor,
            },
        ),
        "LearnedDepth": (
            wv.sensors.LearnedDepth,
            {
                "module": np.copy,
                "inputs": ("depth", "noise"),
                "of": sensor,
                "fill": 0.0,
                "batch": 2,
                "noise_channels": 2,
            },
        ),
        "Latency": (wv.sensors.Latency, {"frames": 2}),
        "Latency.__call__": (
            wv.sensors.Latency(2).__call__,
            {"views": wv.render(seen, CAMERA, POSE, outputs="depth"), "frame": 1},
        ),
        "Latency.reset": (used.reset, {"views": [0]}),
        "Renderer, sensor": (
            wv.Renderer,
            {"scene": seen, "camera": CAMERA, "sensor": sensor, "seed": 1, "outputs": ("depth", "reasons")},
        ),
        "Renderer.render, sensor": (
            wv.Renderer(seen, CAMERA, sensor=sensor).render,
            {"camera_to_world": POSE, "frame": 1, "view_index": [3]},
        ),
        "render, sensor": (
            wv.render,
            {
                "scene": seen,
                "camera": CAMERA,
                "camera_to_world": POSE,
                "sensor": sensor,
                "seed": 1,
                "frame": [1],
                "view_index": [3],
            },
        ),
    }
