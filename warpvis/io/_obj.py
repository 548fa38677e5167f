# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Workarounds for trimesh's OBJ reader, applied to the text before it is parsed; and the materials of its faces.

The reader requires one space after a keyword at the beginning of a line, resolves relative indices from the end of the
file instead of from their line, truncates all vertices to the shortest one, and returns objects in reverse order. It
assigns one material per object, or splits objects by material; texture coordinates come from it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import pluralize, truncate
from warpvis.core.user_warnings import warn_user
from warpvis.io._gltf_materials import Locate
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.materials import Appearance, Material, Texture, Wrap

# All patterns start with the preceding newline, which is found fast, and never backtrack: files have millions of lines.
_INDENTED = re.compile(rb"\n *+(v|vn|vt|f|o|g|s|usemtl|mtllib) ++")
_RELATIVE = re.compile(rb"\nf [^\n-]*+-")
_SHORT_VERTEX, _SHORT_FACE = (
    re.compile(rb"\n%s ++[^\s#]*+(?: ++[^\s#]++)?+ *+(?=[\n#])" % key) for key in (b"v", b"f")
)
_ZERO = re.compile(rb"\nf (?:[^\n#]* )?0++(?=[ /\n#])")
_ELEMENT = re.compile(rb"\n([vf]) ++([^\n#]*)")
_PART = {"object": re.compile(rb"\no ++([^\n]*)"), "group": re.compile(rb"\ng ++([^\n]*)")}

_DIRECTIVE = {
    "object": re.compile(rb"\n(usemtl|o) ++([^\n]*)"),
    "group": re.compile(rb"\n(usemtl|g) ++([^\n]*)"),
}
_LIBRARY = re.compile(rb"\nmtllib ++([^\n]*)")
_FACE = re.compile(rb"\nf ([^\n]*)")
_NORMAL = re.compile(rb"\nf [0-9]++/[0-9]*+/[0-9]")

# Options of maps, and the maximum number of values of each; fewer numbers may precede the file name.
_OPTIONS = {"-o": 3, "-s": 3, "-t": 3, "-mm": 2}
_WORD = ("-clamp", "-blendu", "-blendv", "-cc", "-bm", "-boost", "-texres", "-imfchan", "-type")
_ONCE = (1.0, 1.0)
_PBR = {"pm", "pr", "norm", "map_ke"}  # keywords of physically based materials


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
    kind = _part_kind(text)
    return {"split_objects": kind == "object", "split_groups": kind == "group"}


def has_normals(text: bytes) -> bool:
    """Return whether a face indexes normals."""
    return _NORMAL.search(text) is not None


def _part_kind(text: bytes) -> str:
    return "object" if _PART["object"].search(text) else "group"


def obj_order(text: bytes) -> dict[str, int]:
    """Return the index of each object's name in the file, or of each group's if the file has no objects."""
    kind = _part_kind(text)
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


class ObjMaterials:
    """The materials of an OBJ file, and those of its faces."""

    def __init__(self, name: str, text: bytes, locate: Locate) -> None:
        """Read the MTL files of a text from `straighten_obj`, and collect runs of faces of one object and material."""
        self._name, self._locate = name, locate
        self._statements: dict[str, dict[str, str]] = {}
        self._known: dict[str, Material] = {}
        self._missing: list[str] = []
        self._runs: dict[str, list[tuple[str, int, bytes]]] = {}
        if b"\nusemtl " not in text:
            return
        for match in _LIBRARY.finditer(text):
            self._read_library(_decoded(match[1]), locate)
        self._collect_runs(text)

    def appearance(self, mesh: str, base_appearance: LazyAppearance | None, faces: int) -> LazyAppearance | None:
        """Return the deferred appearance of an object; `mesh` is empty for faces before any name.

        Texture coordinates and vertex colors are those of `base_appearance`, read by trimesh.
        """
        runs = self._runs.pop(mesh, None)  # used once; frees the text of the file
        if not runs:
            return base_appearance
        names = list(dict.fromkeys(run[0] for run in runs))
        rows = self._rows(runs, names, faces) if len(names) > 1 else None
        unknown = [name for name in names if name and name not in self._statements]
        missed = f" ({', '.join(self._missing)}: no such file)" if self._missing else ""
        file_name = self._name

        def make() -> Appearance:
            base = None if base_appearance is None else base_appearance.get()
            if unknown:
                listed = ", ".join(map(repr, map(truncate, unknown[:5])))
                warn_user(f"{file_name}: no MTL file defines the material {listed}{missed}; using white", UserWarning)
            if len(names) > 1 and rows is None:
                warn_user(
                    f"{file_name}: using one material for {mesh!r}, since its faces differ from those of the file",
                    UserWarning,
                )
            uv, colors = (None, None) if base is None else (base.uv, base.vertex_colors)
            return Appearance(tuple(map(self._material, names)), rows, uv, colors)

        return LazyAppearance(make)

    def _read_library(self, words: str, locate: Locate) -> None:
        """Read the MTL files of a line: one file whose name may contain spaces, or else several."""
        found = locate(words)
        names = [words] if found is not None else words.split()
        for name in names:
            found = locate(name)
            try:
                file = found.read_bytes() if isinstance(found, Path) else found
            except OSError:
                file = None
            if file is None:
                self._missing.append(name)
                continue
            for statements in read_mtl(file):
                self._statements.setdefault(statements["name"], statements)

    def _material(self, name: str) -> Material:
        """Return a material, created on first use."""
        if name not in self._known:
            self._known[name] = mtl_material(self._statements.get(name, {"name": name}), self._locate)
        return self._known[name]

    def _collect_runs(self, text: bytes) -> None:
        """Split the text where the object or the material changes."""
        mesh, material, start = "", "", 0
        directives = _DIRECTIVE[_part_kind(text)].finditer(text)
        places = [(match.start(), match[1], _decoded(match[2]), match.end()) for match in directives]
        for place, keyword, value, end in [*places, (len(text), b"", "", len(text))]:
            count = text.count(b"\nf ", start, place)
            if count:
                # Keep the text: the number of triangles per face is computed later, if needed.
                self._runs.setdefault(mesh, []).append((material, count, text[start:place]))
            start = end
            if keyword == b"usemtl":
                material = value
            elif keyword:
                mesh = value

    def _rows(self, runs: list[tuple[str, int, bytes]], names: list[str], faces: int) -> NDArray[np.int32] | None:
        """Return each triangle's material index; None if their number differs from that of trimesh's triangles."""
        numbers = np.array([names.index(run[0]) for run in runs], dtype=np.int32)
        counts = np.array([run[1] for run in runs])
        if counts.sum() == faces:
            return np.repeat(numbers, counts)
        lines = [match[1] for run in runs for match in _FACE.finditer(run[2])]
        polygons, corners = np.repeat(numbers, counts), [len(line.split()) for line in lines]
        if len(corners) != len(polygons):
            return None
        alike = len({len(line.replace(b"/", b" ").split()) for line in lines}) == 1
        if alike and set(corners) == {4}:  # trimesh puts the second halves of all quads after the first halves
            rows = np.concatenate([polygons, polygons])
        else:
            rows = np.repeat(polygons, np.array(corners) - 2)
        return rows if len(rows) == faces else None


