# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Replacement of an object's mesh, for `Scene.update_mesh`."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import FARTHEST, as_warp, on_gpu
from warpvis.core.kernel_cache import launch
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError, SceneError
from warpvis.kernels.constants import CPU_LANES, CUDA_LANES
from warpvis.scene._object import SceneObject, check_mesh
from warpvis.scene._shared_mesh import placed_at
from warpvis.scene.acceleration.bvh import Bvh
from warpvis.scene.acceleration.bvh_cuda import DeviceMesh, build_device_bvh
from warpvis.scene.acceleration.tree_cache import build_tree


class MeshOnDevice(SceneObject):
    """A movable object whose mesh is on the scene's GPU; it is copied to the host on access."""

    def __init__(self, item: SceneObject, mesh: DeviceMesh) -> None:
        """Create a copy of `item` with another mesh."""
        for name in ("name", "label", "pose"):
            object.__setattr__(self, name, getattr(item, name))
        object.__setattr__(self, "mesh", mesh)
        object.__setattr__(
            self, "lazy_appearance", None if item.lazy_appearance is None else item.lazy_appearance.for_any_mesh()
        )

    def __getattr__(self, name: str) -> NDArray[np.float32]:
        """Copy the attribute to the host, and cache it."""
        if name == "_host_vertices":
            found = self.__dict__["mesh"].vertices.numpy()
        elif name == "faces":
            found = self.__dict__["mesh"].faces.numpy()
        elif name == "vertices":
            assert self.pose is not None
            found = placed_at(self.mesh_vertices, self.pose).astype(np.float32)
        else:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        object.__setattr__(self, name, found)
        return found

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as an object on the host."""
        return SceneObject.placed, (
            self.name,
            self.label,
            (self.mesh_vertices, self.faces),
            self.pose,
            None,
            self.lazy_appearance,
        )

    @property
    def triangle_count(self) -> int:
        """Number of triangles of the mesh."""
        return len(self.__dict__["mesh"].faces)

    @property
    def mesh_vertices(self) -> NDArray[np.float32]:
        """The corners in the object's frame."""
        return self._host_vertices


def with_mesh(item: SceneObject, vertices: ArrayInput, faces: ArrayInput | None, device: wp.Device) -> SceneObject:
    """Return the object with another mesh, in its own frame if it is movable, else in the world's.

    Args:
        item: The object; neither attached to another one nor the parent of others.
        vertices: Corners [m], shape ``(n, 3)``.
        faces: Corner indices of the triangles, shape ``(m, 3)``; None for the object's present faces.
        device: The scene's device.

    Raises:
        SceneError: If the mesh is empty or malformed.
    """
    name = item.name
    new_faces = item.faces if faces is None else faces
    if item.pose is not None and on_gpu(vertices) and on_gpu(new_faces):
        return MeshOnDevice(item, _on_device(vertices, new_faces, name, device))
    corners, triangles = check_mesh((_host(vertices, "vertices", name), _host(new_faces, "faces", name)), name)
    if np.abs(corners).max() > FARTHEST:
        raise SceneError(_too_far(item))
    rounded = np.ascontiguousarray(corners, dtype=np.float32)
    lazy_appearance = item.lazy_appearance
    if lazy_appearance is not None and (
        len(rounded) != len(item.vertices) or not np.array_equal(triangles, item.faces)
    ):
        lazy_appearance = lazy_appearance.for_any_mesh()
    if item.pose is None:
        return SceneObject(name, item.label, rounded, triangles, lazy_appearance=lazy_appearance)
    return SceneObject.placed(name, item.label, (rounded, triangles), item.pose, lazy_appearance=lazy_appearance)


