# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Invalid input to the CLI prints one sentence with the value and the expectation."""

import json
import re

import pytest
import trimesh
from command_line import run_apart, run_inside

BOX = trimesh.creation.box()


@pytest.fixture
def workspace(tmp_path):
    BOX.export(tmp_path / "box.stl")
    (tmp_path / "poses.txt").write_text("0 -3 0 0 0.5 -0.5 0.5 -0.5\n")
    (tmp_path / "broken.txt").write_text("0 1 2\n")
    (tmp_path / "list.json").write_text("[]")
    (tmp_path / "broken.json").write_text('{"width": 3,\n')
    (tmp_path / "odd.json").write_text(json.dumps({"width": 3, "height": 2, "hfov": 1, "fov": 1}))
    (tmp_path / "words.json").write_text(json.dumps({"width": 3, "height": 2, "hfov": "wide"}))
    (tmp_path / "small.json").write_text(json.dumps({"width": 3, "height": 2, "hfov": 1, "near": 2, "far": 1}))
    (tmp_path / "half.json").write_text(json.dumps({"width": 3, "hfov": 1}))
    (tmp_path / "file").write_text("in the way")
    return tmp_path


COMMANDS = {
    "no mesh": ("render none.obj --poses poses.txt --out o", "warpvis: none.obj: no such file"),
    "no poses": ("render box.stl --poses none.txt --out o", "warpvis: none.txt: no such file"),
    "broken poses": ("render box.stl --poses broken.txt --out o", "warpvis: broken.txt:1: expected the 8 numbers"),
    "no camera": ("render box.stl --poses poses.txt --out o --camera c", 'a camera is "kinect" or a file'),
    "broken camera": ("render box.stl --poses poses.txt --out o --camera broken.json", "broken.json:2: is not JSON"),
    "camera list": ("render box.stl --poses poses.txt --out o --camera list.json", "holds one JSON object, got list"),
    "odd camera": (
        "render box.stl --poses poses.txt --out o --camera odd.json",
        "odd.json: unknown fov; a camera file",
    ),
    "half a camera": ("render box.stl --poses poses.txt --out o --camera half.json", "half.json: missing height"),
    "camera of words": (
        "render box.stl --poses poses.txt --out o --camera words.json",
        "words.json: hfov must be between 0 and pi radians, got 'wide'",
    ),
    "small camera": ("render box.stl --poses poses.txt --out o --camera small.json", "small.json: the depth range"),
    "no device": ("render box.stl --poses poses.txt --out o --device cuda:9", "device 'cuda:9' is not on this machine"),
    "a file for a folder": (
        "render box.stl --poses poses.txt --out file",
        "warpvis: file: is a file, but a dataset must be a folder",
    ),
    "demo on no device": ("demo --out o --device tpu", "device 'tpu' is not on this machine"),
    "demo into a file": ("demo --out file", "warpvis: file: must be a folder, but is a file"),
    "negative scale": ("render box.stl --poses poses.txt --out o --scale -1", "scale of 'box.stl' must be"),
}


@pytest.mark.parametrize("case", COMMANDS)
def test_cli_prints_one_sentence_and_exits_2(workspace, case):
    arguments, message = COMMANDS[case]
    run = run_apart if case == "no mesh" else run_inside
    result = run(*arguments.split(), cwd=workspace)
    assert result.returncode == 2
    assert "Traceback" not in result.stderr
    lines = [line for line in result.stderr.splitlines() if line.startswith("warpvis: ")]
    assert len(lines) == 1
    assert re.search(message, lines[0])


@pytest.mark.parametrize("arguments", ["", "paint", "render", "render box.stl --poses poses.txt", "demo --color red"])
def test_unknown_cli_arguments_exit_2(workspace, arguments):
    result = run_inside(*arguments.split(), cwd=workspace)
    assert result.returncode == 2
    assert "Traceback" not in result.stderr
