# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Packets of rays with distinct origins: see ``native/cpu/ray_raster_origins.h``."""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.packets import BvhScene
from warpvis.kernels.casting.ray_bundle_packets import RayBundles, TableJob
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import include_native

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "extra_build_options": include_native("cpu/table.h")}
)


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


@wp.func_native("warpvis::TableLaunch::origins(calls.data[0], images_out.data[0]);")
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
