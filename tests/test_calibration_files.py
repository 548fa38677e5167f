# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Every row of the table of calibration files: models and names of cameras.

The files have the keys and layout of those that the tools write. OpenCV writes its own formats, and those of camodocal,
whose code writes them with ``cv2.FileStorage``, too.
"""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

import warpvis as wv
from warpvis.cameras import LensCamera, lenses
from warpvis.errors import FileFormatError, IntrinsicsWarning
from warpvis.io import load_camera

from support.calibration_files import AT, CASES, FRAMES, MEI, RADTAN, SCARAMUZZA, K, basalt, ftheta, rig, written
from support.camera_files import put

PAGE = Path(__file__).parents[1] / "docs" / "sensors" / "calibration_files.md"


@pytest.mark.parametrize("name", CASES)
def test_calibration_files_are_read(name, tmp_path):
    case = CASES[name]
    camera = load_camera(written(case, tmp_path))
    assert (camera.width, camera.height) == (64, 48)
    pixels = np.random.default_rng(0).uniform((8, 8), (56, 40), (40, 2))
    if case.lens.is_pinhole:
        assert isinstance(camera, wv.Camera)
        expected = wv.Camera.from_lens(case.lens, 64, 48)
        np.testing.assert_allclose(camera.to_K(), expected.to_K(), atol=1e-9)
        return
    assert isinstance(camera, LensCamera) and type(camera.lens) is type(case.lens)
    np.testing.assert_allclose(camera.unproject(pixels), case.lens.unproject(pixels), atol=1e-12)
    np.testing.assert_allclose(camera.project(camera.unproject(pixels)), pixels, atol=1e-9)


@pytest.mark.parametrize("name", CASES)
def test_calibration_files_without_distortion(name, tmp_path):
    """A pinhole with the same intrinsics and a warning, or one sentence if the lens is not one."""
    case = CASES[name]
    argument = written(case, tmp_path)
    if case.lens.is_pinhole:
        assert load_camera(argument, distortion=False) == load_camera(argument)
    elif isinstance(case.lens, lenses.OpenCVPinhole) or name in ("pinhole-equi", "pinhole-fov"):
        with pytest.warns(IntrinsicsWarning, match=rf"{Path(case.file).name}.*: the lens has distortion, which is not"):
            camera = load_camera(argument, distortion=False)
        assert (camera.fx, camera.fy) == pytest.approx((case.lens.fx, case.lens.fy))
    else:
        with pytest.raises(FileFormatError, match=rf"{Path(case.file).name}.* is not a pinhole"):
            load_camera(argument, distortion=False)


def test_every_documented_tool_has_a_case():
    tools = PAGE.read_text().split("## Tools")[1].split("##")[0]
    rows = re.findall(r"^\| ([^|]+?) \| (?!File)[^-]", tools, flags=re.MULTILINE)
    assert set(rows) == {case.tool for case in CASES.values()}


@pytest.mark.parametrize("ending", ["yaml", "xml", "json"])
@pytest.mark.parametrize("model", ["MEI", "SCARAMUZZA"])
def test_camodocal_files_of_opencv(ending, model, tmp_path):
    """As ``writeToYamlFile`` of camodocal writes them with cv2.FileStorage, which chooses the syntax by the suffix."""
    cv2 = pytest.importorskip("cv2")
    pytest.importorskip("ruamel.yaml")
    path = tmp_path / f"cam.{ending}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in {"model_type": model, "camera_name": "a", "image_width": 64, "image_height": 48}.items():
        storage.write(name, value)
    for group, fields in {"MEI": MEI, "SCARAMUZZA": SCARAMUZZA}[model].items():
        storage.startWriteStruct(group, cv2.FileNode_MAP)
        for name, value in fields.items():
            storage.write(name, value)
        storage.endWriteStruct()
    storage.release()
    assert load_camera(path).lens == CASES[model].lens


@pytest.mark.parametrize("ending", ["yaml", "xml", "json"])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_opencv_matrices_in_base64(ending, dtype, tmp_path):
    cv2 = pytest.importorskip("cv2")
    pytest.importorskip("ruamel.yaml")
    path = tmp_path / f"a.{ending}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE_BASE64)
    storage.write("image_width", 64), storage.write("image_height", 48)
    storage.write("camera_matrix", np.reshape(K, (3, 3)).astype(dtype))
    storage.write("distortion_coefficients", np.array([[0.25, -0.125, 0, 0]], dtype))
    storage.release()
    assert load_camera(path).lens == lenses.OpenCVPinhole(*AT, (0.25, -0.125, 0, 0))


def test_files_of_open3d(tmp_path):
    open3d = pytest.importorskip("open3d")
    path = str(tmp_path / "a.json")
    open3d.io.write_pinhole_camera_intrinsic(path, open3d.camera.PinholeCameraIntrinsic(64, 48, *AT))
    assert load_camera(path) == wv.Camera(64, 48, *AT[:2], AT[2] + 0.5, AT[3] + 0.5)


@pytest.mark.parametrize("ending", ["txt", "bin"])
def test_files_of_pycolmap(ending, tmp_path):
    pycolmap = pytest.importorskip("pycolmap")
    model = pycolmap.Reconstruction()
    for number, parameters in ((3, (*AT, *RADTAN)), (5, (*AT, 0.1, 0, 0, 0))):
        model.add_camera(pycolmap.Camera(camera_id=number, model="OPENCV", width=64, height=48, params=parameters))
    model.write_text(tmp_path) if ending == "txt" else model.write_binary(tmp_path)
    assert load_camera(f"{tmp_path}/cameras.{ending}:3").lens == lenses.OpenCVPinhole(*AT, RADTAN)
    with pytest.raises(FileFormatError, match=r"different cameras, .*; choose one as .*:[35]"):
        load_camera(tmp_path / f"cameras.{ending}")


def test_frames_of_transforms_have_their_own_lens(tmp_path):
    path = put(tmp_path / "transforms.json", {"frames": FRAMES})
    assert [load_camera(f"{path}:{index}.png").fx for index in range(3)] == [60, 61, 62]
    with pytest.raises(
        FileFormatError, match=r"different cameras, .*; choose one as .*transforms\.json:\./images/0\.png"
    ):
        load_camera(path)


def test_file_names_may_have_colons(tmp_path):
    path = put(tmp_path / "a:b.json", rig(ftheta(**{"bw-poly": "0 0.02"})))
    assert load_camera(path) == load_camera(f"{path}:camera:front:wide:120fov")
    with pytest.raises(FileFormatError, match=r"a:c\.json: no such file|a: no such file"):
        load_camera(tmp_path / "a:c.json")


def test_command_line_reads_named_cameras(tmp_path, monkeypatch, capsys):
    from warpvis.cli import main

    path = put(tmp_path / "calibration.json", basalt(("pinhole", {}), ("ds", {"xi": -0.2, "alpha": 0.6})))
    out = tmp_path / "out"
    arguments = [
        "render",
        "experiment_1",
        "--frame",
        "--camera",
        f"{path}:cam1",
        "--out",
        out,
        "--format",
        "npz",
        "--quiet",
    ]
    monkeypatch.setattr(sys, "argv", ["warpvis", *map(str, arguments)])
    try:
        main()
    except SystemExit as stop:
        assert not stop.code, capsys.readouterr().err
    assert wv.open_dataset(next(out.rglob("manifest.json")).parent).camera.lens == lenses.DoubleSphere(*AT, -0.2, 0.6)
    monkeypatch.setattr(sys, "argv", ["warpvis", *map(str, arguments[:3]), "--camera", str(path), "--out", str(out)])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2 and "has the cameras cam0, cam1; choose one as" in capsys.readouterr().err
