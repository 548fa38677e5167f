# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reading of datasets of situations: `open_situations`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from itertools import accumulate
from typing import Any, overload

from warpvis.batch._dataset import read_record, shard_record
from warpvis.batch._manifest import MANIFEST, read_situation_contents
from warpvis.batch._verify import recorded_shards
from warpvis.batch.reading._shards import Recent
from warpvis.batch.situations._base import SituationFormat, Stored, find_situation_format
from warpvis.batch.storage._stores import Store, open_store
from warpvis.core.checks import check_flag, is_whole
from warpvis.errors import ArrayError, FileFormatError
from warpvis.situations import Situation

_CACHED_SHARDS = 2


class StoredShards:
    """The shards of a dataset."""

    def __init__(self, store: Store, layout: SituationFormat, lengths: Sequence[int]) -> None:
        """Read shards with these numbers of situations from `store`."""
        self._store, self._layout = store, layout
        self.lengths = list(lengths)

    def read(self, shard: int, *, images: bool) -> list[Stored]:
        """Read the situations of a shard."""
        found = self._layout.read_shard(self._store, shard, images=images) if self.lengths[shard] else []
        if len(found) != self.lengths[shard]:
            raise FileFormatError(
                f"{self._store.name}: shard {shard} must have {self.lengths[shard]} situations, got {len(found)}"
            )
        return found

    def records(self) -> Iterator[Mapping[str, Any]]:
        """Yield all situations as dictionaries, without pictures."""
        for shard in range(len(self.lengths)):
            yield from (item.record for item in self.read(shard, images=False))


class SituationDataset(Sequence[Situation]):
    """A dataset of situations, as a sequence. The shards that were read last are cached."""

    def __init__(self, shards: StoredShards, format: str, name: str, *, images: bool) -> None:
        """Read situations from `shards`."""
        self.name = name
        """The dataset's folder or URL."""
        self.format = format
        """The dataset's format."""
        self._shards, self._images = shards, images
        self._ends = list(accumulate(shards.lengths))
        self._recent = Recent[list[Stored]](_CACHED_SHARDS)

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    @overload
    def __getitem__(self, index: int) -> Situation: ...

    @overload
    def __getitem__(self, index: slice) -> list[Situation]: ...

    def __getitem__(self, index: int | slice) -> Situation | list[Situation]:
        """Return a situation, or several."""
        if isinstance(index, slice):
            return [self[place] for place in range(*index.indices(len(self)))]
        if not is_whole(index):
            raise ArrayError(f"index must be a whole number, got {type(index).__name__}")
        if not -len(self) <= index < len(self):
            raise IndexError(f"index must be below {len(self)}, the number of situations, got {index}")
        place = int(index) % len(self)
        shard = next(shard for shard, end in enumerate(self._ends) if place < end)
        stored = self._recent.get(shard, lambda: self._shards.read(shard, images=self._images))
        item = stored[place - (self._ends[shard] - self._shards.lengths[shard])]
        try:
            return item.restore()
        except (KeyError, TypeError, ValueError) as error:
            if isinstance(error, FileFormatError):
                raise
            raise FileFormatError(f"{self.name}: situation {place} is not a valid record") from None


def open_situations(out: str | os.PathLike[str], *, images: bool = True) -> SituationDataset:
    """Open a dataset of situations of any format, also one that is not finished.

    Args:
        out: The dataset's folder or URL.
        images: Whether situations have their pictures. Depth is rounded to millimeters, infinite without a surface.

    Raises:
        FileFormatError: If `out` is not a dataset of situations.
    """
    check_flag(images, "images")
    store = open_store(out)
    try:
        contents = read_situation_contents(store)
        if contents is None:
            raise FileFormatError(f"{store.name}: is not a dataset of situations: it has no {MANIFEST} of them")
        layout = find_situation_format(contents.format)(contents.shard_count, contents.shard_frames)
        lengths = []
        for shard in range(max(recorded_shards(store, layout.shards), default=-1) + 1):
            record = read_record(store, shard_record(shard))
            lengths.append(0 if record is None else record.frames)
    except OSError as error:
        raise FileFormatError(f"{store.name}: cannot be read: {error.strerror or error}") from None
    return SituationDataset(StoredShards(store, layout, lengths), layout.name, store.name, images=images)
