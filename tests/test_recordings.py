# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of depth cameras: every format against a room computed in double precision."""

import json

import numpy as np
import pytest
import trimesh
from PIL import Image

import warpvis as wv
from warpvis.errors import FileFormatError

from support.recordings import (
    K_SMALL,
    SMALL,
    assert_room,
    poses,
    rays,
    refusal,
    room_depth,
    rows,
    save_color,
    save_depth,
    save_lines,
    save_matrix,
    text,
    world_points,
    write_frames,
    write_icl,
    write_nerfstudio,
    write_redwood,
    write_scannet,
    write_seven_scenes,
    write_tum,
)

CAMERA = wv.Camera.from_K([[60.0, 0, 31.5], [0, 61.0, 23.5], [0, 0, 1]], *SMALL, pixel_center=0.0)


def test_tum(tmp_path):
    recording = wv.open_recording(write_tum(tmp_path / "set"))
    assert len(recording) == 3
    assert recording.source == {"file": "set", "format": "tum", "camera": "documented for freiburg1"}
    np.testing.assert_allclose(recording.timestamps, 10 + np.arange(3) / 30, atol=1e-6)
    # Poses are interpolated between the ground truth at 100 Hz.
    expected = rows(poses(recording.timestamps - 10))
    signs = np.sign(np.sum(expected[:, 3:] * recording.camera_to_world[:, 3:], axis=1))
    expected[:, 3:] *= signs[:, None]
    np.testing.assert_allclose(recording.camera_to_world, expected, atol=1e-6)
    assert_room(recording, 5000, 1e-5)
    assert [int(frame.color[5, 7, 2]) for frame in recording] == [0, 10, 20]
    assert recording[0].color.shape == (480, 640, 3)


def test_tum_of_freiburg3_and_of_other_cameras(tmp_path):
    k = (535.4, 539.2, 320.1, 247.6)
    assert_room(wv.open_recording(write_tum(tmp_path / "3", k, count=1, name="rgbd_dataset_freiburg3_x")), 5000, 1e-5)
    folder = write_tum(tmp_path / "other", K_SMALL, SMALL, name="own")
    message = refusal(lambda: wv.open_recording(folder))
    assert message == f"{folder}: does not define the camera; pass that of the depth images as camera="
    recording = wv.open_recording(folder, camera=CAMERA)
    assert recording.source["camera"] == "given"
    assert_room(recording, 5000, 1e-5)
    (folder / "calibration.txt").write_text("60 61 31.5 23.5\n")
    assert wv.open_recording(folder).camera == CAMERA


def test_tum_frames_without_pose_color_or_file(tmp_path):
    folder = write_tum(tmp_path / "set", K_SMALL, SMALL, name="own")
    lines = (folder / "groundtruth.txt").read_text().splitlines()
    # Poses end 10 ms after the first image, 23 ms before the second, and begin again 15 ms before the third.
    stamps = np.array([float(line.split()[0]) for line in lines])
    keep = (stamps < 10.01) | (stamps > 10 + 2 / 30 - 0.015)
    save_lines(folder / "groundtruth.txt", [line for line, flag in zip(lines, keep, strict=True) if flag])
    save_lines(folder / "rgb.txt", (folder / "rgb.txt").read_text().splitlines()[:2])
    recording = wv.open_recording(folder, camera=CAMERA)
    assert np.isnan(recording.camera_to_world).all(axis=1).tolist() == [False, True, False]
    assert [frame.color is None for frame in recording] == [False, True, True]
    posed = recording.posed()
    assert posed.timestamps.tolist() == recording.timestamps[[0, 2]].tolist()
    np.testing.assert_array_equal(posed[1].depth, recording[2].depth)
    missing = next((folder / "depth").glob("10.0333*"))
    missing.unlink()
    with pytest.warns(UserWarning, match=f"1 of 3 depth images do not exist and are left out, the first is {missing}"):
        assert len(wv.open_recording(folder, camera=CAMERA)) == 2


