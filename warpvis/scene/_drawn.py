# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Which objects are drawn in frames of their own, each by the tree of its mesh, and which as one mesh in the world."""

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

# Objects that stay are as fast as one mesh, or faster, while the triangles of all of them fit into caches; and one mesh
# is quickly built. From so many objects of so many triangles on, which one tree saves so many, they share it.
_MIN_USES = 64
_MIN_TRIANGLES = 64
_MIN_SAVED = 1 << 20
# A GPU has room for more, and is slower where each packet asks for many objects.
_MIN_SAVED_CUDA = 1 << 23

# Of the largest coordinate: how much wider an instance's box in the world is.
_BOX_SLACK = 4e-6

_Run = tuple[int, int, SceneObject | Instances]


@dataclass(eq=False)
class DrawnMesh:
    """A mesh in a frame of its own, and who has it."""

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    members: list[range] = field(default_factory=list)
    """Positions among what has frames of its own, in parts."""
    points: wp.array | None = None
    """The vertices on the device, if they change; only one object has the mesh then."""
    owner: NDArray[np.int32] | None = None
    """The triangles' objects, if they are of several that move together; only these have the mesh then."""

    @property
    def places(self) -> NDArray[np.intp]:
        """All positions."""
        return np.fromiter(chain.from_iterable(self.members), dtype=np.intp)


@dataclass(eq=False)
class Drawn:
    """A scene's objects by how they are drawn."""

    labels: NDArray[np.uint8]
    """Of all objects."""
    static: list[int]
    """Objects that stay and are of one mesh, in the world's frame."""
    movable: NDArray[np.int32]
    """Objects that have a pose in every world."""
    movable_poses: NDArray[np.float32]
    """Theirs as they were added, object to world, ``x y z qx qy qz qw``, shape ``(M, 7)``."""
    solid_kinds: NDArray[np.int32]
    """Theirs, and zeros of instances."""
    solid_sizes: NDArray[np.float32]
    """Theirs, ones of meshes: rows of `SOLID_WORDS`."""
    solid_corners: NDArray[np.float32]
    """Theirs: how far they reach along each axis [m]."""
    instances: NDArray[np.int32]
    """Objects that stay and have frames of their own: they come behind those that are movable."""
    instance_poses: NDArray[np.float32]
    """Theirs, object to world."""
    meshes: list[DrawnMesh]
    """The different meshes of both, in the order in which they first come."""

    def one_object(self) -> NDArray[np.int32]:
        """List all that have frames of their own; -1 for those of which the triangles know whose they are."""
        objects = np.concatenate([self.movable, self.instances])
        for mesh in self.meshes:
            if mesh.owner is not None:
                objects[mesh.places] = -1
        return objects

    def boxes(self) -> NDArray[np.float32]:
        """Return the least and greatest corner of each that has a frame of its own, shape ``(n, 2, 3)``.

        They are of its triangles, and of a solid that they stand for.
        """
        boxes = np.zeros((len(self.movable) + len(self.instances), 2, 3), dtype=np.float32)
        for mesh in self.meshes:
            boxes[mesh.places] = np.stack([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])
        solid = np.flatnonzero(self.solid_kinds)
        boxes[solid, 0] = np.minimum(boxes[solid, 0], -self.solid_corners[solid])
        boxes[solid, 1] = np.maximum(boxes[solid, 1], self.solid_corners[solid])
        return boxes

    def world_boxes(self) -> NDArray[np.float32]:
        """Return the instances' boxes in the world, a little wider than rounding can be wrong, shape ``(n, 2, 3)``."""
        boxes = self.boxes()[len(self.movable) :].astype(np.float64)
        matrices = poses_to_matrices(self.instance_poses.astype(np.float64))
        middle, half = boxes.mean(axis=1), (boxes[:, 1] - boxes[:, 0]) / 2
        turned = np.einsum("nij,nj->ni", matrices[:, :3, :3], middle) + matrices[:, :3, 3]
        reach = np.einsum("nij,nj->ni", np.abs(matrices[:, :3, :3]), half)
        # Rays begin where they do in single precision, and go on so far.
        slack = _BOX_SLACK * (np.abs(turned).max(initial=0) + reach.max(initial=0))
        return np.stack([turned - reach - slack, turned + reach + slack], axis=1).astype(np.float32)


def flatten(
    vertices: Sequence[NDArray[np.float32]], faces: Sequence[NDArray[np.int32]], indices: Sequence[int]
) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.int32]]:
    """Gather all vertices of some objects, given in one frame, all their faces, and the faces' objects."""
    first = np.cumsum([0] + [len(part) for part in vertices])
    moved = [part + start for part, start in zip(faces, first, strict=False)]
    owner = np.repeat(np.array(indices, dtype=np.int32), [len(part) for part in faces])
    joined = np.concatenate([np.zeros((0, 3), dtype=np.float32), *vertices])
    return joined, np.concatenate([np.zeros((0, 3), dtype=np.int32), *moved]).astype(np.int32), owner


