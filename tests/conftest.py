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
if "WARPVIS_CPU_FLAGS" in os.environ:  # "-target-cpu haswell" for AVX2 alone, "" for Warp's generic target
    wp.config.cpu_compiler_flags = os.environ["WARPVIS_CPU_FLAGS"]

_PROBE = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
with mujoco.Renderer(model, 8, 8) as renderer:
    renderer.update_scene(mujoco.MjData(model))
    renderer.render()
"""


def _probe_gl() -> str:
    """Why mujoco.Renderer does not work here; empty if it does. Asked in another process: GL libraries may abort."""
    environment = {**os.environ, "MUJOCO_GL": "egl"}
    result = subprocess.run([sys.executable, "-c", _PROBE], env=environment, capture_output=True, text=True)
    return "" if result.returncode == 0 else (result.stderr.strip().splitlines() or ["it crashed"])[-1]


# Before any test module imports mujoco, which reads the variable once.
_NO_GL = _probe_gl()
if not _NO_GL:
    os.environ["MUJOCO_GL"] = "egl"
_skipped: list[str] = []


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip tests that need GL where there is none, or fail them where it is required."""
    if item.get_closest_marker("gl") and _NO_GL:
        if os.environ.get("WARPVIS_REQUIRE_GL") == "1":
            pytest.fail(f"WARPVIS_REQUIRE_GL=1, but mujoco.Renderer does not work here: {_NO_GL}", pytrace=False)
        _skipped.append(item.nodeid)
        pytest.skip(f"no EGL: {_NO_GL}")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say loudly what was left out."""
    if _skipped:
        terminalreporter.section("NO OPENGL", yellow=True, bold=True)
        terminalreporter.line(
            f"{len(_skipped)} tests that compare with mujoco.Renderer were SKIPPED: no EGL here ({_NO_GL}).",
            yellow=True,
            bold=True,
        )
        terminalreporter.line("On Debian and Ubuntu: apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri", yellow=True)


@pytest.fixture(params=["cpu", "cuda:0"])
def device(request: pytest.FixtureRequest) -> str:
    """Every device of this machine that is tested."""
    if request.param != "cpu" and not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    return request.param


@pytest.fixture(params=["rays", "packets"])
def caster(request: pytest.FixtureRequest, device: str) -> str:
    """Every caster; all are on every device."""
    return request.param
