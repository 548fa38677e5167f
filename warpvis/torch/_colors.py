# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The operator `warpvis::colors`: colors of pixels from given colors of objects, with gradients and batches."""

from __future__ import annotations

from typing import Any

import torch
import warp as wp
from torch import Tensor

from warpvis.errors import ArrayError
from warpvis.rendering.color_gradients import COLOR_IMAGES
from warpvis.rendering.differentiable import numbered_renderer
from warpvis.torch._cast import as_array, as_images, as_inputs, batch_first, flatten, on_stream


@torch.library.custom_op("warpvis::colors", mutates_args=())
def interpolate(
    rows: Tensor,
    object_rows: Tensor | None,
    world_index: Tensor | None,
    vertices: list[Tensor],
    images: list[Tensor],
    given: list[Tensor],
    indices: list[int],
    number: int,
) -> Tensor:
    """Return the albedo of a render, from 0 to 1, with the `given` colors of the objects of these indices.

    `images` are those named in `COLOR_IMAGES`. The first four arguments are those of the render.
    """
    renderer, shown = numbered_renderer(number), as_images(COLOR_IMAGES[:3], images[:3])
    renderer.check_colors({index: tuple(tensor.shape) for index, tensor in zip(indices, given, strict=True)})
    result = images[3].to(torch.float32).div_(255.0)
    with on_stream(rows.device):
        colors = {index: as_array(tensor, wp.vec3) for index, tensor in zip(indices, given, strict=True)}
        renderer.interpolate_colors(
            as_inputs(rows, object_rows, world_index, vertices), colors, shown, as_array(result, wp.vec3)
        )
    return result


@interpolate.register_fake
def _(
    rows: Tensor,
    object_rows: Tensor | None,
    world_index: Tensor | None,
    vertices: list[Tensor],
    images: list[Tensor],
    given: list[Tensor],
    indices: list[int],
    number: int,
) -> Tensor:
    return images[3].new_empty(images[3].shape, dtype=torch.float32)


@torch.library.custom_op("warpvis::colors_backward", mutates_args=())
def _interpolate_backward(
    rows: Tensor,
    object_rows: Tensor | None,
    world_index: Tensor | None,
    vertices: list[Tensor],
    images: list[Tensor],
    given: list[Tensor],
    indices: list[int],
    number: int,
    gradient: Tensor,
) -> list[Tensor]:
    """Return gradients with respect to the given colors; `images` are the first three of `COLOR_IMAGES`."""
    shown = as_images(COLOR_IMAGES[:3], images)
    shapes = {index: tuple(tensor.shape[:-1]) for index, tensor in zip(indices, given, strict=True)}
    with on_stream(rows.device):
        sums = numbered_renderer(number).color_gradients(
            as_inputs(rows, object_rows, world_index, vertices), shapes, shown, as_array(gradient, wp.vec3)
        )
    return [wp.to_torch(total).to(torch.float32) for total in sums]


@_interpolate_backward.register_fake
def _(
    rows: Tensor,
    object_rows: Tensor | None,
    world_index: Tensor | None,
    vertices: list[Tensor],
    images: list[Tensor],
    given: list[Tensor],
    indices: list[int],
    number: int,
    gradient: Tensor,
) -> list[Tensor]:
    return [tensor.new_empty(tensor.shape) for tensor in given]


@interpolate.register_vmap
def _(info: Any, in_dims: tuple[Any, ...], *arguments: Any) -> tuple[Tensor, int]:
    rows, object_rows, world_index, vertices, images, given, indices, number = arguments
    if any(dim is not None for dim in in_dims[5]):
        raise ArrayError("colors must be the same for all batches of torch.vmap")
    moved = flatten(info, (*in_dims[:4], None), (rows, object_rows, world_index, vertices))
    views = [
        batch_first(image, dim, info.batch_size).flatten(0, 1) for image, dim in zip(images, in_dims[4], strict=True)
    ]
    return interpolate(*moved, views, given, indices, number).unflatten(0, (info.batch_size, -1)), 0


def _save_for_backward(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
    rows, object_rows, world_index, vertices, images, given, ctx.indices, ctx.number = inputs
    ctx.save_for_backward(rows, object_rows, world_index, *images[:3], *given, *vertices)


def _backward(ctx: Any, gradient: Tensor) -> tuple[Any, ...]:
    rows, object_rows, world_index, *rest = ctx.saved_tensors
    end = 3 + len(ctx.indices)
    images, given, vertices = rest[:3], rest[3:end], rest[end:]
    results = _interpolate_backward(
        rows, object_rows, world_index, vertices, images, given, ctx.indices, ctx.number, gradient
    )
    # Gradients flow to the given colors only.
    return None, None, None, [None] * len(vertices), [None] * len(COLOR_IMAGES), results, None, None


interpolate.register_autograd(_backward, setup_context=_save_for_backward)