def read_mtl(file: bytes) -> list[dict[str, str]]:
    """Return the statements of each material of an MTL file, by keyword; names are in ``name``."""
    found: list[dict[str, str]] = []
    for line in file.replace(b"\r", b"\n").replace(b"\\\n", b" ").split(b"\n"):
        words = _decoded(line.partition(b"#")[0]).split(None, 1)
        if not words:
            continue
        keyword, content = words[0].lower(), words[1] if len(words) > 1 else ""
        if keyword == "newmtl":
            found.append({"name": content.strip()})
        elif found:
            found[-1].setdefault(keyword, content.strip())
    return found


def mtl_material(statements: dict[str, str], locate: Locate) -> Material:
    """Create a material from the statements of an MTL file; invalid numbers are replaced by defaults."""

    def read(keyword: str, default: tuple[float, ...], upper: float = 1.0) -> tuple[Any, ...]:
        found = _numbers(statements.get(keyword, ""), len(default))
        return default if found is None else tuple(np.clip(found, 0, upper).tolist())

    texture, repeat = _texture(statements["map_kd"], locate) if statements.get("map_kd") else (None, _ONCE)
    normal, glow = (_texture(statements[key], locate)[0] if statements.get(key) else None for key in ("norm", "map_ke"))
    opacity = _numbers(statements.get("d", "").replace("-halo", ""), 1)
    if opacity is None and "tr" in statements:
        transparency = _numbers(statements["tr"], 1)
        opacity = None if transparency is None else 1 - transparency
    alpha = 1.0 if opacity is None else float(opacity[0])
    return Material(
        statements["name"],
        (*read("kd", (1.0, 1.0, 1.0)), min(max(alpha, 0.0), 1.0)),
        texture=texture,
        texture_repeat=repeat,
        alpha_mode="blend" if alpha < 1 or "map_d" in statements else "opaque",
        metallic=read("pm", (0.0,))[0],
        roughness=read("pr", (1.0,))[0],
        specular=read("ks", (0.0, 0.0, 0.0)),
        shininess=read("ns", (0.0,), np.inf)[0],
        emission=read("ke", (0.0, 0.0, 0.0) if glow is None else (1.0, 1.0, 1.0), np.inf),
        normal_texture=None if normal is None else replace(normal, color_space="linear"),
        emissive_texture=glow,
        shading="pbr" if _PBR & statements.keys() else "phong",
    )


def _texture(words: str, locate: Locate) -> tuple[Texture, tuple[float, float]]:
    """Parse a map statement, options and a file name that may contain spaces; return the texture and its repetition."""
    remaining, clamp, repeat = words.split(), False, _ONCE
    while len(remaining) > 1 and remaining[0].startswith("-"):
        option = remaining.pop(0).lower()
        if option in _OPTIONS:
            numbers: list[float] = []
            while len(numbers) < _OPTIONS[option] and len(remaining) > 1 and _numbers(remaining[0], 1) is not None:
                numbers.append(float(remaining.pop(0)))
            if option == "-s" and numbers and min(numbers[:2]) >= 0:  # missing values are 1
                repeat = (numbers[0], numbers[1] if len(numbers) > 1 else 1.0)
        elif option in _WORD and len(remaining) > 1:
            clamp |= option == "-clamp" and remaining[0].lower() == "on"
            remaining.pop(0)
    name = " ".join(remaining)
    found = locate(name)
    wrap: Wrap = "clamp" if clamp else "repeat"
    label = str(found) if isinstance(found, Path) else name
    return Texture(b"" if found is None else found, label, wrap, wrap), repeat


def _numbers(text: str, count: int) -> NDArray[np.float64] | None:
    """Return the first `count` finite numbers of a text; None if there are fewer. One of three is repeated."""
    words: Sequence[str] = text.split()[:count]
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError:
        return None
    if count == 3 and len(numbers) == 1:
        numbers = np.repeat(numbers, 3)
    return numbers if len(numbers) == count and np.isfinite(numbers).all() else None


def _decoded(text: bytes) -> str:
    return text.strip().decode("utf-8", errors="replace")
