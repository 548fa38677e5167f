# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure both casters: depth of every preset at 320x240."""

import pytest

import warpvis as wv


@pytest.mark.benchmark(group="casters, depth")
@pytest.mark.parametrize("name", [name for name in wv.scenes.PRESETS if name != "terrain_50m"])  # sized for a GPU
def test_depth(measure_casting, name):
    measure_casting(name, ("depth",))
