# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CUDA: a warp traverses a BVH of 32 lanes for a packet of pixels, points or rays.

The C++ is in ``kernels/native/cuda/``. Kernels are specialized by packet size, by whether they output object ids, by
whether objects move or are resized, and by whether the near plane clips.
"""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.packets import BvhScene
from warpvis.kernels.casting.point_order import PointLists
from warpvis.kernels.casting.rays import RayRange
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.constants import CUDA_LANES
from warpvis.kernels.native_source import include_native
from warpvis.kernels.pinhole import PinholeCamera

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

LEVELS = 8
"""Maximum depth of a tree, in levels of nodes."""

CACHED_NUMBERS = 1 << 24
"""Trees with more numbers prefetch leaves: 64 MB exceed the cache of many GPUs."""

TILE_BITS = 5
"""Log2 of the side of a tile of `FoundObjects` [px]."""

MAX_TILES = 4
"""Maximum number of tiles of an object that is sorted by tiles."""

FRAME_WORDS = 26
"""Number of 64-bit words of a `TableFrame` of ``native/cuda/table.h``."""

EYE_WORDS = 8
"""Number of 64-bit words of a `TableEye` of ``native/cuda/ray_origins.h``."""


@wp.struct
class FoundObjects:
    """Movable objects that may be visible in each view; see ``native/cuda/scene.h``."""

    entries: wp.array2d[wp.vec4i]
    """(view, movable object): `FoundObjects::Entry`; None if packets test all movable objects."""
    counts: wp.array2d[wp.int32]
    """(view, 2): number of objects found in few tiles, and in many."""
    tile_counts: wp.array[wp.int32]
    """(tile of a view): number of objects found in few tiles that are in it and not yet in `order`."""
    tile_ends: wp.array[wp.int32]
    """(tile of a view): end of its objects in `order`."""
    order: wp.array[wp.int32]
    """Entries, sorted by tiles."""
    tiles_y: int
    tiles_x: int


@wp.struct
class RayPackets:
    """A ray bundle in packets; names are those of ``native/cuda/table.h``."""

    frame: wp.array2d[wp.float64]
    """(image, word): `TableFrame`."""
    windows: wp.array2d[wp.int32]
    """(packet, 4): image, the packet's first pixel in it, x and y, and whether all slots have a ray."""
    points: wp.array2d[wp.vec2]
    """(packet, pixel), as are the next three arrays."""
    rests: wp.array2d[wp.vec2]
    scale: wp.array2d[float]
    place: wp.array2d[wp.int32]
    bounds: wp.array2d[wp.vec4]
    """(packet, block): bounds of the points of rays; None for pixels."""
    eyes: wp.array2d[wp.float64]
    """(image, word): `TableEye`; this and the next two are None if all rays start at the camera."""
    asides: wp.array2d[wp.vec2]
    """(packet, pixel): intersection of the ray with the eye's plane."""
    begins: wp.array2d[float]
    """(packet, pixel): distance from that plane to the ray's origin."""
    pixels: int
    """Number of pixels of a view."""
    per_view: int
    """Number of packets, which are whole images, if each view has its own rows of all arrays but `windows` and `place`;
    0 if views share them."""


# C++ that renders a packet: of pixels of a pinhole camera, of points of its image, and of a ray bundle. `USED_POINTS`
# renders some packets of those points of a list that are used.
PIXELS = """warpvis::Packets::cast(warpvis::Scene::of(scene, worlds, found, view),
                       warpvis::View::of(camera, poses, view, cull_backfaces), warpvis::Images::of(images, scene),
                       packet_x, packet_y, memory);
"""
POINTS = """warpvis::PointPacket::cast(warpvis::Scene::of(scene, worlds, found, view),
                           warpvis::View::of(camera, poses, view, cull_backfaces),
                           warpvis::PointList::of(rays, view), warpvis::Warp::uniform(packet_y),
                           warpvis::Images::of(images, scene), memory);
"""
USED_POINTS = """warpvis::PointPacket::cast_used(warpvis::Scene::of(scene, worlds, found, view),
                                warpvis::View::of(camera, poses, view, cull_backfaces),
                                warpvis::UsedPoints::of(rays, view), warpvis::Warp::uniform(packet_y), rays.step,
                                warpvis::Images::of(images, scene), memory);
"""
BUNDLE = """warpvis::TablePacket::of(rays, view, warpvis::Warp::uniform(packet_y))
    .cast(warpvis::Scene::of(scene, worlds, found, view),
          warpvis::TablePacket::view_of(camera, poses, view, cull_backfaces), warpvis::Images::of(images, scene),
          memory);
"""

