# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Datasets of depth-camera models: files depend only on the seed and the frame numbers."""

import dataclasses
import json
import shutil

import numpy as np
import pytest
from batch_jobs import CAMERA, make_frames, make_poses, make_scene, run, tree
from command_line import run_inside
from PIL import Image

import warpvis as wv
from warpvis.batch import FrameRenderer, _render_batch, find_format, make_plan
from warpvis.cameras.frames import Frames
from warpvis.errors import CameraError, FileFormatError
from warpvis.sensors import Reason, sensor_by_name, sensor_from_fields, sensor_to_fields

OUTPUTS = ("depth", "reasons", "true_depth", "segmentation")
STEREO = wv.sensors.StereoDepth(0.05, sigma=0.2, noise_spacing=2, subpixel=8, dropout=0.1, reflectivity={"box": 0.5})
FLIGHT = wv.sensors.TimeOfFlight((80e6, 60e6), signal=1e4, min_coherence=0.9)
SENSED = {"outputs": OUTPUTS, "sensor": STEREO, "seed": 5}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    out = tmp_path_factory.mktemp("whole") / "data"
    run(out, **SENSED)
    return out


def read(out, name):
    return np.concatenate([np.load(path)[name] for path in sorted(out.glob("shard-*.npz"))])


@pytest.mark.parametrize("sensor", [STEREO, FLIGHT], ids=["stereo", "time of flight"])
def test_noise_depends_on_the_frame_number(tmp_path, sensor, device):
    """Noise does not depend on the shard: a single frame and any group of frames have the same images."""
    run(tmp_path / "a", outputs=OUTPUTS, sensor=sensor, seed=5, shard_frames=3, device=device)
    run(tmp_path / "b", outputs=OUTPUTS, sensor=sensor, seed=5, shard_frames=20, device=device)
    renderer = wv.Renderer(make_scene().to(device), CAMERA, outputs=OUTPUTS, sensor=sensor, seed=5)
    poses = make_poses(20)
    alone = [renderer.render(poses[k], frame=k, view_index=[0]) for k in (0, 7, 19)]
    for name in OUTPUTS:
        found = read(tmp_path / "a", name)
        np.testing.assert_array_equal(found, read(tmp_path / "b", name))
        for frame, views in zip((0, 7, 19), alone, strict=True):
            np.testing.assert_array_equal(found[frame], getattr(views, name).numpy()[0])
    depth, true = read(tmp_path / "a", "depth"), read(tmp_path / "a", "true_depth")
    assert np.isnan(depth).any() and (depth != true)[np.isfinite(depth)].mean() > 0.5


def test_frames_of_equal_pose_have_different_noise(tmp_path):
    run(tmp_path / "out", frames=Frames.from_poses(make_poses(1).repeat(2, axis=0)), sensor=STEREO)
    first, second = read(tmp_path / "out", "depth")
    seen = np.isfinite(first) & np.isfinite(second)
    assert (first != second)[seen].mean() > 0.5


def test_resumed_dataset_is_the_same(tmp_path, whole):
    out = tmp_path / "out"
    shutil.copytree(whole, out)
    for shard in (1, 4):
        (out / f"shards/{shard:06d}.json").unlink()
        (out / f"shard-{shard:06d}.npz").unlink()
    assert run(out, resume=True, **SENSED).rendered_frames == 6
    assert tree(out) == tree(whole)


@pytest.mark.slow  # it starts two processes
def test_several_processes_write_the_same(tmp_path, whole, monkeypatch):
    """Simulates several GPUs: each process renders the shards that it takes."""
    monkeypatch.setattr(_render_batch, "parse_devices", lambda device: ["cpu", "cpu"])
    run(tmp_path / "out", **SENSED)
    assert tree(tmp_path / "out") == tree(whole)


def test_shards_do_not_depend_on_the_worker(whole):
    """Each worker has its renderer and renders its shards in any order."""
    scene = make_scene()
    plan = make_plan(scene, CAMERA, make_frames(), find_format("npz"), shard_frames=3, **SENSED)
    for shards in ([6, 0, 4], [5, 3, 2, 1]):
        renderer = FrameRenderer(scene, CAMERA, outputs=plan.outputs, sensor=plan.sensor, seed=plan.sensor_seed)
        for shard in shards:
            numbers = np.arange(len(plan.frames))[plan.shard_slice(shard)]
            found = renderer({"camera_to_world": plan.frames.camera_to_world[numbers], "frame": numbers})
            with np.load(whole / f"shard-{shard:06d}.npz") as kept:
                for name in OUTPUTS:
                    np.testing.assert_array_equal(found[name], kept[name])


def test_resuming_with_another_sensor_or_seed_raises(tmp_path, whole):
    shutil.copytree(whole, tmp_path / "out")
    (tmp_path / "out/shards/000001.json").unlink()
    for change, said in (
        ({"seed": 6}, "sensor_seed was 5 and is 6"),
        ({"sensor": dataclasses.replace(STEREO, sigma=0.3)}, "sensor's sigma was 0.2 and is 0.3"),
    ):
        with pytest.raises(FileFormatError, match=said):
            run(tmp_path / "out", resume=True, **{**SENSED, **change})


