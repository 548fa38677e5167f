# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors and names of labels on maps and in pictures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import LABEL_COUNT, Label, LabelNames

Color = tuple[int, int, int]

MAP_LEGEND: dict[Label, tuple[str, Color]] = {
    Label.EMPTY: ("not seen", (0, 0, 0)),
    Label.GROUND: ("visible ground", (127, 237, 140)),
    Label.OBSTACLE: ("visible part of an obstacle", (99, 74, 42)),
    Label.OBJECT: ("visible object", (239, 87, 0)),
    Label.HUMAN: ("visible human", (11, 96, 205)),
    Label.ROBOT: ("robot", (181, 181, 181)),
}
"""Meaning and color (red, green, blue; 0 to 255) of each `Label` of a map.

All colors differ by at least 30 in CIELAB, also with missing red, green or blue cones in the simulation of Machado,
Oliveira and Fernandes (2009).
"""

# Step of red, green and blue between candidate colors, and limits of their lightness (L* of CIELAB).
_STEP, _DARKEST, _BRIGHTEST = 17, 25, 92
# From linear sRGB to XYZ, relative to the white D65: IEC 61966-2-1.
_TO_XYZ = np.array([(0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505)])
_TO_XYZ /= _TO_XYZ.sum(axis=1, keepdims=True)


@cache
def _palette() -> NDArray[np.uint8]:
    """Choose colors greedily, each as far as possible from all previous ones, starting from `MAP_LEGEND`."""
    levels = np.arange(0, 256, _STEP)
    choice = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 3)
    light = _to_lab(choice)[:, 0]
    choice = choice[(light >= _DARKEST) & (light <= _BRIGHTEST)]
    chosen = [np.array(color) for _, color in MAP_LEGEND.values()]
    places = _to_lab(choice)
    distance = np.min([np.linalg.norm(places - _to_lab(color), axis=1) for color in chosen], axis=0)
    while len(chosen) < LABEL_COUNT:
        farthest = distance.argmax()
        chosen.append(choice[farthest])
        distance = np.minimum(distance, np.linalg.norm(places - places[farthest], axis=1))
    return np.array(chosen, dtype=np.uint8)


def _to_lab(colors: NDArray[np.integer]) -> NDArray[np.float64]:
    """Convert sRGB, 0 to 255, to the approximately perceptually uniform CIELAB (CIE 015), ``(..., 3)``."""
    parts = colors / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    xyz = linear @ _TO_XYZ.T
    x, y, z = np.moveaxis(np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29), -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def label_colors() -> NDArray[np.uint8]:
    """Return the constant color of every label, red, green and blue, shape ``(256, 3)`` uint8."""
    return _palette().copy()


def legend_of(labels: Iterable[int], names: LabelNames) -> dict[int, tuple[str, Color]]:
    """Return the legend of a map, with the meaning and color of each label."""
    colors = label_colors().tolist()
    legend: dict[int, tuple[str, Color]] = {}
    for number in sorted(map(int, labels)):
        is_custom = names.word(number) not in Label.__members__
        legend[number] = (names.name(number) if is_custom else MAP_LEGEND[Label(number)][0], tuple(colors[number]))
    return legend


def ground_bits(labels: Iterable[int]) -> object:
    """Return the ground labels as a bit mask for kernels, a `warpvis.kernels.maps.labels.GroundLabels`."""
    from warpvis.kernels.maps.labels import GroundLabels

    words = [0] * (LABEL_COUNT // 32)
    for label in labels:
        words[label // 32] |= 1 << label % 32
    return GroundLabels(*words)


def read_classes(
    label_names: Mapping[int, str] | None, ground_labels: Iterable[Label | int | str]
) -> tuple[LabelNames, frozenset[int]]:
    """Parse class names and ground labels; see `floor_map`."""
    names = LabelNames(label_names)
    return names, frozenset(names.numbers(ground_labels, "ground_labels"))
