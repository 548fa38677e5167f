# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What `kernels.points` judges by rays or rendered points, by packets on CPU cores: the C++ is ``native/points.h``."""

import warp as wp

from warpvis.kernels.native_source import read_native
from warpvis.kernels.packets import HEADERS, SCENE, ClusterScene
from warpvis.kernels.pinhole import PinholeCamera
from warpvis.kernels.worlds import Worlds

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

CHUNK = 8192
"""Points that are projected at a time; as `PointJob::chunk` in ``native/points.h``."""


@wp.struct
class PointJob:
    """How the work is shared out, and memory for it.

    The image is drawn in pixels of its own, `scale` to a pixel of the camera: a power of two, which rounds nothing.
    """

    scale: wp.float64
    batch: int  # points of a view that are worked on at a time
    strip_tiles: int  # rows of tiles in a strip
    whole: int  # whether a unit of work is a view, not a part of one
    lanes: int  # that a desk has room for
    with_id: int  # whether lanes note what hides their points
    desks: wp.array2d[float]  # one for all workers, or if units are views, one each
    scratch: wp.array2d[float]  # of each worker
    counter: wp.array[wp.int32]  # from 0: next unit, workers that entered, workers that finished, units that are done


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
shape.closed_boxes = scene.closed_boxes.data;
shape.closed_object = scene.closed_object.data;
shape.closed_count = scene.closed_count;
const PointJob asked = {(const float*)points.data, points.shape[0], job.batch, job.strip_tiles, job.whole != 0, width,
                        height, tolerance, status.data, occluders.data};
const int worker = __atomic_fetch_add(job.counter.data + Packets::entered, 1, __ATOMIC_SEQ_CST);
const int desk_number = job.whole ? worker : 0;
float* desk_memory = (float*)((char*)job.desks.data + (long long)desk_number * job.desks.strides[0]);
const Desk desk = Desk::carve(desk_memory, asked, (shape.height + 15) >> 4, job.lanes, job.with_id != 0);
float* scratch = (float*)((char*)job.scratch.data + (long long)worker * job.scratch.strides[0]);
PointPackets::run(tree, movables, shape, asked, desk, scratch, job.counter.data);
"""


@wp.func_native(read_native(*HEADERS, "cpu/points.h") + SCENE + _JUDGE)
def judge_units(
    scene: ClusterScene,
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
    scene: ClusterScene,
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
    """A point's status in every view and, unless that is None, the object that hides it, -1 for none.

    Every worker launches this with the same arguments. The job's counters tell it which one it is, and the next unit
    of work, until none is left.
    """
    _ = wp.tid()
    judge_units(scene, camera, camera_to_world, job, worlds, points, tolerance, status_out, occluders_out)
