# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Fractions, as in `kernels.visibility.fractions`, by packets on CPU cores; see ``native/cpu/fractions.h``."""

import warp as wp

from warpvis.kernels.casting.packets import BvhScene, WorkerMemory
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import include_native
from warpvis.kernels.pinhole import PinholeCamera
from warpvis.kernels.visibility.fractions import Targets
from warpvis.kernels.visibility.silhouettes import Canvas

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "extra_build_options": include_native("cpu/fractions.h")}
)


@wp.struct
class FractionCall:
    """The inputs of a launch; the memory of its workers must be zeroed."""

    scene: BvhScene
    isolated: BvhScene
    targets: Targets
    camera: PinholeCamera
    poses: wp.array[wp.transform]
    workers: WorkerMemory
    canvas: Canvas
    min_samples: int
    cull_backfaces: int
    worlds: Worlds
    spread_worlds: Worlds


@wp.func_native("warpvis::FractionLaunch::measure(call, counts, hidden_by);")
def measure_units(call: FractionCall, counts: wp.array3d[wp.int32], hidden_by: wp.array3d[wp.int32]): ...


@wp.kernel
def measure_fractions_packets(
    # In:
    call: FractionCall,
    # Out:
    counts_out: wp.array3d[wp.int32],
    hidden_by_out: wp.array3d[wp.int32],
):
    """Count samples as in `measure_fractions`. Workers launch it with the same arguments; see `cast_packets`."""
    _ = wp.tid()
    measure_units(call, counts_out, hidden_by_out)
