# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""C++ for CPUs, compiled by Clang with sanitizers and compared with double precision on random scenes.

`tests/native` contains the programs. Each prints the seeds of failing scenes; `check_images SEED 1` runs one scene
again.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from native_build import ROOT, SCENES, build, cache_folder, run_check

pytestmark = [pytest.mark.clang, pytest.mark.slow]


@pytest.fixture(scope="session")
def programs() -> Path:
    """Return the folder of the check programs, which is cached between sessions."""
    return build(cache_folder())


@pytest.mark.parametrize("check", SCENES)
def test_random_scenes_have_no_faults(programs, check):
    fault = run_check(programs, check, SCENES[check])
    assert not fault, fault


def test_guarded_arena_has_the_interface_of_the_arena():
    face = re.compile(r"inline [^(]+\([^)]*\)|^    char\* base;|^    long long used;", re.MULTILINE)
    places = ("kernels/native/cpu/arena.h", "tests/native/cpu/arena.h")
    real, guarded = (face.findall((ROOT / place).read_text(encoding="utf-8")) for place in places)
    assert real == guarded
    assert len(real) == 7
