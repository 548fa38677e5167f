# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Masks of pixels next to silhouettes, as JAX arrays."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import warp as wp
from jax import Array
from jax.custom_batching import custom_vmap
from jax.typing import ArrayLike

from warpvis.cameras.base import AnyCamera
from warpvis.errors import ArrayError, CameraError
from warpvis.jax._arguments import as_array, as_rows
from warpvis.jax._batches import join_images
from warpvis.jax._foreign import Arrays, call_foreign, image_inputs, split_arrays
from warpvis.jax._render import Images
from warpvis.rendering.differentiable import image_shape, numbered_renderer, renderer_number
from warpvis.rendering.gradients import NEEDED_IMAGES
from warpvis.scene import Scene


def silhouette_mask(scene: Scene, camera: AnyCamera, poses: ArrayLike, images: Images) -> Array:
    """Return the mask of pixels next to silhouettes, where gradients of images miss what a motion covers or uncovers.

    A pixel is marked if one of its eight neighbors hits nothing where it hits a surface, or vice versa, or sees another
    object, or a surface that is not connected to its own. Neighbors are those in the image: columns at opposite borders
    of a panorama are not. If a small motion displaces the image by less than a pixel, only marked pixels see another
    surface afterwards.

    Args:
        scene: The scene.
        camera: A camera with an image, not a list of rays.
        poses: Poses of the render.
        images: Its images, with ``depth``, ``normals`` and ``segmentation``.

    Returns:
        Flags, ``(V, H, W)`` bool.

    Raises:
        ArrayError: If an image is missing or does not fit the camera or the poses.
        CameraError: If the camera is a list of rays.

    >>> images = warpvis.jax.render(scene, camera, poses, outputs=("depth", "normals", "segmentation"))
    >>> reliable = ~warpvis.jax.silhouette_mask(scene, camera, poses, images)
    """
    if not isinstance(images, Images):
        raise ArrayError(f"images must be warpvis.jax.Images, got {type(images).__name__}")
    number = renderer_number(scene, camera, deforming=(), caster="auto", threads=None)
    rows = as_rows(poses, "poses", 1, scene)
    rows = rows[None] if rows.ndim == 1 else rows
    missing = [name for name in NEEDED_IMAGES if getattr(images, name) is None]
    if missing:
        raise ArrayError(f"images must have {', '.join(NEEDED_IMAGES)}, got none of {', '.join(missing)}")
    dtypes = {"segmentation": jnp.int32}
    given = {
        name: as_array(getattr(images, name), f"images.{name}", dtypes.get(name, jnp.float32), scene)
        for name in NEEDED_IMAGES
    }
    if any(image.shape != image_shape(name, len(rows), camera) for name, image in given.items()):
        got = " and ".join(str(image.shape) for image in given.values())
        expected = (len(rows), *camera.shape)
        raise ArrayError(f"images must have the axes {expected} of poses and camera, got shapes {got}")
    if len(camera.shape) == 1:
        raise CameraError("camera must have pixels with neighbors for a mask of silhouettes, got a list of rays")
    return _mark(number, *jax.lax.stop_gradient((rows, given))).astype(bool)


@partial(jax.jit, static_argnums=0)
def _mark(number: int, rows: Array, images: dict[str, Array]) -> Array:
    """Return the mask as uint8, given the images that are needed."""

    @custom_vmap
    def one(rows: Array, images: dict[str, Array]) -> Array:
        return _call_mark(number, rows, images)

    @one.def_vmap
    def batch(size: int, batched: Any, *args: Any) -> tuple[Array, bool]:
        mask = _mark(number, *join_images(size, batched, list(args)))
        return mask.reshape(size, -1, *mask.shape[1:]), True

    return one(rows, images)


def _call_mark(number: int, rows: Array, images: dict[str, Array]) -> Array:
    inputs = image_inputs(number, Arrays(rows, None, None, ()), images)
    shape = images["depth"].shape
    return call_foreign(_write_mask, number, inputs, (("mask", wp.uint8, len(shape)),), {"mask": shape})[0]


def _write_mask(number: int, arrays: dict[str, wp.array]) -> None:
    inputs, images, _ = split_arrays(arrays)
    wp.copy(arrays["mask"], numbered_renderer(number).silhouettes(inputs.poses, images))
