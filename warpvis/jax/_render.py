# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Renders of JAX arrays with gradients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import warp as wp
from jax import Array
from jax.typing import ArrayLike

from warpvis.cameras import parameter_names
from warpvis.cameras.base import AnyCamera
from warpvis.core.poses import host_poses
from warpvis.errors import ArrayError, PoseError
from warpvis.jax._batches import cast, parameter_gradients, pose_gradients, vertex_gradients
from warpvis.jax._foreign import Arrays
from warpvis.jax._poses import matrices_to_rows
from warpvis.rendering import CasterName, differentiable
from warpvis.rendering.differentiable import WITH_GRADIENT, numbered_renderer
from warpvis.scene import Scene
from warpvis.scene.worlds import parse_worlds


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


def render(
    scene: Scene,
    camera: AnyCamera,
    poses: ArrayLike,
    *,
    object_poses: ArrayLike | None = None,
    world_index: ArrayLike | None = None,
    vertices: Mapping[str, ArrayLike] | None = None,
    intrinsics: ArrayLike | None = None,
    outputs: Sequence[str] = ("depth",),
    caster: CasterName = "auto",
    threads: int | None = None,
) -> Images:
    """Render images of every pose; gradients flow to all floating-point arrays.

    Images equal those of `warpvis.render`. The render runs on XLA's stream, without copies to the host. It works in
    `jax.jit`, `jax.grad`, `jax.checkpoint`, `jax.lax.scan` and `jax.vmap`, which renders the views of a batch at once,
    or one after the other if vertices are batched. Forward-mode and second derivatives are not defined. The scene and
    the camera are constants of traced functions.

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
        outputs: Images to render: ``"depth"``, ``"points"``, ``"normals"``, ``"labels"``, ``"segmentation"``,
            ``"faces"``. The last three are integers, which have no gradients.
        caster: As for `Renderer`.
        threads: As for `Renderer`.

    Raises:
        ArrayError: If an array has the wrong shape or dtype or is not on the scene's device.
        PoseError: If poses are malformed, as for `Renderer.render`. Values of traced arrays on the CPU are checked when
            the function runs, and JAX raises an error with the same sentence.
    """
    names = differentiable.check_image_names(outputs)
    vertices = {} if vertices is None else vertices
    number = differentiable.renderer_number(scene, camera, deforming=tuple(vertices), caster=caster, threads=threads)
    rows = _as_rows(poses, "poses", 1, scene)
    arrays = Arrays(
        rows[None] if rows.ndim == 1 else rows,
        None if object_poses is None else _as_object_rows(object_poses, scene),
        None if world_index is None else _as_array(world_index, "world_index", jnp.int32, scene),
        tuple(_as_array(value, f"vertices[{name!r}]", jnp.float32, scene) for name, value in vertices.items()),
        None if intrinsics is None else _as_array(intrinsics, "intrinsics", jnp.float32, scene),
    )
    _check(scene, camera, arrays, tuple(vertices))
    return Images(**_render(number, names, arrays))


def _as_array(value: ArrayLike, name: str, dtype: Any, scene: Scene) -> Array:
    """Return an array of a dtype; JAX arrays must be on the scene's device, others are copied to it."""
    try:
        if isinstance(value, Array):
            array = value
        else:
            array = jnp.asarray(value, device=wp.device_to_jax(scene.device))
    except (TypeError, ValueError, RuntimeError) as error:
        raise ArrayError(f"{name} must be an array of numbers on {scene.device}: {error}") from None
    expected = jnp.integer if dtype == jnp.int32 else jnp.floating
    if not jnp.issubdtype(array.dtype, expected):
        raise ArrayError(f"{name} must be {dtype.__name__}, got {array.dtype}")
    if not isinstance(array, jax.core.Tracer):
        devices = array.devices()
        if any(_warp_device(device) != scene.device for device in devices):
            listed = ", ".join(sorted(str(device) for device in devices))
            raise ArrayError(f"{name} must be on the scene's device, {scene.device}, got an array on {listed}")
    return array.astype(dtype)


def _warp_device(device: Any) -> wp.Device | None:
    """Return Warp's name of one of JAX's devices; None if Warp does not support it."""
    try:
        return wp.device_from_jax(device)
    except (RuntimeError, IndexError):
        return None


def _as_rows(poses: ArrayLike, name: str, axes: int, scene: Scene) -> Array:
    """Return poses as rows of at most `axes` leading axes."""
    array = _as_array(poses, name, jnp.float32, scene)
    if array.shape[-2:] == (4, 4):
        array = matrices_to_rows(array)
    elif array.shape[-1:] != (7,):
        raise PoseError(f"{name} must be rows of 7 numbers or matrices of shape (4, 4), got shape {array.shape}")
    if array.ndim not in (axes, axes + 1):
        raise PoseError(f"{name} must have {axes - 1} or {axes} axes before those of a pose, got shape {array.shape}")
    return array


