# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pages on coming from other tools: warpvis code prints what they show; the other tool's code runs where installed."""

import importlib
import re
from pathlib import Path

import docs_preludes as preludes
import pytest

PAGES = Path(__file__).parent.parent / "docs" / "coming_from"

# First line of a fence with the other tool's code; it must contain `NOT_RUN` if no test runs it.
THEIRS = {
    "mujoco_renderer": "# MuJoCo",
    "open3d": "# Open3D",
    "trimesh_ray": "# trimesh",
    "isaac_lab": "# Isaac Lab",
    "blenderproc": "# BlenderProc",
    "bop": "# BOP toolkit",
    "molmospaces": "# MolmoSpaces",
    "webots": "# Webots",
}
NOT_RUN = "not run by the tests"
PYTHON_FENCE = re.compile(r"^```(python|text)\n(.*?)^```", re.DOTALL | re.MULTILINE)


def run(name, folder, capsys, *, theirs):
    """Run a page's code, with or without the other tool's fences, and compare the output with the text fences."""
    names = preludes.prepare(name, folder)
    printed, skipped = "", False
    for number, (language, code) in enumerate(PYTHON_FENCE.findall((PAGES / f"{name}.md").read_text())):
        if language == "python":
            skipped = code.startswith(THEIRS[name]) and not theirs
            if not skipped:
                exec(compile(code, f"{name}, fence {number}", "exec"), names)
            printed = capsys.readouterr().out
        elif not skipped:
            assert printed == code, f"{name}, fence {number}"


def can_import(library):
    """Return whether a library can be imported: Open3D needs libusb, which some machines lack."""
    try:
        importlib.import_module(library)
    except ImportError:
        return False
    return True


@pytest.mark.parametrize("name", THEIRS)
def test_warpvis_code_runs(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run(name, tmp_path, capsys, theirs=False)


@pytest.mark.parametrize("name", [pytest.param("mujoco_renderer", marks=pytest.mark.gl), "trimesh_ray", "open3d"])
def test_other_tools_code_agrees(name, tmp_path, monkeypatch, capsys):
    if name == "open3d" and not can_import("open3d"):
        pytest.skip("Open3D is not installed, or a library that it needs is not")
    monkeypatch.chdir(tmp_path)
    run(name, tmp_path, capsys, theirs=True)


@pytest.mark.parametrize("name", ["isaac_lab", "blenderproc", "bop", "webots"])
def test_fences_that_are_not_run_are_marked(name):
    fences = [
        code for language, code in PYTHON_FENCE.findall((PAGES / f"{name}.md").read_text()) if language == "python"
    ]
    theirs = [code.splitlines()[0] for code in fences if code.startswith(THEIRS[name])]
    assert theirs and all(NOT_RUN in line for line in theirs)
    assert len(theirs) < len(fences)


def test_every_page_is_indexed_and_has_sources():
    pages = {page.stem for page in PAGES.glob("*.md")} - {"index"}
    assert pages == set(THEIRS)
    index = (PAGES / "index.md").read_text()
    for name in pages:
        text = (PAGES / f"{name}.md").read_text()
        assert f"({name}.md)" in index and f"\n{name}\n" in index
        assert "## What differs" in text and re.search(r"^Sources: .*https://", text, re.DOTALL | re.MULTILINE)
