# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Appearances that stand in for Webots' appearance PROTOs and for objects without a file; see `_library`.

Most of these PROTOs (Webots' user guide, "Appearances") are a PBRAppearance with a texture, which is multiplied by the
field `colorOverride` or `baseColor`; the stand-in has the mean color of that texture, and no maps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import FileFormatError
from warpvis.scene.materials import linear_color, screen_color
from warpvis.webots._nodes import Node, Value, new_node
from warpvis.webots.protos._library import FINISHES, OBJECTS, UNKNOWN, VARIANTS, WHITE, Finish, texture_finish

_COLOR_FIELDS = ("colorOverride", "baseColor", "color", "diffuseColor", "mainColor")
_COPIED = ("IBLStrength", "emissiveColor", "emissiveIntensity", "transparency")
"""Fields that appearance PROTOs pass on to their PBRAppearance."""


def stand_in_appearance(node: Node) -> Node | None:
    """Build a PBRAppearance with the mean color of an appearance PROTO; None for an unknown PROTO without a color."""
    finish, factor = FINISHES.get(node.type), field_color(node)
    if finish is None and factor is None:
        return None
    finish = finish or Finish(WHITE)
    field, colors = VARIANTS.get(node.type, ("", {}))
    texture = np.array(linear_color(colors.get(_text(node, field), finish.color))) / linear_color(finish.factor)
    mixed = texture * linear_color(finish.factor if factor is None else factor)
    found = plain_appearance(
        node, screen_color(np.clip(mixed, 0.0, 1.0)), metalness=finish.metalness, roughness=finish.roughness
    )
    if node.type == "ReflectiveSurface" and "metalness" in node.fields:
        found.fields["metalness"] = node.fields["metalness"]
    found.fields.update({name: node.fields[name] for name in _COPIED if name in node.fields})
    return found


def untextured_appearance(appearance: Node, url: str) -> Node | None:
    """Build a copy of an appearance node whose texture is missing, with its mean color; None if that is unknown.

    As in Webots, the texture multiplies the color of a PBRAppearance and replaces that of a Material.
    """
    finish = texture_finish(url)
    if finish is None:
        return None
    fields = {name: value for name, value in appearance.fields.items() if name not in ("baseColorMap", "texture")}
    if appearance.type == "Appearance":
        fields["material"] = new_node(appearance, "Material", {"diffuseColor": [*finish.color]})
        return new_node(appearance, appearance.type, fields, appearance.name)
    factor = np.clip(appearance.vector("baseColor", WHITE), 0.0, 1.0)
    fields["baseColor"] = [*screen_color(np.array(linear_color(finish.color)) * linear_color(factor))]
    for field, value in (("roughness", finish.roughness), ("metalness", finish.metalness)):
        if f"{field}Map" in fields:  # maps replace numbers; those that are found replace this one, too
            fields[field] = [value]
    return new_node(appearance, appearance.type, fields, appearance.name)


def field_color(node: Node) -> NDArray[np.float64] | None:
    """Return the color in the fields of an instance, sRGB from 0 to 1; None if it has none.

    Fields like ``color`` and ``colorOverride`` come first, then the first one whose name ends in "Color".
    """
    others = [field for field in node.fields if field.endswith("Color") and field != "emissiveColor"]
    for field in (*_COLOR_FIELDS, *others):
        try:
            values = node.numbers(field)
        except FileFormatError:
            continue
        if len(values) == 3:
            return np.clip(values, 0.0, 1.0)
    return None


def plain_appearance(like: Node, color: tuple[float, ...], **numbers: float) -> Node:
    """Build a PBRAppearance of one sRGB color, matt by default; `numbers` are other fields."""
    fields: dict[str, Value] = {"baseColor": [*color], "metalness": [0.0], "roughness": [1.0]}
    return new_node(like, "PBRAppearance", fields | {name: [value] for name, value in numbers.items()})


def field_appearance(node: Node, field: str, default: str = "") -> Node | None:
    """Return the appearance in a field of an instance; without that field, an instance of the PROTO `default`."""
    if field in node.fields:
        try:
            return node.node(field)
        except FileFormatError:
            return None
    return new_node(node, default, {}) if default else None


def object_appearance(node: Node) -> Node | None:
    """Return the appearance of all shapes of an object without a file.

    It is that of its field `appearance`, the color in a field, the first other appearance in its fields, the default of
    `OBJECTS`, or `UNKNOWN`.
    """
    color = field_color(node)
    if "appearance" in node.fields:
        return field_appearance(node, "appearance")
    if color is not None:
        return plain_appearance(node, tuple(color.tolist()), roughness=0.5)
    for field in node.fields:
        if field.endswith("Appearance"):
            found = field_appearance(node, field)
            if found is not None:
                return found
    default = OBJECTS.get(node.type.removesuffix("Simple"), UNKNOWN)
    return new_node(node, default, {}) if isinstance(default, str) else plain_appearance(node, default, roughness=0.5)


def _text(node: Node, field: str) -> str:
    try:
        return node.text(field, "")
    except FileFormatError:
        return ""
