# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Code of depth-camera models that only CUDA runs, compiled for the CPU, against rows of single pixels."""

import subprocess

import pytest
from native_build import ROOT, find_compiler

FLAGS = ["-std=c++17", "-O1", "-g1", "-ffp-contract=off", "-Wall", "-Wextra", "-Wno-unused-function"]
FLAGS += ["-Wno-unknown-pragmas", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-Ikernels/native"]


@pytest.mark.cxx
def test_threads_of_a_gpu_equal_rows(tmp_path):
    """The same bits, without reads or writes outside of images."""
    compiler = find_compiler()
    assert compiler is not None
    printed = []
    for name, options in (("rows", []), ("threads", ["-DEMULATES_CUDA"])):
        program = tmp_path / name
        command = [compiler, *FLAGS, *options, "tests/native/sensor_threads.cpp", "-o", program]
        subprocess.run(command, check=True, cwd=ROOT)
        printed.append(subprocess.run([program], check=True, capture_output=True, text=True).stdout.splitlines())
    rows, threads = printed
    assert len(rows) > 600
    assert rows == threads
