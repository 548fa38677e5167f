# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Renders of JAX arrays with gradients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from warpvis.cameras.base import AnyCamera
from warpvis.errors import ArrayError
from warpvis.jax._arguments import as_array, parse_arrays
from warpvis.jax._batches import add_worlds, cast, parameter_gradients, pose_gradients, vertex_gradients
from warpvis.jax._colors import interpolate
from warpvis.jax._foreign import Arrays
from warpvis.rendering import CasterName, differentiable
from warpvis.rendering.color_gradients import COLOR_IMAGES
from warpvis.rendering.differentiable import WITH_GRADIENT, numbered_renderer
from warpvis.scene import Scene


class Images(NamedTuple):
    """Images of V views; those that were not requested are None."""

    depth: Array | None = None
    """Depth [m], ``(V, H, W)``; +inf and -inf where none was measured, as in `warpvis.Views`."""
    points: Array | None = None
    """Seen points in the world frame [m], ``(V, H, W, 3)``; NaN without depth."""
    normals: Array | None = None
    """Unit normals of the seen triangles in the world frame, ``(V, H, W, 3)``; NaN without depth."""
    labels: Array | None = None
    """`Label` values, ``(V, H, W)`` uint8."""
    segmentation: Array | None = None
    """Indices into the scene's objects, ``(V, H, W)`` int32."""
    faces: Array | None = None
    """Indices of the seen triangles in the object's mesh, ``(V, H, W)`` int32."""
    color: Array | None = None
    """Base colors without lighting in sRGB, from 0 to 1, ``(V, H, W, 3)`` float32; the background where nothing is
    seen."""


def render(
    scene: Scene,
    camera: AnyCamera,
    poses: ArrayLike,
    *,
    object_poses: ArrayLike | None = None,
    world_index: ArrayLike | None = None,
    vertices: Mapping[str, ArrayLike] | None = None,
    intrinsics: ArrayLike | None = None,
    colors: Mapping[str, ArrayLike] | None = None,
    outputs: Sequence[str] = ("depth",),
    caster: CasterName = "auto",
    threads: int | None = None,
) -> Images:
    """Render images of every pose; gradients flow to all floating-point arrays.

    Images equal those of `warpvis.render`. The render runs on XLA's stream, without copies to the host. It works in
    `jax.jit`, `jax.grad`, `jax.checkpoint`, `jax.lax.scan` and `jax.vmap`, which renders the views of a batch at once,
    or one after the other if vertices, intrinsics or colors are batched. Forward-mode and second derivatives are not
    defined. The scene and the camera are constants of traced functions.

    Args:
        scene: The scene, on the device of the arrays.
        camera: Any camera or ray pattern.
        poses: Camera to world in the camera's axes: rows ``x y z qx qy qz qw``, ``(V, 7)`` or ``(7,)``, with unit
            quaternions, or matrices, ``(V, 4, 4)`` or ``(4, 4)``. See `apply_twists` for twists.
        object_poses: Poses of the M movable objects in W worlds, rows ``(W, M, 7)`` or ``(M, 7)``, or matrices
            ``(W, M, 4, 4)`` or ``(M, 4, 4)``; by default those with which they were added.
        world_index: World of each view, ``(V,)`` int32; by default view i shows world i, or the only one.
        vertices: Vertices of movable objects in their frames [m], ``(n, 3)``, by name. They replace the vertices of the
            scene, as `Scene.update_vertices` does, also for later renders.
        intrinsics: Parameters of the camera, ``(P,)``, in the order of `warpvis.cameras.parameter_names`: ``fx fy cx
            cy`` of a pinhole, and coefficients of a lens. They replace the camera's own and are read on the host, so
            that the render waits for the GPU.
        colors: Colors of meshes by name, in sRGB from 0 to 1: of the vertices, ``(n, 3)``, or a texture at the texture
            coordinates of the object's appearance, ``(h, w, 3)``, the top row first. In the image ``"color"``, they
            replace the object's appearance; they are interpolated as they are, and not clipped.
        outputs: Images to render: ``"depth"``, ``"points"``, ``"normals"``, ``"labels"``, ``"segmentation"``,
            ``"faces"``, ``"color"``. Labels, segmentation and faces are integers, which have no gradients; the gradient
            of ``"color"`` flows to `colors` only, and not to poses and vertices.
        caster: As for `Renderer`.
        threads: As for `Renderer`.

    Raises:
        ArrayError: If an array has the wrong shape or dtype or is not on the scene's device.
        PoseError: If poses are malformed, as for `Renderer.render`. Values of traced arrays on the CPU are checked when
            the function runs, and JAX raises an error with the same sentence.
        SceneError: If an object of `colors` is a solid, or has no texture coordinates for a texture.
    """
    names = differentiable.check_image_names(outputs, "color")
    vertices = differentiable.check_vertices(vertices)
    number = differentiable.renderer_number(scene, camera, deforming=tuple(vertices), caster=caster, threads=threads)
    arrays = parse_arrays(scene, camera, poses, object_poses, world_index, vertices, intrinsics)
    given = _parse_colors(number, {} if colors is None else colors, names)
    rendered = tuple(name for name in names if name != "color")
    if "color" not in names:
        return Images(**_render(number, rendered, rendered, arrays))
    images = _render(number, rendered, tuple(dict.fromkeys((*rendered, *COLOR_IMAGES))), arrays)
    seen = {name: images[name] for name in COLOR_IMAGES}
    constant = jax.lax.stop_gradient((arrays._replace(intrinsics=None), seen))
    color = interpolate(number, tuple(given), *constant, tuple(given.values()))
    return Images(color=color, **{name: images[name] for name in rendered})


