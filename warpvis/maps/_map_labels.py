# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Labels on maps and in pictures: which are ground, in which colours they are shown, and what they are called."""

from __future__ import annotations

import colorsys
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import LABEL_COUNT, Label, LabelNames

Color = tuple[int, int, int]

MAP_LEGEND: dict[Label, tuple[str, Color]] = {
    Label.EMPTY: ("not seen", (0, 0, 0)),
    Label.GROUND: ("visible ground", (76, 175, 80)),
    Label.OBSTACLE: ("visible part of an obstacle", (141, 95, 55)),
    Label.OBJECT: ("visible object", (229, 57, 53)),
    Label.HUMAN: ("visible human", (41, 98, 255)),
    Label.ROBOT: ("robot", (158, 158, 158)),
}
"""What each `Label` of a map means, and the colour (red, green, blue; 0 to 255) it is shown in."""

# A turn by the golden ratio from one class to the next keeps any run of them apart; these are told by brightness, too.
_TURN = 0.6180339887498949
_SHADES = ((0.85, 0.95), (0.55, 0.75), (0.95, 0.60), (0.40, 0.95))


def label_colors() -> NDArray[np.uint8]:
    """Return the colour of every label, red, green and blue, shape ``(256, 3)``: always the same for a number."""
    colors = [tuple(map(round, 255 * np.array(_shade(number)))) for number in range(LABEL_COUNT)]
    for label, (_, color) in MAP_LEGEND.items():
        colors[label] = color
    return np.array(colors, dtype=np.uint8)


def _shade(number: int) -> tuple[float, float, float]:
    return colorsys.hsv_to_rgb(number * _TURN % 1.0, *_SHADES[number % len(_SHADES)])


def legend_of(labels: Iterable[int], names: LabelNames) -> dict[int, tuple[str, Color]]:
    """Make the legend of a map with these labels: what each is called, and its colour."""
    colors = label_colors().tolist()
    legend: dict[int, tuple[str, Color]] = {}
    for number in sorted(map(int, labels)):
        own = names.word(number) not in Label.__members__
        legend[number] = (names.name(number) if own else MAP_LEGEND[Label(number)][0], tuple(colors[number]))
    return legend


def ground_bits(labels: Iterable[int]) -> object:
    """Return what kernels know of ground: a bit for every label, as `warpvis.kernels.labels.GroundLabels`."""
    from warpvis.kernels.labels import GroundLabels

    words = [0] * (LABEL_COUNT // 32)
    for label in labels:
        words[label // 32] |= 1 << label % 32
    return GroundLabels(*words)


def read_classes(
    label_names: Mapping[int, str] | None, ground_labels: Iterable[Label | int | str]
) -> tuple[LabelNames, frozenset[int]]:
    """Check the names of classes, and which are ground; see `floor_map`.

    Raises:
        SceneError: They are none.
    """
    names = LabelNames(label_names)
    return names, frozenset(names.numbers(ground_labels, "ground_labels"))
