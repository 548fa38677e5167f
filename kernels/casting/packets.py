# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The ``packets`` caster on CPU cores: views, or strips of them, traverse a BVH with one child per SIMD lane.

The C++ is in ``kernels/native/`` and is compiled by Warp's Clang.
"""

import warp as wp

from warpvis.kernels.casting.images import Images
from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.native_source import include_native
from warpvis.kernels.pinhole import PinholeCamera

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
class WorkerMemory:
    """Counters that the workers of a launch share, a `JobCounter` of ``native/shared`` that starts at 0, and memory."""

    counter: wp.array[wp.int32]
    scratch: wp.array2d[wp.uint8]  # per worker; None to measure the bytes that a worker needs
    scratch_bytes: wp.array[wp.int64]


@wp.struct
class PacketJob:
    """Images to render, in units of strips.

    If `points` is positive, rays pass through that many points in every view instead of pixel centers; their
    coordinates are x y x y ... [px], and outputs have the shape (views, 1, points).
    """

    camera: PinholeCamera
    cull_backfaces: int
    strip_rows: wp.array[wp.int32]  # first row of each strip of a view, and the end of the last one
    max_rows: int
    points: int
    pixels: wp.array[float]


@wp.struct
class PacketCall:
    """The arguments of a launch in one struct, which the caller may modify between launches.

    Packing them as individual arguments takes longer than rendering some images.
    """

    scene: BvhScene
    job: PacketJob
    workers: WorkerMemory
    poses: wp.array[wp.transform]
    worlds: Worlds


@wp.struct
class RemapJob:
    """Images to render, in units of trees over parts of maps.

    A map contains, for each pixel of (rows, columns), the position in the camera's image that it shows, x y x y ...
    [px]. `limits` are the inverse depths beyond which surfaces are not searched for; None if all are.
    """

    camera: PinholeCamera
    cull_backfaces: int
    rows: int
    columns: int
    tree_focal: wp.float64
    pixels: wp.array[float]
    limits: wp.array[float]


@wp.struct
class RemapCall:
    """The arguments of a launch, as in `PacketCall`."""

    scene: BvhScene
    job: RemapJob
    workers: WorkerMemory
    poses: wp.array[wp.transform]
    worlds: Worlds


def make_packet_kernel(header: str, units: str, call_type: type) -> wp.Kernel:
    """Return the kernel that casts packets of calls of a type.

    It is in a separate module, as compilation is slow.

    Args:
        header: The header of ``kernels/native`` with the units of work.
        units: Their C++ type, as in `Launch::run` of ``native/cpu/packets.h``.
        call_type: The struct of a call.
    """

    @wp.func_native(f"warpvis::Launch::cast<warpvis::{units}>(calls.data[0], images_out.data[0]);")
    def cast_units(calls: wp.array[call_type], images_out: wp.array[Images]): ...

    options = include_native(header)

    @wp.kernel(
        module="unique", enable_backward=False, grid_stride=False, module_options={"extra_build_options": options}
    )
    def cast_packets(
        # In:
        calls: wp.array[call_type],
        # Out:
        images_out: wp.array[Images],
    ):
        """Write the requested images (None is skipped) of one call; each array contains one element.

        Every worker launches this kernel with the same arguments. The job's shared counters assign worker indices and
        units of work.
        """
        _ = wp.tid()
        cast_units(calls, images_out)

    return cast_packets


cast_packets = make_packet_kernel("cpu/packets.h", "Strips", PacketCall)
cast_remapped_packets = make_packet_kernel("cpu/remap.h", "Maps", RemapCall)
