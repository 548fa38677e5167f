# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures: the devices of this machine, and EGL for the tests that render with MuJoCo."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
import warp as wp

wp.config.log_level = wp.LOG_WARNING

_PROBE = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
with mujoco.Renderer(model, 8, 8) as renderer:
    renderer.update_scene(mujoco.MjData(model))
    renderer.render()
"""
_NO_GL: list[str] = []


def _probe_gl() -> str:
    """Why mujoco.Renderer does not work here; empty if it does. Asked in another process: GL libraries may abort."""
    environment = {**os.environ, "MUJOCO_GL": "egl"}
    result = subprocess.run([sys.executable, "-c", _PROBE], env=environment, capture_output=True, text=True)
    return "" if result.returncode == 0 else (result.stderr.strip().splitlines() or ["it crashed"])[-1]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip tests that need GL where there is none, unless it is required: then they run, and fail."""
    needing = [item for item in items if item.get_closest_marker("gl")]
    if not needing:
        return
    reason = _probe_gl()
    if not reason or os.environ.get("WARPVIS_REQUIRE_GL") == "1":
        os.environ["MUJOCO_GL"] = "egl"  # before anything imports mujoco
        return
    _NO_GL.append(f"{len(needing)} tests that compare with mujoco.Renderer were SKIPPED: no EGL here ({reason}).")
    for item in needing:
        item.add_marker(pytest.mark.skip(reason=f"no EGL: {reason}"))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say loudly what was left out."""
    for line in _NO_GL:
        terminalreporter.section("NO OPENGL", yellow=True, bold=True)
        terminalreporter.line(line, yellow=True, bold=True)
        terminalreporter.line("On Debian and Ubuntu: apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri", yellow=True)


@pytest.fixture(params=["cpu", "cuda:0"])
def device(request: pytest.FixtureRequest) -> str:
    """Every device of this machine that is tested."""
    if request.param != "cpu" and not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    return request.param
