# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Situations as a LeRobot dataset v3, with an episode for each situation.

Source: https://github.com/huggingface/lerobot at 7427f31801f944f5ec9ce53cda02862ce7d1638b, src/lerobot/datasets:
dataset_metadata.py, dataset_writer.py and utils.py.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from warpvis.batch._dataset import commit, shard_record
from warpvis.batch.situations._base import Files, SituationFormat, Stored, read_shard_file
from warpvis.batch.situations._parquet import (
    IMAGE,
    arrow_schema,
    decode_rows,
    image_value,
    make_feature,
    parquet_bytes,
    parquet_row,
)
from warpvis.batch.situations._pictures import decode_picture
from warpvis.core.file_content import reading, require_package
from warpvis.core.types import Json
from warpvis.errors import FileFormatError
from warpvis.io import depth_to_units, encode_pngs
from warpvis.situations import Situation

if TYPE_CHECKING:
    from warpvis.batch._dataset import Record
    from warpvis.batch.storage._output import ShardFiles
    from warpvis.batch.storage._stores import Store

_CHUNK = 1000
"""Files per folder."""
_ROWS = 20
_SAMPLES = 100
"""Number of pictures for statistics."""
_COLOR, _DEPTH = "observation.images.camera", "observation.images.camera_depth"
_PICTURES = {_COLOR: "camera/color", _DEPTH: "camera/depth"}
_STATE = ["x", "y", "z", "qx", "qy", "qz", "qw"]
_NUMBERS = ("frame_index", "episode_index", "index", "task_index")


@dataclass(frozen=True)
class _Shard:
    """The episodes of a shard."""

    tasks: list[str]
    """Task of each episode."""
    frames: list[int]
    """Number of frames of each episode."""


