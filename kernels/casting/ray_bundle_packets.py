# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Ray bundles, as in `kernels.casting.ray_bundles`, by packets on CPU cores; see ``native/cpu/table.h``."""

import warp as wp

from warpvis.kernels.casting.packets import BvhScene, WorkerMemory, make_packet_kernel
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.pinhole import PinholeCamera


@wp.struct
class RayBundles:
    """Ray bundles as a tree; names are those of ``native/cpu/ray_tree.h``, and of ``Bundle`` in ``table.h``.

    Rows have 16 numbers: bounds of a bundle's groups, a group's tiles and a tile's packets, and a packet's rays.
    """

    bundle: wp.array2d[wp.int32]
    group_bounds: wp.array[float]
    tile_bounds: wp.array[float]
    packet_bounds: wp.array[float]
    u: wp.array[float]
    v: wp.array[float]
    rest_u: wp.array[float]
    rest_v: wp.array[float]
    row_u: wp.array[float]
    row_v: wp.array[float]
    scale: wp.array[float]  # None if all are 1
    place: wp.array[wp.int32]
    run: wp.array[wp.int32]
    corner: wp.array[wp.int32]
    fit: wp.array2d[float]  # (tiles, words of a ``RayFit``)
    without_ray: wp.array[wp.int32]  # pixels that have no ray
    focal: wp.float64
    max_groups: int


@wp.struct
class TableJob:
    """Images to render, in units of bundles."""

    camera: PinholeCamera  # size of the table, range and clipping; the rest is not read
    cull_backfaces: int
    bundle_far: wp.array[float]  # greatest z of a bundle's rays that are in range


@wp.struct
class RayOrigins:
    """Distinct origins of the rays of `RayBundles`, and their intersections with the plane of their bundle's eye.

    See ``RayOrigins`` of ``ray_tree.h``. None if all rays begin at the camera.
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
class TableCall:
    """The arguments of a launch, as in `kernels.casting.packets.PacketCall`."""

    scene: BvhScene
    job: TableJob
    workers: WorkerMemory
    rays: RayBundles
    origins: RayOrigins
    poses: wp.array[wp.transform]
    worlds: Worlds


cast_table_packets = make_packet_kernel("cpu/table.h", "Bundles<warpvis::TABLE_RAYS>", TableCall)
cast_ray_origin_packets = make_packet_kernel("cpu/table.h", "Bundles<warpvis::ORIGIN_RAYS>", TableCall)
