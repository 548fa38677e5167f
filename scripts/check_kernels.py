# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Check the style of kernels and of native headers, and print every fault.

python scripts/check_kernels.py    # exit status 1 if there is a fault
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
GROUPS = ["# Scene:", "# Cameras:", "# In:", "# Out:"]
MAX_PARAMETERS = 12
MAX_NATIVE_PARAMETERS, MAX_NATIVE_LINES, MAX_COLUMNS, MAX_LINES = 8, 60, 120, 400
MIN_KERNELS, MIN_NATIVE_FUNCTIONS = 100, 250
"""Minimum numbers in the repository; finding fewer indicates a broken check."""

_NOT_FUNCTIONS = {"if", "for", "while", "switch", "return", "sizeof", "alignof", "static_assert", "decltype"}


def functions(tree: ast.Module, decorator: str) -> Iterator[ast.FunctionDef]:
    """Yield the functions of a module that have a decorator, such as ``wp.kernel``."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            if decorator in [ast.unparse(d).split("(")[0] for d in node.decorator_list]:
                yield node


def check_types(node: ast.FunctionDef) -> Iterator[str]:
    """Check that parameters of a kernel or device function are typed, and arrays written with subscripts."""
    arguments = node.args
    if arguments.defaults or arguments.vararg or arguments.kwarg or arguments.kwonlyargs:
        yield "parameters must be positional and without defaults"
    for argument in arguments.args:
        if argument.annotation is None:
            yield f"parameter {argument.arg} must have a type"
        elif re.search(r"array\d?d?\(", ast.unparse(argument.annotation)):
            yield f"the type of parameter {argument.arg} must be written with a subscript"


def check_groups(node: ast.FunctionDef, source: str) -> Iterator[str]:
    """Check that a kernel's parameters are in groups, with outputs last."""
    names = [argument.arg for argument in node.args.args]
    if len(names) > MAX_PARAMETERS:
        yield f"a kernel must have at most {MAX_PARAMETERS} parameters, got {len(names)}"
    first = next((index for index, name in enumerate(names) if name.endswith("_out")), None)
    if first is None:
        yield "a kernel must have an output, named *_out"
        return
    if not all(name.endswith("_out") for name in names[first:]):
        yield "outputs must be the last parameters"
    head = source.splitlines()[node.lineno - 1 : node.body[0].lineno - 1]
    lines = [line.strip() for line in head]
    comments = [line for line in lines if line.startswith("#")]
    if comments != [group for group in GROUPS if group in comments]:
        yield f"groups of parameters must be {', '.join(GROUPS)}, in this order, got {', '.join(comments)}"
    group = lines.index("# Out:") if "# Out:" in lines else None
    line = next((index for index, line in enumerate(lines) if f"{names[first]}:" in line), None)
    if group is None or line != group + 1:
        yield "the first output must follow '# Out:'"


def check_writes(node: ast.FunctionDef) -> Iterator[str]:
    """Check that a kernel writes to its outputs only."""
    parameters = {argument.arg for argument in node.args.args}
    for statement in ast.walk(node):
        targets = statement.targets if isinstance(statement, ast.Assign) else [getattr(statement, "target", None)]
        for target in targets:
            if isinstance(target, ast.Subscript):
                owner = target.value.value if isinstance(target.value, ast.Attribute) else target.value
                if isinstance(owner, ast.Name) and owner.id in parameters and not owner.id.endswith("_out"):
                    yield f"line {statement.lineno} writes to the input {owner.id}"


def check_thread_index(node: ast.FunctionDef) -> Iterator[str]:
    """Check that a kernel begins with its thread index."""
    statements = [s for s in node.body if not (isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant))]
    if "wp.tid()" not in ast.unparse(statements[0]):
        yield "the first statement must call wp.tid()"


