# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rays through image points, as in `kernels.casting.rays.cast_rays_at`, by CUDA packets: ``native/cuda/points.h``."""

import warp as wp

from warpvis.kernels.casting.images import NATIVE_IMAGES, Images
from warpvis.kernels.casting.packets import BvhScene
from warpvis.kernels.casting.packets_cuda import CHECKS, VIEW, WORLD, FoundObjects, headers
from warpvis.kernels.casting.point_order import PointLists
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import read_native
from warpvis.kernels.pinhole import PinholeCamera

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

_CAST = f"""
{NATIVE_IMAGES}
{CHECKS}
static_assert(sizeof(*points.pixels.data) == sizeof(ImagePoint), "points are read as two numbers");
__shared__ WarpMemory memory;
view = Warp::uniform(view);
packet = Warp::uniform(packet);
{WORLD}
{VIEW}
const int count = points.pixels.shape[1];
const bool sorted = points.spread.data[view] > 0;
const int first = sorted && view > 0 ? points.ends.data[(long long)view * points.cells - 1] : 0;
const PointList list = {{(const ImagePoint*)points.pixels.data + (long long)view * count, count,
                         sorted ? points.order.data + first : nullptr, points.columns}};
PointPacket::cast(all, shape, list, packet, out, memory);
"""


def make_point_packet_function(
    points: int, with_id: bool, movable: bool, clip: bool, resized: bool = False
) -> wp.Function:
    """Make the native function of a kernel; see `kernels.casting.packets_cuda.make_packet_function`.

    Args:
        points: Number of points per packet: 64, 256 or 1024.
        with_id: Whether normals, labels or objects may be requested.
        movable: Whether the scene may have movable objects.
        clip: Whether surfaces nearer than the camera's `near` are invisible.
        resized: Whether movable objects have the sizes of `Worlds.object_sizes`, which must not be None then.
    """
    text = headers(32, with_id, movable, clip, resized, points=points) + read_native(
        "cuda/point_blocks.h", "cuda/points.h"
    )

    @wp.func_native(text + _CAST)
    def cast_point_packet(
        scene: BvhScene,
        camera: PinholeCamera,
        poses: wp.array[wp.transform],
        worlds: Worlds,
        found: FoundObjects,
        points: PointLists,
        view: int,
        packet: int,
        cull_backfaces: bool,
        images: Images,
    ): ...

    return cast_point_packet


def make_point_packet_kernel(points: int, with_id: bool, movable: bool, clip: bool, resized: bool = False) -> wp.Kernel:
    """Make a kernel for packets of image points; see `make_point_packet_function`."""
    cast_point_packet = make_point_packet_function(points, with_id, movable, clip, resized)

    @wp.kernel(module="unique", enable_backward=False, grid_stride=False, cuda_max_registers=96 if movable else 80)
    def cast_point_packets_cuda(
        # Scene:
        scene: BvhScene,
        # Cameras:
        camera: PinholeCamera,
        camera_to_world: wp.array[wp.transform],
        # In:
        worlds: Worlds,
        found: FoundObjects,
        points: PointLists,
        cull_backfaces: bool,
        # Out:
        images_out: Images,
    ):
        """Write the requested images (None is skipped); 32 threads per packet of a view."""
        packet, view, _ = wp.tid()
        cast_point_packet(
            scene, camera, camera_to_world, worlds, found, points, view, packet, cull_backfaces, images_out
        )

    return cast_point_packets_cuda
