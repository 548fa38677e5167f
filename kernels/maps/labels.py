# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Labels of map cells: which labels are ground, and their precedence where several fall on one cell."""

import warp as wp

from warpvis.kernels.constants import LABEL_EMPTY, LABEL_OBJECT, LABEL_ROBOT

EMPTY = wp.constant(wp.uint8(LABEL_EMPTY))
FIRST_ABOVE = wp.constant(LABEL_OBJECT)
LAST_ABOVE = wp.constant(LABEL_ROBOT)

GroundLabels = wp.types.vector(length=8, dtype=wp.uint32)
"""A bitmask over the 256 labels: 1 for ground."""


@wp.func
def is_ground(ground: GroundLabels, label: wp.uint8) -> bool:
    number = int(label)
    return ((ground[number >> 5] >> wp.uint32(number & 31)) & wp.uint32(1)) != wp.uint32(0)


@wp.func
def precedence(ground: GroundLabels, label: wp.uint8) -> int:
    """Return the order in which labels cover each other: empty, ground, obstacles and user-defined classes, then
    objects, humans and robots; within a kind, the greater number wins. The last 8 bits are the label.
    """
    number = int(label)
    if label == EMPTY or is_ground(ground, label):
        return number
    if number >= FIRST_ABOVE and number <= LAST_ABOVE:
        return 512 + number
    return 256 + number


@wp.func
def label_of(order: int) -> wp.uint8:
    """Return the label that has a precedence."""
    return wp.uint8(order & 255)
