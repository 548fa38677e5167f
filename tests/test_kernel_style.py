# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Style checks of kernels in `scripts/check_kernels.py`, and reference implementations of kernels."""

import ast
import re
import sys
from pathlib import Path

import pytest

import reference
from support.call_graph import CallGraph, Name

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

import check_kernels  # noqa: E402

GOOD = '''\
import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def double(x: float) -> float:
    return 2.0 * x


@wp.kernel(module="unique")
def double_all(
    # In:
    values: wp.array[float],
    # Out:
    doubled_out: wp.array[float],
):
    """Double every value."""
    i = wp.tid()
    doubled_out[i] = double(values[i])
'''
BAD = {
    "an untyped parameter": ("x: float", "x", "parameter x must have a type"),
    "a default": ("x: float", "x: float = 1.0", "parameters must be positional and without defaults"),
    "keywords": ("(x: float)", "(*, x: float)", "parameters must be positional and without defaults"),
    "a called array": ("values: wp.array[float]", "values: wp.array2d(dtype=float)", "values must be written with a s"),
    "too many": (
        "    # In:\n",
        "    # In:\n" + "".join(f"    p{i}: int,\n" for i in range(11)),
        "at most 12 .*, got 13",
    ),
    "no output": ("doubled_out", "doubled", "a kernel must have an output"),
    "outputs first": ("    # In:\n", "    # In:\n    b_out: wp.array[float],\n", "outputs must be the last parameters"),
    "an unknown group": ("# In:", "# Input:", "groups of parameters must be"),
    "groups in another order": (
        "    # Out:",
        "    # Scene:\n    scene: int,\n    # Out:",
        "groups of parameters must be",
    ),
    "a line before outputs": ("    # Out:\n", "    # Out:\n    size: int,\n", "the first output must follow"),
    "a written input": (
        "doubled_out[i] =",
        "values[i] = 0.0\n    doubled_out[i] =",
        "line 20 writes to the input values",
    ),
    "a changed input": ("doubled_out[i] =", "values[i] += 1.0\n    doubled_out[i] =", "writes to the input values"),
    "a written field": ("doubled_out[i] =", "values.data[i] = 0.0\n    doubled_out[i] =", "writes to the input values"),
    "a late thread index": ("    i = wp.tid()", "    j = 0\n    i = wp.tid()", r"must call wp\.tid\(\)"),
    "another import": ("import warp as wp", "import warp as wp\nimport numpy as np", "warpvis, got numpy"),
    "another import of names": ("import warp as wp", "import warp as wp\nfrom os import path", "warpvis, got os"),
    "no options": ('wp.set_module_options({"enable_backward": False})', "", "enable_backward to False"),
    "other options": ('"enable_backward": False', '"enable_backward": True', "enable_backward to False"),
}


def test_valid_kernel_has_no_faults():
    assert list(check_kernels.check_module("good", GOOD)) == []


@pytest.mark.parametrize("case", BAD)
def test_faults_of_kernels_are_found(case):
    old, new, message = BAD[case]
    assert old in GOOD
    faults = list(check_kernels.check_module("bad", GOOD.replace(old, new)))
    assert [fault for fault in faults if fault.startswith("bad")] == faults
    assert re.search(message, "\n".join(faults)), faults


def test_top_level_imports_of_kernels_are_found():
    text = "import os\nfrom kernels import rays\n    import scenes.room\nfrom warpvis import kernels, scenes\n"
    assert list(check_kernels.check_imports("a.py", text)) == [
        "a.py: kernels must be imported as warpvis.kernels",
        "a.py: scenes must be imported as warpvis.scenes",
    ]


def test_native_functions_are_all_found():
    text = """
    struct A {
        static inline int none() { return f(1, 2); }
        inline void two(int (*a)[3], const B& b) const {
            if (a) { g(a, b, 3); }
        }
        static __attribute__((noinline)) void nine(int a, int b, int c, int d, int e, int f, int g, int h, int i) {}
    };
    """
    assert list(check_kernels.native_functions(text)) == [("none", 0, 1), ("two", 2, 3), ("nine", 9, 1)]
    assert list(check_kernels.check_header("a.h", text)) == ["a.h: nine must have at most 8 parameters, got 9"]


def test_long_headers_functions_and_lines_are_found():
    text = "void long_one(int a) {\n" + "    f();\n" * 60 + "}\n" + "//\n" * 340 + f"// {'x' * 118}\n"
    assert list(check_kernels.check_header("a.h", text)) == [
        "a.h: a header must have at most 400 lines, got 403",
        "a.h:403: a line must have at most 120 columns, got 121",
        "a.h: long_one must have at most 60 lines, got 62",
    ]


def kernel_names():
    for path in sorted((ROOT / "kernels").rglob("*.py")):
        for node in check_kernels.functions(ast.parse(path.read_text()), "wp.kernel"):
            yield node.name


def test_every_kernel_has_a_reference():
    assert [name for name in kernel_names() if not callable(getattr(reference, name, None))] == []


@pytest.mark.slow
def test_every_reference_is_called_by_a_test():
    """Directly, or as the reference of another kernel, since kernels may share one."""
    called = CallGraph().called_by_tests()
    assert len(called) > 1000
    twins = {name: getattr(reference, name) for name in kernel_names()}
    assert [name for name, twin in twins.items() if Name(twin.__module__, twin.__name__) not in called] == []


def test_calls_are_found_through_imports(tmp_path):
    (tmp_path / "twins.py").write_text("from more import third\ndef first(): second()\ndef second(): ...\n")
    (tmp_path / "more.py").write_text("def third(): ...\ndef fourth(): ...\n")
    (tmp_path / "test_a.py").write_text("import twins\ndef test_it(): twins.first(); twins.third()\n")
    assert CallGraph(tmp_path).called_by_tests() == {
        Name("test_a", "test_it"),
        Name("twins", "first"),
        Name("twins", "second"),
        Name("more", "third"),
    }
