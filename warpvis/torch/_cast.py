# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The operator `warpvis::cast`: renders of tensors as an operator of PyTorch, with gradients and batches."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import torch
import warp as wp
from torch import Tensor

from warpvis.errors import ArrayError
from warpvis.rendering import differentiable
from warpvis.rendering.differentiable import WITH_GRADIENT, DifferentiableRenderer, Inputs, numbered_renderer

_DTYPES = {"labels": torch.uint8, "albedo": torch.uint8, "segmentation": torch.int32, "faces": torch.int32}


@torch.compiler.assume_constant_result
def with_needed(number: int, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return names of images together with those that gradients need."""
    return tuple(dict.fromkeys((*names, *numbered_renderer(number).needed_images())))


def need_gradients(inputs: Sequence[Any]) -> bool:
    return torch.is_grad_enabled() and any(isinstance(value, Tensor) and value.requires_grad for value in inputs)


def on_stream(device: torch.device) -> AbstractContextManager[Any]:
    """Let Warp use PyTorch's current stream of a GPU."""
    return nullcontext() if device.type == "cpu" else wp.ScopedStream(wp.stream_from_torch(device), sync_enter=False)


def as_array(tensor: Tensor, dtype: Any) -> wp.array:
    # Flattening replaces the strides of axes of length 1, which may be anything.
    rows = tensor.detach().contiguous().flatten().view(tensor.shape)
    return wp.from_torch(rows, dtype=dtype, requires_grad=False)


def zeros(shape: tuple[int, ...], dtype: Any, device: wp.Device) -> wp.array:
    """Allocate an array of Warp from PyTorch's memory.

    PyTorch frees it in the order of its current stream, also while it captures a CUDA graph; Warp frees on the default
    stream, which a capture forbids.
    """
    inner, scalar = getattr(dtype, "_shape_", ()), getattr(dtype, "_wp_scalar_type_", dtype)
    place = wp.device_to_torch(device)
    return wp.from_torch(torch.zeros((*shape, *inner), dtype=wp.dtype_to_torch(scalar), device=place), dtype=dtype)


def as_inputs(
    rows: Tensor, object_rows: Tensor | None, world_index: Tensor | None, vertices: Sequence[Tensor]
) -> Inputs:
    return Inputs(
        as_array(rows, wp.transform),
        None if object_rows is None else as_array(object_rows, wp.transform),
        None if world_index is None else as_array(world_index.to(torch.int32), wp.int32),
        [as_array(tensor, wp.vec3) for tensor in vertices],
    )


def _empty_images(renderer: DifferentiableRenderer, rows: Tensor, names: Sequence[str]) -> list[Tensor]:
    shapes = [differentiable.image_shape(name, len(rows), renderer.camera) for name in names]
    return [
        torch.empty(shape, dtype=_DTYPES.get(name, torch.float32), device=rows.device)
        for name, shape in zip(names, shapes, strict=True)
    ]


def as_images(names: Sequence[str], tensors: Sequence[Tensor]) -> dict[str, wp.array]:
    return {
        name: as_array(tensor, differentiable.pixel_type(name)) for name, tensor in zip(names, tensors, strict=True)
    }


def _renderer(number: int, parameters: Tensor | None) -> DifferentiableRenderer:
    """Return a renderer, of a camera with the given parameters, which are read on the host."""
    renderer = numbered_renderer(number)
    return renderer if parameters is None else renderer.with_parameters(parameters.detach().cpu().double().numpy())


@torch.library.custom_op("warpvis::cast", mutates_args=())
def cast(
    rows: Tensor,
    object_rows: Tensor | None,
    world_index: Tensor | None,
    vertices: list[Tensor],
    parameters: Tensor | None,
    number: int,
    outputs: str,
) -> list[Tensor]:
    """Render the images of these names, separated by commas."""
    renderer, names = _renderer(number, parameters), outputs.split(",")
    images = _empty_images(renderer, rows, names)
    with on_stream(rows.device):
        renderer.render(as_inputs(rows, object_rows, world_index, vertices), as_images(names, images))
    return images


@cast.register_fake
def _(
    rows: Tensor,
    object_rows: Tensor | None,
    world_index: Tensor | None,
    vertices: list[Tensor],
    parameters: Tensor | None,
    number: int,
    outputs: str,
) -> list[Tensor]:
    return _empty_images(numbered_renderer(number), rows, outputs.split(","))


@torch.library.custom_op("warpvis::cast_backward", mutates_args=())
def _cast_backward(
    rows: Tensor,
    object_rows: Tensor | None,
    world_index: Tensor | None,
    vertices: list[Tensor],
    parameters: Tensor | None,
    images: list[Tensor],
    gradients: list[Tensor],
    number: int,
    outputs: str,
    given: str,
) -> list[Tensor]:
    """Return gradients with respect to the rows of cameras and objects, and to vertices.

    `gradients` are those with respect to the images named in `given`.
    """
    renderer = _renderer(number, parameters)
    with on_stream(rows.device):
        inputs = as_inputs(rows, object_rows, world_index, vertices)
        shown, given_gradients = as_images(outputs.split(","), images), as_images(given.split(","), gradients)
        of_poses = wp.to_torch(renderer.pose_gradients(inputs, shown, given_gradients))
        of_parameters = None
        if parameters is not None:
            of_parameters = wp.to_torch(renderer.parameter_gradients(inputs, shown, given_gradients))
        of_vertices = renderer.vertex_gradients(inputs, shown, given_gradients)
    results = [of_poses[:, 0].clone()]
    if object_rows is not None:
        results.append(add_worlds(of_poses[:, 1:], object_rows, world_index))
    if parameters is not None and of_parameters is not None:
        results.append(of_parameters.to(parameters))
    return [*results, *(wp.to_torch(array).to(torch.float32) for array in of_vertices)]


@_cast_backward.register_fake
def _(
    rows: Tensor,
    object_rows: Tensor | None,
    world_index: Tensor | None,
    vertices: list[Tensor],
    parameters: Tensor | None,
    images: list[Tensor],
    gradients: list[Tensor],
    number: int,
    outputs: str,
    given: str,
) -> list[Tensor]:
    shaped = [rows, object_rows, parameters, *vertices]
    return [tensor.new_empty(tensor.shape) for tensor in shaped if tensor is not None]


@cast.register_vmap
def _(info: Any, in_dims: tuple[Any, ...], *arguments: Any) -> tuple[list[Tensor], list[int]]:
    *flat, number, outputs = flatten(info, in_dims, arguments)
    names = tuple(outputs.split(","))
    rendered = names
    if need_gradients(flat):  # tensors in vmap do not tell
        rendered = with_needed(number, names)
    images = cast(*flat, number, ",".join(rendered))[: len(names)]
    return [image.unflatten(0, (info.batch_size, -1)) for image in images], [0] * len(images)


def batch_first(tensor: Tensor, dim: int | None, batches: int) -> Tensor:
    """Return a tensor whose first axis is that of the batch."""
    return tensor.expand(batches, *tensor.shape) if dim is None else tensor.movedim(dim, 0)


def flatten(info: Any, in_dims: tuple[Any, ...], arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the arguments of an operator for the views of all batches, with a world for each."""
    rows, object_rows, world_index, vertices, *rest = arguments
    if in_dims[4] is not None:
        raise ArrayError("intrinsics must be the same for all batches of torch.vmap, since they are read on the host")
    if vertices:
        raise ArrayError("vertices must be None under torch.vmap, since a scene has one shape at a time")
    batches = info.batch_size
    rows = batch_first(rows, in_dims[0], batches)
    views = rows.shape[1]
    if object_rows is None:
        return rows.flatten(0, 1), None, None, vertices, *rest
    worlds = object_rows.shape[0] if in_dims[1] is None else object_rows.movedim(in_dims[1], 0).shape[1]
    if world_index is None:
        world_index = (
            torch.arange(views, device=rows.device) if worlds > 1 else rows.new_zeros(views, dtype=torch.int64)
        )
        world_index = world_index.expand(batches, views)
    else:
        world_index = batch_first(world_index, in_dims[2], batches)
    if in_dims[1] is not None:
        object_rows = object_rows.movedim(in_dims[1], 0).flatten(0, 1)
        world_index = world_index + worlds * torch.arange(batches, device=rows.device)[:, None]
    return rows.flatten(0, 1), object_rows, world_index.flatten(), vertices, *rest


def add_worlds(of_views: Tensor, object_rows: Tensor, world_index: Tensor | None) -> Tensor:
    """Add the gradients ``(V, M, 7)`` of the views of each world."""
    if world_index is not None:
        return torch.zeros_like(object_rows).index_add_(0, world_index.long(), of_views)
    if len(object_rows) == 1:
        return of_views.sum(dim=0, keepdim=True)
    return of_views.clone()


def _save_for_backward(ctx: Any, inputs: tuple[Any, ...], output: list[Tensor]) -> None:
    rows, object_rows, world_index, vertices, parameters, ctx.number, ctx.outputs = inputs
    ctx.save_for_backward(rows, object_rows, world_index, parameters, *vertices, *output)
    ctx.vertices = len(vertices)
    ctx.set_materialize_grads(False)  # None for images that are not in the loss


def _backward(ctx: Any, gradients: list[Tensor]) -> tuple[Any, ...]:
    rows, object_rows, world_index, parameters, *rest = ctx.saved_tensors
    vertices, images = list(rest[: ctx.vertices]), list(rest[ctx.vertices :])
    given = {
        name: gradient
        for name, gradient in zip(ctx.outputs.split(","), gradients, strict=True)
        if name in WITH_GRADIENT and gradient is not None
    }
    inputs = rows, object_rows, world_index, vertices, parameters
    results = iter(_cast_backward(*inputs, images, list(given.values()), ctx.number, ctx.outputs, ",".join(given)))
    of_rows = next(results)
    of_objects = None if object_rows is None else next(results)
    of_parameters = None if parameters is None else next(results)
    return of_rows, of_objects, None, list(results), of_parameters, None, None


cast.register_autograd(_backward, setup_context=_save_for_backward)
