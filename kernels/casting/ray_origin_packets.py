# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Packets of rays with distinct origins: see ``native/cpu/ray_raster_origins.h``."""

import warp as wp

from warpvis.kernels.casting.images import NATIVE_IMAGES, Images
from warpvis.kernels.casting.packets import CALL, SCENE, BvhScene
from warpvis.kernels.casting.ray_bundle_packets import TABLE_HEADERS, RayBundles, TableJob
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import read_native

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class RayOrigins:
    """Intersections of the rays of `RayBundles` with the plane of their bundle's eye, and their origins.

    See ``RayOrigins`` of ``ray_tree.h``.
    """

    p: wp.array[float]
    q: wp.array[float]
    begin: wp.array[float]
    clip_inv_z: wp.array[float]
    row_p: wp.array[float]
    row_q: wp.array[float]
    range: wp.array2d[float]  # (tiles, words)
    eye: wp.array2d[wp.float64]  # (bundles, 3), in the frame of the bundle's face
    maxima: wp.array2d[float]  # (bundles, 3): maximum p, q, and distance from the eye to the origin of a ray


@wp.struct
class RayOriginCall:
    """The arguments of a launch; see `kernels.casting.packets.PacketCall`."""

    scene: BvhScene
    job: TableJob
    rays: RayBundles
    origins: RayOrigins
    poses: wp.array[wp.transform]
    worlds: Worlds


_CAST = """
const auto& rays = calls.data->rays;
const auto& origins = calls.data->origins;
const RayTree tree = {rays.group_bounds.data, rays.tile_bounds.data, rays.packet_bounds.data, rays.u.data, rays.v.data,
                      rays.rest_u.data, rays.rest_v.data, rays.row_u.data, rays.row_v.data, rays.scale.data,
                      rays.place.data, rays.run.data, rays.corner.data, (const RayFit*)rays.fit.data, job.clip_inv_z,
                      {origins.p.data, origins.q.data, origins.begin.data, origins.clip_inv_z.data, origins.row_p.data,
                       origins.row_q.data, origins.range.data, 0.0f, 0.0f, 0.0f}};
const TableJob shape = {job.views, job.height, job.width, rays.bundle.shape[0], (const Bundle*)rays.bundle.data,
                        job.bundle_far.data, rays.focal, job.near, job.far, job.clip_inv_z, job.clip_reach,
                        job.cull_backfaces != 0, (const float*)poses.data, tree, rays.without_ray.data,
                        rays.without_ray.shape[0], rays.max_groups, origins.eye.data, origins.maxima.data};
if (!job.scratch.data) {
    Arena measured = Arena::at(nullptr);
    TableMemory::carve(measured, shape, scene.drawn_count, scene.levels);
    job.scratch_bytes.data[0] = measured.used;
    return;
}
const int worker = Workers::enter(job.counter.data);
Arena arena = Arena::at((char*)job.scratch.data + (long long)worker * job.scratch.strides[0]);
const TableMemory memory = TableMemory::carve(arena, shape, scene.drawn_count, scene.levels);
TablePackets::run(drawn, shape, out, memory, job.counter.data);
"""

_REPLACED_HEADERS = {"cpu/table_rays.h": "cpu/origin_rays.h", "cpu/ray_raster.h": "cpu/ray_raster_origins.h"}
RAY_ORIGIN_HEADERS = tuple(_REPLACED_HEADERS.get(name, name) for name in TABLE_HEADERS)


@wp.func_native(read_native(*RAY_ORIGIN_HEADERS, "cpu/table.h") + CALL + SCENE + NATIVE_IMAGES + _CAST)
def cast_ray_origin_bundles(
    calls: wp.array[RayOriginCall],
    images_out: wp.array[Images],
): ...


@wp.kernel
def cast_ray_origin_packets(
    # In:
    calls: wp.array[RayOriginCall],
    # Out:
    images_out: wp.array[Images],
):
    """Write the requested images (None is skipped) of one call; each array contains one element.

    Every worker launches this kernel with the same arguments. The job's shared counters assign worker indices and
    units of work.
    """
    _ = wp.tid()
    cast_ray_origin_bundles(calls, images_out)
