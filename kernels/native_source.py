# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The text of the C++ in ``kernels/native``, which Warp pastes into the functions that use it."""

from pathlib import Path

_FOLDER = Path(__file__).parent / "native"


def read_native(*names: str) -> str:
    """The files' text, one after the other. A change to a file changes the text, and so Warp compiles it anew."""
    return "\n".join((_FOLDER / name).read_text(encoding="utf-8") for name in names) + "\n"
