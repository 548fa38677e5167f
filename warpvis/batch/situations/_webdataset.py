# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Situations as tar files of the WebDataset convention."""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from warpvis.batch._job import shard_name
from warpvis.batch.situations._base import ROW_FIELDS, TEXT, Files, SituationFormat, Stored, make_row
from warpvis.batch.situations._pictures import decode_picture
from warpvis.core.checks import describe_exception
from warpvis.core.types import Json
from warpvis.errors import FileFormatError
from warpvis.situations import Situation

if TYPE_CHECKING:
    from warpvis.batch.storage._output import ShardFiles
    from warpvis.batch.storage._stores import Store


class Webdataset(SituationFormat):
    """Writes ``data/train-000012.tar`` with ``NAME.json`` and pictures such as ``NAME.camera.color.png``."""

    name: ClassVar[str] = "webdataset"
    card: ClassVar[Mapping[str, Json]] = {"split": "train", "path": "data/*.tar"}
    description: ClassVar[str] = (
        "`data/train-NNNNNN.tar`, a tar file for each room, as `webdataset` reads them: `NAME.json` with the fields of "
        "a situation, then its pictures, `NAME.camera.color.png`, `NAME.agent0.color.png` and so on."
    )

    def write_shard(
        self, shard: int, situations: Sequence[Situation], pictures: Sequence[Files], files: ShardFiles
    ) -> list[str]:
        name = _file_name(shard)
        with tarfile.open(files.local_path(name), "w", format=tarfile.USTAR_FORMAT) as archive:
            for situation, encoded in zip(situations, pictures, strict=True):
                text = json.dumps(make_row(situation, encoded), separators=(",", ":"))
                _add(archive, f"{situation.name}.json", text.encode())
                for file, data in encoded.values():
                    _add(archive, f"{situation.name}.{file}", data)
        return [name]

    def columns(self, store: Store) -> list[dict[str, Json]]:
        """Return the columns of all samples.

        Without them, `datasets` takes those of the first five samples. It then refuses samples with other numbers of
        moments or participants, or drops their pictures.
        """
        pictures: dict[str, dict[str, Json]] = {}
        for shard in range(self.shards):
            with store.open(_file_name(shard)) as stream, tarfile.open(fileobj=stream, mode="r:") as archive:
                for member in archive:
                    field = member.name.partition(".")[2]
                    source = None if field == "json" or field in pictures else archive.extractfile(member)
                    if source is not None:
                        pictures[field] = _picture_kind(field, source.read())
        columns = {"json": {"struct": ROW_FIELDS}} | dict(sorted(pictures.items())) | {"__key__": TEXT, "__url__": TEXT}
        return [{"name": name, **kind} for name, kind in columns.items()]

    def read_shard(self, store: Store, shard: int, *, images: bool) -> list[Stored]:
        name = _file_name(shard)
        contents: dict[str, bytes] = {}
        try:
            with store.open(name) as stream, tarfile.open(fileobj=stream, mode="r:") as archive:
                for member in archive:
                    source = archive.extractfile(member) if images or member.name.endswith(".json") else None
                    if source is not None:
                        contents[member.name] = source.read()
            rows = [json.loads(data) for file, data in contents.items() if file.endswith(".json")]
            return [
                Stored(
                    json.loads(row["record"]),
                    {
                        item["image"]: (item["file"], contents[f"{row['name']}.{item['file']}"])
                        for item in row["files"]
                        if images
                    },
                )
                for row in rows
            ]
        except FileNotFoundError:
            raise FileFormatError(f"{store.name}: {name} is missing") from None
        except (tarfile.TarError, ValueError, KeyError, TypeError, EOFError) as error:
            raise FileFormatError(f"{store.name}: {name} is damaged: {describe_exception(error)}") from None


def _picture_kind(file: str, data: bytes) -> dict[str, Json]:
    """Return the type of a picture's column: an image, or the nested lists that `datasets` makes of an array."""
    if not file.endswith(".npz"):
        return {"dtype": "image"}
    image = decode_picture(file, file, data)
    kind: Json = image.dtype.name
    for _ in range(image.ndim - 1):
        kind = {"list": kind}
    return {"struct": [{"name": "image", "list": kind}]}


def _file_name(shard: int) -> str:
    return f"data/train-{shard_name(shard)}.tar"


def _add(archive: tarfile.TarFile, name: str, data: bytes) -> None:
    """Add a file, without a time or an owner."""
    member = tarfile.TarInfo(name)
    member.size = len(data)
    archive.addfile(member, io.BytesIO(data))
