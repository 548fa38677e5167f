# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Renders of tensors with gradients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import torch
import warp as wp
from torch import Tensor
from torch.autograd import forward_ad

from warpvis.cameras import parameter_names
from warpvis.cameras.base import AnyCamera
from warpvis.errors import ArrayError
from warpvis.rendering import CasterName, differentiable
from warpvis.rendering.color_gradients import COLOR_IMAGES
from warpvis.rendering.differentiable import numbered_renderer
from warpvis.scene import Scene
from warpvis.torch._cast import cast, need_gradients, with_needed, zeros
from warpvis.torch._colors import interpolate
from warpvis.torch._poses import as_rows


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
    color: Tensor | None = None
    """Base colors without lighting in sRGB, from 0 to 1, ``(V, H, W, 3)`` float32; the background where nothing is
    seen."""


def render(
    scene: Scene,
    camera: AnyCamera,
    poses: Tensor,
    *,
    object_poses: Tensor | None = None,
    world_index: Tensor | None = None,
    vertices: Mapping[str, Tensor] | None = None,
    intrinsics: Tensor | None = None,
    colors: Mapping[str, Tensor] | None = None,
    outputs: Sequence[str] = ("depth",),
    caster: CasterName = "auto",
    threads: int | None = None,
) -> Images:
    """Render images of every pose; gradients flow to all floating-point tensors.

    Images equal those of `warpvis.render`. The render runs on the tensors' current CUDA stream, without copies to the
    host. It works in `torch.compile` (before PyTorch 2.13, after one call outside), in a CUDA graph after one call
    outside, and under `torch.vmap`.

    Args:
        scene: The scene, on the device of the tensors.
        camera: Any camera or ray pattern.
        poses: Camera to world in the camera's axes, float32: rows ``x y z qx qy qz qw``, ``(V, 7)`` or ``(7,)``, with
            unit quaternions, or matrices, ``(V, 4, 4)`` or ``(4, 4)``. See `apply_twists` for twists.
        object_poses: Poses of the M movable objects in W worlds, rows ``(W, M, 7)`` or ``(M, 7)``, or matrices
            ``(W, M, 4, 4)`` or ``(M, 4, 4)``; by default those with which they were added.
        world_index: World of each view, ``(V,)`` int32; by default view i shows world i, or the only one.
        vertices: Vertices of movable objects in their frames [m], ``(n, 3)``, by name. They replace the vertices of the
            scene, as `Scene.update_vertices` does, also for later renders.
        intrinsics: Parameters of the camera, ``(P,)`` float32 or float64, in the order of
            `warpvis.cameras.parameter_names`: ``fx fy cx cy`` of a pinhole, and coefficients of a lens. They replace
            the camera's own and are read on the host, so that the call waits for the GPU.
        colors: Colors of meshes by name, float32 and in sRGB from 0 to 1: of the vertices, ``(n, 3)``, or a texture at
            the texture coordinates of the object's appearance, ``(h, w, 3)``, the top row first. In the image
            ``"color"``, they replace the object's appearance; they are interpolated as they are, and not clipped.
        outputs: Images to render: ``"depth"``, ``"points"``, ``"normals"``, ``"labels"``, ``"segmentation"``,
            ``"faces"``, ``"color"``. Labels, segmentation and faces are integers, which have no gradients; the gradient
            of ``"color"`` flows to `colors` only, and not to poses and vertices.
        caster: As for `Renderer`.
        threads: As for `Renderer`.

    Raises:
        ArrayError: If a tensor has the wrong shape or dtype or is not on the scene's device.
        PoseError: If poses are malformed, as for `Renderer.render`.
        SceneError: If an object of `colors` is a solid, or has no texture coordinates for a texture.
    """
    names = differentiable.check_image_names(outputs, "color")
    vertices = differentiable.check_vertices(vertices)
    colors = {} if colors is None else colors
    number = _number(scene, camera, tuple(vertices), caster, threads)
    rows = as_rows(poses, "poses", ("V",))
    object_rows = None if object_poses is None else as_rows(object_poses, "object_poses", ("W", "M"))
    _check_world_index(world_index)
    _check_vertices(vertices)
    _check_intrinsics(number, intrinsics)
    inputs = [rows, object_rows, world_index, *vertices.values()]
    _check_colors(colors, names)
    _check_tensors(number, [*inputs, *colors.values()])
    inputs.append(intrinsics)
    rendered = tuple(name for name in names if name != "color")
    if "color" in names:
        rendered = tuple(dict.fromkeys((*rendered, *COLOR_IMAGES)))
    if need_gradients(inputs):
        rendered = with_needed(number, rendered)
    tensors = rows, object_rows, world_index, list(vertices.values()), intrinsics
    images = cast(*tensors, number, ",".join(rendered))
    found = dict(zip(rendered, images, strict=True))
    if "color" in names:
        seen = [found[name].detach() for name in COLOR_IMAGES]
        indices = list(_indices(number, tuple(colors)))
        moved = [None if value is None else value.detach() for value in inputs[:-1]]
        found["color"] = interpolate(*moved[:3], moved[3:], seen, list(colors.values()), indices, number)
    return Images(**{name: found[name] for name in names})


def _number(
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


def _check_tensors(number: int, tensors: Sequence[Tensor | None]) -> None:
    expected = _device_name(number)
    for tensor in tensors:
        if tensor is not None and str(tensor.device) != expected:
            raise ArrayError(f"tensors must be on the scene's device, {expected}, got one on {tensor.device}")
    _check_tangents(tensors)


def _check_tangents(tensors: Sequence[Tensor | None]) -> None:
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


def _check_intrinsics(number: int, intrinsics: Tensor | None) -> None:
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


def _check_colors(colors: Mapping[str, Tensor], names: tuple[str, ...]) -> None:
    if not isinstance(colors, Mapping):
        raise ArrayError(f"colors must be tensors by name of the object, got {type(colors).__name__}")
    if colors and "color" not in names:
        raise ArrayError(f"outputs must contain color if colors are given, got {', '.join(names)}")
    for name, tensor in colors.items():
        if not isinstance(tensor, Tensor):
            raise ArrayError(f"colors[{name!r}] must be a torch.Tensor, got {type(tensor).__name__}")
        if tensor.dtype != torch.float32:
            raise ArrayError(f"colors[{name!r}] must be float32, got {tensor.dtype}")


@torch.compiler.assume_constant_result
def _indices(number: int, names: tuple[str, ...]) -> tuple[int, ...]:
    """Return the indices of objects."""
    return tuple(numbered_renderer(number).scene.index(name) for name in names)
