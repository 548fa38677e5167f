# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Small random changes to files: bytes, words, JSON, and the contents of archives with corrected checksums."""

from __future__ import annotations

import bz2
import gzip
import io
import json
import lzma
import re
import tarfile
import zipfile
import zlib

import numpy as np

_NUMBERS = (
    "0",
    "-1",
    "1",
    "7",
    "3.5",
    "-0.0",
    "nan",
    "inf",
    "-inf",
    "1e400",
    "-1e308",
    "1e38",
    "1e39",
    "1e-320",
    "1e18",
)
_NUMBERS += ("2147483647", "2147483648", "4294967295", "-2147483648", "9" * 20, "9" * 400, "0x10", "1..2", "--1", "1e")
_TEXTS = ("", " ", "x", "\0", "ü", "a" * 5000, "../../outside", "/etc/hostname", "/dev/zero", "/", ".", "%00", "NULL")
_TEXTS += ("http://127.0.0.1:9/x.stl", "file:///etc/hostname", "data:,x", "*", "[", "null", "true", "\u2028", "%s{0}")
_BRACKETS = ("{", "[", "(", "<a>", "<a ", "]", "}", "</a>", '"', "'", "<!--", "#", "\\", "&x;", "%<", ">%", "A { b [ ")
_BYTES = (b"\0", b"\xff", b"\x7f", b"\x80", b"\n", b"\r", b" ", b"0", b"9", b"-", b"\xef\xbb\xbf", b"\xff\xfe")
_INTEGERS = (0, 1, 2, 255, 256, 65535, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1)
_FLOATS = (np.nan, np.inf, -np.inf, 1e38, 1e-45, -1.0, 0.0, 1e18)
_VALUES = (None, True, False, 0, 1, -1, 0.5, 10**18, 2**31, 2**64, 10**400, -1e308, float("nan"), float("inf"), "", "x")
_VALUES += ([], {}, [[]], [1], {"a": 1}, [None], "../../outside", "\0", "a" * 5000, 1e-320, [0] * 100, "7", 65536)

_WORD = re.compile(r'"(?:[^"\\]|\\.)*"|[\w.+-]+|\s+|.')
_NUMBER = re.compile(r"[-+]?\d[\d.]*(?:[eE][-+]?\d+)?$")
_TEXT = {
    "obj",
    "mtl",
    "off",
    "dae",
    "gltf",
    "json",
    "jsonl",
    "wbt",
    "proto",
    "xml",
    "urdf",
    "txt",
    "csv",
    "yaml",
    "xyz",
}
_JSON = {"json", "gltf"}
_ZIP = {"zip", "npz", "3mf", "zae"}
_PACKED = {"gz": gzip, "bz2": bz2, "xz": lzma}


def mutate(rng: np.random.Generator, name: str, data: bytes) -> bytes:
    """Return the bytes of a file after one to four small changes.

    Args:
        rng: Random generator.
        name: Name of the file; the extension gives the format.
        data: Bytes of the file.
    """
    for _ in range(int(rng.choice((1, 1, 1, 2, 4)))):
        data = _change(rng, name.lower(), data)
    return data


def _change(rng: np.random.Generator, name: str, data: bytes) -> bytes:
    kind = name.rpartition(".")[2]
    inside = rng.random() < 0.75  # change the content of a packed file, else its bytes
    try:
        if inside and kind in _ZIP:
            return _in_zip(rng, data)
        if inside and kind in _PACKED:
            return _PACKED[kind].compress(_change(rng, name[: -len(kind) - 1], _PACKED[kind].decompress(data)))
        if inside and kind == "tar":
            return _in_tar(rng, data)
        if inside and kind == "png":
            return _in_png(rng, data)
        if inside and kind == "glb":
            return _in_glb(rng, data)
        if kind in _JSON and rng.random() < 0.6:
            return _in_json(rng, data)
    except Exception:  # an earlier change made the format invalid
        return _in_bytes(rng, data)
    if kind in _TEXT and rng.random() < 0.8:
        return _in_text(rng, data)
    return _in_bytes(rng, data)


