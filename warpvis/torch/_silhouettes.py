# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Masks of pixels next to silhouettes, as tensors."""

from __future__ import annotations

from typing import Any

import torch
import warp as wp
from torch import Tensor

from warpvis.cameras.base import AnyCamera
from warpvis.errors import ArrayError
from warpvis.rendering.differentiable import numbered_renderer, pixel_type
from warpvis.rendering.gradients import NEEDED_IMAGES
from warpvis.scene import Scene
from warpvis.torch._arguments import check_tensors, renderer_number
from warpvis.torch._cast import as_array, batch_first, on_stream
from warpvis.torch._poses import as_rows
from warpvis.torch._render import Images


def silhouette_mask(scene: Scene, camera: AnyCamera, poses: Tensor, images: Images) -> Tensor:
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

    >>> images = warpvis.torch.render(scene, camera, poses, outputs=("depth", "normals", "segmentation"))
    >>> reliable = ~warpvis.torch.silhouette_mask(scene, camera, poses, images)
    """
    if not isinstance(images, Images):
        raise ArrayError(f"images must be warpvis.torch.Images, got {type(images).__name__}")
    rows = as_rows(poses, "poses", ("V",))
    given = [getattr(images, name) for name in NEEDED_IMAGES]
    missing = [name for name, image in zip(NEEDED_IMAGES, given, strict=True) if image is None]
    if missing:
        raise ArrayError(f"images must have {', '.join(NEEDED_IMAGES)}, got none of {', '.join(missing)}")
    number = renderer_number(scene, camera, (), "auto", None)
    check_tensors(number, [rows, *given])
    expected = (len(rows), *camera.shape)
    if any(image.shape[: len(expected)] != expected for image in given):
        got = " and ".join(str(tuple(image.shape)) for image in given)
        raise ArrayError(f"images must have the axes {expected} of poses and camera, got shapes {got}")
    return _mark(rows, given, number).bool()


@torch.library.custom_op("warpvis::silhouettes", mutates_args=())
def _mark(rows: Tensor, images: list[Tensor], number: int) -> Tensor:
    """Return the mask as uint8, given the images that are needed."""
    arrays = {name: as_array(image, pixel_type(name)) for name, image in zip(NEEDED_IMAGES, images, strict=True)}
    with on_stream(rows.device):
        mask = numbered_renderer(number).silhouettes(as_array(rows, wp.transform), arrays)
        return wp.to_torch(mask).clone()


@_mark.register_fake
def _(rows: Tensor, images: list[Tensor], number: int) -> Tensor:
    return images[0].new_empty(images[0].shape, dtype=torch.uint8)


@_mark.register_vmap
def _(info: Any, in_dims: tuple[Any, ...], rows: Tensor, images: list[Tensor], number: int) -> tuple[Tensor, int]:
    tensors = [
        batch_first(tensor, dim, info.batch_size).flatten(0, 1)
        for tensor, dim in zip([rows, *images], [in_dims[0], *in_dims[1]], strict=True)
    ]
    return _mark(tensors[0], tensors[1:], number).unflatten(0, (info.batch_size, -1)), 0
