# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Equality of dataclasses with array fields."""

from __future__ import annotations

from dataclasses import fields

import numpy as np


class ByValue:
    """Mixin for dataclasses with array fields; the generated `__eq__` would need the truth value of an array."""

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        pairs = [(getattr(self, field.name), getattr(other, field.name)) for field in fields(self)]  # type: ignore[arg-type]
        return all(np.array_equal(*pair) if isinstance(pair[0], np.ndarray) else pair[0] == pair[1] for pair in pairs)

    def __hash__(self) -> int:
        values = [getattr(self, field.name) for field in fields(self)]  # type: ignore[arg-type]
        return hash((type(self), *(value.shape if isinstance(value, np.ndarray) else value for value in values)))
