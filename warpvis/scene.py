# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes: named, labelled triangle meshes, and what the casters make of them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from threading import Lock
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.arrays import get_device
from warpvis.errors import SceneError
from warpvis.labels import Label
from warpvis.pose import check_up, poses_to_matrices, poses_to_opencv

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True)
class SceneObject:
    """One object of a scene: a mesh in the world frame, a name and a label."""

    name: str
    label: Label
    vertices: NDArray[np.float32] = field(repr=False)
    """Corners in the world frame [m], shape ``(n, 3)``."""
    faces: NDArray[np.int32] = field(repr=False)
    """Corner indices of the triangles, shape ``(m, 3)``."""

    @property
    def bounds(self) -> NDArray[np.float32]:
        """Least and greatest corner of the axis-aligned box [m], shape ``(2, 3)``."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])


@dataclass(frozen=True)
class Triangles:
    """A scene's triangles on its device, as the ``rays`` caster takes them."""

    struct: Any
    """A `warpvis.kernels.rays.TriangleScene`."""
    mesh: wp.Mesh
    """Owns the memory and the tree that `struct` refers to."""


@dataclass(frozen=True)
class Clusters:
    """A scene's triangles in a cluster tree on its device, as the ``packets`` caster takes them."""

    struct: Any
    """A `warpvis.kernels.packets.ClusterScene`."""
    depth: int
    """Levels of nodes."""
    bytes_per_triangle: float
    """Memory of the tree."""


