# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Trees of a scene: one of all static triangles, one of each movable or shared mesh, and the joined arrays of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import aligned_empty
from warpvis.core.kernel_cache import launch
from warpvis.kernels.constants import BOX_WORDS, CPU_LANES, CUDA_LANES, LEAF_ROWS, NODE_ROWS
from warpvis.scene.acceleration.bvh import Bvh, BvhRefit, check_leaves, check_slots
from warpvis.scene.acceleration.traversal_plan import (
    InstancedMesh,
    TraversalPlan,
    instance_steps,
    join_meshes,
    plan_traversal,
)

if TYPE_CHECKING:
    from warpvis.kernels.casting.packets import BvhScene
    from warpvis.kernels.casting.triangle_scene import TriangleScene
    from warpvis.scene._mesh import Mesh
    from warpvis.scene._object import SceneObject
    from warpvis.scene.acceleration.bvh import Bvh
    from warpvis.scene.acceleration.tree_cache import TreeCache


@dataclass(frozen=True)
class Triangles:
    """A scene's triangles on its device, for the ``rays`` caster."""

    struct: TriangleScene
    meshes: list[wp.Mesh]
    """Own the memory and the trees that `struct` refers to: first the static mesh, if any, then movable ones."""
    refits: dict[int, wp.Mesh] = field(default_factory=dict)
    """Meshes of objects that deform, by object; they share the object's points."""
    instances: wp.array | None = None
    """Owns the memory of the instance steps that `struct` points to."""

    def store_faces(self) -> None:
        """Store the face index in the object's mesh for each triangle."""
        if self.struct.triangle_face is None:
            owner = self.struct.triangle_object
            self.struct.triangle_face = wp.array(own_faces(owner.numpy()), dtype=wp.int32, device=owner.device)


@dataclass(frozen=True)
class SceneBvh:
    """A scene's triangles in BVHs on its device, for the ``packets`` caster."""

    struct: BvhScene
    depth: int
    """Number of node levels of the deepest tree."""
    bytes_per_triangle: float
    """Memory of the trees divided by the number of triangles."""
    has_faces: bool = False
    """Whether the face index in the object's mesh is stored for each triangle."""
    moves_solids_only: bool = False
    """Whether all movable objects are solids."""
    has_solids: bool = False
    """Whether any movable object or instance is a solid."""
    refits: dict[int, BvhRefit] = field(default_factory=dict)
    """Refits of the trees of objects that deform, by object."""
    free_workspaces: list[object] = field(default_factory=list)
    """Scratch memory of `warpvis.visibility._point_packets`, while it is not in use."""


def build_triangles(objects: Sequence[SceneObject], device: wp.Device) -> Triangles:
    """Build Warp's meshes, each with a tree."""
    from warpvis.kernels.casting.triangle_scene import InstanceStep, TriangleScene

    plan = plan_traversal(objects, device)
    count = len(plan.movable) + len(plan.instances)
    struct = TriangleScene()
    meshes = []
    static, owner = join_meshes(objects, plan.static)
    if plan.static:
        meshes.append(make_mesh(static, device))
        struct.mesh = meshes[0].id
    owners, first_face = [owner], np.full(count, -1, dtype=np.int32)
    ids = np.zeros(count, dtype=np.uint64)
    refits = {}
    for shared in plan.meshes:
        places = shared.places
        meshes.append(make_mesh(shared.mesh, device))
        ids[places] = int(meshes[-1].id)
        if shared.mesh.deforms:
            refits[int(plan.movable[places[0]])] = meshes[-1]
        if shared.owner is not None:
            first_face[places] = sum(map(len, owners))
            owners.append(shared.owner)
    struct.triangle_object = wp.array(np.concatenate(owners), dtype=wp.int32, device=device)
    struct.movable_first_face = wp.array(first_face, dtype=wp.int32, device=device)
    struct.movable_mesh = wp.array(ids, dtype=wp.uint64, device=device)
    struct.movable_object = wp.array(plan.one_object(), dtype=wp.int32, device=device)
    struct.movable_count = len(plan.movable)
    struct.movable_solid = wp.array(plan.solid_kinds, dtype=wp.int32, device=device)
    struct.movable_size = wp.array(plan.solid_sizes, dtype=wp.vec4, device=device)
    struct.object_label = wp.array(plan.labels, dtype=wp.uint8, device=device)
    instances = None
    if len(plan.instances):
        instances = wp.array(instance_steps(plan.world_boxes(), plan.instance_poses), dtype=InstanceStep, device=device)
        struct.instances, struct.instance_count = instances.ptr, len(instances)
    return Triangles(struct, meshes, refits, instances)


