# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Define the classes of pixels and the visibility states of points."""

from __future__ import annotations

import enum
from collections.abc import Iterable, Iterator, Mapping

from warpvis.core.checks import as_items, check_mapping, is_whole, truncate
from warpvis.errors import SceneError
from warpvis.kernels import constants

LABEL_COUNT = 256
"""Number of classes: label images are uint8."""

_MAX_LISTED = 12


class Label(enum.IntEnum):
    """Class of a pixel: the classes that every scene has. `Scene.label_names` also contains user-defined classes.

    If several classes fall into one map cell, OBJECT, HUMAN and ROBOT take precedence over OBSTACLE and user-defined
    classes, and these over EMPTY and ground (`Scene.ground_labels`). Within such a group, the greatest value does.
    """

    EMPTY = constants.LABEL_EMPTY
    """No depth, or beyond the maximum range."""
    GROUND = constants.LABEL_GROUND
    """The floor; in a measured image every point lower than `ground_tolerance`."""
    OBSTACLE = constants.LABEL_OBSTACLE
    """Any other surface."""
    OBJECT = constants.LABEL_OBJECT
    """An object of interest to the agents."""
    HUMAN = constants.LABEL_HUMAN
    """A person."""
    ROBOT = constants.LABEL_ROBOT
    """A robot."""

    @classmethod
    def parse(cls, value: Label | int | str) -> Label:
        """Return a label from itself, its number or its name in any case."""
        try:
            return cls[value.upper()] if isinstance(value, str) else cls(value)
        except (KeyError, ValueError, TypeError):
            names = ", ".join(f"{label.name} ({label.value})" for label in cls)
            raise SceneError(f"label must be one of {names}, got {value!r}") from None


class Visibility(enum.IntEnum):
    """Whether a point is visible, and if not, the reason."""

    OUT_OF_VIEW = constants.POINT_OUT_OF_VIEW
    """Behind the camera or outside the image."""
    TOO_NEAR = constants.POINT_TOO_NEAR
    """In the image, but nearer than the camera's minimum depth."""
    TOO_FAR = constants.POINT_TOO_FAR
    """In the image, but farther than the camera's maximum depth."""
    OCCLUDED = constants.POINT_OCCLUDED
    """In the image and in range, but behind a surface."""
    VISIBLE = constants.POINT_VISIBLE
    """Visible."""
    UNKNOWN = constants.POINT_UNKNOWN
    """In the image and in range, but at a pixel without a measurement."""


_GREATEST = max(Label)


class LabelNames(Mapping[int, str]):
    """Names of pixel classes by their numbers from 0 to 255; initially those of `Label`.

    This is a mapping in which names can be added or changed: ``names[40] = "road"``. Numbers without a name are
    classes, too, and are displayed as ``label 40``.
    """

    def __init__(self, names: Mapping[int, str] | None = None) -> None:
        """Initialize with the names of `Label`, and add the given names."""
        self._names = {label.value: label.name.lower() for label in Label}
        if names is not None:
            self.update(names)

    def update(self, names: Mapping[int, str]) -> None:
        """Add or change names. If one is invalid, none is changed.

        Raises:
            SceneError: If a number or a name is invalid, or two numbers have the same name.
        """
        new = dict(self._names)
        for number, name in check_mapping(names, "label_names", SceneError).items():
            new[_check_number(number)] = _check_name(name, number)
        numbers: dict[str, int] = {}
        for number, name in new.items():
            first = numbers.setdefault(name.casefold(), number)
            if first != number:
                raise SceneError(f"label_names must be different names, got {name!r} for {first} and for {number}")
        self._names = dict(sorted(new.items()))

    def __setitem__(self, number: int, name: str) -> None:
        self.update({number: name})

    def __getitem__(self, number: int) -> str:
        return self._names[number]

    def __iter__(self) -> Iterator[int]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __repr__(self) -> str:
        return f"LabelNames({self._names})"

    def number(self, label: Label | int | str) -> int:
        """Return the number of a class, given its number or its name in any case; a `Label` if it is one of them."""
        number: int | None = None
        if isinstance(label, str):
            folded = label.strip().casefold()
            number = next((number for number, name in self._names.items() if name.casefold() == folded), None)
            number = _number_in(folded) if number is None else number
        elif is_whole(label):
            number = int(label)
        if number is None or not 0 <= number < LABEL_COUNT:
            known = f"one of {self._listed()}, or a number from 0 to 255"
            raise SceneError(f"label must be {known}, got {truncate(repr(label))}; label_names names others")
        return Label(number) if number <= _GREATEST else number

    def numbers(self, labels: Iterable[Label | int | str] | Label | int | str, name: str = "labels") -> set[int]:
        """Return the numbers of one or several classes; `name` is that of the argument in error messages."""
        items = [labels] if isinstance(labels, str) or is_whole(labels) else as_items(labels, name, SceneError)
        return {self.number(label) for label in items}

    def name(self, label: Label | int | str) -> str:
        """Return the display name of a class: its name, or ``label 40`` if it has no name."""
        number = self.number(label)
        return self._names.get(number, f"label {int(number)}")

    def word(self, label: int) -> str:
        """Return the name of a class in reports and files: ``"OBJECT"`` for a `Label` with that name, else its name."""
        number, name = self.number(label), self.name(label)
        return number.name if isinstance(number, Label) and number.name.lower() == name else name

    def _listed(self) -> str:
        names = [f"{truncate(name, 40)} ({number})" for number, name in self._names.items()]
        more = len(names) - _MAX_LISTED
        return ", ".join(names if more <= 1 else [*names[:_MAX_LISTED], f"{more} others"])


def _check_number(number: object) -> int:
    if not is_whole(number) or not 0 <= number < LABEL_COUNT:
        raise SceneError(f"label_names must have numbers from 0 to 255, got {number!r}")
    return int(number)


def _check_name(name: object, number: int) -> str:
    if not isinstance(name, str) or not name.strip() or name != name.strip() or not name.isprintable():
        raise SceneError(f"label_names must be names without spaces around them, got {name!r} for {number}")
    meant = _number_in(name.casefold())
    if meant is not None and (meant != number or not name.casefold().startswith(_UNNAMED)):
        raise SceneError(f"label_names must be names that are no numbers, got {name!r} for {number}")
    return name


_UNNAMED = "label "


def _number_in(text: str) -> int | None:
    """Parse a class number: ``40``, or ``label 40``, the display name of a class without a name."""
    digits = text.removeprefix(_UNNAMED)
    return int(digits) if digits.isascii() and digits.isdigit() and len(digits) <= len(str(LABEL_COUNT)) else None