def test_dataset_stores_its_sensor(whole):
    dataset = wv.open_dataset(whole)
    assert dataset.sensor == STEREO
    assert dataset.outputs == OUTPUTS
    assert dataset[3]["reasons"].dtype == np.uint8
    manifest = json.loads((whole / "manifest.json").read_text())
    assert manifest["sensor"]["model"] == "StereoDepth" and manifest["sensor_seed"] == 5
    assert json.loads(str(np.load(whole / "shard-000000.npz")["sensor"])) == manifest["sensor"]


def test_invalid_sensor_in_the_manifest_raises(tmp_path, whole):
    for wrong in (7, {"model": "StereoDepth", "baseline": "wide"}, {"model": 3}, {"model": "StereoDepth", "lens": 1}):
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        shutil.copytree(whole, tmp_path / "out")
        manifest = json.loads((whole / "manifest.json").read_text()) | {"sensor": wrong}
        (tmp_path / "out/manifest.json").write_text(json.dumps(manifest))
        dataset = wv.open_dataset(tmp_path / "out")
        with pytest.raises(FileFormatError, match="has an invalid sensor"):
            dataset.sensor  # noqa: B018


@pytest.mark.parametrize("name", ["d435@64x48", "kinect-v1", "azure-kinect-wide", "flexx2"])
def test_sensors_round_trip_through_fields(name):
    sensor = sensor_by_name(name)
    for model in (sensor, wv.sensors.Corruptions(dropout=0.1, rectangles=(1, 2), of=sensor)):
        assert sensor_from_fields(json.loads(json.dumps(sensor_to_fields(model), allow_nan=False))) == model
    theirs = {"model": "theirs.Sensor", "sigma": 1.0}
    assert sensor_from_fields(theirs) is None
    assert sensor_from_fields({"model": "Corruptions", "dropout": 0.1, "of": theirs}) is None  # no exact depth either


def test_zarr_and_png_contain_reasons(tmp_path, whole):
    zarr = pytest.importorskip("zarr")
    npz = wv.open_dataset(whole)
    run(tmp_path / "zarr", format="zarr", **SENSED)
    held = wv.open_dataset(tmp_path / "zarr")
    for name in OUTPUTS:
        np.testing.assert_array_equal(held[name][:], npz[name][:])
    group = zarr.open_group(tmp_path / "zarr/data.zarr", mode="r")
    assert group.attrs["reasons"]["SHADOW"] == Reason.SHADOW and group.attrs["sensor"]["sigma"] == 0.2
    np.testing.assert_array_equal(group["reasons"][5], npz["reasons"][5])

    run(tmp_path / "png", format="png", **SENSED)
    held = wv.open_dataset(tmp_path / "png")
    np.testing.assert_array_equal(held["reasons"][:], npz["reasons"][:])
    true = npz["true_depth"][:]
    np.testing.assert_allclose(held["true_depth"][:], true, atol=0.000501)
    meaning = json.loads((tmp_path / "png/images.json").read_text())
    assert meaning["reasons"]["values"]["7"] == "DROPOUT"
    with Image.open(tmp_path / "png/depth/000000/000000.png") as picture:
        units = np.asarray(picture)
    lost = ~np.isfinite(npz["depth"][0])
    assert lost.any() and (units[lost] == 0).all() and (units[~lost] > 0).all()


@pytest.mark.smoke("bop", "tum")
@pytest.mark.parametrize("format", ["tum", "bop", "nerfstudio", "colmap"])
def test_lost_pixels_in_each_format(tmp_path, whole, format):
    """Lost pixels are 0 in the files and +inf when read back; none is counted as out of range."""
    kept = wv.open_dataset(whole)["depth"][:]
    usual = {"bop": ("depth", "visibility"), "nerfstudio": ("depth", "color")}.get(format, ("depth",))
    summary = run(tmp_path / "out", format=format, sensor=STEREO, seed=5, outputs=usual)
    assert not summary.warnings
    depth = wv.open_dataset(tmp_path / "out")["depth"][:]
    np.testing.assert_array_equal(np.isfinite(depth), np.isfinite(kept))
    assert (depth[~np.isfinite(kept)] == np.inf).all()
    with pytest.raises(wv.WarpvisError, match=f"for format {format!r}, got 'reasons'"):
        run(tmp_path / "other", format=format, sensor=STEREO, outputs=(*usual, "reasons"))


def test_ros_depth_follows_rep_117(tmp_path, whole):
    pytest.importorskip("rosbags")
    run(tmp_path / "out", format="ros2", sensor=STEREO, seed=5, outputs=("depth",))
    np.testing.assert_array_equal(wv.open_dataset(tmp_path / "out")["depth"][:], wv.open_dataset(whole)["depth"][:])


