# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Normal equations of poses on CPU cores: `kernels.gradients.normal_equations` for 16 pixels at a time."""

import warp as wp

from warpvis.kernels.gradients.normal_equations import Rendered, Strips, Weighting
from warpvis.kernels.native_source import include_native
from warpvis.kernels.pinhole import Window, locate

wp.set_module_options(
    {
        "enable_backward": False,
        "default_grid_stride": False,
        "extra_build_options": include_native("cpu/normal_rows.h"),
    }
)


@wp.func_native("""
const long long pixels = strips.pixels, start = (long long)slot * pixels;
const int last = measured_in.shape[0] - 1, view = rendered.views.data[slot];
const auto options = warpvis::PixelWeighting::of(weighting, sigmas.data, sigmas.shape[0]);
const warpvis::NormalImages images = {.width = strips.width,
                                      .pixels = (int)pixels,
                                      .rays = rays_in.data,
                                      .origins = origins_in.data,
                                      .measured = measured_in.data + (view < last ? view : last) * pixels,
                                      .depth = rendered.depth.data + start,
                                      .normals = (const float*)rendered.normals.data + 3 * start,
                                      .objects = rendered.objects.data ? rendered.objects.data + start : nullptr,
                                      .columns = object_columns.data};
const warpvis::Pose camera = warpvis::Pose::from((const float*)camera_to_world.data + 7LL * slot);
warpvis::NormalRows rows = {.options = options, .images = images, .camera = camera, .offset = {0.0, 0.0, 0.0}};
if (options.column >= 0) {
    const long long row = (long long)slot * object_poses.shape[1] + options.column;
    const float* object = (const float*)object_poses.data + 7 * row;
    for (int k = 0; k < 3; ++k) rows.offset[k] = camera.position[k] - object[k];
}
warpvis::NormalSums sums = {};
const int first = strip * strips.size, end = first + strips.size;
rows.add(first, end < strips.pixels ? end : strips.pixels, &sums);
sums.write(strips_out.data + (slot * (long long)strips_out.shape[1] + strip) * strips_out.shape[2]);
""")
def sum_strip(
    object_columns: wp.array[int],
    camera_to_world: wp.array[wp.transform],
    rays_in: wp.array2d[wp.float64],
    origins_in: wp.array2d[wp.float64],
    slot: int,
    strip: int,
    weighting: Weighting,
    strips: Strips,
    sigmas: wp.array[float],
    object_poses: wp.array2d[wp.transform],
    rendered: Rendered,
    measured_in: wp.array2d[float],
    strips_out: wp.array3d[wp.float64],
): ...


@wp.kernel
def sum_terms_rows(
    # Scene:
    object_columns: wp.array[int],
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    rays_in: wp.array2d[wp.float64],
    origins_in: wp.array2d[wp.float64],
    # In:
    window: Window,
    weighting: Weighting,
    strips: Strips,
    sigmas: wp.array[float],
    object_poses: wp.array2d[wp.transform],
    rendered: Rendered,
    measured_in: wp.array2d[float],
    # Out:
    strips_out: wp.array3d[wp.float64],
):
    """Write the sums of `sum_terms`; each thread of the kernel takes a strip of adjacent pixels."""
    slot, strip, _ = wp.tid()
    slot, strip = locate(window, slot, strip)
    sum_strip(
        object_columns,
        camera_to_world,
        rays_in,
        origins_in,
        slot,
        strip,
        weighting,
        strips,
        sigmas,
        object_poses,
        rendered,
        measured_in,
        strips_out,
    )
