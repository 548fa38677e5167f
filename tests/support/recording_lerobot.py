# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""LeRobot datasets with depth of the room of `support.recordings`, as videos of 12 bits or as images."""

import io
import json
from fractions import Fraction

import numpy as np
import pytest
from PIL import Image

from support.recordings import K_SMALL, SMALL, poses, rays, room_depth

pyarrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

DEPTH = "observation.images.front_depth"
FPS = 10
COUNTS = (4, 3)
"""Frames of the two episodes."""


def depth_at(episode, frame):
    """Return the depth of the room [m], with a row that has no measurement, and one that is too far."""
    depth = room_depth(rays(K_SMALL, *SMALL), poses([10 * episode + frame / FPS])[0])
    depth[0], depth[1] = 0, 30
    return depth


def encode(depth, low=0.01, high=10.0, shift=3.5, use_log=True):
    """Quantize depth as LeRobot's `quantize_depth` does, in double precision."""
    if use_log:
        part = (np.log(depth + shift) - np.log(low + shift)) / (np.log(high + shift) - np.log(low + shift))
    else:
        part = (depth - low) / (high - low)
    return np.rint(part * 4095).clip(0, 4095).astype(np.uint16)


def write_video(path, frames, pixel_format="gray12le"):
    av = pytest.importorskip("av")
    path.parent.mkdir(parents=True)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(
            "libx265", rate=FPS, options={"x265-params": "lossless=1:log-level=none", "g": "2"}
        )
        stream.width, stream.height, stream.pix_fmt = *SMALL, pixel_format
        stream.time_base = Fraction(1, FPS)
        for index, codes in enumerate(frames):
            frame = av.VideoFrame(*SMALL, pixel_format)
            plane = np.frombuffer(frame.planes[0], np.uint8 if pixel_format == "gray" else np.uint16)
            width = plane.size // frame.height
            plane.reshape(frame.height, width)[:, : SMALL[0]] = codes
            frame.pts = index
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode(None):
            container.mux(packet)


def write_table(path, columns):
    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(pyarrow.table(columns), path)


def write_dataset(root, feature, images=None, counts=COUNTS):
    """Write the metadata and the data of a dataset; `images` encodes a frame for the Parquet file."""
    info = {
        "codebase_version": "v3.0",
        "fps": FPS,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
        "features": {DEPTH: feature, "observation.images.front": {"dtype": "video", "info": {"is_depth_map": False}}},
    }
    (root / "meta").mkdir(parents=True)
    (root / "meta/info.json").write_text(json.dumps(info))
    episodes = [(episode, frame) for episode, count in enumerate(counts) for frame in range(count)]
    columns = {
        "episode_index": [episode for episode, _ in episodes],
        "timestamp": np.array([frame / FPS for _, frame in episodes], dtype=np.float32),
    }
    if images is not None:
        columns[DEPTH] = [{"bytes": images(*item), "path": None} for item in episodes]
    write_table(root / "data/chunk-000/file-000.parquet", columns)
    zeros = [0] * len(counts)
    starts = [sum(counts[:index]) / FPS for index in range(len(counts))]
    prefix = f"videos/{DEPTH}"
    names = ("data/chunk_index", "data/file_index", f"{prefix}/chunk_index", f"{prefix}/file_index")
    table = {
        "episode_index": list(range(len(counts))),
        **dict.fromkeys(names, zeros),
        f"{prefix}/from_timestamp": starts,
    }
    write_table(root / "meta/episodes/chunk-000/file-000.parquet", table)
    return root


def write_video_dataset(root, counts=COUNTS, pixel_format="gray12le", **quantization):
    named = {"low": "depth_min", "high": "depth_max"}
    info = {f"video.{named.get(name, name)}": value for name, value in quantization.items()}
    write_dataset(root, {"dtype": "video", "info": {"is_depth_map": True, **info}}, counts=counts)
    frames = [
        encode(depth_at(episode, frame), **quantization)
        for episode, count in enumerate(counts)
        for frame in range(count)
    ]
    write_video(root / f"videos/{DEPTH}/chunk-000/file-000.mp4", frames, pixel_format)
    return root


def write_tiff(values):
    """Return a TIFF file as LeRobot's `write_image` makes it."""
    stream = io.BytesIO()
    Image.fromarray(values).save(stream, "TIFF", compression="raw")
    return stream.getvalue()
