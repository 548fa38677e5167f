# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Warnings that are attributed to the calling line outside of the package."""

from __future__ import annotations

import sys
import warnings

_PACKAGE = __name__.partition(".")[0]


def warn_user(message: str, category: type[Warning]) -> None:
    """Issue a warning for the nearest caller outside of this package, like `skip_file_prefixes` of Python 3.12."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and _is_ours(str(frame.f_globals.get("__name__", ""))):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)


def _is_ours(module: str) -> bool:
    """Return whether a module is part of this package; generated methods of dataclasses have its module names, too."""
    return module == _PACKAGE or module.startswith(f"{_PACKAGE}.")
