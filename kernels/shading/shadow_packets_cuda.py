# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Shadows, as in `kernels.shading.shadow_rays`, by warps of 8 x 4 pixels on CUDA; see ``native/cuda/shadows.h``."""

import warp as wp

from warpvis.kernels.casting.packets import BvhScene
from warpvis.kernels.casting.packets_cuda import FoundObjects, native_options
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.shading.lighting import Lights

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

BLOCK_HEIGHT, BLOCK_WIDTH = 4, 8
"""Pixels of a warp: constants of ``native/cuda/bvh.h`` for packets of 8 x 8 pixels."""


@wp.func_native(
    """
__shared__ warpvis::ShadowMemory memory;
view = warpvis::Warp::uniform(view);
warpvis::shadow_blocks(lights, camera_to_world, worlds, points_in, segmentation_in, normals_in, shadows_out, view)
    .write(warpvis::Scene::of(scene, worlds, found, view), packet_y, packet_x, memory);
"""
)
def cast_block(
    scene: BvhScene,
    lights: Lights,
    camera_to_world: wp.array[wp.transform],
    worlds: Worlds,
    found: FoundObjects,
    points_in: wp.array3d[wp.vec3],
    segmentation_in: wp.array3d[wp.int32],
    normals_in: wp.array3d[wp.vec3],
    shadows_out: wp.array4d[wp.uint8],
    view: int,
    packet_y: int,
    packet_x: int,
): ...


def make_shadow_kernel(resized: bool) -> wp.Kernel:
    """Make the kernel, for worlds that give the sizes of movable objects or not; see `make_packet_kernel`."""
    options = native_options("cuda/shadows.h", 8, True, True, resized)

    @wp.kernel(
        module="unique",
        enable_backward=False,
        grid_stride=False,
        cuda_max_registers=64,  # a full set of blocks on a multiprocessor, worth the spills
        module_options={"extra_build_options": options},
    )
    def cast_shadow_packets_cuda(
        # Scene:
        scene: BvhScene,
        lights: Lights,
        # Cameras:
        camera_to_world: wp.array[wp.transform],
        # In:
        worlds: Worlds,
        found: FoundObjects,
        points_in: wp.array3d[wp.vec3],
        segmentation_in: wp.array3d[wp.int32],
        normals_in: wp.array3d[wp.vec3],
        # Out:
        shadows_out: wp.array4d[wp.uint8],
    ):
        """Write 255 where a light with shadows shines on the surface of a pixel, and 0 elsewhere: (light, view, y, x).

        32 threads write a block of pixels; `found` is unused.
        """
        packet_y, view, packet_x, _ = wp.tid()
        cast_block(
            scene,
            lights,
            camera_to_world,
            worlds,
            found,
            points_in,
            segmentation_in,
            normals_in,
            shadows_out,
            view,
            packet_y,
            packet_x,
        )

    return cast_shadow_packets_cuda
