# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Silhouettes, as in `kernels.visibility.silhouettes`, by packets on CPU cores; see ``native/cpu/silhouettes.h``."""

import warp as wp

from warpvis.kernels.casting.packets import BvhScene, WorkerMemory
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import include_native
from warpvis.kernels.pinhole import PinholeCamera
from warpvis.kernels.visibility.silhouettes import Canvas, Chosen, Comparison

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "extra_build_options": include_native("cpu/silhouettes.h")}
)


@wp.struct
class SilhouetteCall:
    """The inputs of a launch; the memory of its workers must be zeroed."""

    scene: BvhScene
    chosen: Chosen
    camera: PinholeCamera
    poses: wp.array[wp.transform]
    workers: WorkerMemory
    canvas: Canvas
    worlds: Worlds
    comparison: Comparison


@wp.func_native("warpvis::SilhouetteLaunch::measure(call, counts, hidden_by, masks);")
def measure_units(
    call: SilhouetteCall,
    counts: wp.array3d[wp.int32],
    hidden_by: wp.array3d[wp.int32],
    masks: wp.array4d[wp.uint8],
): ...


@wp.kernel
def measure_silhouettes_packets(
    # In:
    call: SilhouetteCall,
    # Out:
    counts_out: wp.array3d[wp.int32],
    hidden_by_out: wp.array3d[wp.int32],
    masks_out: wp.array4d[wp.uint8],
):
    """Count pixels as in `measure_silhouettes`. Workers launch it with the same arguments; see `cast_packets`."""
    _ = wp.tid()
    measure_units(call, counts_out, hidden_by_out, masks_out)
