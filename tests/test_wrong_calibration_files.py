# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Wrong calibration files are rejected with one sentence, and improbable ones warn."""

import copy
import json

import numpy as np
import pytest

import warpvis as wv
from warpvis.errors import IntrinsicsWarning
from warpvis.io import load_camera

from support.calibration_files import CASES, PINHOLE, Case, K, rig, written


def changed(name, *changes):
    """Return the file of a case with replaced texts, or with changed keys of a JSON object."""
    case = CASES[name]
    content = copy.deepcopy(case.content)
    for old, new in changes:
        if isinstance(content, str):
            assert old in content, (old, content)
            content = content.replace(old, new)
        else:
            *parents, key = old
            target = content
            for parent in parents:
                target = target[parent]
            if new is None:
                del target[key]
            else:
                target[key] = new
    return case._replace(content=content)


VALUE = ("value0", "intrinsics", 0, "intrinsics")
RIG = ("rig", "sensors", 1, "properties")
WRONG = {
    "opencv, no size": (changed("pinhole", (("image_width",), None)), r"image_width \[px\] is missing"),
    "opencv, negative size": (changed("pinhole", (("image_height",), -48)), "height must be a whole number of pixels"),
    "opencv, size of text": (changed("pinhole", (("image_width",), "64")), "width must be a whole number of pixels"),
    "opencv, no focal length": (changed("pinhole", (("camera_matrix", "data"), [0.0, *K[1:]])), "fx of a lens must be"),
    "opencv, normalized": (
        changed("pinhole", (("camera_matrix", "data"), [0.9, 0, 0.5, 0, 1.2, 0.5, 0, 0, 1])),
        "intrinsics must be in pixels of an image of 64 x 48, .* multiply fx and cx by 64",
    ),
    "opencv, transposed": (
        changed("pinhole", (("camera_matrix", "data"), [60, 0, 0, 0, 58, 0, 30, 24, 1])),
        "got its transpose",
    ),
    "opencv, skew": (changed("pinhole", (("camera_matrix", "data"), [60, 3, *K[2:]])), "without skew"),
    "opencv, matrix": (
        changed("pinhole", (("camera_matrix", "data"), K[:4])),
        "camera matrix must be 9 finite numbers",
    ),
    "opencv, coefficients": (
        changed("pinhole", (("distortion_coefficients", "data"), [0.1] * 3)),
        "must be 4, 5, 8, 12 or 14 numbers, got 3",
    ),
    "opencv, base64": (
        changed("pinhole", (("camera_matrix", "data"), "$base64$?")),
        "a matrix that is not valid base64",
    ),
    "opencv, base64 of integers": (
        changed("pinhole", (("camera_matrix",), {"dt": "i", "data": "$base64$" + "AAAA" * 20})),
        'a matrix in base64 must have dt "f" or "d"',
    ),
    "omnidir, xi": (changed("omnidir", (("xi",), -1.0)), "xi of a lens must be at least 0, got -1.0"),
    "omnidir, xi of text": (changed("omnidir", (("xi",), "a")), 'xi must be a finite number, got "a"'),
    "omnidir, coefficients": (
        changed("omnidir", (("distortion_coefficients", "data"), [0.1] * 5)),
        "D of OpenCV's omnidir must be 4 numbers",
    ),
    "stereo, name": (CASES["M1"]._replace(name="cam0"), "has no camera 'cam0'; it has M1, M2"),
    "ros, model": (changed("camera_calibration", ("plumb_bob", "omni")), "distortion_model must be one of plumb_bob"),
    "ros, P": (changed("camera_calibration", ("image_width: 64", "a: 1")), r"image_width \[px\] is missing"),
    "kalibr, model": (
        changed("omni-radtan", ("omni", "sphere")),
        "camera_model must be one of pinhole, omni, eucm, ds",
    ),
    "kalibr, distortion": (
        changed("pinhole-radtan", ("radtan", "poly")),
        "distortion_model must be one of none, radtan",
    ),
    "kalibr, pair": (
        changed("omni-radtan", ("radtan", "equidistant")),
        "of camera_model omni must be none or radtan, got equidistant",
    ),
    "kalibr, eucm-radtan": (
        changed("eucm-none", ("coeffs: []", "coeffs: [0.1, 0, 0, 0]"), ("none", "radtan")),
        "of camera_model eucm must be none, got radtan",
    ),
    "kalibr, intrinsics": (changed("omni-none", ("[1.5, ", "[")), "intrinsics of omni must be 5 numbers, got 4"),
    "kalibr, coefficients": (changed("pinhole-radtan", (", -0.002", "")), "of radtan must be 4 numbers, got 3"),
    "kalibr, no size": (
        changed("ds-none", ("resolution", "size")),
        r"cam0: resolution \[px\] must be 2 finite numbers",
    ),
    "kalibr, nan": (changed("pinhole-radtan", ("0.05", ".nan")), "distortion_coeffs must be finite numbers, got nan"),
    "kalibr, xi": (changed("omni-none", ("1.5", "-1.5")), "xi of an omni camera must be at least 0"),
    "camodocal, model": (changed("MEI", ("MEI", "FISH")), 'model_type must be one of PINHOLE, .*, got "FISH"'),
    "camodocal, no parameter": (changed("MEI", ("gamma1", "gamma")), "gamma1 of model_type MEI is missing"),
    "camodocal, no size": (changed("MEI", ("image_height", "rows")), r"image_height \[px\] is missing"),
    "camodocal, no focal length": (
        changed("KANNALA_BRANDT", (f"mu: {60:.16e}", "mu: 0")),
        "fx of a lens must be a number of pixels above 0, got 0.0",
    ),
    "camodocal, sign": (
        changed("SCARAMUZZA", (f"p0: {-60:.16e}", "p0: 60.0")),
        "the first coefficient of Scaramuzza must be below 0",
    ),
    "camodocal, settings": (
        CASES["MEI"]._replace(content='cam0_calib: "left.yaml"\ncam1_calib: "right.yaml"\nimage_width: 64\n'),
        r"holds no camera but names the files left\.yaml and right\.yaml; give one of these",
    ),
    "camodocal, name": (CASES["MEI"]._replace(name="cam0"), "holds one camera, so it takes no name 'cam0'"),
    "orb, model": (
        changed("PinHole", ("PinHole", "Fisheye")),
        r"Camera\.type must be one of PinHole, Rectified, Kannala",
    ),
    "orb, no size": (changed("PinHole", ("Camera.width", "Camera.columns")), r"Camera\.width \[px\] is missing"),
    "orb, several": (
        CASES["KannalaBrandt8"]._replace(name=""),
        "has the cameras Camera1, Camera2; choose one as .*:Camera1",
    ),
    "orb, no parameter": (
        changed("KannalaBrandt8", ("Camera2.k4", "Camera2.k9")),
        "Camera2: k4 of Camera.type Kannala",
    ),
    "orb, no camera": (changed("Rectified", ("Camera1.fx", "fx")), r"Camera1\.fx \[px\] is missing"),
    "orb, negative": (
        changed("Rectified", ("fx: 60.0", "fx: -60.0")),
        "fx of a lens must be a number of pixels above 0, got -60",
    ),
    "basalt, model": (
        changed("ds", (("value0", "intrinsics", 0, "camera_type"), "cylinder")),
        'cam0: camera_type must be one of pinhole, pinhole-radtan8, kb4, ds, eucm, ucm, fov, got "cylinder"',
    ),
    "basalt, no parameter": (changed("ds", ((*VALUE, "xi"), None)), "cam0: xi of camera_type ds is missing"),
    "basalt, text": (changed("ds", ((*VALUE, "fx"), "60")), 'fx of camera_type ds must be a finite number, got "60"'),
    "basalt, range": (changed("eucm", ((*VALUE, "alpha"), 1.5)), "alpha of a lens must be from 0 to 1, got 1.5"),
    "basalt, no size": (
        changed("ds", (("value0", "resolution"), None)),
        r"resolution \[px\] must be 1 x 2 finite numbers",
    ),
    "basalt, size": (changed("ds", (("value0", "resolution"), [[64.5, 48]])), "width must be a whole number of pixels"),
    "basalt, name": (CASES["ds"]._replace(name="left"), "has no camera 'left'; it has cam0"),
    "basalt, list": (changed("ds", (("value0", "intrinsics"), [])), "intrinsics must be a list of objects, got"),
    "ocam, lines": (changed("polynomial", ("48 64", "48")), "expected five lines of numbers, as OCamCalib writes them"),
    "ocam, count": (
        changed("polynomial", ("5 -6.0", "6 -6.0")),
        "the direct polynomial must have 6 coefficients, got 5",
    ),
    "ocam, words": (changed("polynomial", ("0.999000", "c")), "expected five lines of numbers"),
    "colmap, id": (CASES["cameras.txt"]._replace(name="9"), "has no camera '9'; it has 7, 8"),
    "nerfstudio, frame": (CASES["transforms.json"]._replace(name="9.png"), "has no frame with the file_path '9.png'"),
    "blender, no size": (
        changed("camera_angle_x", (("w",), None)),
        r"not the image size, w and h \[px\], and there is no picture next to it",
    ),
    "blender, degrees": (changed("camera_angle_x", (("camera_angle_x",), 50.0)), "must be between 0 and pi radians"),
    "nerfstudio, no focal length": (
        Case("nerfstudio", "t.json", {"w": 64, "h": 48, "frames": []}, PINHOLE),
        r"defines no focal length: fl_x \[px\]",
    ),
    "open3d, no size": (changed("PinholeCameraIntrinsic", (("width",), None)), r"width \[px\] is missing"),
    "open3d, by rows": (
        changed("PinholeCameraIntrinsic", (("intrinsic_matrix",), K)),
        r"K must be \[\[fx, 0, cx\], .*got its transpose",
    ),
    "bop, id": (CASES["scene_camera.json"]._replace(name="4"), "has no camera '4'; it has 3, 5"),
    "bop, several": (CASES["scene_camera.json"]._replace(name=""), "different cameras, .*; choose one as .*:3"),
    "realsense, several": (CASES["64x48"]._replace(name=""), "has the cameras 64x48, 128x96; choose one as .*:64x48"),
    "realsense, size": (CASES["64x48"]._replace(name="640x480"), "has no camera '640x480'; it has 64x48, 128x96"),
    "realsense, text": (changed("64x48", (("rectified.0.fx",), "wide")), r"rectified\.0\.fx \[px\] must be a finite"),
    "realsense, model": (
        changed("Brown Conrady", (("model",), "distortion.inverse_brown_conrady")),
        'model must be one of brown_conrady, .* with coeffs that are not 0, got "inverse_brown_conrady"',
    ),
    "realsense, coefficients": (changed("Brown Conrady", (("coeffs",), [0.1])), "coeffs must be 5 finite numbers"),
    "realsense, no size": (changed("rs2_intrinsics", (("width",), None)), r"width \[px\] is missing"),
    "rig, model": (changed("bw-poly", ((*RIG, "Model"), "pinhole")), 'fov: Model must be ftheta, got "pinhole"'),
    "rig, constant": (changed("bw-poly", ((*RIG, "bw-poly"), "0.1 0.02")), "the constant term, must be 0, got 0.1"),
    "rig, no polynomial": (
        changed("bw-poly", ((*RIG, "bw-poly"), "")),
        "polynomial must be at least 2 numbers, the first",
    ),
    "rig, kind": (
        changed("angle-to-pixeldistance", ((*RIG, "polynomial-type"), "sine")),
        "polynomial-type must be one of pixeldist",
    ),
    "rig, linear": (changed("angle-to-pixeldistance", ((*RIG, "linear-d"), 0.5)), "linear-d must be 0, got 0.5"),
    "rig, nothing": (Case("NVIDIA DriveWorks", "rig.json", rig(), PINHOLE), "the rig has no camera"),
    "rig, several": (CASES["bw-poly"]._replace(name=""), "has the cameras camera:front:wide:120fov, b; choose one as"),
    "rig, sign": (
        changed("bw-poly", ((*RIG, "bw-poly"), "0 -0.02")),
        "the first coefficient of FTheta must be above 0",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_calibration_files_are_rejected(name, tmp_path):
    """One sentence, which begins with the file."""
    case, message = WRONG[name]
    argument = written(case, tmp_path)
    with pytest.raises(wv.WarpvisError, match=message) as error:
        load_camera(argument)
    assert str(error.value).startswith(str(tmp_path / case.file)) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("case", "message"),
    [
        (
            changed("Rectified", ("fx: 60.0", "fx: 1.5"), ("fy: 58.0", "fy: 1.1")),
            "if they are in millimeters, multiply",
        ),
        (
            changed("Rectified", ("fx: 60.0", "fx: 31.0"), ("cx: 30.5", "cx: 80.0")),
            r"point \(80.5, 24.75\) is outside of",
        ),
        (
            changed("Rectified", ("cx: 30.5", "cx: 61.0"), ("cy: 24.25", "cy: 48.0")),
            "multiply fx, fy, cx and cy by 0.5",
        ),
        (changed("Rectified", ("width: 64", "width: 48"), ("height: 48", "height: 64")), "width comes before height"),
    ],
    ids=["millimeters", "swapped", "other size", "turned"],
)
def test_improbable_intrinsics_warn(case, message, tmp_path):
    with pytest.warns(IntrinsicsWarning, match=message):
        load_camera(written(case, tmp_path))


def test_mutated_files_are_read_or_rejected(tmp_path):
    rng, said, sample = (
        np.random.default_rng(0),
        0,
        [case for case in CASES.values() if case.file != "scene_camera.json"],
    )
    pytest.importorskip("ruamel.yaml")
    for index in range(300):
        case = sample[index % len(sample)]
        text = case.content if isinstance(case.content, str) else json.dumps(case.content)
        data = bytearray(text.encode())
        for place in rng.integers(0, len(data), rng.integers(1, 4)):
            data[place] = int(rng.integers(256))
        (tmp_path / case.file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / case.file).write_bytes(data)
        try:
            with np.errstate(all="ignore"):
                load_camera(f"{tmp_path / case.file}:{case.name}" if case.name else tmp_path / case.file)
        except wv.WarpvisError:
            said += 1
    assert said > 80
