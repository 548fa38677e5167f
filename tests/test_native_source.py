# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The headers of ``kernels/native`` as Warp compiles them."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
import warp as wp
from gpu_code import gpu_code

from warpvis.kernels import native_source
from warpvis.kernels.native_source import include_native


@pytest.fixture
def headers(tmp_path, monkeypatch) -> Path:
    """Return a folder that replaces ``kernels/native``."""
    monkeypatch.setattr(native_source, "_FOLDER", tmp_path)
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared" / "number.h").write_text("#pragma once\n\nconstexpr int NUMBER = 1;\n")
    (tmp_path / "value.h").write_text(
        '#pragma once\n\n#include "shared/number.h"\n\n'
        "template <int N>\nstruct Value {\n    static constexpr int TWICE = 2 * N;\n};\n"
    )
    return tmp_path


def make_kernel() -> wp.Kernel:
    @wp.func_native("values[0] = warpvis::Value<warpvis::NUMBER>::TWICE;")
    def write_value(values: wp.array[wp.int32]): ...

    @wp.kernel(
        module="unique", enable_backward=False, module_options={"extra_build_options": include_native("value.h")}
    )
    def write_values(values_out: wp.array[wp.int32]):
        write_value(values_out)

    return write_values


def run(kernel: wp.Kernel) -> int:
    values = wp.zeros(1, dtype=wp.int32, device="cpu")
    wp.launch(kernel, dim=1, inputs=[values], device="cpu")
    return int(values.numpy()[0])


def test_a_changed_header_recompiles_the_modules_that_include_it(headers):
    before = make_kernel()
    assert run(before) == 2
    header = headers / "shared" / "number.h"
    header.write_text(header.read_text().replace("= 1", "= 21"))
    after = make_kernel()
    assert after.module.name != before.module.name
    assert run(after) == 42


def test_what_is_compiled_does_not_depend_on_the_folder(headers, monkeypatch):
    name = make_kernel().module.name
    moved = headers.parent / "moved"
    shutil.copytree(headers, moved)
    shutil.rmtree(moved / "shared")
    shutil.move(headers / "shared", moved)
    monkeypatch.setattr(native_source, "_FOLDER", moved)
    assert make_kernel().module.name == name


def test_a_header_is_included_once_after_those_that_it_includes():
    text = include_native("cpu/packets.h", "cpu/walk.h").extra_cpu_preamble
    names = [name for number, name in re.findall(r'#line (\d+) "(.+)"', text) if number == "1"]
    assert len(names) == len(set(names)) > 20
    assert names[0] == "cpu/packets.h"
    assert text.index("struct Walk {") < text.index("struct Packets {")
    assert "#pragma once" not in text
    assert "#include" not in text


def test_lines_are_numbered_as_in_the_header():
    text = include_native("cpu/objects.h").extra_cpu_preamble
    number, rest = text.rpartition("#line ")[2].split(' "cpu/objects.h"\n')
    lines = (native_source._FOLDER / "cpu" / "objects.h").read_text(encoding="utf-8").splitlines()
    assert rest.splitlines()[:-1] == lines[int(number) - 1 :]
    assert int(number) < 20


@pytest.mark.parametrize(
    "kernel",
    [
        "packets_cuda:make_packet_kernel(16, True, True, True, True)",
        "packets_cuda:make_find_kernel(True)",
        "packets_cuda:make_packet_kernel(32, True, False, True, False, 256)",
        "packets_cuda:make_ray_packet_kernel(32, False, False)",
        "packets_cuda:make_ray_packet_kernel(32, True, True, False, 1024, True)",
    ],
)
def test_variants_of_packets_compile_for_gpus(kernel, tmp_path):
    code = gpu_code(f"warpvis.kernels.casting.{kernel}", tmp_path)
    assert ".entry" in code
