# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Define the classes of pixels and the visibility states of points, and assign classes to objects by their names."""

from __future__ import annotations

import enum
import fnmatch
import json
import os
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from warpvis.core.checks import as_items, as_path, check_mapping, describe_exception, is_whole, truncate
from warpvis.core.file_content import load_yaml, read_text
from warpvis.errors import FileFormatError, SceneError, WarpvisError
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
        """Add or change names. If one is invalid, none is changed."""
        new = dict(self._names)
        for number, name in check_mapping(names, "label_names", SceneError).items():
            if not is_whole(number) or not 0 <= number < LABEL_COUNT:
                raise SceneError(f"label_names must have numbers from 0 to 255, got {number!r}")
            new[int(number)] = _check_name(name, number)
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
            names = [f"{truncate(name, 40)} ({number})" for number, name in self._names.items()]
            more = len(names) - _MAX_LISTED
            known = ", ".join(names if more <= 1 else [*names[:_MAX_LISTED], f"{more} others"])
            given = truncate(repr(label))
            raise SceneError(
                f"label must be one of {known}, or a number from 0 to 255, got {given}; label_names names others"
            )
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


LabelInput: TypeAlias = "Mapping[str, Label | int | str] | str | os.PathLike[str] | LabelRules"
"""Labels by object names or name patterns, or a file that contains them."""

LABEL_FILES = (".json", ".toml", ".yaml", ".yml")
"""File name suffixes of label files."""

_SECTIONS = ("labels", "label_names", "ground_labels")


@dataclass(frozen=True)
class LabelRules:
    """Ordered name patterns with their labels, and the class definitions of a file."""

    labels: Mapping[str, Label | int | str] = field(default_factory=dict)
    """Labels by object names or name patterns: the last matching pattern applies."""
    label_names: Mapping[int, str] = field(default_factory=dict)
    """Names of user-defined classes."""
    ground_labels: tuple[Label | int | str, ...] | None = None
    """The classes that are ground; None if not specified."""

    @classmethod
    def of(cls, labels: LabelInput | None, label_names: Mapping[int, str] | None = None) -> LabelRules:
        """Parse the arguments `labels` and `label_names` of a call; its names take precedence over names of a file."""
        if isinstance(labels, str | os.PathLike):
            rules = _read_file(as_path(labels, "labels"))
        elif isinstance(labels, LabelRules):
            rules = labels
        else:
            rules = cls({} if labels is None else _check_patterns(labels))
        checked_names = {} if label_names is None else check_mapping(label_names, "label_names", SceneError)
        return rules.followed_by(cls(label_names=checked_names))

    def followed_by(self, other: LabelRules) -> LabelRules:
        """Return the combined rules: patterns of `other` come last, and so take precedence."""
        remaining = {pattern: label for pattern, label in self.labels.items() if pattern not in other.labels}
        ground = self.ground_labels if other.ground_labels is None else other.ground_labels
        return LabelRules({**remaining, **other.labels}, {**self.label_names, **other.label_names}, ground)


class LabelPatterns:
    """Match object names against patterns, and record which patterns matched an object."""

    def __init__(self, labels: Mapping[str, Label | int | str], names: LabelNames) -> None:
        """Convert the labels to class numbers."""
        self._patterns = {pattern: names.number(label) for pattern, label in labels.items()}
        self._unused = set(self._patterns)

    def label(self, name: str, default: int | str, aliases: Iterable[str] = ()) -> int | str:
        """Return the label of the last pattern that matches an object's name or alias; else `default`."""
        label, names = default, (name, *aliases)
        for pattern, number in self._patterns.items():
            if any(fnmatch.fnmatchcase(one, pattern) for one in names):
                label = number
                self._unused.discard(pattern)
        return label

    def require_used(self, names: Iterable[str], path: object) -> None:
        """Raise `SceneError` if a pattern matches no object of a file."""
        if self._unused:
            known = truncate(", ".join(map(repr, list(names)[:10])), 300)
            wrong = truncate(", ".join(map(repr, sorted(self._unused))), 300)
            raise SceneError(f"labels for {wrong} fit no object of {path}, which has {known}")


def _check_patterns(labels: object) -> Mapping[str, Any]:
    checked = check_mapping(labels, "labels", SceneError)
    bad = [pattern for pattern in checked if not isinstance(pattern, str)]
    if bad:
        raise SceneError(f"labels must be given to names or patterns of names, got {bad[0]!r}")
    return checked


def _read_file(path: Path) -> LabelRules:
    """Read a label file: JSON, TOML or YAML.

    It contains a mapping of patterns to labels; or sections: ``labels``, which is such a mapping, ``label_names``, a
    mapping of numbers to names, and ``ground_labels``, a list.
    """
    data = _parse(path)
    if not isinstance(data, dict):
        raise FileFormatError(f"{path}: must hold labels by names or patterns of objects, got {type(data).__name__}")
    if not any(isinstance(data.get(section), dict | list) for section in _SECTIONS):
        data = {"labels": data}
    other = [key for key in data if key not in _SECTIONS]
    if other:
        raise FileFormatError(
            f"{path}: must have {', '.join(_SECTIONS)} and nothing else, got {truncate(str(other[0]))!r}"
        )
    try:
        labels = _check_patterns(data.get("labels") or {})
        named = check_mapping(data.get("label_names") or {}, "label_names", SceneError)
        names = {_as_number(key): name for key, name in named.items()}
        classes = LabelNames(names)
        labels = {pattern: _settled(label, classes) for pattern, label in labels.items()}
        ground = data.get("ground_labels")
        if ground is not None and not isinstance(ground, list):
            raise SceneError(f"ground_labels must be a list, got {ground!r}")
    except WarpvisError as error:
        raise FileFormatError(f"{path}: {describe_exception(error)}") from None
    settled = None if ground is None else tuple(_settled(label, classes) for label in ground)
    return LabelRules(labels, names, settled)


def _settled(label: Any, names: LabelNames) -> Any:
    """Return the number of a class that the file names, so that the class may be renamed; other labels unchanged."""
    try:
        return names.number(label)
    except SceneError:
        return label


def _as_number(key: object) -> Any:
    """Convert a numeric string key to an integer: JSON and TOML support only string keys."""
    return int(key) if isinstance(key, str) and key.isascii() and key.isdigit() and len(key) < 10 else key


def _parse(path: Path) -> object:
    kind = path.suffix.lower()
    if kind in (".yaml", ".yml"):
        try:
            return load_yaml(path)
        except FileFormatError as error:
            hint = "; patterns that begin with * need quotes" if "alias" in str(error) else ""
            raise FileFormatError(f"{error}{hint}") from None
    if kind not in LABEL_FILES:
        suffix = repr(path.suffix) if path.suffix else "a name without a suffix"
        raise FileFormatError(f"{path}: {suffix} is no format of labels; those are json, toml and yaml")
    text = read_text(path, "text in UTF-8")
    try:
        return json.loads(text, object_pairs_hook=_without_doubles) if kind == ".json" else tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"{path}: is not {kind[1:].upper()}: {describe_exception(error)}") from None


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        raise ValueError(f"{max(keys, key=keys.count)!r} is there twice")
    return found
