# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth of LeRobot datasets: videos and images against a room computed in double precision."""

import json

import numpy as np
import pytest

import warpvis as wv

from support.recording_lerobot import (
    DEPTH,
    FPS,
    depth_at,
    encode,
    write_dataset,
    write_tiff,
    write_video,
    write_video_dataset,
)
from support.recordings import K_SMALL, SMALL, assert_room, poses, rays, refusal, room_depth, rows, save_lines, text

CAMERA = wv.Camera.from_K([[60.0, 0, 31.5], [0, 61.0, 23.5], [0, 0, 1]], *SMALL, pixel_center=0.0)


@pytest.mark.parametrize(
    "quantization",
    [{}, {"low": 0.2, "high": 8.0, "shift": 1.0}, {"low": 0.1, "high": 7.0, "use_log": False}],
    ids=["default", "log", "linear"],
)
def test_video(tmp_path, quantization):
    root = write_video_dataset(tmp_path / "set", **quantization)
    recording = wv.open_recording(root, camera=CAMERA, episode=1)
    assert recording.source == {"file": "set", "format": "lerobot", "topic": DEPTH, "episode": 1, "camera": "given"}
    np.testing.assert_allclose(recording.timestamps, [0, 0.1, 0.2], atol=1e-7)
    assert np.isnan(recording.camera_to_world).all()
    low, high, shift = (
        quantization.get(name, value) for name, value in (("low", 0.01), ("high", 10.0), ("shift", 3.5))
    )
    for index in (2, 0, 1):
        expected, got = depth_at(1, index), recording[index].depth
        assert np.isnan(got[:2]).all()  # neither the minimum nor the maximum of the quantization
        # Half of a step, which is proportional to depth + shift if it is logarithmic.
        if quantization.get("use_log", True):
            step = np.log((high + shift) / (low + shift)) / 4095 * (expected + shift)
        else:
            step = np.full_like(expected, (high - low) / 4095)
        assert (np.abs(got - expected)[2:] <= 0.5001 * step[2:]).all()
    assert recording[0].color is None


def test_video_with_poses(tmp_path):
    root = write_video_dataset(tmp_path / "set", counts=(4,))
    times = np.arange(-5, 40) / 100
    save_lines(tmp_path / "walk.txt", [text([t, *row]) for t, row in zip(times, rows(poses(times)), strict=True)])
    recording = wv.open_recording(root, camera=CAMERA, poses=tmp_path / "walk.txt")
    depth, camera_to_world = recording.stack()
    assert np.isfinite(camera_to_world).all()
    points = wv.back_project(depth, CAMERA, camera_to_world).numpy()[:, 2:].astype(np.float64)
    near = np.minimum(np.abs(points), np.abs(points - [6, 4, 3])).min(axis=-1)
    assert near.max() < 0.004


@pytest.mark.parametrize(
    ("unit", "dtype", "factor"),
    [
        (None, np.float32, 1),
        (None, np.uint16, 1000),
        ("m", np.float32, 1),
        ("mm", np.float32, 1000),
        ("mm", np.uint16, 1000),
    ],
)
def test_images(tmp_path, unit, dtype, factor):
    def tiff(episode, frame):
        depth = room_depth(rays(K_SMALL, *SMALL), poses([frame / FPS])[0]) * factor
        return write_tiff((np.rint(depth) if dtype is np.uint16 else depth).astype(dtype))

    info = {"is_depth_map": True} | ({} if unit is None else {"depth_unit": unit})
    root = write_dataset(tmp_path / "set", {"dtype": "image", "info": info}, tiff)
    save_lines(tmp_path / "walk.txt", [text([k / FPS, *rows(poses([k / FPS]))[0]]) for k in range(4)])
    recording = wv.open_recording(root, camera=CAMERA, episode=0, poses=tmp_path / "walk.txt")
    assert len(recording) == 4
    assert_room(recording, 1000, 2e-5)
    halved = wv.open_recording(root, camera=CAMERA, episode=0, unit=0.5 / factor)
    np.testing.assert_allclose(halved[1].depth, recording[1].depth / 2, rtol=1e-6)


