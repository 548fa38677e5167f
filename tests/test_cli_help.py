# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Command help, the common syntax of lists, and messages that name options."""

import json
from typing import get_args

import numpy as np
import pytest
import trimesh
from command_line import run_inside

import warpvis as wv
from warpvis.cli import name_options
from warpvis.core.outputs import IMAGE_NAMES, OUTPUTS, SENSOR_NAMES, Output

COMMANDS = [
    "demo",
    "render",
    "batch",
    "generate",
    "verify",
    "warmup",
    "check",
    "perspective",
    "view",
    "info",
    "sensor-fit",
]
ORBIT = "orbit target=0.5,0,0.5 radius=3 height=1 count=2"


def help_of(command, tmp_path):
    """Return a command's help as continuous text without the frame, and the raw output."""
    result = run_inside(*command.split(), "--help", cwd=tmp_path)
    assert result.returncode == 0
    return " ".join(line.strip("│╭╮╰╯─ ") for line in result.stdout.splitlines()), result.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("two")
    file = trimesh.Scene()
    for name, x in (("ball", 0), ("block", 1)):
        there = trimesh.transformations.translation_matrix((x, 0, 0.5))
        file.add_geometry(trimesh.creation.box((0.3,) * 3), node_name=name, geom_name=name, transform=there)
    file.export(place / "two.glb")
    (place / "camera.json").write_text(json.dumps({"width": 32, "height": 24, "hfov": 0.8}))
    return place


def render(folder, out, *arguments, command="render"):
    given = ("--poses", ORBIT, "--camera", "camera.json", "--file-up", "z", "--out", out)
    return run_inside(command, "two.glb", *given, *arguments, cwd=folder)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_no_empty_defaults(command, tmp_path):
    words, printed = help_of(command, tmp_path)
    assert "None" not in words and "(default: )" not in words and "STR|" not in words
    for line, following in zip(printed.splitlines(), printed.splitlines()[1:], strict=False):
        if line.startswith("│ ") and following.startswith("│   "):  # no line ends where the next word would still fit
            text, first = line[2:-2].rstrip(), following.strip("│ ").split(" ")[0]
            starts_option = text.lstrip().startswith("-") or not first or not text
            assert starts_option or len(text) + 1 + len(first) > len(line) - 4 or text.endswith((".", ":")), line


def test_help_shows_defaults_and_choices(tmp_path):
    words, _ = help_of("render", tmp_path)
    for part in ("(default: 1.0)", "(default: npz png)", "--up {z,y}", "--camera kinect|FILE", "--threads INT"):
        assert part in words
    assert "YAML file of names or patterns and their labels" in words
    assert "Robot poses to play on a slider" in help_of("view", tmp_path)[0]


def test_help_lists_all_outputs(tmp_path):
    assert get_args(Output) == tuple(OUTPUTS) == (*IMAGE_NAMES, *SENSOR_NAMES)
    for command in ("render", "batch"):
        words, _ = help_of(command, tmp_path)
        assert (
            f"Outputs to render: {', '.join(IMAGE_NAMES)}, visibility, with --sensor also reasons and true_depth"
            in words
        )
        assert "color, albedo" in words


def test_version(tmp_path):
    result = run_inside("--version", cwd=tmp_path)
    assert (result.returncode, result.stdout) == (0, f"warpvis {wv.__version__}\n")
    assert "warpvis --version prints the version" in help_of("", tmp_path)[0]


@pytest.mark.parametrize(
    ("option", "forms"),
    [
        ("--labels", [["ball=object,block=40"], ["ball=object", "block=40"], ["ball=object,", "block=40,"]]),
        ("--label-names", [["40=road,41=moving car, van"], ["40=road", "41=moving car, van"]]),
        ("--exclude", [["ball,block"], ["ball", "block"]]),
        ("--search-path", [["a,b"], ["a", "b"]]),
        ("--option", [["level=3,compression=zstd"], ["level=3", "compression=zstd"]]),
        ("--sensor-vary", [["sigma=0.05:0.15,dropout=0:0.05"], ["sigma=0.05:0.15", "dropout=0:0.05"]]),
    ],
)
def test_lists_accept_commas_or_spaces(option, forms, tmp_path, monkeypatch):
    """Every list option accepts commas, spaces or both."""
    import tyro

    from warpvis.cli import Batch

    monkeypatch.chdir(tmp_path)
    read = {
        "--labels": lambda command: command.label_rules(),
        "--label-names": lambda command: command.label_rules(),
        "--exclude": lambda command: command.chosen()["exclude"],
        "--search-path": lambda command: command.folders(),
        "--option": lambda command: command.chosen()["options"],
        "--sensor-vary": lambda command: command.chosen()["sensor"],
    }[option]
    common = ["a.obj", "--out", "o", "--sensor", "d435"]
    results = [read(tyro.cli(Batch, args=[*common, option, *words])) for words in forms]
    assert all(result == results[0] for result in results)
    assert results[0] != read(tyro.cli(Batch, args=common))


