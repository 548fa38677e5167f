# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Devices of JAX and PyTorch for tests that have the `device` fixture."""

import pytest
import warp as wp

jax = pytest.importorskip("jax")


@pytest.fixture(autouse=True)
def jax_device(request):
    """Use the JAX device of the test's `device`, or the CPU."""
    device = request.getfixturevalue("device") if "device" in request.fixturenames else "cpu"
    try:
        default = wp.device_to_jax(device)
    except RuntimeError:
        pytest.skip(f"JAX has no device {device}")
    with jax.default_device(default):
        yield


def import_torch(device):
    """Return PyTorch, its part of warpvis, and its name of the device."""
    torch, wt = pytest.importorskip("torch"), pytest.importorskip("warpvis.torch")
    if "cuda" in device and not torch.cuda.is_available():
        pytest.skip("needs CUDA in PyTorch")
    return torch, wt, device.replace("cpu:0", "cpu")
