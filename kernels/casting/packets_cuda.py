# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CUDA: a warp traverses a BVH of 32 lanes for a block of pixels.

The C++ is in ``kernels/native/cuda/``. Kernels are specialized by packet size, by whether they output object ids, by
whether objects move or are resized, and by whether the near plane clips.
"""

import warp as wp

from warpvis.kernels.casting.images import NATIVE_IMAGES, Images
from warpvis.kernels.casting.packets import BvhScene
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.constants import CUDA_LANES
from warpvis.kernels.native_source import read_native
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

_SHARED_HEADERS = ("shared/constants.h", "shared/images.h", "shared/stretch.h", "shared/pose.h", "shared/edges.h")

_HEADERS = (
    "cuda/pixels.h",
    "cuda/uncertain_pixels.h",
    "cuda/raster.h",
    "cuda/visits.h",
    "cuda/walk.h",
    "cuda/solids.h",
    "cuda/objects.h",
    "cuda/output.h",
    "cuda/packets.h",
)


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


CHECKS = """
static_assert(sizeof(*worlds.object_poses.data) == POSE_WORDS * sizeof(float) &&
                  sizeof(*worlds.object_sizes.data) == SOLID_WORDS * sizeof(float),
              "poses and sizes are read as rows of numbers");
"""

WORLD = """
const unsigned char* excluded = nullptr;
const int excluded_row = min(view, worlds.excluded.shape[0] - 1);
if (worlds.excluded.data) excluded = worlds.excluded.data + excluded_row * scene.object_count;
const int world_count = worlds.object_poses.shape[0];
const int world = worlds.world.data ? worlds.world.data[view] : world_count == 1 ? 0 : view;
const float *object_poses = nullptr, *object_sizes = nullptr;
if (world >= 0 && world < world_count) {
    const long long first = (long long)world * scene.movable_count;
    object_poses = (const float*)worlds.object_poses.data + first * POSE_WORDS;
    if (RESIZED) object_sizes = (const float*)worlds.object_sizes.data + first * SOLID_WORDS;
}
// Without movable objects there is one world.
if (scene.movable_count == 0) object_poses = (const float*)scene.instance_pose.data;
const Scene all = {
    {scene.leaves.data, scene.owners.data, scene.nodes.data, scene.children.data, scene.static_root, 0,
     scene.all_closed != 0, scene.leaves.shape[0] > CACHED_NUMBERS, excluded},
    {scene.closed_boxes.data, scene.closed_object.data, scene.closed_count},
    {MOVABLE ? scene.drawn_count : 0, scene.movable_count, scene.movable_object.data, scene.movable_root.data,
     scene.movable_leaf.data, scene.movable_first_id.data, scene.movable_closed.data, scene.movable_boxes.data,
     scene.movable_solid.data, (const float*)scene.movable_size.data, (const float*)scene.instance_pose.data,
     object_poses, object_sizes, excluded},
    {found.entries.data ? (FoundObjects::Entry*)(found.entries.data + (long long)view * scene.drawn_count) : nullptr,
     found.counts.data + 2 * view, found.tile_counts.data, found.tile_ends.data, found.order.data, found.tiles_x,
     view * found.tiles_y * found.tiles_x}};
"""
"""C++ that defines the `Scene` of a view from a kernel's scene, worlds and found objects."""

VIEW = """
const View shape = {view, (int)camera.width, (int)camera.height, {camera.fx, camera.fy}, {camera.cx, camera.cy},
                    camera.near, camera.far, camera.clip_inv_z, camera.clip_reach,
                    (const float*)(poses.data + view), cull_backfaces};
"""

CAST = f"""
{NATIVE_IMAGES}
{CHECKS}
__shared__ WarpMemory memory;
view = Warp::uniform(view);
{WORLD}
{VIEW}
Packets::cast(all, shape, out, packet_x, packet_y, memory);
"""

FIND_OBJECT = f"""
const bool cull_backfaces = false;
{WORLD}
{VIEW}
if (!object_poses) return;
const bool is_object = object < scene.drawn_count;
ObjectPass::find(Packets::camera_of(shape), all.movables, all.found, is_object ? object : scene.drawn_count - 1,
                 is_object);
"""


