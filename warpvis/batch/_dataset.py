# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A dataset that a job writes: starting, resuming and finishing it, and the records of its complete parts.

`JobFolder` is common to all jobs, `Dataset` is that of rendered frames. There is a record for each shard, for the
index, and for the files that some formats write before any shard. Each record is written after the files that it lists.
"""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from warpvis.batch._job import FRAME_ARRAYS, WorkerLostError, frame_arrays, shard_name
from warpvis.batch._manifest import MANIFEST, Manifest, manifest_text, parse_manifest, require_same
from warpvis.batch.formats._npz import npz_parts
from warpvis.batch.storage._output import FileSum, ShardFiles
from warpvis.batch.storage._stores import Store, open_store
from warpvis.core.checks import pluralize
from warpvis.errors import FileFormatError

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.formats._base import Format
    from warpvis.scene import Scene

POSES = "poses.npz"
INDEX_RECORD = "index.json"
BEGIN_RECORD = "begin.json"
RECORDS_FOLDER = "shards"


class ShardPlan(Protocol):
    """Number and lengths of the shards of a job."""

    @property
    def shard_count(self) -> int:
        """Number of shards."""

    def shard_length(self, shard: int) -> int | None:
        """Return the number of frames of a shard; None if only its record has it."""


@dataclass(frozen=True)
class Record:
    """The record of a complete shard or of the index."""

    frames: int
    """Frames or situations of the shard; of the whole dataset for the index."""
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
    """Move `files` to their places in a dataset and then, when they are on the disk, write their record.

    `units` are files and folders that together contain all of `files`; `empty` of the `frames` see nothing.
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


def read_whole(store: Store, name: str, frames: int | None) -> Record | None:
    """Read a record; return None unless it covers `frames` frames, if given, and its files have the recorded sizes."""
    record = read_record(store, name)
    if record is None or frames not in (None, record.frames):
        return None
    return record if all(store.size(file) == item.bytes for file, item in record.files.items()) else None


def read_frame_arrays(store: Store) -> dict[str, Any]:
    """Read the arrays of a dataset's frames.

    They are stored uncompressed; compressed arrays are refused, because they could unpack to any size.
    """
    data = store.read(POSES) or b""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        if sum(info.file_size for info in archive.infolist()) > len(data):
            raise ValueError("its arrays are compressed")
    with np.load(io.BytesIO(data)) as arrays:
        return {name: arrays[name] for name in FRAME_ARRAYS if name in arrays}


class JobFolder:
    """The folder of a job: its manifest, and the records of its shards."""

    def __init__(self, out: str | os.PathLike[str], plan: ShardPlan, manifest: Manifest) -> None:
        """Open the store at `out`; nothing is written yet."""
        self._store: Store = open_store(out)
        self._shards, self._manifest = plan, manifest
        self._complete = 0
        self.name = self._store.name
        self.bytes = 0
        self.frames = 0
        self.empty_frames = 0
        self.warnings: dict[str, int] = {}

    def check(self, *, resume: bool) -> bool:
        """Perform the checks of `opened` without writing; return whether the dataset already exists."""
        try:
            try:
                return self._require_ours(resume=resume)
            except FileFormatError:  # a concurrent writer changes the contents: report the lock instead
                self._store.require_unlocked()
                raise
        except OSError as error:
            raise FileFormatError(f"{self.name}: cannot be read: {error.strerror or error}") from None

    @contextmanager
    def opened(self, *, resume: bool) -> Iterator[list[int]]:
        """Open the dataset for writing, as a context manager that yields the numbers of the missing shards."""
        began = False
        try:
            self._store.create()
            with self._store.locked():
                known = self._require_ours(resume=resume)
                began = True
                self._store.clean()
                self._begin(known=known)
                try:
                    yield self._missing() if known else list(range(self._shards.shard_count))
                finally:
                    self._store.clean()
        except OSError as error:
            done = f"; {self._state()}" if began else ""
            raise FileFormatError(f"{self.name}: cannot be written: {error.strerror or error}{done}") from None
        except WorkerLostError as error:
            raise FileFormatError(f"{self.name}: {error}; {self._state()}") from None

    def add(self, shard: int, record: Record) -> None:
        """Add a complete shard to the counts."""
        self._complete += 1
        self.bytes += record.bytes
        self.frames += record.frames
        self.empty_frames += record.empty
        for message, count in record.warnings.items():
            self.warnings[message] = self.warnings.get(message, 0) + count

    def _state(self) -> str:
        count = self._shards.shard_count
        shards = f"{pluralize(count, 'shard')} {'is' if count == 1 else 'are'}"
        return f"{self._complete} of {shards} complete. Use resume=True to continue"

    def _require_ours(self, *, resume: bool) -> bool:
        """Return whether the dataset already exists and may be resumed."""
        entries = self._store.entries()
        if not entries:
            return False
        found = parse_manifest(self._store.read(MANIFEST)) if MANIFEST in entries else None
        if found is None:
            names = ", ".join(entries[:3]) + (", ..." if len(entries) > 3 else "")
            raise FileFormatError(f"{self.name}: contains other files ({names}). Pass a new or an empty folder.")
        if not resume:
            if INDEX_RECORD in entries:
                raise FileFormatError(f"{self.name}: contains a complete dataset. Pass a new or an empty folder.")
            raise FileFormatError(f"{self.name}: contains an unfinished dataset. Use resume=True to resume it.")
        require_same(found, self._manifest, self.name)
        return True

    def _begin(self, *, known: bool) -> None:
        """Write the manifest, if it is missing, and the other input."""
        with self._store.new_files() as files:
            files.write_text(MANIFEST, manifest_text(self._manifest))
            units = self._write_input(files)
            self._store.put(files, units if known else [MANIFEST, *units])

    def _write_input(self, files: ShardFiles) -> list[str]:
        """Write input of the job that is not in the manifest, and return its units."""
        return []

    def _missing(self) -> list[int]:
        """Return the shards that are not complete, and add the others to the counts."""
        missing = []
        for shard in range(self._shards.shard_count):
            record = read_whole(self._store, shard_record(shard), self._shards.shard_length(shard))
            if record is None:
                missing.append(shard)
            else:
                self.add(shard, record)
        return missing


class Dataset(JobFolder):
    """The folder of a job that renders frames: also its poses and its index."""

    def __init__(self, out: str | os.PathLike[str], plan: Plan, layout: Format, manifest: Manifest) -> None:
        """Open the store at `out`; nothing is written yet."""
        super().__init__(out, plan, manifest)
        self._plan, self._layout = plan, layout

    def finish(self, scene: Scene) -> None:
        """Write the index, if it is missing, which completes the dataset."""
        if read_whole(self._store, INDEX_RECORD, len(self._plan.frames)) is None:
            with self._store.new_files() as files:
                units = self._layout.index(files) + self._layout.write_models(files, scene)
                commit(self._store, INDEX_RECORD, len(self._plan.frames), files, units)

    def _begin(self, *, known: bool) -> None:
        super()._begin(known=known)
        if read_whole(self._store, BEGIN_RECORD, len(self._plan.frames)) is None:
            with self._store.new_files() as files:
                units = self._layout.begin(files)
                if units:
                    commit(self._store, BEGIN_RECORD, len(self._plan.frames), files, units)

    def _write_input(self, files: ShardFiles) -> list[str]:
        files.write(POSES, *npz_parts(frame_arrays(self._plan.frames)))
        return [POSES]
