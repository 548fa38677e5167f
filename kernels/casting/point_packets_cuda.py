# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rays through image points, as in `kernels.casting.rays.cast_rays_at`, by CUDA packets: ``native/cuda/points.h``."""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.packets import BvhScene
from warpvis.kernels.casting.packets_cuda import FoundObjects, native_options
from warpvis.kernels.casting.point_order import PointLists
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.pinhole import PinholeCamera

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

CAST = """
__shared__ warpvis::WarpMemory memory;
view = warpvis::Warp::uniform(view);
packet = warpvis::Warp::uniform(packet);
warpvis::PointPacket::cast(warpvis::Scene::of(scene, worlds, found, view),
                           warpvis::View::of(camera, poses, view, cull_backfaces),
                           warpvis::PointList::of(points, view), packet, warpvis::Images::of(images, scene), memory);
"""


@wp.func_native(CAST)
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


def make_point_packet_kernel(points: int, with_id: bool, movable: bool, clip: bool, resized: bool = False) -> wp.Kernel:
    """Make a kernel for packets of 64, 256 or 1024 points; see `kernels.casting.packets_cuda.make_packet_kernel`."""
    options = native_options("cuda/points.h", 32, with_id, movable, resized, clip=clip, points=points)

    @wp.kernel(
        module="unique",
        enable_backward=False,
        grid_stride=False,
        cuda_max_registers=96 if movable else 80,
        module_options={"extra_build_options": options},
    )
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
