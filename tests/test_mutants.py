# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Mutants of `scripts/mutate.py`: which code is mutated, and known equivalents."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

import mutate  # noqa: E402
from mutants import Mutant, choose, mutants_of  # noqa: E402

CPP = """\
#include "x.h"  // 1 < 2
static_assert(1 < 2, "a < b");
// while (a < b)
for (int i = 0; i < count; ++i) sum += -rows[i] * 0.25f;
if (!done && least(a, b) == 0) image.touch(block);
Points& at = all & mask ? none : "a + b";
"""

PYTHON = '''\
"""1 < 2"""
import a
def f(x: int | None = None) -> int | None:
    """3 < 4"""
    if x is not None and x < max(2, 3):
        pool.run(x)
    return x
'''


def changes(path: str, text: str, number: int) -> set[str]:
    return {mutant.after.strip() for mutant in mutants_of(path, text) if mutant.number == number}


def test_cpp_code_is_mutated():
    loop = changes("x.h", CPP, 4)
    assert "for (int i = 0; i <= count; ++i) sum += -rows[i] * 0.25f;" in loop
    assert "for (int i = 1; i < count; ++i) sum += -rows[i] * 0.25f;" in loop
    assert "for (int i = 0; i < count; ++i) sum += rows[i] * 0.25f;" in loop
    assert "for (int i = 0; i < count; ++i) sum -= -rows[i] * 0.25f;" in loop
    assert "for (int i = 0; i < count; ++i) sum += -rows[i] * 0.5f;" in loop
    branch = changes("x.h", CPP, 5)
    assert "if (done && least(a, b) == 0) image.touch(block);" in branch
    assert "if (!done || least(a, b) == 0) image.touch(block);" in branch
    assert "if (!done && most(a, b) == 0) image.touch(block);" in branch
    assert "if (!done && least(a, b) != 0) image.touch(block);" in branch
    assert ";" in branch


def test_comments_strings_and_declarations_are_not_mutated():
    assert not any(changes("x.h", CPP, number) for number in (1, 2, 3))
    assert changes("x.h", CPP, 6) == {'Points& at = all | mask ? none : "a + b";'}
    assert not any(changes("x.py", PYTHON, number) for number in (1, 2, 3, 4))


def test_python_code_is_mutated():
    assert changes("x.py", PYTHON, 5) == {
        "if x is None and x < max(2, 3):",
        "if x is not None or x < max(2, 3):",
        "if x is not None and x <= max(2, 3):",
        "if x is not None and x < min(2, 3):",
        *(f"if x is not None and x < max({two}, {three}):" for two, three in ((1, 3), (3, 3), (2, 2), (2, 4))),
    }
    assert changes("x.py", PYTHON, 6) == {"pass"}


def test_equivalent_code_is_not_mutated():
    text = "for a, b in zip(x, y, strict=True): f(a, keepdims=True)\n_MAX_KINDS = 3\nside = 3\n"
    assert not changes("x.py", "import a\n\n@dataclass(frozen=True)\nclass A:\n    pass\n", 3)
    assert changes("x.py", text, 1) == {"for a, b in zip(x, y, strict=True): f(a, keepdims=False)"}
    assert changes("x.py", text, 2) == {"pass"}
    assert {"side = 2", "side = 4"} <= changes("x.py", text, 3)
    assert not changes("x.h", "enum { SPINS = 1 << 14 };", 1)


def test_every_file_has_tests():
    """Each file that is mutated has a pattern in the table, each pattern matches a file, and its tests exist."""
    files = [str(path.relative_to(ROOT)) for pattern in mutate.FILES for path in ROOT.glob(pattern)]
    assert len(files) > 60
    assert [path for path in files if not mutate.test_files(path)] == []
    for pattern, names in mutate.TESTS:
        assert any(mutate.fnmatch(path, f"*/{pattern}") for path in files), pattern
        for name in names.split():
            assert (ROOT / f"tests/test_{name}.py").is_file(), (pattern, name)


@pytest.mark.parametrize(
    ("path", "first"),
    [
        ("kernels/native/shared/stereo.h", "stereo"),
        ("kernels/native/cpu/remap_tree.h", "remap"),
        ("kernels/native/cpu/raster.h", "exact_pixels"),
        ("warpvis/rendering/_sensing.py", "depth_sensor"),
    ],
)
def test_tests_are_selected_by_file(path, first):
    command = mutate.tests_for(path, ROOT)[-1]
    assert next(word for word in command.split() if word.startswith("tests/")) == f"tests/test_{first}.py"


def test_selection_depends_only_on_seed():
    mutants = mutants_of("x.h", CPP)
    assert choose(mutants, 5, 7) == choose(mutants, 5, 7) != choose(mutants, 5, 8)
    assert len(choose(mutants, 1000, 0)) == len(set(mutants))


def test_mutant_changes_one_line():
    mutant = mutants_of("x.h", CPP)[0]
    before, after = CPP.split("\n"), mutant.apply(CPP).split("\n")
    assert [number for number in range(len(before)) if before[number] != after[number]] == [mutant.number - 1]


@pytest.fixture(scope="module")
def all_mutants() -> list[Mutant]:
    """Return all mutants."""
    return mutate.collect(list(mutate.FILES), [])


@pytest.mark.slow
@pytest.mark.parametrize("known", mutate.known_equivalents(), ids=lambda known: known.becomes)
def test_known_equivalents_match_existing_mutants(known, all_mutants):
    assert known.reason
    times = sum(known.excuses(mutant) for mutant in all_mutants)
    assert times, "the line is gone: take the entry away, or say what the line is now"
    assert times == 1, "say what stands above the line: there are several of them"


class Tree:
    """A tree of one file, and a test command that reads it."""

    def __init__(self, folder: Path) -> None:
        self.free = mutate.queue.SimpleQueue()
        (folder / "x.py").write_text("value = 1 < 2\n", encoding="utf-8")
        self.free.put(folder)
        self.folder = folder

    def run(self, command: str, copy: Path, limit: float) -> tuple[int, str]:
        text = (copy / "x.py").read_text(encoding="utf-8")
        return (0 if eval(command, {"text": text}) else 1), "said"


@pytest.mark.parametrize(("command", "outcome"), [("'<=' not in text", "killed"), ("'value' in text", "survived")])
def test_mutant_is_judged_and_reverted(tmp_path, command, outcome):
    tree = Tree(tmp_path)
    mutant = Mutant("x.py", 1, "relation", "value = 1 < 2", "value = 1 <= 2")
    verdict = mutate.judge(mutant, tree, [command], {command: 1.0})
    assert verdict.outcome == outcome
    assert (tmp_path / "x.py").read_text(encoding="utf-8") == "value = 1 < 2\n"
    assert tree.free.get_nowait() == tmp_path


def test_mutant_that_does_not_compile_is_stillborn(tmp_path):
    mutant = Mutant("x.py", 1, "sign", "value = 1 < 2", "value = 1 <")
    assert mutate.judge(mutant, Tree(tmp_path), ["True"], {"True": 1.0}).outcome == "stillborn"
