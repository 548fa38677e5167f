# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Situations as lines of JSON and PNG files, in the layout that `datasets` calls a folder of images."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from warpvis.batch._job import shard_name
from warpvis.batch.situations._base import ROW_FIELDS, TEXTS, Files, SituationFormat, Stored, make_row, read_shard_file
from warpvis.core.checks import describe_exception
from warpvis.core.types import Json
from warpvis.errors import FileFormatError
from warpvis.situations import Situation

if TYPE_CHECKING:
    from warpvis.batch.storage._output import ShardFiles
    from warpvis.batch.storage._stores import Store

COLOR = "camera/color"
"""The picture that is a situation's `image`."""


class Jsonl(SituationFormat):
    """Writes ``data/000012/metadata.jsonl`` and pictures such as ``data/000012/NAME.camera.color.png``."""

    name: ClassVar[str] = "jsonl"
    card: ClassVar[Mapping[str, Json]] = {"split": "train", "path": "data/**"}
    # Without these, a file whose lists are empty has columns of nulls, to which those of other files cannot be cast.
    features: ClassVar[Sequence[Json]] = (
        {"name": "image", "dtype": "image"},
        {"name": "views", "list": "image"},
        {"name": "view_names", **TEXTS},
        *ROW_FIELDS,
    )
    description: ClassVar[str] = (
        "`data/NNNNNN/metadata.jsonl`, a folder for each room with a line for each situation, and its pictures next "
        "to it. `datasets` reads it as an image folder: `image` is the picture of the camera, and `views` all others."
    )

    def write_shard(
        self, shard: int, situations: Sequence[Situation], pictures: Sequence[Files], files: ShardFiles
    ) -> list[str]:
        folder = _folder(shard)
        lines = []
        for situation, encoded in zip(situations, pictures, strict=True):
            names = {key: f"{situation.name}.{file}" for key, (file, _) in encoded.items()}
            for key, (_, data) in encoded.items():
                files.write(f"{folder}/{names[key]}", data)
            first, views = split_views(encoded)
            row = {"file_name": None if first is None else names[first], "views_file_names": [names[k] for k in views]}
            lines.append(json.dumps(row | {"view_names": views} | make_row(situation, encoded)))
        files.write_text(f"{folder}/metadata.jsonl", "".join(f"{line}\n" for line in lines))
        return [folder]

    def read_shard(self, store: Store, shard: int, *, images: bool) -> list[Stored]:
        folder = _folder(shard)
        text = read_shard_file(store, f"{folder}/metadata.jsonl")
        try:
            rows = [json.loads(line) for line in text.splitlines()]
            listed = [(json.loads(row["record"]), row["name"], row["files"] if images else []) for row in rows]
            return [
                Stored(
                    record,
                    {
                        str(item["image"]): (item["file"], read_shard_file(store, f"{folder}/{name}.{item['file']}"))
                        for item in pictures
                    },
                )
                for record, name, pictures in listed
            ]
        except (ValueError, KeyError, TypeError) as error:
            if isinstance(error, FileFormatError):
                raise
            reason = describe_exception(error)
            raise FileFormatError(f"{store.name}: {folder}/metadata.jsonl is damaged: {reason}") from None


def split_views(pictures: Files) -> tuple[str | None, list[str]]:
    """Return the key of the camera's color picture, of the first moment, and the keys of the other PNG files."""
    keys = [key for key, (file, _) in pictures.items() if file.endswith(".png")]
    first = next((key for key in keys if key in (COLOR, f"{COLOR}/0")), None)
    return first, [key for key in keys if key != first]


def _folder(shard: int) -> str:
    return f"data/{shard_name(shard)}"
