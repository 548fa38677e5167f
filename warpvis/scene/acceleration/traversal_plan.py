# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Which objects are traversed as instances, in their own frames, and which are merged to one mesh in the world."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices
from warpvis.kernels.constants import CPU_LANES, NODE_HIGH_ROW, NODE_LOW_ROW, NODE_ROWS, SOLID_WORDS
from warpvis.scene._mesh import Mesh, check_values
from warpvis.scene._object import ObjectList, Run, SceneObject
from warpvis.scene.acceleration.bvh import Bvh, build_bvh

# Static objects render as fast as one mesh, or faster, while all their triangles fit into caches; and one mesh is built
# quickly. Objects share a tree if there are at least this many of at least this many triangles, and sharing saves this
# many triangles in total.
_MIN_USES = 64
_MIN_TRIANGLES = 64
_MIN_SAVED = 1 << 20
# GPUs have larger caches, and are slower where a packet tests many instances.
_MIN_SAVED_CUDA = 1 << 23

# Padding of an instance's world box, relative to the largest coordinate.
_BOX_SLACK = 4e-6


@dataclass(eq=False)
class InstancedMesh:
    """A mesh in its own frame, and the objects that use it."""

    mesh: Mesh
    members: list[range] = field(default_factory=list)
    """Ranges of positions among the objects with their own frames."""
    owner: NDArray[np.int32] | None = None
    """The triangles' objects, if several objects move together; the mesh then belongs to these."""

    @cached_property
    def snapshot(self) -> Mesh:
        """The mesh on the host; of a deforming one, its shape at the first access."""
        return Mesh(self.mesh.rounded, self.mesh.faces) if self.mesh.deforms else self.mesh

    @property
    def places(self) -> NDArray[np.intp]:
        """All positions."""
        return np.fromiter(chain.from_iterable(self.members), dtype=np.intp)


@dataclass(eq=False)
class TraversalPlan:
    """A scene's objects, grouped by how they are traversed."""

    labels: NDArray[np.uint8]
    """Labels of all objects."""
    static: list[int]
    """Static objects that are merged to one mesh in the world's frame."""
    movable: NDArray[np.int32]
    """Objects that have a pose in every world."""
    movable_poses: NDArray[np.float32]
    """Initial poses of `movable`, object to world, ``x y z qx qy qz qw``, shape ``(M, 7)``."""
    solid_kinds: NDArray[np.int32]
    """Solid kinds of `movable`, followed by zeros for `instances`."""
    solid_sizes: NDArray[np.float32]
    """Solid sizes of the same objects, ones for meshes: rows of `SOLID_WORDS`."""
    solid_corners: NDArray[np.float32]
    """Half extents of the same solids along each axis [m]."""
    instances: NDArray[np.int32]
    """Static objects with their own frames; they follow the movable ones."""
    instance_poses: NDArray[np.float32]
    """Poses of `instances`, object to world."""
    meshes: list[InstancedMesh]
    """The distinct meshes of `movable` and `instances`, in order of first use."""

    def one_object(self) -> NDArray[np.int32]:
        """Return the object of each frame; -1 for meshes of several objects, whose triangles store their owners."""
        objects = np.concatenate([self.movable, self.instances])
        for mesh in self.meshes:
            if mesh.owner is not None:
                objects[mesh.places] = -1
        return objects

    def boxes(self) -> NDArray[np.float32]:
        """Return the minimum and maximum corner of each object with its own frame, shape ``(n, 2, 3)``.

        The boxes enclose the triangles, and also the solid that they approximate.
        """
        boxes = np.zeros((len(self.movable) + len(self.instances), 2, 3), dtype=np.float32)
        for mesh in self.meshes:
            corners = mesh.snapshot.rounded
            boxes[mesh.places] = np.stack([corners.min(axis=0), corners.max(axis=0)])
        solid = np.flatnonzero(self.solid_kinds)
        boxes[solid, 0] = np.minimum(boxes[solid, 0], -self.solid_corners[solid])
        boxes[solid, 1] = np.maximum(boxes[solid, 1], self.solid_corners[solid])
        return boxes

    def world_boxes(self) -> NDArray[np.float32]:
        """Return the instances' boxes in the world, padded for rounding errors, shape ``(n, 2, 3)``."""
        boxes = self.boxes()[len(self.movable) :].astype(np.float64)
        matrices = poses_to_matrices(self.instance_poses.astype(np.float64))
        middle, half = boxes.mean(axis=1), (boxes[:, 1] - boxes[:, 0]) / 2
        centers = np.einsum("nij,nj->ni", matrices[:, :3, :3], middle) + matrices[:, :3, 3]
        reach = np.einsum("nij,nj->ni", np.abs(matrices[:, :3, :3]), half)
        # Ray origins and distances have single precision.
        slack = _BOX_SLACK * (np.abs(centers).max(initial=0) + reach.max(initial=0))
        return np.stack([centers - reach - slack, centers + reach + slack], axis=1).astype(np.float32)