def test_float_millimeters_are_refused(tmp_path):
    def tiff(*_):
        return write_tiff(np.full((48, 64), 1500, np.float32))

    feature = {"dtype": "image", "info": {"video.is_depth_map": True}}
    root = write_dataset(tmp_path / "set", feature, tiff, (1,))
    message = refusal(lambda: wv.open_recording(root, camera=CAMERA)[0].depth)
    assert "frame 0 of the episode: depth must be in meters, got a median of 1500, as millimeters are" in message


def test_wrong_datasets(tmp_path):
    root = write_dataset(tmp_path / "set", {"dtype": "image", "info": {"is_depth_map": True}}, lambda *_: b"")
    info_path = root / "meta/info.json"
    info = json.loads(info_path.read_text())

    def message(changed=None, **options):
        info_path.write_text(json.dumps(info | (changed or {})))
        return refusal(lambda: wv.open_recording(root, **({"camera": CAMERA, "episode": 1} | options))[0].depth)

    assert message(episode=None) == f"{root}: the dataset has 2 episodes; choose one as episode="
    assert message(episode=2) == f"{root}: episode must be from 0 to 1, got 2"
    assert message(episode=-1) == "episode must be a whole number from 0 up, got -1"
    assert "does not define the camera; pass that of the depth images as camera=" in message(camera=None)
    assert message(topic="x") == f"{root}: 'x' is not a feature of depth images; these are: {DEPTH}"
    assert message().endswith("the dataset has no image, only its name")
    assert message({"codebase_version": "v2.1"}) == (
        f'{info_path}: must be of a LeRobot dataset v3, got "v2.1"; convert it by lerobot'
    )
    assert message({"features": {"a": {"dtype": "video"}}}) == (
        f"{root}: the dataset has no feature of depth images: a"
    )
    depth = {"dtype": "image", "info": {"is_depth_map": True}}
    assert message({"features": {"a": depth, "b": depth}}) == (
        f"{root}: the dataset has several features of depth images; choose one as topic=: a, b"
    )
    wrong = {"dtype": "image", "info": {"is_depth_map": True, "depth_unit": "cm"}}
    assert (
        message({"features": {DEPTH: wrong}}) == f"{info_path}: depth_unit of {DEPTH} must be 'm' or 'mm', got \"cm\""
    )
    for change in ({"video.depth_min": 20}, {"video.shift": -1.0}, {"video.depth_max": "x"}):
        wrong = {"dtype": "video", "info": {"is_depth_map": True, **change}}
        assert message({"features": {DEPTH: wrong}}).startswith(f"{info_path}: {DEPTH}: depth_min")
    assert "world_frame= is for bags" in message(world_frame="map")
    (root / "meta/episodes/chunk-000/file-000.parquet").write_bytes(b"PAR1")
    assert "cannot be read as Parquet" in message()


def test_wrong_videos(tmp_path):
    root = write_video_dataset(tmp_path / "set")
    video = root / f"videos/{DEPTH}/chunk-000/file-000.mp4"
    recording = wv.open_recording(root, camera=CAMERA, episode=1)
    assert "unit= is not for videos of LeRobot" in refusal(
        lambda: wv.open_recording(root, camera=CAMERA, episode=1, unit=0.001)
    )
    video.unlink()
    assert "cannot be read" in refusal(lambda: recording[0].depth)
    video.parent.rmdir()
    write_video(video, [encode(depth_at(0, 0))] * 2)
    assert "frame 2 of the episode: the video has no frame at 0.6000 s" in refusal(lambda: recording[2].depth)
    video.unlink()
    video.parent.rmdir()
    write_video(video, [np.zeros((48, 64), np.uint8)] * 8, "gray")
    assert refusal(lambda: recording[0].depth) == f"{video}: depth must be a video of gray12le, got gray"
