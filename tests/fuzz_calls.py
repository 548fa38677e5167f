# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Random arguments for all public functions: a call must succeed or raise a `WarpvisError` of one sentence.

``make fuzz`` makes many such calls, each from a seed that the report names; `test_garbage` makes a few.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

import warpvis as wv

_EXTREMES = (0, 1, -1, 2, 7, 255, 256, 2**31 - 1, 2**31, -(2**31), 2**53, 2**63, 2**64, 10**30, -(10**400))
_REALS = (0.0, -0.0, 1e-300, 1e-12, 1e-3, 0.5, 1.0, 3.15, 1e6, 1e18, 1e38, 1e39, 1e300, np.inf, -np.inf, np.nan)
_WORDS = ("", " ", "a", "box", "*", "[", "cpu", "cuda:99", "depth", "z", "\0", "ü", "a" * 5000, "../..", "kinect", "1")
_ODD = (b"", b"ab", object(), len, int, 1j, Ellipsis, {1, 2}, range(3), np.float32(2), np.int8(3))
_DTYPES = ("f8", "f4", "f2", "i8", "i4", "u1", "?", "c16", "U3", "O", "M8[s]", "V4")


class Draw:
    """Random values of all kinds."""

    def __init__(self, rng: np.random.Generator) -> None:
        """Store the generator."""
        self._rng = rng

    def pick(self, values):
        """Return a random element of `values`."""
        return values[int(self._rng.integers(len(values)))]

    def real(self):
        """Return a number: extreme, or of any magnitude."""
        return (
            self.pick(_REALS)
            if self._rng.random() < 0.5
            else float(self._rng.normal() * 10.0 ** self._rng.integers(-9, 10))
        )

    def whole(self):
        """Return an integer."""
        return self.pick(_EXTREMES) if self._rng.random() < 0.5 else int(self._rng.integers(-20, 200))

    def array(self):
        """Return an array of any dtype with up to four axes of up to eight entries."""
        shape = tuple(self._rng.integers(0, 9, self._rng.integers(0, 5)))
        dtype = self.pick(_DTYPES)
        values = self._rng.normal(size=shape) * self.pick((1.0, 1e-9, 1e9, 1e30))
        if dtype in ("O", "U3", "V4", "M8[s]"):
            return np.zeros(shape, dtype=dtype)
        with np.errstate(all="ignore"):
            return values.astype(dtype)

    def anything(self, depth: int = 0):
        """Return a value of any kind."""
        kinds = [
            lambda: None,
            lambda: bool(self._rng.integers(2)),
            self.whole,
            self.real,
            lambda: self.pick(_WORDS),
            self.array,
            lambda: self.pick(
                (b"", b"ab", object(), len, int, 1j, Ellipsis, {1, 2}, range(3), np.float32(2), np.int8(3))
            ),
            lambda: Path(self.pick(("", "a", "no/where"))),
        ]
        if depth < 3:
            many = lambda: int(self._rng.integers(0, 5))  # noqa: E731
            kinds += [
                lambda: [self.anything(depth + 1) for _ in range(many())],
                lambda: tuple(self.anything(depth + 1) for _ in range(many())),
                lambda: {self.pick(_WORDS): self.anything(depth + 1) for _ in range(many())},
                lambda: [self.real() for _ in range(many() * 2)],
            ]
        return self.pick(kinds)()

    def spoiled(self, value):
        """Return a valid value with one change: scaled, cropped, repeated, transposed, recast, or with a bad entry."""
        if isinstance(value, bool) or value is None or isinstance(value, str):
            return self.anything()
        if isinstance(value, int | float):
            return type(value)(value * self.pick((-1, 0, 2, 1000))) if self._rng.random() < 0.5 else self.real()
        try:
            array = np.array(value)
        except Exception:
            return self.anything()
        if array.dtype.kind not in "fiub" or not array.size:
            return self.anything()
        change = self._rng.integers(6)
        with np.errstate(all="ignore"):
            if change == 0:
                return array.astype(np.float64) * self.pick((1e-30, 1e-6, -1, 1e6, 1e30))
            if change == 1:
                array = array.astype(np.float64)
                array.flat[int(self._rng.integers(array.size))] = self.real()
                return array
            if change == 2:
                return array[..., :-1]
            if change == 3:
                return np.repeat(array[None], int(self._rng.integers(0, 4)), axis=0)
            if change == 4:
                return array.T
            return array.astype(self.pick(_DTYPES[:6]))


def call_once(table, seed):
    """Make one call; return its name, the changed parameters, and the error unless it is a valid `WarpvisError`."""
    rng = np.random.default_rng(seed)
    draw, names = Draw(rng), sorted(table)
    name = draw.pick(names)
    function, arguments = table[name]
    chosen = rng.permutation(sorted(arguments))[: int(rng.integers(1, 4))].tolist()
    changed = {
        parameter: draw.anything() if rng.random() < 0.5 else draw.spoiled(arguments[parameter]) for parameter in chosen
    }
    try:
        function(**{**arguments, **changed})
    except wv.WarpvisError as error:
        return name, changed, None if str(error).strip() else "an error that says nothing"
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return name, changed, f"{type(error).__name__}: {str(error)[:150]} ({Path(where.filename).name}:{where.lineno})"
    return name, changed, None


def main() -> None:
    """Make many calls and report failures with their seeds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0, help="of the first call; the others count up")
    parser.add_argument(
        "--gigabytes", type=float, default=12.0, help="address space of this process, so that none is ended for it"
    )
    given = parser.parse_args()
    import resource

    from support.garbage import cases, files_for_cases

    limit = int(given.gigabytes * 1e9)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    warnings.simplefilter("ignore")
    wrong, slow, calls = Counter(), [], Counter()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        table = cases(files_for_cases(Path(folder)))
        os.chdir(Path(folder) / "out")
        for seed in range(given.seed, given.seed + given.count):
            if (seed - given.seed) % 2000 == 1999:  # calls add objects to scenes: rebuild them regularly
                table = cases(Path(folder))
            start = time.perf_counter()
            name, changed, error = call_once(table, seed)
            seconds, calls[name] = time.perf_counter() - start, calls[name] + 1
            if seconds > 5:
                slow.append(f"{name} took {seconds:.0f} s (seed {seed}: {str(changed)[:200]})")
            if error is not None:
                key = f"{name}: {error}"
                if not wrong[key]:
                    print(f"seed {seed}: {key}\n    {str(changed)[:300]}", flush=True)
                wrong[key] += 1
        os.chdir("/")
    print(
        f"{sum(calls.values())} calls of {len(calls)} functions, {len(wrong)} kinds of wrong errors, {len(slow)} slow"
    )
    print("\n".join(slow[:20]))
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
