# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Fractions, as in `kernels.visibility.fractions`, by packets on CUDA; see ``native/cuda/fractions.h``."""

import warp as wp

from warpvis.kernels.casting.packets import BvhScene
from warpvis.kernels.casting.packets_cuda import FoundObjects, native_options
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.pinhole import PinholeCamera
from warpvis.kernels.visibility.fractions import Sampling, Targets

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.func_native(
    """
__shared__ warpvis::WarpMemory memory;
view = warpvis::Warp::uniform(view);
warpvis::Fractions::measure(warpvis::Scene::of(scene, worlds, found, view),
                            warpvis::Scene::of(isolated, spread_worlds, found, view),
                            warpvis::View::of(camera, poses, view, sampling.cull_backfaces != 0),
                            warpvis::FractionCall::of(targets, sampling, counts, hidden_by),
                            warpvis::Warp::uniform(target), warpvis::Warp::uniform(part), memory);
"""
)
def measure_part(
    scene: BvhScene,
    isolated: BvhScene,
    targets: Targets,
    camera: PinholeCamera,
    poses: wp.array[wp.transform],
    sampling: Sampling,
    worlds: Worlds,
    spread_worlds: Worlds,
    found: FoundObjects,
    view: int,
    target: int,
    part: int,
    counts: wp.array3d[wp.int32],
    hidden_by: wp.array3d[wp.int32],
): ...


def make_fraction_kernel(clip: bool, resized: bool) -> wp.Kernel:
    """Make a kernel for packets of samples of targets; arguments as for `packets_cuda.make_packet_kernel`."""
    options = native_options("cuda/fractions.h", 32, True, True, resized, clip=clip)

    @wp.kernel(
        module="unique",
        enable_backward=False,
        grid_stride=False,
        cuda_max_registers=128,
        module_options={"extra_build_options": options},
    )
    def measure_fractions_packets_cuda(
        # Scene:
        scene: BvhScene,
        isolated: BvhScene,
        targets: Targets,
        # Cameras:
        camera: PinholeCamera,
        camera_to_world: wp.array[wp.transform],
        # In:
        sampling: Sampling,
        worlds: Worlds,
        spread_worlds: Worlds,
        found: FoundObjects,
        # Out:
        counts_out: wp.array3d[wp.int32],
        hidden_by_out: wp.array3d[wp.int32],
    ):
        """Count samples as in `measure_fractions`: 32 threads for each of `Sampling.threads` parts of a target.

        `found` is unused.
        """
        part, view, target, _ = wp.tid()
        measure_part(
            scene,
            isolated,
            targets,
            camera,
            camera_to_world,
            sampling,
            worlds,
            spread_worlds,
            found,
            view,
            target,
            part,
            counts_out,
            hidden_by_out,
        )

    return measure_fractions_packets_cuda
