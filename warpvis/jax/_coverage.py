# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Areas and visible fractions of objects in images, with gradients by antialiased boundaries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import warp as wp
from jax import Array
from jax.custom_batching import custom_vmap
from jax.typing import ArrayLike

from warpvis.cameras.base import AnyCamera
from warpvis.core.checks import check_flag
from warpvis.jax._arguments import parse_arrays
from warpvis.jax._batches import add_worlds, join_images, join_members, map_members
from warpvis.jax._foreign import Arrays, Spec, call_foreign, image_inputs, split_arrays
from warpvis.rendering.coverage import COVERAGE_IMAGES, check_meshes, target_indices
from warpvis.rendering.differentiable import check_vertices, numbered_renderer, pixel_type, renderer_number
from warpvis.scene import Scene


def coverage(
    scene: Scene,
    camera: AnyCamera,
    poses: ArrayLike,
    names: str | Sequence[str],
    *,
    object_poses: ArrayLike | None = None,
    world_index: ArrayLike | None = None,
    vertices: Mapping[str, ArrayLike] | None = None,
    occluded: bool = True,
) -> Array:
    """Return the area of objects in the image of every pose [px], with gradients to poses and vertices.

    It is the number of pixels that see the objects, where pixels at their boundary count in part, by the mesh edge
    between the pixel centers. Gradients flow to the cameras, to the objects, and to the objects that hide them. An
    object that no pixel sees has the gradient 0, and boundaries at which surfaces intersect contribute none.

    Args:
        scene: A scene of meshes, on the device of the arrays.
        camera: A camera with an image, not a list of rays.
        poses: Camera to world, as for `render`, ``(V, 7)``, ``(7,)``, ``(V, 4, 4)`` or ``(4, 4)``.
        names: An object, or several whose areas are added.
        object_poses: Poses of the movable objects, as for `render`.
        world_index: World of each view, as for `render`.
        vertices: Vertices of movable objects, as for `render`.
        occluded: Whether other objects hide them; if not, only the objects themselves are rendered.

    Returns:
        Areas, ``(V,)`` float32.

    Raises:
        ArrayError: If an array has the wrong shape or dtype or is not on the scene's device.
        CameraError: If the camera is a list of rays.
        SceneError: If the scene has no object of a name, or contains round solids.
    """
    number, indices, arrays = _parse(scene, camera, poses, names, object_poses, world_index, vertices)
    return _measure(number, indices, check_flag(occluded, "occluded"), False, arrays)


def soft_mask(
    scene: Scene,
    camera: AnyCamera,
    poses: ArrayLike,
    names: str | Sequence[str],
    *,
    object_poses: ArrayLike | None = None,
    world_index: ArrayLike | None = None,
    vertices: Mapping[str, ArrayLike] | None = None,
    occluded: bool = True,
) -> Array:
    """Return the share of each pixel that objects cover, with gradients to poses and vertices.

    It is 1 where a pixel sees the objects and 0 elsewhere, except for pixels with a boundary. Its sum is the
    `coverage`, whose arguments and limits it has. Where boundaries of a row and of a column meet, at corners, it may be
    slightly less than 0 or more than 1.

    Returns:
        Masks, ``(V, H, W)`` float32.

    >>> mask = warpvis.jax.soft_mask(scene, camera, poses, "mug")
    >>> loss = 1 - (mask * measured).sum() / (mask + measured - mask * measured).sum()  # intersection over union
    """
    number, indices, arrays = _parse(scene, camera, poses, names, object_poses, world_index, vertices)
    return _measure(number, indices, check_flag(occluded, "occluded"), True, arrays)


