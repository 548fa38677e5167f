# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Records of complete parts of a dataset: one for each shard, one for the index, and one for the files that some
formats write before any shard. Each record is written after the files that it lists.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

from warpvis.batch._job import shard_name
from warpvis.batch.storage._output import FileSum, ShardFiles
from warpvis.batch.storage._stores import Store

INDEX_RECORD = "index.json"
BEGIN_RECORD = "begin.json"
RECORDS_FOLDER = "shards"


@dataclass(frozen=True)
class Record:
    """The record of a complete shard or of the index."""

    frames: int
    """Frames of the shard; of the whole dataset for the index."""
    files: dict[str, FileSum]
    """Its files, by their paths in the dataset."""
    warnings: dict[str, int]
    """Messages passed to `ShardFiles.warn`, with their counts."""
    empty: int = 0
    """Number of a shard's frames that see nothing."""

    @property
    def bytes(self) -> int:
        """Total size of its files in bytes."""
        return sum(item.bytes for item in self.files.values())


def shard_record(shard: int) -> str:
    """Return the path of a shard's record."""
    return f"{RECORDS_FOLDER}/{shard_name(shard)}.json"


def commit(store: Store, name: str, frames: int, files: ShardFiles, units: list[str], *, empty: int = 0) -> Record:
    """Move files to their places in a dataset and then, when they are on the disk, write their record.

    Args:
        store: The dataset.
        name: Path of the record.
        frames: Number of frames that the record covers.
        files: The files that were written.
        units: Files and folders that together contain all of `files`.
        empty: Number of the frames that see nothing.
    """
    sums = files.sums()
    outside = [file for file in sums if not any(file == unit or file.startswith(f"{unit}/") for unit in units)]
    if outside:
        raise RuntimeError(f"the format wrote {outside[0]}, which is in none of its units {units}")
    record = Record(frames, sums, dict(sorted(files.warnings.items())), empty)
    content = {
        "frames": frames,
        "files": {file: {"bytes": item.bytes, "crc32": f"{item.crc32:08x}"} for file, item in sums.items()},
        "warnings": record.warnings,
        "empty": empty,
    }
    files.write_text(name, json.dumps(content, indent=1) + "\n")
    store.put(files, units)  # the record follows only when the files are on the disk
    store.put(files, [name])
    return record


def read_record(store: Store, name: str) -> Record | None:
    """Read a record; return None if it does not exist or is malformed."""
    data = store.read(name)
    if data is None:
        return None
    try:
        content = json.loads(data)
        files = {file: FileSum(int(item["bytes"]), int(item["crc32"], 16)) for file, item in content["files"].items()}
        if not all(map(_is_inside, files)):
            return None
        warnings = {str(message): int(count) for message, count in content["warnings"].items()}
        return Record(int(content["frames"]), files, warnings, int(content.get("empty", 0)))
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        return None


def _is_inside(name: str) -> bool:
    """Return whether a path stays inside the dataset's folder; a record from another source could name any file."""
    return "\\" not in name and "\0" not in name and not {"", ".", ".."} & set(name.split("/"))


def read_whole(store: Store, name: str, frames: int) -> Record | None:
    """Read a record; return None unless it covers `frames` frames and its files exist with the recorded sizes."""
    record = read_record(store, name)
    if record is None or record.frames != frames:
        return None
    return record if all(store.size(file) == item.bytes for file, item in record.files.items()) else None