class Scene:
    """Triangle meshes in the world frame, right-handed, in metres.

    Example:
        >>> scene = Scene()
        >>> scene.add(trimesh.creation.icosphere(radius=0.1), name="ball", label="object", pose=(1, 0, 0.1, 0, 0, 0, 1))
        0
    """

    def __init__(self, *, device: Any = "cpu", up: Literal["z", "y"] = "z") -> None:
        """Make an empty scene.

        Args:
            device: Where it is rendered: ``"cpu"``, ``"cuda:0"``, ...
            up: The world's vertical axis.
        """
        check_up(up)
        self.device: wp.Device = get_device(device)
        self.up: Literal["z", "y"] = up
        self._objects: list[SceneObject] = []
        self._index: dict[str, int] = {}
        self._triangles: Triangles | None = None
        self._clusters: Clusters | None = None
        self._lock = Lock()

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        *,
        device: Any = "cpu",
        up: Literal["z", "y"] = "z",
        file_up: Literal["z", "y"] | None = None,
        scale: float = 1.0,
        labels: Mapping[str, Label | int | str] | None = None,
    ) -> Scene:
        """Read a mesh file: OBJ, STL, PLY, GLB, and what else trimesh reads.

        Every named part of the file becomes one object. Its label is, first, what `labels` says; second, what the
        file says (``"label"`` in a glTF node's or mesh's ``extras``); else `Label.OBSTACLE`.

        Args:
            path: The file.
            device: Where the scene is rendered.
            up: The scene's vertical axis.
            file_up: The file's vertical axis. By default ``"y"`` for glTF, as its specification says, and the scene's
                own for every other format; where the two differ, the geometry is turned upright.
            scale: Factor from the file's unit to metres (0.001 for millimetres).
            labels: Labels by name; a name may be a pattern (``"wall_*"``), and the last one that fits counts.

        Raises:
            FileFormatError: The file is missing or does not parse.
            SceneError: It holds no triangles, or a label's pattern fits nothing.
        """
        from warpvis.io.mesh_files import load_scene

        return load_scene(cls(device=device, up=up), path, file_up=file_up, scale=scale, labels=labels or {})

    def add(
        self,
        mesh: Any,
        *,
        name: str | None = None,
        label: Label | int | str = Label.OBSTACLE,
        pose: ArrayLike | None = None,
        scale: float | ArrayLike = 1.0,
    ) -> int:
        """Add an object.

        Args:
            mesh: A `trimesh.Trimesh`, anything else with `vertices` and `faces`, or the pair ``(vertices, faces)``:
                vertices [m] of shape ``(n, 3)``, corner indices of shape ``(m, 3)``.
            name: A name that no other object has; ``object_0``, ``object_1``, ... by default.
            label: What its pixels are labelled.
            pose: Object to world, ``x y z qx qy qz qw`` or a 4x4 matrix; identity by default.
            scale: Factor of size, or three of them along the mesh's axes, applied before the pose.

        Returns:
            The object's index, the value of its pixels in the object image.

        Raises:
            SceneError: The mesh is empty or malformed, or the name is taken.
            PoseError: The pose is not a pose.
        """
        index = len(self._objects)
        name = f"object_{index}" if name is None else str(name)
        if name in self._index:
            raise SceneError(f"the scene already has an object named {name!r}; give another name")
        vertices, faces = _check_mesh(mesh, name)
        vertices = vertices * _check_scale(scale, name)
        if pose is not None:
            matrix = poses_to_matrices(poses_to_opencv(pose, name=f"pose of {name!r}"))
            if len(matrix) != 1:
                raise SceneError(f"pose of {name!r} must be one pose, got {len(matrix)}")
            vertices = vertices @ matrix[0, :3, :3].T + matrix[0, :3, 3]
        if np.abs(vertices).max() > 1e18:  # their squares must stay finite in single precision
            raise SceneError(f"vertices of {name!r} must lie within 1e18 m of the origin")
        self._objects.append(SceneObject(name, Label.parse(label), vertices.astype(np.float32), faces))
        self._index[name] = index
        self._forget()
        return index

    @property
    def objects(self) -> tuple[SceneObject, ...]:
        """The objects; an object image's values index this."""
        return tuple(self._objects)

    @property
    def triangle_count(self) -> int:
        """Triangles of all objects together."""
        return sum(len(item.faces) for item in self._objects)

    @property
    def bounds(self) -> NDArray[np.float32]:
        """Least and greatest corner of the scene's axis-aligned box [m], shape ``(2, 3)``."""
        boxes = np.stack([item.bounds for item in self.require_objects()])
        return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])

    def index(self, name: str) -> int:
        """Index of the object of that name.

        Raises:
            SceneError: There is none.
        """
        if name not in self._index:
            raise SceneError(f"the scene has no object {name!r}; it has {', '.join(map(repr, self._index)) or 'none'}")
        return self._index[name]

    def __getitem__(self, name: str) -> SceneObject:
        return self._objects[self.index(name)]

    def __iter__(self) -> Iterator[SceneObject]:
        return iter(self.objects)

    def __len__(self) -> int:
        return len(self._objects)

    def __contains__(self, name: object) -> bool:
        return name in self._index

    def __repr__(self) -> str:
        return f"Scene({len(self)} objects, {self.triangle_count} triangles, device={str(self.device)!r})"

    def to(self, device: Any) -> Scene:
        """The same scene for another device."""
        scene = Scene(device=device, up=self.up)
        scene._objects, scene._index = list(self._objects), dict(self._index)
        return scene

    def to_trimesh(self) -> trimesh.Scene:
        """The objects as a `trimesh.Scene` in the same frame, with names kept and labels in the meshes' metadata."""
        import trimesh

        scene = trimesh.Scene()
        for item in self._objects:
            mesh = trimesh.Trimesh(item.vertices, item.faces, process=False, metadata={"label": item.label.name})
            scene.add_geometry(mesh, node_name=item.name, geom_name=item.name)
        return scene

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write the scene as glTF (``.glb``), y up as its specification says; `load` reads it back with its labels.

        Raises:
            FileFormatError: The path does not end in ``.glb``, or cannot be written.
        """
        from warpvis.io.mesh_files import export_scene

        self.require_objects()
        export_scene(self, path)

    def triangles(self) -> Triangles:
        """The triangles and Warp's tree of them, built when first asked for after a change.

        Raises:
            SceneError: The scene is empty.
        """
        with self._lock:
            if self._triangles is None:
                self._triangles = _build_triangles(self.require_objects(), self.device)
            return self._triangles

    def clusters(self) -> Clusters:
        """The cluster tree, built when first asked for after a change.

        Raises:
            SceneError: The scene is empty.
        """
        with self._lock:
            if self._clusters is None:
                self._clusters = _build_clusters(self.require_objects(), self.device)
            return self._clusters

    def object_labels(self) -> wp.array:
        """Labels of the objects on the scene's device, shape ``(objects,)`` uint8."""
        return _label_array(self.require_objects(), self.device)

    def _forget(self) -> None:
        self._triangles = self._clusters = None

    def require_objects(self) -> list[SceneObject]:
        """The objects; a `SceneError` if there are none."""
        if not self._objects:
            raise SceneError("the scene has no objects; add() one first")
        return self._objects


