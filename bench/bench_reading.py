# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure reading frames of a dataset in random order: `warpvis.open_dataset` against zarr-python and `numpy.load`.

``python bench/bench_reading.py --out DIR`` writes frames of 320x240 in several formats, and one process reads all of
them in random order, alternating with the peers. The files are in the page cache, like a dataset that fits into memory;
``--cold`` drops the cache before every round, which requires root.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import warpvis as wv
from warpvis.scenes import PRESETS

sys.path.insert(0, str(Path(__file__).parent))
from machine import describe

CAMERA = wv.Camera.from_fov(320, 240, hfov=0.994837)
MIN_RAW = 5000
FORMATS = {"npz": {}, "zarr": {}, "zarr, zstd": {"compression": "zstd"}, "png": {}}
Read = Callable[[int], object]


def write(out: Path, scene: str, count: int) -> None:
    """Write datasets of all `FORMATS`, and return them by name."""
    shutil.rmtree(out, ignore_errors=True)
    poses = PRESETS[scene].poses(count)
    for name, options in FORMATS.items():
        kind = name.split(",")[0]
        wv.render_batch(
            PRESETS[scene].build(), CAMERA, wv.Frames.from_poses(poses), out / name, format=kind, options=options
        )


def readers(out: Path) -> dict[str, Read]:
    """Return readers of one frame's depth by name."""
    import zarr

    datasets = {name: wv.open_dataset(out / name) for name in FORMATS}
    shard = _shard_frames(out / "npz")
    arrays = {name: zarr.open_group(out / name / "data.zarr", mode="r")["depth"] for name in ("zarr", "zarr, zstd")}
    found: dict[str, Read] = {name: dataset.__getitem__ for name, dataset in datasets.items()}
    found |= {f"{name}, by zarr-python": array.__getitem__ for name, array in arrays.items()}
    found["npz, by numpy.load"] = lambda i: np.load(out / "npz" / f"shard-{i // shard:06d}.npz")["depth"][i % shard]
    return found


def _shard_frames(folder: Path) -> int:
    return int(json.loads((folder / "manifest.json").read_text())["shard_frames"])


def measure(read: Read, order: np.ndarray, seconds: float) -> float:
    """Return the rate of reading [frames/s]."""
    start, count = time.perf_counter(), 0
    for index in order.tolist():
        read(index)
        count += 1
        if time.perf_counter() - start > seconds:
            break
    return count / (time.perf_counter() - start)


def main() -> None:
    """Print the rates, and whether raw shards reach their target."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=4000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=2.0, help="of each reader in a round, at most")
    parser.add_argument("--scene", default="blobs_77k", choices=sorted(PRESETS))
    parser.add_argument("--cold", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("bench_reading_out"))
    arguments = parser.parse_args()
    print(describe(["numpy", "zarr", "numcodecs"]))
    write(arguments.out, arguments.scene, arguments.frames)
    rng = np.random.default_rng(0)
    rates: dict[str, list[float]] = {}
    for round_ in range(-1, arguments.rounds):  # the first round fills the page cache
        for name, read in readers(arguments.out).items():
            if arguments.cold:
                os.sync()
                Path("/proc/sys/vm/drop_caches").write_text("1")
            rate = measure(read, rng.permutation(arguments.frames), arguments.seconds)
            if round_ >= 0:
                rates.setdefault(name, []).append(rate)
    for name, rounds in rates.items():
        print(f"{name:28} {np.median(rounds):8,.0f} frames/s (from {min(rounds):,.0f} to {max(rounds):,.0f})")
    raw = min(np.median(rates[name]) for name in ("npz", "zarr"))
    verdict = "reached" if raw >= MIN_RAW else "MISSED"
    print(f"raw shards, in random order: {raw:,.0f} frames/s, at least {MIN_RAW}: {verdict}")
    shutil.rmtree(arguments.out)


if __name__ == "__main__":
    main()
