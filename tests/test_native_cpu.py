# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The C++ for CPUs, compiled by Clang with sanitizers and compared with double precision over random scenes.

`tests/native` holds the programs. Each prints the seeds of scenes that it finds a fault in; `check_images SEED 1` runs
one of them again.
"""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest
from native_build import CHECKS, ROOT, build

from warpvis.kernels.packets import HEADERS

pytestmark = pytest.mark.clang

SCENES = {"tree": 1500, "images": 240, "points": 160, "silhouettes": 120}
"""Random scenes of each check: a few seconds."""


@pytest.fixture(scope="session")
def programs(request) -> Path:
    """The folder of the checks' programs, which are kept from one session to the next."""
    cache = os.environ.get("WARPVIS_NATIVE_CACHE")
    return build(Path(cache) if cache else request.config.rootpath / ".pytest_cache" / "native")


@pytest.mark.parametrize("check", CHECKS)
def test_random_scenes(programs, check):
    options = {"UBSAN_OPTIONS": "print_stacktrace=1", "ASAN_OPTIONS": "detect_stack_use_after_return=1"}
    command = [str(programs / f"check_{check}"), "0", str(SCENES[check])]
    result = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **options})
    assert result.returncode == 0, (result.stdout + result.stderr)[-6000:]
    assert f"0 faults in {SCENES[check]} scenes" in result.stdout


def test_the_checks_have_the_headers_that_warp_compiles():
    text = (ROOT / "tests" / "native" / "headers.h").read_text(encoding="utf-8")
    casting = text.split("namespace casting {")[1].split("}")[0]
    included = re.findall(r'#include "([^"]+)"', casting)
    assert included == [*HEADERS, "cpu/points.h", "cpu/silhouettes.h"]