def _check_mesh(mesh: Any, name: str) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    if isinstance(mesh, tuple | list) and len(mesh) == 2:
        vertices, faces = mesh
    elif hasattr(mesh, "vertices") and hasattr(mesh, "faces"):
        vertices, faces = mesh.vertices, mesh.faces
    else:
        raise SceneError(
            f"mesh of {name!r} must be a trimesh.Trimesh or a pair (vertices, faces), got {type(mesh).__name__}"
        )
    try:
        vertices, faces = np.asarray(vertices, dtype=np.float64), np.asarray(faces)
    except (TypeError, ValueError) as error:
        raise SceneError(f"mesh of {name!r} must hold arrays of numbers: {error}") from None
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise SceneError(f"vertices of {name!r} must have shape (n, 3), got {vertices.shape}")
    if faces.size == 0:
        raise SceneError(f"mesh of {name!r} must have triangles, got none")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise SceneError(f"faces of {name!r} must be integers of shape (m, 3), got {faces.dtype} {faces.shape}")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise SceneError(f"vertices of {name!r} must be finite: {len(bad)} are not, the first at {bad[0]}")
    low, high = faces.min(), faces.max()
    if low < 0 or high >= len(vertices):
        raise SceneError(f"faces of {name!r} must index its {len(vertices)} vertices, got indices from {low} to {high}")
    return vertices, faces.astype(np.int32)


def _check_scale(scale: float | ArrayLike, name: str) -> NDArray[np.float64]:
    factors = np.asarray(scale, dtype=np.float64)
    if factors.shape not in ((), (3,)) or not (np.isfinite(factors).all() and (factors > 0).all()):
        raise SceneError(f"scale of {name!r} must be one or three positive numbers, got {scale!r}")
    return factors


def _flatten(objects: list[SceneObject]) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.int32]]:
    """All vertices, all faces, and the faces' objects."""
    first = np.cumsum([0] + [len(item.vertices) for item in objects])
    vertices = np.concatenate([item.vertices for item in objects])
    faces = np.concatenate([item.faces + start for item, start in zip(objects, first, strict=False)])
    owner = np.repeat(np.arange(len(objects), dtype=np.int32), [len(item.faces) for item in objects])
    return vertices, faces.astype(np.int32), owner


def _label_array(objects: list[SceneObject], device: wp.Device) -> wp.array:
    return wp.array([int(item.label) for item in objects], dtype=wp.uint8, device=device)


def _build_triangles(objects: list[SceneObject], device: wp.Device) -> Triangles:
    from warpvis.kernels.rays import TriangleScene

    vertices, faces, owner = _flatten(objects)
    mesh = wp.Mesh(
        points=wp.array(vertices, dtype=wp.vec3, device=device),
        indices=wp.array(faces.ravel(), dtype=wp.int32, device=device),
        # The surface area heuristic traces fastest on both devices; leaves of 4 are 15 to 20 % faster on the CPU.
        bvh_constructor="sah",
        bvh_leaf_size=4 if device.is_cpu else None,
    )
    struct = TriangleScene()
    struct.mesh = mesh.id
    struct.triangle_object = wp.array(owner, dtype=wp.int32, device=device)
    struct.object_label = _label_array(objects, device)
    return Triangles(struct, mesh)


def _build_clusters(objects: list[SceneObject], device: wp.Device) -> Clusters:
    from warpvis.closed import provably_closed
    from warpvis.cluster_tree import build_cluster_tree
    from warpvis.kernels import packets_cuda
    from warpvis.kernels.packets import ClusterScene

    vertices, faces, owner = _flatten(objects)
    closed = np.array([provably_closed(item.vertices, item.faces) for item in objects])
    if device.is_cpu:
        tree = build_cluster_tree(vertices, faces, owner, closed)
    else:
        tree = build_cluster_tree(vertices, faces, owner, closed, lanes=32, most_levels=packets_cuda.LEVELS)
    # The casters read an object's complement where its back faces can be left out.
    owners = tree.owners.numpy()
    np.bitwise_not(owners, out=owners, where=closed[owners])
    boxes = np.array([item.bounds for item, skip in zip(objects, closed, strict=True) if skip], dtype=np.float32)
    struct = ClusterScene()
    struct.leaves, struct.owners = tree.leaves.to(device), tree.owners.to(device)
    struct.nodes, struct.children = tree.nodes.to(device), tree.children.to(device)
    struct.object_label = _label_array(objects, device)
    struct.closed_boxes = wp.array(boxes.ravel(), dtype=wp.float32, device=device)
    struct.closed_count, struct.all_closed = len(boxes), int(closed.all())
    return Clusters(struct, tree.depth, tree.bytes_per_triangle)