def join_meshes(objects: Sequence[SceneObject], indices: Sequence[int]) -> tuple[Mesh, NDArray[np.int32]]:
    """Concatenate the meshes of objects that are static or move together; also return the objects of the faces."""
    parts = [objects[index] for index in indices]
    vertices = [np.zeros((0, 3), dtype=np.float32), *(part.frame_vertices for part in parts)]
    first = np.cumsum([len(part) for part in vertices])
    faces = [part.faces + start for part, start in zip(parts, first, strict=False)]
    owner = np.repeat(np.array(indices, dtype=np.int32), [len(part.faces) for part in parts])
    joined = np.concatenate([np.zeros((0, 3), dtype=np.int32), *faces]).astype(np.int32)
    return Mesh(np.concatenate(vertices), joined), owner


def plan_traversal(objects: Sequence[SceneObject], device: wp.Device) -> TraversalPlan:
    """Group objects by how they are traversed on a device, without creating the objects of instance batches."""
    listed = objects if isinstance(objects, ObjectList) else ObjectList(objects)
    labels = np.zeros(len(listed), dtype=np.uint8)
    movable_runs: list[Run] = []
    static: list[Run] = []
    pieces: dict[int, list[int]] = {}
    for run in listed.runs():
        first, count, item, _ = run
        labels[first : first + count] = int(item.label)
        if item.pose is not None:
            movable_runs.append(run)
        elif item.parent is not None:
            pieces.setdefault(item.parent, [item.parent]).append(first)
        else:
            static.append(run)
    shared = _find_instanced_meshes(static, device)
    instanced = [run for run in static if run.item.mesh in shared]
    movable, instances = _indices(movable_runs), _indices(instanced)
    kinds, sizes, corners = _solids(movable_runs, len(movable) + len(instances))
    return TraversalPlan(
        labels,
        _indices([run for run in static if run.item.mesh not in shared]).tolist(),
        movable,
        _poses(movable_runs),
        kinds,
        sizes,
        corners,
        instances,
        _poses(instanced),
        _find_meshes(listed, pieces, movable_runs, instanced),
    )


def _find_instanced_meshes(static: Sequence[Run], device: wp.Device) -> set[Mesh]:
    """Return the shared meshes whose static objects are traversed faster as instances."""
    uses: Counter[Mesh] = Counter()
    for _, count, item, _ in static:
        if item.shares_mesh:
            uses[item.mesh] += count
    min_saved = _MIN_SAVED if device.is_cpu else _MIN_SAVED_CUDA
    return {
        mesh
        for mesh, count in uses.items()
        if count >= _MIN_USES and len(mesh.faces) >= _MIN_TRIANGLES and (count - 1) * len(mesh.faces) >= min_saved
    }


def _indices(runs: Sequence[Run]) -> NDArray[np.int32]:
    parts = chain.from_iterable(range(run.first, run.first + run.length) for run in runs)
    return np.fromiter(parts, dtype=np.int32)


def _poses(runs: Sequence[Run]) -> NDArray[np.float32]:
    return np.concatenate([np.zeros((0, 7), dtype=np.float32), *(run.rows.astype(np.float32) for run in runs)])


def _solids(
    movable_runs: Sequence[Run], total: int
) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]:
    """Return kinds, sizes and half extents of the solids of objects with their own frames."""
    kinds, sizes = np.zeros(total, dtype=np.int32), np.ones((total, SOLID_WORDS), dtype=np.float32)
    corners, end = np.zeros((total, 3), dtype=np.float32), 0
    for _, count, item, _ in movable_runs:
        start, end = end, end + count
        if item.solid is not None:
            kinds[start:end], sizes[start:end] = item.solid.kind, [*item.solid.radii, item.solid.half]
            corners[start:end] = np.nextafter(item.solid.extent, np.inf, dtype=np.float32)
    return kinds, sizes, corners