FIND_OBJECT = """
warpvis::Packets::find(warpvis::Scene::of(scene, worlds, found, view), warpvis::View::of(camera, poses, view, false),
                       object);
"""


def native_options(
    header: str,
    side: int,
    with_id: bool,
    movable: bool,
    resized: bool,
    *,
    clip: bool = False,
    ray_table: bool = False,
    points: int = 0,
    origins: bool = False,
) -> wp.ModuleBuildOptions:
    """Return the build options of a kernel for packets; see `make_packet_kernel` and `make_ray_packet_kernel`."""
    values = {
        "PACKET_WIDTH": packet_width(side),
        "PACKET_HEIGHT": side,
        "LEVELS": LEVELS,
        "CACHED_NUMBERS": CACHED_NUMBERS,
        "TILE_BITS": TILE_BITS,
        "MAX_TILES": MAX_TILES,
        "WITH_ID": with_id,
        "MOVABLE": movable,
        "RESIZED": resized,
        "CLIPS": clip,
        "IS_TABLE": ray_table,
        "RAY_TABLE": ray_table or points > 0,
        "POINT_BLOCKS": points // CUDA_LANES,
        "RAY_ORIGINS": origins,
        "TABLE_FRAME_WORDS": FRAME_WORDS,
        "TABLE_EYE_WORDS": EYE_WORDS,
    }
    text = "".join(f"constexpr int {name} = {int(value)};\n" for name, value in values.items())
    return include_native(header, cuda=True, constants=text)


def packet_width(side: int) -> int:
    """Return the width of packets of a height of 1, 2, 4, 8, 16 or 32 pixels: the height, or twice that, up to 4."""
    return max(side, min(2 * side, 4))


def cast_function(call: str, camera_type: type, rays_type: type) -> wp.Function:
    """Return the native function that renders a packet by `PIXELS`, `POINTS` or `BUNDLE`."""
    body = f"""
__shared__ warpvis::WarpMemory memory;
view = warpvis::Warp::uniform(view);
{call}"""

    @wp.func_native(body)
    def cast_packet(
        scene: BvhScene,
        camera: camera_type,
        poses: wp.array[wp.transform],
        worlds: Worlds,
        found: FoundObjects,
        rays: rays_type,
        view: int,
        packet_y: int,
        packet_x: int,
        cull_backfaces: bool,
        images: Images,
    ): ...

    return cast_packet


def _make_kernel(
    call: str, camera_type: type, rays_type: type, registers: int, options: wp.ModuleBuildOptions
) -> wp.Kernel:
    cast_packet = cast_function(call, camera_type, rays_type)

    @wp.kernel(
        module="unique",
        enable_backward=False,
        grid_stride=False,
        cuda_max_registers=registers,
        module_options={"extra_build_options": options},
    )
    def cast_packets_cuda(
        # Scene:
        scene: BvhScene,
        # Cameras:
        camera: camera_type,
        camera_to_world: wp.array[wp.transform],
        # In:
        worlds: Worlds,
        found: FoundObjects,
        rays: rays_type,
        cull_backfaces: bool,
        # Out:
        images_out: Images,
    ):
        """Write the requested images (None is skipped); 32 threads per packet.

        Rows of packets of all views are interleaved. Packets at the horizon take longest, in all views alike; the last
        packets of a launch are from the bottom rows, which finish together. Packets of points and of ray bundles are in
        one column.
        """
        packet_y, view, packet_x, _ = wp.tid()
        cast_packet(
            scene,
            camera,
            camera_to_world,
            worlds,
            found,
            rays,
            view,
            packet_y,
            packet_x,
            cull_backfaces,
            images_out,
        )

    return cast_packets_cuda


