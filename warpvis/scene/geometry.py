# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What the casters make of a scene's objects: trees of the triangles that stay, and of each mesh that moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import get_device
from warpvis.errors import SceneError
from warpvis.kernels.constants import BOX_WORDS, CPU_LANES, CUDA_LANES, LEAF_ROWS, NODE_ROWS, SOLID_WORDS
from warpvis.scene._joined_trees import first_leaves, first_nodes, join_trees

if TYPE_CHECKING:
    from warpvis.kernels.packets import BvhScene
    from warpvis.kernels.rays import TriangleScene
    from warpvis.scene._bvh import Bvh
    from warpvis.scene._kept_trees import KeptTrees
    from warpvis.scene._object import SceneObject
    from warpvis.scene._refit import BvhRefit


@dataclass(frozen=True)
class Triangles:
    """A scene's triangles on its device, as the ``rays`` caster takes them."""

    struct: TriangleScene
    meshes: list[wp.Mesh]
    """Own the memory and the trees that `struct` refers to: of what stays, if anything does, and of what moves."""
    refits: dict[int, wp.Mesh] = field(default_factory=dict)
    """The meshes of objects that deform, by object: their points are the object's, and they have a `refit`."""

    @property
    def mesh(self) -> wp.Mesh:
        """The first of them."""
        return self.meshes[0]


@dataclass(frozen=True)
class SceneBvh:
    """A scene's triangles in BVHs on its device, as the ``packets`` caster takes them."""

    struct: BvhScene
    depth: int
    """Levels of nodes of the deepest tree."""
    bytes_per_triangle: float
    """Memory of the trees."""
    moves_solids_only: bool = False
    """Whether all movable objects are solids."""
    refits: dict[int, BvhRefit] = field(default_factory=dict)
    """What makes the tree of an object that deforms hold its points, by object."""
    idle: list[object] = field(default_factory=list)
    """Memory that `warpvis.visibility._point_packets` works with when it is called."""


@dataclass
class _Mesh:
    """One mesh of objects that move, and who has it."""

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    movables: list[int] = field(default_factory=list)
    points: wp.array | None = None
    """The vertices on the device, if they change; only one object has the mesh then."""
    owner: NDArray[np.int32] | None = None
    """The triangles' objects, if they are of several that move together; only these have the mesh then."""


def label_array(objects: Sequence[SceneObject], device: wp.Device) -> wp.array:
    """Return the objects' labels, shape ``(objects,)`` uint8."""
    return wp.array([int(item.label) for item in objects], dtype=wp.uint8, device=device)


def build_triangles(objects: Sequence[SceneObject], device: wp.Device) -> Triangles:
    """Build Warp's meshes, with a tree each."""
    from warpvis.kernels.rays import TriangleScene

    static, movable = _part(objects)
    struct = TriangleScene()
    meshes = []
    vertices, faces, owner = _flatten([objects[index].vertices for index in static], objects, static)
    if static:
        meshes.append(_make_mesh(vertices, faces, device))
        struct.mesh = meshes[0].id
    owners, first_face = [owner], np.full(len(movable), -1, dtype=np.int32)
    ids = np.zeros(len(movable), dtype=np.uint64)
    refits = {}
    shared_meshes = _share_meshes(objects, movable)
    for shared in shared_meshes:
        meshes.append(_make_mesh(shared.vertices, shared.faces, device, shared.points))
        ids[shared.movables] = int(meshes[-1].id)
        if shared.points is not None:
            refits[movable[shared.movables[0]]] = meshes[-1]
        if shared.owner is not None:
            first_face[shared.movables] = sum(map(len, owners))
            owners.append(shared.owner)
    struct.triangle_object = wp.array(np.concatenate(owners), dtype=wp.int32, device=device)
    struct.movable_first_face = wp.array(first_face, dtype=wp.int32, device=device)
    struct.movable_mesh = wp.array(ids, dtype=wp.uint64, device=device)
    struct.movable_object = _one_object(movable, shared_meshes, device)
    struct.movable_count = len(movable)
    struct.movable_solid, struct.movable_size = solid_sizes(objects, movable, device)
    struct.object_label = label_array(objects, device)
    return Triangles(struct, meshes, refits)


