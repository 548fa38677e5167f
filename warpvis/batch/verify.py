# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a dataset is complete and sound: every file against its record."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from warpvis.batch.dataset import POSES
from warpvis.batch.identity import frames_hash
from warpvis.batch.manifest import MANIFEST, parse_manifest
from warpvis.batch.records import INDEX_RECORD, Record, read_record, shard_record
from warpvis.batch.stores import Store, open_store
from warpvis.errors import FileFormatError
from warpvis.threads import core_count


@dataclass(frozen=True)
class VerifyReport:
    """What was found in a dataset."""

    out: str
    """The dataset."""
    format: str
    """Its format."""
    frames: int
    """Frames that it should have."""
    shards: int
    """Shards that it should have."""
    whole_shards: int
    """Shards that are recorded and sound."""
    files: int
    """Files that were read."""
    bytes: int
    """Their bytes."""
    problems: tuple[str, ...]
    """What is wrong, a sentence each."""

    @property
    def ok(self) -> bool:
        """Whether the dataset is complete and sound."""
        return not self.problems


def verify(out: str | os.PathLike[str]) -> VerifyReport:
    """Read every file of a dataset and compare it with its record.

    Args:
        out: The dataset's folder or URL.

    Raises:
        FileFormatError: It is no dataset, or cannot be read.
    """
    store = open_store(out)
    try:
        return _verify(store)
    except OSError as error:
        raise FileFormatError(f"{store.name}: cannot be read: {error.strerror or error}") from None


def _verify(store: Store) -> VerifyReport:
    manifest = parse_manifest(store.read(MANIFEST))
    if manifest is None:
        raise FileFormatError(f"{store.name}: is no dataset: it has no {MANIFEST} of warpvis")
    frames, shard_frames = manifest["frames"], manifest["shard_frames"]
    shards = -(-frames // shard_frames)
    problems = list(_check_poses(store, manifest))
    known, whole, size = {MANIFEST, POSES}, 0, 0
    expected = {shard_record(k): min(shard_frames, frames - k * shard_frames) for k in range(shards)}
    expected[INDEX_RECORD] = frames
    with ThreadPoolExecutor(core_count()) as pool:
        for name, record, wrong in pool.map(lambda item: _check(store, *item), expected.items()):
            problems += wrong
            known |= {name, *record.files} if record else {name}
            size += record.bytes if record else 0
            whole += name != INDEX_RECORD and not wrong
    problems += [f"{name}: is in no record" for name in sorted(set(store.files()) - known)]
    return VerifyReport(store.name, manifest["format"], frames, shards, whole, len(known), size, tuple(problems))


def _check_poses(store: Store, manifest: Mapping[str, Any]) -> Iterator[str]:
    import io

    import numpy as np

    from warpvis.frames import Frames

    try:
        with np.load(io.BytesIO(store.read(POSES) or b"")) as arrays:
            found = {name: arrays.get(name) for name in ("camera_to_world", "timestamps", "object_poses", "world")}
        if frames_hash(Frames(**found)) != manifest["poses"]["sha256"]:
            yield f"{POSES}: holds other poses than the manifest says"
    except Exception:  # whatever NumPy and zipfile raise for what is no such file
        yield f"{POSES}: is missing or cannot be read"


def _check(store: Store, name: str, frames: int) -> tuple[str, Record | None, list[str]]:
    """A record's name and content, and what is wrong with it or its files."""
    record = read_record(store, name)
    if record is None:
        return name, None, [f"{name}: is missing" if store.size(name) is None else f"{name}: is no record"]
    wrong = [] if record.frames == frames else [f"{name}: is of {record.frames} frames, and should be of {frames}"]
    for file, expected in record.files.items():
        size = store.size(file)
        if size is None:
            wrong.append(f"{file}: is missing")
        elif size != expected.bytes:
            wrong.append(f"{file}: has {size} bytes, and should have {expected.bytes}")
        elif _crc32(store, file) != expected.crc32:
            wrong.append(f"{file}: its checksum differs from the recorded one")
    return name, record, wrong


def _crc32(store: Store, name: str) -> int:
    crc = 0
    with store.open(name) as stream:
        while data := stream.read(1 << 20):
            crc = zlib.crc32(data, crc)
    return crc
