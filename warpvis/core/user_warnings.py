# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Warnings that name the line of whoever calls the library, however deep in it they come up."""

from __future__ import annotations

import sys
import warnings

_PACKAGE = __name__.partition(".")[0]


def warn_user(message: str, category: type[Warning]) -> None:
    """Warn of the nearest caller outside of this package; Python 3.12 has `skip_file_prefixes` for that."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and _is_ours(str(frame.f_globals.get("__name__", ""))):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)


def _is_ours(module: str) -> bool:
    """Tell whether a module is of this package. Methods that dataclasses write have the names of their module."""
    return module == _PACKAGE or module.startswith(f"{_PACKAGE}.")