def _parse_colors(number: int, colors: Mapping[str, ArrayLike], names: tuple[str, ...]) -> dict[int, Array]:
    """Return given colors by index of the object, checked."""
    if not isinstance(colors, Mapping):
        raise ArrayError(f"colors must be arrays by name of the object, got {type(colors).__name__}")
    if colors and "color" not in names:
        raise ArrayError(f"outputs must contain color if colors are given, got {', '.join(names)}")
    renderer = numbered_renderer(number)
    scene = renderer.scene
    arrays = {
        scene.index(name): as_array(value, f"colors[{name!r}]", jnp.float32, scene) for name, value in colors.items()
    }
    renderer.check_colors({index: array.shape for index, array in arrays.items()})
    return arrays


@partial(jax.custom_vjp, nondiff_argnums=(0, 1, 2))
def _render(number: int, requested: tuple[str, ...], names: tuple[str, ...], arrays: Arrays) -> dict[str, Array]:
    """Return images by name; gradients are those of the `requested` ones."""
    return cast(number, names, arrays)


def _forward(
    number: int, requested: tuple[str, ...], names: tuple[str, ...], arrays: Arrays
) -> tuple[dict[str, Array], tuple[Arrays, dict[str, Array]]]:
    """Render the images, and those that gradients need."""
    needed = numbered_renderer(number).needed_images()
    images = cast(number, tuple(dict.fromkeys((*names, *needed))), arrays)
    return {name: images[name] for name in names}, (arrays, {name: images[name] for name in needed})


def _backward(
    number: int,
    requested: tuple[str, ...],
    names: tuple[str, ...],
    saved: tuple[Arrays, dict[str, Array]],
    gradients: dict[str, Array],
) -> tuple[Arrays]:
    """Return gradients with respect to the arrays. XLA removes calls whose results are not used."""
    arrays, images = saved
    given = {name: gradients[name] for name in requested if name in WITH_GRADIENT}
    if not given:
        return (jax.tree.map(lambda array: None, arrays),)
    numbered_renderer(number).check_normals(given)
    of_poses = pose_gradients(number, arrays._replace(vertices=()), images, given)
    of_objects = None
    if arrays.object_poses is not None:
        of_objects = add_worlds(of_poses[:, 1:], arrays.object_poses, arrays.world_index)
    of_vertices = vertex_gradients(number, arrays, images, given) if arrays.vertices else ()
    of_intrinsics = None
    if arrays.intrinsics is not None:
        of_intrinsics = parameter_gradients(number, arrays._replace(vertices=()), images, given)
    return (Arrays(of_poses[:, 0], of_objects, None, of_vertices, of_intrinsics),)


_render.defvjp(_forward, _backward)
