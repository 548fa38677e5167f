# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Transparent surfaces on CPU cores: `layers` for lists of the pixels that show what is behind their surfaces.

The pixels of a list are arranged as an image whose blocks of 4 x 4 hold consecutive ones, for kernels that process rows
or blocks of an image.
"""

import warp as wp

from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.constants import BLOCK_SIDE
from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import pixel_center
from warpvis.kernels.rows import RowJob, enter_rows, finish_rows, rows_of, take_rows
from warpvis.kernels.shading.base_colors import DeviceMaterials, Footprint
from warpvis.kernels.shading.layers import Layers, blend_surface, find_opacity_of_pixels

wp.set_module_options(pixel_options("shared/opacity.h", cpu=("cpu/layer_rows.h",)))


@wp.struct
class FindCall:
    """The arguments of a launch over bands of four rows of images, as of `layers.find_opacity`."""

    appearance: DeviceMaterials
    footprint: Footprint
    camera_to_world: wp.array[wp.transform]
    worlds: Worlds
    points: wp.array3d[wp.vec3]
    segmentation: wp.array3d[wp.int32]
    faces: wp.array3d[wp.int32]
    job: RowJob


@wp.struct
class FoundPixels:
    """The pixels of each band that show what is behind their surfaces."""

    count: wp.array2d[wp.int32]
    """(view, band)"""
    pixels: wp.array3d[wp.int32]
    """(view, band, number): y width + x."""
    opacity: wp.array3d[wp.vec2]
    """(view, band, number): opacity, and how often the surface is blended."""


@wp.struct
class ListCall:
    """The arguments of a launch over bands that lists their pixels."""

    found: FoundPixels
    first: wp.array2d[wp.int32]  # (view, band + 1): number of pixels in the bands before
    width: int  # of the image
    points: wp.array3d[wp.vec3]
    segmentation: wp.array3d[wp.int32]
    faces: wp.array3d[wp.int32]
    color: wp.array3d[wp.vec3ub]
    places: wp.array3d[wp.vec2]  # image points of the pixels; None for their centers
    rays: wp.array3d[wp.vec3d]  # (view or 1, y, x); may be None
    job: RowJob


@wp.struct
class PixelList:
    """Listed pixels, as an image, and the surfaces behind which their rays go on."""

    layers: Layers
    pixels: wp.array3d[wp.int32]
    """y width + x; -1 after the last one."""
    places: wp.array3d[wp.vec2]
    """Image points [px]; NaN after the last one, and for finished pixels."""
    rays: wp.array3d[wp.vec3d]
    """Rays of the camera frame; may be None."""
    points: wp.array3d[wp.vec3]
    segmentation: wp.array3d[wp.int32]
    faces: wp.array3d[wp.int32]


@wp.struct
class BlendCall:
    """The arguments of a launch over rows of a list, as of `layers.find_opacity` and `layers.blend_layer`."""

    appearance: DeviceMaterials
    footprint: Footprint
    camera_to_world: wp.array[wp.transform]
    worlds: Worlds
    listed: PixelList
    points: wp.array3d[wp.vec3]  # of the surfaces that are blended
    segmentation: wp.array3d[wp.int32]
    faces: wp.array3d[wp.int32]
    is_back: wp.array3d[wp.uint8]
    color: wp.array3d[wp.vec3ub]  # of the listed pixels
    opacity: wp.array3d[wp.vec2]  # memory for the list
    number: int
    job: RowJob


@wp.struct
class BlendedImages:
    """The colors of all pixels, and a number that becomes 1 if any listed pixel shows more than this layer."""

    color: wp.array3d[wp.vec3ub]
    unfinished: wp.array[wp.int32]


@wp.func_native("warpvis::list_transparent(calls.data[0], found_out.data[0]);")
def find_transparent_of(calls: wp.array[FindCall], found_out: wp.array[FoundPixels]): ...


@wp.kernel
def find_transparent_rows(
    # In:
    calls: wp.array[FindCall],
    # Out:
    found_out: wp.array[FoundPixels],
):
    """Find the pixels of one call that show what is behind their surfaces; each array contains one element.

    Every worker launches this kernel, as those below.
    """
    _ = wp.tid()
    find_transparent_of(calls, found_out)


@wp.func
def place_of(number: int, columns: int) -> wp.vec2i:
    """Return the row and column of a listed pixel."""
    block, pixel = number // (BLOCK_SIDE * BLOCK_SIDE), number % (BLOCK_SIDE * BLOCK_SIDE)
    across = columns // BLOCK_SIDE
    return wp.vec2i(
        block // across * BLOCK_SIDE + pixel // BLOCK_SIDE, block % across * BLOCK_SIDE + pixel % BLOCK_SIDE
    )


@wp.func
def list_pixel(call: ListCall, view: int, band: int, number: int, list_out: PixelList):
    """Copy a pixel that was found in a band to the list, and blend its surface as the first layer."""
    place = place_of(call.first[view, band] + number, list_out.pixels.shape[2])
    row, column = place[0], place[1]
    pixel = call.found.pixels[view, band, number]
    y, x = pixel // call.width, pixel % call.width
    list_out.pixels[view, row, column] = pixel
    center = pixel_center(y, x)
    if call.places:
        center = call.places[view, y, x]
    list_out.places[view, row, column] = center
    if call.rays:
        list_out.rays[view, row, column] = call.rays[wp.min(view, call.rays.shape[0] - 1), y, x]
    list_out.points[view, row, column] = call.points[view, y, x]
    list_out.segmentation[view, row, column] = call.segmentation[view, y, x]
    list_out.faces[view, row, column] = call.faces[view, y, x]
    opacity = call.found.opacity[view, band, number]
    blend_surface(list_out.layers, 0, opacity, call.color[view, y, x], view, row, column)


@wp.func
def end_list(first: int, view: int, list_out: PixelList):
    """Mark places of the list from a number on as unused."""
    for number in range(first, list_out.pixels.shape[1] * list_out.pixels.shape[2]):
        place = place_of(number, list_out.pixels.shape[2])
        row, column = place[0], place[1]
        list_out.pixels[view, row, column] = -1
        list_out.places[view, row, column] = wp.vec2(wp.nan, wp.nan)
        list_out.segmentation[view, row, column] = -2
        list_out.layers.clear[view, row, column] = wp.vec2(0.0, 0.0)


@wp.kernel
def list_transparent_rows(
    # In:
    calls: wp.array[ListCall],
    # Out:
    lists_out: wp.array[PixelList],
):
    """List the pixels of one call, band after band, and blend their surfaces as the first layer."""
    _ = wp.tid()
    call, listed = calls[0], lists_out[0]
    enter_rows(call.job)
    unit = take_rows(call.job)
    while unit >= 0:
        rows = rows_of(call.job, unit)
        for band in range(rows[1], rows[2]):
            for number in range(call.found.count[rows[0], band]):
                list_pixel(call, rows[0], band, number, listed)
            if band == call.job.height - 1:
                end_list(call.first[rows[0], band + 1], rows[0], listed)
        unit = take_rows(call.job)
    finish_rows(call.job)


@wp.func
def blend_row(call: BlendCall, view: int, row: int, images_out: BlendedImages):
    """Blend the surfaces that a row of the list shows, and write the colors of finished pixels."""
    columns, width = call.color.shape[2], images_out.color.shape[2]
    listed = call.listed
    find_opacity_of_pixels(
        call.appearance,
        call.footprint,
        call.camera_to_world,
        call.worlds,
        call.points,
        call.segmentation,
        call.faces,
        call.is_back,
        view,
        row,
        0,
        columns,
        call.opacity,
    )
    for column in range(columns):
        if listed.layers.clear[view, row, column][0] == 0.0:
            continue
        opacity = call.opacity[view, row, column]
        color = call.color[view, row, column]
        finished, blended = blend_surface(listed.layers, call.number, opacity, color, view, row, column)
        if finished:
            pixel = listed.pixels[view, row, column]
            images_out.color[view, pixel // width, pixel % width] = blended
            listed.places[view, row, column] = wp.vec2(wp.nan, wp.nan)
        else:
            images_out.unfinished[0] = 1


@wp.kernel
def blend_layer_rows(
    # In:
    calls: wp.array[BlendCall],
    # Out:
    images_out: wp.array[BlendedImages],
):
    """Blend a layer of listed pixels with those in front of it, and write the colors of finished pixels."""
    _ = wp.tid()
    call, images = calls[0], images_out[0]
    enter_rows(call.job)
    unit = take_rows(call.job)
    while unit >= 0:
        rows = rows_of(call.job, unit)
        for row in range(rows[1], rows[2]):
            blend_row(call, rows[0], row, images)
        unit = take_rows(call.job)
    finish_rows(call.job)