def draw_plan(objects: Sequence[SceneObject], device: wp.Device) -> Drawn:
    """Sort objects by how they are drawn on a device; none of those that were added together is made for it."""
    listed = objects if isinstance(objects, ObjectList) else ObjectList(objects)
    labels = np.zeros(len(listed), dtype=np.uint8)
    moving: list[_Run] = []
    staying: list[_Run] = []
    pieces: dict[int, list[int]] = {}
    for run in listed.runs():
        first, count, item = run
        labels[first : first + count] = int(item.label)
        if item.movable if isinstance(item, Instances) else item.pose is not None:
            moving.append(run)
        elif isinstance(item, SceneObject) and item.carrier is not None:
            pieces.setdefault(item.carrier, [item.carrier]).append(first)
        else:
            staying.append(run)
    shared = _meshes_that_pay(staying, device)
    alike = [run for run in staying if id(_mesh_of(run[2])) in shared]
    movable, instances = _indices(moving), _indices(alike)
    kinds, sizes, corners = _solids(moving, len(movable) + len(instances))
    return Drawn(
        labels,
        [index for run in staying if id(_mesh_of(run[2])) not in shared for index in range(run[0], run[0] + run[1])],
        movable,
        _poses(moving, len(movable)),
        kinds,
        sizes,
        corners,
        instances,
        _poses(alike, len(instances)),
        _find_meshes(listed, pieces, moving, alike),
    )


def instance_indices(objects: ObjectList, device: wp.Device) -> frozenset[int]:
    """Return which objects stay and have frames of their own on a device."""
    return frozenset(draw_plan(objects, device).instances.tolist())


def _mesh_of(item: SceneObject | Instances) -> SharedMesh | None:
    """Return the mesh that what stays shares with others."""
    return item.mesh if isinstance(item, Instances) else item.shared_mesh


def _meshes_that_pay(staying: Sequence[_Run], device: wp.Device) -> set[int]:
    """Find meshes of which objects that stay are better drawn in frames of their own, by their ids."""
    uses: dict[int, int] = {}
    triangles = {}
    for _, count, item in staying:
        mesh = _mesh_of(item)
        if mesh is not None:
            uses[id(mesh)] = uses.get(id(mesh), 0) + count
            triangles[id(mesh)] = len(mesh.faces)
    least = _MIN_SAVED if device.is_cpu else _MIN_SAVED_CUDA
    return {
        mesh
        for mesh, count in uses.items()
        if count >= _MIN_USES and triangles[mesh] >= _MIN_TRIANGLES and (count - 1) * triangles[mesh] >= least
    }


def _indices(runs: Sequence[_Run]) -> NDArray[np.int32]:
    parts = chain.from_iterable(range(first, first + count) for first, count, _ in runs)
    return np.fromiter(parts, dtype=np.int32)


def _poses(runs: Sequence[_Run], total: int) -> NDArray[np.float32]:
    poses, end = np.zeros((total, 7), dtype=np.float32), 0
    for first, count, item in runs:
        at, end = end, end + count
        poses[at:end] = item.poses(first, count) if isinstance(item, Instances) else item.place
    return poses


def _solids(moving: Sequence[_Run], total: int) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]:
    """Return kinds, sizes and reach of what has a frame of its own."""
    kinds, sizes = np.zeros(total, dtype=np.int32), np.ones((total, SOLID_WORDS), dtype=np.float32)
    corners, end = np.zeros((total, 3), dtype=np.float32), 0
    for _, count, item in moving:
        at, end = end, end + count
        if item.solid is not None:
            kinds[at:end], sizes[at:end] = item.solid.kind, [*item.solid.radii, item.solid.half]
            corners[at:end] = np.nextafter(item.solid.extent, np.inf, dtype=np.float32)
    return kinds, sizes, corners


def _find_meshes(
    objects: ObjectList, pieces: dict[int, list[int]], moving: Sequence[_Run], alike: Sequence[_Run]
) -> list[DrawnMesh]:
    """Find the different meshes among what has frames of its own, in the order in which they first come."""
    from warpvis.scene._refit import check_values

    meshes: dict[int | tuple[bytes, bytes], DrawnMesh] = {}
    of_arrays: dict[tuple[int, int], DrawnMesh] = {}  # the same arrays need not be compared
    end = 0
    for first, count, item in chain(moving, alike):
        at, end = end, end + count
        shared = None if isinstance(item, SceneObject) and item.pose is not None else _mesh_of(item)
        if shared is not None:
            vertices, faces = shared.rounded, shared.faces
        else:
            assert isinstance(item, SceneObject) and item.mesh_vertices is not None
            vertices, faces = item.mesh_vertices, item.faces
            if first in pieces:
                parts = [objects[index] for index in pieces[first]]
                flat = flatten([frame_vertices(part) for part in parts], [part.faces for part in parts], pieces[first])
                meshes[first] = DrawnMesh(*flat[:2], [range(at, end)], owner=flat[2])
                continue
            if item.points is not None:
                check_values(vertices, item.name)  # those of a GPU have not been: building must not meet a NaN
                meshes[first] = DrawnMesh(vertices, faces, [range(at, end)], item.points)
                continue
        arrays = id(vertices), id(faces)
        if arrays not in of_arrays:
            found = DrawnMesh(vertices, faces)
            of_arrays[arrays] = meshes.setdefault((vertices.tobytes(), faces.tobytes()), found)
        of_arrays[arrays].members.append(range(at, end))
    return list(meshes.values())


def frame_vertices(item: SceneObject) -> NDArray[np.float32]:
    """Return the corners of a movable object in its frame, or in that of the one that it is attached to."""
    assert item.mesh_vertices is not None
    return item.mesh_vertices
