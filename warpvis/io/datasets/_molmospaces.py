# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Classes of the objects of MolmoSpaces' houses, which are MJCF, from the ``*_metadata.json`` next to them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from warpvis.core.categories import label_of_category
from warpvis.core.file_content import is_file
from warpvis.core.labels import Label
from warpvis.io.datasets._fields import Fields
from warpvis.scene import FileParts, Part


def with_categories(found: FileParts) -> FileParts:
    """Return the parts of a model with the classes that the house's metadata defines; unchanged without metadata.

    Bodies are those of ``name_map``, else the object's own name. Labels follow the classes, except those of ground.
    """
    path = _metadata_of(found.path)
    if path is None:
        return found
    categories: dict[str, tuple[str, str]] = {}
    objects = Fields.read(path).child("objects")
    for name in objects.values:
        item = objects.child(name)
        word, asset = item.text("category", ""), item.text("asset_id", "")
        for body in {name: None, **item.child("name_map").child("bodies").values}:
            categories[body] = word, asset
    return replace(found, parts=[_described(part, categories) for part in found.parts])


def _described(part: Part, categories: dict[str, tuple[str, str]]) -> Part:
    found = next((categories[name] for name in (*part.aliases, part.name) if name in categories), None)
    if found is None or not found[0]:
        return part
    label = part.label if part.label == Label.GROUND else label_of_category(found[0])
    extras = {**part.extras, "asset_id": found[1]} if found[1] else part.extras
    return replace(part, category=found[0], label=label, extras=extras)


def _metadata_of(path: Path) -> Path | None:
    """Return the metadata of a house: of its name, or of its name without ``_ceiling`` or other endings."""
    words = path.stem.split("_")
    for count in range(len(words), 0, -1):
        place = path.with_name("_".join([*words[:count], "metadata.json"]))
        if is_file(place):
            return place
    return None
