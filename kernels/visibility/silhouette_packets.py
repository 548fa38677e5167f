# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Silhouettes, as in `kernels.visibility.silhouettes`, by packets on CPU cores; see ``native/cpu/silhouettes.h``."""

import warp as wp

from warpvis.kernels.casting.packets import BvhScene
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import include_native
from warpvis.kernels.pinhole import PinholeCamera
from warpvis.kernels.visibility.silhouettes import Canvas, Chosen, Comparison

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "extra_build_options": include_native("cpu/silhouettes.h")}
)


@wp.struct
class SilhouetteJob:
    """Shared counters of a `PacketJob`, which start at 0, and the workers' memory, which must be zeroed."""

    counter: wp.array[wp.int32]
    scratch: wp.array2d[wp.uint8]  # per worker; None to measure the bytes that a worker needs
    scratch_bytes: wp.array[wp.int64]


_MEASURE = """
warpvis::Job image = warpvis::Job::of_camera(camera, camera_to_world, 1.0);
image.far = __builtin_inff();
const warpvis::SilhouetteJob request = {.count = chosen.index.shape[0],
                                        .chosen = chosen.index.data,
                                        .objects = scene.object_count,
                                        .canvas = {canvas.x0, canvas.y0, canvas.x1, canvas.y1},
                                        .seen_only = canvas.seen_only != 0,
                                        .near = camera.near,
                                        .far = camera.far,
                                        .seen = comparison.segmentation.data,
                                        .depth = comparison.depth.data,
                                        .delta = comparison.delta,
                                        .counts = (char*)counts.data,
                                        .count_stride = counts.strides[0],
                                        .view_stride = counts.strides[1],
                                        .hidden_by = hidden_by.data,
                                        .masks = masks.data};
warpvis::SilhouetteLaunch::measure(job, warpvis::Scene::of(scene, worlds), scene.levels, image, request);
"""


@wp.func_native(_MEASURE)
def measure_units(
    scene: BvhScene,
    chosen: Chosen,
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    job: SilhouetteJob,
    canvas: Canvas,
    worlds: Worlds,
    comparison: Comparison,
    counts: wp.array3d[wp.int32],
    hidden_by: wp.array3d[wp.int32],
    masks: wp.array4d[wp.uint8],
): ...


@wp.kernel
def measure_silhouettes_packets(
    # Scene:
    scene: BvhScene,
    chosen: Chosen,
    # Cameras:
    camera: PinholeCamera,
    camera_to_world: wp.array[wp.transform],
    job: SilhouetteJob,
    # In:
    canvas: Canvas,
    worlds: Worlds,
    comparison: Comparison,
    # Out:
    counts_out: wp.array3d[wp.int32],
    hidden_by_out: wp.array3d[wp.int32],
    masks_out: wp.array4d[wp.uint8],
):
    """Count pixels as in `measure_silhouettes`. Workers launch it with the same arguments; see `cast_packets`."""
    _ = wp.tid()
    measure_units(
        scene, chosen, camera, camera_to_world, job, canvas, worlds, comparison, counts_out, hidden_by_out, masks_out
    )
