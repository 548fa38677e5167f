# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Calibration files of every tool in the documentation's table, with own numbers, and the lenses in them."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from PIL import Image
from pose_samples import nerfstudio

from warpvis.cameras import lenses

from support.camera_files import NERF, ROS_YAML, put

F = (60.0, 58.0, 30.5, 24.25)  # fx fy cx cy, pixel centers at whole numbers
AT = (60.0, 58.0, 31.0, 24.75)  # the same for warpvis, at +0.5
FOCAL = dict(zip(("fx", "fy", "cx", "cy"), F, strict=True))
K = [F[0], 0.0, F[2], 0.0, F[1], F[3], 0.0, 0.0, 1.0]
RADTAN = (-0.2, 0.05, 0.001, -0.002)
FISHEYE = (0.01, 0.002, -0.003, 0.0004)
RATIONAL = (-0.2, 0.05, 0.001, -0.002, 0.01, 0.05, 0.04, 0.001)
POLYNOMIAL = (-60.0, 0.0, 0.002, -3e-6, 6e-9)
PINHOLE = lenses.OpenCVPinhole(*AT)


def numbered(names, values):
    return dict(zip(names.split(), values, strict=True))


def kalibr(model, intrinsics, distortion, coefficients, name="cam0"):
    """As Kalibr's ``yaml.dump`` writes it."""
    return (
        f"{name}:\n  cam_overlaps: [1]\n  camera_model: {model}\n  distortion_coeffs: {list(coefficients)}\n"
        f"  distortion_model: {distortion}\n  intrinsics: {list(intrinsics)}\n  resolution: [64, 48]\n"
        f"  rostopic: /{name}/image_raw\n"
    )


def camodocal(model, **groups):
    lines = ["%YAML:1.0", "---", f"model_type: {model}", "camera_name: camera", "image_width: 64", "image_height: 48"]
    for group, fields in groups.items():
        lines += [f"{group}:", *(f"   {name}: {value:.16e}" for name, value in fields.items())]
    return "\n".join(lines) + "\n"


MEI = {
    "mirror_parameters": {"xi": 1.4},
    "distortion_parameters": numbered("k1 k2 p1 p2", RADTAN),
    "projection_parameters": numbered("gamma1 gamma2 u0 v0", F),
}
SCARAMUZZA = {
    "poly_parameters": numbered("p0 p1 p2 p3 p4", POLYNOMIAL),
    "inv_poly_parameters": {f"p{power}": 9.0 for power in range(20)},
    "affine_parameters": {"ac": 0.999, "ad": 0.001, "ae": -0.002, "cx": F[2], "cy": F[3]},
}


def orb_slam(model, *parameters, names="k1 k2 p1 p2", second=None, prefix="Camera1"):
    """As the settings in ORB-SLAM's folder Examples."""
    lines = ["%YAML:1.0", "", f'Camera.type: "{model}"', "", "# Left camera"]
    for camera, values in ((prefix, F), ("Camera2", second)):
        if values:
            fields = numbered(f"fx fy cx cy {names}", (*values, *parameters))
            lines += [f"{camera}.{name}: {value}" for name, value in fields.items()]
    matrix = "!!opencv-matrix\n  rows: 1\n  cols: 2\n  dt: f\n  data: [ 1.0, 0.0,\n          ]"
    lines += [
        f"Stereo.T_c1_c2: {matrix}",
        "Camera.width: 64",
        "Camera.height: 48",
        "Viewer.PointSize:2",
        "Camera.newWidth: 32",
        "Camera.fps: 20",
    ]
    return "\n".join(lines) + "\n"


def basalt(*cameras):
    """As the library cereal writes it."""
    entries = [{"camera_type": kind, "intrinsics": {**FOCAL, **fields}} for kind, fields in cameras]
    value = {"T_imu_cam": [], "intrinsics": entries, "resolution": [[64, 48]] * len(cameras), "imu_update_rate": 200.0}
    return {"value0": value}


def rig(*sensors):
    return {"rig": {"sensors": [{"name": "imu", "protocol": "imu", "properties": {}}, *sensors]}}


def ftheta(name="camera:front:wide:120fov", **fields):
    properties = {"Model": "ftheta", "cx": "31.0", "cy": "24.75", "width": "64", "height": "48"}
    return {"name": name, "protocol": "camera.virtual", "properties": properties | fields}


