# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Soft shadows and ambient occlusion, as in `kernels.shading.soft_shadow_rays`, by packets on CPU cores.

See ``native/cpu/soft_shadows.h``.
"""

import warp as wp

from warpvis.kernels.casting.packets import BvhScene
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import include_native
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.shading.lighting import Lights

wp.set_module_options(
    {
        "enable_backward": False,
        "default_grid_stride": False,
        "extra_build_options": include_native("cpu/soft_shadows.h"),
    }
)

SOFT_ROWS = 16
"""Rows of pixels that a thread writes: `SoftRows::HEIGHT`."""


@wp.func_native(
    """
const auto rows = warpvis::shadow_rows(
    lights, camera_to_world, worlds, points_in, segmentation_in, normals_in, shadows_out, view
);
const auto scene_of = warpvis::Scene::of(scene, worlds);
const int y = row * SOFT_HEIGHT;
warpvis::soft_rows(rows, rows.lights, scene_of, scene.levels, [&](const auto& soft) {
    for (int i = 0; i < rows.light_count; ++i)
        if (rows.lights[i].shadow >= 0 && rows.lights[i].sample_count > 0)
            soft.light(rows.lights[i], (const float*)lights.samples.data, y);
});
""".replace("SOFT_HEIGHT", str(SOFT_ROWS))
)
def cast_soft_rows(
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
def cast_soft_shadow_packets(
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
    """Write the fraction of each light with a radius that shines on the surface of a pixel: (light, view, y, x).

    The thread index y counts groups of `SOFT_ROWS` rows, and a thread writes all pixels of one.
    """
    view, row, _ = wp.tid()
    view, row = locate(window, view, row)
    cast_soft_rows(
        scene, lights, camera_to_world, worlds, points_in, segmentation_in, normals_in, shadows_out, view, row
    )


@wp.func_native(
    """
const auto rows = warpvis::shadow_rows(
    lights, camera_to_world, worlds, points_in, segmentation_in, normals_in, occlusion_out, view
);
const auto scene_of = warpvis::Scene::of(scene, worlds);
warpvis::soft_rows(rows, rows.lights, scene_of, scene.levels, [&](const auto& soft) {
    soft.ambient((const float*)directions.data, directions.shape[1], distance, row * SOFT_HEIGHT);
});
""".replace("SOFT_HEIGHT", str(SOFT_ROWS))
)
def cast_occlusion_rows(
    scene: BvhScene,
    lights: Lights,
    camera_to_world: wp.array[wp.transform],
    worlds: Worlds,
    directions: wp.array2d[wp.vec3],
    distance: float,
    points_in: wp.array3d[wp.vec3],
    segmentation_in: wp.array3d[wp.int32],
    normals_in: wp.array3d[wp.vec3],
    occlusion_out: wp.array3d[wp.uint8],
    view: int,
    row: int,
): ...


@wp.kernel
def cast_occlusion_packets(
    # Scene:
    scene: BvhScene,
    lights: Lights,
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    directions: wp.array2d[wp.vec3],
    distance: float,
    points_in: wp.array3d[wp.vec3],
    segmentation_in: wp.array3d[wp.int32],
    normals_in: wp.array3d[wp.vec3],
    # Out:
    occlusion_out: wp.array3d[wp.uint8],
):
    """Write the fraction of ambient light that surfaces within a distance do not block, 255 for 1.

    `directions` are those of classes of pixels, (class, direction). The thread index y counts groups of `SOFT_ROWS`
    rows, and a thread writes all pixels of one.
    """
    view, row, _ = wp.tid()
    view, row = locate(window, view, row)
    cast_occlusion_rows(
        scene,
        lights,
        camera_to_world,
        worlds,
        directions,
        distance,
        points_in,
        segmentation_in,
        normals_in,
        occlusion_out,
        view,
        row,
    )