def _pick(rng, values):
    return values[int(rng.integers(len(values)))]


def _in_bytes(rng: np.random.Generator, data: bytes) -> bytes:
    """Change some bytes, or remove, duplicate or move a block."""
    if not data:
        return _pick(rng, _BYTES)
    out, place = bytearray(data), int(rng.integers(len(data)))
    if rng.random() < 0.3:  # sizes are stored in file headers
        place = int(rng.integers(min(len(data), 64)))
    other, length = int(rng.integers(len(data))), int(rng.integers(1, 33))
    match int(rng.integers(10)):
        case 0:
            out[place] ^= 1 << int(rng.integers(8))
        case 1:
            out[place : place + 1] = _pick(rng, _BYTES)
        case 2:
            del out[place:]
        case 3:
            del out[place : place + length]
        case 4:
            out[place:place] = out[other : other + length]
        case 5:
            out[place : place + length] = rng.bytes(length)
        case 6 | 7:
            size, order = int(_pick(rng, (1, 2, 4, 8))), _pick(rng, ("little", "big"))
            number = int(_pick(rng, _INTEGERS)) % (1 << 8 * size)
            out[place : place + size] = number.to_bytes(size, order)
        case 8:
            kind = _pick(rng, ("<f4", "<f8"))
            value = np.array(_pick(rng, _FLOATS)).astype(kind).tobytes()
            place -= place % len(value) if rng.random() < 0.5 else 0
            out[place : place + len(value)] = value
        case _:
            out[place : place + length], out[other : other + length] = (
                out[other : other + length],
                out[place : place + length],
            )
    return bytes(out)


def _in_text(rng: np.random.Generator, data: bytes) -> bytes:
    """Change a word or a line of a text."""
    text = data.decode("utf-8", errors="surrogateescape")
    words = _WORD.findall(text[:20_000]) + ([text[20_000:]] if len(text) > 20_000 else [])
    if not words:
        return _pick(rng, _BYTES)
    place, other = (int(number) for number in rng.integers(len(words), size=2))
    numbers = [number for number, word in enumerate(words) if _NUMBER.match(word)]
    if numbers and rng.random() < 0.5:
        words[_pick(rng, numbers)] = _pick(rng, _NUMBERS)
        return "".join(words).encode("utf-8", errors="surrogateescape")
    match int(rng.integers(10)):
        case 0:
            words = words[: place + 1]
        case 1:
            del words[place : place + int(rng.integers(1, 6))]
        case 2:
            words[place], words[other] = words[other], words[place]
        case 3:
            words.insert(place, words[other])
        case 4:
            words[place] = _pick(rng, _TEXTS)
        case 5:
            words[place] = '"' + _pick(rng, _TEXTS) + '"'
        case 6:
            words[place] = _pick(rng, _BRACKETS) * int(_pick(rng, (1, 1, 10, 3000)))
        case 7:
            lines = "".join(words).split("\n")
            line = int(rng.integers(len(lines)))
            lines[line:line] = [lines[int(rng.integers(len(lines)))]] * int(_pick(rng, (1, 2, 200)))
            words = ["\n".join(lines)]
        case 8:
            return (
                "".join(words)
                .encode("utf-8", errors="surrogateescape")
                .replace(b"\n", _pick(rng, (b"\r", b"\r\n", b"")))
            )
        case _:
            words[place] = rng.bytes(int(rng.integers(1, 20))).decode("latin-1")
    return "".join(words).encode("utf-8", errors="surrogateescape")


def _in_json(rng: np.random.Generator, data: bytes) -> bytes:
    """Change a value of a JSON file: replace it, remove it, or copy another value."""
    content = json.loads(data)
    places = [((), None)]
    _list_places(content, places)
    holder, key = places[int(rng.integers(1, len(places)))] if len(places) > 1 else ((), None)
    if key is None:
        return json.dumps(_pick(rng, _VALUES)).encode()
    match int(rng.integers(5)):
        case 0:
            del holder[key]
        case 1:
            source, other = places[int(rng.integers(1, len(places)))]
            holder[key] = json.loads(json.dumps(source[other]))
        case 2 if isinstance(holder[key], list):
            holder[key] = holder[key] * int(_pick(rng, (2, 2, 50)))
        case 3 if isinstance(holder[key], int | float):
            holder[key] = holder[key] * _pick(rng, (-1, 2, 3, 10, 1000, 0.5)) + _pick(rng, (0, 1, -1))
        case _:
            holder[key] = _pick(rng, _VALUES)
    return json.dumps(content).encode()