OCAM = """\
#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB). These are used by cam2world

5 -6.000000e+01 0.000000e+00 2.000000e-03 -3.000000e-06 6.000000e-09

#polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB). These are used by world2cam

3 90.000000 60.000000 1.000000

#center: "row" and "column", starting from 0 (C convention)

24.250000 30.500000

#affine parameters "c", "d", "e"

0.999000 0.001000 -0.002000

#image size: "height" and "width"

48 64

"""
RS_TABLE = {"baseline": "-50.0", "intrinsic_left.x.x": "0.5"} | {
    f"rectified.{index}.{key}": str(value)
    for index, (width, height, fx) in enumerate(((64, 48, 60.0), (128, 96, 120.0), (0, 0, 0.0)))
    for key, value in numbered("fx fy ppx ppy width height", (fx, fx, F[2], F[3], width, height)).items()
}
RS_STREAM = {"width": 64, "height": 48, "fx": 60.0, "fy": 58.0, "ppx": F[2], "ppy": F[3]}
MATRIX = {"type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d", "data": K}
OPENCV = {"image_width": 64, "image_height": 48, "camera_matrix": MATRIX}
COEFFICIENTS = {"type_id": "opencv-matrix", "rows": 1, "cols": 4, "dt": "d"}


class Case(NamedTuple):
    """A file of a tool in the table, the name of a camera in it, and the expected lens."""

    tool: str
    file: str
    content: object
    lens: lenses.Lens
    name: str = ""


def opencv(lens, *coefficients, **fields):
    return Case(
        "OpenCV", "a.json", OPENCV | {"distortion_coefficients": COEFFICIENTS | {"data": coefficients}} | fields, lens
    )


def kalibr_case(lens, *entry):
    return Case("Kalibr", "camchain.yaml", kalibr(*entry), lens)


def vins(lens, model, **groups):
    return Case("camodocal, VINS-Fusion", "cam.yaml", camodocal(model, **groups), lens)


def orb(lens, *settings, name="", **more):
    return Case("ORB-SLAM2 and 3", "settings.yaml", orb_slam(*settings, **more), lens, name)


def basalt_case(lens, kind, **fields):
    return Case("Basalt", "calibration.json", basalt((kind, fields)), lens)


