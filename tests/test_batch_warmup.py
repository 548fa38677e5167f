# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels compiled ahead, by one process or by several that start at once."""

import subprocess
import sys

import pytest

import warpvis as wv
from warpvis.batch import warmup


def test_warmup(device):
    assert warmup(device, outputs=["depth"], casters=["packets"]) > 0
    with pytest.raises(wv.errors.ArrayError, match="outputs must be some of"):
        warmup(device, outputs=["colour"])


# A module of two little kernels: the same way to the cache as every other one, in less time.
_COLD = """
from warpvis.kernels.poses import poses_to_opencv
from warpvis.core.threads import load_module
load_module(poses_to_opencv)
"""


def test_many_processes_share_a_fresh_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("WARP_CACHE_PATH", str(tmp_path / "cache"))
    command = [sys.executable, "-c", _COLD]
    processes = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(4)]
    errors = [process.communicate()[1] for process in processes]
    assert [process.returncode for process in processes] == [0] * 4, errors
    assert list(tmp_path.glob("cache/**/wp_warpvis.kernels.poses*"))