def build_scene_bvh(
    objects: Sequence[SceneObject],
    device: wp.Device,
    *,
    lanes: int | None = None,
    cache: TreeCache | None = None,
    faces: bool = False,
) -> SceneBvh:
    """Build the BVHs in joined arrays, with `lanes` triangles per leaf; by default the width of the caster.

    Valid trees of `cache` are reused; the trees of this build replace them. `faces` is as for `Scene.bvh`.
    """
    from warpvis.kernels.casting.packets import BvhScene
    from warpvis.scene.acceleration.tree_cache import TreeCache

    cache = TreeCache(keep=False) if cache is None else cache
    lanes = lanes or (CPU_LANES if device.is_cpu else CUDA_LANES)
    plan = plan_traversal(objects, device)
    static = plan.static
    trees, closed_of, owners = [], [], []
    closed = np.zeros(len(objects), dtype=bool)
    if static:
        closed[static] = [cache.closed(objects[index].frame_vertices, objects[index].faces) for index in static]
        mesh, owner = join_meshes(objects, static)
        trees.append(cache.tree(mesh, owner, closed, lanes, device))
        closed_of.append(closed)
        owners.append(owner)
    boxes = [objects[index].bounds for index in static if closed[index]]
    struct = BvhScene()
    struct.closed_boxes = wp.array(np.array(boxes, dtype=np.float32).ravel(), dtype=wp.float32, device=device)
    struct.closed_object = wp.array([i for i in static if closed[i]], dtype=wp.int32, device=device)
    struct.closed_count, struct.all_closed = len(boxes), int(closed[static].all())

    one_object = plan.one_object()
    tree_of = np.zeros(len(one_object), dtype=np.int64)
    mesh_closed = np.zeros(len(one_object), dtype=np.int32)
    for shared in plan.meshes:
        owner, part_closed = _owners(shared, objects, cache)
        places = shared.places
        tree_of[places], mesh_closed[places] = len(trees), part_closed[owner].all()
        trees.append(cache.tree(shared.snapshot, owner, part_closed, lanes, device))
        closed_of.append(part_closed)
        owners.append(owner)
    cache.finish()
    join_trees(struct, trees, closed_of, device, share=not cache.keep)
    if faces:
        struct.slot_face = slot_faces(trees, owners, device)

    slots = np.array([tree.leaf_count * tree.lanes for tree in trees])
    static_slots = int(slots[0]) if static else 0
    ends = static_slots + np.cumsum(slots[tree_of])
    check_slots(max(ends, default=0))
    struct.static_root = 0 if static else -1
    struct.static_object = wp.array(static, dtype=wp.int32, device=device)
    struct.movable_count, struct.drawn_count = len(plan.movable), len(one_object)
    struct.movable_object = wp.array(one_object, dtype=wp.int32, device=device)
    nodes, leaves = first_places(trees)
    struct.movable_root = wp.array(nodes[tree_of], dtype=wp.int32, device=device)
    struct.movable_leaf = wp.array(leaves[tree_of], dtype=wp.int32, device=device)
    struct.movable_first_id = wp.array(ends - slots[tree_of], dtype=wp.int32, device=device)
    struct.movable_closed = wp.array(mesh_closed, dtype=wp.int32, device=device)
    struct.movable_solid = wp.array(plan.solid_kinds, dtype=wp.int32, device=device)
    struct.movable_size = wp.array(plan.solid_sizes, dtype=wp.vec4, device=device)
    struct.movable_boxes = wp.array(plan.boxes().ravel(), dtype=wp.float32, device=device)
    struct.instance_pose = wp.array(plan.instance_poses, dtype=wp.transform, device=device)
    struct.object_label = wp.array(plan.labels, dtype=wp.uint8, device=device)
    struct.object_count = len(objects)
    struct.levels = max(tree.depth for tree in trees)
    size = sum(tree.bytes_per_triangle * tree.triangle_count for tree in trees)
    return SceneBvh(
        struct,
        depth=max(tree.depth for tree in trees),
        bytes_per_triangle=size / sum(tree.triangle_count for tree in trees),
        has_faces=faces,
        moves_solids_only=len(one_object) > 0 and bool(plan.solid_kinds.all()),
        has_solids=bool(plan.solid_kinds.any()),
        refits=_make_refits(struct, trees, plan),
    )


