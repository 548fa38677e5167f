# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Renders and their gradients under `jax.jit` and `jax.vmap`.

A function that is mapped by `jax.vmap` is called once for the views of all members of a batch, whose worlds are joined.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jax.custom_batching import custom_vmap

from warpvis.jax._foreign import Arrays, call_cast, call_parameter_gradients, call_pose_gradients, call_vertex_gradients


@partial(jax.jit, static_argnums=(0, 1))
def cast(number: int, names: tuple[str, ...], arrays: Arrays) -> dict[str, Array]:
    """Render images by name."""

    @custom_vmap
    def one(arrays: Arrays) -> dict[str, Array]:
        return call_cast(number, names, arrays)

    @one.def_vmap
    def batch(size: int, batched: list[Arrays], arrays: Arrays) -> tuple[dict[str, Array], dict[str, bool]]:
        if any(batched[0].vertices) or batched[0].intrinsics:
            images = map_members(partial(cast, number, names), batched, [arrays])
        else:
            images = cast(number, names, join_members(size, batched[0], arrays))
            images = {name: image.reshape(size, -1, *image.shape[1:]) for name, image in images.items()}
        return images, dict.fromkeys(names, True)

    return one(arrays)


@partial(jax.jit, static_argnums=0)
def pose_gradients(number: int, arrays: Arrays, images: dict[str, Array], gradients: dict[str, Array]) -> Array:
    """Return gradients with respect to the rows of cameras and objects, ``(V, 1 + M, 7)``."""

    @custom_vmap
    def one(arrays: Arrays, images: dict[str, Array], gradients: dict[str, Array]) -> Array:
        return call_pose_gradients(number, arrays, images, gradients)

    @one.def_vmap
    def batch(size: int, batched: Any, arrays: Arrays, *rest: dict[str, Array]) -> tuple[Array, bool]:
        if batched[0].intrinsics:
            return map_members(partial(pose_gradients, number), batched, [arrays, *rest]), True
        joined = join_members(size, batched[0], arrays)
        result = pose_gradients(number, joined, *join_images(size, batched[1:], list(rest)))
        return result.reshape(size, -1, *result.shape[1:]), True

    return one(arrays, images, gradients)


@partial(jax.jit, static_argnums=0)
def vertex_gradients(
    number: int, arrays: Arrays, images: dict[str, Array], gradients: dict[str, Array]
) -> tuple[Array, ...]:
    """Return gradients with respect to the vertices of each deforming object, ``(n, 3)``."""

    @custom_vmap
    def one(*args: Any) -> tuple[Array, ...]:
        return call_vertex_gradients(number, *args)

    @one.def_vmap
    def batch(size: int, batched: Any, *args: Any) -> tuple[tuple[Array, ...], tuple[bool, ...]]:
        results = map_members(partial(vertex_gradients, number), batched, list(args))
        return results, (True,) * len(results)

    return one(arrays, images, gradients)


@partial(jax.jit, static_argnums=0)
def parameter_gradients(number: int, arrays: Arrays, images: dict[str, Array], gradients: dict[str, Array]) -> Array:
    """Return gradients with respect to the camera's parameters, ``(P,)``."""

    @custom_vmap
    def one(*args: Any) -> Array:
        return call_parameter_gradients(number, *args)

    @one.def_vmap
    def batch(size: int, batched: Any, *args: Any) -> tuple[Array, bool]:
        return map_members(partial(parameter_gradients, number), batched, list(args)), True

    return one(arrays, images, gradients)


def _with_members(size: int, is_batched: bool, array: Array) -> Array:
    """Return an array with a leading axis of a batch."""
    return array if is_batched else jnp.broadcast_to(array, (size, *array.shape))


def join_members(size: int, batched: Arrays, arrays: Arrays) -> Arrays:
    """Return the views of all members of a batch as views of one render."""
    poses = _with_members(size, bool(batched.poses), arrays.poses)
    views = poses.shape[1]
    objects, index = arrays.object_poses, arrays.world_index
    if objects is not None:
        worlds = objects.shape[1] if batched.object_poses else objects.shape[0]
        if index is None:
            index = jnp.zeros(views, jnp.int32) if worlds == 1 else jnp.arange(views, dtype=jnp.int32)
        index = _with_members(size, bool(batched.world_index), index)
        if batched.object_poses:
            objects = objects.reshape(-1, *objects.shape[2:])
            index = index + worlds * jnp.arange(size, dtype=jnp.int32)[:, None]
    elif index is not None:
        index = _with_members(size, bool(batched.world_index), index)
    return Arrays(poses.reshape(-1, 7), objects, None if index is None else index.reshape(-1), *arrays[3:])


def join_images(size: int, batched: Any, images: Any) -> Any:
    """Return images of all members of a batch as images of one render."""

    def join(is_batched: bool, array: Array) -> Array:
        return _with_members(size, is_batched, array).reshape(-1, *array.shape[1 + is_batched :])

    return jax.tree.map(join, batched, images)


def map_members(function: Callable[..., Any], batched: list[Any], args: list[Any]) -> Any:
    """Call a function for the members of a batch one after the other."""
    flags, leaves = jax.tree.leaves(batched), jax.tree.leaves(args)
    structure = jax.tree.structure(args)

    def member(mapped: list[Array]) -> Any:
        values = iter(mapped)
        one = [next(values) if is_batched else leaf for is_batched, leaf in zip(flags, leaves, strict=True)]
        return function(*jax.tree.unflatten(structure, one))

    chosen = [leaf for is_batched, leaf in zip(flags, leaves, strict=True) if is_batched]
    return jax.lax.map(member, chosen)


def add_worlds(of_views: Array, object_poses: Array, world_index: Array | None) -> Array:
    """Add the gradients ``(V, M, 7)`` of the views of each world."""
    if world_index is not None:
        return jnp.zeros_like(object_poses).at[world_index].add(of_views)
    return of_views.sum(axis=0, keepdims=True) if len(object_poses) == 1 else of_views
