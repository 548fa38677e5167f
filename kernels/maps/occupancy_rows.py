# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Integration of depth images into an occupancy map on CPU cores: `kernels.maps.occupancy` for 16 numbers at a time."""

import warp as wp

from warpvis.kernels.maps.occupancy import block_corner
from warpvis.kernels.maps.occupancy_blocks import BlockList, Blocks
from warpvis.kernels.maps.occupancy_images import MAX_SAME_SURFACE_STEP, TILE, DepthView
from warpvis.kernels.native_source import include_native
from warpvis.kernels.pinhole import Window, locate

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "extra_build_options": include_native("cpu/occupancy.h")}
)


@wp.func_native(
    """
const int width = depth_in.shape[2], height = depth_in.shape[1];
const float* depth = depth_in.data + ((long long)image * height + y) * width;
const warpvis::SurfaceRow row = {.width = width,
                                 .depth = depth,
                                 .above = y > 0 ? depth - width : nullptr,
                                 .below = y + 1 < height ? depth + width : nullptr,
                                 .near = depth_view.camera.near,
                                 .reach = depth_view.reach,
                                 .sigma = &depth_view.sigma[0],
                                 .max_step = max_step};
row.bound((float*)bounds_out.data + 2LL * y * width);
"""
)
def bound_row(
    depth_view: DepthView,
    image: int,
    y: int,
    max_step: float,
    depth_in: wp.array3d[float],
    bounds_out: wp.array3d[wp.vec2],
): ...


@wp.kernel
def bound_surface(
    # Cameras:
    window: Window,
    image: int,
    views: wp.array[DepthView],
    # In:
    depth_in: wp.array3d[float],
    # Out:
    bounds_out: wp.array3d[wp.vec2],
):
    """Write the intervals of `occupancy_images.bound_surface`; each thread of the kernel takes a row of pixels."""
    index, y, _x = wp.tid()
    index, y = locate(window, index, y)
    bound_row(views[image], image, y, MAX_SAME_SURFACE_STEP, depth_in, bounds_out)


@wp.func_native(
    """
const int width = depth_in.shape[2];
warpvis::Pose pose;
for (int i = 0; i < 3; ++i) {
    pose.position[i] = depth_view.origin[i];
    for (int k = 0; k < 3; ++k) pose.axis[i][k] = depth_view.rotation.data[i][k];
}
const double focal[2] = {depth_view.camera.fx, depth_view.camera.fy};
const double center[2] = {depth_view.camera.cx, depth_view.camera.cy};
const warpvis::DepthRow row = {.width = width,
                               .depth = depth_in.data + ((long long)image * depth_in.shape[1] + y) * width,
                               .range = warpvis::DepthRange::of(depth_view.camera.near, depth_view.reach),
                               .origin = pose.position,
                               .directions = warpvis::RowDirections::of(pose, focal, center, y, nullptr)};
warpvis::BlockGrid grid = {.cell = blocks.cell, .slots = blocks.slot.data};
for (int i = 0; i < 3; ++i) {
    grid.first[i] = blocks.first[i];
    grid.size[i] = blocks.slot.shape[i];
}
grid.mark(row, marks_out.data, marked_slots_out.data);
"""
)
def mark_row(
    depth_view: DepthView,
    image: int,
    y: int,
    blocks: Blocks,
    depth_in: wp.array3d[float],
    marks_out: wp.array2d[wp.uint8],
    marked_slots_out: wp.array[wp.uint8],
): ...


@wp.kernel
def mark_points(
    # Cameras:
    window: Window,
    image: int,
    views: wp.array[DepthView],
    # In:
    blocks: Blocks,
    depth_in: wp.array3d[float],
    # Out:
    marks_out: wp.array2d[wp.uint8],
    marked_slots_out: wp.array[wp.uint8],
):
    """Mark voxels as `occupancy.mark_points` does; each thread of the kernel takes a row of pixels."""
    index, y, _x = wp.tid()
    index, y = locate(window, index, y)
    mark_row(views[image], image, y, blocks, depth_in, marks_out, marked_slots_out)


@wp.func_native(
    """
unsigned char* marks = nullptr;
if (marked_slots_out.data[slot]) marks = marks_out.data + (long long)warpvis::BLOCK_SIZE * slot;
marked_slots_out.data[slot] = 0;
const warpvis::VoxelBlock block = {.values = (short*)blocks_out.voxels.data + (long long)warpvis::BLOCK_SIZE * slot,
                                   .marks = marks};
warpvis::BlockView depth = {.fx = (float)view.camera.fx,
                            .fy = (float)view.camera.fy,
                            .cx = (float)view.camera.cx,
                            .cy = (float)view.camera.cy,
                            .width = view.camera.width,
                            .height = view.camera.height,
                            .reach = view.reach,
                            .row_length = bounds_in.shape[2],
                            .bounds = (const float*)bounds_in.data,
                            .tiles = (const float*)tiles_in.data,
                            .tile_side = tile_side,
                            .tiles_per_row = tiles_in.shape[2],
                            .hit = (short)view.hit,
                            .miss = (short)view.miss,
                            .minimum = (short)view.minimum,
                            .maximum = (short)view.maximum,
                            .cell = (float)blocks_out.cell};
float sight[3], position[3] = {};
for (int i = 0; i < 3; ++i) {
    sight[i] = (float)center[i];
    double place = 0;
    for (int k = 0; k < 3; ++k) {
        place += view.rotation.data[i][k] * center[k];
        depth.step[k][i] = (float)(view.rotation.data[i][k] * blocks_out.cell);
    }
    position[i] = (float)place;
}
const auto summary = update == 3 ? block.update(depth, sight, position) : block.update(depth, update == 1);
ranges_out.data[2 * row] = summary.low();
ranges_out.data[2 * row + 1] = summary.high();
"""
)
def update_block(
    view: DepthView,
    blocks_out: Blocks,
    slot: int,
    update: int,
    center: wp.vec3d,
    bounds_in: wp.array3d[wp.vec2],
    tile_side: int,
    tiles_in: wp.array3d[wp.vec3],
    marks_out: wp.array2d[wp.uint8],
    marked_slots_out: wp.array[wp.uint8],
    row: int,
    ranges_out: wp.array2d[wp.int32],
): ...


@wp.kernel
def update_voxels(
    # Cameras:
    window: Window,
    image: int,
    views: wp.array[DepthView],
    # In:
    bounds_in: wp.array3d[wp.vec2],
    tiles_in: wp.array3d[wp.vec3],
    # Out:
    listed_out: BlockList,
    blocks_out: Blocks,
    marks_out: wp.array2d[wp.uint8],
    marked_slots_out: wp.array[wp.uint8],
):
    """Update listed blocks and write the ranges of their values, one block per thread."""
    row, i, _j = wp.tid()
    row, i = locate(window, row, i)

    view = views[image]
    x, y, z = listed_out.blocks[row][0], listed_out.blocks[row][1], listed_out.blocks[row][2]
    half = wp.float64(0.5) * blocks_out.cell
    center = block_corner(view, blocks_out, wp.vec3i(x, y, z)) + wp.vec3d(half, half, half)
    update_block(
        view,
        blocks_out,
        blocks_out.slot[x, y, z],
        listed_out.blocks[row][3] % 4,
        center,
        bounds_in,
        TILE,
        tiles_in,
        marks_out,
        marked_slots_out,
        row,
        listed_out.ranges,
    )
