# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""``warpvis render --lidar``: point clouds of a lidar along poses."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warpvis.cli._inputs import FrameOptions, refuse_options
from warpvis.core.checks import check_choice, pluralize
from warpvis.errors import CameraError, FileFormatError, PoseError

if TYPE_CHECKING:
    from warpvis.cameras import Rays
    from warpvis.cameras.frames import Frames
    from warpvis.rendering import Output
    from warpvis.scene import Scene
    from warpvis.sensors.lidars import Livox

FORMATS = ("bin", "pcd", "las", "npy")
"""File formats of point clouds."""

_OUTPUTS: tuple[Output, ...] = ("depth", "labels", "segmentation")
_RAYS_AT_ONCE = 2**22
_CAMERAS = (
    "camera",
    "replace_camera",
    "convention",
    "outputs",
    "objects",
    "option",
    "sensor",
    "sensor_seed",
    "sensor_vary",
    "device_name",
    "version_exact",
)


def find_lidar(name: str) -> Rays | Livox:
    """Return a lidar by name, Ouster metadata file, or Livox name with its file, ``mid360:FILE``."""
    from warpvis.sensors import lidars

    spinning: dict[str, Callable[[], Rays]] = {
        "vlp16": lidars.vlp16,
        "vlp32c": lidars.vlp32c,
        "hdl64e": lidars.hdl64e,
        "bpearl": lidars.bpearl,
    }
    plain = name.lower().replace("-", "")
    if plain in spinning:
        return spinning[plain]()
    model, mode = (name.partition("@")[0], name.partition("@")[2] or None)
    if model.lower().endswith(".json") or plain.startswith("os"):
        return lidars.ouster(model, mode)
    livox, _, file = name.partition(":")
    if livox.lower().replace("-", "") in ("mid360", "avia", "horizon", "tele", "mid40", "mid70", "hap"):
        return lidars.livox(livox, file or None)
    raise CameraError(
        f"--lidar must be {', '.join(spinning)}, os1-128 or the metadata of an Ouster (with @1024x10 for a mode), or "
        f"mid360:FILE, got {name!r}"
    )


@dataclass(frozen=True)
class CloudJob:
    """Arguments of ``warpvis render --lidar``."""

    lidar: str
    file: Path
    poses: str | None
    out: Path
    formats: Sequence[str]
    exclude: Sequence[str]
    moving: bool
    threads: int | None
    device: str
    quiet: bool


def render_clouds(command: FrameOptions, job: CloudJob) -> bool:
    """Write a cloud of every frame, OUT/pcd/000000.pcd and so on; return whether any of them has points.

    Args:
        command: The command, with options for reading files.
        job: Arguments of the rendering.
    """
    from warpvis.io import save_clouds
    from warpvis.pose_generators import looks_like_spec

    refuse_options(command, _CAMERAS, "with --lidar no camera is rendered: give")
    if job.poses is None:
        raise PoseError("give --poses with --lidar, a file of the lidar's poses: x forward, y left, z up")
    if looks_like_spec(job.poses):
        raise PoseError(
            f"--poses with --lidar must be a file of the lidar's poses, x forward, y left, z up, got {job.poses!r}, "
            "which generates camera poses"
        )
    lidar = find_lidar(job.lidar)
    for name in job.formats:
        check_choice(name, "--format with --lidar", FORMATS, FileFormatError)
        if (job.out / name).exists() and any((job.out / name).iterdir()):
            raise FileFormatError(f"{job.out / name}: exists already; give a new or empty folder")
    scene, _, frames = command.load(job.file, job.poses, device=job.device)
    if frames.camera is not None:
        raise PoseError(f"{job.poses} contains a camera's poses, but a lidar's are x forward, y left, z up")
    turns = len(_turns(frames, lidar)) if job.moving else len(frames)
    began, points = time.perf_counter(), 0
    for place, cloud in enumerate(_clouds(job, scene, frames, lidar, turns)):
        points += len(cloud)
        for name in job.formats:
            save_clouds(job.out / name, [cloud], f".{name}", first=place)
    if not job.quiet:
        folders = ", ".join(str(job.out / name) for name in job.formats)
        seconds = time.perf_counter() - began
        of = f" of {pluralize(len(frames), 'pose')}" if job.moving else ""
        print(f"clouds: {pluralize(turns, 'frame')}{of}, {pluralize(points, 'point')}, in {seconds:.1f} s: {folders}")
    return points > 0


def _turns(frames: Frames, lidar: Rays | Livox) -> Frames:
    """Return the frames from which a whole revolution ends before the last pose."""
    from warpvis.cameras import Rays

    rays = lidar if isinstance(lidar, Rays) else lidar.frame(0)
    if rays.times is None:
        raise CameraError(f"--moving requires a lidar whose rays have times, and {type(rays).__name__} have none")
    if not (np.diff(frames.timestamps) > 0).all():
        raise PoseError("--moving requires timestamps that increase from pose to pose")
    lasts, known = float(rays.times.max()), float(frames.timestamps[-1] - frames.timestamps[0])
    if known < lasts:
        raise PoseError(f"--moving requires poses for a revolution of the lidar, {lasts:.6g} s, got {known:.6g} s")
    return frames[: int(np.searchsorted(frames.timestamps, frames.timestamps[-1] - lasts, side="right"))]


def _clouds(job: CloudJob, scene: Scene, frames: Frames, lidar: Rays | Livox, turns: int) -> Iterator[np.ndarray]:
    """Render the clouds in batches; a Livox has different rays in every frame."""
    from warpvis.cameras import Rays
    from warpvis.rendering import Renderer
    from warpvis.sensors import Motion, point_clouds

    prepare = partial(Renderer, scene, outputs=_OUTPUTS, threads=job.threads)
    renderer, step = None, 1
    if isinstance(lidar, Rays):
        renderer, step = prepare(lidar), max(_RAYS_AT_ONCE // len(lidar), 1)
    for first in range(0, turns, step):
        part = frames[first : min(first + step, turns)]
        rays = lidar if isinstance(lidar, Rays) else lidar.frame(first)
        moves = job.moving and Motion(frames.camera_to_world, frames.timestamps, starts=part.timestamps)
        views = (renderer or prepare(rays)).render(
            moves or part.camera_to_world,
            object_poses=part.object_poses,
            world_index=part.world_index,
            exclude=list(job.exclude) or None,
        )
        yield from point_clouds(views, rays)
