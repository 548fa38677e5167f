# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Datasets without visible objects warn with the likely reason; `--fail-empty` makes it an error."""

import json
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from batch_jobs import CAMERA, make_frames, make_scene, run

import warpvis as wv
from warpvis.cli import Batch, Render

from support.recorded_warnings import recorded_warnings

ALL_OUTPUTS = ("depth", "points", "normals", "labels", "segmentation")


def away(frames, which):
    """Point the cameras of some frames away from the scene."""
    poses = frames.camera_to_world.copy()
    poses[which] = [wv.look_at(pose[:3], 3 * pose[:3]) for pose in poses[which]]
    return replace(frames, camera_to_world=poses)


def messages(call):
    """Return the warnings and the result of a call."""
    with recorded_warnings() as caught:
        result = call()
    return [str(item.message) for item in caught], result


def plate():
    """Return a part of 305 x 304 x 26 mm that was loaded in meters."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((305, 304, 26)), name="plate")
    return scene


def test_scene_in_millimeters_is_suspected(tmp_path):
    said, summary = messages(lambda: run(tmp_path / "out", scene=plate(), frames=make_frames(12), shard_frames=12))
    # The cameras are 3 m from the origin, inside the plate.
    assert said == [
        "12 of 12 frames see nothing: the scene spans 305 x 304 x 26 m, near is 0.3 m, far is 4.5 m; "
        "are its units millimeters (a scale of 0.001)?"
    ]
    assert summary.empty_frames == summary.frames == 12


@pytest.mark.parametrize(
    ("size", "camera", "hint"),
    [
        (4, CAMERA, "do the cameras point away from it because convention does not match their axes"),
        (0.1, replace(CAMERA, near=2.0), "it is smaller than that: are its units not meters?"),
        (0.5, replace(CAMERA, far=0.5), "near is 0.3 m, far is 0.5 m; the nearest camera is 2.76 m away from it"),
        (0.5, replace(CAMERA, far=np.inf), "near is 0.3 m; do the cameras point away from it"),
    ],
)
def test_other_reasons_for_empty_frames(tmp_path, size, camera, hint):
    scene = wv.Scene()
    scene.add(trimesh.creation.box((size,) * 3), name="box")
    frames = away(make_frames(3), slice(None))
    (said,), _ = messages(lambda: run(tmp_path / "out", scene=scene, frames=frames, camera=camera))
    assert said.startswith("3 of 3 frames see nothing: the scene spans ") and hint in said


@pytest.mark.parametrize("outputs", [*((name,) for name in ALL_OUTPUTS), ("visibility",), ("visibility", "depth")])
def test_empty_frames_are_detected_from_every_output(tmp_path, outputs):
    frames = away(make_frames(12), [0, 3, 4, 5, 11])
    said, summary = messages(lambda: run(tmp_path / "out", frames=frames, outputs=outputs))
    assert said == ["5 of 12 frames see nothing"] and summary.empty_frames == 5
    records = [json.loads(path.read_text()) for path in sorted((tmp_path / "out" / "shards").iterdir())]
    assert [record["empty"] for record in records] == [1, 3, 0, 1]


def test_empty_visibility_of_selected_objects(tmp_path):
    scene = make_scene()
    scene.add(trimesh.creation.box((0.1,) * 3), name="far", pose=(90, 0, 0, 0, 0, 0, 1))
    given = {"scene": scene, "frames": make_frames(3), "outputs": ("visibility",)}
    (said,), _ = messages(lambda: run(tmp_path / "out", objects=["far"], **given))
    assert said.startswith("3 of 3 frames see nothing of the chosen objects: the scene spans 93.1 x 6 x 1.05 m")
    assert messages(lambda: run(tmp_path / "all", **given))[0] == []


def test_frame_with_one_hit_pixel_is_not_empty(tmp_path):
    """The first frame sees a box in its last pixel, the second one nothing, the third one a plate that is too near."""
    scene, ray = wv.Scene(), np.array([31.5 - CAMERA.cx, 23.5 - CAMERA.cy]) / CAMERA.fx
    scene.add(trimesh.creation.box((0.03,) * 3), name="box", pose=(*2 * ray, 2, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((2, 2, 0.01)), name="plate", pose=(90, 0, 0.1, 0, 0, 0, 1))
    frames = wv.Frames.from_poses([(0, 0, 0, 0, 0, 0, 1), (0, 0, 0, 1, 0, 0, 0), (90, 0, 0, 0, 0, 0, 1)])
    said, summary = messages(lambda: run(tmp_path / "out", scene=scene, frames=frames))
    assert said == ["2 of 3 frames see nothing"] and summary.empty_frames == 2
    depth = wv.open_dataset(tmp_path / "out")["depth"][:]
    assert np.argwhere(np.isfinite(depth)).tolist() == [[0, 23, 31]] and np.isneginf(depth[2]).all()


def test_long_job_warns_early(tmp_path):
    said, _ = messages(lambda: run(tmp_path / "out", scene=plate(), frames=make_frames(12), shard_frames=3, threads=1))
    assert len(said) == 2  # another shard may be complete before the first one
    assert re.match(r"so far (3|6|9|12) of \1 frames see nothing: the scene spans 305 x 304 ", said[0])
    assert said[1].startswith("12 of 12 frames see nothing: ")
    frames = away(make_frames(12), slice(3, None))
    assert messages(lambda: run(tmp_path / "some", frames=frames, threads=1))[0] == ["9 of 12 frames see nothing"]


def test_empty_count_covers_the_whole_dataset(tmp_path):
    frames = away(make_frames(12), [0, 1, 2, 9])
    messages(lambda: run(tmp_path / "out", frames=frames))
    for name in ("index.json", "shards/000003.json"):
        (tmp_path / "out" / name).unlink()
    for rendered in (3, 0):
        said, summary = messages(lambda: run(tmp_path / "out", frames=frames, resume=True))
        assert said == ["4 of 12 frames see nothing"]
        assert (summary.rendered_frames, summary.empty_frames) == (rendered, 4)


@pytest.fixture
def workspace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plate().export("plate.glb")
    make_scene().export("scene.glb")
    np.save("poses.npy", make_frames(5).camera_to_world)
    np.save("some.npy", away(make_frames(5), [1]).camera_to_world)
    return tmp_path


@pytest.mark.parametrize("command", [Batch, Render])
def test_command_line_warnings_and_fail_empty(workspace, command, capsys):
    def call(file, out, **options):
        out = workspace / out
        return messages(
            command(file=workspace / file, poses=options.pop("poses", "poses.npy"), out=out, quiet=True, **options).run
        )[0]

    (said, *again) = call("plate.glb", "seen")
    assert said.startswith("5 of 5 frames see nothing") and set(again) <= {said}
    assert call("plate.glb", "mended", scale=0.001, fail_empty=True) == []
    assert set(call("scene.glb", "some", poses="some.npy", fail_empty=True)) == {"1 of 5 frames sees nothing"}
    with warnings.catch_warnings(), pytest.raises(SystemExit) as ended:
        warnings.simplefilter("ignore")
        command(
            file=workspace / "plate.glb", poses="poses.npy", out=workspace / "out", quiet=True, fail_empty=True
        ).run()
    assert ended.value.code == 3


def test_range_finders_that_measure_nothing(workspace):
    robot = """#VRML_SIM R2023b utf8
    Robot { name "robot" children [ RangeFinder { name "%s" maxRange %g } ] }
    Solid { translation 3 0 0 children [ Shape { geometry Box { size 1 1 1 } } ] }"""
    for name, reach in (("blind", 1), ("sees", 9)):
        (workspace / f"{name}.wbt").write_text(robot % (name, reach))
    said, _ = messages(Render(file=workspace / "blind.wbt", out=workspace / "a", quiet=True).run)
    assert said == ["1 of 1 device sees nothing in its range: 'blind'"]
    sees = Render(file=workspace / "sees.wbt", out=workspace / "b", quiet=True, fail_empty=True)
    assert messages(sees.run)[0] == []
    for exact in (False, True):
        command = Render(
            file=workspace / "blind.wbt",
            out=workspace / f"c{exact}",
            quiet=True,
            fail_empty=True,
            version_exact=exact,
        )
        with pytest.raises(SystemExit) as ended:
            messages(command.run)
        assert ended.value.code == 3


def test_zero_frames_raise(tmp_path):
    with pytest.raises(wv.WarpvisError, match="there must be at least one frame to render, got none"):
        wv.render_batch(make_scene(), CAMERA, make_frames(3)[:0], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_images_larger_than_memory_raise(tmp_path):
    camera = wv.Camera(10**7, 10**7, 1e6, 1e6, 5e6, 5e6)
    with pytest.raises(wv.WarpvisError, match=r"images of shape \(1, 10000000, 10000000\) need 400000.0 GB"):
        wv.render_batch(make_scene(), camera, make_frames(3), tmp_path / "out")


def test_invalid_number_of_workers_raises(tmp_path):
    """The error is raised before Ray starts."""
    with pytest.raises(wv.WarpvisError, match="workers must be a whole number from 1 up, got inf"):
        run(tmp_path / "out", engine="ray", workers=np.inf, threads=None)
