# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Datasets are read as they were rendered: in any order, in other processes, and partially."""

import importlib
import json
import multiprocessing
import os
import pickle
import shutil

import numpy as np
import pytest
import trimesh
from batch_jobs import FORMATS

import warpvis as wv
from warpvis.batch import find_format
from warpvis.core.outputs import SENSOR_NAMES

CAMERA = wv.Camera(24, 18, fx=25.0, fy=23.0, cx=11.3, cy=9.1, near=0.5, far=6.0)
FRAMES, SHARD_FRAMES = 7, 3
READ = [name for name in FORMATS if name != "ply"]
BESIDE = {"camera_to_world", "K", "distortion", "timestamp", "frame", "object_poses", "world"}
IMAGES = ("depth", "points", "normals", "labels", "segmentation", "faces", "color", "albedo")
MILLIMETER = 1e-3


def make_scene():
    scene = wv.Scene()
    scene.add(trimesh.creation.box((6, 6, 0.1)), name="floor", label="ground", pose=(0, 0, -0.05, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(subdivisions=2, radius=0.4), name="ball", label="object", movable=True)
    scene.add(trimesh.creation.box((0.4, 0.5, 1.2)), name="box", pose=(-0.6, 0.1, 0.6, 0, 0, 0, 1))
    return scene


def make_frames():
    """Return frames around the scene in two worlds; the last one sees mainly the sky."""
    angles = np.arange(FRAMES) / 2
    poses = [wv.look_at((2.6 * np.cos(a), 2.6 * np.sin(a), 0.6), (0, 0, 0.4)) for a in angles[:-1]]
    poses.append(wv.look_at((3.5, 0.0, 0.4), (0, 0.3, 2.5)))
    ball = np.array([[(x, 0.1, 0.4, 0, 0, 0, 1)] for x in (0.8, 0.3)], dtype=np.float32)
    times = 10.0 + np.arange(FRAMES)
    return wv.Frames.from_poses(poses, timestamps=times, object_poses=ball, world_index=[0, 1, 1, 0, 0, 1, 0])


@pytest.fixture(scope="module")
def rendered():
    """Return images of all frames, and object visibility."""
    frames = make_frames()
    worlds = {"object_poses": frames.object_poses, "world_index": frames.world_index}
    views = wv.render(make_scene(), CAMERA, frames.camera_to_world, outputs=IMAGES, **worlds)
    return {name: getattr(views, name).numpy() for name in IMAGES}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return a function that writes a dataset with all outputs once, and returns its path."""
    root, scene, frames = tmp_path_factory.mktemp("datasets"), make_scene(), make_frames()

    def write(kind, **options):
        out = root / "-".join([kind, *options.values()])
        if not out.exists():
            pytest.importorskip({"zarr": "zarr", "ros2": "rosbags"}.get(kind, "numpy"))
            outputs = sorted(set(find_format(kind).outputs) - set(SENSOR_NAMES))
            wv.render_batch(
                scene, CAMERA, frames, out, format=kind, outputs=outputs, shard_frames=SHARD_FRAMES, options=options
            )
        return out

    return write


def assert_as_rendered(frame, rendered, index):
    """Depth agrees within whole millimeters, or exactly; everything else agrees exactly."""
    no_depth = ~np.isfinite(rendered["depth"][index])
    for name in set(frame) & set(IMAGES):
        got, expected = frame[name], rendered[name][index]
        assert (got.dtype, got.shape) == (expected.dtype, expected.shape)
        assert got.flags.owndata and got.flags.writeable
        if name == "depth":
            assert np.array_equal(~np.isfinite(got), no_depth)
            np.testing.assert_allclose(got[~no_depth], expected[~no_depth], atol=0.501 * MILLIMETER)
        elif name == "normals":
            np.testing.assert_allclose(got, expected, atol=1e-6)
        else:
            assert np.array_equal(got, expected, equal_nan=name == "points")


@pytest.mark.parametrize("kind", READ)
def test_frames_are_read_back(kind, written, rendered):
    dataset, frames = wv.open_dataset(written(kind)), make_frames()
    assert len(dataset) == FRAMES
    assert (dataset.complete, dataset.format, dataset.camera) == (True, kind, CAMERA)
    assert dataset.object_names == ("floor", "ball", "box")
    assert dataset.object_labels == (wv.Label.GROUND, wv.Label.OBJECT, wv.Label.OBSTACLE)
    assert "depth" in dataset.outputs
    for index in (4, 0, 6, 2, 2):
        frame = dataset[index]
        assert set(frame) == set(dataset.outputs) | BESIDE
        assert_as_rendered(frame, rendered, index)
        assert np.array_equal(frame["camera_to_world"], frames.camera_to_world[index])
        assert np.array_equal(frame["K"], CAMERA.to_K())
        assert (frame["timestamp"], frame["frame"], frame["world"]) == (10.0 + index, index, frames.world_index[index])
        assert np.array_equal(frame["object_poses"], frames.object_poses[frames.world_index[index]])
        assert not frame["distortion"].any()


@pytest.mark.parametrize("kind", ["npz", "zarr"])
def test_raw_arrays_are_bit_identical(kind, written, rendered):
    dataset = wv.open_dataset(written(kind))
    visibility = ("visible_fraction", "visible_pixels", "image_pixels", "silhouette_pixels", "too_near_pixels")
    visibility += ("too_far_pixels", "status", "occluder", "visible_box", "silhouette_box")
    assert set(dataset.outputs) == {*IMAGES, *visibility}
    for name in IMAGES:
        assert np.asarray(dataset[name]).tobytes() == rendered[name].tobytes()
    assert dataset["visible_fraction"].shape == (FRAMES, len(dataset.visibility_objects))
    assert 0 < dataset["visible_fraction"][:].max() <= 1
    both = [wv.open_dataset(written(one))["status"][:] for one in ("npz", "zarr")]
    assert np.array_equal(*both)


def test_bop_object_visibility(written):
    dataset, raw = wv.open_dataset(written("bop")), wv.open_dataset(written("npz"))
    column = raw.visibility_objects.index("ball")
    assert dataset.visibility_objects == ("ball",)
    for index, frame in enumerate(dataset):
        assert frame["silhouette_pixels"][0] >= raw["image_pixels"][index][column]
        assert frame["visible_fraction"][0] == pytest.approx(
            frame["visible_pixels"][0] / max(1, frame["silhouette_pixels"][0])
        )
    assert dataset["visible_pixels"][:].max() > 10


def test_compressed_zarr_is_read(written, rendered):
    dataset = wv.open_dataset(written("zarr", compression="zstd"))
    assert dataset["depth"][:].tobytes() == rendered["depth"].tobytes()
    assert np.array_equal(dataset[[5, 1]]["labels"], rendered["labels"][[5, 1]])


@pytest.mark.parametrize("kind", ["npz", "png"])
def test_indexing_by_slices_numbers_and_names(kind, written, rendered):
    dataset, frames = wv.open_dataset(written(kind), outputs=["depth", "labels"]), make_frames()
    assert dataset.outputs == ("depth", "labels")
    part = dataset[1:6:2]
    assert part["depth"].shape == (3, 18, 24) and part["K"].shape == (3, 3, 3)
    assert np.array_equal(part["labels"], rendered["labels"][1:6:2])
    assert np.array_equal(part["frame"], [1, 3, 5])
    assert np.array_equal(part["camera_to_world"], frames.camera_to_world[1:6:2])
    assert np.array_equal(part["object_poses"], frames.object_poses[frames.world_index[1:6:2]])
    some = dataset[np.array([-1, 0])]
    assert np.array_equal(some["labels"], rendered["labels"][[-1, 0]]) and some["timestamp"].tolist() == [16.0, 10.0]
    assert np.array_equal(dataset[-2]["labels"], rendered["labels"][-2])
    labels = dataset["labels"]
    assert (len(labels), labels.shape, labels.dtype) == (FRAMES, (FRAMES, 18, 24), np.uint8)
    assert np.array_equal(labels[np.int64(3)], rendered["labels"][3])
    assert np.array_equal(np.asarray(labels), rendered["labels"]) and labels.ndim == 3
    for key in (
        (3, 5, 7),
        (-1, slice(2, 9), 4),
        (slice(1, 6, 2), 5),
        (2,),
        (),
        ([4, 1], slice(3), slice(None, None, 2)),
    ):
        assert np.array_equal(labels[key], rendered["labels"][key]), key
    assert np.array_equal(dataset["timestamp"], frames.timestamps)
    assert [frame["frame"] for frame in dataset] == list(range(FRAMES))
    assert dataset[2:2]["depth"].shape == (0, 18, 24)
    assert dataset.frames.camera_to_world.shape == (FRAMES, 7)


def test_urls_are_read_like_folders(rendered):
    pytest.importorskip("fsspec")
    for kind in ("npz", "png"):
        out = f"memory://read/{kind}"
        options = {"format": kind, "outputs": ["depth"], "shard_frames": SHARD_FRAMES}
        wv.render_batch(make_scene(), CAMERA, make_frames(), out, **options)
        dataset = wv.open_dataset(out)
        for index in (6, 0):
            assert_as_rendered(dataset[index], rendered, index)


@pytest.mark.parametrize("kind", ["npz", "zarr", "png", "bop"])
def test_unfinished_datasets_are_read_partially(kind, written, rendered, tmp_path):
    out = tmp_path / "part"
    shutil.copytree(written(kind), out)
    (out / "index.json").unlink()
    (out / "shards" / "000001.json").unlink()
    dataset = wv.open_dataset(out)
    assert not dataset.complete and "4 frames of 7, unfinished" in repr(dataset)
    assert dataset.frame_numbers.tolist() == [0, 1, 2, 6]
    assert dataset[3]["frame"] == 6 and dataset[3]["timestamp"] == 16.0
    assert_as_rendered(dataset[3], rendered, 6)
    assert np.array_equal(dataset[3]["object_poses"], make_frames().object_poses[0])
    assert len(dataset.frames) == 4
    with pytest.raises(IndexError, match="index of a frame must be less than 4, the number of frames, got 4"):
        dataset[4]


def test_unfinished_zarr_can_be_opened(written, tmp_path, monkeypatch):
    """zarr-python can open it: the metadata, with camera and conventions, is written first."""
    zarr = pytest.importorskip("zarr")
    monkeypatch.setattr("warpvis.batch.formats._zarr.Zarr.write_shard", _stop)
    out = tmp_path / "begun"
    with pytest.raises(RuntimeError, match="stopped"):
        wv.render_batch(make_scene(), CAMERA, make_frames(), out, format="zarr", outputs=["depth"])
    group = zarr.open_group(out / "data.zarr", mode="r")
    assert group["depth"].shape == (FRAMES, 18, 24) and np.isposinf(group["depth"][0]).all()
    assert np.array_equal(group["camera_to_world"][:], make_frames().camera_to_world)
    said = group.attrs
    assert (said["near"], said["far"], said["pixel_center"], said["units"]) == (0.5, 6.0, 0.5, "meters")
    assert len(wv.open_dataset(out)) == 0
    monkeypatch.undo()
    wv.render_batch(make_scene(), CAMERA, make_frames(), out, format="zarr", outputs=["depth"], resume=True)
    assert wv.batch.verify(out).ok
    assert len(wv.open_dataset(out)) == FRAMES
    (out / "data.zarr" / "zarr.json").write_text("{}")
    report = wv.batch.verify(out)
    assert report.damaged == ("begin.json",) and not report.ok


def _stop(*_):
    raise RuntimeError("stopped")


def _labels_of(given):
    dataset, index = given
    return dataset[index]["labels"]


@pytest.mark.smoke("fork")
@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_datasets_are_read_in_other_processes(method, written, rendered):
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {method} here")
    dataset = wv.open_dataset(written("npz"))
    dataset[0]  # keep a file open
    with multiprocessing.get_context(method).Pool(2) as pool:
        read = pool.map(_labels_of, [(dataset, index) for index in range(FRAMES)])
    assert np.array_equal(read, rendered["labels"])
    again = pickle.loads(pickle.dumps(wv.open_dataset(written("zarr"), outputs=("depth",))))
    assert again.outputs == ("depth",) and np.array_equal(again[3]["depth"], rendered["depth"][3])


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_torch_data_loader_reads_datasets(method, written, rendered):
    torch = pytest.importorskip("torch")
    loader = torch.utils.data.DataLoader(
        wv.open_dataset(written("npz")), batch_size=2, shuffle=True, num_workers=2, multiprocessing_context=method
    )
    seen = []
    for batch in loader:
        numbers = batch["frame"].tolist()
        assert np.array_equal(batch["depth"].numpy(), rendered["depth"][numbers])
        assert batch["object_poses"].shape == (len(numbers), 1, 7)
        seen += numbers
    assert sorted(seen) == list(range(FRAMES))


def damage(kind, out):
    """Return a file that contains a frame's depth."""
    return {
        "npz": out / "shard-000000.npz",
        "zarr": out / "data.zarr" / "depth" / "c.0.0.0",
        "png": out / "depth" / "000000" / "000000.png",
        "colmap": out / "stereo" / "depth_maps" / "000000" / "000000.png.geometric.bin",
        "bop": out / "train" / "000000" / "scene_gt_info.json",
        "ros2": out / "bag_000000" / "bag_000000.mcap",
    }[kind]


@pytest.mark.parametrize("kind", ["npz", "zarr", "png", "colmap", "bop", "ros2"])
def test_damaged_files_are_reported(kind, written, tmp_path):
    """Truncated, overwritten, empty or missing files: an error that names the file, or different values."""
    out, rng = tmp_path / "set", np.random.default_rng(0)
    shutil.copytree(written(kind), out)
    path = damage(kind, out)
    whole = path.read_bytes()
    said = 0
    for turn in range(25):
        data = bytearray(whole)
        if turn % 2:
            data = data[: int(rng.integers(1, len(data)))]
        for place in rng.integers(0, len(data), 8) if turn > 3 else ():
            data[place] = int(rng.integers(256))
        path.write_bytes(data)
        said += not _reads(out, path.name if kind != "ros2" else "bag_000000")
    assert said >= 10
    path.write_bytes(b"")
    assert not _reads(out, "bag_000000" if kind == "ros2" else path.name)
    path.unlink()
    assert not _reads(out, "bag_000000" if kind == "ros2" else path.name)


def _reads(out, name):
    try:
        wv.open_dataset(out)[0]
    except wv.errors.FileFormatError as error:
        assert name in str(error)
        return False
    return True


MANIFESTS = {
    "no camera": {"camera": None},
    "a camera of words": {"camera": {"width": "wide"}},
    "no objects": {"scene": {"objects": {"ball": {}}}},
    "no shards": {"shard_frames": 0},
    "too many frames": {"frames": 10**12},
    "no format": {"format": "jpeg"},
    "outputs": {"outputs": [1]},
}


@pytest.mark.parametrize("name", MANIFESTS)
def test_invalid_manifests_are_rejected(name, written, tmp_path):
    out = tmp_path / "set"
    shutil.copytree(written("npz"), out)
    manifest = json.loads((out / "manifest.json").read_text())
    (out / "manifest.json").write_text(json.dumps(manifest | MANIFESTS[name]))
    with pytest.raises(wv.errors.FileFormatError, match=r"set: .*(manifest\.json|poses\.npz|'jpeg')"):
        wv.open_dataset(out)


def test_invalid_arguments_and_paths_are_rejected(written, tmp_path):
    dataset = wv.open_dataset(written("npz"))
    with pytest.raises(wv.WarpvisError, match="there is no array 'rgb'; there are albedo, color, depth"):
        dataset["rgb"]
    with pytest.raises(wv.WarpvisError, match=r"frames must be a list, got 1\.5"):
        dataset[1.5]
    with pytest.raises(wv.WarpvisError, match="indices after the frames must be whole numbers or slices, got 'a'"):
        dataset["depth"][0, "a"]
    with pytest.raises(wv.WarpvisError, match=r"there is no such part of depth, .*: index 99 is out of bounds"):
        dataset["depth"][0, 99]
    with pytest.raises(wv.WarpvisError, match="index of a frame must be a whole number, got 'a'"):
        dataset[["a", "b"]]
    with pytest.raises(wv.WarpvisError, match=r"outputs must be from albedo, color, depth, .*, got 'rgb'"):
        wv.open_dataset(written("npz"), outputs=["rgb"])
    (tmp_path / "looked").mkdir()
    for path in (tmp_path / "nowhere", tmp_path / "looked"):
        with pytest.raises(wv.WarpvisError, match="is not a dataset: the folder does not exist or is empty"):
            wv.open_dataset(path)
    with pytest.raises(
        wv.WarpvisError, match=r"it has no manifest\.json of warpvis; its subfolders with datasets: .*npz"
    ):
        wv.open_dataset(written("npz").parent)
    with pytest.raises(wv.WarpvisError, match="format 'ply' cannot be read: its files are point clouds"):
        wv.open_dataset(written("ply"))


def test_number_of_open_files_is_limited(written, monkeypatch):
    """The number of open files of a dataset with many shards is limited."""
    frames = importlib.import_module("warpvis.batch.reading._shards")
    monkeypatch.setattr(frames, "_MAX_MAPPED", 1)
    dataset = wv.open_dataset(written("npz"))
    before = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else 0
    for index in (0, 3, 6, 0, 3, 6):
        dataset[index]
    if before:
        assert len(os.listdir("/proc/self/fd")) <= before + 2
