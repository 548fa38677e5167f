# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Verification of datasets: every file is compared with its record."""

from __future__ import annotations

import itertools
import os
import zlib
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from warpvis.batch._dataset import (
    BEGIN_RECORD,
    INDEX_RECORD,
    POSES,
    RECORDS_FOLDER,
    read_frame_arrays,
    read_record,
    shard_record,
)
from warpvis.batch._job import FRAME_ARRAYS, shard_name
from warpvis.batch._manifest import (
    MANIFEST,
    Contents,
    frames_hash,
    read_label_names,
    read_manifest,
    read_situation_contents,
)
from warpvis.batch.storage._stores import Store, open_store
from warpvis.core.checks import check_flag, pluralize
from warpvis.core.threads import core_count
from warpvis.errors import FileFormatError

_MAX_RANGES = 10
_MAX_DIGITS = 20


@dataclass(frozen=True)
class VerifyReport:
    """The result of `verify`."""

    out: str
    """The dataset."""
    format: str
    """The dataset's format."""
    frames: int
    """Expected number of frames; of situations, the number of those that are recorded."""
    shards: int
    """Expected number of shards."""
    whole_shards: int
    """Number of shards that are recorded and intact."""
    files: int
    """Number of records and of the files that they list."""
    bytes: int
    """Total recorded size of the files in bytes."""
    problems: tuple[str, ...]
    """Descriptions of the problems, one sentence each."""
    damaged: tuple[str, ...] = ()
    """Records of damaged shards or files; once they are removed, a resumed job writes these again."""
    repaired: bool = False
    """Whether these records were removed, so that `render_batch` with the same arguments and `resume` restores them."""
    has_situations: bool = False
    """Whether the dataset consists of situations instead of frames."""

    @property
    def ok(self) -> bool:
        """Whether the dataset is complete and intact."""
        return not self.problems


def verify(out: str | os.PathLike[str], *, repair: bool = False) -> VerifyReport:
    """Read every file of a dataset and compare it with its record.

    Args:
        out: The dataset's folder or URL.
        repair: Whether to remove the records of damaged shards, so that a resumed job renders them again. Rendering
            needs the scene, which a dataset does not contain. `render_batch(resume=True, repair=True)` does both.

    Raises:
        FileFormatError: If `out` is not a dataset or cannot be read; with `repair`, also if another process writes it.
    """
    repair = check_flag(repair, "repair")
    store = open_store(out)
    try:
        if not repair:
            return _verify(store)
        _read_layout(store)
        with store.locked():
            report = _verify(store)
            for record in report.damaged:
                store.remove(record)
            return replace(report, repaired=True)
    except OSError as error:
        action = "repaired" if repair else "read"
        raise FileFormatError(f"{store.name}: cannot be {action}: {error.strerror or error}") from None


def _read_layout(store: Store) -> Contents:
    contents = read_situation_contents(store)
    if contents is None:
        manifest, contents = read_manifest(store)
        read_label_names(store.name, manifest)
    return contents


def _verify(store: Store) -> VerifyReport:
    contents = _read_layout(store)
    frames, shard_frames, shards = contents.frames, contents.shard_frames, contents.shard_count
    sha256 = contents.poses_sha256
    problems = [] if sha256 is None else list(_check_poses(store, sha256, frames))
    recorded = recorded_shards(store, shards)
    expected: dict[str, int | None] = {
        shard_record(k): None if sha256 is None else min(shard_frames, frames - k * shard_frames) for k in recorded
    }
    whole = None if sha256 is None else frames
    other_records = {INDEX_RECORD: whole} | ({} if store.size(BEGIN_RECORD) is None else {BEGIN_RECORD: whole})
    with ThreadPoolExecutor(core_count()) as pool:
        checked = list(pool.map(lambda item: _check(store, item), [*expected.items(), *other_records.items()]))
    present = [shard for shard, item in zip(recorded, checked, strict=False) if not item.missing]
    if len(present) < shards:
        missing = f"{pluralize(shards, 'shard')} {'is' if shards == 1 else 'are'} missing"
        problems.append(f"{shards - len(present)} of {missing}: {_gaps(present, shards)}")
    problems += [problem for item in checked for problem in item.problems]
    files = {name for item in checked for name in item.files}
    described = {MANIFEST} if sha256 is None else {MANIFEST, POSES}
    problems += [f"{name}: is not part of any record" for name in sorted(set(store.files()) - files - described)]
    complete = sum(not item.problems and not item.missing for item in checked[: len(recorded)])
    size = sum(item.bytes for item in checked)
    damaged = tuple(item.files[0] for item in checked if item.problems and item.files)
    if sha256 is None:
        frames = sum(item.frames for item in checked[: len(recorded)])
    counts = (frames, shards, complete, len(files), size)
    return VerifyReport(store.name, contents.format, *counts, tuple(problems), damaged, has_situations=sha256 is None)