def test_written_tum_set(tmp_path):
    scene = wv.Scene(device="cpu")
    scene.add(trimesh.creation.box((1, 1, 1)), name="box", pose=(3, 0, 0, 0, 0, 0, 1))
    frames = wv.Frames.from_poses([wv.look_at((0, y, 0), (3, 0, 0)) for y in (0.0, 0.5)], timestamps=[1.0, 1.5])
    wv.render_batch(scene, CAMERA, frames, tmp_path / "set", format="tum")
    folder = next((tmp_path / "set").rglob("depth.txt")).parent
    recording = wv.open_recording(folder)
    np.testing.assert_allclose(recording.camera_to_world, frames.camera_to_world, atol=1e-12)
    depth, camera_to_world = recording.stack()
    rendered = wv.render(scene, CAMERA, camera_to_world).depth.numpy()
    hit = np.isfinite(rendered)
    np.testing.assert_array_equal(np.isfinite(depth), hit)
    assert np.abs(depth[hit] - rendered[hit]).max() <= 0.5001 / 5000
    seen = wv.point_visibility_from_depth(depth, recording.camera, camera_to_world, [[2.5, 0, 0]], tolerance=0.01)
    assert (seen.numpy() == wv.Visibility.VISIBLE).all()


def test_icl(tmp_path):
    published = write_icl(tmp_path)
    recording = wv.open_recording(tmp_path)
    assert recording.source["format"] == "icl"
    assert np.isnan(recording.camera_to_world[0]).all()
    assert recording.timestamps.tolist() == [0, 1, 2]
    assert_room(recording.posed(), 5000)
    # The published frames have y up: p = R ((u - cx) / fx, (v - cy) / -480, 1) d + t.
    frame = recording[1]
    left_handed = rays((481.2, -480.0, 319.5, 239.5), 640, 480) * frame.depth[..., None].astype(np.float64)
    points = left_handed @ published[1, :3, :3].T + published[1, :3, 3]
    np.testing.assert_allclose(world_points(frame), points * [1, -1, 1], atol=1e-9)
    assert frame.color.max() == 7


def test_seven_scenes(tmp_path):
    folder = tmp_path / "seq-01"
    write_seven_scenes(folder)
    first = np.asarray(Image.open(folder / "frame-000000.depth.png")).copy()
    first[:2], first[2:5] = 65535, 0
    Image.fromarray(first).save(folder / "frame-000000.depth.png")
    for path in (tmp_path, folder):
        recording = wv.open_recording(path)
        assert recording.source["camera"] == "documented for 7-Scenes"
        assert recording.camera == wv.Camera(640, 480, 585, 585, 320, 240)
    assert np.isnan(recording[0].depth[:5]).all()
    assert np.isfinite(recording[0].depth[5:]).all()
    assert_room(recording[1:])
    assert recording[2].color[0, 0].tolist() == [2, 2, 2]
    (folder / "frame-000002.pose.txt").unlink()
    assert np.isnan(wv.open_recording(folder).camera_to_world[2]).all()


def test_seven_scenes_of_another_camera(tmp_path):
    write_seven_scenes(tmp_path / "own", SMALL, (60.0, 61.0, 30.0, 24.0))
    assert "pass that of the depth images as camera=" in refusal(lambda: wv.open_recording(tmp_path / "own"))
    save_matrix(tmp_path / "camera-intrinsics.txt", [[60, 0, 29.5], [0, 61, 23.5], [0, 0, 1]])
    assert_room(wv.open_recording(tmp_path / "own"))
    write_seven_scenes(tmp_path / "more")
    assert "has several sequences; give one of more, own" in refusal(lambda: wv.open_recording(tmp_path))


def test_scannet(tmp_path):
    recording = wv.open_recording(write_scannet(tmp_path))
    assert recording.source["format"] == "scannet"
    assert recording.camera == CAMERA
    assert np.isnan(recording.camera_to_world).all(axis=1).tolist() == [False, True, False]
    assert_room(recording.posed())
    color = recording[2].color
    assert color.shape == (48, 64, 3)
    # Column x has its center at x + 0.5, which is column 2 x + 1 of twice the resolution.
    np.testing.assert_array_equal(color[10, :, 0], 2 * np.arange(64) + 1)


def test_redwood(tmp_path):
    write_redwood(tmp_path)
    assert "does not define the camera" in refusal(lambda: wv.open_recording(tmp_path))
    k = [60.0, 0, 0, 0, 61.0, 0, 31.5, 23.5, 1]  # by columns
    camera = {"width": 64, "height": 48, "intrinsic_matrix": k}
    (tmp_path / "camera.json").write_text(json.dumps(camera | {"width": 640}))
    message = refusal(lambda: wv.open_recording(tmp_path))
    assert "must be the camera of the depth images, 64 x 48 pixels, got 640 x 48" in message
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    recording = wv.open_recording(tmp_path)
    assert recording.source == {"file": tmp_path.name, "format": "redwood", "camera": "camera.json"}
    assert recording.camera == CAMERA
    assert np.isnan(recording.camera_to_world).all(axis=1).tolist() == [False, True, False]
    assert_room(recording.posed())
    assert recording[1].color is None
    assert abs(int(recording[2].color[3, 3, 1]) - 100) < 3