def build_mesh_tree(item: SceneObject, closed: bool, device: wp.Device) -> Bvh:
    """Build the tree of an object's new mesh, on the device if its mesh is on the device."""
    if isinstance(item, MeshOnDevice):
        from warpvis.kernels.casting.packets_cuda import LEVELS

        mesh: DeviceMesh = item.__dict__["mesh"]
        return build_device_bvh(mesh._replace(closed=_flag(closed, device)), max_levels=LEVELS)
    vertices, faces = item.mesh_vertices, item.faces
    assert vertices is not None
    lanes = CPU_LANES if device.is_cpu else CUDA_LANES
    return build_tree(vertices, faces, np.zeros(len(faces), dtype=np.int32), np.array([closed]), lanes, device)


def build_warp_mesh(item: SceneObject, device: wp.Device) -> wp.Mesh:
    """Build the mesh of an object for the ``rays`` caster."""
    from warpvis.scene.acceleration.geometry import make_mesh

    if isinstance(item, MeshOnDevice):
        mesh: DeviceMesh = item.__dict__["mesh"]
        return make_mesh(mesh.vertices, mesh.faces.flatten(), device)
    assert item.mesh_vertices is not None
    return make_mesh(item.mesh_vertices, item.faces, device)


def _flag(closed: bool, device: wp.Device) -> wp.array:
    return wp.full(1, int(closed), dtype=wp.uint8, device=device)


def _on_device(vertices: ArrayInput, faces: ArrayInput, name: str, device: wp.Device) -> DeviceMesh:
    """Copy a mesh that is on the scene's GPU, and check it there."""
    try:
        corners = as_warp(_rows(vertices, wp.vec3), wp.vec3, ("n",), name=f"vertices of {name!r}", device=device)
        triangles = as_warp(_rows(faces, wp.vec3i), wp.vec3i, ("m",), name=f"faces of {name!r}", device=device)
    except ArrayError as error:
        raise SceneError(str(error)) from None
    if not len(triangles):
        raise SceneError(f"mesh of {name!r} must have triangles, got none")
    corners, indices = wp.clone(corners), wp.clone(triangles).view(wp.int32).reshape((len(triangles), 3))
    _check_values(corners, indices, name)
    owner = wp.zeros(len(indices), dtype=wp.int32, device=device)
    return DeviceMesh(corners, indices, owner, _flag(False, device))


def _check_values(vertices: wp.array, faces: wp.array, name: str) -> None:
    """Raise a `SceneError` if a corner is not finite or too far away, or a face index is out of range."""
    from warpvis.kernels.bvh.items_cuda import check_mesh as find_bad

    count, limits = len(vertices), np.iinfo(np.int32)
    found = wp.array([0, limits.max, limits.max, limits.min], dtype=wp.int32, device=vertices.device)
    launch(find_bad, max(count, len(faces)), [vertices, faces, FARTHEST, found], vertices.device)
    bad, first, low, high = found.numpy().tolist()
    if bad:
        raise SceneError(
            f"vertices of {name!r} must be finite and within 1e18 m of the origin of its frame: {bad} are not, the "
            f"first at {first}"
        )
    if low < 0 or high >= count:
        noun = "vertex" if count == 1 else "vertices"
        raise SceneError(f"faces of {name!r} must index its {count} {noun}, got indices from {low} to {high}")


def _rows(value: ArrayInput, kind: type) -> ArrayInput:
    """View a Warp array of rows of three numbers as an array of vectors; return anything else unchanged."""
    scalar = kind._wp_scalar_type_  # type: ignore[attr-defined]
    if isinstance(value, wp.array) and value.dtype == scalar and value.ndim == 2 and value.shape[1] == 3:
        return value.contiguous().view(kind).reshape((value.shape[0],))
    return value


def _too_far(item: SceneObject) -> str:
    origin = "the origin of its frame" if item.movable else "the origin"
    return f"vertices of {item.name!r} must lie within 1e18 m of {origin}"


def _host(array: ArrayInput, kind: str, name: str) -> ArrayInput:
    """Copy a GPU array to the host; return any other array unchanged."""
    if isinstance(array, wp.array):
        return array.numpy()
    if not on_gpu(array):
        return array
    try:
        return wp.from_dlpack(array).numpy()
    except (RuntimeError, TypeError) as error:
        raise SceneError(f"{kind} of {name!r} must be an array of numbers: {error}") from None
