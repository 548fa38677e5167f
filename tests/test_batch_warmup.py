# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Ahead-of-time kernel compilation."""

import pytest

import warpvis as wv
from warpvis.batch import warmup


def test_warmup(device):
    assert warmup(device, outputs=["depth"], casters=["packets"]) > 0
    with pytest.raises(wv.errors.ArrayError, match="outputs must be some of"):
        warmup(device, outputs=["tint"])