def visible_fraction(
    scene: Scene,
    camera: AnyCamera,
    poses: ArrayLike,
    names: str | Sequence[str],
    *,
    object_poses: ArrayLike | None = None,
    world_index: ArrayLike | None = None,
    vertices: Mapping[str, ArrayLike] | None = None,
) -> Array:
    """Return the visible fraction of objects in the image of every pose, with gradients to poses and vertices.

    It is the `coverage` of the objects over their coverage if nothing hid them; parts outside of the image do not
    count. If they are outside or entirely hidden, it is 0 with the gradient 0.

    The arguments are those of `coverage`.

    Returns:
        Fractions, ``(V,)`` float32.

    >>> gradient = jax.grad(lambda poses: warpvis.jax.visible_fraction(scene, camera, poses, "mug").sum())(poses)
    """
    options: dict[str, Any] = {"object_poses": object_poses, "world_index": world_index, "vertices": vertices}
    seen = coverage(scene, camera, poses, names, **options)
    alone = coverage(scene, camera, poses, names, occluded=False, **options)
    return jnp.where(alone > 0, seen / jnp.where(alone > 0, alone, 1.0), 0.0)


def _parse(
    scene: Scene,
    camera: AnyCamera,
    poses: ArrayLike,
    names: str | Sequence[str],
    object_poses: ArrayLike | None,
    world_index: ArrayLike | None,
    vertices: Mapping[str, ArrayLike] | None,
) -> tuple[int, tuple[int, ...], Arrays]:
    """Check the arguments of `coverage`, and return the renderer's number, indices of the objects, and arrays."""
    vertices = check_vertices(vertices)
    number = renderer_number(scene, camera, deforming=tuple(vertices), caster="auto", threads=None)
    indices = target_indices(scene, camera, names)
    check_meshes(scene)
    return number, indices, parse_arrays(scene, camera, poses, object_poses, world_index, vertices)


@partial(jax.custom_vjp, nondiff_argnums=(0, 1, 2, 3))
def _measure(number: int, indices: tuple[int, ...], occluded: bool, with_mask: bool, arrays: Arrays) -> Array:
    """Return areas or masks of the objects of these indices."""
    return _render(number, indices, occluded, with_mask, arrays)[0]


def _forward(
    number: int, indices: tuple[int, ...], occluded: bool, with_mask: bool, arrays: Arrays
) -> tuple[Array, tuple[Arrays, dict[str, Array]]]:
    result, images = _render(number, indices, occluded, with_mask, arrays)
    return result, (arrays, images)


def _backward(
    number: int,
    indices: tuple[int, ...],
    occluded: bool,
    with_mask: bool,
    saved: tuple[Arrays, dict[str, Array]],
    gradient: Array,
) -> tuple[Arrays]:
    arrays, images = saved
    of_poses, *of_vertices = _gradients(number, indices, arrays, images, gradient)
    of_objects = None
    if arrays.object_poses is not None:
        of_objects = add_worlds(of_poses[:, 1:], arrays.object_poses, arrays.world_index)
    return (Arrays(of_poses[:, 0], of_objects, None, tuple(of_vertices)),)


_measure.defvjp(_forward, _backward)


@partial(jax.jit, static_argnums=(0, 1, 2, 3))
def _render(
    number: int, indices: tuple[int, ...], occluded: bool, with_mask: bool, arrays: Arrays
) -> tuple[Array, dict[str, Array]]:
    """Return areas or masks, and the images that gradients are computed from."""

    @custom_vmap
    def one(arrays: Arrays) -> tuple[Array, dict[str, Array]]:
        return _call_render(number, indices, occluded, with_mask, arrays)

    @one.def_vmap
    def batch(size: int, batched: Any, arrays: Arrays) -> tuple[Any, Any]:
        function = partial(_render, number, indices, occluded, with_mask)
        if any(batched[0].vertices):
            results = map_members(function, batched, [arrays])
        else:
            joined = function(join_members(size, batched[0], arrays))
            results = jax.tree.map(lambda array: array.reshape(size, -1, *array.shape[1:]), joined)
        return results, jax.tree.map(lambda array: True, results)

    return one(arrays)


