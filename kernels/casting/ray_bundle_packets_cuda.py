# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Ray bundles, as in `kernels.casting.ray_bundles`, by packets on CUDA; see ``native/cuda/table.h``."""

import warp as wp

from warpvis.kernels.casting.images import NATIVE_IMAGES, Images
from warpvis.kernels.casting.packets import BvhScene
from warpvis.kernels.casting.packets_cuda import CHECKS, WORLD, FoundObjects, headers
from warpvis.kernels.casting.rays import RayRange
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import read_native

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

FRAME_WORDS = 24
"""Number of 64-bit words of a `TableFrame`."""

EYE_WORDS = 8
"""Number of 64-bit words of a `TableEye`."""


@wp.struct
class RayPackets:
    """A ray bundle in packets; names are those of ``native/cuda/table.h``."""

    frame: wp.array2d[wp.float64]
    """(packet, word): `TableFrame`."""
    points: wp.array2d[wp.vec2]
    """(packet, pixel), as are the next three arrays."""
    rests: wp.array2d[wp.vec2]
    scale: wp.array2d[float]
    place: wp.array2d[wp.int32]
    bounds: wp.array2d[wp.vec4]
    """(packet, block): bounds of the points of rays; None for pixels."""
    eyes: wp.array2d[wp.float64]
    """(packet, word): `TableEye`; this and the next two are None if all rays start at the camera."""
    asides: wp.array2d[wp.vec2]
    """(packet, pixel): intersection of the ray with the eye's plane."""
    begins: wp.array2d[float]
    """(packet, pixel): distance from that plane to the ray's origin."""
    pixels: int
    """Number of pixels of a view."""


_CAST = f"""
{NATIVE_IMAGES}
{CHECKS}
__shared__ WarpMemory memory;
view = Warp::uniform(view);
packet = Warp::uniform(packet);
{WORLD}
const View shape = {{view, PACKET_WIDTH, PACKET_HEIGHT, {{1.0, 1.0}}, {{0.0, 0.0}}, range.near, range.far, NOWHERE,
                     0.0f, (const float*)(poses.data + view), cull_backfaces}};
const long long first = (long long)packet * SLOTS;
const TablePacket rays = {{(const TableFrame*)(packets.frame.data + (long long)packet * TABLE_FRAME_WORDS),
                           (const ImagePoint*)packets.points.data + first,
                           (const ImagePoint*)packets.rests.data + first,
                           packets.scale.data + first, packets.place.data + first,
                           (const ImageBox*)packets.bounds.data + (long long)packet * SLOT_BLOCKS, packets.pixels,
                           ORIGINS}};
rays.cast(all, shape, out, memory);
"""

_ORIGINS = """{packets.eyes.data + (long long)packet * TABLE_EYE_WORDS},
                           {(const ImagePoint*)packets.asides.data + first, packets.begins.data + first}"""


def make_ray_packet_function(
    side: int, with_id: bool, movable: bool, resized: bool = False, points: int = 0, origins: bool = False
) -> wp.Function:
    """Make the native function of a kernel; see `kernels.casting.packets_cuda.make_packet_function`.

    A packet is a square image of a side with one ray per pixel or, if `points` is positive, that many rays anywhere in
    such an image. If `origins`, rays have distinct origins near the camera; otherwise all start at the camera.
    """
    text = f"enum {{ TABLE_FRAME_WORDS = {FRAME_WORDS}, TABLE_EYE_WORDS = {EYE_WORDS} }};\n"
    text += headers(side, with_id, movable, False, resized, ray_table=True, points=points, origins=origins)
    slots = ("cuda/point_blocks.h", "cuda/table_points.h") if points else ("cuda/table_pixels.h",)
    text += read_native(*slots, "cuda/table.h")

    cast = _CAST.replace("ORIGINS", _ORIGINS if origins else "{}, {}")

    @wp.func_native(text + cast)
    def cast_ray_packet(
        scene: BvhScene,
        range: RayRange,
        poses: wp.array[wp.transform],
        worlds: Worlds,
        found: FoundObjects,
        packets: RayPackets,
        view: int,
        packet: int,
        cull_backfaces: bool,
        images: Images,
    ): ...

    return cast_ray_packet


def make_ray_packet_kernel(
    side: int, with_id: bool, movable: bool, resized: bool = False, points: int = 0, origins: bool = False
) -> wp.Kernel:
    """Make a kernel for packets of a ray bundle; see `make_ray_packet_function`."""
    cast_ray_packet = make_ray_packet_function(side, with_id, movable, resized, points, origins)

    @wp.kernel(module="unique", enable_backward=False, grid_stride=False, cuda_max_registers=96 if movable else 80)
    def cast_ray_packets_cuda(
        # Scene:
        scene: BvhScene,
        # Cameras:
        camera: RayRange,
        camera_to_world: wp.array[wp.transform],
        # In:
        worlds: Worlds,
        found: FoundObjects,
        packets: RayPackets,
        cull_backfaces: bool,
        # Out:
        images_out: Images,
    ):
        """Write the requested images (None is skipped); 32 threads per packet of a view."""
        packet, view, _ = wp.tid()
        cast_ray_packet(
            scene, camera, camera_to_world, worlds, found, packets, view, packet, cull_backfaces, images_out
        )

    return cast_ray_packets_cuda
