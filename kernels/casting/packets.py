# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CPU cores: views, or strips of them, traverse a BVH with one child per SIMD lane.

The C++ is in ``kernels/native/`` and is compiled by Warp's Clang. It consists of structs of static functions, because
the text of a native function is pasted into a function body.
"""

import warp as wp

from warpvis.kernels.casting.images import NATIVE_IMAGES, Images
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import read_native

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class BvhScene:
    """BVHs in shared arrays: of all static geometry, then of each mesh that is movable or shared by static objects.

    ``owners`` contains each static triangle's object, or the complement of its index if the object is closed. Triangles
    of a movable mesh of a single object have 0 or its complement. Triangle ids are positions in leaves: first those of
    static triangles, then those of each movable object, as if each had its own leaves.
    """

    leaves: wp.array[float]
    owners: wp.array[wp.int32]
    nodes: wp.array[float]
    children: wp.array[wp.int32]
    slot_face: wp.array[wp.int32]  # (position in leaves): face index in the object's mesh, or -1; None until needed
    object_label: wp.array[wp.uint8]
    object_count: int
    levels: int  # of the deepest tree
    static_root: int  # -1 without static geometry
    static_object: wp.array[wp.int32]  # static objects
    closed_boxes: wp.array[float]  # of closed static objects
    closed_object: wp.array[wp.int32]
    closed_count: int
    all_closed: int  # whether all static objects are closed
    movable_count: int
    drawn_count: int  # objects with their own frame: movable objects, then static instances
    instance_pose: wp.array[wp.transform]  # of static instances
    movable_object: wp.array[wp.int32]  # (drawn), as below; -1 if several objects move together: see owners
    movable_root: wp.array[wp.int32]
    movable_leaf: wp.array[wp.int32]  # first leaf of its tree
    movable_first_id: wp.array[wp.int32]  # id of its first triangle
    movable_closed: wp.array[wp.int32]
    movable_boxes: wp.array[float]  # bounds of its triangles, in its frame
    movable_solid: wp.array[wp.int32]  # a `warpvis.scene.solids.SolidKind`
    movable_size: wp.array[wp.vec4]  # of a solid: factors along x, y and z [m], and half length before scaling


@wp.struct
class PacketJob:
    """Images to render, in units of strips. Counters are a `JobCounter` of ``native/shared`` and start at 0.

    If `points` is positive, rays pass through that many points in every view instead of pixel centers; their
    coordinates are x y x y ... [px], and outputs have the shape (views, 1, points).
    """

    views: int
    height: int
    width: int
    strips: int
    max_rows: int
    strip_rows: wp.array[wp.int32]
    focal_x: wp.float64
    focal_y: wp.float64
    center_x: wp.float64
    center_y: wp.float64
    near: float
    far: float
    clip_inv_z: float
    clip_reach: float
    cull_backfaces: int
    points: int
    pixels: wp.array[float]
    counter: wp.array[wp.int32]
    scratch: wp.array2d[wp.uint8]  # per worker; None to measure the bytes that a worker needs
    scratch_bytes: wp.array[wp.int64]


@wp.struct
class PacketCall:
    """The arguments of a launch in one struct, which the caller may modify between launches.

    Packing them as individual arguments takes longer than rendering some images.
    """

    scene: BvhScene
    job: PacketJob
    poses: wp.array[wp.transform]
    worlds: Worlds


HEADERS = (
    "shared/constants.h",
    "shared/images.h",
    "shared/stretch.h",
    "shared/pose.h",
    "shared/edges.h",
    "cpu/plain_rays.h",
    "cpu/lanes.h",
    "cpu/arena.h",
    "cpu/workers.h",
    "cpu/image.h",
    "cpu/ray_tree.h",
    "cpu/bvh.h",
    "cpu/camera.h",
    "cpu/setup.h",
    "cpu/pixels.h",
    "cpu/raster.h",
    "cpu/solids.h",
    "cpu/worlds.h",
    "cpu/output.h",
    "cpu/sparse.h",
    "cpu/ray_leaf.h",
    "cpu/ray_raster.h",
    "cpu/walk.h",
    "cpu/movables.h",
    "cpu/packets.h",
)

SCENE = """
static_assert(sizeof(wp::transform) == POSE_WORDS * sizeof(float) && sizeof(wp::vec4) == SOLID_WORDS * sizeof(float),
              "poses and solids are read as rows of numbers");
const Scene drawn = {
    {scene.leaves.data, scene.owners.data, scene.nodes.data, scene.children.data, scene.static_root,
     scene.all_closed != 0, scene.closed_boxes.data, scene.closed_object.data, scene.closed_count},
    {scene.drawn_count, scene.movable_count, scene.movable_object.data, scene.movable_root.data,
     scene.movable_leaf.data, scene.movable_first_id.data, scene.movable_closed.data, scene.movable_boxes.data,
     scene.movable_solid.data, (const float*)scene.movable_size.data, (const float*)scene.instance_pose.data,
     (const float*)worlds.object_poses.data, (const float*)worlds.object_sizes.data, worlds.object_poses.shape[0],
     worlds.world.data, worlds.excluded.data, worlds.excluded.shape[0], scene.object_count, scene.static_object.data,
     scene.static_object.shape[0]}};
"""
"""C++ that defines the `Scene` of ``kernels/native/cpu`` from a `BvhScene` ``scene`` and `Worlds` ``worlds``."""

CALL = """
const auto& scene = calls.data->scene;
const auto& job = calls.data->job;
const auto& poses = calls.data->poses;
const auto& worlds = calls.data->worlds;
const auto& images = images_out.data[0];
"""
"""C++ that names the members of a call's struct, the first of ``calls``, and its images."""

_CAST = """
const Job shape = {job.views, job.height, job.width, job.strips, job.strip_rows.data, job.max_rows,
                   {job.focal_x, job.focal_y}, {job.center_x, job.center_y}, job.near, job.far,
                   job.clip_inv_z, job.clip_reach, job.cull_backfaces != 0, (const float*)poses.data, job.points,
                   job.pixels.data};
if (!job.scratch.data) {
    Arena measured = Arena::at(nullptr);
    StripMemory::carve(measured, shape, scene.drawn_count, scene.levels);
    job.scratch_bytes.data[0] = measured.used;
    return;
}
const int worker = Workers::enter(job.counter.data);
Arena arena = Arena::at((char*)job.scratch.data + (long long)worker * job.scratch.strides[0]);
const StripMemory memory = StripMemory::carve(arena, shape, scene.drawn_count, scene.levels);
Packets::run(drawn, shape, out, memory, job.counter.data);
"""


@wp.func_native(read_native(*HEADERS) + CALL + SCENE + NATIVE_IMAGES + _CAST)
def cast_units(
    calls: wp.array[PacketCall],
    images_out: wp.array[Images],
): ...


@wp.kernel
def cast_packets(
    # In:
    calls: wp.array[PacketCall],
    # Out:
    images_out: wp.array[Images],
):
    """Write the requested images (None is skipped) of one call; each array contains one element.

    Every worker launches this kernel with the same arguments. The job's shared counters assign worker indices and
    units of work.
    """
    _ = wp.tid()
    cast_units(calls, images_out)
