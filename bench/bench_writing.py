# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure how fast one process encodes and writes datasets, by number of threads, against common writers.

``python bench/bench_writing.py`` renders depth images of 320x240, and color images above a checkered floor, once. A job
then writes depth repeatedly as PNG, as Zarr with zstd, and as raw npz, and color as PNG, JPEG and WebP, into each of
the folders ``--out``, so that only encoding and writing take time. Files are synced, as in every job. The peers
`cv2.imwrite` in a loop, zarr-python and `numpy.savez` do not sync. The table names peers that are not installed. The
rates of rendering alone, with all threads, precede it. ``--size 640x480`` selects another size.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import warpvis as wv
from warpvis.batch._dataset import Record
from warpvis.batch._frame_renderer import Batch, ImageBuffers
from warpvis.batch._render_batch import make_plan
from warpvis.batch._writer import Job, ShardWriter
from warpvis.batch.formats._base import find_format
from warpvis.batch.storage._stores import open_store
from warpvis.cameras.frames import Frames
from warpvis.core.threads import core_count
from warpvis.scene.lights import Light
from warpvis.scene.materials import Appearance, Material, Texture
from warpvis.scenes import PRESETS

sys.path.insert(0, str(Path(__file__).parent))
from machine import OtherWork, describe

SHARD = 218
MAX_SHARDS = 4000
FORMATS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "png": ("depth", "png", {}),
    "zarr, zstd": ("depth", "zarr", {"compression": "zstd"}),
    "npz": ("depth", "npz", {}),
    "color png": ("color", "png", {}),
    "color jpeg": ("color", "png", {"color": "jpeg"}),
    "color webp": ("color", "png", {"color": "webp"}),
}
"""Output, format and options of each row."""
MIN_TIMES = 8.0
"""Minimum speedup of PNG and of Zarr by 16 threads on 16 cores."""
Peer = Callable[[Path, np.ndarray, float], float]


class Rendered:
    """A substitute for `FrameRenderer` that returns the same images every time."""

    def __init__(self, output: str, images: np.ndarray) -> None:
        """Store the images of one shard, aligned to a page as a renderer's are."""
        _, self._images = ImageBuffers((output,), camera_of(images), len(images)).first(len(images))
        self._images[output][:] = images

    def render(self, batch: Batch, *, out: ImageBuffers) -> dict[str, np.ndarray]:
        """Return the images."""
        return {name: image[: len(batch["camera_to_world"])] for name, image in self._images.items()}


def camera_of(images: np.ndarray) -> wv.Camera:
    """Return the camera of images ``(n, H, W, ...)``."""
    return wv.Camera.from_fov(images.shape[2], images.shape[1], hfov=0.994837)


def render_once(preset: str, width: int, height: int) -> dict[str, np.ndarray]:
    """Return the depth and color images of one shard, and print how fast they are rendered."""
    scene = PRESETS[preset].build()
    least, greatest = scene.bounds
    x0, y0, x1, y1, z = *(2 * least[:2] - greatest[:2]), *(2 * greatest[:2] - least[:2]), least[2]
    corners, faces = np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]]), np.array([[0, 1, 2], [0, 2, 3]])
    checker = np.where((np.indices((64, 64)).sum(axis=0) % 2 == 0)[..., None], [210, 200, 180], [40, 60, 50])
    uv = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)[faces]
    floor = Appearance((Material(texture=Texture(checker.astype(np.uint8))),), uv=uv)
    scene.add((corners, faces), name="checkered floor", appearance=floor)
    scene.lights = Light("directional", direction=(0.3, 0.4, -1.0), ambient=(0.3, 0.3, 0.3))
    images, poses = {}, PRESETS[preset].poses(SHARD)
    for output in ("depth", "color"):
        renderer = wv.Renderer(scene, wv.Camera.from_fov(width, height, hfov=0.994837), outputs=(output,))
        views = renderer.render(poses)
        start = time.perf_counter()
        images[output] = getattr(renderer.render(poses, out=views), output).numpy()
        print(f"rendering {output} alone: {SHARD / (time.perf_counter() - start):,.0f} frames/s")
    return images


def write(out: Path, name: str, images: np.ndarray, threads: int, seconds: float) -> tuple[float, dict[str, object]]:
    """Return the rate with this number of threads [frames/s], and sizes and checksums of the first shard's files."""
    output, kind, options = FORMATS[name]
    scene = wv.Scene()
    scene.add(([[0, 0, 1], [1, 0, 1], [0, 1, 1]], [[0, 1, 2]]), name="triangle")
    frames = Frames.from_poses(np.tile([0.0, 0, 0, 0, 0, 0, 1], (SHARD * MAX_SHARDS, 1)))
    layout, camera = find_format(kind), camera_of(images)
    plan = make_plan(scene, camera, frames, layout, outputs=[output], shard_frames=SHARD, options=options)
    store = open_store(out)
    store.create()
    records: dict[int, Record] = {}

    def shards() -> Iterator[int]:
        for shard in range(MAX_SHARDS):
            if time.perf_counter() - start > seconds and shard >= 2:
                return
            yield shard

    with ShardWriter(Job(plan, scene, kind, os.fspath(out)), device="cpu", threads=threads) as writer:
        writer._renderer = Rendered(output, images)  # type: ignore[assignment]
        if writer._processes is not None:
            writer._processes.ready()
        start = time.perf_counter()
        writer.run(shards(), records.__setitem__)
        rate = SHARD * len(records) / (time.perf_counter() - start)
    return rate, dict(records[0].files)