def test_batches_require_frame_numbers(device):
    renderer = FrameRenderer(make_scene().to(device), CAMERA, outputs=OUTPUTS, sensor=STEREO, seed=5)
    poses = make_poses(6)
    together = renderer({"camera_to_world": poses, "frame": np.arange(6)})
    last = renderer({"camera_to_world": poses[4:], "frame": [4, 5]})
    np.testing.assert_array_equal(last["depth"], together["depth"][4:])
    with pytest.raises(wv.WarpvisError, match="batch must contain frame"):
        renderer({"camera_to_world": poses})


def test_named_sensor_provides_its_camera(tmp_path):
    sensor = sensor_by_name("d435@64x48")
    assert sensor == wv.sensors.realsense_d435(64, 48)
    run(tmp_path / "out", camera=None, sensor=sensor, outputs=("reasons",))
    assert wv.open_dataset(tmp_path / "out").camera == sensor.camera()
    with pytest.raises(CameraError, match="the sensor has no native_camera"):
        run(tmp_path / "other", camera=None, sensor=STEREO)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("d345", "there is no sensor 'd345'; did you mean d4"),
        ("realsens_d455", "did you mean d455"),
        ("webcam", "there are d405, d415, d435"),
        ("d435@big", "a size must be given as in d435@424x240"),
        ("kinect-v2@64x48", "kinect-v2 has a fixed size"),
    ],
)
def test_unknown_sensor_names_raise_with_suggestions(name, said):
    with pytest.raises(CameraError, match=said):
        sensor_by_name(name)


def test_invalid_arguments_raise(tmp_path):
    lens = wv.Camera.from_opencv(np.array([[300.0, 0, 16], [0, 300, 12], [0, 0, 1]]), (-0.2, 0.05, 0, 0), 32, 24)
    for change, said in (
        ({"outputs": ("depth", "reasons")}, "outputs must not contain reasons without a sensor"),
        ({"sensor": "d435"}, "sensor must be a model of"),
        ({"sensor": STEREO, "seed": -1}, "seed must be"),
        ({"sensor": STEREO, "camera": lens}, "camera of StereoDepth must be a warpvis.Camera"),
        ({"sensor": wv.sensors.StereoDepth(0.05, reflectivity={"sofa": 0.1})}, "sofa"),
    ):
        with pytest.raises(wv.WarpvisError, match=said):
            run(tmp_path / "out", **change)
        assert not (tmp_path / "out").exists()


def test_command_line(tmp_path):
    import trimesh

    trimesh.creation.box((0.5, 1.0, 0.5)).export(tmp_path / "box.stl")
    np.save(tmp_path / "poses.npy", make_poses(4))
    words = ["box.stl", "--poses", "poses.npy", "--sensor", "d435@64x48", "--sensor-seed", "7", "--quiet"]
    seen = ["--outputs", "depth,reasons"]
    for command, out, more in (("render", "look", []), ("batch", "data", ["--shard-frames", "3"])):
        done = run_inside(command, *words, *seen, "--out", out, *more, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    rendered, batched = wv.open_dataset(tmp_path / "look/npz"), wv.open_dataset(tmp_path / "data")
    np.testing.assert_array_equal(rendered["depth"][:], batched["depth"][:])
    assert batched.camera == batched.sensor.camera() == wv.sensors.realsense_d435(64, 48).camera()
    direct = wv.Scene.load(tmp_path / "box.stl")
    views = wv.render(direct, batched.camera, make_poses(4)[2], sensor=batched.sensor, seed=7, frame=2)
    np.testing.assert_array_equal(batched["depth"][2], views.depth.numpy()[0])
    varied = ["--sensor-vary", "sigma=0.05:0.2", "noise_spacing=1:4"]
    done = run_inside("batch", *words, *seen, "--out", "varied", *varied, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    varied = wv.open_dataset(tmp_path / "varied")
    own = varied.sensor.drawn(seed=7, frame=2)
    assert varied.sensor.ranges == {"sigma": (0.05, 0.2), "noise_spacing": (1, 4)} and own != batched.sensor
    views = wv.render(direct, varied.camera, make_poses(4)[2], sensor=own, seed=7, frame=2)
    np.testing.assert_array_equal(varied["depth"][2], views.depth.numpy()[0])
    for wrong, said in (
        (["--sensor", "d345"], "there is no sensor 'd345'; did you mean d4"),
        (["--sensor-seed", "3"], "without --sensor, give no --sensor-seed"),
        (["--sensor-vary", "sigma=0:1"], "without --sensor, give no --sensor-vary"),
        (["--sensor", "d435", "--sensor-vary", "sigma=0.1"], "NAME=MIN:MAX once, as in sigma=0.05:0.15, got"),
        (["--sensor", "d435", "--sensor-vary", "color=0:1"], "StereoDepth has no parameter 'color'"),
        (["--sensor", "d435", "--lidar", "vlp16"], "with --lidar no camera is rendered: give no --sensor"),
    ):
        done = run_inside("render", "box.stl", "--poses", "poses.npy", *wrong, "--out", "no", cwd=tmp_path)
        assert done.returncode == 2 and said in done.stderr, done.stderr
