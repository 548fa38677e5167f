# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tutorials are correct: pages print what they show, and notebooks run and support their claims."""

import json
import re
import shlex
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
import warp as wp

import warpvis as wv
from warpvis.cli import main

TUTORIALS = Path(__file__).parent.parent / "docs" / "tutorials"
PAGES = ["mujoco_depth", "camera_placement", "recording", pytest.param("thousand_rooms", marks=pytest.mark.slow)]
NOTEBOOKS = sorted(TUTORIALS.glob("*.ipynb"))
NOTEBOOK = pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.stem)


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """Return an empty working folder; restore Warp's settings afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(wp.config, "log_level", wp.config.log_level)
    yield tmp_path
    plt.close("all")


def run_shell(code, monkeypatch):
    """Run the ``warpvis`` commands of a shell fence."""
    for line in code.replace("\\\n", " ").splitlines():
        if line.startswith("warpvis "):
            monkeypatch.setattr(sys, "argv", shlex.split(line))
            try:
                main()
            except SystemExit as stop:
                assert not stop.code, line


def cells(notebook, kind):
    return [cell for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == kind]


def run_notebook(name):
    """Run a notebook's code in this process and return its variables."""
    names = {}
    for number, cell in enumerate(cells(TUTORIALS / f"{name}.ipynb", "code")):
        exec(compile("".join(cell["source"]), f"{name}, code cell {number}", "exec"), names)
    return names


@pytest.mark.docs
@pytest.mark.parametrize("name", PAGES)
def test_page_prints_what_it_shows(name, elsewhere, monkeypatch, capsys):
    text = (TUTORIALS / f"{name}.md").read_text()
    names, printed = {}, ""
    fences = re.findall(r"^```(python|bash|text)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    assert any(language == "text" for language, _ in fences)
    for number, (language, code) in enumerate(fences):
        if language == "text":
            assert printed == code, f"{name}, fence {number}"
            continue
        if language == "bash":
            run_shell(code, monkeypatch)
        else:
            exec(compile(code, f"{name}, fence {number}", "exec"), names)
        printed = capsys.readouterr().out
    pictures = re.findall(r"\(\.\./pictures/(\w+\.png)\)", text)
    assert pictures and all((elsewhere / picture).is_file() for picture in pictures)


def test_every_page_is_run():
    names = {page if isinstance(page, str) else page.values[0] for page in PAGES}
    assert names | {"index"} == {page.stem for page in TUTORIALS.glob("*.md")}


@pytest.mark.docs
def test_kinect_notebook(elsewhere):
    """Noise at 1 m is about 1.4 mm as the text says, and the manually projected point equals the rendered one."""
    names = run_notebook("kinect_in_ten_minutes")
    assert 1.35 < names["square"] < 1.45
    assert np.allclose(names["rotation"] @ names["in_camera"] + names["pose"][:3], [0.5363, 0.5588, 0.8778], atol=1e-4)
    found = {reason for reason in wv.sensors.Reason if (names["reasons"] == reason).any()}
    assert {"VALID", "SHADOW", "EDGE", "GRAZING"} == {reason.name for reason in found}
    assert (elsewhere / "desk.png").is_file()


@pytest.mark.docs
def test_perspective_notebook(elsewhere):
    """From the proposed pose the robot sees both objects, and no longer the bowl."""
    names = run_notebook("who_sees_what")
    proposal, objects = names["proposal"], names["objects"]
    assert proposal.fractions == {"red cup": 1.0, "salt": 1.0}
    seen = wv.perspective(names["scene"], [names["moved"], names["person"]], objects=objects)
    states = dict(zip(objects, seen.states("robot", "person")[0], strict=True))
    assert states["bowl"] == wv.visibility.State.SECOND
    assert names["states"].shape == (61, 4)


@NOTEBOOK
def test_notebooks_are_stored_without_outputs(notebook):
    for cell in cells(notebook, "code"):
        assert cell["outputs"] == [] and cell["execution_count"] is None


@NOTEBOOK
def test_notebook_links_resolve(notebook):
    text = "\n".join("".join(cell["source"]) for cell in cells(notebook, "markdown"))
    links = re.findall(r"\]\(([^)#:]+)[^)]*\)", text)
    assert links and all((TUTORIALS / link).exists() for link in links)


def test_index_lists_every_tutorial():
    text = (TUTORIALS / "index.md").read_text()
    for page in [*TUTORIALS.glob("[!i]*.md"), *NOTEBOOKS]:
        assert f"({page.name})" in text and f"\n{page.stem}\n" in text, page.name
