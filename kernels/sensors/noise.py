# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Structs and functions shared by models of depth sensors."""

import warp as wp

from warpvis.kernels.pinhole import PinholeCamera


@wp.struct
class SensorInputs:
    """Inputs of a depth sensor for all views; arrays are None if its model does not use them."""

    camera: PinholeCamera  # of a lens: only image size and depth range
    true_depth: wp.array3d[float]
    normals: wp.array3d[wp.vec3]
    segmentation: wp.array3d[wp.int32]
    shown: wp.array3d[wp.int32]  # index of the pixel in the view whose normal and object apply; None: its own
    reflectivity: wp.array[float]  # of objects
    column_slopes: wp.array[wp.float64]  # x of the camera-frame ray with z = 1, for each column; None: it is computed
    row_slopes: wp.array[wp.float64]  # y of that ray, for each row
    draws: wp.array[wp.vec2ui]  # keys of random numbers
    seed: wp.uint32


@wp.struct
class MeasuredImages:
    """Images that a depth sensor writes; reasons may be None."""

    depth: wp.array3d[float]
    reasons: wp.array3d[wp.uint8]


@wp.func_native("return warpvis::SensorRange<warpvis::OnePixel>{camera.near, camera.far}.report(depth);")
def limit_depth(camera: PinholeCamera, depth: float) -> float: ...


@wp.func_native("return warpvis::SensorRange<warpvis::OnePixel>::reason(depth);")
def range_reason(depth: float) -> int: ...


@wp.func
def write_pixel(images_out: MeasuredImages, view: int, y: int, x: int, depth: float, reason: int):
    """Write the measured depth of a pixel and its reason, if requested."""
    images_out.depth[view, y, x] = depth
    if images_out.reasons:
        images_out.reasons[view, y, x] = wp.uint8(reason)
