# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Arguments of renders of tensors, checked, and the numbers of renderers, which are constants of traced functions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import torch
import warp as wp
from torch import Tensor
from torch.autograd import forward_ad

from warpvis.cameras import parameter_names
from warpvis.cameras.base import AnyCamera
from warpvis.errors import ArrayError
from warpvis.rendering import CasterName, differentiable
from warpvis.rendering.differentiable import numbered_renderer
from warpvis.scene import Scene
from warpvis.torch._cast import zeros
from warpvis.torch._poses import as_rows


def renderer_number(
    scene: Scene, camera: AnyCamera, deforming: tuple[str, ...], caster: CasterName, threads: int | None
) -> int:
    """Return the number of a renderer, which is a constant of traced functions.

    They are traced again for another scene or camera. Before version 2.13, PyTorch cannot call a function of objects
    while it traces, but it can look up what a call before has made.
    """
    if not _TRACES_OBJECTS and torch.compiler.is_compiling():
        return int(scene.numbers_of_renderers[id(camera), deforming, caster, threads])
    return _make_number(scene, camera, deforming, caster, threads)


_TRACES_OBJECTS = tuple(int(part) for part in torch.__version__.split(".")[:2]) >= (2, 13)


@torch.compiler.assume_constant_result
def _make_number(
    scene: Scene, camera: AnyCamera, deforming: tuple[str, ...], caster: CasterName, threads: int | None
) -> int:
    options = {"deforming": deforming, "caster": caster, "threads": threads}
    number = differentiable.renderer_number(scene, camera, **options, zeros=zeros)
    scene.numbers_of_renderers[id(camera), deforming, caster, threads] = str(number)  # a number would become a symbol
    return number


@torch.compiler.assume_constant_result
def _device_name(number: int) -> str:
    """Return the device of a renderer's scene in PyTorch's words."""
    return str(wp.device_to_torch(numbered_renderer(number).scene.device))


def parse_tensors(
    number: int,
    poses: Tensor,
    object_poses: Tensor | None,
    world_index: Tensor | None,
    vertices: Mapping[str, Tensor],
) -> tuple[Tensor, Tensor | None, Tensor | None, list[Tensor]]:
    """Return the rows of cameras and objects, the worlds and the vertices of a render, checked."""
    rows = as_rows(poses, "poses", ("V",))
    object_rows = None if object_poses is None else as_rows(object_poses, "object_poses", ("W", "M"))
    _check_world_index(world_index)
    _check_vertices(vertices)
    check_tensors(number, [rows, object_rows, world_index, *vertices.values()])
    return rows, object_rows, world_index, list(vertices.values())


def check_tensors(number: int, tensors: Iterable[Tensor | None]) -> None:
    """Check that tensors are on the scene's device, and have no tangents."""
    tensors = list(tensors)
    expected = _device_name(number)
    for tensor in tensors:
        if tensor is not None and str(tensor.device) != expected:
            raise ArrayError(f"tensors must be on the scene's device, {expected}, got one on {tensor.device}")
    _check_tangents(tensors)


def _check_tangents(tensors: list[Tensor | None]) -> None:
    """Refuse forward-mode derivatives: PyTorch drops them in custom operators, as if they were 0."""
    if torch.compiler.is_compiling():
        return
    for tensor in tensors:
        if tensor is not None and tensor.is_floating_point() and forward_ad.unpack_dual(tensor).tangent is not None:
            raise ArrayError(
                "tensors must have no tangents, as in torch.func.jvp and jacfwd: renders have no forward-mode "
                "derivatives; use torch.autograd.grad"
            )


def _check_world_index(world_index: Tensor | None) -> None:
    if world_index is None:
        return
    if not isinstance(world_index, Tensor) or world_index.dtype not in (torch.int32, torch.int64):
        got = world_index.dtype if isinstance(world_index, Tensor) else type(world_index).__name__
        raise ArrayError(f"world_index must be a torch.Tensor of int32, got {got}")


def _check_vertices(vertices: Mapping[str, Tensor]) -> None:
    for name, tensor in vertices.items():
        if not isinstance(tensor, Tensor) or tensor.dtype != torch.float32 or tensor.shape[1:] != (3,):
            got = f"{tensor.dtype} of shape {tuple(tensor.shape)}" if isinstance(tensor, Tensor) else type(tensor)
            raise ArrayError(f"vertices of {name!r} must be a float32 torch.Tensor of shape (n, 3), got {got}")


def check_intrinsics(number: int, intrinsics: Tensor | None) -> None:
    """Check the parameters of the camera."""
    if intrinsics is None:
        return
    names = _parameter_names(number)
    if not names:
        raise ArrayError("intrinsics must be None for a camera without parameters, such as a list of rays")
    if not isinstance(intrinsics, Tensor) or not intrinsics.is_floating_point() or intrinsics.shape != (len(names),):
        is_tensor = isinstance(intrinsics, Tensor)
        got = f"{intrinsics.dtype} {tuple(intrinsics.shape)}" if is_tensor else type(intrinsics).__name__
        raise ArrayError(f"intrinsics must be a torch.Tensor of the {len(names)} numbers {', '.join(names)}, got {got}")
    if str(intrinsics.device) not in ("cpu", _device_name(number)):
        places = " or ".join(dict.fromkeys(["cpu", _device_name(number)]))
        raise ArrayError(f"intrinsics must be on {places}, got a tensor on {intrinsics.device}")
    _check_tangents([intrinsics])


@torch.compiler.assume_constant_result
def _parameter_names(number: int) -> tuple[str, ...]:
    return parameter_names(numbered_renderer(number).camera)