def test_redwood_default_camera(tmp_path):
    write_frames(tmp_path, (525.0, 525.0, 319.5, 239.5), (640, 480), 1)
    save_lines(tmp_path / "a.log", ["0 0 1", *(text(row) for row in poses([0])[0])])
    assert_room(wv.open_recording(tmp_path))


def test_images_with_a_trajectory(tmp_path):
    write_frames(tmp_path, K_SMALL, SMALL)
    trajectory = tmp_path / "walk.txt"
    stamps = np.arange(-0.5, 2.5, 0.01)
    save_lines(trajectory, [text([time, *row]) for time, row in zip(stamps, rows(poses(stamps)), strict=True)])
    assert_room(wv.open_recording(tmp_path, camera=CAMERA, poses=trajectory), tolerance=1e-5)
    (tmp_path / "trajectory.txt").write_bytes(trajectory.read_bytes())
    assert_room(wv.open_recording(tmp_path, camera=CAMERA), tolerance=1e-5)
    assert_room(wv.open_recording(tmp_path / "depth", camera=CAMERA, poses=trajectory), tolerance=1e-5)
    save_lines(trajectory, [text([time + 90, *row]) for time, row in zip(range(3), rows(poses(range(3))), strict=True)])
    assert_room(wv.open_recording(tmp_path, camera=CAMERA, poses=trajectory))  # by order
    save_lines(trajectory, [text([time + 90, *row]) for time, row in zip(range(2), rows(poses(range(2))), strict=True)])
    message = refusal(lambda: wv.open_recording(tmp_path, camera=CAMERA, poses=trajectory))
    assert message.startswith(f"{trajectory}: must have a pose for each of the 3 depth images, or times")
    (tmp_path / "trajectory.txt").unlink()
    recording = wv.open_recording(tmp_path, camera=CAMERA)
    assert np.isnan(recording.camera_to_world).all()
    assert "pass poses=, a file of poses" in refusal(recording.posed)


def test_images_with_colmap(tmp_path):
    matrices = write_frames(tmp_path, K_SMALL, SMALL, depth="depth/view_{:d}.png")
    lines = []
    for index in (2, 0):
        inverse = np.linalg.inv(matrices[index])
        *q, w = rows(inverse[None])[0, 3:]
        lines += [f"{index + 1} {text([w, *q, *inverse[:3, 3]])} 1 view_{index}.jpg", ""]
        save_color(tmp_path / f"images/view_{index}.jpg", SMALL[::-1], 50 * index)
    save_lines(tmp_path / "sparse/0/images.txt", lines)
    save_lines(tmp_path / "sparse/0/cameras.txt", ["1 PINHOLE 64 48 60 61 32 24"])
    recording = wv.open_recording(tmp_path)
    assert recording.camera == CAMERA
    assert np.isnan(recording.camera_to_world).all(axis=1).tolist() == [False, True, False]
    assert_room(recording.posed())
    assert recording[2].color.mean() == pytest.approx(100, abs=2)


def test_images_with_nerfstudio(tmp_path):
    write_nerfstudio(tmp_path, write_frames(tmp_path, K_SMALL, SMALL))
    assert_room(wv.open_recording(tmp_path))
    (tmp_path / "depth").rename(tmp_path / "measured")
    write_nerfstudio(tmp_path, poses(range(3)), depth_file_path="measured/{:d}.png")
    for index in range(3):
        save_color(tmp_path / f"images/{index}.png", SMALL[::-1], index)
    recording = wv.open_recording(tmp_path)
    assert recording.camera == CAMERA
    assert_room(recording)
    assert [int(frame.color[0, 0, 0]) for frame in recording] == [2, 1, 0]


