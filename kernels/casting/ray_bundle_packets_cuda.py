# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Ray bundles, as in `kernels.casting.ray_bundles`, by packets on CUDA; see ``native/cuda/table.h``."""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.packets import BvhScene
from warpvis.kernels.casting.packets_cuda import FoundObjects, native_options
from warpvis.kernels.casting.rays import RayRange
from warpvis.kernels.casting.worlds import Worlds

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


CAST = """
__shared__ warpvis::WarpMemory memory;
view = warpvis::Warp::uniform(view);
packet = warpvis::Warp::uniform(packet);
warpvis::TablePacket::of(packets, packet)
    .cast(warpvis::Scene::of(scene, worlds, found, view),
          warpvis::TablePacket::view_of(range, poses, view, cull_backfaces), warpvis::Images::of(images, scene),
          memory);
"""

_CONSTANTS = f"constexpr int TABLE_FRAME_WORDS = {FRAME_WORDS}, TABLE_EYE_WORDS = {EYE_WORDS};\n"


@wp.func_native(CAST)
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


def make_ray_packet_kernel(
    side: int, with_id: bool, movable: bool, resized: bool = False, points: int = 0, origins: bool = False
) -> wp.Kernel:
    """Make a kernel for packets of a ray bundle; see `kernels.casting.packets_cuda.make_packet_kernel`.

    A packet is a square image of a side with one ray per pixel or, if `points` is positive, that many rays anywhere in
    such an image. If `origins`, rays have distinct origins near the camera; otherwise all start at the camera.
    """
    options = native_options(
        "cuda/table.h",
        side,
        with_id,
        movable,
        resized,
        ray_table=True,
        points=points,
        origins=origins,
        constants=_CONSTANTS,
    )

    @wp.kernel(
        module="unique",
        enable_backward=False,
        grid_stride=False,
        cuda_max_registers=96 if movable else 80,
        module_options={"extra_build_options": options},
    )
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
