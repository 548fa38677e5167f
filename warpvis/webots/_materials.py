# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Materials and textures of Webots' Shapes, from their Appearance or PBRAppearance nodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import WarpvisError
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.colors import linear_color
from warpvis.scene.materials import Appearance, Filter, Material, Texture, Wrap
from warpvis.webots._nodes import Node
from warpvis.webots.shapes._coordinates import texture_coordinates
from warpvis.webots.shapes._polygons import Triangles

Find = Callable[[str, Node], Path | None]
"""Finds the file of a node's URL; returns None if the file is not available."""

# Defaults of omitted fields (docs/reference of Webots: material.md and pbrappearance.md).
_DIFFUSE = (0.8, 0.8, 0.8)
_SHININESS = 0.2
_WRAPS: dict[bool, Wrap] = {True: "repeat", False: "clamp"}
_EXPONENT = 128.0
"""Specular exponent for a shininess of 1, as in OpenGL."""


def shape_appearance(shape: Node) -> Node | None:
    """Return the appearance node of a Shape; None if it is missing or invalid."""
    try:
        return shape.node("appearance")
    except WarpvisError:  # does not affect depth
        return None


class Surface(NamedTuple):
    """A Shape's appearance and mesh."""

    appearance: Node | None
    geometry: Node
    mesh: Triangles
    """In the geometry's frame."""
    mirrored: bool
    """Whether its transform to the world reverses the orientation of triangles."""

    def coordinates(self) -> NDArray[np.float32] | None:
        """Return texture coordinates of the triangles' corners; None without a texture or coordinates."""
        if self.appearance is None or _texture_node(self.appearance) is None:
            return None
        try:
            uv = texture_coordinates(self.geometry, *self.mesh, mirrored=self.mirrored)
            change = self.appearance.node("textureTransform")
            return uv if uv is None or change is None else _transformed(uv, change)
        except WarpvisError:  # does not affect depth
            return None


def join_appearances(surfaces: Sequence[Surface], find: Find) -> LazyAppearance | None:
    """Return the lazily loaded appearance of an object that consists of several shapes; None if no shape has any.

    Args:
        surfaces: The shapes, in the order of the object's triangles.
        find: Finds the files of their images.
    """
    return LazyAppearance(partial(_joined, surfaces, find)) if any(item.appearance for item in surfaces) else None


def _joined(surfaces: Sequence[Surface], find: Find) -> Appearance | None:
    numbers: dict[int, int] = {}
    found: list[Material | None] = []
    rows: list[NDArray[np.int32]] = []
    for surface in surfaces:
        node = surface.appearance
        if id(node) not in numbers:
            numbers[id(node)] = len(found)
            found.append(None if node is None else _material(node, find))
        rows.append(np.full(len(surface.mesh[1]), numbers[id(node)], dtype=np.int32))
    if not any(found):
        return None
    parts = [surface.coordinates() for surface in surfaces]
    uv = None
    if any(part is not None for part in parts):
        sizes = [len(row) for row in rows]
        uv = np.concatenate(
            [np.zeros((size, 3, 2)) if part is None else part for part, size in zip(parts, sizes, strict=True)]
        )
    materials = tuple(item or Material() for item in found)
    return Appearance(materials, np.concatenate(rows) if len(found) > 1 else None, uv=uv)


def _material(appearance: Node, find: Find) -> Material | None:
    """Read the material of an appearance node; return None if it has none or cannot be read."""
    try:
        texture = _texture(_texture_node(appearance), find)
        if appearance.type == "PBRAppearance":
            return _pbr(appearance, texture)
        if appearance.type != "Appearance":
            return None
        node = appearance.node("material")
        return _classic(node, texture) if node is not None else None if texture is None else Material(texture=texture)
    except WarpvisError:  # does not affect depth
        return None


def _texture_node(appearance: Node) -> Node | None:
    """Return the ImageTexture of an appearance node; None if it is missing or invalid."""
    try:
        found = appearance.node("baseColorMap" if appearance.type == "PBRAppearance" else "texture")
    except WarpvisError:  # does not affect depth
        return None
    return found if found is not None and found.type == "ImageTexture" and found.texts("url") else None


def _texture(node: Node | None, find: Find) -> Texture | None:
    """Read an ImageTexture (Webots' reference, imagetexture.md)."""
    if node is None:
        return None
    url = node.texts("url")[0]
    file = find(url, node)
    wrap_u, wrap_v = (_WRAPS[node.flag(field, True)] for field in ("repeatS", "repeatT"))
    smooth: Filter = "linear" if node.number("filtering", 4) > 0 else "nearest"
    return Texture(b"" if file is None else file, url if file is None else str(file), wrap_u, wrap_v, smooth)


def _transformed(uv: NDArray[np.float32], change: Node) -> NDArray[np.float32]:
    """Apply a TextureTransform to texture coordinates (src/wren/TextureTransform.cpp).

    Webots translates them, then rotates and scales them about the center; v increases from the image's lower edge.
    """
    center, move = change.vector("center", (0.0, 0.0)), change.vector("translation", (0.0, 0.0))
    angle, scale = change.number("rotation", 0.0), change.vector("scale", (1.0, 1.0))
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return (((uv + move + center) @ rotation.T) * scale - center).astype(np.float32)


def _pbr(node: Node, texture: Texture | None) -> Material:
    strength = max(0.0, node.number("emissiveIntensity", 1.0))
    alpha = 1 - _unit(node.number("transparency", 0.0))
    return Material(
        node.text("name", "") or node.name or "",
        (*_color(node, "baseColor", (1.0, 1.0, 1.0)), alpha),
        "linear",
        texture,
        "blend" if alpha < 1 else "opaque",
        metallic=_unit(node.number("metalness", 1.0)),
        roughness=_unit(node.number("roughness", 0.0)),
        emission=tuple((strength * np.clip(node.vector("emissiveColor", (0.0, 0.0, 0.0)), 0.0, 1.0)).tolist()),
    )


def _classic(node: Node, texture: Texture | None) -> Material:
    """Read a Material; a texture replaces its colors (src/webots/nodes/WbMaterial.cpp)."""
    alpha = 1 - _unit(node.number("transparency", 0.0))
    plain = texture is None
    return Material(
        node.name or "",
        (*(_color(node, "diffuseColor", _DIFFUSE) if plain else (1.0, 1.0, 1.0)), alpha),
        "linear",
        texture,
        "blend" if alpha < 1 else "opaque",
        specular=_color(node, "specularColor", (0.0, 0.0, 0.0)) if plain else (0.0, 0.0, 0.0),
        shininess=_EXPONENT * _unit(node.number("shininess", _SHININESS)) if plain else 0.0,
        emission=_color(node, "emissiveColor", (0.0, 0.0, 0.0)),
    )


def _color(node: Node, field: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
    """Read a color as linear RGB, as Webots converts it (src/wren/PhongMaterial.cpp, PbrMaterial.cpp)."""
    return linear_color(np.clip(node.vector(field, default), 0.0, 1.0))  # type: ignore[return-value]


def _unit(value: float) -> float:
    return float(np.clip(value, 0.0, 1.0))
