# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The scene of a room: floor, walls with openings, ceiling, items, lights."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import Label, LabelRules
from warpvis.core.types import DeviceLike
from warpvis.scene import FileParts, Part, Scene
from warpvis.scene.lights import Background, Light
from warpvis.scene.materials import Appearance, Material
from warpvis.situations.rooms._boxes import Box
from warpvis.situations.rooms._items import RoomItem, RoomLight
from warpvis.situations.rooms._outline import Opening, Outline
from warpvis.situations.rooms.shapes import CATEGORIES
from warpvis.situations.rooms.shapes._colors import COLORS, MATERIALS

SLAB = 0.1
"""Thickness of floor and ceiling [m]."""
_FRAME = 0.05
_LEAF = 0.04
_ON_FLOOR = frozenset("ball,teddy bear,toy car,toy blocks,box,crate,basket,bucket,suitcase,trash bin".split(","))
"""Categories of objects that stand on the floor; other furniture is an obstacle."""

_CUBE = np.array([[x, y, z] for z in (0, 1) for y in (-1, 1) for x in (-1, 1)], dtype=float)
_CUBE_FACES = np.array(
    [
        [0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4],
        [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5],
    ]
)  # fmt: skip


def label_of(category: str) -> Label:
    """Return the label of an item of a category."""
    if category == "rug":
        return Label.GROUND
    is_object = CATEGORIES[category].mount == "support" or category in _ON_FLOOR
    return Label.OBJECT if is_object else Label.OBSTACLE


