# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Assign labels to objects by patterns of names, from a mapping or a file, which may also define class names."""

from __future__ import annotations

import fnmatch
import json
import os
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from warpvis.core.checks import as_path, check_mapping, describe_exception, truncate
from warpvis.core.file_content import load_yaml, read_text
from warpvis.core.labels import Label, LabelNames
from warpvis.errors import FileFormatError, SceneError, WarpvisError

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
        names = {_as_number(key): name for key, name in _mapping(data.get("label_names") or {}).items()}
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


def _mapping(value: object) -> Mapping[Any, Any]:
    return check_mapping(value, "label_names", SceneError)


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