def build_scene_bvh(
    objects: Sequence[SceneObject], device: wp.Device, *, lanes: int | None = None, kept: KeptTrees | None = None
) -> SceneBvh:
    """Build the BVHs, all in the same arrays.

    Args:
        objects: What is in the scene.
        device: Where the arrays are to be.
        lanes: Triangles of a leaf; as many as the device's caster takes by default.
        kept: Trees of an earlier build, of which those that are still right are taken; they are this one's afterwards.
    """
    from warpvis.kernels.packets import BvhScene
    from warpvis.scene._kept_trees import KeptTrees

    kept = KeptTrees(keep=False) if kept is None else kept
    lanes = lanes or (CPU_LANES if device.is_cpu else CUDA_LANES)
    static, movable = _part(objects)
    shared = _share_meshes(objects, movable)
    trees, closed_of = [], []
    closed = np.zeros(len(objects), dtype=bool)
    if static:
        closed[static] = [kept.closed(objects[i].vertices, objects[i].faces) for i in static]
        vertices = [objects[i].vertices for i in static]
        trees.append(kept.tree(*_flatten(vertices, objects, static), closed, lanes, device))
        closed_of.append(closed)
    boxes = [objects[i].bounds for i in static if closed[i]]
    struct = BvhScene()
    struct.closed_boxes = _floats(boxes, device)
    struct.closed_object = wp.array([i for i in static if closed[i]], dtype=wp.int32, device=device)
    struct.closed_count, struct.all_closed = len(boxes), int(closed[static].all())

    tree_of = np.zeros(len(movable), dtype=np.int64)
    mesh_closed = np.zeros(len(movable), dtype=np.int32)
    for mesh in shared:
        owner, part_closed = _owners(mesh, objects, kept)
        tree_of[mesh.movables], mesh_closed[mesh.movables] = len(trees), part_closed[owner].all()
        trees.append(kept.tree(mesh.vertices, mesh.faces, owner, part_closed, lanes, device))
        closed_of.append(part_closed)
    kept.finish()
    join_trees(struct, trees, closed_of, device, share=not kept.keep)

    slots = np.array([tree.leaf_count * tree.lanes for tree in trees])
    static_slots = int(slots[0]) if static else 0
    ends = static_slots + np.cumsum(slots[tree_of])
    if len(ends) and ends[-1] >= 2**31:
        raise SceneError(f"all objects together must have fewer than 2^31 triangles, got {ends[-1]}, leaves filled up")
    struct.static_root = 0 if static else -1
    struct.static_object = wp.array(static, dtype=wp.int32, device=device)
    struct.movable_count = len(movable)
    struct.movable_object = _one_object(movable, shared, device)
    struct.movable_root = wp.array(first_nodes(trees)[tree_of], dtype=wp.int32, device=device)
    struct.movable_leaf = wp.array(first_leaves(trees)[tree_of], dtype=wp.int32, device=device)
    struct.movable_first_id = wp.array(ends - slots[tree_of], dtype=wp.int32, device=device)
    struct.movable_closed = wp.array(mesh_closed, dtype=wp.int32, device=device)
    struct.movable_solid, struct.movable_size = solid_sizes(objects, movable, device)
    struct.movable_boxes = _floats(_boxes(objects, movable, shared), device)
    struct.object_label = label_array(objects, device)
    struct.object_count = len(objects)
    struct.levels = max(tree.depth for tree in trees)
    size = sum(tree.bytes_per_triangle * tree.triangle_count for tree in trees)
    return SceneBvh(
        struct,
        depth=max(tree.depth for tree in trees),
        bytes_per_triangle=size / sum(tree.triangle_count for tree in trees),
        moves_solids_only=bool(movable) and all(objects[index].solid is not None for index in movable),
        refits=_make_refits(struct, trees, shared, movable),
    )


def _part(objects: Sequence[SceneObject]) -> tuple[list[int], list[int]]:
    """Return indices of the objects that stay, and of those that have a pose in every world."""
    static = [index for index, item in enumerate(objects) if not item.movable]
    return static, [index for index, item in enumerate(objects) if item.pose is not None]


def _pieces(objects: Sequence[SceneObject]) -> dict[int, list[int]]:
    """Group what moves together, by the object that has the pose: itself, and what is attached to it."""
    pieces = {index: [index] for index, item in enumerate(objects) if item.pose is not None}
    for index, item in enumerate(objects):
        if item.carrier is not None:
            pieces[item.carrier].append(index)
    return pieces


def _one_object(movable: Sequence[int], meshes: Sequence[_Mesh], device: wp.Device) -> wp.array:
    """List the objects that have a pose, ``(M,)`` int32; -1 for those of which the triangles know whose they are."""
    objects = np.array(movable, dtype=np.int32)
    for mesh in meshes:
        if mesh.owner is not None:
            objects[mesh.movables] = -1
    return wp.array(objects, dtype=wp.int32, device=device)


