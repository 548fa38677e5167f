# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Differentiable renders for PyTorch: gradients of depth, points and normals with respect to poses and shapes.

>>> import torch, warpvis.torch
>>> poses = torch.tensor([[0, 0, 0, 0, 0, 0, 1.0]], requires_grad=True)
>>> images = warpvis.torch.render(scene, camera, poses, outputs=("depth", "normals"))
>>> images.depth[images.depth.isfinite()].sum().backward()

Gradients are those of the seen surfaces; silhouettes do not contribute (`silhouette_mask`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any, NamedTuple

import torch
import warp as wp
from torch import Tensor

from warpvis.cameras.base import AnyCamera
from warpvis.errors import ArrayError, PoseError
from warpvis.rendering import differentiable
from warpvis.rendering._choices import CasterName
from warpvis.rendering.differentiable import WITH_GRADIENT, DifferentiableRenderer, Inputs, numbered_renderer
from warpvis.scene import Scene

__all__ = ["Images", "apply_twists", "matrices_to_rows", "render"]

_DTYPES = {"labels": torch.uint8, "segmentation": torch.int32, "faces": torch.int32}


class Images(NamedTuple):
    """Images of V views; those that were not requested are None."""

    depth: Tensor | None = None
    """Depth [m], ``(V, H, W)``; +inf and -inf where none was measured, as in `warpvis.Views`."""
    points: Tensor | None = None
    """Seen points in the world frame [m], ``(V, H, W, 3)``; NaN without depth."""
    normals: Tensor | None = None
    """Unit normals of the seen triangles in the world frame, ``(V, H, W, 3)``; NaN without depth."""
    labels: Tensor | None = None
    """`Label` values, ``(V, H, W)`` uint8."""
    segmentation: Tensor | None = None
    """Indices into the scene's objects, ``(V, H, W)`` int32."""
    faces: Tensor | None = None
    """Indices of the seen triangles in the object's mesh, ``(V, H, W)`` int32."""


def render(
    scene: Scene,
    camera: AnyCamera,
    poses: Tensor,
    *,
    object_poses: Tensor | None = None,
    world_index: Tensor | None = None,
    vertices: Mapping[str, Tensor] | None = None,
    outputs: Sequence[str] = ("depth",),
    caster: CasterName = "auto",
    threads: int | None = None,
) -> Images:
    """Render images of every pose; gradients flow to all floating-point tensors.

    Images equal those of `warpvis.render`. The render runs on the tensors' current CUDA stream, without copies to the
    host. It works in `torch.compile`, in a CUDA graph after one call outside, and under `torch.vmap`.

    Args:
        scene: The scene, on the device of the tensors.
        camera: Any camera or ray pattern.
        poses: Camera to world in the camera's axes, float32: rows ``x y z qx qy qz qw``, ``(V, 7)`` or ``(7,)``, with
            unit quaternions, or matrices, ``(V, 4, 4)`` or ``(4, 4)``. See `apply_twists` for twists.
        object_poses: Poses of the M movable objects in W worlds, rows ``(W, M, 7)`` or ``(M, 7)``, or matrices
            ``(W, M, 4, 4)``; by default those with which they were added.
        world_index: World of each view, ``(V,)`` int32; by default view i shows world i, or the only one.
        vertices: Vertices of movable objects in their frames [m], ``(n, 3)``, by name. They replace the vertices of the
            scene, as `Scene.update_vertices` does, also for later renders.
        outputs: Images to render: ``"depth"``, ``"points"``, ``"normals"``, ``"labels"``, ``"segmentation"``,
            ``"faces"``. The last three are integers, which have no gradients.
        caster: As for `Renderer`.
        threads: As for `Renderer`.

    Raises:
        ArrayError: If a tensor has the wrong shape or dtype or is not on the scene's device.
        PoseError: If poses are malformed, as for `Renderer.render`.
    """
    names = differentiable.check_image_names(outputs)
    vertices = {} if vertices is None else vertices
    number = _number(scene, camera, tuple(vertices), caster, threads)
    rows = _as_rows(poses, "poses", ("V",))
    object_rows = None if object_poses is None else _as_rows(object_poses, "object_poses", ("W", "M"))
    inputs = [rows, object_rows, world_index, *vertices.values()]
    _check_tensors(number, inputs)
    rendered = names
    if _need_gradients(inputs):
        rendered = _with_needed(number, names)
    images = _cast(rows, object_rows, world_index, list(vertices.values()), number, ",".join(rendered))
    return Images(**{name: image for name, image in zip(rendered, images, strict=True) if name in names})


def apply_twists(poses: Tensor, twists: Tensor) -> Tensor:
    """Return poses that are moved by small motions in their own frames.

    Args:
        poses: Rows ``x y z qx qy qz qw``, shape ``(..., 7)``.
        twists: Rotation vectors w [rad] and translations v [m], shape ``(..., 6)``: ``R exp([w]x)`` and ``t + R v``.

    Returns:
        Rows, ``(..., 7)``. At zero, gradients with respect to twists exist.
    """
    if poses.shape[-1] != 7 or twists.shape[-1] != 6:
        raise PoseError(
            f"poses and twists must have shapes (..., 7) and (..., 6), got {tuple(poses.shape)} and "
            f"{tuple(twists.shape)}"
        )
    vector, translation = twists[..., :3], twists[..., 3:]
    angle = torch.linalg.vector_norm(vector, dim=-1, keepdim=True)
    turn = torch.cat([0.5 * torch.sinc(angle / (2 * torch.pi)) * vector, torch.cos(0.5 * angle)], dim=-1)
    rotation = poses[..., 3:]
    moved = poses[..., :3] + _rotate(rotation, translation)
    return torch.cat([moved, _product(rotation, turn)], dim=-1)


def matrices_to_rows(matrices: Tensor) -> Tensor:
    """Return the rows ``x y z qx qy qz qw`` of rigid transforms, shape ``(..., 4, 4)``, with gradients.

    The products of the quaternion's components are linear in the rotation matrix: ``4 q q^T = K``. The row of K with
    the largest diagonal is a multiple of q.
    """
    if matrices.shape[-2:] != (4, 4):
        raise PoseError(f"matrices must have shape (..., 4, 4), got {tuple(matrices.shape)}")
    r = [[matrices[..., i, k] for k in range(3)] for i in range(3)]
    x, y, z = r[0][0] - r[1][1] - r[2][2], r[1][1] - r[0][0] - r[2][2], r[2][2] - r[0][0] - r[1][1]
    xy, xz, yz = r[0][1] + r[1][0], r[0][2] + r[2][0], r[1][2] + r[2][1]
    xw, yw, zw = r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]
    w = r[0][0] + r[1][1] + r[2][2]
    table = [1 + x, xy, xz, xw, xy, 1 + y, yz, yw, xz, yz, 1 + z, zw, xw, yw, zw, 1 + w]
    products = torch.stack(table, dim=-1).reshape(*matrices.shape[:-2], 4, 4)
    largest = torch.diagonal(products, dim1=-2, dim2=-1).argmax(dim=-1)
    chosen = torch.take_along_dim(products, largest[..., None, None].expand(*largest.shape, 1, 4), dim=-2)[..., 0, :]
    quaternion = chosen / torch.linalg.vector_norm(chosen, dim=-1, keepdim=True)
    return torch.cat([matrices[..., :3, 3], quaternion], dim=-1)


