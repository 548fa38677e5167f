# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images of the places of maps, by packets on CPU cores, in ``native/cpu/remap.h``."""

import warp as wp

from warpvis.kernels.images import NATIVE_IMAGES, Images
from warpvis.kernels.native_source import read_native
from warpvis.kernels.packets import CALL, SCENE, BvhScene
from warpvis.kernels.pinhole import PinholeCamera
from warpvis.kernels.table_packets import TABLE_HEADERS
from warpvis.kernels.worlds import Worlds

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class RemapJob:
    """Images to make, in units of trees over parts of maps. Counters, from 0, are a `JobCounter` of ``native/shared``.

    A map says for each pixel of images, (rows, columns), which place of the camera's image it shows, x y x y ... [px].
    """

    views: int
    rows: int
    columns: int
    camera: PinholeCamera
    tree_focal: wp.float64
    cull_backfaces: int
    at: wp.array[float]
    counter: wp.array[wp.int32]
    scratch: wp.array2d[wp.uint8]  # of each worker; None to measure how many bytes each needs
    scratch_bytes: wp.array[wp.int64]


@wp.struct
class RemapCall:
    """What a launch is given, as `kernels.packets.PacketCall`."""

    scene: BvhScene
    job: RemapJob
    poses: wp.array[wp.transform]
    worlds: Worlds


_CAST = """
const auto& camera = job.camera;
const RemapJob shape = {job.views, job.rows, job.columns, (int)camera.width, (int)camera.height,
                        {camera.fx, camera.fy}, {camera.cx, camera.cy}, job.tree_focal, camera.near, camera.far,
                        camera.most_inv_z, camera.clip_reach, job.cull_backfaces != 0, (const float*)poses.data,
                        job.at.data};
if (!job.scratch.data) {
    Arena measured = Arena::at(nullptr);
    RemapMemory::carve(measured, shape, scene.drawn_count, scene.levels);
    job.scratch_bytes.data[0] = measured.used;
    return;
}
const int worker = Workers::enter(job.counter.data);
Arena arena = Arena::at((char*)job.scratch.data + (long long)worker * job.scratch.strides[0]);
const RemapMemory memory = RemapMemory::carve(arena, shape, scene.drawn_count, scene.levels);
RemapPackets::run(drawn, shape, out, memory, job.counter.data);
"""

REMAP_HEADERS = (*TABLE_HEADERS, "cpu/table.h", "cpu/remap_map.h", "cpu/remap_tree.h", "cpu/remap.h")


@wp.func_native(read_native(*REMAP_HEADERS) + CALL + SCENE + NATIVE_IMAGES + _CAST)
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
    """Write the asked-for images (one that is None is skipped) of one call: each array holds one.

    Every worker launches this with the same arguments. The job's counters tell it which one it is, and the next unit
    of work, until none is left.
    """
    _ = wp.tid()
    cast_trees(calls, images_out)
