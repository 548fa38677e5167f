# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure the cost of writing a dataset: batch rendering against rendering alone, and its memory.

``python bench/bench_batch.py`` alternates between rendering 20,000 depth images of 320x240 into the same memory and
rendering the same images to a dataset on disk. It prints the ratio of the rates and how much the memory of the process
grew from the 2,000th frame to the last.
``python bench/bench_batch.py --engine ray --workers 1,2`` compares Ray workers of one core each, and
``python bench/bench_batch.py --device cuda:0 --device cuda:0,cuda:1`` GPUs.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import warpvis as wv
from warpvis.batch import BatchSummary, render_batch
from warpvis.batch._frame_renderer import ImageBuffers
from warpvis.cameras.frames import Frames
from warpvis.scenes import PRESETS

sys.path.insert(0, str(Path(__file__).parent))
from machine import OtherWork, describe

CAMERA = wv.Camera.from_fov(320, 240, hfov=0.994837)
MIN_RATIO, MAX_GROWTH, MIN_SPEEDUP = 0.6, 0.1, {"ray": 1.6, "local": 1.8}
FLAT_FROM = 2000
BATCHES = (16, 218)


def render_alone(scene: wv.Scene, poses: np.ndarray, outputs: tuple[str, ...], batch: int) -> float:
    """Return the rate of rendering into reused memory [frames/s]."""
    renderer = wv.Renderer(scene, CAMERA, outputs=outputs)
    views, _ = ImageBuffers(outputs, CAMERA, batch).first(batch)
    renderer.render(poses[:batch], out=views)
    count = len(poses) // batch * batch
    start = time.perf_counter()
    for first in range(0, count, batch):
        renderer.render(poses[first : first + batch], out=views)
    return count / (time.perf_counter() - start)


class Memory:
    """Resident memory of this process while shards are written, by the number of complete frames."""

    def __init__(self, out: Path, shard_frames: int, frames: int) -> None:
        """Watch the dataset in `out`."""
        self._records, self._shard_frames, self._frames = out / "shards", shard_frames, frames
        self._samples: list[tuple[int, int]] = []
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch)

    def __enter__(self) -> Memory:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._over.wait(0.05):
            shards = len(os.listdir(self._records)) if self._records.is_dir() else 0
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            self._samples.append((shards * self._shard_frames, pages * os.sysconf("SC_PAGE_SIZE")))

    def growth(self) -> tuple[float, int]:
        """Return the growth from the 2,000th frame to the last, maximum minus minimum, and the maximum [bytes]."""
        sizes = [size for frames, size in self._samples if FLAT_FROM <= frames < self._frames]
        return max(sizes) / min(sizes) - 1, max(sizes)


@contextmanager
def new_dataset(out: Path) -> Iterator[None]:
    """Return a folder that does not exist yet, and delete it afterwards."""
    if out.exists():
        sys.exit(f"{out} is there already; give another --out, which is deleted in the end")
    try:
        yield
    finally:
        shutil.rmtree(out, ignore_errors=True)


def write_batch(scene: wv.Scene, frames: Frames, arguments: argparse.Namespace, **settings: Any) -> BatchSummary:
    """Render to the dataset."""
    kind = {"format": arguments.format, "outputs": arguments.outputs.split(","), "options": arguments.options}
    return render_batch(scene, CAMERA, frames, arguments.out, shard_frames=arguments.shard_frames, **kind, **settings)


def compare_with_rendering(scene: wv.Scene, frames: Frames, arguments: argparse.Namespace) -> None:
    """Print both rates, measured in turns, their ratio, and the memory."""
    poses, outputs = frames.camera_to_world.astype(np.float32), tuple(arguments.outputs.split(","))
    ratios, growths = [], []
    for round_ in range(arguments.rounds):
        other_work = OtherWork()
        before = max(render_alone(scene, poses, outputs, batch) for batch in BATCHES)
        memory = Memory(arguments.out, arguments.shard_frames or BATCHES[-1], len(frames))
        with new_dataset(arguments.out), memory:
            summary = write_batch(scene, frames, arguments)
        rendering_rate = (before + max(render_alone(scene, poses, outputs, batch) for batch in BATCHES)) / 2
        ratios.append(summary.frames_per_second / rendering_rate)
        growth, size = memory.growth()
        growths.append(growth)
        print(
            f"round {round_ + 1}: alone {rendering_rate:.0f} frames/s, batch {summary.frames_per_second:.0f} frames/s "
            f"({summary.bytes / summary.seconds / 1e9:.2f} GB/s): {ratios[-1]:.0%}; "
            f"{size / 1e6:.0f} MB resident, within {growth:.1%} from frame {FLAT_FROM} on. {other_work.warning()}"
        )
    reached = "reached" if np.median(ratios) >= MIN_RATIO and max(growths) <= MAX_GROWTH else "MISSED"
    print(
        f"median {np.median(ratios):.0%} of rendering alone, at least {MIN_RATIO:.0%}; memory grew by "
        f"{max(growths):.1%}, at most {MAX_GROWTH:.0%}: {reached}"
    )