@pytest.mark.parametrize("suffix", ["npy", "tiff"])
def test_float_images(tmp_path, suffix):
    depth = room_depth(rays(K_SMALL, *SMALL), poses([0])[0]).astype(np.float32)
    depth[0, :4] = 0, np.nan, np.inf, -1

    def save(values):
        path = tmp_path / f"0.{suffix}"
        np.save(path, values) if suffix == "npy" else Image.fromarray(values).save(path)
        return path

    save(depth)
    got = wv.open_recording(tmp_path, camera=CAMERA)[0].depth
    assert np.isnan(got[0, :4]).all()
    np.testing.assert_array_equal(got[1:], depth[1:])
    path = save(depth * 1000)
    message = refusal(lambda: wv.open_recording(tmp_path, camera=CAMERA)[0].depth)
    assert message.startswith(f"{path}: depth must be in meters, got a median of ")
    assert message.endswith("as millimeters are; pass unit=0.001, the length of a unit in meters")
    got = wv.open_recording(tmp_path, camera=CAMERA, unit=0.001)[0].depth
    np.testing.assert_allclose(got[1:], depth[1:], rtol=1e-6)


@pytest.mark.parametrize("maximum", [65535, 10000])
def test_pgm(tmp_path, maximum):
    """Pixels are as stored, high byte first, also with a lower maximum."""
    units = np.rint(1000 * room_depth(rays(K_SMALL, *SMALL), poses([0])[0])).astype(np.uint16)
    units[0, :2] = 0, maximum
    header = f"P5\n# a depth image\n64 48\n# of a Kinect\n{maximum}\n".encode()
    (tmp_path / "0.pgm").write_bytes(header + units.astype(">u2").tobytes())
    got = wv.open_recording(tmp_path, camera=CAMERA)[0].depth
    expected = units / 1000
    expected[0, 0] = np.nan
    expected[0, 1] = np.nan if maximum == 65535 else 10.0
    np.testing.assert_allclose(got, expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"P2\n2 2\n65535\n1 2 3 4\n", "not a binary PGM image (P5)"),
        (b"P5\n2 2\n255\n1234", "expected a gray PGM of 16 bits, got a maximum of 255"),
        (b"P5\n2 2\n65535\n1234567", "a PGM image of 2 x 2 pixels has 7 bytes"),
        (b"P5\n0 2\n65535\n1234567", "a PGM image of 0 x 2 pixels has 7 bytes"),
    ],
)
def test_damaged_pgm(tmp_path, data, expected):
    path = tmp_path / "0.pgm"
    path.write_bytes(data)
    assert refusal(lambda: wv.io.read_depth(path)) == f"{path}: {expected}"


def test_unit_of_integers(tmp_path):
    write_frames(tmp_path, K_SMALL, SMALL, units=4000)
    assert_room_of = wv.open_recording(tmp_path, camera=CAMERA, unit=1 / 4000)
    expected = room_depth(rays(K_SMALL, *SMALL), poses([0])[0])
    np.testing.assert_allclose(assert_room_of[0].depth, expected, atol=0.5001 / 4000)


def test_sequence(tmp_path):
    write_frames(tmp_path, K_SMALL, SMALL, 12)
    recording = wv.open_recording(tmp_path, camera=CAMERA)
    assert recording.timestamps.tolist() == list(range(12))  # 10 follows 9
    assert recording[-1].timestamp == 11
    assert recording[2:8:2][1].timestamp == 4
    assert recording[2:8][1:3].timestamps.tolist() == [3, 4]
    assert [frame.timestamp for frame in recording[9:]] == [9, 10, 11]
    frame = recording[3]
    assert frame.depth is frame.depth
    np.testing.assert_array_equal(recording[3:5].stack()[0][1], recording[4].depth)
    with pytest.raises(IndexError, match="frame must be from -12 to 11, got 12"):
        recording[12]
    assert "indexed by an integer or a slice, got 'a'" in refusal(lambda: recording["a"])
    assert "12 frames, 0 with a pose" in repr(recording)


def test_images_are_read_when_accessed(tmp_path):
    write_frames(tmp_path, K_SMALL, SMALL)
    recording = wv.open_recording(tmp_path, camera=CAMERA)
    path = tmp_path / "depth/1.png"
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    assert np.isfinite(recording[0].depth).all()
    assert refusal(lambda: recording[1].depth).startswith(f"{path}: not a PNG image")
    assert refusal(recording.stack).startswith(f"{path}: not a PNG image")
    path.unlink()
    assert refusal(lambda: recording[1].depth) == f"{path}: no such file"


