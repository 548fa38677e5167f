# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The classes of a pixel or a point."""

from __future__ import annotations

import enum

from warpvis.errors import SceneError


class Label(enum.IntEnum):
    """What a pixel shows. The order is the order of precedence where several fall on one cell of a map."""

    EMPTY = 0
    """No depth, or beyond the maximum range."""
    GROUND = 1
    """The floor; in a measured image every point lower than `sigma`."""
    OBSTACLE = 2
    """Any other surface."""
    OBJECT = 3
    """A thing the agents are interested in."""
    HUMAN = 4
    """A person."""
    ROBOT = 5
    """A robot."""

    @classmethod
    def parse(cls, value: Label | int | str) -> Label:
        """Label from itself, its number or its name in any case.

        Raises:
            SceneError: There is no such label.
        """
        try:
            return cls[value.upper()] if isinstance(value, str) else cls(value)
        except (KeyError, ValueError):
            names = ", ".join(f"{label.name} ({label.value})" for label in cls)
            raise SceneError(f"label must be one of {names}, got {value!r}") from None


class Visibility(enum.IntEnum):
    """Whether a point can be seen, and if not, why."""

    OUT_OF_VIEW = 0
    """Behind the camera or outside the image."""
    TOO_NEAR = 1
    """In the image, nearer than the camera measures."""
    TOO_FAR = 2
    """In the image, farther than the camera measures."""
    OCCLUDED = 3
    """In the image and in range, behind something."""
    VISIBLE = 4
    """Seen."""
    UNKNOWN = 5
    """In the image and in range, where nothing was measured."""
