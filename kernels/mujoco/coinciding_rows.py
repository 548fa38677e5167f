# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Consistent visibility of coinciding surfaces on CPU cores: `coinciding.show_later` in a launch packed once."""

import warp as wp

from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.constants import CPU_LANES
from warpvis.kernels.mujoco.coinciding import Coinciding, show_last
from warpvis.kernels.native_source import include_native
from warpvis.kernels.pinhole import PinholeCamera
from warpvis.kernels.rows import RowJob, enter_rows, finish_rows, rows_of, take_rows

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "extra_build_options": include_native("cpu/coinciding.h")}
)


@wp.struct
class LaterCall:
    """The arguments of a launch, as of `coinciding.show_later`, in one struct that is modified between launches."""

    coinciding: Coinciding
    camera: PinholeCamera
    camera_to_world: wp.array[wp.transform]
    worlds: Worlds
    depth: wp.array3d[float]
    cull_backfaces: int
    job: RowJob


@wp.struct
class LaterImages:
    """The images that are corrected; labels and faces may be None."""

    segmentation: wp.array3d[wp.int32]
    labels: wp.array3d[wp.uint8]
    faces: wp.array3d[wp.int32]


@wp.func_native("return warpvis::coinciding_pixels(call, segmentation, view, y, x);")
def candidates_from(call: LaterCall, segmentation: wp.array3d[wp.int32], view: int, y: int, x: int) -> wp.uint32: ...


@wp.func_native("return __builtin_ctz(bits);")
def lowest_bit(bits: wp.uint32) -> int: ...


@wp.kernel
def show_later_rows(
    # In:
    calls: wp.array[LaterCall],
    # Out:
    images_out: wp.array[LaterImages],
):
    """Correct the images of one call; each array contains one element. Every worker launches this kernel."""
    _ = wp.tid()
    call, images = calls[0], images_out[0]
    enter_rows(call.job)
    unit = take_rows(call.job)
    while unit >= 0:
        rows = rows_of(call.job, unit)
        for y in range(rows[1], rows[2]):
            for packet in range((images.segmentation.shape[2] + CPU_LANES - 1) // CPU_LANES):
                pixels = candidates_from(call, images.segmentation, rows[0], y, CPU_LANES * packet)
                while pixels != wp.uint32(0):
                    show_last(
                        call.coinciding,
                        call.camera,
                        call.camera_to_world[rows[0]],
                        call.worlds,
                        rows[0],
                        y,
                        CPU_LANES * packet + lowest_bit(pixels),
                        call.depth,
                        call.cull_backfaces != 0,
                        images.segmentation,
                        images.labels,
                        images.faces,
                    )
                    pixels = pixels & (pixels - wp.uint32(1))
        unit = take_rows(call.job)
    finish_rows(call.job)