STEREO = {"image_width": 64, "image_height": 48, "M1": MATRIX, "D1": COEFFICIENTS | {"data": RADTAN}} | {
    "M2": MATRIX,
    "D2": COEFFICIENTS | {"data": (0.1, 0, 0, 0)},
}
FRAMES = [
    {**NERF, "fl_x": 60.0 + index, "file_path": f"./images/{index}.png", "transform_matrix": np.eye(4).tolist()}
    for index in range(3)
]
KANNALA_BRANDT = {"projection_parameters": numbered("k2 k3 k4 k5 mu mv u0 v0", (*FISHEYE, *F))}
PARAMETERS = {"projection_parameters": FOCAL}
CASES = {
    "pinhole": opencv(lenses.OpenCVPinhole(*AT, RADTAN), *RADTAN),
    "fisheye": opencv(lenses.KannalaBrandt(*AT, FISHEYE), *FISHEYE, fisheye_model=1),
    "omnidir": opencv(lenses.Mei(*AT, 1.4, RADTAN), *RADTAN, xi=1.4),
    "M1": Case("OpenCV's stereo sample", "s.json", STEREO, lenses.OpenCVPinhole(*AT, RADTAN), "M1"),
    "M2": Case("OpenCV's stereo sample", "s.json", STEREO, lenses.OpenCVPinhole(*AT, (0.1, 0, 0, 0)), "M2"),
    "camera_calibration": Case(
        "ROS camera_calibration",
        "ost.yaml",
        ROS_YAML.replace("[0, 0, 0, 0, 0]", "[0.1, 0, 0, 0, 0]"),
        lenses.OpenCVPinhole(60, 58, 31.3, 25.1, (0.1, 0, 0, 0)),
    ),
    "pinhole-none": kalibr_case(PINHOLE, "pinhole", F, "none", ()),
    "pinhole-radtan": kalibr_case(lenses.OpenCVPinhole(*AT, RADTAN), "pinhole", F, "radtan", RADTAN),
    "pinhole-equi": kalibr_case(lenses.KannalaBrandt(*AT, FISHEYE), "pinhole", F, "equidistant", FISHEYE),
    "pinhole-fov": kalibr_case(lenses.FOV(*AT, 0.9), "pinhole", F, "fov", (0.9,)),
    "omni-none": kalibr_case(lenses.EUCM(24, 23.2, *AT[2:], 0.6), "omni", (1.5, *F), "none", ()),
    "omni-radtan": kalibr_case(lenses.Mei(*AT, 1.5, RADTAN), "omni", (1.5, *F), "radtan", RADTAN),
    "eucm-none": kalibr_case(lenses.EUCM(*AT, 0.6, 1.1), "eucm", (0.6, 1.1, *F), "none", ()),
    "ds-none": kalibr_case(lenses.DoubleSphere(*AT, -0.2, 0.6), "ds", (-0.2, 0.6, *F), "none", ()),
    "PINHOLE": vins(
        lenses.OpenCVPinhole(*AT, RADTAN),
        "PINHOLE",
        distortion_parameters=numbered("k1 k2 p1 p2", RADTAN),
        **PARAMETERS,
    ),
    "PINHOLE_FULL": vins(
        lenses.OpenCVPinhole(*AT, RATIONAL),
        "PINHOLE_FULL",
        distortion_parameters=numbered("k1 k2 p1 p2 k3 k4 k5 k6", RATIONAL),
        **PARAMETERS,
    ),
    "KANNALA_BRANDT": vins(lenses.KannalaBrandt(*AT, FISHEYE), "KANNALA_BRANDT", **KANNALA_BRANDT),
    "MEI": vins(lenses.Mei(*AT, 1.4, RADTAN), "MEI", **MEI),
    "SCARAMUZZA": vins(lenses.Scaramuzza(*AT[2:], POLYNOMIAL, (0.999, 0.001, -0.002, 1.0)), "scaramuzza", **SCARAMUZZA),
    "PinHole": orb(lenses.OpenCVPinhole(*AT, (*RADTAN, 0)), "PinHole", *RADTAN),
    "PinHole, k3": orb(lenses.OpenCVPinhole(*AT, (*RADTAN, 0.01)), "PinHole", *RADTAN, 0.01, names="k1 k2 p1 p2 k3"),
    "PinHole, ORB-SLAM2": orb(lenses.OpenCVPinhole(*AT, (*RADTAN, 0)), "PinHole", *RADTAN, prefix="Camera"),
    "Rectified": orb(PINHOLE, "Rectified", names=""),
    "KannalaBrandt8": orb(
        lenses.KannalaBrandt(61, 59, 32.5, 25.5, FISHEYE),
        "KannalaBrandt8",
        *FISHEYE,
        names="k1 k2 k3 k4",
        second=(61.0, 59.0, 32.0, 25.0),
        name="Camera2",
    ),
    "basalt pinhole": basalt_case(PINHOLE, "pinhole"),
    "pinhole-radtan8": basalt_case(
        lenses.OpenCVPinhole(*AT, RATIONAL),
        "pinhole-radtan8",
        **numbered("k1 k2 p1 p2 k3 k4 k5 k6", RATIONAL),
        rpmax=2.7,
    ),
    "kb4": basalt_case(lenses.KannalaBrandt(*AT, FISHEYE), "kb4", **numbered("k1 k2 k3 k4", FISHEYE)),
    "ds": basalt_case(lenses.DoubleSphere(*AT, -0.2, 0.6), "ds", xi=-0.2, alpha=0.6),
    "eucm": basalt_case(lenses.EUCM(*AT, 0.6, 1.1), "eucm", alpha=0.6, beta=1.1),
    "ucm": basalt_case(lenses.EUCM(*AT, 0.6), "ucm", alpha=0.6),
    "fov": basalt_case(lenses.FOV(*AT, 0.9), "fov", w=0.9),
    "cam1": Case("Basalt", "c.json", basalt(("pinhole", {}), ("fov", {"w": 0.9})), lenses.FOV(*AT, 0.9), "cam1"),
    "polynomial": Case(
        "OCamCalib", "calib_results.txt", OCAM, lenses.Scaramuzza(*AT[2:], POLYNOMIAL, (1.0, -0.002, 0.001, 0.999))
    ),
    "cameras.txt": Case(
        "COLMAP", "cameras.txt", "7 FOV 64 48 60 58 31 24.75 0.9\n8 PINHOLE 32 24 9 9 1 1", lenses.FOV(*AT, 0.9), "7"
    ),
    "transforms.json": Case(
        "nerfstudio",
        "transforms.json",
        {"frames": FRAMES, "k1": 0.1},
        lenses.OpenCVPinhole(61, 58, 31.3, 25.1, (0.1, 0, 0, 0)),
        "images/1.png",
    ),
    "is_fisheye": Case(
        "instant-ngp",
        "transforms.json",
        {"frames": nerfstudio()["frames"]} | NERF | {"is_fisheye": True, "k1": 0.05},
        lenses.KannalaBrandt(60, 58, 31.3, 25.1, (0.05, 0, 0, 0)),
    ),
    "camera_angle_x": Case(
        "Blender's NeRF sets",
        "transforms_train.json",
        {"frames": nerfstudio()["frames"]} | {"camera_angle_x": 2 * math.atan(32 / 60), "w": 64, "h": 48},
        lenses.OpenCVPinhole(60, 60, 32, 24),
    ),
    "PinholeCameraIntrinsic": Case(
        "Open3D",
        "intrinsic.json",
        {"width": 64, "height": 48, "intrinsic_matrix": [60.0, 0, 0, 0, 58.0, 0, F[2], F[3], 1]},
        PINHOLE,
    ),
    "camera.json": Case("BOP", "camera.json", FOCAL | {"width": 64, "height": 48, "depth_scale": 0.1}, PINHOLE),
    "scene_camera.json": Case(
        "BOP", "a/b/scene_camera.json", {"3": {"cam_K": [9.0, *K[1:]]}, "5": {"cam_K": K}}, PINHOLE, "5"
    ),
    "calibration.txt": Case(
        "TUM",
        "calibration.txt",
        "60 58 30.5 24.25 -0.2 0.05 0.001 -0.002 0.01\n",
        lenses.OpenCVPinhole(*AT, (*RADTAN, 0.01)),
    ),
    "64x48": Case("RealSense", "table.json", RS_TABLE, lenses.OpenCVPinhole(60, 60, *AT[2:]), "64x48"),
    "rs2_intrinsics": Case(
        "RealSense SDK",
        "color.json",
        RS_STREAM | {"model": "distortion.inverse_brown_conrady", "coeffs": [0.0] * 5},
        PINHOLE,
    ),
    "Brown Conrady": Case(
        "RealSense SDK",
        "color.json",
        RS_STREAM | {"model": "Brown Conrady", "coeffs": [*RADTAN, 0.01]},
        lenses.OpenCVPinhole(*AT, (*RADTAN, 0.01)),
    ),
    "Kannala Brandt4": Case(
        "RealSense SDK",
        "t265.json",
        RS_STREAM | {"model": "distortion.kannala_brandt4", "coeffs": [*FISHEYE, 0.0]},
        lenses.KannalaBrandt(*AT, FISHEYE),
    ),
    "F-Theta": Case(
        "RealSense SDK",
        "zr300.json",
        RS_STREAM | {"model": "F-Theta", "coeffs": [0.9, 0, 0, 0, 0]},
        lenses.FOV(*AT, 0.9),
    ),
    "bw-poly": Case(
        "NVIDIA DriveWorks",
        "rig.json",
        rig(ftheta(**{"bw-poly": "0 0.02 1e-5 0 0"}), ftheta("b", **{"bw-poly": "0 1"})),
        lenses.FTheta(31, 24.75, (0.02, 1e-5)),
        "camera:front:wide:120fov",
    ),
    "angle-to-pixeldistance": Case(
        "NVIDIA DriveWorks",
        "rig.json",
        rig(ftheta(**{"polynomial": "0.0 50.0 -1.0", "polynomial-type": "angle-to-pixeldistance", "linear-c": 1.0})),
        lenses.FTheta(31, 24.75, (50.0, -1.0), "angle_to_radius"),
    ),
    "lens": Case(
        "warpvis",
        "eye.json",
        {"width": 64, "height": 48, "lens": {"model": "FOV", **numbered("fx fy cx cy", AT), "omega": 0.9}},
        lenses.FOV(*AT, 0.9),
    ),
}


def written(case, folder):
    """Write the file of a case, and the images from which some formats take the size; return the argument."""
    if Path(case.file).suffix == ".yaml":
        pytest.importorskip("ruamel.yaml")
    path = put(folder / case.file, case.content)
    if case.tool == "TUM":
        put(folder / "depth.txt", "0.0 0.png\n")
        Image.new("L", (64, 48)).save(folder / "0.png")
    if case.file.endswith("scene_camera.json"):
        (path.parent / "rgb").mkdir()
        Image.new("L", (64, 48)).save(path.parent / "rgb" / "000003.png")
    return f"{path}:{case.name}" if case.name else path
