# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The C++ source of ``kernels/native``, which Warp pastes into native functions."""

from pathlib import Path

_FOLDER = Path(__file__).parent / "native"


def read_native(*names: str) -> str:
    """Return the concatenated text of files. Warp recompiles kernels when it changes."""
    return "\n".join((_FOLDER / name).read_text(encoding="utf-8") for name in names) + "\n"
