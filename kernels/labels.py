# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Labels on maps: which are ground, and which of several that fall on one cell it shows."""

import warp as wp

from warpvis.kernels.constants import LABEL_EMPTY, LABEL_OBJECT, LABEL_ROBOT

EMPTY = wp.constant(wp.uint8(LABEL_EMPTY))
FIRST_ABOVE = wp.constant(LABEL_OBJECT)
LAST_ABOVE = wp.constant(LABEL_ROBOT)

GroundLabels = wp.types.vector(length=8, dtype=wp.uint32)
"""A bit for each of the 256 labels: whether it is ground."""


@wp.func
def is_ground(ground: GroundLabels, label: wp.uint8) -> bool:
    number = int(label)
    return ((ground[number >> 5] >> wp.uint32(number & 31)) & wp.uint32(1)) != wp.uint32(0)


@wp.func
def precedence(ground: GroundLabels, label: wp.uint8) -> int:
    """Order in which labels cover each other: nothing, ground, obstacles and classes of users' own, then objects,
    humans and robots; of one kind, the greater number. Its last 8 bits are the label.
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
