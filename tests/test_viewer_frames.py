# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of frames on the live page, from pose files and datasets, and of their recordings for Rerun."""

import sys
from collections import Counter
from unittest import mock

import numpy as np
import pytest
import trimesh
from command_line import run_inside

import warpvis as wv
from warpvis.cli import View
from warpvis.viewer import Viewer, ViewerState, save_rerun

PORT = 8461
WALK = np.array([wv.look_at((-1.5, y, 0.8), (1, 0, 0.2)) for y in (-0.5, 0.0, 0.5)])


def room():
    scene = wv.Scene()
    scene.add(trimesh.creation.box((4, 4, 0.02)), name="floor", label="ground", pose=(0, 0, -0.01, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.2, 0.2, 0.2)), name="box", movable=True, pose=(1, 0, 0.1, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(radius=0.1), name="ball", label="object", pose=(1, 0.5, 0.1, 0, 0, 0, 1))
    return scene


def moved(count=3):
    rows = np.tile(np.array([1, 0, 0.1, 0, 0, 0, 1], dtype=np.float32), (count, 1, 1))
    rows[:, 0, 1] = np.linspace(0, 0.4, count)
    return rows


def state_of(frames):
    return ViewerState(room(), [wv.Agent.kinect("robot", WALK[0])], frames=frames, points=500)


def test_frame_places_camera_and_movable_objects():
    frames = wv.Frames.from_poses(WALK, object_poses=moved())
    state = state_of(frames)
    for number in (2, 0, 1):
        state.show_frame(number)
        snapshot = state.snapshot()
        np.testing.assert_allclose(snapshot.agents[0].poses[0], WALK[number], atol=1e-9)
        # The ball may be dragged too, so the box is not the only movable object here.
        np.testing.assert_allclose(state.object_pose("box"), moved()[number, 0], atol=1e-6)
        seen = wv.object_visibility(room(), wv.Camera.kinect(), WALK[number], object_poses=moved()[number])
        row = next(row for row in snapshot.rows if row.name == "box")
        assert row.fractions[0] == pytest.approx(seen.fraction.numpy()[0, 1], abs=0.01)


def test_world_index_selects_object_poses():
    frames = wv.Frames.from_poses(WALK, object_poses=moved(2), world_index=[1, 0, 1])
    state = state_of(frames)
    state.show_frame(2)
    np.testing.assert_allclose(state.object_pose("box"), moved(2)[1, 0], atol=1e-6)


def test_dataset_plays_from_the_command_line(tmp_path):
    room().export(tmp_path / "room.glb")
    scene = wv.Scene.load(tmp_path / "room.glb")
    wv.render_batch(scene, wv.Camera.from_fov(16, 12, hfov=1.0), wv.Frames.from_poses(WALK), tmp_path / "set")
    state = View(file=tmp_path / "room.glb", poses=str(tmp_path / "set")).load()
    assert len(state.frames) == 3
    with Viewer(state, port=PORT) as viewer:
        viewer.page.act(lambda: state.show_frame(2))
        viewer.update()
        np.testing.assert_allclose(viewer.page.gizmos.agents["robot"].position, WALK[2, :3], atol=1e-6)
        assert viewer.page.panel.sliders["frame"].max == 2
    spec = View(file=tmp_path / "room.glb", poses="orbit target=0,0,0.5 radius=1.5 height=1 count=5").load()
    assert len(spec.frames) == 5


def test_rerun_recording_has_every_frame(tmp_path):
    from rerun.chunk import RrdReader

    state = state_of(wv.Frames.from_poses(WALK, object_poses=moved()))
    state.show_frame(1)
    save_rerun(state, tmp_path / "walk.rrd")
    assert state.frame == 1
    chunks = RrdReader(tmp_path / "walk.rrd").stream().to_chunks()
    rows = Counter()
    for chunk in chunks:
        rows[chunk.entity_path] += chunk.num_rows
    wanted = ("world/cloud", "world/agents/0", "images/robot", "table")
    assert [rows[f"/{entity}"] for entity in wanted] == [3, 3, 3, 3]
    assert rows["/world/objects/1"] == 4  # its mesh once, and its pose per frame


def test_command_writes_a_recording(tmp_path):
    result = run_inside("view", "experiment_3", "--rerun", "three.rrd", cwd=tmp_path)
    assert result.returncode == 0 and result.stdout == "three.rrd\n", result.stderr
    assert (tmp_path / "three.rrd").read_bytes()[:4] in (b"RRF2", b"RRF3")


def test_invalid_input_raises(tmp_path):
    frames = wv.Frames.from_poses(WALK)
    two = np.tile(moved(), (1, 2, 1))
    cases = [
        (lambda: state_of("walk.txt"), "frames must be a non-empty warpvis.Frames, got str"),
        (
            lambda: state_of(wv.Frames.from_poses(WALK, object_poses=two)),
            "frames must have poses of the scene's 1 movable objects, got 2",
        ),
        (lambda: state_of(frames).show_frame(3), "frame must be an index from 0 into 3 frames, got 3"),
        (lambda: state_of(None).show_frame(0), "frame must be an index from 0 into 0 frames, got 0"),
        (lambda: save_rerun(state_of(None), tmp_path / "no" / "a.rrd"), "cannot be written"),
        (lambda: save_rerun(room(), tmp_path / "a.rrd"), "state must be a warpvis.viewer.ViewerState"),
    ]
    for call, words in cases:
        with pytest.raises(wv.WarpvisError, match=words):
            call()
    with mock.patch.dict(sys.modules, {"rerun": None}), pytest.raises(wv.WarpvisError, match=r"warpvis\[rerun\]"):
        save_rerun(state_of(None), tmp_path / "a.rrd")
