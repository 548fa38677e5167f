# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Renders of tensors with gradients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from warpvis.cameras.base import AnyCamera
from warpvis.errors import ArrayError
from warpvis.rendering import CasterName, differentiable
from warpvis.rendering.color_gradients import COLOR_IMAGES
from warpvis.rendering.differentiable import numbered_renderer
from warpvis.scene import Scene
from warpvis.torch._arguments import check_intrinsics, check_tensors, parse_tensors, renderer_number
from warpvis.torch._cast import cast, need_gradients, with_needed
from warpvis.torch._colors import interpolate


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
    number = renderer_number(scene, camera, tuple(vertices), caster, threads)
    tensors = parse_tensors(number, poses, object_poses, world_index, vertices)
    check_intrinsics(number, intrinsics)
    _check_colors(colors, names)
    check_tensors(number, colors.values())
    inputs = [*tensors[:3], *tensors[3]]
    rendered = tuple(name for name in names if name != "color")
    if "color" in names:
        rendered = tuple(dict.fromkeys((*rendered, *COLOR_IMAGES)))
    if need_gradients([*inputs, intrinsics]):
        rendered = with_needed(number, rendered)
    images = cast(*tensors, intrinsics, number, ",".join(rendered))
    found = dict(zip(rendered, images, strict=True))
    if "color" in names:
        seen = [found[name].detach() for name in COLOR_IMAGES]
        indices = list(_indices(number, tuple(colors)))
        moved = [None if value is None else value.detach() for value in inputs]
        found["color"] = interpolate(*moved[:3], moved[3:], seen, list(colors.values()), indices, number)
    return Images(**{name: found[name] for name in names})


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
