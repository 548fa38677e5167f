# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""``warpvis render --lidar``: point clouds along poses, as used from a shell."""

import re
import sys

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.cli import main


@pytest.fixture
def folder(tmp_path, monkeypatch):
    trimesh.creation.box((4, 4, 2)).export(tmp_path / "room.ply")
    (tmp_path / "walk.txt").write_text("0 0 0 0 0 0 0 1\n0.1 0.5 0 0 0 0 0.70710678 0.70710678\n")
    (tmp_path / "back.txt").write_text("1 0 0 0 0 0 0 1\n0.5 0.5 0 0 0 0 0 1\n")
    (tmp_path / "short.txt").write_text("1 0 0 0 0 0 0 1\n1.01 0.5 0 0 0 0 0 1\n")
    np.save(tmp_path / "mid360.npy", np.zeros((40_000, 2), dtype=np.float32))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def render(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["warpvis", "render", "room.ply", "--out", "scans", *arguments])
    main()


def test_one_cloud_is_written_per_pose(folder, monkeypatch, capsys):
    render(monkeypatch, "--lidar", "os1-128@512x10", "--poses", "walk.txt", "--format", "bin", "npy", "ply")
    names = sorted(path.relative_to(folder / "scans").as_posix() for path in (folder / "scans").rglob("*.*"))
    assert names == [
        "bin/000000.bin",
        "bin/000001.bin",
        "npy/000000.npy",
        "npy/000001.npy",
        "ply/000000.ply",
        "ply/000001.ply",
    ]
    cloud = np.load(folder / "scans/npy/000001.npy")
    points = np.stack([cloud[axis] for axis in "xyz"], axis=-1)
    # The room is 4 m wide; the lidar looks along its y axis, 0.5 m left of its center.
    walls = np.abs(points - [0, 0.5, 0]) - [2, 2, 1]
    assert np.abs(walls.max(axis=1)).max() < 1e-5
    np.testing.assert_array_equal(np.fromfile("scans/bin/000001.bin", np.float32).reshape(-1, 4)[:, :3], points)
    np.testing.assert_array_equal(wv.io.read_points("scans/ply/000001.ply"), points)
    assert "clouds: 2 frames, 131072 points" in capsys.readouterr().out


@pytest.mark.parametrize("lidar", ["vlp16", "vls128", "xt32", "rplidar-a2", "os1-32", "mid360:mid360.npy"])
def test_lidars_are_selected_by_name(folder, monkeypatch, lidar):
    render(monkeypatch, "--lidar", lidar, "--poses", "walk.txt", "--quiet")
    assert len(list((folder / "scans/pcd").iterdir())) == 2


@pytest.mark.parametrize("lidar", ["os1-128@512x10", "mid360:mid360.npy"])
def test_moving_lidar(folder, monkeypatch, capsys, lidar):
    """At 10 m/s a scan is skewed by 1 m; de-skewed points lie on the walls."""
    rows = np.zeros((5, 8))
    rows[:, 0], rows[:, 1], rows[:, 7] = 1e3 + 0.04 * np.arange(5), -0.8 + 0.4 * np.arange(5), 1
    np.savetxt("drive.txt", rows)
    np.save("mid360.npy", np.random.default_rng(0).uniform((-3.1, -0.8), (3.1, 0.8), (40_000, 2)).astype(np.float32))
    render(monkeypatch, "--lidar", lidar, "--poses", "drive.txt", "--format", "npy", "--moving")
    assert sorted(path.name for path in (folder / "scans/npy").iterdir()) == ["000000.npy", "000001.npy"]
    assert "clouds: 2 frames of 5 poses" in capsys.readouterr().out
    motion = wv.sensors.Motion(rows[:, 1:], rows[:, 0], starts=rows[:2, 0])
    clouds = [np.load(folder / f"scans/npy/00000{k}.npy") for k in (0, 1)]
    for view, straight in enumerate(wv.sensors.deskew(clouds, motion)):
        skewed, points = (np.stack([c[axis] for axis in "xyz"], axis=-1) for c in (clouds[view], straight))
        place = [0.4 * view - 0.8, 0, 0]
        errors = [np.abs((np.abs(given + place) - [2, 2, 1]).max(axis=1)).max() for given in (skewed, points)]
        assert errors[0] > 0.5 and errors[1] < 1e-5