def _find_meshes(
    objects: ObjectList, pieces: dict[int, list[int]], movable_runs: Sequence[Run], instanced: Sequence[Run]
) -> list[InstancedMesh]:
    """Find the distinct meshes of the objects with their own frames, in order of first use."""
    meshes: dict[int | tuple[bytes, bytes], InstancedMesh] = {}
    of_arrays: dict[tuple[int, int], InstancedMesh] = {}  # identical arrays need not be compared
    end = 0
    for first, count, item, _ in chain(movable_runs, instanced):
        start, end = end, end + count
        found = InstancedMesh(item.mesh)
        if first in pieces:
            mesh, owner = join_meshes(objects, pieces[first])
            found = meshes[first] = InstancedMesh(mesh, owner=owner)
        elif item.mesh.deforms:
            # GPU vertices are unchecked so far: builders cannot handle NaN.
            check_values(found.snapshot.rounded, item.name)
            meshes[first] = found
        else:
            vertices, faces = item.mesh.rounded, item.faces
            arrays = id(vertices), id(faces)
            if arrays not in of_arrays:
                of_arrays[arrays] = meshes.setdefault((vertices.tobytes(), faces.tobytes()), found)
            found = of_arrays[arrays]
        found.members.append(range(start, end))
    return list(meshes.values())


def instance_steps(boxes: NDArray[np.float32], poses: NDArray[np.float32]) -> np.ndarray:
    """Build a tree of boxes in the world for stackless traversal: `InstanceStep` of the kernels, in depth-first order.

    If the box of a step is missed, traversal skips to `after`, past its whole subtree; else it goes on with the next
    step (Smits 1998, "Efficiency issues for ray tracing"). Shapes of the arguments: ``(n, 2, 3)`` [m], ``(n, 7)``.
    """
    from warpvis.kernels.casting.triangle_scene import InstanceStep

    corners = np.arange(2 * len(boxes), dtype=np.int32).reshape(-1, 2)
    tree = build_bvh(  # each triangle is a diagonal of a box
        boxes.reshape(-1, 3),
        corners[:, [0, 1, 0]],
        np.zeros(len(boxes), dtype=np.int32),
        np.zeros(1, dtype=bool),
        lanes=CPU_LANES,
    )
    source, after = _walk(tree, len(boxes))
    nodes = tree.nodes.numpy().reshape(-1, NODE_ROWS, tree.lanes)
    sides = [nodes[:, row : row + 3].transpose(0, 2, 1).reshape(-1, 3) for row in (NODE_LOW_ROW, NODE_HIGH_ROW)]
    every_box = np.concatenate([boxes, np.stack(sides, axis=1)])
    struct: Any = InstanceStep
    steps: np.ndarray = np.zeros(len(source), dtype=struct.numpy_dtype())
    steps["low"], steps["high"] = every_box[source, 0], every_box[source, 1]
    steps["after"], steps["instance"] = after, np.where(source < len(boxes), source, -1)
    steps["pose"][: len(poses)] = poses
    return steps


def _walk(tree: Bvh, count: int) -> tuple[NDArray[np.intp], NDArray[np.int32]]:
    """Return each step's box, an instance below `count` or `count` plus a child slot, and each step's `after`."""
    children = tree.children.numpy().reshape(-1, tree.lanes)
    leaves = [leaf[leaf >= 0].tolist() for leaf in tree.triangles.numpy().reshape(-1, tree.lanes)]
    source: list[int] = []
    after: list[int] = []

    def visit(node: int) -> None:
        for lane, child in enumerate(children[node].tolist()):
            if child == 0:
                continue
            step = len(source)
            source.append(count + node * tree.lanes + lane)
            after.append(0)
            if child > 0:
                visit(child)
            else:
                source.extend(leaves[~child])
                after.extend(range(step + 2, len(source) + 1))
            after[step] = len(source)

    visit(0)
    return np.array(source, dtype=np.intp), np.array(after, dtype=np.int32)
