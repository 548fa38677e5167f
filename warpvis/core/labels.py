# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Name the classes of a pixel and of a point."""

from __future__ import annotations

import enum
import fnmatch
from collections.abc import Iterable, Mapping

from warpvis.core.checks import check_mapping
from warpvis.errors import SceneError
from warpvis.kernels import constants


class Label(enum.IntEnum):
    """What a pixel shows. The order is the order of precedence where several fall on one cell of a map."""

    EMPTY = constants.LABEL_EMPTY
    """No depth, or beyond the maximum range."""
    GROUND = constants.LABEL_GROUND
    """The floor; in a measured image every point lower than `ground_tolerance`."""
    OBSTACLE = constants.LABEL_OBSTACLE
    """Any other surface."""
    OBJECT = constants.LABEL_OBJECT
    """A thing the agents are interested in."""
    HUMAN = constants.LABEL_HUMAN
    """A person."""
    ROBOT = constants.LABEL_ROBOT
    """A robot."""

    @classmethod
    def parse(cls, value: Label | int | str) -> Label:
        """Return a label from itself, its number or its name in any case.

        Raises:
            SceneError: There is no such label.
        """
        try:
            return cls[value.upper()] if isinstance(value, str) else cls(value)
        except (KeyError, ValueError, TypeError):
            names = ", ".join(f"{label.name} ({label.value})" for label in cls)
            raise SceneError(f"label must be one of {names}, got {value!r}") from None


class Visibility(enum.IntEnum):
    """Whether a point can be seen, and if not, why."""

    OUT_OF_VIEW = constants.POINT_OUT_OF_VIEW
    """Behind the camera or outside the image."""
    TOO_NEAR = constants.POINT_TOO_NEAR
    """In the image, nearer than the camera measures."""
    TOO_FAR = constants.POINT_TOO_FAR
    """In the image, farther than the camera measures."""
    OCCLUDED = constants.POINT_OCCLUDED
    """In the image and in range, behind something."""
    VISIBLE = constants.POINT_VISIBLE
    """Seen."""
    UNKNOWN = constants.POINT_UNKNOWN
    """In the image and in range, where nothing was measured."""


class LabelPatterns:
    """Labels that a user gives to the objects of a file, by names or patterns of names."""

    def __init__(self, labels: Mapping[str, Label | int | str]) -> None:
        """Read them.

        Raises:
            SceneError: A label is none.
        """
        check_mapping(labels, "labels", SceneError)
        bad = [pattern for pattern in labels if not isinstance(pattern, str)]
        if bad:
            raise SceneError(f"labels must be given to names or patterns of names, got {bad[0]!r}")
        self._patterns = {pattern: Label.parse(label) for pattern, label in labels.items()}
        self._unused = set(self._patterns)

    def label(self, name: str, own: Label | int | str, aliases: Iterable[str] = ()) -> Label | int | str:
        """Return what the last pattern says that fits an object's name or an alias; its own label if none does."""
        label, names = own, (name, *aliases)
        for pattern, given in self._patterns.items():
            if any(fnmatch.fnmatchcase(one, pattern) for one in names):
                label = given
                self._unused.discard(pattern)
        return label

    def require_used(self, names: Iterable[str], path: object) -> None:
        """Raise `SceneError` if a pattern fits none of a file's objects."""
        if self._unused:
            some = ", ".join(map(repr, list(names)[:10]))
            wrong = ", ".join(map(repr, sorted(self._unused)))
            raise SceneError(f"labels for {wrong} fit no object of {path}, which has {some}")