@pytest.mark.parametrize("poses", [("walk.txt",), ("drive.txt", "--moving")], ids=["still", "moving"])
def test_noise_of_lidars(folder, monkeypatch, poses):
    np.savetxt("drive.txt", [[1e3 + t, t, 0, 0, 0, 0, 0, 1] for t in (0.0, 0.06, 0.12, 0.18)])
    clouds = {}
    for name, noise in {
        "exact": (),
        "mine": ("--sensor-seed", "2"),
        "again": ("--sensor-seed", "2"),
        "other": (),
    }.items():
        if name != "exact":
            noise = ("--lidar-noise", "sigma=0.02,dropout=0.25,detection_range=4", "reflectivity=0.5", *noise)
        render(monkeypatch, "--lidar", "vlp16", "--poses", *poses, "--format", "npy", "--quiet", *noise)
        clouds[name] = [np.load(path) for path in sorted((folder / "scans/npy").iterdir())]
        (folder / "scans").rename(folder / name)
    assert len(clouds["mine"]) == 2
    for exact, mine, again, other in zip(*clouds.values(), strict=True):
        np.testing.assert_array_equal(again, mine)
        assert abs(len(mine) / len(exact) - 0.75) < 0.02 and len(other) != len(mine)
        rays = {(ray["ring"], ray["time"]): ray["range"] for ray in exact}
        error = np.array([ray["range"] - rays[ray["ring"], ray["time"]] for ray in mine])
        assert abs(error.std() / 0.02 - 1) < 0.05 and abs(error.mean()) < 0.001
    first, second = clouds["mine"]
    assert len(first) != len(second)  # frames have distinct noise


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--lidar", "os9-128", "--poses", "walk.txt"), "--lidar must be OS0-128, .* got 'os9-128'"),
        (("--lidar", "rplidar-x9", "--poses", "walk.txt"), "--lidar must be .*A1.* got 'X9'"),
        (("--lidar", "vlp99", "--poses", "walk.txt"), "--lidar must be vlp16, vlp32c, .* got 'vlp99'"),
        (("--lidar", "vlp16"), "give --poses with --lidar"),
        (("--lidar", "vlp16", "--poses", "walk.txt", "--camera", "kinect"), "no camera is rendered: give no --camera"),
        (("--lidar", "vlp16", "--poses", "walk.txt", "--format", "png"), "--format with --lidar must be .* got 'png'"),
        (("--poses", "walk.txt", "--moving"), "--moving requires --lidar"),
        (("--poses", "walk.txt", "--lidar-noise", "sigma=1"), "--lidar-noise requires --lidar"),
        (
            ("--lidar", "vlp16", "--poses", "walk.txt", "--sensor-seed", "1"),
            "without --lidar-noise, give no --sensor-se",
        ),
        (
            ("--lidar", "vlp16", "--poses", "walk.txt", "--lidar-noise", "noise=1"),
            "--lidar-noise takes each NAME=NUMBER once, of .*sigma.*, got 'noise=1'",
        ),
        (
            ("--lidar", "vlp16", "--poses", "walk.txt", "--lidar-noise", "rain=1"),
            "detection_range must be a number of m",
        ),
        (
            ("--lidar", "vlp16", "--poses", "back.txt", "--moving"),
            "timestamps that increase from pose to pose",
        ),
        (
            ("--lidar", "vlp16", "--poses", "short.txt", "--moving"),
            "revolution of the lidar, 0.09.* s, got 0.01 s",
        ),
        (("--lidar", "os1-128@9x9", "--poses", "walk.txt"), 'mode must be "512x10", .* got .9x9.'),
        (("--lidar", "avia:none.csv", "--poses", "walk.txt"), "none.csv: cannot be read"),
    ],
)
def test_invalid_arguments_exit_2(folder, monkeypatch, capsys, arguments, message):
    with pytest.raises(SystemExit) as ended:
        render(monkeypatch, *arguments)
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert re.search(message, said) and len(said.splitlines()) == 1
    assert not (folder / "scans").exists()


def test_non_empty_folder_is_not_overwritten(folder, monkeypatch, capsys):
    render(monkeypatch, "--lidar", "vlp16", "--poses", "walk.txt", "--quiet")
    with pytest.raises(SystemExit):
        render(monkeypatch, "--lidar", "vlp16", "--poses", "walk.txt", "--quiet")
    assert "exists already; give a new or empty folder" in capsys.readouterr().err
