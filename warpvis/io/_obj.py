# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Workarounds for trimesh's OBJ reader, applied to the text before it is parsed.

The reader requires one space after a keyword at the beginning of a line, resolves relative indices from the end of the
file instead of from their line, truncates all vertices to the shortest one, and returns objects in reverse order.
"""

from __future__ import annotations

import re

from warpvis.core.checks import pluralize

# All patterns start with the preceding newline, which is found fast, and never backtrack: files have millions of lines.
_INDENTED = re.compile(rb"\n *+(v|vn|vt|f|o|g|s|usemtl|mtllib) ++")
_RELATIVE = re.compile(rb"\nf [^\n-]*+-")
_SHORT_VERTEX, _SHORT_FACE = (
    re.compile(rb"\n%s ++[^\s#]*+(?: ++[^\s#]++)?+ *+(?=[\n#])" % key) for key in (b"v", b"f")
)
_ZERO = re.compile(rb"\nf (?:[^\n#]* )?0++(?=[ /\n#])")
_ELEMENT = re.compile(rb"\n([vf]) ++([^\n#]*)")
_PART = {"object": re.compile(rb"\no ++([^\n]*)"), "group": re.compile(rb"\ng ++([^\n]*)")}


def straighten_obj(file: bytes) -> tuple[bytes, list[str]]:
    """Return an OBJ file's text with keywords at the beginning of lines, one space after, and no relative indices.

    The text starts and ends with an empty line. Faces of fewer than three corners are removed; the second value
    describes them, as a part of a sentence.
    """
    text, joined = _lines(file)
    zero = _ZERO.search(joined)
    if zero:
        line, content = _line(text, joined, zero)
        raise ValueError(f"line {line}: vertex indices of a face start at 1, got {content!r}")
    short = _SHORT_VERTEX.search(joined)
    if short:
        raise ValueError("line {}: a vertex needs three numbers, got {!r}".format(*_line(text, joined, short)))
    notes = []
    short = _SHORT_FACE.search(joined)
    if short:
        line, content = _line(text, joined, short)
        joined, count = _SHORT_FACE.subn(b"\n", joined)
        notes.append(f"{pluralize(count, 'face')} of fewer than three corners, the first {content!r} in line {line}")
    return (_absolute(joined) if _RELATIVE.search(joined) else joined), notes


def require_obj_elements(file: bytes) -> None:
    """Reject vertices that are not numbers, and faces that index no vertex; a slow pass that names the line."""
    text, joined = _lines(file)
    count = len(re.findall(rb"\nv ", joined))
    for element in _ELEMENT.finditer(joined):
        words = element[2].split()
        try:
            if element[1] == b"v":
                list(map(float, words))
                continue
            corners = [int(word.partition(b"/")[0]) for word in words]
        except ValueError:
            line, content = _line(text, joined, element)
            rule = "a vertex needs three numbers" if element[1] == b"v" else "a face needs numbers of vertices"
            raise ValueError(f"line {line}: {rule}, got {content!r}") from None
        if any(corner > count for corner in corners):
            line, content = _line(text, joined, element)
            raise ValueError(f"line {line}: a face must index the file's {count} vertices, got {content!r}")


def _lines(file: bytes) -> tuple[bytes, bytes]:
    """Return the text with keywords at the beginning of lines, and the same with continued lines joined."""
    text = b"\n" + file.replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\t", b" ") + b"\n"
    if b"\n " in text:
        text = _INDENTED.sub(rb"\n\1 ", text)
    return text, text.replace(b"\\\n", b" ")


def obj_splits(text: bytes) -> dict[str, bool]:
    """Return the options that split the file into its objects, or into its groups if it has no objects."""
    objects = bool(_PART["object"].search(text))
    return {"split_objects": objects, "split_groups": not objects}


def obj_order(text: bytes) -> dict[str, int]:
    """Return the index of each object's name in the file, or of each group's if the file has no objects."""
    kind = "object" if obj_splits(text)["split_objects"] else "group"
    names = dict.fromkeys(match[1].strip().decode("utf-8", errors="replace") for match in _PART[kind].finditer(text))
    return {name: number for number, name in enumerate(names)}


def _line(text: bytes, joined: bytes, match: re.Match[bytes]) -> tuple[int, str]:
    """Return number and content of the line where a match starts; `joined` is `text` with continued lines joined."""
    place = match.start()
    joins, passed = 0, 0
    for piece in text.split(b"\\\n")[:-1]:
        passed += len(piece) + 1
        if passed > place:
            break
        joins += 1
    content = joined[place + 1 : joined.index(b"\n", place + 1)].decode(errors="replace").strip()
    return joined.count(b"\n", 0, place) + joins + 1, content


def _absolute(text: bytes) -> bytes:
    """Replace relative indices, where -1 is the last vertex before the face, by absolute ones."""
    counts = {b"v": 0, b"vt": 0, b"vn": 0}
    lines = text.split(b"\n")
    for number, line in enumerate(lines):
        keyword = line.partition(b" ")[0]
        if keyword in counts:
            counts[keyword] += 1
        elif keyword == b"f" and b"-" in line:
            lines[number] = b"f " + b" ".join(_corner(corner, counts) for corner in line[2:].split())
    return b"\n".join(lines)


def _corner(corner: bytes, counts: dict[bytes, int]) -> bytes:
    parts = []
    for index, count in zip(corner.split(b"/"), counts.values(), strict=False):
        if index.startswith(b"-"):
            absolute = count + int(index) + 1
            if absolute < 1:
                raise ValueError(f"a face references vertex {int(index)} after {count} vertices")
            index = b"%d" % absolute
        parts.append(index)
    return b"/".join(parts)