def recorded_shards(store: Store, shards: int) -> list[int]:
    """Return the numbers of the recorded shards, in order.

    The records are listed, because the number of shards in a manifest is arbitrary and may be huge.
    """
    stems = (name.removesuffix(".json") for name in store.names(RECORDS_FOLDER) if name.endswith(".json"))
    numbers = {int(stem): stem for stem in stems if stem.isascii() and stem.isdigit() and len(stem) < _MAX_DIGITS}
    return sorted(number for number, stem in numbers.items() if number < shards and shard_name(number) == stem)


def _check_poses(store: Store, sha256: str, frames: int) -> Iterator[str]:
    from warpvis.cameras.frames import Frames

    try:
        arrays = read_frame_arrays(store)
        values: dict[str, Any] = {name: arrays.get(name) for name in FRAME_ARRAYS}
        stored = Frames(**values)
        if frames_hash(stored) != sha256:
            yield f"{POSES}: contains other poses than the manifest"
        elif len(stored) != frames:
            yield f"{POSES}: must have the {pluralize(frames, 'frame')} of the manifest, got {len(stored)}"
    except Exception:  # NumPy and zipfile may raise any exception for a malformed file
        yield f"{POSES}: is missing or cannot be read"


class _Checked(NamedTuple):
    """The result of checking a record and its files."""

    files: list[str]
    """The record and its files."""
    bytes: int
    problems: list[str]
    missing: bool = False
    """Whether a shard has no record; missing shards are reported together in one problem."""
    frames: int = 0
    """The recorded number of frames or situations."""


def _check(store: Store, item: tuple[str, int | None]) -> _Checked:
    """Compare a record with its files; `item` is its name and its expected number of frames, if known."""
    name, frames = item
    record = read_record(store, name)
    if record is None and store.size(name) is not None:
        return _Checked([name], 0, [f"{name}: is not a valid record"])
    if record is None:
        index = name == INDEX_RECORD
        return _Checked([], 0, [f"{name}: is missing: the job was not finished"] if index else [], not index)
    wrong = (
        []
        if frames is None or record.frames == frames
        else [f"{name}: must be a record of {pluralize(frames, 'frame')}, got {record.frames}"]
    )
    for file, expected in record.files.items():
        size = store.size(file)
        if size is None:
            wrong.append(f"{file}: is missing")
        elif size != expected.bytes:
            wrong.append(f"{file}: must have {expected.bytes} bytes, got {size}")
        elif _crc32(store, file) != expected.crc32:
            wrong.append(f"{file}: its checksum differs from the recorded one")
    return _Checked([name, *record.files], record.bytes, wrong, frames=record.frames)


def _gaps(numbers: Sequence[int], count: int) -> str:
    """Format the numbers below `count` that are missing from increasing `numbers`, as ranges: ``0-3, 7, 9-12``."""
    runs = [(last + 1, following - 1) for last, following in itertools.pairwise([-1, *numbers, count])]
    ranges = [str(first) if first == last else f"{first}-{last}" for first, last in runs if first <= last]
    return ", ".join(ranges[:_MAX_RANGES]) + (", ..." if len(ranges) > _MAX_RANGES else "")


def _crc32(store: Store, name: str) -> int:
    crc = 0
    with store.open(name) as stream:
        while data := stream.read(1 << 20):
            crc = zlib.crc32(data, crc)
    return crc
