# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""`point_visibility` on CPU cores: points are projected, sorted into cells of an image, and judged in packets."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import aligned_empty
from warpvis.core.camera import Camera
from warpvis.core.threads import load_module, run_together
from warpvis.kernels.constants import COUNTER_FINISHED, JOB_COUNTERS
from warpvis.rendering.casters import NOTE_WORDS, TILE, VISIT_WORDS
from warpvis.scene import Scene
from warpvis.scene.geometry import Clusters

if TYPE_CHECKING:
    from warpvis.kernels.point_packets import PointJob
    from warpvis.kernels.worlds import Worlds

# Points of a view that are worked on at a time, which bounds the memory.
_MOST_POINTS = 1 << 20
# A view of at most so many is one worker's, if there are views for all.
_MOST_WHOLE = 1 << 15
_STRIPS = 16
# Of an image, in pixels: the number of a cell in a row of tiles has to fit a `Spot` in kernels/native/points.h.
_MOST_SIDE = 1 << 18
# Workplaces that a scene keeps: for so many callers at a time.
_KEPT = 2


@dataclass(frozen=True)
class _Layout:
    """The image of a job in its own pixels, and how the work is parted."""

    scale: float
    tiles_x: int
    tiles_y: int
    strip_tiles: int
    batch: int
    chunks: int
    with_id: bool
    whole: bool
    workers: int

    @property
    def desks(self) -> int:
        return self.workers if self.whole else 1

    @property
    def lanes(self) -> int:
        """Of a desk, at most: a packet is never emptier than by 15, and there is none for a cell without points."""
        strips = -(-self.tiles_y // self.strip_tiles)
        cells = self.tiles_x * self.strip_tiles * strips * TILE
        return self.batch + 15 * min(cells, self.batch)


@dataclass
class _Workplace:
    """What one call at a time works with. To get that much memory from the system takes longer than to use it."""

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
    """Write every point's status in every view and, unless that is None, what hides it.

    Args:
        scene: A scene on the CPU.
        camera: The camera with its depth range.
        poses: Rows ``(V, 7)`` as of `warpvis.core.poses.host_poses`.
        worlds: As of `warpvis.scene.worlds.parse_worlds`.
        points: Finite points, shape ``(N,)`` vec3.
        tolerance: Metres from 0 up.
        status: Shape ``(V, N)`` uint8.
        occluders: Shape ``(V, N)`` int32.
        threads: CPU threads to use.
    """
    from warpvis.kernels.point_packets import judge_points_packets

    if not status.size:
        return
    load_module(judge_points_packets)
    clusters = scene.clusters()
    # Solids are drawn with what is first along a ray.
    with_id = occluders is not None or any(item.solid is not None for item in scene.objects)
    layout = _lay_out(camera, scene.triangle_count, len(poses), len(points), with_id, threads)
    place = _take(clusters, layout)
    place.counter[:] = 0
    rows = wp.array(np.ascontiguousarray(poses), dtype=wp.transform, device="cpu", copy=False)
    lens = camera.device_struct()
    inputs = [clusters.struct, lens, rows, place.job, worlds, points, tolerance, status, occluders]
    launch = wp.launch(judge_points_packets, dim=1, inputs=inputs, device="cpu", record_cmd=True)
    run_together(launch.launch, layout.workers, lambda: bool(place.counter[COUNTER_FINISHED] == layout.workers))
    if len(clusters.idle) < _KEPT:
        clusters.idle.append(place)


def _lay_out(camera: Camera, triangles: int, views: int, count: int, with_id: bool, threads: int) -> _Layout:
    from warpvis.kernels.point_packets import CHUNK

    batch = min(-(-count // TILE) * TILE, _MOST_POINTS)
    scale = _scale(camera, triangles, batch)
    tiles_x, tiles_y = (-(-math.ceil(side * scale) // TILE) for side in (camera.width, camera.height))
    strip_tiles, chunks = -(-tiles_y // _STRIPS), -(-batch // CHUNK)
    whole = threads == 1 or (count <= _MOST_WHOLE and views >= 2 * threads)
    turns = views * -(-count // batch)
    units = turns if whole else turns * (chunks + -(-tiles_y // strip_tiles))
    return _Layout(scale, tiles_x, tiles_y, strip_tiles, batch, chunks, with_id, whole, min(threads, units))


def _scale(camera: Camera, triangles: int, count: int) -> float:
    """Choose pixels of an image, whose cells are 4 x 4 of them, to one of the camera's.

    Small cells let the walk pass over more, large ones fill packets. This number of them is near the fastest one for 10
    to a million points in scenes of 5.4 k to 1.2 M triangles.
    """
    cells = 0.7 * math.sqrt(triangles * min(count, 1000)) + count / 32
    scale = 2.0 ** round(0.5 * math.log2(16 * cells / (camera.width * camera.height)))
    return min(scale, 2.0 ** math.floor(math.log2(_MOST_SIDE / max(camera.width, camera.height))))


def _take(clusters: Clusters, layout: _Layout) -> _Workplace:
    """Return a workplace that nobody uses: callers on several threads each have their own."""
    while clusters.idle:
        try:
            place = cast(_Workplace, clusters.idle.pop())
        except IndexError:  # another thread was quicker
            break
        if place.layout == layout:
            return place
    return _make(clusters, layout)


def _make(clusters: Clusters, layout: _Layout) -> _Workplace:
    from warpvis.kernels.point_packets import CHUNK, PointJob

    job, counter = PointJob(), np.zeros(JOB_COUNTERS, dtype=np.int32)
    job.scale, job.batch, job.strip_tiles = layout.scale, layout.batch, layout.strip_tiles
    job.whole, job.with_id, job.lanes = int(layout.whole), int(layout.with_id), layout.lanes
    # As `Desk` in kernels/native/points.h carves it: where rows of spots end, spots, and lanes.
    words = -(-layout.chunks * layout.tiles_y // TILE) * TILE + layout.chunks * CHUNK * 4
    words += layout.lanes * (5 if layout.with_id else 4)
    job.desks = aligned_empty((layout.desks, -(-words // TILE) * TILE), wp.float32)
    # As `PointPackets::strip` and `PointStrip::carve` do: spots, what is known of cells and tiles, where cells end, and
    # notes of movable objects with a stack that has room for all children of a node on every level.
    tiles = layout.tiles_x * layout.strip_tiles
    words = (layout.batch + TILE) * 4 + tiles * (16 + 16 + 1 + 4 + 1) + TILE + layout.tiles_x * 16
    words += clusters.struct.movable_count * NOTE_WORDS + (clusters.depth + 1) * 16 * VISIT_WORDS + 2 * TILE
    job.scratch = aligned_empty((layout.workers, -(-words // TILE) * TILE), wp.float32)
    job.counter = wp.array(counter, dtype=wp.int32, device="cpu", copy=False)
    return _Workplace(layout, job, counter)
