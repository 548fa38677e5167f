# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""`point_visibility` on CPU cores: points are projected, sorted into cells of an image, and tested in packets."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from threading import Event
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import aligned_empty
from warpvis.core.threads import pack_launch, run_together, write_fields
from warpvis.kernels.constants import (
    COUNTER_FINISHED,
    COUNTER_NEXT_UNIT,
    CPU_LANES,
    JOB_COUNTERS,
    POINT_CHUNK,
    TILE_SIDE,
)
from warpvis.scene import Scene
from warpvis.scene.acceleration.geometry import SceneBvh

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds
    from warpvis.kernels.visibility.point_packets import PointJob

# Maximum number of points of a view per batch, which bounds the memory.
_MAX_POINTS = 1 << 20
# Views with at most this many points are processed by one worker each, if there are enough views for all workers.
_MAX_WHOLE = 1 << 15
_STRIPS = 16
# First and longest sleep of a worker that waits for others [s].
_SHORTEST_PAUSE, _LONGEST_PAUSE = 5e-5, 1e-3
# Maximum side of the image [px]: the index of a cell in a row of tiles must fit a `ProjectedPoint` of
# native/cpu/point_bins.h.
_MAX_SIDE = 1 << 18
# Maximum number of cached workspaces of a scene, one per concurrent call.
_MAX_CACHED = 2


@dataclass(frozen=True)
class _Layout:
    """Size of the image of a job, and division of the work."""

    scale: float
    """Pixels of the image per pixel of the camera, along each axis."""
    side: tuple[int, int]
    """Width and height of the image [px]."""
    strip_tiles: int
    batch: int
    with_id: bool
    views_are_units: bool
    units: int
    workers: int


@dataclass
class _Workspace:
    """Memory for one call at a time; cached, since allocating it takes longer than using it."""

    layout: _Layout
    job: PointJob
    counter: NDArray[np.int32]


def judge_by_packets(
    scene: Scene,
    camera: Camera,
    poses: NDArray[np.float32],
    worlds: Worlds,
    points: wp.array,
    tolerance: float,
    status: wp.array,
    occluders: wp.array | None,
    threads: int,
) -> None:
    """Write the status of every point in every view, ``(V, N)``, and if `occluders` is given, the object that hides it.

    The scene is on the CPU; `poses` are rows of `host_poses`, and `points` finite vec3.
    """
    from warpvis.kernels.visibility.point_packets import PointCall, judge_points_packets

    if not status.size:
        return
    clusters = scene.bvh()
    # Analytic solids require the kernels that also find the first object along a ray.
    with_id = occluders is not None or clusters.has_solids
    layout = _lay_out(camera, scene.triangle_count, len(poses), len(points), with_id, threads)
    space = _take(clusters, layout)
    space.counter[:] = 0
    call: Any = PointCall()
    call.tolerance = tolerance
    lens = camera.device_struct()
    rows = wp.array(np.ascontiguousarray(poses), dtype=wp.transform, device="cpu", copy=False)
    write_fields(call, scene=clusters.struct, camera=lens, poses=rows, job=space.job, worlds=worlds, points=points)
    launch = pack_launch(judge_points_packets, [call, status, occluders])
    if space.job.bins is None:
        launch.launch()  # without scratch memory, it only writes the sizes that it needs to `job.bytes`
        bins, scratch = space.job.bytes.numpy().tolist()
        space.job.bins = aligned_empty((layout.workers if layout.views_are_units else 1, bins), wp.uint8)
        space.job.scratch = aligned_empty((layout.workers, scratch), wp.uint8)
        write_fields(call, job=space.job)
    work = partial(_work, launch, space.counter, layout.units, Event())
    run_together(work, layout.workers, lambda: bool(space.counter[COUNTER_FINISHED] == layout.workers))
    if len(clusters.free_workspaces) < _MAX_CACHED:
        clusters.free_workspaces.append(space)


def _work(launch: wp.Launch, counter: NDArray[np.int32], units: int, all_taken: Event) -> None:
    """Process units of work until none is left. A waiting worker sleeps, since it may share the core of another one."""
    pause = _SHORTEST_PAUSE
    launch.launch()
    while counter[COUNTER_NEXT_UNIT] < units:
        if all_taken.wait(pause):
            return
        pause = min(2 * pause, _LONGEST_PAUSE)
        launch.launch()
    all_taken.set()


def _lay_out(camera: Camera, triangles: int, views: int, count: int, with_id: bool, threads: int) -> _Layout:
    batch = min(-(-count // CPU_LANES) * CPU_LANES, _MAX_POINTS)
    scale = _scale(camera, triangles, batch)
    width, height = math.ceil(camera.width * scale), math.ceil(camera.height * scale)
    tiles_y = -(-height // TILE_SIDE)
    strip_tiles, chunks = -(-tiles_y // _STRIPS), -(-batch // POINT_CHUNK)
    by_view = threads == 1 or (count <= _MAX_WHOLE and views >= 2 * threads)
    batches = views * -(-count // batch)
    units = batches if by_view else batches * (chunks + -(-tiles_y // strip_tiles))
    return _Layout(scale, (width, height), strip_tiles, batch, with_id, by_view, units, min(threads, units))


def _scale(camera: Camera, triangles: int, count: int) -> float:
    """Return the scale of the image, whose cells are 4 x 4 pixels, relative to the camera's.

    Small cells let the traversal skip more, large cells fill packets. This number of cells is nearly the fastest for 10
    to a million points in scenes of 5.4 k to 1.2 M triangles.
    """
    cells = 0.7 * math.sqrt(triangles * min(count, 1000)) + count / 32
    scale = 2.0 ** round(0.5 * math.log2(16 * cells / (camera.width * camera.height)))
    return min(scale, 2.0 ** math.floor(math.log2(_MAX_SIDE / max(camera.width, camera.height))))


def _take(clusters: SceneBvh, layout: _Layout) -> _Workspace:
    """Return an unused workspace, cached or new: concurrent calls use distinct workspaces."""
    while clusters.free_workspaces:
        try:
            space = cast(_Workspace, clusters.free_workspaces.pop())
        except IndexError:  # another thread was quicker
            break
        if space.layout == layout:
            return space
    return _make(layout)


def _make(layout: _Layout) -> _Workspace:
    from warpvis.kernels.visibility.point_packets import PointJob

    job, counter = PointJob(), np.zeros(JOB_COUNTERS, dtype=np.int32)
    job.scale, job.batch, job.strip_tiles = layout.scale, layout.batch, layout.strip_tiles
    job.views_are_units, job.with_id = int(layout.views_are_units), int(layout.with_id)
    job.counter = wp.array(counter, dtype=wp.int32, device="cpu", copy=False)
    job.taken = wp.zeros(layout.workers, dtype=wp.int32, device="cpu")
    job.bytes = wp.zeros(2, dtype=wp.int64, device="cpu")
    return _Workspace(layout, job, counter)