def cv2_in_a_loop(out: Path, depth: np.ndarray, seconds: float) -> float:
    """Return the rate of writing 16-bit PNG with OpenCV [frames/s]."""
    import cv2

    out.mkdir()
    start, count = time.perf_counter(), 0
    while time.perf_counter() - start < seconds:
        image = depth[count % len(depth)]
        units = np.where(np.isfinite(image), np.rint(image * 1000), 0).astype(np.uint16)
        cv2.imwrite(str(out / f"{count:06d}.png"), units)
        count += 1
    return count / (time.perf_counter() - start)


def zarr_python(out: Path, depth: np.ndarray, seconds: float) -> float:
    """Return the rate of writing shards of the same layout with zarr-python and its default threads [frames/s]."""
    import zarr
    from zarr.codecs import ZstdCodec

    shape = (SHARD * MAX_SHARDS, *depth.shape[1:])
    array = zarr.create_group(out).create_array(
        "depth", shape=shape, chunks=(1, *shape[1:]), shards=(SHARD, *shape[1:]), dtype="float32",
        compressors=ZstdCodec(level=1),
    )  # fmt: skip
    start, shard = time.perf_counter(), 0
    while time.perf_counter() - start < seconds:
        array[shard * SHARD : (shard + 1) * SHARD] = depth
        shard += 1
    return shard * SHARD / (time.perf_counter() - start)


def savez_in_a_loop(out: Path, depth: np.ndarray, seconds: float) -> float:
    """Return the rate of writing one file per shard with `numpy.savez` [frames/s]."""
    out.mkdir()
    start, shard = time.perf_counter(), 0
    while time.perf_counter() - start < seconds:
        np.savez(out / f"{shard:06d}.npz", depth=depth)
        shard += 1
    return shard * SHARD / (time.perf_counter() - start)


def cv2_of_colors(suffix: str, flags: list[int]) -> Peer:
    """Return a peer that writes color images with OpenCV."""

    def write_colors(out: Path, images: np.ndarray, seconds: float) -> float:
        import cv2

        out.mkdir()
        start, count = time.perf_counter(), 0
        while time.perf_counter() - start < seconds:
            cv2.imwrite(str(out / f"{count:06d}{suffix}"), images[count % len(images)][..., ::-1], flags)
            count += 1
        return count / (time.perf_counter() - start)

    return write_colors


PEERS: dict[str, tuple[str, Peer]] = {
    "png": ("cv2.imwrite", cv2_in_a_loop),
    "zarr, zstd": ("zarr-python", zarr_python),
    "npz": ("numpy.savez", savez_in_a_loop),
    "color png": ("cv2.imwrite", cv2_of_colors(".png", [])),
    "color jpeg": ("cv2.imwrite", cv2_of_colors(".jpg", [1, 95])),  # IMWRITE_JPEG_QUALITY
    "color webp": ("cv2.imwrite", cv2_of_colors(".webp", [64, 95])),  # IMWRITE_WEBP_QUALITY
}


def compare(out: Path, name: str, images: np.ndarray, arguments: argparse.Namespace) -> None:
    """Print a row: the rates of all numbers of threads, and that of the peer."""
    rates, sums = {}, []
    other_work = OtherWork()
    for threads in arguments.threads:
        try:
            rates[threads], files = write(out, name, images, threads, arguments.seconds)
        except wv.errors.FileFormatError as error:
            print(f"{name:11} left out: {error}")
            return
        finally:
            shutil.rmtree(out, ignore_errors=True)
        sums.append(files)
    title, peer = PEERS[name]
    try:
        peer_rate = f"{title} {peer(out, images, arguments.seconds):,.0f}"
    except ImportError as error:
        peer_rate = f"{title} left out: {error}"
    finally:
        shutil.rmtree(out, ignore_errors=True)
    first, last = arguments.threads[0], arguments.threads[-1]
    line = " ".join(f"{rate:9,.0f}" for rate in rates.values())
    same = "the same bytes" if all(item == sums[0] for item in sums) else "OTHER BYTES"
    times = rates[last] / rates[first]
    print(f"{name:11}{line}   {times:5.2f} times, {same}; {peer_rate}. {other_work.warning()}", flush=True)
    if first == 1 and last >= 16 <= core_count() and name != "npz":
        verdict = "reached" if times >= MIN_TIMES else "MISSED"
        print(f"{name}: {times:.1f} times one thread, at least {MIN_TIMES:g}: {verdict}")


def main() -> None:
    """Print a table for each folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--threads", type=lambda text: [int(n) for n in text.split(",")], default=[1, 2, 4, 8, 16])
    parser.add_argument("--formats", nargs="*", default=list(FORMATS), choices=list(FORMATS))
    parser.add_argument("--seconds", type=float, default=1.5, help="of each figure, at least")
    parser.add_argument("--size", type=lambda text: [int(n) for n in text.split("x")], default=[320, 240])
    parser.add_argument("--scene", default="blobs_77k", choices=sorted(PRESETS))
    parser.add_argument(
        "--out", type=Path, nargs="*", default=[Path("/dev/shm/bench_writing_out"), Path("bench_writing_out")]
    )
    arguments = parser.parse_args()
    print(describe(["warp-lang", "numpy", "zarr", "numcodecs", "pyarrow", "opencv-python-headless"]))
    print(f"frames/s of {arguments.size[0]}x{arguments.size[1]}, {arguments.scene}")
    images = render_once(arguments.scene, *arguments.size)
    for out in arguments.out:
        if out.exists():
            sys.exit(f"{out} is there already; give another --out, which is deleted in the end")
        if not out.absolute().parent.is_dir():
            print(f"{out} left out: there is no {out.absolute().parent}")
            continue
        print(f"{os.path.abspath(out)}\nthreads    " + " ".join(f"{count:9}" for count in arguments.threads))
        for name in arguments.formats:
            compare(out, name, images[FORMATS[name][0]], arguments)


if __name__ == "__main__":
    main()
