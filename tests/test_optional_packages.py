# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The package without the dependencies of its extras `cli` and `viz`."""

import sys

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import __main__
from warpvis.batch import _render_batch


def test_command_line_without_tyro_names_its_extra(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("warpvis.cli")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr(wv, "cli", raising=False)
    monkeypatch.setitem(sys.modules, "tyro", None)
    with pytest.raises(SystemExit, match=r"^error: the command line needs tyro.*pip install 'warpvis\[cli\]'$"):
        __main__._import_command_line()


def test_pictures_without_matplotlib_name_their_extra(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    floor = wv.floor_map(np.zeros((1, 2, 2, 3)), np.ones((1, 2, 2), np.uint8), bounds=((-1, -1, -1), (1, 1, 1)))
    for save in (
        lambda: wv.viz.save_map(floor, tmp_path / "map.png"),
        lambda: wv.viz.depth_colors(np.ones((2, 2)), (0.5, 2)),
    ):
        with pytest.raises(wv.WarpvisError, match=r"matplotlib, which is missing: pip install 'warpvis\[viz\]'"):
            save()


def test_batches_without_tqdm_have_no_progress_bar(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "tqdm", None)
    monkeypatch.setattr(_render_batch.sys.stderr, "isatty", lambda: True)
    poses = np.array([(0, 0, 0, 0, 0, 0, 1)] * 3, np.float32)
    scene = wv.Scene()
    scene.add(trimesh.creation.icosphere(radius=0.3), name="ball", pose=(2, 0, 0, 0, 0, 0, 1))
    dataset = wv.render_batch(scene, wv.Camera.from_fov(32, 24, hfov=1.0), poses, tmp_path / "data")
    assert dataset.frames == 3
    assert "frames/s" not in capsys.readouterr().err
