# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Areas and visible fractions of objects in images, with gradients by antialiased boundaries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
import warp as wp
from torch import Tensor

from warpvis.cameras.base import AnyCamera
from warpvis.core.checks import check_flag
from warpvis.rendering.coverage import COVERAGE_IMAGES, target_indices
from warpvis.rendering.differentiable import check_vertices, numbered_renderer
from warpvis.scene import Scene
from warpvis.torch._arguments import parse_tensors, renderer_number
from warpvis.torch._cast import add_worlds, as_array, as_images, as_inputs, flatten, on_stream


def coverage(
    scene: Scene,
    camera: AnyCamera,
    poses: Tensor,
    names: str | Sequence[str],
    *,
    object_poses: Tensor | None = None,
    world_index: Tensor | None = None,
    vertices: Mapping[str, Tensor] | None = None,
    occluded: bool = True,
) -> Tensor:
    """Return the area of objects in the image of every pose [px], with gradients to poses and vertices.

    It is the number of pixels that see the objects, where pixels at their boundary count in part, by the mesh edge
    between the pixel centers. Gradients flow to the cameras, to the objects, and to the objects that hide them. An
    object that no pixel sees has the gradient 0, and boundaries at which surfaces intersect contribute none.

    Args:
        scene: A scene of meshes, on the device of the tensors.
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
        ArrayError: If a tensor has the wrong shape or dtype or is not on the scene's device.
        CameraError: If the camera is a list of rays.
        SceneError: If the scene has no object of a name, or contains round solids.
    """
    inputs = object_poses, world_index, vertices
    return _measure(*_parse(scene, camera, poses, names, *inputs), check_flag(occluded, "occluded"), False)[0]


def soft_mask(
    scene: Scene,
    camera: AnyCamera,
    poses: Tensor,
    names: str | Sequence[str],
    *,
    object_poses: Tensor | None = None,
    world_index: Tensor | None = None,
    vertices: Mapping[str, Tensor] | None = None,
    occluded: bool = True,
) -> Tensor:
    """Return the share of each pixel that objects cover, with gradients to poses and vertices.

    It is 1 where a pixel sees the objects and 0 elsewhere, except for pixels with a boundary. Its sum is the
    `coverage`, whose arguments and limits it has. Where boundaries of a row and of a column meet, at corners, it may be
    slightly less than 0 or more than 1.

    Returns:
        Masks, ``(V, H, W)`` float32.

    >>> mask = warpvis.torch.soft_mask(scene, camera, poses, "mug")
    >>> loss = 1 - (mask * measured).sum() / (mask + measured - mask * measured).sum()  # intersection over union
    """
    inputs = object_poses, world_index, vertices
    return _measure(*_parse(scene, camera, poses, names, *inputs), check_flag(occluded, "occluded"), True)[0]


def visible_fraction(
    scene: Scene,
    camera: AnyCamera,
    poses: Tensor,
    names: str | Sequence[str],
    *,
    object_poses: Tensor | None = None,
    world_index: Tensor | None = None,
    vertices: Mapping[str, Tensor] | None = None,
) -> Tensor:
    """Return the visible fraction of objects in the image of every pose, with gradients to poses and vertices.

    It is the `coverage` of the objects over their coverage if nothing hid them; parts outside of the image do not
    count. If they are outside or entirely hidden, it is 0 with the gradient 0.

    The arguments are those of `coverage`.

    Returns:
        Fractions, ``(V,)`` float32.

    >>> hidden = 1 - warpvis.torch.visible_fraction(scene, camera, poses, "mug")
    >>> hidden.sum().backward()
    """
    options: dict[str, Any] = {"object_poses": object_poses, "world_index": world_index, "vertices": vertices}
    seen = coverage(scene, camera, poses, names, **options)
    alone = coverage(scene, camera, poses, names, occluded=False, **options)
    return torch.where(alone > 0, seen / torch.where(alone > 0, alone, 1.0), 0.0)


def _parse(
    scene: Scene,
    camera: AnyCamera,
    poses: Tensor,
    names: str | Sequence[str],
    object_poses: Tensor | None,
    world_index: Tensor | None,
    vertices: Mapping[str, Tensor] | None,
) -> tuple[Tensor, Tensor | None, Tensor | None, list[Tensor], list[int], int]:
    """Check the arguments of `coverage`, and return those of the operator."""
    vertices = check_vertices(vertices)
    number = renderer_number(scene, camera, tuple(vertices), "auto", None)
    indices = target_indices(scene, camera, names)
    return *parse_tensors(number, poses, object_poses, world_index, vertices), list(indices), number