def _as_object_rows(object_poses: ArrayLike, scene: Scene) -> Array:
    rows = _as_rows(object_poses, "object_poses", 2, scene)
    rows = rows[None] if rows.ndim == 2 else rows
    if not scene.movable or rows.shape[1] != len(scene.movable):
        raise PoseError(
            f"object_poses must be those of the {len(scene.movable)} movable objects in each world, "
            f"got shape {rows.shape}"
        )
    return rows


def _check(scene: Scene, camera: AnyCamera, arrays: Arrays, deforming: Sequence[str]) -> None:
    """Check shapes, and the values of arrays on the CPU that are not traced."""
    views = len(arrays.poses)
    worlds = 1 if arrays.object_poses is None else len(arrays.object_poses)
    if arrays.world_index is not None and arrays.world_index.shape != (views,):
        raise ArrayError(f"world_index must have shape ({views},), got {arrays.world_index.shape}")
    if arrays.world_index is None and worlds not in (1, views):
        raise ArrayError(f"object_poses have {worlds} worlds for {views} views; give world_index= for each view")
    for name, vertices in zip(deforming, arrays.vertices, strict=True):
        expected = scene.objects[scene.index(name)].vertices.shape
        if vertices.shape != expected:
            raise ArrayError(f"vertices[{name!r}] must have shape {expected}, got {vertices.shape}")
    if arrays.intrinsics is not None:
        names = parameter_names(camera)
        if not names:
            raise ArrayError("intrinsics must be None for a camera without parameters, such as a list of rays")
        if arrays.intrinsics.shape != (len(names),):
            raise ArrayError(
                f"intrinsics must be the {len(names)} numbers {', '.join(names)}, got shape {arrays.intrinsics.shape}"
            )
    if scene.device.is_cpu:
        known = jax.tree.map(lambda array: None if isinstance(array, jax.core.Tracer) else np.asarray(array), arrays)
        if known.poses is not None:
            host_poses(known.poses, camera.axes, axes=camera.axes, name="poses")
        if known.object_poses is not None and (arrays.world_index is None or known.world_index is not None):
            parse_worlds(scene, views, known.object_poses, known.world_index, None)


@partial(jax.custom_vjp, nondiff_argnums=(0, 1))
def _render(number: int, names: tuple[str, ...], arrays: Arrays) -> dict[str, Array]:
    return cast(number, names, arrays)


def _forward(
    number: int, names: tuple[str, ...], arrays: Arrays
) -> tuple[dict[str, Array], tuple[Arrays, dict[str, Array]]]:
    """Render the images, and those that gradients need."""
    needed = numbered_renderer(number).needed_images()
    images = cast(number, tuple(dict.fromkeys((*names, *needed))), arrays)
    return {name: images[name] for name in names}, (arrays, {name: images[name] for name in needed})


def _backward(
    number: int, names: tuple[str, ...], saved: tuple[Arrays, dict[str, Array]], gradients: dict[str, Array]
) -> tuple[Arrays]:
    """Return gradients with respect to the arrays. XLA removes calls whose results are not used."""
    arrays, images = saved
    given = {name: gradients[name] for name in names if name in WITH_GRADIENT}
    if not given:
        return (jax.tree.map(lambda array: None, arrays),)
    numbered_renderer(number).check_normals(given)
    of_poses = pose_gradients(number, arrays._replace(vertices=()), images, given)
    of_objects = None
    if arrays.object_poses is not None:
        of_objects = _add_worlds(of_poses[:, 1:], arrays.object_poses, arrays.world_index)
    of_vertices = vertex_gradients(number, arrays, images, given) if arrays.vertices else ()
    of_intrinsics = None
    if arrays.intrinsics is not None:
        of_intrinsics = parameter_gradients(number, arrays._replace(vertices=()), images, given)
    return (Arrays(of_poses[:, 0], of_objects, None, of_vertices, of_intrinsics),)


_render.defvjp(_forward, _backward)


def _add_worlds(of_views: Array, object_poses: Array, world_index: Array | None) -> Array:
    """Add the gradients ``(V, M, 7)`` of the views of each world."""
    if world_index is not None:
        return jnp.zeros_like(object_poses).at[world_index].add(of_views)
    return of_views.sum(axis=0, keepdims=True) if len(object_poses) == 1 else of_views
