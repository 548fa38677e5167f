# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of `warpvis watch`: answers of a recording on disk, and its page without a browser."""

import csv
import json
import signal
import socket
import subprocess
import sys
import time
from unittest import mock

import numpy as np
import pytest
from command_line import run_inside

import warpvis as wv

from support.watching import BALL, BOX, FLOOR, person, raised, save_folder

PORT = 8561


def places():
    return [f"{name}={','.join(map(str, raised(place)))}" for name, place in (("ball", BALL), ("box", BOX))]


@pytest.fixture
def recorded(tmp_path):
    """Write a recording with a person who walks out of it; return the arguments that all commands share."""
    camera = save_folder(tmp_path / "room")
    row = " ".join(map(str, person().poses[0])).split()
    lines = ["timestamp,name,x,y,z,qx,qy,qz,qw", *(f"{when},anna,{','.join(row)}" for when in range(5))]
    (tmp_path / "people.csv").write_text("\n".join(lines) + "\n")
    people = ["--people", "people.csv", "--floor", FLOOR, "--cell-size", 0.04]
    return ["room", "--camera", camera.name, *people, "--places", *places()]


def test_answers_are_written_and_printed(recorded, tmp_path):
    result = run_inside("watch", *recorded, "--no-view", "--print-every", 4, "--out", "who.csv", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    printed = [line for line in result.stdout.splitlines() if line.startswith("frame")]
    assert [line.split(",")[0] for line in printed] == ["frame 1 of 8", "frame 5 of 8"]
    assert "anna: ball occluded 100 %, box visible" in printed[1] and "means box" in printed[1]
    with (tmp_path / "who.csv").open() as file:
        rows = list(csv.DictReader(file))
    # Anna's poses end at 4 s, and are valid for a second more.
    assert {int(row["frame"]) for row in rows if row["agent"] == "anna"} == set(range(6))
    assert {int(row["frame"]) for row in rows if row["agent"] == "robot"} == set(range(8))
    last = {row["place"]: row for row in rows if row["agent"] == "anna" and row["frame"] == "5"}
    assert last["ball"]["status"] == "occluded" and float(last["ball"]["hidden"]) == 1
    assert last["box"]["status"] == "visible" and float(last["box"]["meant"]) > 0.9
    assert [float(row["timestamp"]) for row in rows if row["agent"] == "robot"][::2] == [0, 1, 2, 3, 4, 5, 6, 7]


def test_answers_equal_those_of_a_watcher(recorded, tmp_path):
    result = run_inside("watch", *recorded, "--no-view", "--every", 3, "--out", "who.json", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    answers = json.loads((tmp_path / "who.json").read_text())["answers"]
    recording = wv.open_recording(tmp_path / "room", camera=wv.io.load_camera(tmp_path / "camera.json"))
    options = {"floor": FLOOR, "cell_size": 0.04, "places": {"ball": raised(BALL), "box": raised(BOX)}}
    watcher = wv.visibility.DepthWatcher(recording.camera, **options)
    for index in (0, 3):
        frame = recording[index]
        watched = watcher.update(frame.depth, frame.camera_to_world, [person()], time=index / 30)
        for place, sight in watched.sights["anna"].items():
            keys = {"frame": index, "agent": "anna", "place": place}
            (found,) = (row for row in answers if keys.items() <= row.items())
            assert found["status"] == sight.status.name.lower()
            for name in ("visible", "hidden", "unknown", "out_of_view"):
                assert found[name] == pytest.approx(getattr(sight, name), abs=1e-4)


def test_floor_is_found_in_the_recording(recorded, tmp_path):
    arguments = [word for word in recorded if word not in ("--floor", FLOOR)]
    result = run_inside("watch", *arguments, "--no-view", "--up", "0,0,1", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("floor: 1.1") and "anna: ball occluded" in result.stdout


def test_page_shows_the_answers(recorded, tmp_path):
    from warpvis.viewer import WatchPage

    shown = {}

    def stop(page):
        shown["frames"], shown["table"] = page.frames, page._table.content
        shown["points"] = {name: len(node.points) for name, node in page._clouds.items()}
        shown["images"] = {name: image.image.shape for name, image in page._images.items()}

    with mock.patch.object(WatchPage, "wait", stop):
        result = run_inside("watch", *recorded, "--speed", 0, "--port", PORT, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("http://localhost:")
    assert shown["frames"] == 8 and shown["points"]["surface"] > 1000
    assert shown["images"]["depth"] == (120, 160, 3) and "ball" in shown["table"] and "robot" in shown["table"]


def test_page_shows_unknown_space_near_lines_of_sight(recorded, tmp_path):
    from warpvis.viewer import WatchPage

    bob = person("bob", eyes=(0.5, 3.0, 1.4))
    recording = wv.open_recording(tmp_path / "room", camera=wv.io.load_camera(tmp_path / "camera.json"))
    watcher = wv.visibility.DepthWatcher(recording.camera, floor=FLOOR, cell_size=0.04, places={"ball": raised(BALL)})
    with WatchPage(watcher, port=PORT + 1, speed=0) as page:
        for frame in recording[:3]:
            watched = watcher.update(frame.depth, frame.camera_to_world, [bob])
        page.show(watched, "here")
        cloud = np.array(page._clouds["unknown"].points)
        eye, center = watched.people[0].poses[0, :3], watched.places["ball"][:3]
        along = np.clip((cloud - eye) @ (center - eye) / ((center - eye) @ (center - eye)), 0, 1)
        distances = np.linalg.norm(cloud - eye - along[:, None] * (center - eye), axis=1)
        assert len(cloud) > 10 and distances.max() < 0.2
        assert "here" in page._status.content and "warpvis-meant" in page.answers.answers.meant.content


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["nothing"], "nothing: no such file or folder"),
        (["room", "--places", "ball=1,2"], "place 'ball' must be 3 or 4 numbers, got '1,2'"),
        (
            ["room", "--places", "ball=1,2,3", "ball=1,2,4"],
            "places must have different names, got 'ball' more than once",
        ),
        (["room", "--every", "0"], "--every must be"),
        (["room", "--out", "who.txt"], "the name must end in .csv or .json"),
        (["room", "--fixed"], "has poses, so it takes no --fixed"),
        (["room", "--up", "up"], "--up must be 3 numbers, got 'up'"),
        (["room", "--people", "nobody.csv"], "nobody.csv"),
        (
            ["room", "--people", "twice.csv"],
            "twice.csv: 'anna' must have one pose at a time, got several at 1.000000 s",
        ),
    ],
)
def test_bad_options_are_refused(options, words, tmp_path):
    save_folder(tmp_path / "room", count=2)
    rows = "1,anna,0,0,0,0,0,0,1\n" * 2
    (tmp_path / "twice.csv").write_text("timestamp,name,x,y,z,qx,qy,qz,qw\n" + rows)
    result = run_inside("watch", *options, "--camera", "camera.json", "--no-view", cwd=tmp_path)
    assert result.returncode == 2 and words in result.stderr, result.stderr
    assert result.stderr.count("\n") == 1


def test_places_are_read_from_files(tmp_path):
    from warpvis.cli._watch import _read_places

    (tmp_path / "places.csv").write_text("name,x,y,z,diameter\n# a comment\nmug, 1, 2, 3, 0.1\nthe door,4,5,6\n")
    np.save(tmp_path / "points.npy", np.arange(6.0).reshape(2, 3))
    found = _read_places([str(tmp_path / "places.csv"), "cup=0 1 2", str(tmp_path / "points.npy")])
    expected = {"mug": [1, 2, 3, 0.1], "the door": [4, 5, 6], "cup": [0, 1, 2], "point 0": [0, 1, 2]}
    expected["point 1"] = [3, 4, 5]
    assert {name: place.tolist() for name, place in found.items()} == expected


def test_ctrl_c_ends_the_page_and_keeps_the_answers(recorded, tmp_path):
    command = [sys.executable, "-m", "warpvis", "watch", *map(str, recorded)]
    options = ["--port", str(PORT + 2), "--out", "who.csv"]
    with subprocess.Popen([*command, *options], cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline().startswith("http")
            time.sleep(3)
            process.send_signal(signal.SIGINT)
            assert process.wait(timeout=60) == 130
        finally:
            process.kill()
    assert (tmp_path / "who.csv").read_text().startswith("frame,timestamp,agent,place,status")
    with socket.socket() as probe:
        assert probe.connect_ex(("localhost", PORT + 2)) != 0