def mesh_of(boxes: Sequence[Box]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return the triangles of boxes."""
    vertices = []
    for box in boxes:
        u, v = _CUBE[:, 0] * box.half_x, _CUBE[:, 1] * box.half_y
        z = box.low + _CUBE[:, 2] * (box.high - box.low)
        vertices.append(np.column_stack([box.x + box.cos * u - box.sin * v, box.y + box.sin * u + box.cos * v, z]))
    faces = np.concatenate([_CUBE_FACES + 8 * number for number in range(len(boxes))])
    return np.concatenate(vertices), faces.astype(np.int32)


def wall_boxes(outline: Outline, index: int) -> list[Box]:
    """Return the boxes of a wall beside, below and above its openings; walls do not overlap each other."""
    wall, thickness = outline.walls[index], outline.thickness
    low, high = -SLAB, outline.height + SLAB
    # At its end, a wall turns left at a convex corner and extends to the outer face of the next one; at the corner of
    # an L that is not convex, the next wall starts behind this one.
    after, before = outline.walls[(index + 1) % len(outline.walls)], outline.walls[index - 1]
    turns_left = wall.dx * after.dy - wall.dy * after.dx > 0
    came_left = before.dx * wall.dy - before.dy * wall.dx > 0
    end = wall.length + (thickness if turns_left else 0.0)
    position = 0.0 if came_left else thickness
    boxes = []
    openings = sorted((o for o in outline.openings if o.wall == index), key=lambda o: o.start)
    for opening in openings:
        boxes.append(wall.strip(position, opening.start, -thickness, low, high))
        stop = opening.start + opening.width
        # Below a door, the floor covers the wall.
        boxes.append(wall.strip(opening.start, stop, -thickness, low, opening.low or -SLAB / 2))
        boxes.append(wall.strip(opening.start, stop, -thickness, opening.high, high))
        position = stop
    return [*boxes, wall.strip(position, end, -thickness, low, high)]


def opening_boxes(outline: Outline, opening: Opening) -> list[Box]:
    """Return the frame of a window, or the frame and the leaf of a door, within the wall or outside of it."""
    wall, thickness = outline.walls[opening.wall], outline.thickness
    start, stop = opening.start, opening.start + opening.width

    def bar(first: float, last: float, low: float, high: float) -> Box:
        x, y = wall.point((first + last) / 2, -thickness / 2)
        return Box(x, y, wall.dx, wall.dy, (last - first) / 2, _LEAF / 2, low, high)

    low, high = opening.low, opening.high
    frame = [bar(start, start + _FRAME, low, high), bar(stop - _FRAME, stop, low, high)]
    frame.append(bar(start + _FRAME, stop - _FRAME, high - _FRAME, high))
    if opening.kind == "window":
        middle = (start + stop) / 2
        frame.append(bar(start + _FRAME, stop - _FRAME, low, low + _FRAME))
        frame.append(bar(middle - _FRAME / 2, middle + _FRAME / 2, low + _FRAME, high - _FRAME))
    elif opening.is_open:
        # The leaf has turned by 90 degrees about its hinge, outward.
        width = opening.width - 2 * _FRAME
        x, y = wall.point(start + _FRAME / 2, -thickness - width / 2 - 0.02)
        frame.append(Box(x, y, wall.dy, -wall.dx, width / 2, _LEAF / 2, 0.0, high - _FRAME))
    else:
        frame.append(bar(start + _FRAME, stop - _FRAME, 0.0, high - _FRAME))
    return frame


def slab_boxes(outline: Outline, low: float, high: float) -> list[Box]:
    """Return boxes that cover the floor and the walls' plan between two heights."""
    thickness, boxes = outline.thickness - 0.01, []  # the walls' outer faces are not coplanar with its sides
    x0, y0, x1, y1 = outline.bounds
    for a, b, c, d in outline.rectangles:
        left, right = a - thickness * (a == x0), c + thickness * (c == x1)
        lower, upper = b - thickness * (b == y0), d + thickness * (d == y1)
        boxes.append(
            Box((left + right) / 2, (lower + upper) / 2, 1.0, 0.0, (right - left) / 2, (upper - lower) / 2, low, high)
        )
    return boxes


@lru_cache(maxsize=64)
def _plain(word: str) -> Appearance:
    """Return the appearance of a uniform color or material."""
    color = COLORS.get(word) or MATERIALS[word]
    red, green, blue = (channel / 255 for channel in color)
    return Appearance((Material(base_color=(red, green, blue, 1.0)),))


def _structure(outline: Outline, colors: tuple[str, str], *, ceiling: bool) -> Iterator[Part]:
    """Yield the parts of floor, walls, openings and ceiling."""
    wall_color, floor_material = colors
    floor = mesh_of(slab_boxes(outline, -SLAB, 0.0))
    yield Part("floor", floor, Label.GROUND, category="floor", appearance=_plain(floor_material))
    for index in range(len(outline.walls)):
        mesh = mesh_of(wall_boxes(outline, index))
        yield Part(f"wall_{index + 1}", mesh, category="wall", appearance=_plain(wall_color))
    for opening in outline.openings:
        mesh = mesh_of(opening_boxes(outline, opening))
        yield Part(opening.name, mesh, category=opening.kind, appearance=_plain("frame"))
    if ceiling:
        mesh = mesh_of(slab_boxes(outline, outline.height, outline.height + SLAB))
        yield Part("ceiling", mesh, category="ceiling", appearance=_plain("ceiling"))


def build_scene(
    outline: Outline,
    items: Sequence[RoomItem],
    lamps: Sequence[RoomLight],
    colors: tuple[str, str],
    device: DeviceLike,
    up: Literal["z", "y"],
    *,
    ceiling: bool,
    movable: bool = True,
) -> Scene:
    """Return the scene of a room; see `Room.build`."""
    parts = list(_structure(outline, colors, ceiling=ceiling))
    for item in items:
        if not ceiling and item.support == "ceiling":
            continue
        parts.append(
            Part(
                item.name,
                item.mesh,
                label_of(item.category),
                np.array(item.pose),
                movable=movable and item.movable,
                category=item.category,
                appearance=item.appearance,
            )
        )
    lights = [Light("ambient", "daylight", color=(0.42, 0.42, 0.42), ambient=(0.42, 0.42, 0.42), color_space="linear")]
    lights += [
        Light(
            "point",
            f"lamp_{number + 1}",
            lamp.position,
            color=lamp.color,
            attenuation=(1.0, 0.0, 0.12),
            color_space="linear",
            radius=0.15,
        )
        for number, lamp in enumerate(lamps)
    ]
    sky = Background(color=(0.62, 0.78, 0.92))
    found = FileParts(Path("room"), parts, up="z", lights=tuple(lights), background=sky)
    scene = Scene(device=device, up=up)
    scene.add_parts(found, LabelRules(), movable=any(part.movable for part in parts))
    return scene
