# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Which objects are traversed as instances, in their own frames, and which are merged to one mesh in the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices
from warpvis.kernels.constants import SOLID_WORDS
from warpvis.scene._object import SceneObject
from warpvis.scene._object_list import Instances, ObjectList
from warpvis.scene._shared_mesh import SharedMesh

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

_Run = tuple[int, int, SceneObject | Instances]


@dataclass(eq=False)
class InstancedMesh:
    """A mesh in its own frame, and the objects that use it."""

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    members: list[range] = field(default_factory=list)
    """Ranges of positions among the objects with their own frames."""
    points: wp.array | None = None
    """The vertices on the device, if they change; the mesh then belongs to one object."""
    owner: NDArray[np.int32] | None = None
    """The triangles' objects, if several objects move together; the mesh then belongs to these."""

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
            boxes[mesh.places] = np.stack([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])
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


def flatten(
    vertices: Sequence[NDArray[np.float32]], faces: Sequence[NDArray[np.int32]], indices: Sequence[int]
) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.int32]]:
    """Concatenate the vertices of objects, given in one frame, and their faces; also return the faces' objects."""
    first = np.cumsum([0] + [len(part) for part in vertices])
    moved = [part + start for part, start in zip(faces, first, strict=False)]
    owner = np.repeat(np.array(indices, dtype=np.int32), [len(part) for part in faces])
    joined = np.concatenate([np.zeros((0, 3), dtype=np.float32), *vertices])
    return joined, np.concatenate([np.zeros((0, 3), dtype=np.int32), *moved]).astype(np.int32), owner


def plan_traversal(objects: Sequence[SceneObject], device: wp.Device) -> TraversalPlan:
    """Group objects by how they are traversed on a device, without creating the objects of instance batches."""
    listed = objects if isinstance(objects, ObjectList) else ObjectList(objects)
    labels = np.zeros(len(listed), dtype=np.uint8)
    movable_runs: list[_Run] = []
    static: list[_Run] = []
    pieces: dict[int, list[int]] = {}
    for run in listed.runs():
        first, count, item = run
        labels[first : first + count] = int(item.label)
        if item.movable if isinstance(item, Instances) else item.pose is not None:
            movable_runs.append(run)
        elif isinstance(item, SceneObject) and item.parent is not None:
            pieces.setdefault(item.parent, [item.parent]).append(first)
        else:
            static.append(run)
    shared = _find_instanced_meshes(static, device)
    instanced = [run for run in static if id(_mesh_of(run[2])) in shared]
    movable, instances = _indices(movable_runs), _indices(instanced)
    kinds, sizes, corners = _solids(movable_runs, len(movable) + len(instances))
    return TraversalPlan(
        labels,
        [index for run in static if id(_mesh_of(run[2])) not in shared for index in range(run[0], run[0] + run[1])],
        movable,
        _poses(movable_runs, len(movable)),
        kinds,
        sizes,
        corners,
        instances,
        _poses(instanced, len(instances)),
        _find_meshes(listed, pieces, movable_runs, instanced),
    )


def instance_indices(objects: ObjectList, device: wp.Device) -> frozenset[int]:
    """Return the static objects that have their own frames on a device."""
    return frozenset(plan_traversal(objects, device).instances.tolist())


def _mesh_of(item: SceneObject | Instances) -> SharedMesh | None:
    """Return the mesh that a static object shares with others."""
    return item.mesh if isinstance(item, Instances) else item.shared_mesh


def _find_instanced_meshes(static: Sequence[_Run], device: wp.Device) -> set[int]:
    """Return the ids of shared meshes whose static objects are traversed faster as instances."""
    uses: dict[int, int] = {}
    triangles = {}
    for _, count, item in static:
        mesh = _mesh_of(item)
        if mesh is not None:
            uses[id(mesh)] = uses.get(id(mesh), 0) + count
            triangles[id(mesh)] = len(mesh.faces)
    min_saved = _MIN_SAVED if device.is_cpu else _MIN_SAVED_CUDA
    return {
        mesh
        for mesh, count in uses.items()
        if count >= _MIN_USES and triangles[mesh] >= _MIN_TRIANGLES and (count - 1) * triangles[mesh] >= min_saved
    }


def _indices(runs: Sequence[_Run]) -> NDArray[np.int32]:
    parts = chain.from_iterable(range(first, first + count) for first, count, _ in runs)
    return np.fromiter(parts, dtype=np.int32)


def _poses(runs: Sequence[_Run], total: int) -> NDArray[np.float32]:
    poses, end = np.zeros((total, 7), dtype=np.float32), 0
    for first, count, item in runs:
        start, end = end, end + count
        poses[start:end] = item.poses(first, count) if isinstance(item, Instances) else item.place
    return poses


def _solids(
    movable_runs: Sequence[_Run], total: int
) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]:
    """Return kinds, sizes and half extents of the solids of objects with their own frames."""
    kinds, sizes = np.zeros(total, dtype=np.int32), np.ones((total, SOLID_WORDS), dtype=np.float32)
    corners, end = np.zeros((total, 3), dtype=np.float32), 0
    for _, count, item in movable_runs:
        start, end = end, end + count
        if item.solid is not None:
            kinds[start:end], sizes[start:end] = item.solid.kind, [*item.solid.radii, item.solid.half]
            corners[start:end] = np.nextafter(item.solid.extent, np.inf, dtype=np.float32)
    return kinds, sizes, corners


def _find_meshes(
    objects: ObjectList, pieces: dict[int, list[int]], movable_runs: Sequence[_Run], instanced: Sequence[_Run]
) -> list[InstancedMesh]:
    """Find the distinct meshes of the objects with their own frames, in order of first use."""
    from warpvis.scene.acceleration.refit import check_values

    meshes: dict[int | tuple[bytes, bytes], InstancedMesh] = {}
    of_arrays: dict[tuple[int, int], InstancedMesh] = {}  # identical arrays need not be compared
    end = 0
    for first, count, item in chain(movable_runs, instanced):
        start, end = end, end + count
        shared = None if isinstance(item, SceneObject) and item.pose is not None else _mesh_of(item)
        if shared is not None:
            vertices, faces = shared.rounded, shared.faces
        else:
            assert isinstance(item, SceneObject) and item.mesh_vertices is not None
            vertices, faces = item.mesh_vertices, item.faces
            if first in pieces:
                parts = [objects[index] for index in pieces[first]]
                flat = flatten([frame_vertices(part) for part in parts], [part.faces for part in parts], pieces[first])
                meshes[first] = InstancedMesh(*flat[:2], [range(start, end)], owner=flat[2])
                continue
            if item.points is not None:
                check_values(vertices, item.name)  # GPU vertices are unchecked so far: builders cannot handle NaN
                meshes[first] = InstancedMesh(vertices, faces, [range(start, end)], item.points)
                continue
        arrays = id(vertices), id(faces)
        if arrays not in of_arrays:
            found = InstancedMesh(vertices, faces)
            of_arrays[arrays] = meshes.setdefault((vertices.tobytes(), faces.tobytes()), found)
        of_arrays[arrays].members.append(range(start, end))
    return list(meshes.values())


def frame_vertices(item: SceneObject) -> NDArray[np.float32]:
    """Return the corners of a movable object in its frame, or of an attached object in its parent's frame."""
    assert item.mesh_vertices is not None
    return item.mesh_vertices
