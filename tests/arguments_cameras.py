# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of cameras and ray bundles: ``name: (function, arguments)``."""

import types

from arguments_shared import CAMERA, MESSAGE, POSE, WORLDS, scene

import warpvis as wv
from warpvis.scene.lights import AmbientOcclusion

RAW_INFO = types.SimpleNamespace(
    width=8, height=6, k=[9, 0, 4, 0, 9, 3, 0, 0, 1], d=[0.01, 0, 0, 0, 0], distortion_model="plumb_bob"
)
LENS = wv.cameras.LensCamera(wv.cameras.lenses.OpenCVPinhole(9, 9, 4, 3, (0.01, 0, 0, 0)), 8, 6)


def camera_cases(folder):
    """Return the cases; write their files to `folder`."""
    seen = scene()
    return {
        "Camera": (wv.Camera, dict(zip(("width", "height", "fx", "fy", "cx", "cy"), (8, 6, 9, 9, 4, 3), strict=True))),
        "Camera.range": (lambda near, far: wv.Camera(8, 6, 9, 9, 4, 3, near, far), {"near": 0.1, "far": 4.0}),
        "Camera.from_fov": (wv.Camera.from_fov, {"width": 8, "height": 6, "hfov": 1.0, "near": 0.1, "far": 9.0}),
        "Camera.from_fov, vertical": (wv.Camera.from_fov, {"width": 8, "height": 6, "vfov": 1.0}),
        "Camera.from_fov, linear": (wv.Camera.from_fov, {"width": 8, "height": 6, "hfov": 1.0, "vertical": "linear"}),
        "Camera.from_K": (wv.Camera.from_K, {"K": CAMERA.to_K(), "width": 8, "height": 6, "pixel_center": 0.5}),
        "Camera.from_opencv": (
            wv.Camera.from_opencv,
            {"K": CAMERA.to_K(), "D": [0.01, 0, 0, 0], "width": 8, "height": 6, "model": "fisheye", "kind": "range"},
        ),
        "Camera.from_opencv, range": (
            lambda near, far: wv.Camera.from_opencv(CAMERA.to_K(), None, 8, 6, near=near, far=far),
            {"near": 0.1, "far": 4.0},
        ),
        "Camera.from_raw_camera_info": (
            wv.Camera.from_raw_camera_info,
            {"message": RAW_INFO, "near": 0.1, "far": 4.0, "kind": "z"},
        ),
        "Camera.from_lens": (
            wv.Camera.from_lens,
            {"lens": CAMERA.lens, "width": 8, "height": 6, "near": 0.1, "far": 4.0, "kind": "range"},
        ),
        "Camera.from_colmap": (
            wv.Camera.from_colmap,
            {"model": "SIMPLE_RADIAL", "params": (9, 4, 3, 0.01), "width": 8, "height": 6, "kind": "z"},
        ),
        "Camera.from_kalibr": (
            wv.Camera.from_kalibr,
            {"camera": {"intrinsics": [9, 9, 4, 3], "resolution": [8, 6]}, "near": 0.1, "far": 4.0, "kind": "z"},
        ),
        "Camera.from_nerfstudio": (
            wv.Camera.from_nerfstudio,
            {"fields": {"fl_x": 9, "fl_y": 9, "cx": 4, "cy": 3, "w": 8, "h": 6, "k1": 0.01}, "near": 0.1, "far": 4.0},
        ),
        "Camera.unproject": (CAMERA.unproject, {"pixels": [[1, 1]]}),
        "Camera.kinect": (wv.Camera.kinect, {"vertical": "square"}),
        "Camera.from_camera_info": (
            wv.Camera.from_camera_info,
            {"message": CAMERA.to_camera_info(**MESSAGE), "rectified": True, "near": 0.1, "far": 9.0},
        ),
        "Camera.to_camera_info": (CAMERA.to_camera_info, MESSAGE),
        "Camera.to_K": (CAMERA.to_K, {"pixel_center": 0.5}),
        "Camera.depth_rays": (CAMERA.depth_rays, {"pixels": [[1, 1]]}),
        "Camera.rays_at": (CAMERA.rays_at, {"pixels": [[1, 1]]}),
        "Camera.has_pixels_of": (CAMERA.has_pixels_of, {"other": CAMERA}),
        "Camera.project": (CAMERA.project, {"points": [[0, 0, 1]]}),
        "Camera.back_project": (CAMERA.back_project, {"pixels": [[1, 1]], "depth": [1.0]}),
        "OrthographicCamera": (
            wv.cameras.OrthographicCamera,
            dict(
                zip(
                    ("width", "height", "fx", "fy", "cx", "cy", "near", "far"),
                    (8, 6, 9, 9, 4, 3, 0.1, 4.0),
                    strict=True,
                )
            ),
        ),
        "OrthographicCamera.from_extent": (
            wv.cameras.OrthographicCamera.from_extent,
            {"width": 8, "height": 6, "across": 2.0, "near": 0.1, "far": 4.0},
        ),
        "LensCamera": (
            wv.cameras.LensCamera,
            {"lens": LENS.lens, "width": 8, "height": 6, "near": 0.1, "far": 4.0, "kind": "z"},
        ),
        "Rays": (
            wv.cameras.Rays,
            {
                "directions": [[0, 0, 1]],
                "origins": [[0, 0, 0]],
                "times": [0],
                "rings": [0],
                "near": 0.1,
                "far": 4.0,
                "kind": "z",
                "axes": "opencv",
            },
        ),
        "LensCamera.project": (LENS.project, {"points": [[0, 0, 1]]}),
        "LensCamera.unproject": (LENS.unproject, {"pixels": [[1, 1]]}),
        "LensCamera.to_camera_info": (LENS.to_camera_info, MESSAGE),
        "LensCamera.canvas_rays": (LENS.canvas_rays, {"canvas": (1, 0, 0, 1)}),
        "LensCamera.has_pixels_of": (LENS.has_pixels_of, {"other": LENS}),
        "LensCamera.depth_rays": (LENS.depth_rays, {"pixels": [[1, 1]]}),
        "LensCamera.rays_at": (LENS.rays_at, {"pixels": [[1, 1]]}),
        "LensCamera of OpenCV": (
            wv.cameras.lenses.OpenCVPinhole,
            {"fx": 9, "fy": 9, "cx": 4, "cy": 3, "coefficients": (0.01, 0, 0, 0)},
        ),
        "LensCamera of fisheyes": (
            wv.cameras.lenses.KannalaBrandt,
            {"fx": 9, "fy": 9, "cx": 4, "cy": 3, "coefficients": (0.01, 0, 0, 0)},
        ),
        "LensCamera of two spheres": (
            wv.cameras.lenses.DoubleSphere,
            {"fx": 9, "fy": 9, "cx": 4, "cy": 3, "xi": -0.2, "alpha": 0.6},
        ),
        "LensCamera of mirrors": (
            wv.cameras.lenses.Mei,
            {"fx": 9, "fy": 9, "cx": 4, "cy": 3, "xi": 1.2, "coefficients": (0.01, 0, 0, 0)},
        ),
        "LensCamera of OCamCalib": (
            wv.cameras.lenses.Scaramuzza,
            {"cx": 4, "cy": 3, "coefficients": (-9, 0, 0.01), "affine": (1, 0, 0, 1)},
        ),
        "LensCamera of F-theta": (
            wv.cameras.lenses.FTheta,
            {"cx": 4, "cy": 3, "coefficients": (0.1,), "maps": "radius_to_angle", "max_view_angle": 2.0},
        ),
        "LensCamera of panoramas": (wv.cameras.lenses.Equirectangular, {"width": 8, "height": 6}),
        "WideCamera": (
            wv.cameras.WideCamera,
            {"width": 8, "height": 6, "hfov": 3.0, "projection": "spherical", "near": 0.1, "far": 9.0},
        ),
        "WideCamera.rays_at": (wv.cameras.WideCamera(8, 6, 3.0).rays_at, {"pixels": [[1, 1]]}),
        "parameter_names": (wv.cameras.parameter_names, {"camera": LENS}),
        "parameter_values": (wv.cameras.parameter_values, {"camera": LENS}),
        "with_parameters": (wv.cameras.with_parameters, {"camera": CAMERA, "values": [9, 9, 4, 3]}),
        "ray_jacobian": (wv.cameras.ray_jacobian, {"camera": LENS}),
        "origin_jacobian": (wv.cameras.origin_jacobian, {"camera": LENS}),
        "render_wide": (
            wv.rendering.render_wide,
            {
                "scene": seen,
                "width": 8,
                "height": 6,
                "hfov": 3.0,
                "camera_to_world": POSE,
                "projection": "spherical",
                "near": 0.1,
                "far": 9.0,
                "outputs": ["depth"],
                "cull_backfaces": False,
                "shadows": True,
                "reflections": True,
                "ambient_occlusion": AmbientOcclusion(0.5),
                "convention": "opencv",
                "threads": 1,
                **WORLDS,
            },
        ),
    }
