# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""PTX that NVRTC compiles from a module's kernels, without a GPU too."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

_COMPILE = """
import sys, importlib, warp as wp
for name, folder in zip(sys.argv[1::2], sys.argv[2::2]):
    place, _, call = name.partition(":")
    module = importlib.import_module(place)
    module = eval(call, vars(module)).module if call else module
    wp.compile_aot_module(module, device=None, arch=90, module_dir=folder, use_ptx=True, strip_hash=True)
    print("compiled", name)
"""
_SIMPLE = "warpvis.kernels.casting.images"


def gpu_code(module: str, folder: Path) -> str:
    """Return the PTX of a module, compiled in a subprocess: compiling it here would make it another module.

    A call after a colon, as in ``module:make_kernel(16)``, makes a kernel, whose module is compiled instead.

    Skip the test if NVRTC cannot compile a simple module.
    """
    places = {_SIMPLE: folder / "simple", module: folder / "module"}
    for place in places.values():
        place.mkdir()
    words = [word for name, place in places.items() for word in (name, str(place))]
    done = subprocess.run([sys.executable, "-c", _COMPILE, *words], capture_output=True, text=True)
    if f"compiled {_SIMPLE}" not in done.stdout:
        pytest.skip("NVRTC is not there")
    assert done.returncode == 0, done.stderr[-2000:]
    (ptx,) = places[module].glob("*.ptx")
    return ptx.read_text(encoding="utf-8")
