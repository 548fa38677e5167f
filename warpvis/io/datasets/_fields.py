# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Fields of JSON objects, with messages that name the file and the field."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.file_content import read_json
from warpvis.core.types import Json
from warpvis.errors import FileFormatError
from warpvis.io._files import as_numbers, shorten


class Fields:
    """A JSON object, and its location in messages."""

    def __init__(self, value: Json, location: str) -> None:
        """Check that the value is an object."""
        if not isinstance(value, dict):
            raise FileFormatError(f"{location} must be an object, got {shorten(value)}")
        self.values: dict[str, Any] = value
        self.location = location

    @classmethod
    def read(cls, path: Path) -> Fields:
        """Read a file that contains an object."""
        value = read_json(path)
        if not isinstance(value, dict):
            raise FileFormatError(f"{path}: must contain a JSON object, got {shorten(value)}")
        return cls(value, f"{path}:")

    def named(self, name: str) -> str:
        """Return the location of a field."""
        return f"{self.location} {name!r}" if self.location.endswith(":") else f"{self.location}[{name!r}]"

    def text(self, name: str, default: str | None = None) -> str:
        """Return a string; the default if it is missing, or an error without a default."""
        value = self.values.get(name, default)
        if not isinstance(value, str):
            raise FileFormatError(
                f"{self.named(name)} must be a text, got {'nothing' if value is None else shorten(value)}"
            )
        return value

    def vector(self, name: str, default: tuple[float, ...]) -> NDArray[np.float64]:
        """Return a list of as many finite numbers as the default has."""
        if name not in self.values:
            return np.array(default, dtype=np.float64)
        return as_numbers(self.values[name], (len(default),), self.named(name))

    def number(self, name: str, default: float) -> float:
        """Return a finite number."""
        return float(as_numbers(self.values[name], (), self.named(name))) if name in self.values else default

    def whole(self, name: str, default: int | None = None) -> int:
        """Return an integer; the default if it is missing, or an error without a default."""
        value = self.values.get(name, default)
        if type(value) is not int:
            given = "nothing" if value is None else shorten(value)
            raise FileFormatError(f"{self.named(name)} must be a whole number, got {given}")
        return value

    def child(self, name: str) -> Fields:
        """Return an object; an empty one if it is missing."""
        return Fields(self.values.get(name, {}), self.named(name))

    def children(self, name: str, *, required: bool = False) -> Iterator[Fields]:
        """Yield the objects of a list; none if it is missing."""
        value = self.values.get(name) if required else self.values.get(name, [])
        if not isinstance(value, list):
            given = "nothing" if value is None else shorten(value)
            raise FileFormatError(f"{self.named(name)} must be a list of objects, got {given}")
        for number, item in enumerate(value):
            yield Fields(item, f"{self.named(name)}[{number}]")

    def numbers(self, name: str) -> NDArray[np.int64]:
        """Return a list of integers, shape ``(n,)``."""
        value = self.values.get(name)
        if isinstance(value, list) and all(type(item) is int for item in value):
            try:
                return np.array(value, dtype=np.int64).reshape(-1)
            except OverflowError:
                pass
        given = "nothing" if value is None else shorten(value)
        raise FileFormatError(f"{self.named(name)} must be a list of whole numbers, got {given}")
