# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Shadows, as in `kernels.shading.shadow_rays`, by packets of points on CPU cores; see ``native/cpu/shadows.h``."""

import warp as wp

from warpvis.kernels.casting.packets import BvhScene
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import include_native
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.shading.lighting import Lights

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "extra_build_options": include_native("cpu/shadows.h")}
)

PACKET_ROWS = 4
"""Rows of pixels of a packet: `ShadowPacket::HEIGHT`."""


@wp.func_native(
    """
const auto rows = warpvis::shadow_rows(
    lights, camera_to_world, worlds, points_in, segmentation_in, normals_in, shadows_out, view
);
rows.write(warpvis::Scene::of(scene, worlds), scene.levels, row * warpvis::ShadowPacket::HEIGHT);
"""
)
def cast_rows(
    scene: BvhScene,
    lights: Lights,
    camera_to_world: wp.array[wp.transform],
    worlds: Worlds,
    points_in: wp.array3d[wp.vec3],
    segmentation_in: wp.array3d[wp.int32],
    normals_in: wp.array3d[wp.vec3],
    shadows_out: wp.array4d[wp.uint8],
    view: int,
    row: int,
): ...


@wp.kernel
def cast_shadow_packets(
    # Scene:
    scene: BvhScene,
    lights: Lights,
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    points_in: wp.array3d[wp.vec3],
    segmentation_in: wp.array3d[wp.int32],
    normals_in: wp.array3d[wp.vec3],
    # Out:
    shadows_out: wp.array4d[wp.uint8],
):
    """Write 255 where a light with shadows shines on the surface of a pixel, and 0 elsewhere: (light, view, y, x).

    The thread index y counts rows of packets, and a thread writes all pixels of one.
    """
    view, row, _ = wp.tid()
    view, row = locate(window, view, row)
    cast_rows(scene, lights, camera_to_world, worlds, points_in, segmentation_in, normals_in, shadows_out, view, row)