@contextmanager
def ray_cluster(cores: int | None) -> Iterator[None]:
    """Run a Ray cluster whose processes use only this number of cores; no cluster for None."""
    if cores is None:
        yield
        return
    import ray

    allowed = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, allowed[:cores])
    ray.init(num_cpus=cores, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
    try:
        yield
    finally:
        ray.shutdown()
        os.sched_setaffinity(0, allowed)


def steady_rate(out: Path, frames: int) -> float:
    """Return the rate of the last three quarters of the shards [frames/s]: by then all processes have started."""
    times = sorted(path.stat().st_mtime for path in (out / "shards").iterdir())
    first = len(times) // 4
    return frames * (len(times) - 1 - first) / len(times) / (times[-1] - times[first])


def compare_with_each_other(scene: wv.Scene, frames: Frames, arguments: argparse.Namespace) -> None:
    """Print the rates of engines with increasing numbers of workers or GPUs, and the speedup of the last."""
    choices: dict[str, tuple[int | None, dict[str, Any]]] = {
        name: (None, {"device": name}) for name in arguments.device
    }
    if arguments.engine == "ray":
        counts = map(int, arguments.workers.split(","))
        choices = {f"{count} workers": (count, {"engine": "ray", "workers": count}) for count in counts}
    rates: dict[str, list[float]] = {name: [] for name in choices}
    for round_ in range(arguments.rounds):
        for name, (cores, settings) in choices.items():
            with ray_cluster(cores), new_dataset(arguments.out):
                summary = write_batch(scene, frames, arguments, **settings)
                rates[name].append(steady_rate(arguments.out, len(frames)))
            total_rate = f"{summary.frames_per_second:.0f} with the start of processes"
            print(f"round {round_ + 1}: {name}: {rates[name][-1]:.0f} frames/s, {total_rate}")
    print(f"medians: {', '.join(f'{name} {np.median(rate):.0f}' for name, rate in rates.items())} frames/s")
    first, *_, last = map(np.array, rates.values())
    times, minimum = float(np.median(last / first)), MIN_SPEEDUP[arguments.engine]
    print(f"{times:.2f} times in the median round, at least {minimum}: {'reached' if times >= minimum else 'MISSED'}")


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=20_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--scene", default="blobs_77k", choices=sorted(PRESETS))
    parser.add_argument("--format", default="zarr")
    parser.add_argument("--outputs", default="depth")
    parser.add_argument("--options", nargs="*", default=[], help="KEY=VALUE of the format")
    parser.add_argument("--shard-frames", type=int)
    parser.add_argument("--engine", default="local", choices=("local", "ray"))
    parser.add_argument("--workers", default="1,2", help="numbers of Ray workers")
    parser.add_argument("--device", action="append", default=[], help="give it more than once to compare")
    parser.add_argument("--out", type=Path, default=Path("bench_batch_out"))
    arguments = parser.parse_args()
    arguments.options = dict(option.split("=", 1) for option in arguments.options)
    return arguments


def main() -> None:
    """Print the figures, and whether they reach their targets."""
    arguments = parse_arguments()
    print(describe(["warp-lang", "numpy", "zarr", "ray"]))
    scene = PRESETS[arguments.scene].build()
    frames = Frames.from_poses(PRESETS[arguments.scene].poses(arguments.frames))
    count = f"{arguments.frames:,} frames of {CAMERA.width}x{CAMERA.height}, {arguments.scene}"
    print(f"{count}, {arguments.outputs} to {arguments.format}, {os.path.abspath(arguments.out)}")
    if arguments.engine == "ray" or arguments.device:
        compare_with_each_other(scene, frames, arguments)
    else:
        compare_with_rendering(scene, frames, arguments)


if __name__ == "__main__":
    main()
