# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""New objects, for `Scene.add`; new vertices, for `Scene.update_vertices`; new meshes, for `Scene.update_mesh`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from warpvis.core.arrays import FARTHEST, as_numpy, as_warp, on_gpu
from warpvis.core.kernel_cache import launch
from warpvis.core.types import ArrayInput, MeshLike
from warpvis.errors import ArrayError, SceneError
from warpvis.scene._mesh import Mesh, MeshCache, check_indices, check_mesh, check_values
from warpvis.scene._object import IDENTITY, ObjectList, SceneObject, attach, check_scale
from warpvis.scene.appearances import LazyAppearance, choose_appearance
from warpvis.scene.materials import Appearance, AppearanceLike
from warpvis.scene.solids import Solid


def read_mesh(
    meshes: MeshCache,
    mesh: MeshLike,
    scale: float | ArrayLike,
    name: str,
    appearance: AppearanceLike | LazyAppearance | None,
) -> tuple[Mesh, Solid | None, LazyAppearance | None]:
    """Check a mesh given to a scene, and return it scaled: its triangles, its round solid and its appearance."""
    factors = check_scale(scale, name)
    shared = meshes.get(mesh, factors, name)
    solid = mesh.scaled(factors) if isinstance(mesh, Solid) else None
    shown = choose_appearance(appearance, mesh, name, (len(shared.vertices), len(shared.faces)))
    if shown is not None and (factors != factors.flat[0]).any():
        shown = shown.transformed(np.diag(factors))
    return shared, solid, shown


def place_object(item: SceneObject, objects: ObjectList, *, movable: bool) -> SceneObject:
    """Return a new object as a scene stores it; `item` has its mesh's frame, and its pose as `origin`."""
    name, shared, row = item.name, item.mesh, item.origin
    place = IDENTITY if row is None else row
    if movable and item.parent is None:
        start = place.astype(np.float32)
        shared.check_reach(start[None], name)
        return replace(item, mesh=shared.single, pose=start, origin=None)
    shared.check_reach(place[None], name)
    if item.parent is None and shared.uses:
        shared.uses += 1
        return replace(item, shares_mesh=True, solid=None)
    placed = shared.placed(row)
    world = vertices = placed.astype(np.float32)
    if item.parent is not None:
        vertices = attach(name, placed, objects[item.parent], is_solid=item.solid is not None)
    shared.uses += item.parent is None and not movable
    return replace(item, mesh=Mesh(vertices, shared.faces), solid=None, world=world)


def as_deforming(item: SceneObject, device: wp.Device) -> SceneObject:
    """Return a movable object whose vertices are on the device, and not initialized."""
    points = wp.empty(len(item.mesh.source), dtype=wp.vec3, device=device)
    mesh = Mesh(points, item.faces, deforms=True)
    shown = item.lazy_appearance
    return SceneObject(item.name, item.label, mesh, item.pose, category=item.category, lazy_appearance=shown)


def parse_vertices(vertices: ArrayInput, item: SceneObject, device: wp.Device) -> wp.array:
    """Convert new vertices of an object to vec3, on the host or on the device; host arrays are checked."""
    name, count = item.name, len(item.mesh.source)
    if on_gpu(vertices):
        result = _on_device(vertices, wp.vec3, "n", f"vertices of {name!r}", device)
    else:
        try:
            host = as_numpy(vertices, name=f"vertices of {name!r}")
        except ArrayError as error:
            raise SceneError(str(error)) from None
        if host.ndim != 2 or host.shape[1] != 3:
            raise SceneError(f"vertices of {name!r} must have shape ({count}, 3), got {host.shape}")
        check_values(host, name)
        result = wp.array(np.ascontiguousarray(host, dtype=np.float32), dtype=wp.vec3, device="cpu", copy=False)
    if len(result) != count:
        raise SceneError(f"vertices of {name!r} must have {count} rows, as before, got {len(result)}")
    return result


def parse_normals(normals: ArrayInput, item: SceneObject) -> wp.array:
    """Convert shading normals of an object to those of the corners of its faces, ``(m, 3)`` vec3 on the host."""
    try:
        found = Appearance(normals=as_numpy(normals, name=f"normals of {item.name!r}"))
    except ArrayError as error:
        raise SceneError(str(error)) from None
    found.check_fits(len(item.mesh.source), len(item.mesh.source_faces), item.name)
    rows = found.corner_normals(item.faces)
    assert rows is not None
    return wp.array(np.ascontiguousarray(rows), dtype=wp.vec3, device="cpu", copy=False)


def with_mesh(item: SceneObject, vertices: ArrayInput, faces: ArrayInput | None, device: wp.Device) -> SceneObject:
    """Return a detached object with another mesh, in its own frame if it is movable, else in the world's."""
    name, appearance = item.name, item.lazy_appearance
    new_faces = item.faces if faces is None else faces
    if item.pose is not None and on_gpu(vertices) and on_gpu(new_faces):
        mesh, is_alike = _mesh_on_device(vertices, new_faces, name, device), False
    else:
        corners, triangles = check_mesh((_host(vertices, "vertices", name), _host(new_faces, "faces", name)), name)
        if np.abs(corners).max() > FARTHEST:
            origin = "the origin of its frame" if item.movable else "the origin"
            raise SceneError(f"vertices of {name!r} must lie within 1e18 m of {origin}")
        mesh = Mesh(np.ascontiguousarray(corners, dtype=np.float32), triangles)
        is_alike = len(corners) == len(item.mesh.source) and np.array_equal(triangles, item.faces)
    if appearance is not None:
        appearance = appearance.without_normals() if is_alike else appearance.for_any_mesh()
    return SceneObject(name, item.label, mesh, item.pose, category=item.category, lazy_appearance=appearance)


def _mesh_on_device(vertices: ArrayInput, faces: ArrayInput, name: str, device: wp.Device) -> Mesh:
    """Copy a mesh that is on the scene's GPU, and check it there."""
    from warpvis.kernels.bvh.ranges_cuda import check_mesh as find_bad

    corners = wp.clone(_on_device(vertices, wp.vec3, "n", f"vertices of {name!r}", device))
    triangles = wp.clone(_on_device(faces, wp.vec3i, "m", f"faces of {name!r}", device))
    if not len(triangles):
        raise SceneError(f"mesh of {name!r} must have triangles, got none")
    indices, limits = triangles.view(wp.int32).reshape((len(triangles), 3)), np.iinfo(np.int32)
    found = wp.array([0, limits.max, limits.max, limits.min], dtype=wp.int32, device=device)
    launch(find_bad, max(len(corners), len(indices)), [corners, indices, FARTHEST, found], device)
    bad, first, low, high = found.numpy().tolist()
    if bad:
        raise SceneError(
            f"vertices of {name!r} must be finite and within 1e18 m of the origin of its frame: {bad} are not, the "
            f"first at {first}"
        )
    check_indices(low, high, len(corners), name)
    return Mesh(corners, indices)


def _on_device(value: ArrayInput, kind: type, dimension: str, subject: str, device: wp.Device) -> wp.array:
    """Convert an array of vectors, or of rows of three numbers, on a GPU."""
    scalar = kind._wp_scalar_type_  # type: ignore[attr-defined]
    if isinstance(value, wp.array) and value.dtype == scalar and value.ndim == 2 and value.shape[1] == 3:
        value = value.contiguous().view(kind).reshape((value.shape[0],))
    try:
        return as_warp(value, kind, (dimension,), name=subject, device=device)
    except ArrayError as error:
        raise SceneError(str(error)) from None


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