def make_packet_kernel(
    side: int,
    with_id: bool,
    movable: bool,
    clip: bool,
    resized: bool = False,
    points: int = 0,
    used: bool = False,
) -> wp.Kernel:
    """Make a kernel for packets of pixels or image points, which every thread of a warp runs.

    Args:
        side: Packet height; see `packet_width`. It is 32 for points.
        with_id: Whether normals, labels or objects may be requested.
        movable: Whether the scene may have movable objects.
        clip: Whether surfaces nearer than the camera's `near` are invisible.
        resized: Whether movable objects have the sizes of `Worlds.object_sizes`, which must not be None then.
        points: If positive, packets consist of 64, 256 or 1024 points of `rays`. Otherwise the kernel ignores `rays`.
        used: Whether warps loop over packets of the points that are used, `PointLists.used`.
    """
    header, call = ("cuda/points.h", USED_POINTS if used else POINTS) if points else ("cuda/packets.h", PIXELS)
    options = native_options(header, side, with_id, movable, resized, clip=clip, points=points)
    registers = _max_registers(movable, is_wide_image=side == 32 and not points, with_id=with_id)
    return _make_kernel(call, PinholeCamera, PointLists, registers, options)


def make_ray_packet_kernel(
    side: int, with_id: bool, movable: bool, resized: bool = False, points: int = 0, origins: bool = False
) -> wp.Kernel:
    """Make a kernel for packets of a ray bundle; see `make_packet_kernel`.

    A packet is a square of a side, with one ray per pixel, of an image of that side or a larger one or, if `points` is
    positive, that many rays anywhere in such an image. If `origins`, rays have distinct origins near the camera;
    otherwise all start at the camera.
    """
    options = native_options(
        "cuda/table.h", side, with_id, movable, resized, ray_table=True, points=points, origins=origins
    )
    # Distinct origins take more registers: with 96, an OS0-128 is up to 1.14 times as fast as with 80 (H100).
    registers = _max_registers(movable or origins)
    return _make_kernel(BUNDLE, RayRange, RayPackets, registers, options)


def _max_registers(movable: bool, *, is_wide_image: bool = False, with_id: bool = False) -> int:
    """Return the number of registers of a thread: more reduce occupancy too much, and fewer cause too many spills."""
    if movable and is_wide_image:
        return 128 if with_id else 80  # with ids, shared memory limits the occupancy
    return 96 if movable else 80


@wp.func_native(FIND_OBJECT)
def find_object(
    scene: BvhScene,
    camera: PinholeCamera,
    poses: wp.array[wp.transform],
    worlds: Worlds,
    found: FoundObjects,
    view: int,
    object: int,
): ...


def make_find_kernel(resized: bool) -> wp.Kernel:
    """Make the kernel that finds the movable objects that may be visible in each view."""
    options = native_options("cuda/packets.h", 32, False, True, resized)

    @wp.kernel(
        module="unique", enable_backward=False, grid_stride=False, module_options={"extra_build_options": options}
    )
    def find_objects_cuda(
        # Scene:
        scene: BvhScene,
        # Cameras:
        camera: PinholeCamera,
        camera_to_world: wp.array[wp.transform],
        # In:
        worlds: Worlds,
        # Out:
        found_out: FoundObjects,
    ):
        """Find the objects that a view may see: one object per lane, one view per warp. Counts must be 0 before."""
        view, group, lane = wp.tid()
        find_object(scene, camera, camera_to_world, worlds, found_out, view, group * CUDA_LANES + lane)

    return find_objects_cuda


@wp.kernel
def sort_into_tiles(
    # Out:
    found_out: FoundObjects,
):
    """Fill `order` from entries, counts and ends: one object per thread. The counts are 0 afterwards."""
    view, i = wp.tid()
    if i >= found_out.counts[view, 0]:
        return
    entry = found_out.entries[view, i]
    columns, rows = entry[1], entry[2]
    for y in range((rows & 0xFFFF) >> TILE_BITS, ((rows >> (16 + TILE_BITS)) & 0x7FF) + 1):
        for x in range((columns & 0xFFFF) >> TILE_BITS, ((columns >> (16 + TILE_BITS)) & 0x7FF) + 1):
            tile = (view * found_out.tiles_y + y) * found_out.tiles_x + x
            found_out.order[found_out.tile_ends[tile] - wp.atomic_sub(found_out.tile_counts, tile, 1)] = i
