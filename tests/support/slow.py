# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Split the parameters of tests between `make test` and `make test-slow`."""

from collections.abc import Iterable, Sequence
from typing import Any

import pytest


def parametrize(
    names: str | Sequence[str], values: Iterable[Any], *, keep: int | Iterable[int] = 1, **options: Any
) -> pytest.MarkDecorator:
    """Parametrize a test like `pytest.mark.parametrize`, and mark all but some parameters as slow.

    Args:
        names: As of `pytest.mark.parametrize`.
        values: As of `pytest.mark.parametrize`.
        keep: The number of first parameters that run in `make test`, or the indices of those that do.
        **options: As of `pytest.mark.parametrize`.
    """
    fast = set(range(keep)) if isinstance(keep, int) else set(keep)
    several = not isinstance(names, str) or "," in names
    params = []
    for index, value in enumerate(values):
        if not isinstance(value, type(pytest.param())):
            value = pytest.param(*(value if several else (value,)))
        marks = value.marks if index in fast else [*value.marks, pytest.mark.slow]
        params.append(pytest.param(*value.values, id=value.id, marks=marks))
    return pytest.mark.parametrize(names, params, **options)
