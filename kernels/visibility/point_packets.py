# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visibility of points, as in `kernels.visibility.points`, by packets on CPU cores; see ``native/cpu/points.h``."""

import warp as wp

from warpvis.kernels.casting.packets import BvhScene
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import include_native
from warpvis.kernels.pinhole import PinholeCamera

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "extra_build_options": include_native("cpu/points.h")}
)


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


@wp.struct
class PointCall:
    """The inputs of a launch."""

    scene: BvhScene
    camera: PinholeCamera
    poses: wp.array[wp.transform]
    job: PointJob
    worlds: Worlds
    points: wp.array[wp.vec3]
    tolerance: float


@wp.func_native("warpvis::PointLaunch::judge(call, status, occluders);")
def judge_units(call: PointCall, status: wp.array2d[wp.uint8], occluders: wp.array2d[wp.int32]): ...


@wp.kernel
def judge_points_packets(
    # In:
    call: PointCall,
    # Out:
    status_out: wp.array2d[wp.uint8],
    occluders_out: wp.array2d[wp.int32],
):
    """Write each point's status in every view and, unless it is None, the object that occludes it, or -1.

    Every worker launches this kernel with the same arguments. The job's shared counters assign worker indices and
    units of work.
    """
    _ = wp.tid()
    judge_units(call, status_out, occluders_out)