def test_existing_folder_with_a_comma_is_not_split(tmp_path, monkeypatch):
    from warpvis.cli import Info

    monkeypatch.chdir(tmp_path)
    (tmp_path / "a,b").mkdir()
    assert [path.name for path in Info(search_path=("a,b", "c,d")).folders()] == ["a,b", "c", "d"]


MESSAGES = {
    "bop": ("render", ["--format", "bop"], "Assign that label with --labels or choose objects with --objects to"),
    "outputs": ("render", ["--outputs", "foo"], "warpvis: --outputs must be some of depth, points"),
    "no sensor": ("render", ["--outputs", "reasons"], "warpvis: --outputs must not contain reasons without a sensor"),
    "scale": ("render", ["--scale", "-1"], "warpvis: --scale of 'two.glb' must be one or three positive numbers"),
    "threads": ("batch", ["--threads", "0"], "warpvis: --threads must be a whole number"),
    "label": ("render", ["--labels", "ball=foo"], "got 'foo'; --label-names names others"),
    "label names": ("render", ["--label-names", "300=road"], "warpvis: --label-names must have numbers"),
    "shards": ("batch", ["--shard-frames", "0"], "warpvis: --shard-frames must be a whole number"),
    "workers": ("batch", ["--workers", "2"], "--workers and --address require --engine ray, got --engine local"),
    "repair": ("batch", ["--repair"], "warpvis: --repair requires --resume, because it renders damaged parts of an"
               " existing dataset again"),
}  # fmt: skip


@pytest.mark.parametrize("case", MESSAGES)
def test_messages_name_options(case, folder, tmp_path):
    command, arguments, message = MESSAGES[case]
    result = render(folder, tmp_path / "out", *arguments, command=command)
    assert result.returncode == 2 and message in result.stderr


def test_lidar_poses_must_be_a_file(folder, tmp_path):
    result = run_inside("render", "two.glb", "--poses", ORBIT, "--lidar", "vlp16", "--out", tmp_path / "o", cwd=folder)
    assert "--poses with --lidar must be a file of the lidar's poses" in result.stderr and ORBIT in result.stderr


def test_warnings_name_options(folder, tmp_path):
    np.save(tmp_path / "poses.npy", np.array([wv.look_at((2 * np.cos(a), 2 * np.sin(a), 1), (0, 0, 0.5))
                                              for a in range(6)])[:, [0, 1, 2, 6, 3, 4, 5]])  # fmt: skip
    given = ("--poses", tmp_path / "poses.npy", "--file-up", "z", "--out", tmp_path / "out")
    for more, warned in ((), True), (("--quaternion", "wxyz"), False):
        result = run_inside("check", "two.glb", *given[:-2], *more, cwd=folder)
        assert ("If they have, pass --quaternion wxyz" in result.stderr) == warned


def test_messages_about_files_keep_their_keys():
    from warpvis.cli import Info

    message = "rules.json: label_names must be a mapping"
    assert name_options(message, Info()) == name_options(message, None) == message
    assert name_options("give file_up=, or label_names", Info()) == "give --file-up, or --label-names"


@pytest.mark.parametrize("layout", ["npz", "zarr"])
def test_datasets_contain_colors(layout, folder, tmp_path):
    result = render(folder, tmp_path / "out", "--outputs", "color,albedo,depth", "--format", layout, "--no-pictures")
    assert (result.returncode, result.stderr) == (0, "")
    dataset = wv.open_dataset(tmp_path / "out" / layout)
    scene = wv.Scene.load(folder / "two.glb", file_up="z")
    frame = dataset[1]
    views = wv.render(scene, dataset.camera, frame["camera_to_world"], outputs=("color", "albedo"))
    for name in ("color", "albedo"):
        image = getattr(views, name).numpy()[0]
        assert frame[name].dtype == np.uint8 and len(np.unique(image)) > 1
        np.testing.assert_array_equal(frame[name], image)
    assert json.loads((tmp_path / "out" / layout / "manifest.json").read_text())["shadows"] is True
    assert run_inside("verify", tmp_path / "out" / layout, cwd=tmp_path).returncode == 0
    options = ("--no-shadows", "--samples", "4")
    result = render(folder, tmp_path / "bright", "--outputs", "color", "--format", layout, *options)
    assert result.returncode == 0
    manifest = json.loads((tmp_path / "bright" / layout / "manifest.json").read_text())
    assert (manifest["shadows"], manifest["samples"]) == (False, 4)
    smooth = wv.render(
        scene, dataset.camera, frame["camera_to_world"], outputs="color", shadows=False, samples=4
    ).color.numpy()
    np.testing.assert_array_equal(wv.open_dataset(tmp_path / "bright" / layout)[1]["color"], smooth[0])