def test_images_of_other_sizes(tmp_path):
    write_frames(tmp_path, K_SMALL, SMALL)
    path = tmp_path / "depth/2.png"
    save_depth(path, np.ones((24, 32)), 1000)
    save_color(tmp_path / "color/0.png", (24, 32), 1)
    recording = wv.open_recording(tmp_path, camera=CAMERA)
    assert refusal(lambda: recording[2].depth).startswith(
        f"{path}: must have the pixels of the camera, 64 x 48, got 32 x 24; "
    )
    assert "its color image must have the size of the depth image, 64 x 48, got 32 x 24" in refusal(
        lambda: recording[0].color
    )
    save_color(path, SMALL[::-1], 9)
    assert "expected a gray PNG of 16 bits" in refusal(lambda: recording[2].depth)


def matrix_text(*diagonal):
    return "\n".join(text(row) for row in np.diag([*diagonal, 1.0]))


@pytest.mark.parametrize(
    ("write", "name", "content", "expected"),
    [
        (write_tum, "depth.txt", "1.0\n", "{}:1: expected 'timestamp filename', got '1.0'"),
        (write_tum, "depth.txt", "a b\n", "{}:1: expected 'timestamp filename', got 'a b'"),
        (write_tum, "depth.txt", "# none\n", "{}: holds no lines 'timestamp filename'"),
        (write_tum, "depth.txt", "1 depth/no.png\n", "{}: none of the 1 depth image exists, the first is"),
        (write_tum, "groundtruth.txt", "1 2 3\n", "{}:1: expected the 8 numbers"),
        (write_tum, "calibration.txt", "1 2 3\n", "{}:1: expected fx fy cx cy"),
        (write_scannet, "pose/0.txt", "1 2 3\n", "{}: a pose must be 4 x 4 numbers, got 1 x 3"),
        (write_scannet, "pose/0.txt", "1 2\n3\n", "{}:2: expected a row of a matrix of numbers, got '3'"),
        (
            write_scannet,
            "pose/0.txt",
            matrix_text(2, 2, 2),
            "{}: pose must be rotations without scale",
        ),
        (
            write_scannet,
            "pose/0.txt",
            matrix_text(-1, 1, 1),
            "{}: pose must be rotations, not mirrors",
        ),
        (write_scannet, "intrinsic/intrinsic_depth.txt", "1 2\n", "{}: intrinsics must be 3 x 3 or 4 x 4 numbers"),
        (write_redwood, "trajectory.log", "0 0 1\n1 0 0 0\n", "{}:1: a pose must be a line of 3 integers and 4 lines"),
        (write_redwood, "trajectory.log", "x\n", "{}:1: a pose must be a line of 3 integers and 4 lines"),
    ],
)
def test_damaged_files(tmp_path, write, name, content, expected):
    write(tmp_path)
    (tmp_path / name).write_text(content)
    message = refusal(lambda: wv.open_recording(tmp_path, camera=CAMERA if write is write_redwood else None))
    assert message.startswith(expected.format(tmp_path / name)), message


def test_log_of_other_frames(tmp_path):
    write_redwood(tmp_path)
    (tmp_path / "depth/00002.png").unlink()
    message = refusal(lambda: wv.open_recording(tmp_path, camera=CAMERA))
    assert "the frame must be from 0 to 1, as there are depth images, got 2" in message


def test_wrong_arguments(tmp_path):
    write_frames(tmp_path, K_SMALL, SMALL)
    depth = tmp_path / "depth/0.png"

    def message(path=tmp_path, **options):
        return refusal(lambda: wv.open_recording(path, **options))

    assert message(tmp_path / "none") == f"{tmp_path / 'none'}: no such file or folder"
    assert message(depth) == f"{depth}: must be the folder of a recording, or a bag (.bag, .mcap, .db3)"
    assert "does not define the camera" in message()
    assert message(file_format="bag").startswith('file_format must be "tum", "icl", ')
    assert "camera" in message(camera="kinect")
    assert "unit must be the length of a unit, above 0 and at most 1 m, got 0" in message(camera=CAMERA, unit=0)
    assert "unit must be" in message(camera=CAMERA, unit="mm")
    assert "no such file" in message(camera=CAMERA, poses=tmp_path / "none.txt")
    assert "must be a file of poses, got a folder" in message(camera=CAMERA, poses=tmp_path)
    assert "has no frames of 7-Scenes" in message(file_format="7scenes")
    assert "depth.txt: cannot be read" in message(file_format="tum")
    assert "associations.txt: cannot be read" in message(file_format="icl")
    (tmp_path / "empty").mkdir()
    assert "has no depth images, .png" in message(tmp_path / "empty")
    with pytest.raises(FileFormatError, match="must be the name of a file"):
        wv.open_recording(3)