def _list_places(value, places) -> None:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        places.append((value, key))
        _list_places(item, places)


def _in_glb(rng: np.random.Generator, data: bytes) -> bytes:
    """Change the JSON or the binary chunk of a binary glTF file and correct the lengths."""
    length = int.from_bytes(data[12:16], "little")
    text, rest = data[20 : 20 + length], data[28 + length :]
    if rest and rng.random() < 0.5:
        rest = _in_bytes(rng, rest)
    else:
        text = _in_json(rng, text)
        text += b" " * (-len(text) % 4)
    chunks = len(text).to_bytes(4, "little") + b"JSON" + text + len(rest).to_bytes(4, "little") + b"BIN\0" + rest
    return b"glTF" + (2).to_bytes(4, "little") + (12 + len(chunks)).to_bytes(4, "little") + chunks


def _in_png(rng: np.random.Generator, data: bytes) -> bytes:
    """Change a chunk of a PNG file."""
    chunks, place = [], 8
    while place + 12 <= len(data):
        length = int.from_bytes(data[place : place + 4], "big")
        chunks.append((data[place + 4 : place + 8], data[place + 8 : place + 8 + length]))
        place += 12 + length
    number = int(rng.integers(len(chunks)))
    kind, body = chunks[number]
    if kind == b"IDAT" and rng.random() < 0.5:
        body = zlib.compress(_in_bytes(rng, zlib.decompress(body)))
    else:
        body = _in_bytes(rng, body)
    chunks[number] = kind, body
    return data[:8] + b"".join(
        len(body).to_bytes(4, "big") + kind + body + zlib.crc32(kind + body).to_bytes(4, "big") for kind, body in chunks
    )


def _in_zip(rng: np.random.Generator, data: bytes) -> bytes:
    """Change, rename, remove or re-encode a file of a ZIP archive."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        files = [(info.filename, archive.read(info), info.compress_type) for info in archive.infolist()]
    number = int(rng.integers(len(files)))
    name, content, stored = files[number]
    match int(rng.integers(8)):
        case 0:
            name = _pick(rng, (*_TEXTS[2:8], name.upper(), name + ".obj"))
        case 1:
            del files[number]
        case 2:
            stored = zipfile.ZIP_DEFLATED if stored == zipfile.ZIP_STORED else zipfile.ZIP_STORED
        case _:
            content = _change(rng, name, content)
    if number < len(files) and files[number][0]:
        files[number] = name, content, stored
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content, stored in files:
            archive.writestr(zipfile.ZipInfo(name.replace("\0", "_") or "_"), content, stored)
    return out.getvalue()


def _in_tar(rng: np.random.Generator, data: bytes) -> bytes:
    """Change a member of a tar archive, its name, or its type: a link, a folder, a device."""
    with tarfile.open(fileobj=io.BytesIO(data)) as archive:
        files = [(member, archive.extractfile(member).read()) for member in archive if member.isfile()]
    number = int(rng.integers(len(files)))
    member, content = files[number]
    match int(rng.integers(5)):
        case 0:
            member.name = _pick(rng, ("../../outside.stl", "/outside.stl", "x", "a" * 200 + ".stl"))
        case 1:
            member.type = _pick(
                rng, (tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.DIRTYPE, tarfile.CHRTYPE, tarfile.FIFOTYPE)
            )
            member.linkname = _pick(rng, ("/etc/hostname", "../../x", member.name, "/dev/zero"))
        case _:
            files[number] = member, _change(rng, member.name, content)
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w") as archive:
        for member, content in files:
            member.size = len(content) if member.isfile() else 0
            archive.addfile(member, io.BytesIO(content) if member.isfile() else None)
    return out.getvalue()
