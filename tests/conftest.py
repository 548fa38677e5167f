# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures for devices and casters, and requirements of tests: EGL, Clang or any C++ compiler."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

import pytest
import warp as wp

# Rewrite assertions of shared modules, so that failures print their values as in test modules.
_HELPERS = [path.stem for path in Path(__file__).parent.glob("*.py") if not path.stem.startswith(("test_", "conftest"))]
pytest.register_assert_rewrite("support", *_HELPERS)

from browser_pages import why_no_chromium
from native_build import find_clang, find_compiler

wp.config.log_level = wp.LOG_WARNING
if "WARPVIS_CPU_FLAGS" in os.environ:  # "-target-cpu haswell" for AVX2 alone, "" for Warp's generic target
    wp.config.cpu_compiler_flags = os.environ["WARPVIS_CPU_FLAGS"]

# JAX would reserve most of the GPU's memory in each process of the tests.
os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")

CUDA_DEVICES = ("cuda:0",) if wp.is_cuda_available() else ()
"""The tested GPU, if any."""

_PROBE = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
with mujoco.Renderer(model, 8, 8) as renderer:
    renderer.update_scene(mujoco.MjData(model))
    renderer.render()
"""


def _probe_gl() -> str:
    """Return why `mujoco.Renderer` fails here, or an empty string. Uses a subprocess: GL libraries may abort."""
    environment = {**os.environ, "MUJOCO_GL": "egl"}
    result = subprocess.run([sys.executable, "-c", _PROBE], env=environment, capture_output=True, text=True)
    return "" if result.returncode == 0 else (result.stderr.strip().splitlines() or ["it crashed"])[-1]


# Set before any test module imports mujoco, which reads the variable once. Processes of xdist inherit the result.
_NO_GL = os.environ.get("WARPVIS_NO_GL")
if _NO_GL is None:
    _NO_GL = os.environ["WARPVIS_NO_GL"] = _probe_gl()
if not _NO_GL:
    os.environ["MUJOCO_GL"] = "egl"


@dataclass(frozen=True)
class Need:
    """A requirement of marked tests. If it is missing, they skip, or fail if an environment variable is set."""

    variable: str
    missing: Callable[[], str]
    """Return why the requirement is not met, or an empty string."""
    title: str
    tests: str
    packages: str
    skipped: list[str] = field(default_factory=list)


NEEDS = {
    "gl": Need(
        "WARPVIS_REQUIRE_GL",
        lambda: _NO_GL,
        "NO OPENGL",
        "that compare with mujoco.Renderer",
        "libegl1 libegl-mesa0 libgl1-mesa-dri",
    ),
    "clang": Need(
        "WARPVIS_REQUIRE_CLANG",
        lambda: find_clang()[1],
        "NO CLANG",
        "of the C++ in kernels/native",
        "clang-19 libclang-rt-19-dev",
    ),
    "cxx": Need(
        "WARPVIS_REQUIRE_CXX",
        lambda: "" if find_compiler() else "no g++ or clang++ is here",
        "NO C++ COMPILER",
        "of the C++ in kernels/native/cuda, by an emulated warp,",
        "g++",
    ),
    "browser": Need(
        "WARPVIS_REQUIRE_CHROMIUM",
        why_no_chromium,
        "NO CHROMIUM",
        "of the live viewer",
        "chromium",
    ),
}


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip tests whose requirement is not met, or fail them where it is mandatory."""
    for marker, need in NEEDS.items():
        why = item.get_closest_marker(marker) and need.missing()
        if not why:
            continue
        if os.environ.get(need.variable) == "1":
            pytest.fail(f"{need.variable}=1, but this test cannot run here: {why}", pytrace=False)
        need.skipped.append(item.nodeid)
        pytest.skip(f"{need.title.lower()}: {why}")


@pytest.hookimpl(tryfirst=True)  # before pytest evaluates -m
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the parameters that `smoke` does not list as slow, and deselect GPU tests without a GPU."""
    _mark_slow(items)
    if CUDA_DEVICES:
        return
    needs_cuda = [item for item in items if "cuda" in getattr(item, "fixturenames", ())]
    if needs_cuda:
        config.hook.pytest_deselected(items=needs_cuda)
        items[:] = [item for item in items if "cuda" not in getattr(item, "fixturenames", ())]


def pytest_collection_finish() -> None:
    """Exclude modules and collected tests from garbage collections, which are several times faster then."""
    gc.collect()
    gc.freeze()


def _mark_slow(items: list[pytest.Item]) -> None:
    """Mark tests as slow whose parameters match no pattern of their `smoke` marker, except tests on a GPU."""
    for item in items:
        smoke = item.get_closest_marker("smoke")
        if smoke and isinstance(item, pytest.Function) and "cuda" not in item.callspec.id:
            if not any(fnmatchcase(item.callspec.id, pattern) for pattern in smoke.args):
                item.add_marker(pytest.mark.slow)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Report which tests were deselected."""
    if not CUDA_DEVICES:
        terminalreporter.section("NO CUDA DEVICE", yellow=True, bold=True)
        terminalreporter.line("Tests on a GPU were left out.", yellow=True)
    for need in NEEDS.values():
        if not need.skipped:
            continue
        terminalreporter.section(need.title, yellow=True, bold=True)
        line = f"{len(need.skipped)} tests {need.tests} were SKIPPED: {need.missing()}."
        terminalreporter.line(line, yellow=True, bold=True)
        terminalreporter.line(f"On Debian and Ubuntu: apt-get install {need.packages}", yellow=True)


@pytest.fixture
def cuda() -> Iterator[str]:
    """Return the name of the GPU. Tests that use it are deselected without a GPU."""
    yield from _device("cuda:0")


@pytest.fixture(params=["cpu", *CUDA_DEVICES])
def device(request: pytest.FixtureRequest) -> Iterator[str]:
    """Yield the name of every tested device."""
    yield from _device(request.param)


def _device(name: str) -> Iterator[str]:
    """Yield a device's name and restore its stream afterwards.

    `wp.array.numpy` sets another stream temporarily. If several threads do so at once, that stream may remain set, and
    no graph can be captured on it.
    """
    if name == "cpu":
        yield name
        return
    stream = wp.get_stream(name)
    yield name
    wp.set_stream(stream, name)


@pytest.fixture(params=["rays", "packets"])
def caster(request: pytest.FixtureRequest, device: str) -> str:
    """Return the name of every caster; all are available on every device."""
    return request.param
