# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""JSON and accessors of glTF files, compressed or not.

Section numbers are those of the glTF 2.0 specification. Errors are `ValueError` with a message of one sentence.
"""

from __future__ import annotations

import base64
import json
import urllib.parse
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import describe_exception
from warpvis.core.types import Json

Find = Callable[[str], bytes]
"""Reads a file that another one references."""

DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")

_HEADER, _CHUNK_HEADER = 12, 8
_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}

# Accessors without data are zeros of any count: a short file could allocate any amount of memory.
_MAX_ZEROS = 1 << 24


class GltfData:
    """The JSON of a glTF file, and its buffers."""

    def __init__(self, file: bytes, find: Find) -> None:
        """Parse the JSON of a file, ``.gltf`` or ``.glb`` by its first bytes; `find` reads its buffers."""
        self._find = find
        self._chunk: bytes | None = None
        text = file
        if file.startswith(b"glTF"):
            text, self._chunk = _chunks(file)
        content = json.loads(text.decode("utf-8-sig"))
        if not isinstance(content, dict):
            raise ValueError("it contains no JSON object")
        self._content: dict[str, Json] = content
        asset = content.get("asset")
        version = str(asset.get("version", "2.0")) if isinstance(asset, dict) else "2.0"
        if version.split(".")[0] != "2":
            raise ValueError(f"it is glTF {version}, but only 2 is supported")
        self._buffers: dict[int, bytes] = {}

    def names(self, key: str) -> list[str]:
        """Return a list of strings, such as ``extensionsUsed``."""
        return [str(name) for name in self.all(key)]

    def all(self, key: str) -> list[Any]:
        """Return a list of the JSON; an empty one if not given."""
        found = self._content.get(key, [])
        if not isinstance(found, list):
            raise ValueError(f"{key} must be a list")
        return found

    def one(self, key: str, index: Json) -> dict[str, Any]:
        """Return an object of a list of the JSON."""
        items = self.all(key)
        if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(items):
            raise ValueError(f"it references {key} {index!r} of {len(items)}")
        if not isinstance(items[index], dict):
            raise ValueError(f"{key} {index} must be an object")
        return items[index]

    def get(self, key: str, otherwise: Json = None) -> Json:
        """Return a value of the JSON."""
        return self._content.get(key, otherwise)

    def accessor(self, index: Json) -> NDArray[np.generic]:
        """Read an accessor (3.6.2), shape ``(count, components)``; normalized integers become float64."""
        item = self.one("accessors", index)
        count, dtype, width = _layout(item)
        if "bufferView" in item:
            rows = self._rows(item["bufferView"], item.get("byteOffset", 0), count, dtype, width)
        elif count > _MAX_ZEROS:
            raise ValueError(f"accessor {index} has {count} elements and no data")
        else:
            rows = np.zeros((count, width), dtype)
        if "sparse" in item:
            rows = self._with_sparse(rows, item["sparse"])
        return self.scaled(rows, index)

    def scaled(self, rows: NDArray[np.generic], index: Json) -> NDArray[np.generic]:
        """Dequantize integers, if their accessor is normalized (3.6.2.2).

        The accessor's type counts, since a decoder may return integers as floats.
        """
        item = self.one("accessors", index)
        kind = _component(item["componentType"])
        if item.get("normalized") is not True or kind.kind not in "iu":
            return rows
        return np.maximum(rows.astype(np.float64) / np.iinfo(kind.str).max, -1.0)

    def has_data(self, index: Json) -> bool:
        """Return whether an accessor has uncompressed data; if not, an extension decodes it."""
        item = self.one("accessors", index)
        return "bufferView" in item or "sparse" in item

    def view(self, index: Json) -> NDArray[np.uint8]:
        """Return the bytes of a buffer view (3.6.1), decoded."""
        item = self.one("bufferViews", index)
        extensions = item.get("extensions") or {}
        for name in MESHOPT:
            if name in extensions:
                return self._decode_meshopt(item, extensions[name], name)
        return self._bytes(item)

    def _bytes(self, item: dict[str, Any]) -> NDArray[np.uint8]:
        data = np.frombuffer(self._buffer(item["buffer"]), dtype=np.uint8)
        start, length = _whole(item.get("byteOffset", 0), "byteOffset"), _whole(item["byteLength"], "byteLength")
        if start + length > len(data):
            raise ValueError(f"a buffer view ends at byte {start + length} of a buffer of {len(data)}")
        return data[start : start + length]

    def _buffer(self, index: Json) -> bytes:
        item = self.one("buffers", index)
        assert isinstance(index, int)
        if index not in self._buffers:
            uri = item.get("uri")
            if uri is not None:
                inline = str(uri).startswith("data:")
                self._buffers[index] = uri_bytes(str(uri)) if inline else self._find(uri_name(str(uri)))
            elif index == 0 and self._chunk is not None:
                self._buffers[index] = self._chunk
            else:
                raise ValueError(f"buffer {index} has no data")
        return self._buffers[index]

    def _rows(self, view: Json, start: Json, count: int, dtype: np.dtype, width: int) -> NDArray[np.generic]:
        data = self.view(view)
        item = self.one("bufferViews", view)
        size = width * dtype.itemsize
        stride = _whole(item.get("byteStride", size), "byteStride")
        first = _whole(start, "byteOffset")
        if stride < size:
            raise ValueError(f"elements of {size} bytes have a stride of {stride} bytes")
        if count and first + (count - 1) * stride + size > len(data):
            raise ValueError(f"an accessor of {count} elements exceeds its buffer view of {len(data)} bytes")
        if not count:
            return np.zeros((0, width), dtype)
        return np.ndarray((count, width), dtype, data.data, first, (stride, dtype.itemsize))

    def _with_sparse(self, rows: NDArray[np.generic], sparse: dict[str, Any]) -> NDArray[np.generic]:
        """Return rows with the sparse replacements applied (3.6.2.3)."""
        count = _whole(sparse["count"], "count")
        indices, values = sparse["indices"], sparse["values"]
        kind = _component(indices["componentType"])
        places = self._rows(indices["bufferView"], indices.get("byteOffset", 0), count, kind, 1)[:, 0].astype(np.int64)
        if count and places.max() >= len(rows):
            raise ValueError(f"a sparse accessor of {len(rows)} elements replaces number {places.max()}")
        changed = rows.copy()
        changed[places] = self._rows(
            values["bufferView"], values.get("byteOffset", 0), count, rows.dtype, rows.shape[1]
        )
        return changed

    def _decode_meshopt(self, item: dict[str, Any], packed: dict[str, Any], name: str) -> NDArray[np.uint8]:
        try:
            import meshoptimizer
        except ImportError:
            if self.one("buffers", item["buffer"]).get("uri") is not None:  # uncompressed fallback data
                return self._bytes(item)
            raise ValueError(missing(name, "meshoptimizer")) from None
        count, stride = _whole(packed["count"], "count"), _whole(packed["byteStride"], "byteStride")
        source, mode = self._bytes(packed).tobytes(), packed.get("mode")
        if mode == "ATTRIBUTES":
            if stride % 4 or not 0 < stride <= 256:
                raise ValueError(f"{name}: byteStride must be a multiple of 4 up to 256, got {stride}")
            found = meshoptimizer.decode_vertex_buffer(count, stride, source, dtype=np.dtype(f"V{stride}"))
        elif mode in ("TRIANGLES", "INDICES"):
            # The C code aborts on these errors of a file.
            if stride not in (2, 4) or (mode == "TRIANGLES" and count % 3):
                raise ValueError(f"{name}: {mode} must be indices of 2 or 4 bytes, got {count} of {stride}")
            decode = meshoptimizer.decode_index_buffer if mode == "TRIANGLES" else meshoptimizer.decode_index_sequence
            found = decode(count, stride, source)
        else:
            raise ValueError(f"{name}: mode must be ATTRIBUTES, TRIANGLES or INDICES, got {mode!r}")
        decoded = found.view(np.uint8).reshape(-1)[: count * stride]
        kind, fits = packed.get("filter", "NONE"), {"OCTAHEDRAL": (4, 8), "QUATERNION": (8,)}
        if kind == "EXPONENTIAL" and mode == "ATTRIBUTES":
            return meshoptimizer.decode_filter_exp(decoded, count, stride)
        if kind in fits and stride in fits[kind] and mode == "ATTRIBUTES":
            decode_filter = (
                meshoptimizer.decode_filter_oct if kind == "OCTAHEDRAL" else meshoptimizer.decode_filter_quat
            )
            return decode_filter(decoded, count, stride)
        return decoded


def decode_draco(data: bytes) -> Any:
    """Decode a `DRACO` mesh to an object with ``faces``, and ``attributes`` with ``unique_id`` and ``data``."""
    try:
        import DracoPy
    except ImportError:
        raise ValueError(missing(DRACO, "DracoPy")) from None
    try:
        return DracoPy.decode(data)
    except Exception as error:  # the decoder raises its own exceptions
        raise ValueError(f"{DRACO}: {describe_exception(error)}") from None


def missing(extension: str, package: str) -> str:
    """Return the message for a missing decoder."""
    return f"it is compressed by {extension}, and reading that needs {package}: pip install 'warpvis[gltf]'"


def _chunks(file: bytes) -> tuple[bytes, bytes | None]:
    """Return the JSON and the binary chunk of a GLB file (4.4)."""
    chunks: dict[bytes, bytes] = {}
    place = _HEADER
    if int.from_bytes(file[4:8], "little") != 2:
        raise ValueError(f"it is glTF {int.from_bytes(file[4:8], 'little')}, but only 2 is supported")
    while place + _CHUNK_HEADER <= len(file):
        length, kind = int.from_bytes(file[place : place + 4], "little"), file[place + 4 : place + 8]
        place += _CHUNK_HEADER
        if place + length > len(file):
            raise ValueError(f"it ends after {len(file)} bytes, in the middle of a chunk")
        chunks.setdefault(kind, file[place : place + length])
        place += length
    if b"JSON" not in chunks:
        raise ValueError("it has no JSON")
    return chunks[b"JSON"], chunks.get(b"BIN\0")


def uri_bytes(uri: str) -> bytes:
    """Return the bytes of a ``data:`` URI."""
    kind, _, text = uri.partition(",")
    return base64.b64decode(text) if kind.endswith(";base64") else urllib.parse.unquote_to_bytes(text)


def uri_name(uri: str) -> str:
    """Return the file name of a URI."""
    return urllib.parse.unquote(uri)


def _layout(item: dict[str, Any]) -> tuple[int, np.dtype, int]:
    """Return the number of an accessor's elements, and the type and number of their components."""
    width = _WIDTHS.get(item["type"])
    if width is None:
        raise ValueError(f"accessors must be of {', '.join(_WIDTHS)}, got {item['type']!r}")
    return _whole(item["count"], "count"), _component(item["componentType"]), width


def _component(code: Json) -> np.dtype:
    if not isinstance(code, int) or code not in _COMPONENTS:
        raise ValueError(f"componentType must be one of {', '.join(map(str, _COMPONENTS))}, got {code!r}")
    return np.dtype(_COMPONENTS[code])


def _whole(value: Json, name: str) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"{name} must be a whole number from 0 up, got {value!r}")
    return value
