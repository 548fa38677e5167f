# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Expansion of xacro files by the package of the same name, with packages found without ROS."""

from __future__ import annotations

import contextlib
import io
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from warpvis.core.checks import describe_exception
from warpvis.core.file_content import require_package
from warpvis.errors import FileFormatError
from warpvis.io.urdf._places import Places

_lock = threading.Lock()  # xacro has global state


def expand_xacro(path: Path, places: Places) -> bytes:
    """Return the XML of a xacro file, with the default values of its arguments."""
    require_package("xacro", f"{path}: reading xacro files needs the package xacro", "urdf")
    import xacro

    def find(package: str) -> str:
        found = places.packages(package)
        if not found:
            raise ValueError(f"the package {package!r} was not found above the file or on the search path")
        return str(found[0])

    with _lock, _packages_of(find), contextlib.redirect_stderr(io.StringIO()):
        try:
            return xacro.process_file(str(path)).toxml(encoding="utf-8")
        except (Exception, SystemExit) as error:  # xacro evaluates expressions, which raise any exception
            reason = describe_exception(error)
            hint = f"; give it by xacro {path.name} name:=value > robot.urdf" if "argument" in reason else ""
            raise FileFormatError(f"{path}: xacro cannot expand it: {reason}{hint}") from None


@contextlib.contextmanager
def _packages_of(find: Callable[[str], str]) -> Iterator[None]:
    """Let xacro find packages by a function, instead of by ROS."""
    from xacro import substitution_args as module

    state: Any = module
    former, symbols = state._eval_find, state._eval_dict
    state._eval_find = symbols["find"] = find
    try:
        yield
    finally:
        state._eval_find = symbols["find"] = former
