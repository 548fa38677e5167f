# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of depth cameras that compute one pixel at a time on the CPU, as they do on a GPU."""

import importlib.util
import sys

from warpvis.kernels import native_source


def compute_one_pixel_at_a_time(monkeypatch, *names):
    """Replace modules of `warpvis.kernels.sensors`, in the order of their imports, by copies with scalar numbers."""
    monkeypatch.setattr(native_source, "CPU_NUMBERS", "OnePixel")
    for name in names:
        full_name = f"warpvis.kernels.sensors.{name}"
        source = importlib.util.find_spec(full_name).origin
        spec = importlib.util.spec_from_file_location(f"one_pixel_{name}", source)
        copy = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, spec.name, copy)
        spec.loader.exec_module(copy)
        monkeypatch.setitem(sys.modules, full_name, copy)