def _rotate(q: Tensor, v: Tensor) -> Tensor:
    """Rotate vectors by unit quaternions ``x y z w``."""
    cross = 2 * torch.linalg.cross(q[..., :3], v)
    return v + q[..., 3:] * cross + torch.linalg.cross(q[..., :3], cross)


def _product(p: Tensor, q: Tensor) -> Tensor:
    """Return products of quaternions ``x y z w``."""
    vector = p[..., 3:] * q[..., :3] + q[..., 3:] * p[..., :3] + torch.linalg.cross(p[..., :3], q[..., :3])
    scalar = p[..., 3:] * q[..., 3:] - (p[..., :3] * q[..., :3]).sum(dim=-1, keepdim=True)
    return torch.cat([vector, scalar], dim=-1)


def _as_rows(poses: Tensor, name: str, axes: tuple[str, ...]) -> Tensor:
    """Return poses as rows of the shape ``(*axes, 7)``; the first axis may be missing."""
    if not isinstance(poses, Tensor):
        raise ArrayError(f"{name} must be a torch.Tensor, got {type(poses).__name__}")
    if poses.dtype != torch.float32:
        raise ArrayError(f"{name} must be float32, got {poses.dtype}")
    rows = matrices_to_rows(poses) if poses.ndim > len(axes) and poses.shape[-2:] == (4, 4) else poses
    rows = rows[None] if rows.ndim == len(axes) else rows
    if rows.ndim != len(axes) + 1 or rows.shape[-1] != 7:
        shape = ", ".join(axes)
        raise PoseError(f"{name} must have shape ({shape}, 7) or ({shape}, 4, 4), got {tuple(poses.shape)}")
    return rows


