# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The colours and textures of Webots' Shapes: what their Appearance or PBRAppearance says."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import WarpvisError
from warpvis.scene.colors import linear_color
from warpvis.scene.looks import Look
from warpvis.scene.materials import Appearance, Filter, Material, Texture, Wrap
from warpvis.webots._nodes import Node
from warpvis.webots.shapes._coordinates import texture_coordinates
from warpvis.webots.shapes._polygons import Triangles

Find = Callable[[str, Node], Path | None]
"""Finds the file of a url that a node names; None if it is not at hand."""

# What Webots takes where a field is left out (docs/reference of Webots: material.md and pbrappearance.md).
_DIFFUSE = (0.8, 0.8, 0.8)
_SHININESS = 0.2
_WRAPS: dict[bool, Wrap] = {True: "repeat", False: "clamp"}
_EXPONENT = 128.0
"""Of a highlight whose shininess is 1, as in OpenGL."""


def shape_appearance(shape: Node) -> Node | None:
    """Return the node that says what a Shape looks like; None without, or where there is none such."""
    try:
        return shape.node("appearance")
    except WarpvisError:  # what is no appearance changes no depth
        return None


class Surface(NamedTuple):
    """What a Shape looks like, and what of."""

    appearance: Node | None
    geometry: Node
    mesh: Triangles
    """In the geometry's frame."""
    turned_round: bool
    """Whether the corners of its triangles go the other way round where it is."""

    def coordinates(self) -> NDArray[np.float32] | None:
        """Return texture coordinates of the corners of its triangles; None where it has no texture, or they none."""
        if self.appearance is None or _texture_node(self.appearance) is None:
            return None
        try:
            uv = texture_coordinates(self.geometry, *self.mesh, turned_round=self.turned_round)
            change = self.appearance.node("textureTransform")
            return uv if uv is None or change is None else _transformed(uv, change)
        except WarpvisError:  # it changes no depth
            return None


def joined_look(surfaces: Sequence[Surface], find: Find) -> Look | None:
    """Remember what shapes look like that became one object; None if none says anything.

    Args:
        surfaces: The shapes, in the order of the object's triangles.
        find: Finds the images that they name.
    """
    return Look(partial(_joined, surfaces, find)) if any(item.appearance for item in surfaces) else None


def _joined(surfaces: Sequence[Surface], find: Find) -> Appearance | None:
    numbers: dict[int, int] = {}
    kept: list[Material | None] = []
    rows: list[NDArray[np.int32]] = []
    for surface in surfaces:
        node = surface.appearance
        if id(node) not in numbers:
            numbers[id(node)] = len(kept)
            kept.append(None if node is None else _material(node, find))
        rows.append(np.full(len(surface.mesh[1]), numbers[id(node)], dtype=np.int32))
    if not any(kept):
        return None
    parts = [surface.coordinates() for surface in surfaces]
    uv = None
    if any(part is not None for part in parts):
        sizes = [len(row) for row in rows]
        uv = np.concatenate(
            [np.zeros((size, 3, 2)) if part is None else part for part, size in zip(parts, sizes, strict=True)]
        )
    materials = tuple(item or Material() for item in kept)
    return Appearance(materials, np.concatenate(rows) if len(kept) > 1 else None, uv=uv)


def _material(look: Node, find: Find) -> Material | None:
    """Read a material; None where the node says none, or what is no colour."""
    try:
        texture = _texture(_texture_node(look), find)
        if look.type == "PBRAppearance":
            return _pbr(look, texture)
        if look.type != "Appearance":
            return None
        said = look.node("material")
        return _classic(said, texture) if said is not None else None if texture is None else Material(texture=texture)
    except WarpvisError:  # it changes no depth
        return None


def _texture_node(look: Node) -> Node | None:
    """Return the ImageTexture of an appearance."""
    try:
        found = look.node("baseColorMap" if look.type == "PBRAppearance" else "texture")
    except WarpvisError:  # likewise
        return None
    return found if found is not None and found.type == "ImageTexture" and found.texts("url") else None


def _texture(said: Node | None, find: Find) -> Texture | None:
    """Read an ImageTexture (Webots' reference, imagetexture.md)."""
    if said is None:
        return None
    url = said.texts("url")[0]
    file = find(url, said)
    wrap_u, wrap_v = (_WRAPS[said.flag(field, True)] for field in ("repeatS", "repeatT"))
    smooth: Filter = "linear" if said.number("filtering", 4) > 0 else "nearest"
    return Texture(b"" if file is None else file, url if file is None else str(file), wrap_u, wrap_v, smooth)


def _transformed(uv: NDArray[np.float32], change: Node) -> NDArray[np.float32]:
    """Change texture coordinates as a TextureTransform says (src/wren/TextureTransform.cpp).

    Webots moves them, turns and stretches them about the center, whose v counts upwards from the image's lower edge.
    """
    center, move = change.vector("center", (0.0, 0.0)), change.vector("translation", (0.0, 0.0))
    angle, scale = change.number("rotation", 0.0), change.vector("scale", (1.0, 1.0))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return (((uv + move + center) @ turn.T) * scale - center).astype(np.float32)


def _pbr(look: Node, texture: Texture | None) -> Material:
    strength = max(0.0, look.number("emissiveIntensity", 1.0))
    alpha = 1 - _unit(look.number("transparency", 0.0))
    return Material(
        look.text("name", "") or look.name or "",
        (*_color(look, "baseColor", (1.0, 1.0, 1.0)), alpha),
        "linear",
        texture,
        "blend" if alpha < 1 else "opaque",
        metallic=_unit(look.number("metalness", 1.0)),
        roughness=_unit(look.number("roughness", 0.0)),
        emission=tuple((strength * np.clip(look.vector("emissiveColor", (0.0, 0.0, 0.0)), 0.0, 1.0)).tolist()),
    )


def _classic(said: Node, texture: Texture | None) -> Material:
    """Read a Material; where there is a texture, that stands for its colours (src/webots/nodes/WbMaterial.cpp)."""
    alpha = 1 - _unit(said.number("transparency", 0.0))
    plain = texture is None
    return Material(
        said.name or "",
        (*(_color(said, "diffuseColor", _DIFFUSE) if plain else (1.0, 1.0, 1.0)), alpha),
        "linear",
        texture,
        "blend" if alpha < 1 else "opaque",
        specular=_color(said, "specularColor", (0.0, 0.0, 0.0)) if plain else (0.0, 0.0, 0.0),
        shininess=_EXPONENT * _unit(said.number("shininess", _SHININESS)) if plain else 0.0,
        emission=_color(said, "emissiveColor", (0.0, 0.0, 0.0)),
    )


def _color(node: Node, field: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
    """Read a colour; Webots turns it into a linear one (src/wren/PhongMaterial.cpp, PbrMaterial.cpp)."""
    return linear_color(np.clip(node.vector(field, default), 0.0, 1.0))  # type: ignore[return-value]


def _unit(value: float) -> float:
    return float(np.clip(value, 0.0, 1.0))