@partial(jax.jit, static_argnums=(0, 1))
def _gradients(
    number: int, indices: tuple[int, ...], arrays: Arrays, images: dict[str, Array], gradient: Array
) -> tuple[Array, ...]:
    """Return gradients with respect to the rows of cameras and objects, ``(V, 1 + M, 7)``, and to vertices."""

    @custom_vmap
    def one(*args: Any) -> tuple[Array, ...]:
        return _call_gradients(number, indices, *args)

    @one.def_vmap
    def batch(size: int, batched: Any, *args: Any) -> tuple[tuple[Array, ...], tuple[bool, ...]]:
        function = partial(_gradients, number, indices)
        if args[0].vertices:  # their gradients are sums over the views of a member
            results = map_members(function, batched, list(args))
        else:
            joined = join_members(size, batched[0], args[0])
            (of_poses,) = function(joined, *join_images(size, batched[1:], list(args[1:])))
            results = (of_poses.reshape(size, -1, *of_poses.shape[1:]),)
        return results, (True,) * len(results)

    return one(arrays, images, gradient)


def _call_render(
    number: int, indices: tuple[int, ...], occluded: bool, with_mask: bool, arrays: Arrays
) -> tuple[Array, dict[str, Array]]:
    shape = len(arrays.poses), *numbered_renderer(number).camera.shape
    outputs: Spec = (("masks", wp.float32, 3) if with_mask else ("areas", wp.float32, 1),)
    outputs += tuple((name, pixel_type(name), 3) for name in COVERAGE_IMAGES)
    shapes = {name: shape[:axes] for name, _, axes in outputs}
    inputs = image_inputs(number, arrays, {})
    result, *images = call_foreign(_write_render, number, inputs, outputs, shapes, indices, occluded)
    return result, dict(zip(COVERAGE_IMAGES, images, strict=True))


def _call_gradients(
    number: int, indices: tuple[int, ...], arrays: Arrays, images: dict[str, Array], gradient: Array
) -> tuple[Array, ...]:
    spec, given = image_inputs(number, arrays, images)
    inputs = (*spec, ("weights", wp.float32, gradient.ndim)), {**given, "weights": gradient}
    shapes: dict[str, tuple[int, ...]] = {
        "of_poses": (len(arrays.poses), 1 + len(numbered_renderer(number).scene.movable)),
        **{f"of_vertices_{k}": (len(vertices),) for k, vertices in enumerate(arrays.vertices)},
    }
    outputs = tuple(
        (name, wp.transform if name == "of_poses" else wp.vec3, len(shape)) for name, shape in shapes.items()
    )
    return tuple(call_foreign(_write_gradients, number, inputs, outputs, shapes, indices))


def _write_render(number: int, arrays: dict[str, wp.array], indices: tuple[int, ...], occluded: bool) -> None:
    renderer, names = numbered_renderer(number), _names(number, indices)
    inputs, images, _ = split_arrays(arrays)
    renderer.render(inputs, images, only=None if occluded else names)
    if "masks" in arrays:
        renderer.masks(inputs, images, names, arrays["masks"])
    else:
        renderer.areas(inputs, images, names, arrays["areas"])


def _write_gradients(number: int, arrays: dict[str, wp.array], indices: tuple[int, ...]) -> None:
    inputs, images, _ = split_arrays(arrays)
    given = arrays["weights"]
    weights = wp.empty(given.shape, dtype=wp.float64, device=given.device)
    wp.utils.array_cast(given, weights)
    weights = weights if weights.ndim == 3 else weights.reshape((len(weights), 1, 1))
    of_poses, of_vertices = numbered_renderer(number).area_gradients(inputs, images, _names(number, indices), weights)
    wp.copy(arrays["of_poses"], of_poses)
    for k, result in enumerate(of_vertices):
        wp.utils.array_cast(result, arrays[f"of_vertices_{k}"])


def _names(number: int, indices: tuple[int, ...]) -> tuple[str, ...]:
    objects = numbered_renderer(number).scene.objects
    return tuple(objects[index].name for index in indices)