def headers(
    side: int,
    with_id: bool,
    movable: bool,
    clip: bool,
    resized: bool,
    *,
    ray_table: bool = False,
    points: int = 0,
    origins: bool = False,
) -> str:
    """Return the C++ of packets; see `make_packet_function`.

    If `ray_table`, rays are read from a ray bundle, and have distinct origins if `origins`. If `points` is positive,
    packets consist of that many points of the image or of the bundle.
    """
    head = f"enum {{ PACKET_WIDTH = {packet_width(side)}, PACKET_HEIGHT = {side}, LEVELS = {LEVELS} }};\n"
    head += (
        f"enum {{ MOVABLE = {int(movable)}, RESIZED = {int(resized)}, RAY_TABLE = {int(ray_table or points > 0)} }};\n"
    )
    head += f"enum {{ POINT_BLOCKS = {points // CUDA_LANES}, RAY_ORIGINS = {int(origins)} }};\n"
    head += f"enum {{ TILE_BITS = {TILE_BITS}, MAX_TILES = {MAX_TILES}, CACHED_NUMBERS = {CACHED_NUMBERS} }};\n"
    near = "origins" if origins else "clips" if clip else "occludes"
    kinds = ("cuda/depth_id.h" if with_id else "cuda/depth.h", f"cuda/near_{near}.h")
    kind = ("table" if ray_table else "grid", "table_point" if ray_table else "point")
    places = (f"cuda/{kind[points > 0]}_places.h",)
    if points:
        places = ("cuda/point_index.h", *places)
    setup = (
        f"cuda/{'point' if points else 'no'}_cells.h",
        "cuda/bvh.h",
        f"cuda/{'ray' if origins else 'no'}_origins.h",
        "cuda/camera.h",
        "cuda/scene.h",
        "cuda/setup.h",
        *places,
    )
    return head + read_native(*_SHARED_HEADERS, "cuda/lanes.h", *kinds, *setup, *_HEADERS)


def packet_width(side: int) -> int:
    """Return the width of packets of a height of 1, 2, 4, 8, 16 or 32 pixels: the height, or twice that, up to 4."""
    return max(side, min(2 * side, 4))


def make_packet_function(side: int, with_id: bool, movable: bool, clip: bool, resized: bool = False) -> wp.Function:
    """Make the native function of a kernel, which every thread of a warp calls.

    Args:
        side: Packet height; see `packet_width`.
        with_id: Whether normals, labels or objects may be requested.
        movable: Whether the scene may have movable objects.
        clip: Whether surfaces nearer than the camera's `near` are invisible.
        resized: Whether movable objects have the sizes of `Worlds.object_sizes`, which must not be None then.
    """

    @wp.func_native(headers(side, with_id, movable, clip, resized) + CAST)
    def cast_packet(
        scene: BvhScene,
        camera: PinholeCamera,
        poses: wp.array[wp.transform],
        worlds: Worlds,
        found: FoundObjects,
        view: int,
        packet_y: int,
        packet_x: int,
        cull_backfaces: bool,
        images: Images,
    ): ...

    return cast_packet


def make_packet_kernel(side: int, with_id: bool, movable: bool, clip: bool, resized: bool = False) -> wp.Kernel:
    """Make a kernel for packets of a height; see `make_packet_function`."""
    cast_packet = make_packet_function(side, with_id, movable, clip, resized)

    # More registers reduce occupancy too much; fewer cause too many spills.
    @wp.kernel(module="unique", enable_backward=False, grid_stride=False, cuda_max_registers=96 if movable else 80)
    def cast_packets_cuda(
        # Scene:
        scene: BvhScene,
        # Cameras:
        camera: PinholeCamera,
        camera_to_world: wp.array[wp.transform],
        # In:
        worlds: Worlds,
        found: FoundObjects,
        cull_backfaces: bool,
        # Out:
        images_out: Images,
    ):
        """Write the requested images (None is skipped); 32 threads per packet.

        Rows of packets of all views are interleaved. Packets at the horizon take longest, in all views alike; the last
        packets of a launch are from the bottom rows, which finish together.
        """
        packet_y, view, packet_x, _ = wp.tid()
        cast_packet(
            scene,
            camera,
            camera_to_world,
            worlds,
            found,
            view,
            packet_y,
            packet_x,
            cull_backfaces,
            images_out,
        )

    return cast_packets_cuda


def make_find_kernel(resized: bool) -> wp.Kernel:
    """Make the kernel that finds the movable objects that may be visible in each view."""

    @wp.func_native(headers(32, False, True, False, resized) + FIND_OBJECT)
    def find_object(
        scene: BvhScene,
        camera: PinholeCamera,
        poses: wp.array[wp.transform],
        worlds: Worlds,
        found: FoundObjects,
        view: int,
        object: int,
    ): ...

    @wp.kernel(module="unique", enable_backward=False, grid_stride=False)
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