def _owners(
    shared: InstancedMesh, objects: Sequence[SceneObject], cache: TreeCache
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Return the objects of a mesh's triangles, 0 if it belongs to one object, and which owners are closed."""
    if shared.owner is None:
        closed = not shared.mesh.deforms and cache.closed(shared.mesh.rounded, shared.mesh.faces)
        return np.zeros(len(shared.mesh.faces), dtype=np.int32), np.array([closed])
    flags = np.zeros(len(objects), dtype=bool)
    for part in np.unique(shared.owner):
        flags[part] = cache.closed(objects[part].frame_vertices, objects[part].faces)
    return shared.owner, flags


def _make_refits(struct: BvhScene, trees: Sequence[Bvh], plan: TraversalPlan) -> dict[int, BvhRefit]:
    """Create refits of the trees of objects that deform, in the joined arrays; the last trees are `plan.meshes`."""
    refits = {}
    first = len(trees) - len(plan.meshes)
    places = list(zip(trees, *first_places(trees), strict=True))[first:]
    for shared, (tree, node, leaf) in zip(plan.meshes, places, strict=True):
        if not shared.mesh.deforms:
            continue
        (position,) = shared.places.tolist()
        leaf_size, node_size = LEAF_ROWS * tree.lanes, NODE_ROWS * tree.lanes
        refits[int(plan.movable[position])] = BvhRefit(
            tree,
            shared.mesh.faces,
            shared.mesh.source,
            struct.leaves[leaf * leaf_size : (leaf + tree.leaf_count) * leaf_size],
            struct.nodes[node * node_size : (node + tree.node_count) * node_size],
            struct.movable_boxes[position * BOX_WORDS : (position + 1) * BOX_WORDS],
        )
    return refits


def make_mesh(mesh: Mesh, device: wp.Device) -> wp.Mesh:
    """Build Warp's mesh and its tree. Arrays on the device are shared."""
    points, faces = mesh.source, mesh.source_faces
    if not isinstance(points, wp.array):
        points = wp.array(mesh.rounded, dtype=wp.vec3, device=device)
    on_device = isinstance(faces, wp.array)
    return wp.Mesh(
        points=points,
        indices=faces.flatten() if on_device else wp.array(faces.ravel(), dtype=wp.int32, device=device),
        # The fastest to trace: on the CPU the surface area heuristic, with leaves of 4 by 15 to 20 %; on CUDA the wide
        # tree, by 7 % (5 thousand triangles) to 86 % (1.2 million).
        bvh_constructor="sah" if device.is_cpu else "cubql",
        bvh_leaf_size=4 if device.is_cpu else None,
    )


def join_trees(
    struct: BvhScene, trees: Sequence[Bvh], closed: Sequence[NDArray[np.bool_]], device: wp.Device, *, share: bool
) -> None:
    """Concatenate the arrays of all trees, and offset their children: node indices, or complements of leaf indices.

    `closed` owners of each tree are stored as their bitwise complement. With `share`, the arrays of a single tree may
    be used and changed without a copy.
    """
    check_leaves(sum(tree.leaf_count for tree in trees), trees[0].lanes)
    if not all(tree.leaves.device.is_cpu for tree in trees):
        _join_on_device(struct, trees, closed, device, share=share)
        return
    own = [tree.owners.numpy() for tree in trees]
    owners = [np.where(flags[owner], ~owner, owner) for owner, flags in zip(own, closed, strict=True)]
    if len(trees) == 1 and share:
        tree = trees[0]
        np.copyto(tree.owners.numpy(), owners[0])
        struct.leaves, struct.owners = tree.leaves.to(device), tree.owners.to(device)
        struct.nodes, struct.children = tree.nodes.to(device), tree.children.to(device)
        return
    children = []
    for tree, first_node, first_leaf in zip(trees, *first_places(trees), strict=True):
        child = tree.children.numpy()
        children.append(child + np.where(child > 0, first_node, 0) - np.where(child < 0, first_leaf, 0))
    struct.leaves = _join([tree.leaves.numpy() for tree in trees], wp.float32, device)
    struct.nodes = _join([tree.nodes.numpy() for tree in trees], wp.float32, device)
    struct.owners = _join(owners, wp.int32, device)
    struct.children = _join(children, wp.int32, device)


def first_places(trees: Sequence[Bvh]) -> NDArray[np.int64]:
    """Return the indices of each tree's first node and of its first leaf in the joined arrays, shape ``(2, trees)``."""
    counts = np.array([[tree.node_count for tree in trees], [tree.leaf_count for tree in trees]], dtype=np.int64)
    return np.cumsum(counts, axis=1) - counts


def move_children(children: wp.array, node: int, leaf: int) -> None:
    """Offset a tree's children for joined arrays in which its nodes begin at `node` and its leaves at `leaf`."""
    if not children.device.is_cpu:
        from warpvis.kernels.bvh.nodes_cuda import join_children

        launch(join_children, len(children), [node, leaf, children], children.device)
        return
    child = children.numpy()
    child += np.where(child > 0, node, 0).astype(np.int32) - np.where(child < 0, leaf, 0).astype(np.int32)


def concatenate(parts: Sequence[wp.array], device: wp.Device) -> wp.array:
    """Concatenate flat arrays of any device; on the CPU the result is aligned to 64 bytes."""
    count, dtype = sum(map(len, parts)), parts[0].dtype
    joined = aligned_empty((count,), dtype) if device.is_cpu else wp.empty(count, dtype=dtype, device=device)
    first = 0
    for part in parts:
        wp.copy(joined, part, dest_offset=first, count=len(part))
        first += len(part)
    return joined


def _join_on_device(
    struct: BvhScene, trees: Sequence[Bvh], closed: Sequence[NDArray[np.bool_]], device: wp.Device, *, share: bool
) -> None:
    from warpvis.kernels.bvh.nodes_cuda import mark_owners

    for name in ("leaves", "owners", "nodes", "children"):
        parts = [getattr(tree, name) for tree in trees]
        is_usable = len(parts) == 1 and share and parts[0].device == device
        setattr(struct, name, parts[0] if is_usable else concatenate(parts, device))
    node, leaf = 0, 0
    for tree, flags in zip(trees, closed, strict=True):
        lanes = tree.lanes
        owners = struct.owners[leaf * lanes : (leaf + tree.leaf_count) * lanes]
        if flags.any():
            launch(mark_owners, len(owners), [wp.array(flags, dtype=wp.uint8, device=device), owners], device)
        if node:
            children = struct.children[node * lanes : (node + tree.node_count) * lanes]
            move_children(children, node, leaf)
        node, leaf = node + tree.node_count, leaf + tree.leaf_count


def _join(parts: Sequence[np.ndarray], dtype: type, device: wp.Device) -> wp.array:
    """Concatenate the parts; on the CPU the result is aligned to 64 bytes."""
    joined = aligned_empty((sum(len(part) for part in parts),), dtype)
    np.concatenate(parts, out=joined.numpy(), casting="same_kind")
    return joined.to(device)


def own_faces(owner: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return each triangle's face index in its object's mesh; `owner` lists an object's triangles in order."""
    starts = np.flatnonzero(np.diff(owner, prepend=-1))
    counts = np.diff(starts, append=len(owner))
    return (np.arange(len(owner)) - np.repeat(starts, counts)).astype(np.int32)


def slot_faces(trees: Sequence[Bvh], owners: Sequence[NDArray[np.int32]], device: wp.Device) -> wp.array:
    """Return the object's face index for each leaf slot of the trees, one tree after the other; -1 for unused slots.

    `owners` are, for each tree, the object indices of the triangles it was built from.
    """
    parts = []
    for tree, owner in zip(trees, owners, strict=True):
        triangles = tree.triangles.numpy()
        parts.append(np.where(triangles < 0, np.int32(-1), own_faces(owner)[triangles]))
    return wp.array(np.concatenate(parts), dtype=wp.int32, device=device)
