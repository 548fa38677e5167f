# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Generate kernels/constants.py, the constants shared by Python and C++, from kernels/native/shared/constants.h."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
HEADER = ROOT / "kernels" / "native" / "shared" / "constants.h"
MODULE = ROOT / "kernels" / "constants.py"

_HEAD = '''# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Constants shared by C++ and Python, generated from native/shared/constants.h by scripts/generate_constants.py."""
'''
_ENUM = re.compile(r"((?:// [^\n]*\n)+)enum (\w+) \{\n(.*?)\};", re.DOTALL)
_MEMBER = re.compile(r"    (\w+) = (-?\d+(?: << \d+)?),(?:  // (.*))?")
_FLOAT = re.compile(r"((?:// [^\n]*\n)+)constexpr float (\w+) = ([\d.e+-]+)f;")


def generate(header: str) -> str:
    """Return the text of the module for the text of the header."""
    parts = [_HEAD]
    for comment, name, body in _ENUM.findall(header):
        lines = [as_python(comment)]
        for line in body.splitlines():
            member = _MEMBER.fullmatch(line)
            if member is None:
                raise ValueError(f"{HEADER.name}: members of enum {name} must be NAME = NUMBER, got {line.strip()!r}")
            lines.append(f"{member[1]} = {member[2]}" + (f"  # {member[3]}" if member[3] else ""))
        parts.append("\n".join(lines) + "\n")
    for comment, name, value in _FLOAT.findall(header):
        parts.append(f"{as_python(comment)}\n{name} = {value}\n")
    return "\n".join(parts)


def as_python(comment: str) -> str:
    """Convert the lines of a C++ comment to a Python comment."""
    return "\n".join(line.replace("//", "#", 1) for line in comment.strip().splitlines())


if __name__ == "__main__":
    MODULE.write_text(generate(HEADER.read_text(encoding="utf-8")), encoding="utf-8")
