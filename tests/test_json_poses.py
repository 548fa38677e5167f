# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of nerfstudio and BOP files: their definitions, and messages for malformed files."""

import json

import numpy as np
import pytest
from pose_samples import MATRICES, assert_same_poses, bop, nerfstudio

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.io import read_frames


def test_nerfstudio_poses_match_definition(tmp_path):
    (tmp_path / "transforms.json").write_text(json.dumps(nerfstudio()))
    frames = read_frames(tmp_path / "transforms.json")
    assert_same_poses(frames)
    np.testing.assert_array_equal(frames.timestamps, np.arange(6))
    assert frames.source == {"file": "transforms.json", "format": "nerfstudio", "convention": "opengl"}
    # A nerfstudio camera looks along its -z, and its image is upright along its +y.
    for frame, matrix in zip(nerfstudio()["frames"], poses_to_matrices(frames.camera_to_world), strict=True):
        given = np.array(frame["transform_matrix"])
        np.testing.assert_allclose(matrix[:3, 2], -given[:3, 2], atol=1e-12)
        np.testing.assert_allclose(matrix[:3, 1], -given[:3, 1], atol=1e-12)
        np.testing.assert_allclose(matrix[:3, [0, 3]], given[:3, [0, 3]], atol=1e-12)


def test_bop_poses_match_definition(tmp_path):
    ids = [3, 1, 20, 100, 0, 7]
    (tmp_path / "scene_camera.json").write_text(json.dumps(bop(ids=ids)))
    frames = read_frames(tmp_path / "scene_camera.json")
    assert_same_poses(frames, MATRICES[np.argsort(ids)])
    np.testing.assert_array_equal(frames.timestamps, sorted(ids))
    assert frames.source == {"file": "scene_camera.json", "format": "bop", "convention": "opencv"}
    point = np.array([0.3, -0.2, 1.5])
    for image, matrix in zip(sorted(ids), poses_to_matrices(frames.camera_to_world), strict=True):
        entry = bop(ids=ids)[str(image)]
        in_camera = np.reshape(entry["cam_R_w2c"], (3, 3)) @ (1000 * point) + entry["cam_t_w2c"]
        np.testing.assert_allclose(matrix[:3, :3].T @ (point - matrix[:3, 3]), in_camera / 1000, atol=1e-12)


def changed(data, *keys, to):
    """Return a copy of nested data with the value at `keys` replaced, or removed if `to` is `...`."""
    data = json.loads(json.dumps(data))
    place = data
    for key in keys[:-1]:
        place = place[key]
    if to is ...:
        del place[keys[-1]]
    else:
        place[keys[-1]] = to
    return data


SCALED = (2 * np.eye(3)).ravel().tolist()
MIRROR = np.diag([1.0, 1, -1, 1]).tolist()
FRAME = ("frames", 2, "transform_matrix")


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "poses.json:1: is not JSON: Expecting value"),
        (b'{"frames": [\n{"a": 1\n', "poses.json:3: is not JSON: Expecting ',' delimiter"),
        (b"\xff\xfe\x00", "poses.json: is not a JSON text file"),
        (b"[" * 100_000, "poses.json: cannot be read as JSON: it is nested too deeply"),
        (b'{"0": ' + b"9" * 10_000 + b"}", "poses.json: cannot be read as JSON: Exceeds the limit"),
        ([1], "poses.json: must be an object of images by their ids, got [1]"),
        (None, "poses.json: must be an object of images by their ids, got null"),
        ({}, "poses.json: holds no poses"),
        ({"frames": []}, "poses.json: holds no poses"),
        ({"frames": None}, 'poses.json: must be an object with a list "frames", got null'),
        ({"frames": {"0": {}}}, 'poses.json: must be an object with a list "frames", got an object'),
        ({"frames": [{}]}, 'poses.json: frame 0 must be an object with a "transform_matrix"'),
        ({"frames": [3]}, 'poses.json: frame 0 must be an object with a "transform_matrix"'),
        (
            changed(nerfstudio(), *FRAME, to=None),
            "poses.json: transform_matrix of frame 2 must be 4 x 4 finite numbers, got null",
        ),
        (
            changed(nerfstudio(), *FRAME, to=np.eye(3).tolist()),
            "poses.json: transform_matrix of frame 2 must be 4 x 4 finite numbers, got a list of 3 lists or objects",
        ),
        (changed(nerfstudio(), *FRAME, 1, 1, to=True), "poses.json: transform_matrix of frame 2 must be 4 x 4 finite"),
        (changed(nerfstudio(), *FRAME, 1, 1, to="1"), "poses.json: transform_matrix of frame 2 must be 4 x 4 finite"),
        (changed(nerfstudio(), *FRAME, 1, 1, to=[1]), "poses.json: transform_matrix of frame 2 must be 4 x 4 finite"),
        (changed(nerfstudio(), *FRAME, 1, 3, to=np.nan), "poses.json: transform_matrix of frame 2 must be 4 x 4 fini"),
        (changed(nerfstudio(), *FRAME, 1, 3, to=10**400), "poses.json: transform_matrix of frame 2 must be 4 x 4 fin"),
        (changed(nerfstudio(), *FRAME, 1, 3, to=1e19), "poses.json: frame 2: poses must be finite numbers of at mo"),
        (changed(nerfstudio(), *FRAME, 3, 0, to=1), "poses.json: frame 2: poses must have the last row 0 0 0 1"),
        (changed(nerfstudio(), *FRAME, to=MIRROR), "poses.json: frame 2: poses must be rotations, not mirrors"),
        ({"first": {}}, 'poses.json: image ids must be whole numbers, got "first"'),
        ({"-1": {}}, 'poses.json: image ids must be whole numbers, got "-1"'),
        ({"1": {}, "01": {}}, "poses.json: image 1 occurs twice, as '1' and '01'"),
        ({"4": {"cam_K": [1]}}, "poses.json: image 4 has no cam_R_w2c and no cam_t_w2c, so no pose"),
        ({"4": [1]}, "poses.json: image 4 has no cam_R_w2c and no cam_t_w2c, so no pose"),
        (changed(bop(), "3", "cam_t_w2c", to=...), "poses.json: image 3 has no cam_t_w2c, so no pose"),
        (changed(bop(), "3", "cam_t_w2c", to=[1, 2]), "poses.json: cam_t_w2c of image 3 must be 3 finite numbers, got"),
        (changed(bop(), "3", "cam_R_w2c", to=np.eye(3).tolist()), "poses.json: cam_R_w2c of image 3 must be 9 finite "),
        (changed(bop(), "3", "cam_R_w2c", to=SCALED), "poses.json: image 3: poses must be rotations without scale"),
        (changed(bop(), "3", "cam_R_w2c", 4, to=1e300), "poses.json: image 3: poses must be finite numbers of at most"),
    ],
)
def test_malformed_json_is_rejected(tmp_path, data, said):
    path = tmp_path / "poses.json"
    path.write_bytes(data if isinstance(data, bytes) else json.dumps(data).encode())
    with pytest.raises(wv.errors.FileFormatError) as error:
        read_frames(path)
    assert str(error.value).removeprefix(f"{tmp_path}/").startswith(said)
    assert "\n" not in str(error.value)
    if isinstance(data, bytes):
        return
    path.rename(tmp_path / "poses")
    with pytest.raises(wv.errors.FileFormatError):
        read_frames(tmp_path / "poses", file_format="nerfstudio" if "frames" in str(data) else "bop")