class Lerobot(SituationFormat):
    """Writes ``data/chunk-000/file-012.parquet`` with a row for each moment, and ``meta``.

    The task of an episode is the text of the situation's first question, and the column ``answer`` its answer. All
    questions, and the pictures of other views, are in ``situations/chunk-000/file-012.parquet``. Numbers of episodes
    and tasks depend on the shards before, and are written last.
    """

    name: ClassVar[str] = "lerobot"
    library: ClassVar[str] = "zlib pyarrow"
    card: ClassVar[Mapping[str, Json]] = {"split": "train", "path": "data/*/*.parquet"}
    description: ClassVar[str] = (
        "A LeRobot dataset v3: an episode for each situation with a frame for each moment, in "
        "`data/chunk-NNN/file-NNN.parquet`, a file for each room. The task is the text of the first question, `answer` "
        "its answer, `observation.state` the pose of the eyes of the first participant. All questions, and the "
        "pictures of other views, are in `situations/chunk-NNN/file-NNN.parquet`."
    )

    def write_shard(
        self, shard: int, situations: Sequence[Situation], pictures: Sequence[Files], files: ShardFiles
    ) -> list[str]:
        pa = require_package("pyarrow", "format 'lerobot' is written with pyarrow", "dataset")
        frames, rows = [], []
        for situation, encoded in zip(situations, pictures, strict=True):
            stored = _frames(situation, encoded)
            used = {key for frame in stored for key in frame.pop("keys")}
            frames += stored
            others = {key: value for key, value in encoded.items() if key not in used}
            row = parquet_row(situation, others)
            rows.append(row | {"task": _task(situation), "frames": len(stored)})
        data, name = _file_names(shard)
        schema = arrow_schema(pa, {"task": pa.string(), "frames": pa.int64()})
        files.write(name, parquet_bytes(pa.Table.from_pylist(rows, schema=schema), rows=_ROWS))
        if not rows:
            return [name]  # `datasets` cannot read an empty file
        with_depth = _DEPTH in frames[0]
        if any((_DEPTH in frame) != with_depth for frame in frames):
            raise FileFormatError("format 'lerobot' requires the picture camera/depth of all situations or of none")
        files.write(data, parquet_bytes(_frame_table(pa, frames, _features(with_depth=with_depth)), rows=_ROWS))
        return [data, name]

    def read_shard(self, store: Store, shard: int, *, images: bool) -> list[Stored]:
        parquet = require_package("pyarrow.parquet", "format 'lerobot' is read with pyarrow", "dataset")
        data, name = _file_names(shard)
        stored = decode_rows(f"{store.name}: {name}", read_shard_file(store, name), images=images)
        if not images:
            return stored
        content = read_shard_file(store, data)
        with reading(f"{store.name}: {data}", "frames of LeRobot"):
            rows = parquet.read_table(io.BytesIO(content)).to_pylist()
            result = []
            for item in stored:
                count = len(item.record["moments"])
                frames, rows = rows[:count], rows[count:]
                found = {}
                for time, frame in enumerate(frames):
                    for column, key in _PICTURES.items():
                        if column in frame:
                            place = f"{key}/{time}" if count > 1 else key
                            found[place] = frame[column]["path"], frame[column]["bytes"]
                result.append(Stored(item.record, found | dict(item.files)))
            return result

    def finish(self, store: Store, records: Sequence[Record]) -> None:
        """Write the numbers of episodes, frames and tasks into the files of shards where they differ."""
        pa = require_package("pyarrow", "format 'lerobot' is written with pyarrow", "dataset")
        parquet = require_package("pyarrow.parquet", "format 'lerobot' is written with pyarrow", "dataset")
        tasks: dict[str, int] = {}
        episode = index = 0
        for shard, episodes in enumerate(_read_shards(store, self.shards)):
            if not episodes.tasks:
                continue
            name = _file_names(shard)[0]
            numbers = [tasks.setdefault(task, len(tasks)) for task in episodes.tasks]
            columns = {
                "episode_index": np.repeat(episode + np.arange(len(numbers)), episodes.frames),
                "index": index + np.arange(sum(episodes.frames)),
                "task_index": np.repeat(np.array(numbers, dtype=np.int64), episodes.frames),
            }
            episode, index = episode + len(numbers), index + sum(episodes.frames)
            table = parquet.read_table(io.BytesIO(read_shard_file(store, name)))
            if all(np.array_equal(table.column(key).to_numpy(), column) for key, column in columns.items()):
                continue
            for key, column in columns.items():
                table = table.set_column(table.column_names.index(key), table.schema.field(key), pa.array(column))
            with store.new_files() as files:
                files.write(name, parquet_bytes(table, rows=_ROWS))
                other = _file_names(shard)[1]
                files.write(other, read_shard_file(store, other))
                commit(store, shard_record(shard), records[shard].frames, files, [name, other])

    def index(self, files: ShardFiles, store: Store) -> list[str]:
        """Write ``meta``: the features, the statistics, the tasks and the episodes."""
        pa = require_package("pyarrow", "format 'lerobot' is written with pyarrow", "dataset")
        parquet = require_package("pyarrow.parquet", "format 'lerobot' is written with pyarrow", "dataset")
        tasks: dict[str, int] = {}
        rows: list[dict[str, Any]] = []
        index = 0
        for shard, episodes in enumerate(_read_shards(store, self.shards)):
            for task, count in zip(episodes.tasks, episodes.frames, strict=True):
                tasks.setdefault(task, len(tasks))
                places = {"data/chunk_index": shard // _CHUNK, "data/file_index": shard % _CHUNK}
                rows.append(
                    {"episode_index": len(rows), "tasks": [task], "length": count, "dataset_from_index": index}
                    | {"dataset_to_index": index + count, **places}
                    | {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
                )
                index += count
        shard = self._first_shard(store)
        schema = parquet.read_schema(io.BytesIO(read_shard_file(store, _file_names(shard)[0])))
        info = {
            "codebase_version": "v3.0",
            "robot_type": None,
            "total_episodes": len(rows),
            "total_frames": index,
            "total_tasks": len(tasks),
            "chunks_size": _CHUNK,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200,
            "fps": _rate(self.read_shard(store, shard, images=False)),
            "splits": {"train": f"0:{len(rows)}"},
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": None,
            "features": _describe(self, store, shard, with_depth=_DEPTH in schema.names),
        }
        files.write_text("meta/info.json", json.dumps(info, indent=4) + "\n")
        # The layout of a pandas table whose index are the tasks.
        columns = [
            {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": dtype, "metadata": None}
            for name, kind, dtype in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
        ]
        table = pa.table({"task_index": pa.array(tasks.values(), pa.int64()), "task": pa.array(tasks, pa.string())})
        names = {"index_columns": ["task"], "column_indexes": [], "columns": columns}
        table = table.replace_schema_metadata({"pandas": json.dumps(names)})
        files.write("meta/tasks.parquet", parquet_bytes(table, rows=10_000))
        files.write_text("meta/stats.json", json.dumps(self._statistics(store, index), indent=4) + "\n")
        name = "meta/episodes/chunk-000/file-000.parquet"
        files.write(name, parquet_bytes(pa.Table.from_pylist(rows), rows=10_000))
        return ["meta"]

    def _first_shard(self, store: Store) -> int:
        """Return the number of the first shard with a situation."""
        for shard, episodes in enumerate(_read_shards(store, self.shards)):
            if episodes.tasks:
                return shard
        raise FileFormatError(f"{store.name}: format 'lerobot' requires at least one situation, got none")

    def _statistics(self, store: Store, frames: int) -> dict[str, Json]:
        """Return the statistics of the poses of all frames, and of the camera's colors in about `_SAMPLES` of them."""
        parquet = require_package("pyarrow.parquet", "format 'lerobot' is read with pyarrow", "dataset")
        step = max(1, frames // _SAMPLES)
        index, states, colors = 0, [], []
        for shard, episodes in enumerate(_read_shards(store, self.shards)):
            if not episodes.tasks:
                continue
            name = _file_names(shard)[0]
            content = io.BytesIO(read_shard_file(store, name))
            with reading(f"{store.name}: {name}", "frames of LeRobot"):
                found = parquet.read_table(content, columns=["observation.state"]).column(0).to_pylist()
                states += found
                chosen = range(-index % step, len(found), step)
                index += len(found)
                if chosen:
                    pictures = parquet.read_table(content, columns=[_COLOR]).column(0)
                    encoded = [pictures[place].as_py() for place in chosen]
                    images = [decode_picture("camera/color", item["path"], item["bytes"]) for item in encoded]
                    colors += [image[::4, ::4].reshape(-1, 3) for image in images]
        camera = _describe_values(np.concatenate(colors) / 255, len(colors), shape=(3, 1, 1))
        return {_COLOR: camera, "observation.state": _describe_values(np.array(states), frames, shape=(len(_STATE),))}


def _file_names(shard: int) -> tuple[str, str]:
    """Return the files of a shard: its frames, and its situations."""
    place = f"chunk-{shard // _CHUNK:03d}/file-{shard % _CHUNK:03d}.parquet"
    return f"data/{place}", f"situations/{place}"


def _task(situation: Situation) -> str:
    return situation.questions[0].text if situation.questions else "Look around."


def _frames(situation: Situation, pictures: Files) -> list[dict[str, Any]]:
    """Return a row for each moment, with the names of the pictures in it as ``keys``."""
    rows = []
    for time, moment in enumerate(situation.moments):
        end = f"/{time}" if len(situation.moments) > 1 else ""
        color, depth = f"camera/color{end}", f"camera/depth{end}"
        if color not in pictures:
            raise FileFormatError(f"format 'lerobot' requires the picture {color}, which {situation.name} lacks")
        row: dict[str, Any] = {_COLOR: image_value(pictures[color], situation.name), "keys": [color]}
        if depth in pictures:
            file, data = pictures[depth]
            if file.endswith(".png"):
                row["keys"].append(depth)
            else:
                units = depth_to_units(situation.images[depth], 1000.0)
                file, data = f"{file.removesuffix('npz')}png", next(encode_pngs(units[None]))
            row[_DEPTH] = image_value((file, data), situation.name)
        eyes = moment.participants[0].eyes if moment.participants else (0.0,) * len(_STATE)
        answer = situation.questions[0].answer if situation.questions else ""
        row |= {"observation.state": list(eyes), "answer": answer, "timestamp": moment.time, "frame_index": time}
        rows.append(row | {"episode_index": 0, "index": 0, "task_index": 0})
    return rows


def _features(*, with_depth: bool) -> list[str]:
    pictures = [_COLOR, _DEPTH] if with_depth else [_COLOR]
    return [*pictures, "observation.state", "answer", "timestamp", *_NUMBERS]


def _frame_table(pa: Any, frames: list[dict[str, Any]], features: list[str]) -> Any:
    image = pa.struct({"bytes": pa.binary(), "path": pa.string()})
    kinds = dict.fromkeys(features, pa.int64()) | {name: image for name in (_COLOR, _DEPTH) if name in features}
    kinds |= {"observation.state": pa.list_(pa.float32(), len(_STATE)), "answer": pa.string()}
    kinds["timestamp"] = pa.float32()
    described = {name: IMAGE if kind == image else make_feature(pa, kind) for name, kind in kinds.items()}
    metadata = {"huggingface": json.dumps({"info": {"features": described}})}
    return pa.Table.from_pylist(frames, schema=pa.schema(kinds, metadata=metadata))


def _describe(layout: Lerobot, store: Store, shard: int, *, with_depth: bool) -> dict[str, Json]:
    """Return the features as LeRobot describes them; sizes of pictures are those of the first one of `shard`."""
    first = layout.read_shard(store, shard, images=True)[0].restore()
    color = next(image for key, image in first.images.items() if key.startswith("camera/color"))
    features: dict[str, Any] = {
        _COLOR: {"dtype": "image", "shape": list(color.shape), "names": ["height", "width", "channels"]}
    }
    if with_depth:
        shape = [*color.shape[:2], 1]
        features[_DEPTH] = {"dtype": "image", "shape": shape, "names": ["height", "width", "channels"]}
        features[_DEPTH]["info"] = {"is_depth_map": True, "depth_unit": "mm"}
    features["observation.state"] = {"dtype": "float32", "shape": [len(_STATE)], "names": _STATE}
    features["answer"] = {"dtype": "string", "shape": [1], "names": None}
    features["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
    return features | {name: {"dtype": "int64", "shape": [1], "names": None} for name in _NUMBERS}


def _describe_values(values: NDArray[Any], count: int, *, shape: tuple[int, ...]) -> dict[str, Json]:
    """Return LeRobot's statistics of the columns of `values`, rounded so that they are equal on all CPUs."""
    found = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
    found |= {f"q{share:02d}": np.quantile(values, share / 100, axis=0) for share in (1, 10, 50, 90, 99)}
    described: dict[str, Json] = {name: np.round(item, 6).reshape(shape).tolist() for name, item in found.items()}
    return described | {"count": [count]}


def _rate(situations: Sequence[Stored]) -> int:
    """Return the frames per second of the first situation over time, rounded; 1 if there is none."""
    for item in situations:
        times = [moment["time"] for moment in item.record["moments"]]
        if len(times) > 1 and times[1] > times[0]:
            return max(1, round(1 / (times[1] - times[0])))
    return 1


def _read_shards(store: Store, count: int) -> Iterator[_Shard]:
    """Yield the episodes of each shard."""
    parquet = require_package("pyarrow.parquet", "format 'lerobot' is read with pyarrow", "dataset")
    for shard in range(count):
        name = _file_names(shard)[1]
        with reading(f"{store.name}: {name}", "situations of LeRobot"), store.open(name) as stream:
            table = parquet.read_table(stream, columns=["task", "frames"])
            yield _Shard(table.column("task").to_pylist(), table.column("frames").to_pylist())