# The numbers are constants of a traced function, which is traced again for another scene or camera.
@torch.compiler.assume_constant_result
def _number(
    scene: Scene, camera: AnyCamera, deforming: tuple[str, ...], caster: CasterName, threads: int | None
) -> int:
    return differentiable.renderer_number(scene, camera, deforming=deforming, caster=caster, threads=threads)


@torch.compiler.assume_constant_result
def _with_needed(number: int, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return names of images together with those that gradients need."""
    return tuple(dict.fromkeys((*names, *numbered_renderer(number).needed_images())))


@torch.compiler.assume_constant_result
def _device_name(number: int) -> str:
    """Return the device of a renderer's scene in PyTorch's words."""
    return str(wp.device_to_torch(numbered_renderer(number).scene.device))


def _need_gradients(inputs: Sequence[Any]) -> bool:
    return torch.is_grad_enabled() and any(isinstance(value, Tensor) and value.requires_grad for value in inputs)


def _check_tensors(number: int, tensors: Sequence[Tensor | None]) -> None:
    expected = _device_name(number)
    for tensor in tensors:
        if tensor is not None and str(tensor.device) != expected:
            raise ArrayError(f"tensors must be on the scene's device, {expected}, got one on {tensor.device}")


def _on_stream(device: torch.device) -> AbstractContextManager[Any]:
    """Let Warp use PyTorch's current stream of a GPU."""
    return nullcontext() if device.type == "cpu" else wp.ScopedStream(wp.stream_from_torch(device), sync_enter=False)


def _as_array(tensor: Tensor, dtype: Any) -> wp.array:
    return wp.from_torch(tensor.detach().contiguous(), dtype=dtype, requires_grad=False)


def _as_inputs(
    rows: Tensor, object_rows: Tensor | None, world_index: Tensor | None, vertices: Sequence[Tensor]
) -> Inputs:
    return Inputs(
        _as_array(rows, wp.transform),
        None if object_rows is None else _as_array(object_rows, wp.transform),
        None if world_index is None else _as_array(world_index.to(torch.int32), wp.int32),
        [_as_array(tensor, wp.vec3) for tensor in vertices],
    )


def _empty_images(renderer: DifferentiableRenderer, rows: Tensor, names: Sequence[str]) -> list[Tensor]:
    shapes = [differentiable.image_shape(name, len(rows), renderer.camera) for name in names]
    return [
        torch.empty(shape, dtype=_DTYPES.get(name, torch.float32), device=rows.device)
        for name, shape in zip(names, shapes, strict=True)
    ]


def _as_images(names: Sequence[str], tensors: Sequence[Tensor]) -> dict[str, wp.array]:
    return {
        name: _as_array(tensor, differentiable.pixel_type(name)) for name, tensor in zip(names, tensors, strict=True)
    }


@torch.library.custom_op("warpvis::cast", mutates_args=())
def _cast(
    rows: Tensor,
    object_rows: Tensor | None,
    world_index: Tensor | None,
    vertices: list[Tensor],
    number: int,
    outputs: str,
) -> list[Tensor]:
    """Render the images of these names, separated by commas."""
    renderer, names = numbered_renderer(number), outputs.split(",")
    images = _empty_images(renderer, rows, names)
    with _on_stream(rows.device):
        renderer.render(_as_inputs(rows, object_rows, world_index, vertices), _as_images(names, images))
    return images


@_cast.register_fake
def _(
    rows: Tensor,
    object_rows: Tensor | None,
    world_index: Tensor | None,
    vertices: list[Tensor],
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
    images: list[Tensor],
    gradients: list[Tensor],
    number: int,
    outputs: str,
    given: str,
) -> list[Tensor]:
    """Return gradients with respect to the rows of cameras and objects, and to vertices.

    `gradients` are those with respect to the images named in `given`.
    """
    renderer = numbered_renderer(number)
    with _on_stream(rows.device):
        inputs = _as_inputs(rows, object_rows, world_index, vertices)
        shown, given_gradients = _as_images(outputs.split(","), images), _as_images(given.split(","), gradients)
        of_poses = wp.to_torch(renderer.pose_gradients(inputs, shown, given_gradients))
        of_vertices = renderer.vertex_gradients(inputs, shown, given_gradients)
    results = [of_poses[:, 0].clone()]
    if object_rows is not None:
        results.append(_add_worlds(of_poses[:, 1:], object_rows, world_index))
    return [*results, *(wp.to_torch(array).to(torch.float32) for array in of_vertices)]


@_cast_backward.register_fake
def _(
    rows: Tensor,
    object_rows: Tensor | None,
    world_index: Tensor | None,
    vertices: list[Tensor],
    images: list[Tensor],
    gradients: list[Tensor],
    number: int,
    outputs: str,
    given: str,
) -> list[Tensor]:
    shaped = [rows, *([] if object_rows is None else [object_rows]), *vertices]
    return [tensor.new_empty(tensor.shape) for tensor in shaped]


@_cast.register_vmap
def _(info: Any, in_dims: tuple[Any, ...], *arguments: Any) -> tuple[list[Tensor], list[int]]:
    *flat, number, outputs = _flatten(info, in_dims, arguments)
    names = tuple(outputs.split(","))
    rendered = names
    if _need_gradients(flat):  # tensors in vmap do not tell
        rendered = _with_needed(number, names)
    images = _cast(*flat, number, ",".join(rendered))[: len(names)]
    return [image.unflatten(0, (info.batch_size, -1)) for image in images], [0] * len(images)


def _batch_first(tensor: Tensor, dim: int | None, batches: int) -> Tensor:
    """Return a tensor whose first axis is that of the batch."""
    return tensor.expand(batches, *tensor.shape) if dim is None else tensor.movedim(dim, 0)


def _flatten(info: Any, in_dims: tuple[Any, ...], arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the arguments of an operator for the views of all batches, with a world for each."""
    rows, object_rows, world_index, vertices, *rest = arguments
    if vertices:
        raise ArrayError("vertices must be None under torch.vmap, since a scene has one shape at a time")
    batches = info.batch_size
    rows = _batch_first(rows, in_dims[0], batches)
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
        world_index = _batch_first(world_index, in_dims[2], batches)
    if in_dims[1] is not None:
        object_rows = object_rows.movedim(in_dims[1], 0).flatten(0, 1)
        world_index = world_index + worlds * torch.arange(batches, device=rows.device)[:, None]
    return rows.flatten(0, 1), object_rows, world_index.flatten(), vertices, *rest


def _add_worlds(of_views: Tensor, object_rows: Tensor, world_index: Tensor | None) -> Tensor:
    """Add the gradients ``(V, M, 7)`` of the views of each world."""
    if world_index is not None:
        return torch.zeros_like(object_rows).index_add_(0, world_index.long(), of_views)
    if len(object_rows) == 1:
        return of_views.sum(dim=0, keepdim=True)
    return of_views.clone()


def _save_for_backward(ctx: Any, inputs: tuple[Any, ...], output: list[Tensor]) -> None:
    rows, object_rows, world_index, vertices, ctx.number, ctx.outputs = inputs
    ctx.save_for_backward(rows, object_rows, world_index, *vertices, *output)
    ctx.vertices = len(vertices)


def _backward(ctx: Any, gradients: list[Tensor]) -> tuple[Any, ...]:
    rows, object_rows, world_index, *rest = ctx.saved_tensors
    vertices, images = list(rest[: ctx.vertices]), list(rest[ctx.vertices :])
    given = {
        name: gradient
        for name, gradient in zip(ctx.outputs.split(","), gradients, strict=True)
        if name in WITH_GRADIENT and gradient is not None
    }
    results = _cast_backward(
        rows, object_rows, world_index, vertices, images, list(given.values()), ctx.number, ctx.outputs, ",".join(given)
    )
    of_objects = None if object_rows is None else results[1]
    return results[0], of_objects, None, results[len(results) - ctx.vertices :], None, None


_cast.register_autograd(_backward, setup_context=_save_for_backward)