@torch.library.custom_op("warpvis::coverage", mutates_args=())
def _measure(
    rows: Tensor,
    object_rows: Tensor | None,
    world_index: Tensor | None,
    vertices: list[Tensor],
    indices: list[int],
    number: int,
    occluded: bool,
    with_mask: bool,
) -> list[Tensor]:
    """Return areas or masks, and the images that gradients are computed from."""
    renderer = numbered_renderer(number)
    shape = len(rows), *renderer.camera.shape
    images = [torch.empty(shape, dtype=torch.int32, device=rows.device) for _ in COVERAGE_IMAGES]
    names = tuple(renderer.scene.objects[index].name for index in indices)
    with on_stream(rows.device):
        inputs, shown = as_inputs(rows, object_rows, world_index, vertices), as_images(COVERAGE_IMAGES, images)
        renderer.render(inputs, shown, only=None if occluded else names)
        if with_mask:
            masks = torch.empty(shape, dtype=torch.float32, device=rows.device)
            renderer.masks(inputs, shown, names, as_array(masks, wp.float32))
            return [masks, *images]
        areas = torch.empty(shape[:1], dtype=torch.float32, device=rows.device)
        renderer.areas(inputs, shown, names, as_array(areas, wp.float32))
        return [areas, *images]


@_measure.register_fake
def _(
    rows: Tensor,
    object_rows: Tensor | None,
    world_index: Tensor | None,
    vertices: list[Tensor],
    indices: list[int],
    number: int,
    occluded: bool,
    with_mask: bool,
) -> list[Tensor]:
    shape = len(rows), *numbered_renderer(number).camera.shape
    images = [rows.new_empty(shape, dtype=torch.int32) for _ in COVERAGE_IMAGES]
    return [rows.new_empty(shape if with_mask else shape[:1]), *images]


@_measure.register_vmap
def _(info: Any, in_dims: tuple[Any, ...], *arguments: Any) -> tuple[list[Tensor], list[int]]:
    *inputs, indices, number, occluded, with_mask = arguments
    results = _measure(*flatten(info, (*in_dims[:4], None), tuple(inputs)), indices, number, occluded, with_mask)
    return [result.unflatten(0, (info.batch_size, -1)) for result in results], [0] * len(results)


@torch.library.custom_op("warpvis::coverage_backward", mutates_args=())
def _measure_backward(
    rows: Tensor,
    object_rows: Tensor | None,
    world_index: Tensor | None,
    vertices: list[Tensor],
    images: list[Tensor],
    of_result: Tensor,
    indices: list[int],
    number: int,
) -> list[Tensor]:
    """Return gradients with respect to the rows of cameras and objects, and to vertices."""
    renderer = numbered_renderer(number)
    names = tuple(renderer.scene.objects[index].name for index in indices)
    with on_stream(rows.device):
        inputs, shown = as_inputs(rows, object_rows, world_index, vertices), as_images(COVERAGE_IMAGES, images)
        views = of_result.to(torch.float64)
        weights = as_array(views if views.ndim == 3 else views[:, None, None], wp.float64)
        found, of_vertices = renderer.area_gradients(inputs, shown, names, weights)
        of_poses = wp.to_torch(found)
        results = [of_poses[:, 0].clone()]
        if object_rows is not None:
            results.append(add_worlds(of_poses[:, 1:], object_rows, world_index))
        return [*results, *(wp.to_torch(array).to(torch.float32) for array in of_vertices)]


@_measure_backward.register_fake
def _(
    rows: Tensor,
    object_rows: Tensor | None,
    world_index: Tensor | None,
    vertices: list[Tensor],
    images: list[Tensor],
    of_result: Tensor,
    indices: list[int],
    number: int,
) -> list[Tensor]:
    return [tensor.new_empty(tensor.shape) for tensor in (rows, object_rows, *vertices) if tensor is not None]


def _save_for_backward(ctx: Any, inputs: tuple[Any, ...], output: list[Tensor]) -> None:
    rows, object_rows, world_index, vertices, ctx.indices, ctx.number, *_ = inputs
    ctx.save_for_backward(rows, object_rows, world_index, *vertices, *output[1:])
    ctx.vertices = len(vertices)


def _backward(ctx: Any, gradients: list[Tensor]) -> tuple[Any, ...]:
    rows, object_rows, world_index, *rest = ctx.saved_tensors
    vertices, images = list(rest[: ctx.vertices]), list(rest[ctx.vertices :])
    results = iter(
        _measure_backward(
            rows, object_rows, world_index, vertices, images, gradients[0].contiguous(), ctx.indices, ctx.number
        )
    )
    of_rows = next(results)
    of_objects = None if object_rows is None else next(results)
    return of_rows, of_objects, None, list(results), None, None, None, None


_measure.register_autograd(_backward, setup_context=_save_for_backward)
