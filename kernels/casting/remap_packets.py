# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images at positions given by maps, by packets on CPU cores; see ``native/cpu/remap.h``."""

import warp as wp

from warpvis.kernels.casting.images import NATIVE_IMAGES, Images
from warpvis.kernels.casting.packets import CALL, SCENE, BvhScene
from warpvis.kernels.casting.ray_bundle_packets import TABLE_HEADERS
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import read_native
from warpvis.kernels.pinhole import PinholeCamera

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


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


_CAST = """
const auto& camera = job.camera;
const RemapJob shape = {job.views, job.rows, job.columns, (int)camera.width, (int)camera.height,
                        {camera.fx, camera.fy}, {camera.cx, camera.cy}, job.tree_focal, camera.near, camera.far,
                        camera.clip_inv_z, camera.clip_reach, job.cull_backfaces != 0, (const float*)poses.data,
                        job.pixels.data};
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
    """Write the requested images (None is skipped) of one call; each array contains one element.

    Every worker launches this kernel with the same arguments. The job's shared counters assign worker indices and
    units of work.
    """
    _ = wp.tid()
    cast_trees(calls, images_out)
