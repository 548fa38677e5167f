# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of pixels from given colors of objects, with gradients and batches."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import warp as wp
from jax import Array
from jax.custom_batching import custom_vmap

from warpvis.jax._batches import join_images, join_members, map_members
from warpvis.jax._foreign import Arrays, Spec, call_foreign, image_inputs, split_arrays
from warpvis.rendering.color_gradients import COLOR_IMAGES
from warpvis.rendering.differentiable import numbered_renderer


@partial(jax.custom_vjp, nondiff_argnums=(0, 1))
def interpolate(
    number: int, indices: tuple[int, ...], arrays: Arrays, images: dict[str, Array], colors: tuple[Array, ...]
) -> Array:
    """Return the albedo of a render, from 0 to 1, with the given colors of the objects of these indices.

    `arrays` are those of the render, and `images` those named in `COLOR_IMAGES`.
    """
    return _interpolate(number, indices, arrays, images, colors)


def _forward(
    number: int, indices: tuple[int, ...], arrays: Arrays, images: dict[str, Array], colors: tuple[Array, ...]
) -> tuple[Array, tuple[Arrays, dict[str, Array], tuple[Array, ...]]]:
    return _interpolate(number, indices, arrays, images, colors), (arrays, _seen(images), colors)


def _backward(
    number: int,
    indices: tuple[int, ...],
    saved: tuple[Arrays, dict[str, Array], tuple[Array, ...]],
    gradient: Array,
) -> tuple[Arrays, dict[str, None], tuple[Array, ...]]:
    """Return gradients with respect to the given colors only."""
    arrays, images, colors = saved
    shapes = tuple(given.shape[:-1] for given in colors)
    of_colors = _gradients(number, indices, shapes, arrays, images, gradient) if colors else ()
    return jax.tree.map(lambda array: None, arrays), dict.fromkeys(COLOR_IMAGES), of_colors


interpolate.defvjp(_forward, _backward)


@partial(jax.jit, static_argnums=(0, 1))
def _interpolate(
    number: int, indices: tuple[int, ...], arrays: Arrays, images: dict[str, Array], colors: tuple[Array, ...]
) -> Array:
    @custom_vmap
    def one(*args: Any) -> Array:
        return _call_interpolation(number, indices, *args)

    @one.def_vmap
    def batch(size: int, batched: Any, *args: Any) -> tuple[Array, bool]:
        if any(batched[0].vertices) or any(batched[2]):
            return map_members(partial(_interpolate, number, indices), batched, list(args)), True
        joined, views = join_members(size, batched[0], args[0]), join_images(size, batched[1], args[1])
        result = _interpolate(number, indices, joined, views, args[2])
        return result.reshape(size, -1, *result.shape[1:]), True

    return one(arrays, images, colors)


@partial(jax.jit, static_argnums=(0, 1, 2))
def _gradients(
    number: int,
    indices: tuple[int, ...],
    shapes: tuple[tuple[int, ...], ...],
    arrays: Arrays,
    images: dict[str, Array],
    gradient: Array,
) -> tuple[Array, ...]:
    """Return gradients with respect to colors of these shapes; those of the members of a batch are not added."""

    @custom_vmap
    def one(*args: Any) -> tuple[Array, ...]:
        return _call_gradients(number, indices, shapes, *args)

    @one.def_vmap
    def batch(size: int, batched: Any, *args: Any) -> tuple[tuple[Array, ...], tuple[bool, ...]]:
        results = map_members(partial(_gradients, number, indices, shapes), batched, list(args))
        return results, (True,) * len(results)

    return one(arrays, images, gradient)


def _seen(images: dict[str, Array]) -> dict[str, Array]:
    """Return the images without albedo."""
    return {name: images[name] for name in COLOR_IMAGES[:3]}


def _call_interpolation(
    number: int, indices: tuple[int, ...], arrays: Arrays, images: dict[str, Array], colors: tuple[Array, ...]
) -> Array:
    camera = numbered_renderer(number).camera
    spec, given = image_inputs(number, arrays, _seen(images))
    color_type = ("color", wp.vec3, 1 + len(camera.shape))
    added: Spec = (("base", *color_type[1:]), *((f"colors_{k}", wp.vec3, c.ndim - 1) for k, c in enumerate(colors)))
    values = images["albedo"].astype(jnp.float32) / 255.0, *colors
    inputs = (*spec, *added), {**given, **dict(zip((name for name, *_ in added), values, strict=True))}
    shapes = {"color": (len(arrays.poses), *camera.shape)}
    return call_foreign(_write_colors, number, inputs, (color_type,), shapes, indices)[0]


def _call_gradients(
    number: int,
    indices: tuple[int, ...],
    shapes: tuple[tuple[int, ...], ...],
    arrays: Arrays,
    images: dict[str, Array],
    gradient: Array,
) -> tuple[Array, ...]:
    spec, given = image_inputs(number, arrays, images)
    inputs = (*spec, ("of_color", wp.vec3, gradient.ndim - 1)), {**given, "of_color": gradient}
    named = {f"of_colors_{k}": shape for k, shape in enumerate(shapes)}
    outputs = tuple((name, wp.vec3, len(shape)) for name, shape in named.items())
    return tuple(call_foreign(_write_gradients, number, inputs, outputs, named, indices))


def _write_colors(number: int, arrays: dict[str, wp.array], indices: tuple[int, ...]) -> None:
    inputs, images, _ = split_arrays(arrays)
    colors = {index: arrays[f"colors_{k}"] for k, index in enumerate(indices)}
    wp.copy(arrays["color"], arrays["base"])
    numbered_renderer(number).interpolate_colors(inputs, colors, images, arrays["color"])


def _write_gradients(number: int, arrays: dict[str, wp.array], indices: tuple[int, ...]) -> None:
    inputs, images, _ = split_arrays(arrays)
    shapes = {index: arrays[f"of_colors_{k}"].shape for k, index in enumerate(indices)}
    sums = numbered_renderer(number).color_gradients(inputs, shapes, images, arrays["of_color"])
    for k, total in enumerate(sums):
        wp.utils.array_cast(total, arrays[f"of_colors_{k}"])
