# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The source distribution, the wheel built from it, and an environment with the wheel installed."""

import re
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
from ruamel.yaml import YAML

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
SOURCES = ("warpvis", "kernels", "scenes", "pyproject.toml", "README.md", "LICENSE")


def run(*command, **options):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def build(kind, source, out):
    """Return a distribution built by this environment's setuptools, without downloads."""
    run(sys.executable, "-m", "build", f"--{kind}", "--no-isolation", "--outdir", out, source)
    (made,) = out.iterdir()
    return made


@pytest.fixture(scope="module")
def sdist(tmp_path_factory):
    copy = tmp_path_factory.mktemp("checkout")
    run("cp", "-r", *(ROOT / name for name in SOURCES), copy)
    return build("sdist", copy, tmp_path_factory.mktemp("sdist"))


@pytest.fixture(scope="module")
def wheel(sdist, tmp_path_factory):
    """Return a wheel built from the source distribution, as an installer does without a wheel."""
    unpacked = tmp_path_factory.mktemp("unpacked")
    with tarfile.open(sdist) as archive:
        archive.extractall(unpacked, filter="data")
    return build("wheel", next(unpacked.iterdir()), tmp_path_factory.mktemp("wheel"))


@pytest.mark.slow
def test_distributions_pass_index_checks(sdist, wheel):
    assert run(sys.executable, "-m", "twine", "check", "--strict", sdist, wheel).count("PASSED") == 2
    run(sys.executable, "-m", "check_wheel_contents", wheel)


@pytest.mark.slow
def test_wheel_contains_all_files_of_the_package(wheel):
    """Checks modules, headers and worlds, built through the source distribution."""
    inside = set(zipfile.ZipFile(wheel).namelist())
    places = {"warpvis": "warpvis", "kernels": "warpvis/kernels", "scenes": "warpvis/scenes"}
    for folder, place in places.items():
        kept = run("git", "ls-files", folder, cwd=ROOT).split() if (ROOT / ".git").exists() else []
        for name in kept:
            assert f"{place}/{name.removeprefix(folder + '/')}" in inside


@pytest.mark.slow
def test_wheel_runs_in_a_fresh_environment(wheel, tmp_path):
    """Dependencies come from this environment, the package itself from the wheel."""
    fresh = tmp_path / "fresh"
    venv.create(fresh, with_pip=False)
    python, bin_folder = fresh / "bin" / "python", fresh / "bin"
    there = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())
    (there / "needs.pth").write_text(sysconfig.get_path("purelib") + "\n")
    run(sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index", wheel)
    where = run(python, "-c", "import warpvis; print(warpvis.__file__)", cwd=tmp_path)
    assert Path(where.strip().splitlines()[-1]).is_relative_to(fresh)
    assert re.search(r"ball +object", run(bin_folder / "warpvis", "info", "experiment_3", cwd=tmp_path))


def test_metadata_agree():
    """Version, license and requirements agree between the project, the citation and the conda recipe."""
    yaml = YAML(typ="safe")
    citation, recipe = yaml.load(ROOT / "CITATION.cff"), yaml.load(ROOT / "conda" / "recipe.yaml")
    assert citation["version"] == recipe["context"]["version"] == PROJECT["version"]
    assert citation["license"] == recipe["about"]["license"] == PROJECT["license"]
    names = {"mujoco-python": "mujoco"}  # names at conda-forge
    needs = {names.get(need.split()[0], need.split()[0]) + need.split()[1] for need in recipe["requirements"]["run"]}
    assert needs == {*PROJECT["dependencies"], f"python{PROJECT['requires-python']}"}


def test_workflows_run_targets_of_the_makefile():
    yaml, makefile = YAML(typ="safe"), (ROOT / "Makefile").read_text()
    folder = ROOT / ".github" / "workflows"
    jobs = {name: job for path in folder.glob("*.yml") for name, job in yaml.load(path)["jobs"].items()}
    commands = [step["run"] for job in jobs.values() for step in job["steps"] if "run" in step]
    targets = {command.split()[1] for command in commands if re.match(r"make \w", command)}
    for job in jobs.values():
        targets |= set(job.get("strategy", {}).get("matrix", {}).get("target", ()))
    assert {"lint", "test", "test-slow", "docs", "test-browser", "test-lowest"} <= targets
    assert all(re.search(rf"^{target}:", makefile, re.MULTILINE) for target in targets)
    files = {word for command in commands for word in command.split() if word.startswith("tests/")}
    assert len(files) > 5
    assert all((ROOT / file).is_file() for file in files)
    assert all("timeout-minutes" in job for job in jobs.values())
    versions = set(jobs["systems"]["strategy"]["matrix"]["python"])
    assert versions >= {line.split()[-1] for line in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", line)}
