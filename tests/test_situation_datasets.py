# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Datasets of situations: the same bytes in every way of writing them, and read back by us and by their libraries."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from batch_jobs import tree
from situation_jobs import FakeGenerator, FakeOptions

import warpvis as wv
from warpvis.batch import open_dataset, verify
from warpvis.batch.situations import generate_situations, open_situations
from warpvis.batch.situations._base import make_row
from warpvis.batch.situations._job import choose_situations
from warpvis.batch.situations._pictures import picture_files

pytest.importorskip("sklearn")
pytest.importorskip("pyarrow")

FORMATS = ("webdataset", "parquet", "jsonl", "lerobot")
ROOMS, OPTIONS = 4, FakeOptions()


def generate(out, options=OPTIONS, *, count=40, shard_situations=10, threads=1, **others):
    return generate_situations(
        out, options, FakeGenerator, count=count, shard_situations=shard_situations, threads=threads, **others
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the folder of an uninterrupted dataset in each format."""
    folder = tmp_path_factory.mktemp("whole")
    for name in FORMATS:
        generate(folder / name, format=name, license="cc-by-4.0")
    return folder


def expected(rooms=ROOMS, **options):
    generator = FakeGenerator(FakeOptions(**options))
    return [situation for room in range(rooms) for situation in generator.shard(room)]


def require_equal(found, situation):
    assert json.dumps(found.to_dict()) == json.dumps(situation.to_dict())
    assert found.images.keys() == situation.images.keys()
    for key, image in situation.images.items():
        assert found.images[key].dtype == image.dtype
        np.testing.assert_allclose(found.images[key], image, rtol=0, atol=5.1e-4, err_msg=key)


@pytest.mark.parametrize("name", FORMATS)
def test_situations_are_read_back(whole, name):
    dataset, situations = open_situations(whole / name), expected()
    assert len(dataset) == len(situations) == 40 and dataset.format == name
    for found, situation in zip(dataset, situations, strict=True):
        require_equal(found, situation)
    assert dataset[-1].name == "00003-0009" and [item.name for item in dataset[9:11]] == ["00000-0009", "00001-0000"]
    assert not open_situations(whole / name, images=False)[3].images
    report = verify(whole / name)
    assert report.ok and report.whole_shards == ROOMS and report.format == name


@pytest.mark.parametrize("name", FORMATS)
def test_moments_and_far_depth_are_read_back(tmp_path, name):
    options = FakeOptions(moments=3, far=100.0, seed=2)
    generate(tmp_path, options, count=20, format=name)
    for found, situation in zip(open_situations(tmp_path), expected(2, moments=3, far=100.0, seed=2), strict=True):
        require_equal(found, situation)


class Killed(BaseException):
    """Ends a job as a signal does."""


class Dying(FakeGenerator):
    def shard(self, number):
        if number == 2:
            raise Killed
        return super().shard(number)


Dying.__qualname__ = "FakeGenerator"


@pytest.mark.parametrize("name", FORMATS)
def test_bytes_after_a_killed_run(tmp_path, whole, name):
    options = {"count": 40, "shard_situations": 10, "format": name, "license": "cc-by-4.0"}
    with pytest.raises(Killed):
        generate_situations(tmp_path, FakeOptions(), Dying, threads=2, **options)
    assert len(open_situations(tmp_path)) == 20 and not (tmp_path / "README.md").exists()
    summary = generate(tmp_path, resume=True, threads=2, **options)
    assert summary.generated == 20 and summary.situations == 40 and summary.questions == 80
    assert tree(tmp_path) == tree(whole / name)
    summary = generate(tmp_path, resume=True, **options)
    assert summary.generated == 0 and summary.questions == 80 and summary.shortcuts is None


def test_damaged_shards_are_generated_again(tmp_path, whole):
    out = tmp_path / "out"
    shutil.copytree(whole / "webdataset", out)
    data = out / "data" / "train-000001.tar"
    data.write_bytes(data.read_bytes().replace(b"visible", b"VISIBLE"))
    assert verify(out).problems == ("data/train-000001.tar: its checksum differs from the recorded one",)
    assert generate(out, license="cc-by-4.0", resume=True, repair=True).generated == 10
    assert tree(out) == tree(whole / "webdataset")


@pytest.mark.slow
def test_bytes_of_processes(tmp_path, whole):
    generate(tmp_path, workers=2, threads=2, license="cc-by-4.0")
    assert tree(tmp_path) == tree(whole / "webdataset")


@pytest.mark.slow
def test_bytes_of_ray(tmp_path, whole, monkeypatch):
    ray = pytest.importorskip("ray")
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    places = {"env_vars": {"PYTHONPATH": str(Path(__file__).parent)}}  # of the generator
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="ERROR", runtime_env=places)
    try:
        generate(tmp_path, engine="ray", workers=2, threads=None, license="cc-by-4.0")
    finally:
        ray.shutdown()
    assert tree(tmp_path) == tree(whole / "webdataset")


class CountingGenerator(FakeGenerator):
    threads = None

    def __init__(self, options, *, device, threads):
        super().__init__(options)
        CountingGenerator.threads = threads


def test_generators_get_the_number_of_threads(tmp_path):
    options = FakeOptions(0, per_shard=4)
    generate_situations(tmp_path / "out", options, CountingGenerator, count=4, format="jsonl", threads=3, quiet=True)
    assert CountingGenerator.threads == 3


def test_last_shard_has_whole_pairs():
    situations = FakeGenerator(FakeOptions()).shard(0)
    assert [item.name for item in choose_situations(situations, 5)] == [f"00000-000{k}" for k in range(4)]


def test_webdataset_reads_the_shards(whole):
    webdataset = pytest.importorskip("webdataset")
    files = sorted(map(str, (whole / "webdataset" / "data").glob("*.tar")))
    samples = list(webdataset.WebDataset(files, shardshuffle=False, empty_check=False).decode("rgb8"))
    assert [sample["__key__"] for sample in samples] == [situation.name for situation in expected()]
    for sample, situation in zip(samples, expected(), strict=True):
        assert sample["json"]["questions"][0]["answer"] == situation.questions[0].answer
        np.testing.assert_array_equal(sample["camera.color.png"], situation.images["camera/color"])


@pytest.mark.parametrize("name", ["parquet", "jsonl", "webdataset"])
def test_datasets_reads_the_folder(tmp_path, whole, monkeypatch, name):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    datasets = pytest.importorskip("datasets")
    loaded = datasets.load_dataset(str(whole / name), split="train", cache_dir=str(tmp_path))
    rows = {(row["json"] if name == "webdataset" else row)["name"]: row for row in loaded}
    assert sorted(rows) == [situation.name for situation in expected()]
    for situation in expected()[::7]:
        row = rows[situation.name]
        picture = row["camera.color.png" if name == "webdataset" else "image"]
        np.testing.assert_array_equal(np.asarray(picture), situation.images["camera/color"])
        row = row["json"] if name == "webdataset" else row
        assert row["questions"][1]["choices"] == list(situation.questions[1].choices)
        if name != "webdataset":
            depth = np.asarray(row["views"][row["view_names"].index("camera/depth")])
            np.testing.assert_allclose(depth[1:], 1000 * situation.images["camera/depth"][1:], atol=0.51)


@pytest.mark.parametrize("single", [2, 6])
def test_datasets_reads_different_numbers_of_moments(tmp_path, monkeypatch, single):
    """`datasets` infers columns from five samples, unless the card contains them."""
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    datasets = pytest.importorskip("datasets")
    options = FakeOptions(moments=2, single=single)
    generate(tmp_path / "out", options, count=20, format="webdataset")
    cache = str(tmp_path / "cache")
    loaded = list(datasets.load_dataset(str(tmp_path / "out"), split="train", cache_dir=cache))
    assert (
        list(datasets.load_dataset(str(tmp_path / "out"), split="train", streaming=True))[3]["json"]
        == loaded[3]["json"]
    )
    for row, situation in zip(loaded, expected(2, moments=2, single=single), strict=True):
        assert row["__key__"] == situation.name
        assert row["json"] == make_row(situation, picture_files(situation))
        assert (row["camera.color.1.png"] is None) == (len(situation.moments) == 1)
        for key, (file, _) in picture_files(situation).items():
            image = situation.images[key]
            if "masks" in key:
                np.testing.assert_array_equal(row[file]["image"], image)
            elif "color" in key:
                np.testing.assert_array_equal(np.asarray(row[file]), image)
            elif "depth" in key:
                np.testing.assert_allclose(np.asarray(row[file]).ravel()[1:], 1000 * image.ravel()[1:], atol=0.51)
            else:
                np.testing.assert_array_equal(np.asarray(row[file]).astype(np.int32) - 1, image)


class PartlyColorGenerator(FakeGenerator):
    """The situations of the first room have one picture, those of others have several."""

    def shard(self, number):
        found = super().shard(number)
        if number:
            return found
        return [replace(one, images={"camera/color": one.images["camera/color"]}) for one in found]


def test_card_of_jsonl_defines_columns(tmp_path):
    """`datasets` infers them from a file in the order of a set, which may be one whose lists are empty."""
    options = {"count": 20, "shard_situations": 10, "format": "jsonl", "threads": 1}
    generate_situations(tmp_path, OPTIONS, PartlyColorGenerator, **options)
    card = (tmp_path / "README.md").read_text()
    (features,) = re.findall(r"^configs:\n- config_name: default\n(?:  .*\n)*?  features: (.*)\n", card, re.MULTILINE)
    columns = {column.pop("name"): column for column in json.loads(features)}
    assert columns["views"] == {"list": "image"} and columns["view_names"] == {"list": "string"}
    row = json.loads((tmp_path / "data" / "000001" / "metadata.jsonl").read_text().splitlines()[0])
    assert set(columns) == {{"file_name": "image", "views_file_names": "views"}.get(name, name) for name in row}


@pytest.mark.parametrize("name", ["parquet", "jsonl", "webdataset"])
def test_datasets_reads_rooms_with_one_picture_and_with_several(tmp_path, monkeypatch, name):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    datasets = pytest.importorskip("datasets")
    options = {"count": 20, "shard_situations": 10, "format": name, "threads": 1}
    generate_situations(tmp_path / "out", OPTIONS, PartlyColorGenerator, **options)
    loaded = datasets.load_dataset(str(tmp_path / "out"), split="train", cache_dir=str(tmp_path / "cache"))
    assert len(loaded) == 20
    if name != "webdataset":
        views = sorted(len(row["views"]) for row in loaded)
        assert views[:10] == [0] * 10 and views[10:] == [len(expected()[0].images) - 2] * 10  # one is no PNG


def test_lerobot_dataset(tmp_path, whole, monkeypatch):
    """Read the dataset as LeRobot does: tasks with pandas, frames with `datasets`; and depth as a recording."""
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    pandas, datasets = pytest.importorskip("pandas"), pytest.importorskip("datasets")
    folder, situations = whole / "lerobot", expected()
    info = json.loads((folder / "meta" / "info.json").read_text())
    assert {"data_files_size_in_mb", "video_files_size_in_mb"} <= set(info)  # `split_dataset` of LeRobot 0.4 reads them
    assert info["codebase_version"] == "v3.0" and info["total_frames"] == info["total_episodes"] == 40
    tasks = pandas.read_parquet(folder / "meta" / "tasks.parquet")
    assert tasks["task_index"].tolist() == list(range(info["total_tasks"])) and tasks.index.is_unique
    episodes = pandas.read_parquet(folder / "meta" / "episodes" / "chunk-000" / "file-000.parquet")
    loaded = datasets.load_dataset(str(folder), split="train", cache_dir=str(tmp_path))
    assert set(loaded.column_names) == set(info["features"])
    for number, (row, situation) in enumerate(zip(loaded, situations, strict=True)):
        assert row["index"] == row["episode_index"] == number and row["frame_index"] == 0
        assert tasks.iloc[row["task_index"]].name == situation.questions[0].text == episodes["tasks"][number][0]
        assert episodes["data/file_index"][number] == number // 10 and row["answer"] == situation.questions[0].answer
        picture = np.asarray(row["observation.images.camera"])
        np.testing.assert_array_equal(picture, situation.images["camera/color"])
    recording = wv.open_recording(folder, camera=wv.Camera.from_fov(8, 6, hfov=1.0), episode=23)
    np.testing.assert_allclose(recording[0].depth[1:], situations[23].images["camera/depth"][1:], atol=5.1e-4)


def test_lerobot_statistics(whole):
    """Without these, LeRobot cannot merge datasets or normalize inputs."""
    stats = json.loads((whole / "lerobot" / "meta" / "stats.json").read_text())
    names = {"min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99"}
    assert set(stats) == {"observation.images.camera", "observation.state"}
    assert all(set(item) == names and item["count"] == [40] for item in stats.values())
    states = np.array([situation.moments[0].participants[0].eyes for situation in expected()])
    np.testing.assert_allclose(stats["observation.state"]["std"], states.std(0), atol=1e-5)
    np.testing.assert_allclose(stats["observation.state"]["q90"], np.quantile(states, 0.9, axis=0), atol=1e-5)
    colors = np.stack([situation.images["camera/color"][::4, ::4] for situation in expected()]) / 255
    np.testing.assert_allclose(
        stats["observation.images.camera"]["mean"], colors.mean((0, 1, 2))[:, None, None], atol=1e-5
    )


@pytest.mark.parametrize("name", FORMATS)
def test_rooms_without_situations(tmp_path, monkeypatch, name):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    datasets = pytest.importorskip("datasets")
    generate(tmp_path / "out", FakeOptions(empty=(0, 2)), format=name)
    report = verify(tmp_path / "out")
    assert report.ok and report.has_situations and report.frames == len(open_situations(tmp_path / "out")) == 20
    loaded = datasets.load_dataset(str(tmp_path / "out"), split="train", cache_dir=str(tmp_path / "cache"))
    assert len(loaded) == 20


def test_lerobot_without_situations(tmp_path):
    with pytest.raises(wv.errors.FileFormatError, match="requires at least one situation, got none"):
        generate(tmp_path, FakeOptions(empty=(0, 1, 2, 3)), format="lerobot")


def test_datasheet(whole):
    text = (whole / "parquet" / "README.md").read_text()
    card, _, body = text.removeprefix("---\n").partition("---\n")
    assert 'license: "cc-by-4.0"' in card and 'path: "data/*.parquet"' in card and '- "n<1K"' in card
    counts = [question.answer for situation in expected() for question in situation.questions[:1]].count("yes")
    assert re.search(rf"\| `sees` \| 40 \| .*yes: {counts}\b", body)
    assert "| kitchen | 2 |" in body and "FakeOptions(seed=0" in body and "count=40" in body
    assert "cc-by" not in (whole / "parquet" / "shards" / "000000.json").read_text()


def test_shortcut_is_refused(tmp_path):
    options, sizes = FakeOptions(shortcut="text"), {"count": 100, "shard_situations": 10}
    with pytest.raises(wv.errors.ShortcutError, match="questions of kind 'sees' are answered by the shortcut"):
        generate(tmp_path, options, **sizes)
    assert not verify(tmp_path).ok and not (tmp_path / "README.md").exists()
    summary = generate(tmp_path, options, **sizes, resume=True, allow_shortcuts=True)
    assert summary.generated == 0 and {item.name for item in summary.shortcuts.found} >= {"text"}
    assert verify(tmp_path).ok and "**above the threshold**" in (tmp_path / "README.md").read_text()


WRONG = {
    "count": ({"count": 0}, "count must be a whole number from 1 up, got 0"),
    "size": ({"shard_situations": 1.5}, "shard_situations must be a whole number from 1 up, got 1.5"),
    "format": ({"format": "csv"}, "format must be one of webdataset, parquet, jsonl, lerobot, got 'csv'"),
    "options": ({"options": {"seed": 1}}, "options must be a dataclass with the options of the generator, got dict"),
    "repair": ({"repair": True}, "repair=True requires resume=True"),
    "engine": ({"engine": "slurm"}, 'engine must be "local" or "ray", got \'slurm\''),
    "workers": ({"workers": 0}, "workers must be a whole number from 1 up, got 0"),
    "address": ({"address": "auto"}, 'address= require engine="ray"'),
    "threads": ({"threads": 0}, "threads must be a whole number from 1 up, got 0"),
    "allow": ({"allow_shortcuts": 2}, "allow_shortcuts must be True or False, got 2"),
    "threshold": ({"shortcut_threshold": 1.5}, "shortcut_threshold must be a number from 0 to 1, got 1.5"),
    "license": ({"license": 3}, "license must be text, got 3"),
    "device": ({"device": "gpu"}, "gpu"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_input(tmp_path, name):
    changed, message = WRONG[name]
    with pytest.raises(wv.errors.WarpvisError, match=message) as caught:
        generate(tmp_path / "out", **changed)
    assert "\n" not in str(caught.value) and not (tmp_path / "out").exists()


def test_other_folders_are_refused(tmp_path, whole):
    with pytest.raises(wv.errors.FileFormatError, match="contains a complete dataset"):
        generate(whole / "jsonl", format="jsonl")
    with pytest.raises(wv.errors.FileFormatError, match=r"other input: .*options's seed was 0 and is 5"):
        generate(whole / "jsonl", FakeOptions(seed=5), format="jsonl", license="cc-by-4.0", resume=True)
    with pytest.raises(wv.errors.FileFormatError, match="situations, not frames: open it with open_situations"):
        open_dataset(whole / "jsonl")
    with pytest.raises(wv.errors.FileFormatError, match="is not a dataset of situations"):
        open_situations(tmp_path)
    with pytest.raises(IndexError, match="index must be below 40"):
        open_situations(whole / "jsonl")[40]


@pytest.mark.parametrize("name", FORMATS)
def test_damaged_files_are_one_sentence(tmp_path, whole, name):
    out = tmp_path / "out"
    shutil.copytree(whole / name, out)
    for path in [path for path in (out / "data").rglob("*") if path.is_file()]:
        path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(wv.errors.FileFormatError) as caught:
        open_situations(out)[0]
    assert "\n" not in str(caught.value)
    shutil.rmtree(out / "data")
    with pytest.raises(wv.errors.FileFormatError, match="is missing"):
        open_situations(out)[0]
