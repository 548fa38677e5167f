# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Silhouettes, as in `kernels.visibility.silhouettes`, by packets on CPU cores; see ``native/cpu/silhouettes.h``."""

import warp as wp

from warpvis.kernels.casting.packets import HEADERS, SCENE, BvhScene
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import read_native
from warpvis.kernels.pinhole import PinholeCamera
from warpvis.kernels.visibility.silhouettes import Canvas, Chosen, Comparison

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class SilhouetteJob:
    """Shared counters of a `PacketJob`, which start at 0, and the workers' memory, which must be zeroed."""

    counter: wp.array[wp.int32]
    scratch: wp.array2d[wp.uint8]  # per worker; None to measure the bytes that a worker needs
    scratch_bytes: wp.array[wp.int64]


_MEASURE = """
Job shape = Job();
shape.views = camera_to_world.shape[0];
shape.height = (int)camera.height;
shape.width = (int)camera.width;
shape.focal[0] = camera.fx;
shape.focal[1] = camera.fy;
shape.center[0] = camera.cx;
shape.center[1] = camera.cy;
shape.far = __builtin_inff();
shape.poses = (const float*)camera_to_world.data;
const SilhouetteJob asked = {chosen.index.shape[0], chosen.index.data, scene.object_count,
                             {canvas.x0, canvas.y0, canvas.x1, canvas.y1}, canvas.seen_only != 0,
                             camera.near, camera.far, comparison.segmentation.data, comparison.depth.data,
                             comparison.delta, (char*)counts.data, counts.strides[0], counts.strides[1],
                             hidden_by.data, masks.data};
if (!job.scratch.data) {
    Arena measured = Arena::at(nullptr);
    SilhouetteMemory::carve(measured, asked, scene.drawn_count, scene.levels);
    job.scratch_bytes.data[0] = measured.used;
    return;
}
const int worker = Workers::enter(job.counter.data);
Arena arena = Arena::at((char*)job.scratch.data + (long long)worker * job.scratch.strides[0]);
const SilhouetteMemory memory = SilhouetteMemory::carve(arena, asked, scene.drawn_count, scene.levels);
const Silhouettes silhouettes = {drawn, shape, asked, memory};
silhouettes.run(job.counter.data);
"""


@wp.func_native(read_native(*HEADERS, "cpu/silhouettes.h") + SCENE + _MEASURE)
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
