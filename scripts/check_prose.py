# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Find stilted phrases in docstrings, comments, messages and documents.

    python scripts/check_prose.py [PATH ...]

Prints ``file:line: phrase`` for each, and exits with 1 if there are any. Rewrite the sentence with a
subject, a verb and an object.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("warpvis", "kernels", "scenes", "bench", "examples", "scripts", "docs", "README.md", "CONTRIBUTING.md")
PHRASES = re.compile(
    r"\b(?:nobody|somebody|whoever|amiss|meanwhile)\b"
    r"|\bwhat (?:it|they) (?:has|have) to be\b"
    r"|\bof (?:its|their|one's|our|your) own(?=[.,;:)]| (?:and|that|with|which)\b|$)"
    r"|\b[Ss]o (?:many|few) \w+ (?:at|of|are|as)\b"
    r"|(?<!there )\b(?:is|are|was) none\b"
    r"|\b(?:says|said) (?:it|so|that|nothing|which|where|how|what|whether)\b"
    r"|\bby who\b|\bfor those who\b|\bwho (?:asks|calls|casts|reads|renders|takes|waits)\b"
    r"|\bin place of\b|\btaken for\b|\bby lot\b"
    r"|(?:^|[.:;] )What (?:is|are|was|makes|has|casters|readers)\b"
    r"|(?:^|[.:;] )Of (?:a|an|the|its|all|each|what|several|those)\b(?! course)"
)


def texts(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the first line and the text of every docstring, comment block or paragraph of a file."""
    source = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        yield from _python_texts(source)
    elif path.suffix in (".h", ".cpp"):
        for block in re.finditer(r"//[^\n]*(?:\n\s*//[^\n]*)*", source):
            yield source.count("\n", 0, block.start()) + 1, block.group().replace("//", " ")
    else:
        source = re.sub(r"```.*?```", lambda code: "\n" * code.group().count("\n"), source, flags=re.DOTALL)
        for block in re.finditer(r"\S.*?(?=\n\s*\n|\Z)", source, re.DOTALL):
            yield source.count("\n", 0, block.start()) + 1, block.group()


def _python_texts(source: str) -> Iterator[tuple[int, str]]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield node.lineno, node.value
    comments = [token for token in tokenize.generate_tokens(io.StringIO(source).readline) if token.string[:1] == "#"]
    for token in comments:
        yield token.start[0], token.string.lstrip("# ")


def main() -> int:
    """Check the given files, or all of the project's."""
    chosen = [Path(word) for word in sys.argv[1:]] or [ROOT / name for name in FOLDERS]
    files = [path for place in chosen for path in ([place] if place.is_file() else sorted(place.rglob("*")))]
    found = 0
    for path in files:
        if path.suffix not in (".py", ".h", ".cpp", ".md") or "_build" in path.parts or path.name == "check_prose.py":
            continue
        for line, text in texts(path):
            for match in PHRASES.finditer(re.sub(r"\s+", " ", text)):
                print(f"{path}:{line}: {match.group().strip('.:; ')!r}")
                found += 1
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