def check_module(name: str, source: str) -> Iterator[str]:
    """Check the style of a module of ``kernels/``."""
    tree = ast.parse(source)
    imported = {
        alias.name.split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names
    }
    imported |= {str(node.module).split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    allowed = {"pathlib", "re", "warp"} if name == "native_source" else {"typing", "warp", "warpvis"}
    if imported - allowed:
        yield f"{name}: imports must be of {', '.join(sorted(allowed))}, got {', '.join(sorted(imported - allowed))}"
    if "@wp.kernel" in source:
        options = [ast.unparse(node) for node in tree.body if "set_module_options" in ast.unparse(node)]
        if len(options) != 1 or not ("'enable_backward': False" in options[0] or "pixel_options(" in options[0]):
            yield f"{name}: a module with kernels must set enable_backward to False, once"
    for node in functions(tree, "wp.func"):
        yield from (f"{name}.{node.name}: {fault}" for fault in check_types(node))
    for node in functions(tree, "wp.kernel"):
        for faults in (
            check_types(node),
            check_groups(node, source),
            check_writes(node),
            check_thread_index(node),
        ):
            yield from (f"{name}.{node.name}: {fault}" for fault in faults)


def check_imports(name: str, source: str) -> Iterator[str]:
    """Check that ``kernels`` and ``scenes`` are not imported as top-level packages.

    That would compile every kernel a second time, and shadow another project's package.
    """
    for match in re.finditer(r"^\s*(?:from|import) (kernels|scenes)\b", source, re.MULTILINE):
        yield f"{name}: {match[1]} must be imported as warpvis.{match[1]}"


def _closing(code: str, start: int) -> tuple[int, int]:
    """Return where the bracket that is open before `start` closes, and the number of commas at its own depth."""
    depth, commas = 1, 0
    for place in range(start, len(code)):
        character = code[place]
        depth += (character in "([{") - (character in ")]}")
        commas += character == "," and depth == 1
        if depth == 0:
            return place, commas
    raise ValueError("a bracket is never closed")


def native_functions(text: str) -> Iterator[tuple[str, int, int]]:
    """Return the name, the number of parameters and the number of lines of every C++ function that has a body."""
    code = re.sub(r'//[^\n]*|"(?:\\.|[^"\\\n])*"', lambda match: " " * len(match[0]), text)
    for match in re.finditer(r"\b([A-Za-z_]\w*)\s*\(", code):
        if match[1] in _NOT_FUNCTIONS:
            continue
        end, commas = _closing(code, match.end())
        body = re.compile(r"\s*(?:const)?\s*\{").match(code, end + 1)
        if body:
            last, _ = _closing(code, body.end())
            parameters = commas + 1 if code[match.end() : end].strip() else 0
            yield match[1], parameters, code.count("\n", match.start(), last) + 1


def check_header(name: str, text: str) -> Iterator[str]:
    """Check the sizes of a native header and of its functions."""
    lines = text.splitlines()
    if len(lines) > MAX_LINES:
        yield f"{name}: a header must have at most {MAX_LINES} lines, got {len(lines)}"
    for number, line in enumerate(lines, 1):
        if len(line) > MAX_COLUMNS:  # clang-format leaves comments
            yield f"{name}:{number}: a line must have at most {MAX_COLUMNS} columns, got {len(line)}"
    for function, parameters, count in native_functions(text):
        if count > MAX_NATIVE_LINES:
            yield f"{name}: {function} must have at most {MAX_NATIVE_LINES} lines, got {count}"
        if parameters > MAX_NATIVE_PARAMETERS:
            yield f"{name}: {function} must have at most {MAX_NATIVE_PARAMETERS} parameters, got {parameters}"


def check_repository(root: Path = ROOT) -> list[str]:
    """Return every fault of the repository."""
    faults: list[str] = []
    kernels = functions_found = 0
    for path in sorted((root / "kernels").rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        faults += check_module(path.stem, source)
        kernels += len(list(functions(ast.parse(source), "wp.kernel")))
    for path in sorted((root / "kernels" / "native").glob("*/*.h")):
        text = path.read_text(encoding="utf-8")
        faults += check_header(f"{path.parent.name}/{path.name}", text)
        functions_found += len(list(native_functions(text)))
    for folder in ("warpvis", "kernels", "scenes", "tests", "bench"):
        for path in sorted((root / folder).rglob("*.py")):
            faults += check_imports(str(path.relative_to(root)), path.read_text(encoding="utf-8"))
    if kernels < MIN_KERNELS or functions_found < MIN_NATIVE_FUNCTIONS:
        faults.append(f"only {kernels} kernels and {functions_found} native functions were found")
    return faults


def main() -> int:
    """Print every fault, and return the exit status."""
    faults = check_repository()
    for fault in faults:
        print(fault)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
