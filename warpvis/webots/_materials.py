# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The base colour of Webots' Shapes: what their Appearance or PBRAppearance says."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import WarpvisError
from warpvis.scene.colors import linear_color
from warpvis.scene.looks import Look
from warpvis.scene.materials import Appearance, Material
from warpvis.webots._nodes import Node

# What Webots takes where a field is left out (docs/reference of Webots: material.md and pbrappearance.md).
_DIFFUSE = (0.8, 0.8, 0.8)
_SHININESS = 0.2
_EXPONENT = 128.0
"""Of a highlight whose shininess is 1, as in OpenGL."""


def shape_appearance(shape: Node) -> Node | None:
    """Return the node that says what a Shape looks like; None without, or where there is none such."""
    try:
        return shape.node("appearance")
    except WarpvisError:  # what is no appearance changes no depth
        return None


def joined_look(appearances: Sequence[Node | None], counts: Sequence[int]) -> Look | None:
    """Remember the appearances of shapes that became one object, of so many faces each; None if none says anything."""
    return Look(partial(_joined, appearances, counts)) if any(appearances) else None


def _joined(appearances: Sequence[Node | None], counts: Sequence[int]) -> Appearance | None:
    numbers: dict[int, int] = {}
    kept: list[Material | None] = []
    rows: list[NDArray[np.int32]] = []
    for node, count in zip(appearances, counts, strict=True):
        if id(node) not in numbers:
            numbers[id(node)] = len(kept)
            kept.append(None if node is None else _material(node))
        rows.append(np.full(count, numbers[id(node)], dtype=np.int32))
    if not any(kept):
        return None
    return Appearance(tuple(item or Material() for item in kept), np.concatenate(rows) if len(kept) > 1 else None)


def _material(look: Node) -> Material | None:
    """Read a material; None where the node says none, or what is no colour."""
    try:
        if look.type == "PBRAppearance":
            return _pbr(look)
        said = look.node("material") if look.type == "Appearance" else None
        return None if said is None else _classic(said)
    except WarpvisError:  # it changes no depth
        return None


def _pbr(look: Node) -> Material:
    strength = max(0.0, look.number("emissiveIntensity", 1.0))
    alpha = 1 - _unit(look.number("transparency", 0.0))
    return Material(
        look.text("name", "") or look.name or "",
        (*_color(look, "baseColor", (1.0, 1.0, 1.0)), alpha),
        "linear",
        alpha_mode="blend" if alpha < 1 else "opaque",
        metallic=_unit(look.number("metalness", 1.0)),
        roughness=_unit(look.number("roughness", 0.0)),
        emission=tuple((strength * np.clip(look.vector("emissiveColor", (0.0, 0.0, 0.0)), 0.0, 1.0)).tolist()),
    )


def _classic(said: Node) -> Material:
    alpha = 1 - _unit(said.number("transparency", 0.0))
    return Material(
        said.name or "",
        (*_color(said, "diffuseColor", _DIFFUSE), alpha),
        "linear",
        alpha_mode="blend" if alpha < 1 else "opaque",
        specular=_color(said, "specularColor", (0.0, 0.0, 0.0)),
        shininess=_EXPONENT * _unit(said.number("shininess", _SHININESS)),
        emission=_color(said, "emissiveColor", (0.0, 0.0, 0.0)),
    )


def _color(node: Node, field: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
    """Read a colour; Webots turns it into a linear one (src/wren/PhongMaterial.cpp, PbrMaterial.cpp)."""
    return linear_color(np.clip(node.vector(field, default), 0.0, 1.0))  # type: ignore[return-value]


def _unit(value: float) -> float:
    return float(np.clip(value, 0.0, 1.0))
