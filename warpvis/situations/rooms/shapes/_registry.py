# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The table of categories: how a shape is built, in which sizes and colors, and where it is placed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

from warpvis.scene.materials import Appearance
from warpvis.situations.rooms.shapes._builder import Shape, ShapeBuilder
from warpvis.situations.rooms.shapes._colors import COLORS

Mount = Literal["floor", "support", "wall", "ceiling"]
"""Where items of a category are: on the floor, on other items, on a wall (x = 0 touches it), or below the ceiling."""

EVERY_COLOR = tuple(COLORS)
BRIGHT = ("red", "orange", "yellow", "green", "blue", "purple", "pink", "white", "turquoise")
WOOD = ("brown", "beige", "white", "black", "gray")
FABRIC = ("gray", "beige", "blue", "green", "brown", "red", "turquoise", "black")


@dataclass(frozen=True)
class Category:
    """A category of items."""

    name: str
    build: Callable[..., None]
    """Adds the pieces to a `ShapeBuilder`; further arguments are the shape's parameters."""
    variants: tuple[Mapping[str, Any], ...]
    """Parameters to choose from."""
    colors: tuple[str, ...]
    mount: Mount
    movable: bool
    access: float
    """Depth of the floor in front of it that other furniture leaves free [m]."""


CATEGORIES: dict[str, Category] = {}
"""All categories by name."""


def category(
    name: str,
    *variants: Mapping[str, Any],
    colors: Sequence[str] = WOOD,
    mount: Mount = "floor",
    movable: bool = False,
    access: float = 0.0,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that registers a function as the shape of a category."""

    def register(build: Callable[..., None]) -> Callable[..., None]:
        CATEGORIES[name] = Category(name, build, variants or ({},), tuple(colors), mount, movable, access)
        return build

    return register


def get_shape(name: str, parameters: Mapping[str, Any]) -> Shape:
    """Return the shape of a category with parameters; equal ones are the same object."""
    return _built(name, tuple(sorted(parameters.items())))


@lru_cache(maxsize=4096)
def _built(name: str, parameters: tuple[tuple[str, Any], ...]) -> Shape:
    builder = ShapeBuilder()
    CATEGORIES[name].build(builder, **dict(parameters))
    return builder.finish(name, dict(parameters))


@lru_cache(maxsize=8192)
def get_appearance(shape: Shape, color: str) -> Appearance:
    """Return the appearance of a shape in a color; equal ones are the same object."""
    return Appearance(face_colors=shape.face_colors(color), normals=shape.normals)
