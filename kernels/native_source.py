# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The C++ headers of ``kernels/native``, which Warp compiles in front of a module's kernels."""

import re
from pathlib import Path

import warp as wp

_FOLDER = Path(__file__).parent / "native"
_FUSE = "#pragma clang fp contract(fast)\n"
_INCLUDE = re.compile(r'#include "(.+)"')

CPU_NUMBERS = "PixelLanes"
"""Numbers of formulas that `pixel_options` compiles for the CPU."""


def include_native(*names: str, cuda: bool = False, constants: str = "") -> wp.ModuleBuildOptions:
    """Return build options of a module (experimental in Warp 1.17) whose native functions call C++ of headers.

    The headers are in namespace ``warpvis`` of the module's source, which contains their text: what Warp compiles and
    hashes does not depend on where the package is installed, so that environments share a kernel cache, and cannot
    change between both. An unnamed namespace prevents the linker from merging functions of several modules.

    Args:
        names: Headers, relative to ``kernels/native``; the headers that they include follow.
        cuda: Whether the functions are compiled for CUDA instead of the CPU.
        constants: C++ that defines constants before the headers.
    """
    text = f"namespace warpvis {{ namespace {{\n{constants}{_expand(names, set())}}} }}\n"
    if cuda:
        return wp.ModuleBuildOptions(extra_cuda_preamble=text)
    return wp.ModuleBuildOptions(extra_cpu_preamble=text)


def _expand(names: tuple[str, ...], seen: set[str]) -> str:
    """Return the text of headers and, once each, of those that they include; `#line` directives name the files."""
    text = ""
    for name in names:
        if name in seen:
            continue
        seen.add(name)
        text += f'#line 1 "{name}"\n'
        for number, line in enumerate((_FOLDER / name).read_text(encoding="utf-8").splitlines(), 2):
            if match := _INCLUDE.fullmatch(line):
                text += f'{_expand((match[1],), seen)}#line {number} "{name}"\n'
            else:
                text += "\n" if line == "#pragma once" else f"{line}\n"
    return text


def pixel_options(
    *names: str, cpu: tuple[str, ...] = (), fused: bool = False
) -> dict[str, bool | wp.ModuleBuildOptions]:
    """Return options of a module whose formulas compute 16 pixels of a row at a time on the CPU, and one on CUDA.

    They are templates of the type of numbers, `PixelLanes` or `OnePixel`; for each device, ``PixelNumbers`` is one.
    Products and sums are not fused, so that CPU and CUDA compute the same bits, unless `fused` asks for it. `cpu` are
    headers for the CPU alone.
    """
    # Warp applies "fuse_fp" to CUDA only.
    of_lanes = (_FUSE if fused else "") + _pixel_numbers(CPU_NUMBERS)
    of_cpu = include_native("cpu/random_lanes.h", *names, *cpu, constants=of_lanes)
    cuda = include_native("shared/random.h", *names, cuda=True, constants=_pixel_numbers("OnePixel"))
    options = {"enable_backward": False, "default_grid_stride": False, "fuse_fp": fused}
    return options | {"extra_build_options": of_cpu.merged(cuda)}


def _pixel_numbers(name: str) -> str:
    return f"struct {name};\ntypedef {name} PixelNumbers;\n"
