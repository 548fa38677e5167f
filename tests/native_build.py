# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compile and run the checks of `tests/native`, which include the CPU code of `kernels/native`, with Clang."""

from __future__ import annotations

import argparse
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SCENES = {"tree": 1500, "edges": 1000, "images": 600, "points": 160, "silhouettes": 120}
"""The checks and their numbers of random scenes, which take a few seconds."""

MIN_CLANG = 17
"""First version of Clang with the vector builtins of the headers."""

# Without AVX-512, the ABI of 16-lane vectors differs; each program is compiled as a whole, so it is consistent.
_FLAGS = (
    "-std=c++17",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-Wno-psabi",
    "-Wno-c++20-designator",
    "-Itests/native",
    "-Ikernels/native",
)
# Faults end the program at once; frame pointers make reports readable. Uninitialized variables get a pattern. Trailing
# arrays of structs have exactly their declared length.
_SANITIZERS = (
    "-O1",
    "-g1",
    "-fno-omit-frame-pointer",
    "-fsanitize=address,undefined",
    "-fstrict-flex-arrays=3",
    "-fno-sanitize-recover=all",
    "-ftrivial-auto-var-init=pattern",
)
_TARGET = ("-march=native",) if platform.machine() in ("x86_64", "AMD64") else ()
# The libraries of sanitizers are a separate package.
_PROBE = "#include <vector>\nint main() { return (int)std::vector<int>(1)[0]; }\n"


@cache
def find_clang() -> tuple[str, str]:
    """Return the newest clang++ that supports sanitizers and "", or "" and the reason that none does.

    `CLANGXX` overrides the search.
    """
    named = os.environ.get("CLANGXX")
    names = [named] if named else [*(f"clang++-{version}" for version in range(30, MIN_CLANG - 1, -1)), "clang++"]
    why = f"no clang++ of version {MIN_CLANG} or later is here"
    for name in names:
        if not (path := shutil.which(name)):
            continue
        version = subprocess.run([path, "-dumpversion"], capture_output=True, text=True).stdout.strip()
        if not version or int(version.split(".")[0]) < MIN_CLANG:
            why = f"{name} is of version {version or 'unknown'}, and {MIN_CLANG} is the least"
            continue
        with tempfile.TemporaryDirectory() as folder:
            command = [path, *_SANITIZERS, "-x", "c++", "-", "-o", str(Path(folder) / "probe")]
            result = subprocess.run(command, input=_PROBE, capture_output=True, text=True)
        if result.returncode == 0:
            return path, ""
        why = f"{name} has no sanitizers: {result.stderr.strip().splitlines()[-1]}"
    return "", why


@cache
def find_compiler() -> str | None:
    """Return a C++ compiler for code that does not need Clang: `CXX`, g++ or clang++; None if there is none."""
    names = (os.environ.get("CXX", ""), "g++", "clang++")
    return next((path for name in names if name and (path := shutil.which(name))), None) or find_clang()[0] or None


def cache_folder() -> Path:
    """Return the folder of objects and programs: pytest's cache or `WARPVIS_NATIVE_CACHE`."""
    return Path(os.environ.get("WARPVIS_NATIVE_CACHE") or ROOT / ".pytest_cache" / "native")


def sources(name: str) -> list[Path]:
    """Return the source files of an object: only `cast` contains the native code."""
    own = [path for path in (ROOT / "tests" / "native").rglob("*") if path.suffix == ".h" or path.stem == name]
    native = [*ROOT.glob("kernels/native/cpu/*.h"), *ROOT.glob("kernels/native/shared/*.h")]
    return sorted([*own, *native] if name == "cast" else own)


def run_clang(*options: str) -> subprocess.CompletedProcess[str]:
    """Run the compiler in the repository's root."""
    clang, why = find_clang()
    assert clang, why
    return subprocess.run([clang, *options], cwd=ROOT, capture_output=True, text=True)


def compile_object(folder: Path, name: str) -> Path:
    """Compile one of the sources unless the cache holds the result of the same source, options and compiler.

    Raises:
        AssertionError: If compilation fails; the text contains the compiler's output.
    """
    options = [*_FLAGS, *_TARGET, *(_SANITIZERS if name == "cast" else ("-O1",))]
    options += os.environ.get("WARPVIS_NATIVE_FLAGS", "").split()
    digest = hashlib.sha256(" ".join([run_clang("--version").stdout, platform.processor(), *options]).encode())
    for path in sources(name):
        digest.update(path.name.encode() + path.read_bytes())
    target = folder / f"{name}-{digest.hexdigest()[:16]}.o"
    if not target.is_file():
        for old in folder.glob(f"{name}-*.o"):  # keep one version only
            old.unlink()
        fresh = target.with_suffix(f".{os.getpid()}.tmp")
        result = run_clang(*options, "-c", f"tests/native/{name}.cpp", "-o", str(fresh))
        assert result.returncode == 0, result.stderr
        fresh.rename(target)
    return target


def build(folder: Path) -> Path:
    """Build the check programs, ``check_<name>`` for every name of `SCENES`.

    The native code is compiled with sanitizers, the reference code without, for speed.

    Args:
        folder: Folder of objects and programs.

    Returns:
        The folder.

    Raises:
        AssertionError: If compilation fails; the text contains the compiler's output.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names = ["cast", *(f"check_{name}" for name in SCENES)]
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        cast, *checks = pool.map(lambda name: compile_object(folder, name), names)
        for result in pool.map(
            lambda made: run_clang(*_SANITIZERS, str(cast), str(made[0]), "-o", str(folder / made[1])),
            zip(checks, names[1:], strict=True),
        ):
            assert result.returncode == 0, result.stderr
    return folder


def run_check(folder: Path, name: str, scenes: int) -> str:
    """Run a check program over random scenes; return its output if it finds a fault, else an empty string."""
    options = {"UBSAN_OPTIONS": "print_stacktrace=1", "ASAN_OPTIONS": "detect_stack_use_after_return=1"}
    command = [str(folder / f"check_{name}"), "0", str(scenes)]
    result = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **options})
    fine = result.returncode == 0 and f"0 faults in {scenes} scenes" in result.stdout
    return "" if fine else f"exit status {result.returncode}\n{result.stdout}{result.stderr}"[:8000]


def main() -> int:
    """Compile and run all checks; return 0 without faults, 1 with faults, 3 if the native code does not compile."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--has-clang", action="store_true", help="only check whether there is a compiler")
    arguments = parser.parse_args()
    if why := find_clang()[1]:
        sys.exit(why)
    if arguments.has_clang:
        return 0
    try:
        folder = build(cache_folder())
    except AssertionError as error:
        print(error)
        return 3
    for name, scenes in SCENES.items():
        if fault := run_check(folder, name, scenes):
            print(f"check_{name}: {fault}")
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
