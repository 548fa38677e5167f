# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Situations as Parquet files, with the features that `datasets` reads: pictures are decoded as images."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from warpvis.batch.situations._base import Files, SituationFormat, Stored, make_row, read_shard_file
from warpvis.batch.situations._jsonl import split_views
from warpvis.core.file_content import reading, require_package
from warpvis.core.types import Json
from warpvis.situations import Situation

if TYPE_CHECKING:
    from warpvis.batch.storage._output import ShardFiles
    from warpvis.batch.storage._stores import Store

IMAGE = {"_type": "Image"}
"""Feature of a picture."""
_ROWS = 20
"""Situations per group of rows, which readers load at once."""
_PICTURES = ("image", "image_name", "views", "view_names", "arrays")


class Parquet(SituationFormat):
    """Writes ``data/train-00012-of-00100.parquet`` with a row for each situation.

    A row has the pictures and all questions about them, as in FineVision and The Cauldron, so that a picture is stored
    and decoded once for all of its questions.
    """

    name: ClassVar[str] = "parquet"
    library: ClassVar[str] = "zlib pyarrow"
    card: ClassVar[Mapping[str, Json]] = {"split": "train", "path": "data/*.parquet"}
    description: ClassVar[str] = (
        "`data/train-NNNNN-of-NNNNN.parquet`, a file for each room with a row for each situation, and its questions in "
        "a list, so that a picture is stored once for all of its questions. `image` is the picture of the camera, "
        "`views` are all others."
    )

    def write_shard(
        self, shard: int, situations: Sequence[Situation], pictures: Sequence[Files], files: ShardFiles
    ) -> list[str]:
        pa = require_package("pyarrow", "format 'parquet' is written with pyarrow", "dataset")
        rows = [parquet_row(situation, encoded) for situation, encoded in zip(situations, pictures, strict=True)]
        if not rows:
            return []  # `datasets` cannot read an empty file
        table = pa.Table.from_pylist(rows, schema=arrow_schema(pa))
        name = self._file_name(shard)
        files.write(name, parquet_bytes(table, rows=_ROWS))
        return [name]

    def read_shard(self, store: Store, shard: int, *, images: bool) -> list[Stored]:
        name = self._file_name(shard)
        return decode_rows(f"{store.name}: {name}", read_shard_file(store, name), images=images)

    def _file_name(self, shard: int) -> str:
        return f"data/train-{shard:05d}-of-{self.shards:05d}.parquet"


def parquet_bytes(table: Any, *, rows: int) -> bytes:
    """Return a table as a Parquet file with groups of `rows` rows."""
    parquet = require_package("pyarrow.parquet", "Parquet is written with pyarrow", "dataset")
    stream = io.BytesIO()
    parquet.write_table(table, stream, row_group_size=rows, compression="zstd", use_dictionary=False)
    return stream.getvalue()


def decode_rows(place: str, data: bytes, *, images: bool) -> list[Stored]:
    """Read the rows of a Parquet file; `place` is its name in messages."""
    parquet = require_package("pyarrow.parquet", f"{place}: Parquet is read with pyarrow", "dataset")
    with reading(place, "Parquet of situations"):
        rows = parquet.read_table(io.BytesIO(data), columns=["record", *(_PICTURES if images else ())]).to_pylist()
        return [Stored(json.loads(row["record"]), _stored_files(row) if images else {}) for row in rows]


def image_value(encoded: tuple[str, bytes], name: str) -> dict[str, Any]:
    """Return a picture as `datasets` stores it."""
    file, data = encoded
    return {"bytes": data, "path": f"{name}.{file}"}


def parquet_row(situation: Situation, pictures: Files) -> dict[str, Any]:
    """Return the values of `arrow_schema` for a situation."""
    first, views = split_views(pictures)
    row = make_row(situation, pictures)
    del row["files"]
    return row | {
        "image": None if first is None else image_value(pictures[first], situation.name),
        "image_name": first or "",
        "views": [image_value(pictures[key], situation.name) for key in views],
        "view_names": views,
        "arrays": [{"name": key, "bytes": data} for key, (file, data) in pictures.items() if not file.endswith(".png")],
    }


def _stored_files(row: Mapping[str, Any]) -> dict[str, tuple[str, bytes]]:
    found = dict(zip(row["view_names"], row["views"], strict=True))
    if row["image"] is not None:
        found[row["image_name"]] = row["image"]
    files = {key: (image["path"], image["bytes"]) for key, image in found.items()}
    return files | {item["name"]: (f"{item['name']}.npz", item["bytes"]) for item in row["arrays"]}


def arrow_schema(pa: Any, others: Mapping[str, Any] | None = None) -> Any:
    """Return the columns of situations, and `others`, with their features for `datasets`."""
    text, image = pa.string(), pa.struct({"bytes": pa.binary(), "path": pa.string()})
    texts = pa.list_(text)
    question = {"kind": text, "text": text, "paraphrases": texts, "choices": texts, "answer": text, "reason": text}
    question |= {"about": texts, "margin": pa.float64(), "unit": text}
    sight = {"agent": text, "thing": text, "time": pa.int32(), "fraction": pa.float64(), "error": pa.float64()}
    fields = {
        "name": text,
        "image": image,
        "image_name": text,
        "views": pa.list_(image),
        "view_names": texts,
        "questions": pa.list_(pa.struct(question)),
        "sights": pa.list_(pa.struct(sight | {"state": text})),
        "twin": text,
        "arrays": pa.list_(pa.struct({"name": text, "bytes": pa.binary()})),
        "record": text,
        **(others or {}),
    }
    features = {name: IMAGE if name == "image" else make_feature(pa, kind) for name, kind in fields.items()}
    features["views"] = {"_type": "List", "feature": IMAGE}
    metadata = {"huggingface": json.dumps({"info": {"features": features}})}
    return pa.schema(fields, metadata=metadata)


def make_feature(pa: Any, kind: Any) -> Any:
    """Return the feature of `datasets` for a type of Arrow."""
    if pa.types.is_list(kind):
        return {"_type": "List", "feature": make_feature(pa, kind.value_type)}
    if pa.types.is_fixed_size_list(kind):
        return {"_type": "List", "feature": make_feature(pa, kind.value_type), "length": kind.list_size}
    if pa.types.is_struct(kind):
        return {kind.field(place).name: make_feature(pa, kind.field(place).type) for place in range(kind.num_fields)}
    return {"_type": "Value", "dtype": {"double": "float64", "float": "float32"}.get(str(kind), str(kind))}
