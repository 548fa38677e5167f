# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visibility of points, as in `kernels.visibility.points`, by packets on CPU cores; see ``native/cpu/points.h``."""

import warp as wp

from warpvis.kernels.casting.packets import HEADERS, SCENE, BvhScene
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import read_native
from warpvis.kernels.pinhole import PinholeCamera

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class PointJob:
    """The division of work among workers, and their memory, aligned to cache lines.

    The image is rendered at `scale` times the camera's resolution: a power of two, so that nothing is rounded.
    """

    scale: wp.float64
    batch: int  # points of a view that are processed at a time
    strip_tiles: int  # rows of tiles per strip
    views_are_units: int  # whether a unit of work is a whole view instead of a part of one
    with_id: int  # whether to identify the objects that occlude points
    bins: wp.array2d[wp.uint8]  # shared by all workers, or per worker if views are units; None to measure
    scratch: wp.array2d[wp.uint8]  # per worker
    bytes: wp.array[wp.int64]  # sizes of bins and scratch
    counter: wp.array[wp.int32]  # initially 0
    taken: wp.array[wp.int32]  # [worker]: whether its memory is in use; initially 0


_JUDGE = """
const double width = camera.width * job.scale, height = camera.height * job.scale;
Job shape = Job();
shape.views = camera_to_world.shape[0];
shape.width = (int)__builtin_ceil(width);
shape.height = (int)__builtin_ceil(height);
shape.focal[0] = camera.fx * job.scale;
shape.focal[1] = camera.fy * job.scale;
shape.center[0] = camera.cx * job.scale;
shape.center[1] = camera.cy * job.scale;
shape.near = camera.near;
shape.far = camera.far;
shape.poses = (const float*)camera_to_world.data;
const PointJob asked = {(const float*)points.data, points.shape[0], job.batch, job.strip_tiles,
                        job.views_are_units != 0, job.with_id != 0, width, height, tolerance, status.data,
                        occluders.data};
const int tiles_x = Grid::tiles(shape.width), tiles_y = Grid::tiles(shape.height);
if (!job.bins.data) {
    Arena bins = Arena::at(nullptr), scratch = Arena::at(nullptr);
    PointBins::carve(bins, asked, tiles_x, tiles_y);
    PointMemory::carve(scratch, asked, tiles_x, scene.drawn_count, scene.levels);
    job.bytes.data[0] = bins.used;
    job.bytes.data[1] = scratch.used;
    return;
}
Workers::enter(job.counter.data);
const int slot = Workers::take_memory(job.taken.data);
Arena shared = Arena::at((char*)job.bins.data + (job.views_are_units ? slot : 0) * (long long)job.bins.strides[0]);
Arena own = Arena::at((char*)job.scratch.data + slot * (long long)job.scratch.strides[0]);
const PointBins bins = PointBins::carve(shared, asked, tiles_x, tiles_y);
const PointMemory memory = PointMemory::carve(own, asked, tiles_x, scene.drawn_count, scene.levels);
const PointWork work = {drawn, shape, asked, bins};
PointPackets::of(work, memory).run(job.counter.data);
Workers::give_back_memory(job.taken.data, slot);
"""


@wp.func_native(read_native(*HEADERS, "cpu/point_bins.h", "cpu/points.h") + SCENE + _JUDGE)
def judge_units(
    scene: BvhScene,
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    job: PointJob,
    worlds: Worlds,
    points: wp.array[wp.vec3],
    tolerance: float,
    status: wp.array2d[wp.uint8],
    occluders: wp.array2d[wp.int32],
): ...


@wp.kernel
def judge_points_packets(
    # Scene:
    scene: BvhScene,
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    job: PointJob,
    # In:
    worlds: Worlds,
    points: wp.array[wp.vec3],
    tolerance: float,
    # Out:
    status_out: wp.array2d[wp.uint8],
    occluders_out: wp.array2d[wp.int32],
):
    """Write each point's status in every view and, unless it is None, the object that occludes it, or -1.

    Every worker launches this kernel with the same arguments. The job's shared counters assign worker indices and
    units of work.
    """
    _ = wp.tid()
    judge_units(scene, camera, camera_to_world, job, worlds, points, tolerance, status_out, occluders_out)
