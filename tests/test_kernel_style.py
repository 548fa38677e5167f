# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels are written one way: typed parameters in named groups, outputs last and named ``*_out``, no NumPy."""

import ast
import re
from pathlib import Path

import pytest

import reference

ROOT = Path(__file__).parent.parent
MODULES = sorted((ROOT / "kernels").glob("*.py"))
GROUPS = ["# Scene:", "# Cameras:", "# In:", "# Out:"]
MAX_PARAMETERS = 12


def functions(decorator):
    for path in MODULES:
        source = path.read_text()
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.FunctionDef) and decorator in [
                ast.unparse(d).split("(")[0] for d in node.decorator_list
            ]:
                yield pytest.param(node, source, id=f"{path.stem}.{node.name}")


KERNELS = list(functions("wp.kernel"))


def test_there_are_kernels():
    assert len(KERNELS) >= 8


@pytest.mark.parametrize(("node", "source"), [*KERNELS, *functions("wp.func")])
def test_parameters_are_typed_and_arrays_subscripted(node, source):
    arguments = node.args
    assert not (arguments.defaults or arguments.vararg or arguments.kwarg or arguments.kwonlyargs)
    for argument in arguments.args:
        assert argument.annotation is not None, argument.arg
        assert not re.search(r"array\d?d?\(", ast.unparse(argument.annotation)), argument.arg


@pytest.mark.parametrize(("node", "source"), KERNELS)
def test_parameters_are_grouped_and_outputs_last(node, source):
    arguments = node.args.args
    assert len(arguments) <= MAX_PARAMETERS
    first_output = next(i for i, argument in enumerate(arguments) if argument.arg.endswith("_out"))
    assert all(argument.arg.endswith("_out") for argument in arguments[first_output:])
    head = "\n".join(source.splitlines()[node.lineno - 1 : node.body[0].lineno - 1])
    found = [line.strip() for line in head.splitlines() if line.strip().startswith("#")]
    assert found == [group for group in GROUPS if group in found]
    out_comment = next(i for i, line in enumerate(head.splitlines()) if line.strip() == "# Out:")
    output_line = next(i for i, line in enumerate(head.splitlines()) if f"{arguments[first_output].arg}:" in line)
    assert output_line == out_comment + 1


@pytest.mark.parametrize(("node", "source"), KERNELS)
def test_only_outputs_are_written(node, source):
    parameters = {argument.arg for argument in node.args.args}
    for statement in ast.walk(node):
        targets = statement.targets if isinstance(statement, ast.Assign) else [getattr(statement, "target", None)]
        for target in targets:
            if isinstance(target, ast.Subscript):
                owner = target.value.value if isinstance(target.value, ast.Attribute) else target.value
                if isinstance(owner, ast.Name) and owner.id in parameters:
                    assert owner.id.endswith("_out")


@pytest.mark.parametrize(("node", "source"), KERNELS)
def test_the_thread_index_comes_first(node, source):
    statements = [s for s in node.body if not (isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant))]
    assert "wp.tid()" in ast.unparse(statements[0])


@pytest.mark.parametrize(("node", "source"), KERNELS)
def test_every_kernel_has_a_twin(node, source):
    assert callable(getattr(reference, node.name))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_modules_hold_device_code_only(path):
    tree = ast.parse(path.read_text())
    imported = {
        name.name.split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names
    }
    imported |= {node.module.split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert imported <= ({"pathlib"} if path.stem == "native_source" else {"warp", "warpvis"})
    if "@wp.kernel" in path.read_text():
        options = [ast.unparse(node) for node in tree.body if "set_module_options" in ast.unparse(node)]
        assert len(options) == 1
        assert "'enable_backward': False" in options[0]


def test_kernels_are_never_imported_as_a_top_level_package():
    """`import kernels` would compile every kernel a second time, and shadow another project's package."""
    for path in [
        p for folder in ("warpvis", "kernels", "scenes", "tests", "bench") for p in (ROOT / folder).rglob("*.py")
    ]:
        assert not re.search(r"^\s*(from|import) (kernels|scenes)\b", path.read_text(), re.MULTILINE), path


HEADERS = sorted((ROOT / "kernels" / "native").glob("*/*.h"))
MAX_NATIVE_PARAMETERS, MAX_NATIVE_LINES, MAX_COLUMNS, MAX_LINES = 8, 60, 120, 400
_NO_FUNCTIONS = {"if", "for", "while", "switch", "return", "sizeof", "alignof", "static_assert", "decltype"}


def closing(code, start):
    """Where the bracket that is open before a place is closed, and how many commas are between at its own level."""
    depth, commas = 1, 0
    for place in range(start, len(code)):
        character = code[place]
        depth += (character in "([{") - (character in ")]}")
        commas += character == "," and depth == 1
        if depth == 0:
            return place, commas
    raise AssertionError("a bracket is never closed")


def native_functions(text):
    """Name, parameters and lines of every function that has a body."""
    code = re.sub(r'//[^\n]*|"(?:\\.|[^"\\\n])*"', lambda match: " " * len(match[0]), text)
    for match in re.finditer(r"\b([A-Za-z_]\w*)\s*\(", code):
        if match[1] in _NO_FUNCTIONS:
            continue
        end, commas = closing(code, match.end())
        body = re.compile(r"\s*(?:const)?\s*\{").match(code, end + 1)
        if body:
            last, _ = closing(code, body.end())
            parameters = commas + 1 if code[match.end() : end].strip() else 0
            yield match[1], parameters, code.count("\n", match.start(), last) + 1


@pytest.mark.parametrize("path", HEADERS, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_native_functions_are_short_and_take_few_parameters(path):
    text = path.read_text()
    assert len(text.splitlines()) <= MAX_LINES
    assert not [line for line in text.splitlines() if len(line) > MAX_COLUMNS]  # clang-format leaves comments
    functions = list(native_functions(text))
    assert not {name: lines for name, _, lines in functions if lines > MAX_NATIVE_LINES}
    assert not {name: count for name, count, _ in functions if count > MAX_NATIVE_PARAMETERS}


def test_native_functions_are_all_found():
    """Were they not, the rules above would hold of anything."""
    text = """
    struct A {
        static inline int none() { return f(1, 2); }
        inline void two(int (*a)[3], const B& b) const {
            if (a) { g(a, b, 3); }
        }
        static __attribute__((noinline)) void nine(int a, int b, int c, int d, int e, int f, int g, int h, int i) {}
    };
    """
    assert list(native_functions(text)) == [("none", 0, 1), ("two", 2, 3), ("nine", 9, 1)]
    assert sum(len(list(native_functions(path.read_text()))) for path in HEADERS) > 250
