# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Arguments of renders as JAX arrays, checked as far as they are known while JAX traces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import warp as wp
from jax import Array
from jax.typing import ArrayLike

from warpvis.cameras import parameter_names
from warpvis.cameras.base import AnyCamera
from warpvis.core.poses import host_poses
from warpvis.errors import ArrayError, PoseError
from warpvis.jax._foreign import Arrays
from warpvis.jax._poses import matrices_to_rows
from warpvis.scene import Scene
from warpvis.scene.worlds import parse_worlds


def parse_arrays(
    scene: Scene,
    camera: AnyCamera,
    poses: ArrayLike,
    object_poses: ArrayLike | None,
    world_index: ArrayLike | None,
    vertices: Mapping[str, ArrayLike],
    intrinsics: ArrayLike | None = None,
) -> Arrays:
    """Return the arrays of a render, checked."""
    rows = as_rows(poses, "poses", 1, scene)
    arrays = Arrays(
        rows[None] if rows.ndim == 1 else rows,
        None if object_poses is None else _as_object_rows(object_poses, scene),
        None if world_index is None else as_array(world_index, "world_index", jnp.int32, scene),
        tuple(as_array(value, f"vertices[{name!r}]", jnp.float32, scene) for name, value in vertices.items()),
        None if intrinsics is None else as_array(intrinsics, "intrinsics", jnp.float32, scene),
    )
    _check(scene, camera, arrays, tuple(vertices))
    return arrays


def as_array(value: ArrayLike, name: str, dtype: Any, scene: Scene) -> Array:
    """Return an array of a dtype; JAX arrays must be on the scene's device, others are copied to it."""
    try:
        if isinstance(value, Array):
            array = value
        else:
            array = jnp.asarray(value, device=wp.device_to_jax(scene.device))
    except (TypeError, ValueError, RuntimeError) as error:
        raise ArrayError(f"{name} must be an array of numbers on {scene.device}: {error}") from None
    expected = jnp.integer if dtype == jnp.int32 else jnp.floating
    if not jnp.issubdtype(array.dtype, expected):
        raise ArrayError(f"{name} must be {dtype.__name__}, got {array.dtype}")
    if not isinstance(array, jax.core.Tracer):
        devices = array.devices()
        if any(_warp_device(device) != scene.device for device in devices):
            listed = ", ".join(sorted(str(device) for device in devices))
            raise ArrayError(f"{name} must be on the scene's device, {scene.device}, got an array on {listed}")
    return array.astype(dtype)


def _warp_device(device: Any) -> wp.Device | None:
    """Return Warp's name of one of JAX's devices; None if Warp does not support it."""
    try:
        return wp.device_from_jax(device)
    except (RuntimeError, IndexError):
        return None


def as_rows(poses: ArrayLike, name: str, axes: int, scene: Scene) -> Array:
    """Return poses as rows of at most `axes` leading axes."""
    array = as_array(poses, name, jnp.float32, scene)
    if array.shape[-2:] == (4, 4):
        if scene.device.is_cpu and array.size and not isinstance(array, jax.core.Tracer):
            host_poses(np.asarray(array).reshape(-1, 4, 4), name=name)  # rows of wrong matrices are unit quaternions
        array = matrices_to_rows(array)
    elif array.shape[-1:] != (7,):
        raise PoseError(f"{name} must be rows of 7 numbers or matrices of shape (4, 4), got shape {array.shape}")
    if array.ndim not in (axes, axes + 1):
        raise PoseError(f"{name} must have {axes - 1} or {axes} axes before those of a pose, got shape {array.shape}")
    return array


def _as_object_rows(object_poses: ArrayLike, scene: Scene) -> Array:
    rows = as_rows(object_poses, "object_poses", 2, scene)
    rows = rows[None] if rows.ndim == 2 else rows
    if not scene.movable or rows.shape[1] != len(scene.movable):
        raise PoseError(
            f"object_poses must be those of the {len(scene.movable)} movable objects in each world, "
            f"got shape {rows.shape}"
        )
    return rows


def _check(scene: Scene, camera: AnyCamera, arrays: Arrays, deforming: Sequence[str]) -> None:
    """Check shapes, and the values of arrays on the CPU that are not traced."""
    views = len(arrays.poses)
    worlds = 1 if arrays.object_poses is None else len(arrays.object_poses)
    if arrays.world_index is not None and arrays.world_index.shape != (views,):
        raise ArrayError(f"world_index must have shape ({views},), got {arrays.world_index.shape}")
    if arrays.world_index is None and worlds not in (1, views):
        raise ArrayError(f"object_poses have {worlds} worlds for {views} views; give world_index= for each view")
    for name, vertices in zip(deforming, arrays.vertices, strict=True):
        expected = scene.objects[scene.index(name)].vertices.shape
        if vertices.shape != expected:
            raise ArrayError(f"vertices[{name!r}] must have shape {expected}, got {vertices.shape}")
    if arrays.intrinsics is not None:
        names = parameter_names(camera)
        if not names:
            raise ArrayError("intrinsics must be None for a camera without parameters, such as a list of rays")
        if arrays.intrinsics.shape != (len(names),):
            raise ArrayError(
                f"intrinsics must be the {len(names)} numbers {', '.join(names)}, got shape {arrays.intrinsics.shape}"
            )
    if scene.device.is_cpu:
        known = jax.tree.map(lambda array: None if isinstance(array, jax.core.Tracer) else np.asarray(array), arrays)
        if known.poses is not None:
            host_poses(known.poses, camera.axes, axes=camera.axes, name="poses")
        if known.object_poses is not None and (arrays.world_index is None or known.world_index is not None):
            parse_worlds(scene, views, known.object_poses, known.world_index, None)
