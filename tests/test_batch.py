# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Batch rendering: images equal the renderer's, and a resumed job writes the same bytes as an uninterrupted one."""

import json
import os
import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from batch_jobs import CAMERA, FORMATS, make_frames, make_poses, make_scene, run, tree

import warpvis as wv
from warpvis.batch import FrameRenderer, verify
from warpvis.batch.engines import _local as local
from warpvis.cameras.frames import Frames

TESTS = Path(__file__).parent
OUTPUTS = ("depth", "points", "normals", "labels", "segmentation", "faces")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return an uninterrupted dataset."""
    out = tmp_path_factory.mktemp("whole") / "data"
    run(out)
    return out


def describe_scene(folder, scene):
    """Return the description of a scene in the manifest of a dataset that is written to an empty folder."""
    run(folder, scene=scene, frames=make_frames(1))
    return json.loads((folder / "manifest.json").read_text())["scene"]


def read_npz(out, name):
    return np.concatenate([np.load(path)[name] for path in sorted(Path(out).glob("shard-*.npz"))])


def test_images_equal_the_renderers(tmp_path, device):
    summary = run(tmp_path / "out", outputs=OUTPUTS, device=device)
    views = wv.render(make_scene().to(device), CAMERA, make_poses(20), outputs=OUTPUTS)
    for name in OUTPUTS:
        np.testing.assert_array_equal(read_npz(tmp_path / "out", name), getattr(views, name).numpy())
    np.testing.assert_array_equal(read_npz(tmp_path / "out", "camera_to_world"), make_frames().camera_to_world)
    assert (summary.frames, summary.shards, summary.rendered_frames) == (20, 7, 20)
    assert summary.bytes == sum(path.stat().st_size for path in (tmp_path / "out").glob("*.npz")) - _poses(tmp_path)
    assert summary.frames_per_second > 0
    assert verify(tmp_path / "out").ok


def _poses(folder):
    return (folder / "out" / "poses.npz").stat().st_size


def test_visibility_equals_object_visibility(tmp_path, device):
    run(tmp_path / "out", outputs=("visibility",), objects=["ball", "box"], device=device)
    seen = wv.object_visibility(make_scene().to(device), CAMERA, make_poses(20), objects=["ball", "box"])
    np.testing.assert_array_equal(read_npz(tmp_path / "out", "visible_fraction"), seen.fraction.numpy())
    np.testing.assert_array_equal(read_npz(tmp_path / "out", "visible_box"), seen.visible_box.numpy())


@pytest.mark.parametrize("excluded", [["ball"], [2]])
def test_excluded_objects_are_not_rendered(tmp_path, excluded):
    run(tmp_path / "out", outputs=("segmentation",), exclude=excluded)
    objects = read_npz(tmp_path / "out", "segmentation")
    assert set(np.unique(objects)) == {-1, 0, 1}


def moving_frames(*, world=None):
    poses = np.tile([-0.5, 0.3, 0.5, 0, 0, 0, 1], (20, 1, 1))
    poses[:, 0, 2] += np.linspace(0, 1, 20)
    poses = poses if world is None else poses[:4]
    return Frames.from_poses(make_poses(20), object_poses=poses, world_index=world)


@pytest.mark.parametrize("world", [None, np.arange(20) % 4])
def test_each_frame_uses_its_world(tmp_path, world):
    scene, frames = make_scene(movable=True), moving_frames(world=world)
    run(tmp_path / "out", scene=scene, frames=frames)
    expected = wv.render(
        scene, CAMERA, make_poses(20), outputs=("depth",), object_poses=frames.object_poses, world_index=world
    )
    np.testing.assert_array_equal(read_npz(tmp_path / "out", "depth"), expected.depth.numpy())
    still = wv.render(scene, CAMERA, make_poses(20), outputs=("depth",)).depth.numpy()
    assert (read_npz(tmp_path / "out", "depth") != still).any()


def test_movable_objects_default_to_their_initial_pose(tmp_path):
    run(tmp_path / "out", scene=make_scene(movable=True))
    expected = wv.render(make_scene(), CAMERA, make_poses(20), outputs=("segmentation",)).segmentation.numpy()
    poses = np.load(tmp_path / "out" / "poses.npz")
    np.testing.assert_allclose(poses["object_poses"], [[[-0.5, 0.3, 0.5, 0, 0, 0, 1]]], atol=1e-7)
    assert (np.isfinite(read_npz(tmp_path / "out", "depth")) == (expected >= 0)).mean() > 0.99


def test_frame_renderer():
    renderer = FrameRenderer(make_scene, CAMERA, outputs=("depth", "visibility"), objects=["ball"], masks=True)
    batch = renderer({"camera_to_world": make_poses(4), "number": np.arange(4)})
    assert batch["number"].tolist() == [0, 1, 2, 3]
    assert batch["depth"].shape == (4, 24, 32) and batch["depth"].dtype == np.float32
    assert batch["masks"].shape == (4, 1, 24, 32) and batch["visible_box"].shape == (4, 1, 4)
    again = renderer({"camera_to_world": make_poses(2)})
    np.testing.assert_array_equal(again["depth"], wv.render(make_scene(), CAMERA, make_poses(2)).depth.numpy())
    with pytest.raises(wv.errors.ArrayError, match="batch must contain camera_to_world, got poses"):
        renderer({"poses": make_poses(2)})
    with pytest.raises(wv.errors.ArrayError, match=r"outputs must be some of depth, .*visibility, got tint"):
        FrameRenderer(make_scene(), CAMERA, outputs=("tint",))


def test_scenes_can_be_pickled(tmp_path):
    scene = make_scene(movable=True)
    scene.add(trimesh.creation.box(), name="hat", attach_to="ball")
    scene.add(wv.scene.solids.sphere(0.2), name="bead", movable=True, pose=(0, 1, 1, 0, 0, 0, 1))
    scene.bvh()
    copy = pickle.loads(pickle.dumps(scene))
    stored = [describe_scene(tmp_path / f"{k}", each) for k, each in enumerate((scene, copy, scene.to("cpu")))]
    assert stored[0] == stored[1] == stored[2]
    assert (copy.up, copy.movable, copy.index("hat")) == (scene.up, scene.movable, scene.index("hat"))
    for name in ("depth", "segmentation"):
        a, b = (getattr(wv.render(each, CAMERA, make_poses(3)), name).numpy() for each in (scene, copy))
        np.testing.assert_array_equal(a, b)


def test_scene_hash_covers_all_visible_properties(tmp_path):
    scenes = [make_scene(), make_scene(movable=True)]
    for change in ({"label": "human"}, {"name": "sphere"}, {"pose": (0, 0, 0.1, 0, 0, 0, 1)}, {"scale": 1.01}):
        scene = wv.Scene()
        scene.add(trimesh.creation.box(), **{"name": "box", **change})
        scenes.append(scene)
    hashes = {describe_scene(tmp_path / f"{k}", scene)["sha256"] for k, scene in enumerate(scenes)}
    assert len(hashes) == 6


def test_bytes_do_not_depend_on_threads_or_time(tmp_path, whole):
    run(tmp_path / "out", threads=1)
    assert tree(tmp_path / "out") == tree(whole)


NEEDS = {"zarr": "zarr", "ros2": "rosbags"}


@pytest.mark.smoke("npz", "bop", "png", "zarr", "ply", "tum")
@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_complete_and_reproducible(tmp_path, name):
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    scene = make_scene(movable=True)
    summary = run(tmp_path / "a", scene=scene, format=name)
    report = verify(tmp_path / "a")
    assert report.ok, report.problems
    assert (report.format, report.frames, report.whole_shards) == (name, 20, 7)
    assert summary.bytes > 0
    run(tmp_path / "b", scene=scene, format=name, threads=1)
    shutil.rmtree(tmp_path / "b" / "shards")
    (tmp_path / "b" / "index.json").unlink()
    run(tmp_path / "b", scene=scene, format=name, resume=True)
    assert tree(tmp_path / "a") == tree(tmp_path / "b")


@pytest.mark.slow
def test_several_device_processes(tmp_path, monkeypatch, whole):
    """Simulate several GPUs by using the CPU twice."""
    monkeypatch.setattr("warpvis.batch._render_batch.parse_devices", lambda device: ["cpu", "cpu"])
    run(tmp_path / "out", device="cpu")
    assert tree(tmp_path / "out") == tree(whole)

    shutil.rmtree(tmp_path / "out" / "shards")
    (tmp_path / "out" / "shards").write_text("in the way")
    with pytest.raises(wv.errors.FileFormatError, match=r"out: cannot be written: .*; 0 of 7 shards are complete"):
        run(tmp_path / "out", device="cpu", resume=True)

    monkeypatch.setattr(local, "_work", die_soon)
    with pytest.raises(
        wv.WarpvisError, match=r"the process for cpu ended with exit code 7; 0 of 7 shards are complete"
    ):
        run(tmp_path / "other", device="cpu")


def die_soon(connection, *others):
    os._exit(7)


def test_several_gpus_and_resume_on_cuda(tmp_path, cuda):
    """One GPU, all GPUs, and a resumed job write the same bytes."""
    given = {"scene": make_scene(movable=True), "outputs": (*OUTPUTS, "visibility")}
    run(tmp_path / "one", device="cuda:0", **given)
    run(tmp_path / "all", device="cuda:all", **given)
    assert tree(tmp_path / "all") == tree(tmp_path / "one")
    for shard in (1, 4):
        (tmp_path / "all" / "shards" / f"00000{shard}.json").unlink()
        (tmp_path / "all" / f"shard-00000{shard}.npz").unlink()
    assert run(tmp_path / "all", device="cuda:all", resume=True, **given).rendered_frames == 6
    assert tree(tmp_path / "all") == tree(tmp_path / "one")


def test_parse_devices():
    assert local.parse_devices("cpu") == ["cpu"]
    assert local.parse_devices("cpu, cpu") == ["cpu"]
    with pytest.raises(wv.errors.ArrayError, match="device 'cuda:99' is not on this machine"):
        local.parse_devices("cpu,cuda:99")


BAD = {
    "format": ({"format": "tiff"}, f"format must be one of {', '.join(FORMATS)}, got 'tiff'"),
    "engine": ({"engine": "spark"}, 'engine must be "local" or "ray", got \'spark\''),
    "output": ({"outputs": ["tint"]}, "outputs must be some of depth, .*, got tint"),
    "no output": ({"outputs": []}, "outputs must be some of .*, got none"),
    "unfit output": (
        {"format": "tum", "outputs": ["labels"]},
        "outputs must be from color, depth for format 'tum', got 'labels'",
    ),
    "option": ({"options": {"speed": 3}}, "format 'npz' has no option 'speed'; its options: none"),
    "shards": ({"shard_frames": 0}, "shard_frames must be a whole number from 1 up, got 0"),
    "object": ({"objects": ["cat"], "outputs": ["visibility"]}, "the scene has no object 'cat'"),
    "empty scene": ({"scene": wv.Scene()}, "the scene has no objects"),
    "no scene": ({"scene": 3}, "scene must be a warpvis.Scene, got int"),
    "no camera": ({"camera": "kinect"}, "camera must be a warpvis.Camera or a warpvis.cameras.LensCamera, got str"),
    "device": ({"device": "cuda:99"}, "device 'cuda:99' is not on this machine"),
    "objects that do not move": (
        {"frames": moving_frames()},
        "frames must have poses of the 0 movable objects of the scene, got 1",
    ),
    "threads": ({"threads": 0}, "threads must be a whole number from 1 up"),
}


@pytest.mark.parametrize("case", BAD)
def test_invalid_arguments_write_nothing(tmp_path, case):
    given, message = BAD[case]
    with pytest.raises(wv.WarpvisError, match=message) as caught:
        run(tmp_path / "out", **given)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_manifest(tmp_path, whole):
    manifest = json.loads((whole / "manifest.json").read_text())
    assert manifest["frames"] == 20 and manifest["seed"] == 3 and manifest["format"] == "npz"
    assert manifest["scene"]["sha256"] == describe_scene(tmp_path / "again", make_scene())["sha256"]
    assert manifest["versions"].keys() == {"warpvis", "warp-lang", "numpy"}
    assert list(manifest["scene"]["objects"]) == ["floor", "box", "ball"]


@pytest.mark.parametrize("source", [np.zeros(2), {"file": "a"}, 3, b"a"])
def test_source_must_be_a_string(tmp_path, source):
    with pytest.raises(wv.WarpvisError, match="source must be a text, got "):
        run(tmp_path / "set", source=source)
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize("caster", [{1, 2}, None, "fast", 3])
def test_invalid_caster_writes_nothing(tmp_path, caster):
    with pytest.raises(wv.WarpvisError, match="caster must be "):
        run(tmp_path / "set", caster=caster)
    assert not (tmp_path / "set").exists()
