# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The base class of formats of situations, and the fields that all of them have."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar

from warpvis.batch.situations._pictures import decode_picture
from warpvis.core.types import Json
from warpvis.errors import FileFormatError
from warpvis.situations import Situation

if TYPE_CHECKING:
    from warpvis.batch._dataset import Record
    from warpvis.batch.storage._output import ShardFiles
    from warpvis.batch.storage._stores import Store

FORMATS = ("webdataset", "parquet", "jsonl", "lerobot")
"""Names of the formats: the modules of this package, imported on demand, and their classes."""

Files = Mapping[str, tuple[str, bytes]]
"""Result of `picture_files`."""


@dataclass(frozen=True, eq=False)
class Stored:
    """A situation as it is stored: its record, and its encoded pictures."""

    record: Mapping[str, Any]
    """Result of `Situation.to_dict`."""
    files: Files
    """Name and contents of each picture; empty if they were not requested."""

    def restore(self) -> Situation:
        """Return the situation with its pictures."""
        images = {key: decode_picture(key, file, data) for key, (file, data) in self.files.items()}
        return Situation.from_dict(with_margins(self.record), images)


def with_margins(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record with infinite margins, which are null in JSON."""
    questions = [q | {"margin": math.inf if q["margin"] is None else q["margin"]} for q in record["questions"]]
    return {**record, "questions": questions}


TEXT: dict[str, Json] = {"dtype": "string"}
_NUMBER: dict[str, Json] = {"dtype": "float64"}
TEXTS: dict[str, Json] = {"list": "string"}


def _fields(**kinds: Mapping[str, Json]) -> list[Json]:
    """Return the fields of a structure as `datasets` writes them in a card."""
    return [{"name": name, **kind} for name, kind in kinds.items()]


_QUESTION = _fields(
    kind=TEXT,
    text=TEXT,
    paraphrases=TEXTS,
    choices=TEXTS,
    answer=TEXT,
    reason=TEXT,
    about=TEXTS,
    margin=_NUMBER,
    unit=TEXT,
)
_SIGHT = _fields(agent=TEXT, thing=TEXT, time={"dtype": "int32"}, fraction=_NUMBER, error=_NUMBER, state=TEXT)
ROW_FIELDS = _fields(
    name=TEXT,
    twin=TEXT,
    questions={"list": _QUESTION},
    sights={"list": _SIGHT},
    files={"list": _fields(image=TEXT, file=TEXT)},
    record=TEXT,
)
"""Fields of `make_row`."""


class SituationFormat:
    """A layout of files. Its bytes must depend only on the situations, not on the time or on random names."""

    name: ClassVar[str]
    """Name of the format, as on the command line."""
    library: ClassVar[str] = "zlib"
    """Distributions that affect the bytes, separated by spaces; the manifest contains their versions."""
    card: ClassVar[Mapping[str, Json]]
    """Path of the data files for the `configs` of a Hugging Face dataset card."""
    features: ClassVar[Sequence[Json]] = ()
    """Columns for these `configs`, if `datasets` would infer them from the first file that it finds."""
    description: ClassVar[str]
    """Its files, for datasheets, in Markdown."""

    def __init__(self, shards: int, shard_situations: int) -> None:
        """Prepare to write or read `shards` shards of at most `shard_situations` situations each."""
        self.shards, self.shard_situations = shards, shard_situations

    def write_shard(
        self, shard: int, situations: Sequence[Situation], pictures: Sequence[Files], files: ShardFiles
    ) -> list[str]:
        """Write the files of one shard, and return its units: files, or folders with files of this shard only."""
        raise NotImplementedError

    def read_shard(self, store: Store, shard: int, *, images: bool) -> list[Stored]:
        """Read the situations of a shard, in their order."""
        raise NotImplementedError

    def finish(self, store: Store, records: Sequence[Record]) -> None:
        """Complete the files of shards, when the records of all shards are known."""

    def columns(self, store: Store) -> list[dict[str, Json]]:
        """Return the columns of the dataset for its card, as `datasets` writes them; empty if the files define them."""
        return []

    def index(self, files: ShardFiles, store: Store) -> list[str]:
        """Write files for the whole dataset after all shards, and return their units."""
        return []


def find_situation_format(name: object) -> type[SituationFormat]:
    """Return the class of a format."""
    if not isinstance(name, str) or name not in FORMATS:
        raise FileFormatError(f"format must be one of {', '.join(FORMATS)}, got {name!r}")
    return getattr(import_module(f"warpvis.batch.situations._{name}"), name.capitalize())


def make_row(situation: Situation, pictures: Files) -> dict[str, Any]:
    """Return the fields of a situation.

    Every situation has the same fields of the same types, which Arrow and `datasets` need. What differs between
    situations, such as the description of the room, is in ``record``, a JSON text of all of `Situation.to_dict`.
    """
    return {
        "name": situation.name,
        "twin": situation.twin or "",
        "questions": [
            {
                "kind": question.kind,
                "text": question.text,
                "paraphrases": list(question.paraphrases),
                "choices": list(question.choices),
                "answer": question.answer,
                "reason": question.reason,
                "about": list(question.about),
                "margin": _finite(float(question.margin)),
                "unit": question.unit,
            }
            for question in situation.questions
        ],
        "sights": [
            {
                "agent": sight.agent,
                "thing": sight.thing,
                "time": sight.time,
                "fraction": float(sight.fraction),
                "error": float(sight.error),
                "state": sight.state,
            }
            for sight in situation.sights
        ],
        "files": [{"image": key, "file": file} for key, (file, _) in pictures.items()],
        "record": record_text(situation),
    }


def record_text(situation: Situation) -> str:
    """Return everything but the pictures as JSON, with null for infinite numbers."""
    return json.dumps(_finite(situation.to_dict()), allow_nan=False, separators=(",", ":"))


def _finite(value: Any) -> Any:
    """Return a value of JSON with None for numbers that JSON cannot hold."""
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def read_shard_file(store: Store, name: str) -> bytes:
    """Read a file of a shard, which must exist."""
    data = store.read(name)
    if data is None:
        raise FileFormatError(f"{store.name}: {name} is missing")
    return data