def _owners(
    mesh: _Mesh, objects: Sequence[SceneObject], kept: KeptTrees
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Tell whose a moving mesh's triangles are, 0 if it is of one object, and which owners are closed."""
    if mesh.owner is None:
        closed = mesh.points is None and kept.closed(mesh.vertices, mesh.faces)
        return np.zeros(len(mesh.faces), dtype=np.int32), np.array([closed])
    flags = np.zeros(len(objects), dtype=bool)
    for part in np.unique(mesh.owner):
        flags[part] = kept.closed(_mesh_vertices(objects[part]), objects[part].faces)
    return mesh.owner, flags


def _share_meshes(objects: Sequence[SceneObject], movable: Sequence[int]) -> list[_Mesh]:
    """Find the different meshes among movable objects, in the order in which they first come."""
    from warpvis.scene._refit import check_values

    meshes: dict[int | tuple[bytes, bytes], _Mesh] = {}
    of_arrays: dict[tuple[int, int], _Mesh] = {}  # the same arrays need not be compared
    pieces = _pieces(objects)
    for position, index in enumerate(movable):
        item, piece = objects[index], pieces[index]
        if len(piece) > 1:
            flat = _flatten([_mesh_vertices(objects[part]) for part in piece], objects, piece)
            meshes[index] = _Mesh(*flat[:2], [position], owner=flat[2])
            continue
        vertices, faces = _mesh_vertices(item), item.faces
        if item.points is not None:
            check_values(vertices, item.name)  # those of a GPU have not been: building must not meet a NaN
            meshes[index] = _Mesh(vertices, faces, [position], item.points)
            continue
        arrays = id(vertices), id(faces)
        if arrays not in of_arrays:
            of_arrays[arrays] = meshes.setdefault((vertices.tobytes(), faces.tobytes()), _Mesh(vertices, faces))
        of_arrays[arrays].movables.append(position)
    return list(meshes.values())


def solid_sizes(objects: Sequence[SceneObject], movable: Sequence[int], device: wp.Device) -> tuple[wp.array, wp.array]:
    """Return movable objects' kinds of solid, ``(M,)`` int32, and sizes, ``(M,)`` vec4: ones of meshes."""
    kinds, sizes = np.zeros(len(movable), dtype=np.int32), np.ones((len(movable), SOLID_WORDS), dtype=np.float32)
    for position, index in enumerate(movable):
        solid = objects[index].solid
        if solid is not None:
            kinds[position], sizes[position] = solid.kind, [*solid.radii, solid.half]
    return wp.array(kinds, dtype=wp.int32, device=device), wp.array(sizes, dtype=wp.vec4, device=device)


def _make_refits(
    struct: BvhScene, trees: Sequence[Bvh], shared: Sequence[_Mesh], movable: Sequence[int]
) -> dict[int, BvhRefit]:
    """Make what refits the trees of objects that deform, in the arrays of all trees. Those of `shared` come last."""
    from warpvis.scene._refit import BvhRefit

    refits = {}
    first = len(trees) - len(shared)
    places = list(zip(trees, first_nodes(trees), first_leaves(trees), strict=True))[first:]
    for mesh, (tree, node, leaf) in zip(shared, places, strict=True):
        if mesh.points is None:
            continue
        (position,) = mesh.movables
        leaf_size, node_size = LEAF_ROWS * tree.lanes, NODE_ROWS * tree.lanes
        refits[movable[position]] = BvhRefit(
            tree,
            mesh.faces,
            mesh.points,
            struct.leaves[leaf * leaf_size : (leaf + tree.leaf_count) * leaf_size],
            struct.nodes[node * node_size : (node + tree.node_count) * node_size],
            struct.movable_boxes[position * BOX_WORDS : (position + 1) * BOX_WORDS],
        )
    return refits


def _flatten(
    vertices: Sequence[NDArray[np.float32]], objects: Sequence[SceneObject], indices: Sequence[int]
) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.int32]]:
    """Gather all vertices of some objects, given in one frame, all their faces, and the faces' objects."""
    first = np.cumsum([0] + [len(part) for part in vertices])
    faces = [objects[index].faces + start for index, start in zip(indices, first, strict=False)]
    owner = np.repeat(np.array(indices, dtype=np.int32), [len(part) for part in faces])
    joined = np.concatenate([np.zeros((0, 3), dtype=np.float32), *vertices])
    return joined, np.concatenate([np.zeros((0, 3), dtype=np.int32), *faces]).astype(np.int32), owner


def _make_mesh(
    vertices: NDArray[np.float32], faces: NDArray[np.int32], device: wp.Device, points: wp.array | None = None
) -> wp.Mesh:
    return wp.Mesh(
        points=wp.array(vertices, dtype=wp.vec3, device=device) if points is None else points,
        indices=wp.array(faces.ravel(), dtype=wp.int32, device=device),
        # What traces fastest: the surface area heuristic on the CPU, with leaves of 4 by 15 to 20 %; on CUDA the wide
        # tree, by 7 % (5 thousand triangles) to 86 % (1.2 million).
        bvh_constructor="sah" if device.is_cpu else "cubql",
        bvh_leaf_size=4 if device.is_cpu else None,
    )


def _mesh_vertices(item: SceneObject) -> NDArray[np.float32]:
    assert item.mesh_vertices is not None
    return item.mesh_vertices


def _boxes(
    objects: Sequence[SceneObject], movable: Sequence[int], meshes: Sequence[_Mesh]
) -> list[NDArray[np.float32]]:
    """Return the least and greatest corner of every movable: of its triangles, and of a solid that they stand for."""
    boxes = [np.zeros((2, 3), dtype=np.float32)] * len(movable)
    for mesh in meshes:
        box = np.stack([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])
        for position in mesh.movables:
            boxes[position] = box
            solid = objects[movable[position]].solid
            if solid is not None:
                corner = np.nextafter(solid.extent, np.inf, dtype=np.float32)
                boxes[position] = np.stack([np.minimum(box[0], -corner), np.maximum(box[1], corner)])
    return boxes


def _floats(boxes: Sequence[NDArray[np.float32]], device: wp.Device) -> wp.array:
    return wp.array(np.array(boxes, dtype=np.float32).ravel(), dtype=wp.float32, device=get_device(device))
