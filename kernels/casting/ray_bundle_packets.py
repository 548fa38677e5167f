# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Ray bundles, as in `kernels.casting.ray_bundles`, by packets on CPU cores; see ``native/cpu/table.h``."""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.packets import BvhScene
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import include_native

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


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
    """Images to render, in units of bundles. Counters are a `JobCounter` of ``native/shared`` and start at 0."""

    views: int
    height: int
    width: int
    near: float
    far: float
    clip_inv_z: float
    clip_reach: float
    cull_backfaces: int
    bundle_far: wp.array[float]
    counter: wp.array[wp.int32]
    scratch: wp.array2d[wp.uint8]  # per worker; None to measure the bytes that a worker needs
    scratch_bytes: wp.array[wp.int64]


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
    """The arguments of a launch; see `kernels.casting.packets.PacketCall`."""

    scene: BvhScene
    job: TableJob
    rays: RayBundles
    origins: RayOrigins
    poses: wp.array[wp.transform]
    worlds: Worlds


def _make_kernel(rays: str) -> wp.Kernel:
    """Return the kernel for a ``RayKind`` of ``native/cpu/image.h``, in a separate module, as compilation is slow."""

    @wp.func_native(f"warpvis::TableLaunch::table<warpvis::{rays}>(calls.data[0], images_out.data[0]);")
    def cast_bundles(
        calls: wp.array[TableCall],
        images_out: wp.array[Images],
    ): ...

    options = include_native("cpu/table.h")

    @wp.kernel(
        module="unique", enable_backward=False, grid_stride=False, module_options={"extra_build_options": options}
    )
    def cast_table_packets(
        # In:
        calls: wp.array[TableCall],
        # Out:
        images_out: wp.array[Images],
    ):
        """Write the requested images (None is skipped) of one call; each array contains one element.

        Every worker launches this kernel with the same arguments. The job's shared counters assign worker indices and
        units of work.
        """
        _ = wp.tid()
        cast_bundles(calls, images_out)

    return cast_table_packets


cast_table_packets, cast_ray_origin_packets = _make_kernel("TABLE_RAYS"), _make_kernel("ORIGIN_RAYS")
