# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The wheel contains the whole package and works outside the checkout; names, versions and lists agree."""

import ast
import importlib
import os
import re
import subprocess
import sys
import tomllib
import types
import zipfile
from pathlib import Path

import pytest

import warpvis

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())

_SMOKE = """
import pathlib, sys
import warpvis as wv
from warpvis import kernels, scenes
from warpvis.kernels.casting import rays
place = pathlib.Path(wv.__file__).resolve()
assert place.is_relative_to(pathlib.Path(sys.argv[1]).resolve()), place
assert (place.parent / "py.typed").is_file()
preset = scenes.PRESETS["experiment_1"]
views = wv.render(preset.build(), wv.Camera.from_fov(32, 24, hfov=1), preset.poses())
print(views.depth.shape)
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Return a wheel built from a copy with this environment's setuptools: no network, and no files in the checkout."""
    copy = tmp_path_factory.mktemp("source")
    for name in ("warpvis", "kernels", "scenes", "pyproject.toml", "README.md", "LICENSE"):
        subprocess.run(["cp", "-r", str(ROOT / name), str(copy)], check=True)
    out = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(copy)]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout + result.stderr
    return next(out.glob("warpvis-*.whl"))


@pytest.mark.slow
def test_wheel_contains_every_module(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    for folder, package in PROJECT["tool"]["setuptools"]["package-dir"].items():
        for path in (ROOT / package).rglob("*.py"):
            assert f"{folder.replace('.', '/')}/{path.relative_to(ROOT / package)}" in names
    assert "warpvis/py.typed" in names
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert not [name for name in names if name.startswith(("tests/", "bench/", "kernels/", "scenes/"))]


@pytest.mark.slow
def test_wheel_works_from_another_folder(wheel, tmp_path):
    target = tmp_path / "site"
    zipfile.ZipFile(wheel).extractall(target)
    environment = {**os.environ, "PYTHONPATH": str(target)}
    command = [sys.executable, "-c", _SMOKE, str(target)]
    result = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert "(1, 24, 32)" in result.stdout


def test_all_subpackages_are_listed():
    listed = set(PROJECT["tool"]["setuptools"]["packages"])
    assert listed == {
        name for name in modules() if (importlib.import_module(name).__file__ or "").endswith("__init__.py")
    }


def modules():
    """Return the names of all modules of the package, derived from its files."""
    for folder, package in PROJECT["tool"]["setuptools"]["package-dir"].items():
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT / package).with_suffix("").parts
            if parts[-1] != "__main__":
                yield ".".join((folder, *parts)).removesuffix(".__init__")


def test_every_module_imports():
    for name in modules():
        importlib.import_module(name)


def test_public_names_exist():
    for name in warpvis.__all__:
        assert getattr(warpvis, name) is not None
    assert callable(warpvis.render) and callable(warpvis.classify)
    with pytest.raises(AttributeError, match="No warpvis attribute nothing"):
        _ = warpvis.nothing


def test_public_names_have_one_import_path():
    """Public names of the package are in no subpackage's list, and no two subpackages list the same object."""
    homes = {}
    for package in warpvis.__all__:
        module = getattr(warpvis, package)
        if isinstance(module, types.ModuleType):
            for name in getattr(module, "__all__", ()):
                homes.setdefault(id(getattr(module, name)), []).append(f"{package}.{name}")
    for name in warpvis.__all__:
        homes.setdefault(id(getattr(warpvis, name)), []).append(name)
    assert [paths for paths in homes.values() if len(paths) > 1] == []


def test_top_level_package_is_small():
    names = [name for name in warpvis.__all__ if not isinstance(getattr(warpvis, name), types.ModuleType)]
    assert len(names) <= 36
    entries = [path.name for path in (ROOT / "warpvis").iterdir() if path.name != "__pycache__"]
    assert len(entries) <= 24


@pytest.mark.slow
def test_private_modules_are_not_imported_across_packages():
    """Modules whose names begin with _ are imported only within their package, also inside functions."""
    found = []
    for path in (ROOT / "warpvis").rglob("*.py"):
        own = path.relative_to(ROOT / "warpvis").parts[0]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("warpvis."):
                for name in (node.module, *(f"{node.module}.{alias.name}" for alias in node.names)):
                    first, *rest = name.split(".")[1:]
                    is_module = (ROOT / "warpvis" / first).joinpath(*rest).with_suffix(".py").is_file()
                    if first != own and is_module and any(part.startswith("_") for part in rest):
                        found.append(f"{path.relative_to(ROOT)}:{node.lineno} imports {name}")
    assert found == []


def test_versions_agree():
    assert PROJECT["project"]["version"] == warpvis.__version__
    assert f"## {warpvis.__version__}" in (ROOT / "CHANGELOG.md").read_text()


def test_constraints_contain_only_pinned_versions():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = {}
    for line in lines:
        if line and not line.startswith("#"):
            match = re.fullmatch(r"([A-Za-z0-9._-]+)==([A-Za-z0-9.]+)", line)
            assert match, line
            pins[match[1].lower().replace("_", "-")] = match[2]
    groups = PROJECT["dependency-groups"]
    named = [*PROJECT["project"]["dependencies"], *groups["test-core"], *groups["test"], *groups["lint"]]
    for requirement in [entry for entry in named if isinstance(entry, str)]:
        assert re.match(r"[A-Za-z0-9-]+", requirement)[0].lower() in pins, requirement
