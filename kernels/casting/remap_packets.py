# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images at positions given by maps, by packets on CPU cores; see ``native/cpu/remap.h``."""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.packets import BvhScene
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import include_native
from warpvis.kernels.pinhole import PinholeCamera

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "extra_build_options": include_native("cpu/remap.h")}
)


@wp.struct
class RemapJob:
    """Images to render, in units of trees over parts of maps.

    A map contains, for each pixel of (rows, columns), the position in the camera's image that it shows, x y x y ...
    [px]. Counters are a `JobCounter` of ``native/shared`` and start at 0.
    """

    views: int
    rows: int
    columns: int
    camera: PinholeCamera
    tree_focal: wp.float64
    cull_backfaces: int
    pixels: wp.array[float]
    counter: wp.array[wp.int32]
    scratch: wp.array2d[wp.uint8]  # per worker; None to measure the bytes that a worker needs
    scratch_bytes: wp.array[wp.int64]


@wp.struct
class RemapCall:
    """The arguments of a launch; see `kernels.casting.packets.PacketCall`."""

    scene: BvhScene
    job: RemapJob
    poses: wp.array[wp.transform]
    worlds: Worlds


@wp.func_native("warpvis::RemapLaunch::remap(calls.data[0], images_out.data[0]);")
def cast_trees(
    calls: wp.array[RemapCall],
    images_out: wp.array[Images],
): ...


@wp.kernel
def cast_remapped_packets(
    # In:
    calls: wp.array[RemapCall],
    # Out:
    images_out: wp.array[Images],
):
    """Write the requested images (None is skipped) of one call; each array contains one element.

    Every worker launches this kernel with the same arguments. The job's shared counters assign worker indices and
    units of work.
    """
    _ = wp.tid()
    cast_trees(calls, images_out)
