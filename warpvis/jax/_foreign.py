# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Renders and their gradients as functions of XLA's foreign function interface."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from jax import Array

from warpvis.rendering import differentiable
from warpvis.rendering.differentiable import (
    WITH_GRADIENT,
    WITHOUT_GRADIENT,
    DifferentiableRenderer,
    Inputs,
    numbered_renderer,
)

Spec = tuple[tuple[str, Any, int], ...]
"""Names, dtypes and numbers of axes of arrays."""

_streams: dict[str, wp.Stream] = {}
"""Warp's streams of GPUs, by the names of devices."""


class Arrays(NamedTuple):
    """The arrays that a render depends on; see `Inputs`."""

    poses: Array
    object_poses: Array | None
    world_index: Array | None
    vertices: tuple[Array, ...]
    intrinsics: Array | None = None


def call_cast(number: int, names: tuple[str, ...], arrays: Arrays) -> dict[str, Array]:
    camera, views = numbered_renderer(number).camera, len(arrays.poses)
    given = _named(arrays)
    shapes = dict.fromkeys(names, (views, *camera.shape))
    outputs = tuple((name, differentiable.pixel_type(name), 1 + len(camera.shape)) for name in names)
    results = call_foreign(_write_images, number, (_input_spec(arrays), given), outputs, shapes)
    return dict(zip(names, results, strict=True))


def call_pose_gradients(number: int, arrays: Arrays, images: dict[str, Array], gradients: dict[str, Array]) -> Array:
    renderer = numbered_renderer(number)
    inputs = image_inputs(number, arrays, images, gradients)
    shape = len(arrays.poses), 1 + len(renderer.scene.movable)
    outputs = (("of_poses", wp.transform, 2),)
    return call_foreign(_write_pose_gradients, number, inputs, outputs, {"of_poses": shape})[0]


def call_vertex_gradients(
    number: int, arrays: Arrays, images: dict[str, Array], gradients: dict[str, Array]
) -> tuple[Array, ...]:
    inputs = image_inputs(number, arrays, images, gradients)
    shapes = {f"of_vertices_{k}": (len(vertices),) for k, vertices in enumerate(arrays.vertices)}
    outputs = tuple((name, wp.vec3, 1) for name in shapes)
    return tuple(call_foreign(_write_vertex_gradients, number, inputs, outputs, shapes))


def call_parameter_gradients(
    number: int, arrays: Arrays, images: dict[str, Array], gradients: dict[str, Array]
) -> Array:
    """Return gradients with respect to the camera's parameters, ``(P,)``."""
    inputs = image_inputs(number, arrays, images, gradients)
    outputs, shapes = (("of_intrinsics", wp.float32, 1),), {"of_intrinsics": inputs[1]["intrinsics"].shape}
    return call_foreign(_write_parameter_gradients, number, inputs, outputs, shapes)[0]


def call_foreign(
    function: Callable[..., None],
    number: int,
    inputs: tuple[Spec, dict[str, Array]],
    outputs: Spec,
    shapes: Mapping[str, tuple[int, ...]],
    *options: Hashable,
) -> Sequence[Array]:
    """Return the outputs of a foreign function; shapes are without the components of vectors.

    The function is called with the number of the renderer, the arrays by name, and the options.
    """
    device = numbered_renderer(number).scene.device
    if device.is_cuda:
        _streams.setdefault(device.alias, device.stream)
    types, arrays = inputs
    return _foreign(function, types, outputs, options)(*arrays.values(), number, output_dims=dict(shapes))


def image_inputs(
    number: int, arrays: Arrays, images: Mapping[str, Array], gradients: Mapping[str, Array] | None = None
) -> tuple[Spec, dict[str, Array]]:
    """Return the inputs of a foreign function of images and of gradients with respect to them, and their types."""
    gradients = {} if gradients is None else gradients
    axes = 1 + len(numbered_renderer(number).camera.shape)
    types = tuple((name, differentiable.pixel_type(name), axes) for name in images)
    of_types = tuple((f"of_{name}", differentiable.pixel_type(name), axes) for name in gradients)
    named = {f"of_{name}": gradient for name, gradient in gradients.items()}
    return (*_input_spec(arrays), *types, *of_types), {**_named(arrays), **images, **named}


def _named(arrays: Arrays) -> dict[str, Array]:
    """Return the arrays that are given, by name."""
    optional = {
        "poses": arrays.poses,
        "object_poses": arrays.object_poses,
        "world_index": arrays.world_index,
        "intrinsics": arrays.intrinsics,
    }
    named = {name: array for name, array in optional.items() if array is not None}
    return {**named, **{f"vertices_{k}": vertices for k, vertices in enumerate(arrays.vertices)}}


def _input_spec(arrays: Arrays) -> Spec:
    types = {
        "poses": (wp.transform, 1),
        "object_poses": (wp.transform, 2),
        "world_index": (wp.int32, 1),
        "intrinsics": (wp.float32, 1),
    }
    return tuple((name, *types.get(name, (wp.vec3, 1))) for name in _named(arrays))


@cache
def _foreign(function: Callable[..., None], inputs: Spec, outputs: Spec, options: tuple[Hashable, ...]) -> Any:
    """Return a JAX function that calls ``function(number, arrays, *options)`` with its inputs and outputs by name.

    Its arguments are the inputs and the number of a renderer. Graphs are not captured, since renders may build trees
    and allocate memory.
    """
    parameters = [(name, wp.array(dtype=dtype, ndim=axes)) for name, dtype, axes in inputs]
    parameters.append(("number", wp.int32))
    parameters += [(name, wp.array(dtype=dtype, ndim=axes)) for name, dtype, axes in outputs]

    def call(*values: Any) -> None:
        arrays = {name: value for (name, _), value in zip(parameters, values, strict=True)}
        number = int(arrays.pop("number"))
        with _on_warp_stream(arrays["poses"].device):
            function(number, arrays, *options)

    call.__annotations__ = dict(parameters)
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    signature = inspect.Signature([inspect.Parameter(name, kind, annotation=type_) for name, type_ in parameters])
    call.__signature__ = signature  # type: ignore[attr-defined]
    return wp.jax_callable(
        call,
        num_outputs=len(outputs),
        graph_mode=wp.JaxCallableGraphMode.NONE,
        module_preload_mode=wp.JaxModulePreloadMode.NONE,
        vmap_method=None,
    )


def _on_warp_stream(device: wp.Device) -> AbstractContextManager[Any]:
    """Use Warp's stream of a GPU, which first waits for XLA's stream; after the call, XLA's stream waits for it.

    Calls of the scene outside of JAX are on the same stream, and Warp releases memory in the order of its own streams.
    """
    if device.is_cpu or device.alias not in _streams:
        return nullcontext()
    return wp.ScopedStream(_streams[device.alias], sync_enter=True, sync_exit=True)


def _as_inputs(arrays: Mapping[str, wp.array]) -> Inputs:
    vertices = [array for name, array in arrays.items() if name.startswith("vertices_")]
    return Inputs(arrays["poses"], arrays.get("object_poses"), arrays.get("world_index"), vertices)


def split_arrays(arrays: Mapping[str, wp.array]) -> tuple[Inputs, dict[str, wp.array], dict[str, wp.array]]:
    """Return the inputs, the images and the gradients of images."""
    images = {name: arrays[name] for name in (*WITH_GRADIENT, *WITHOUT_GRADIENT, "albedo") if name in arrays}
    gradients = {name: arrays[f"of_{name}"] for name in WITH_GRADIENT if f"of_{name}" in arrays}
    return _as_inputs(arrays), images, gradients


def _renderer(number: int, arrays: Mapping[str, wp.array]) -> DifferentiableRenderer:
    """Return a renderer, of a camera with the given parameters, which are read on the host."""
    renderer, intrinsics = numbered_renderer(number), arrays.get("intrinsics")
    return renderer if intrinsics is None else renderer.with_parameters(intrinsics.numpy().astype(np.float64))


def _write_images(number: int, arrays: dict[str, wp.array]) -> None:
    inputs, images, _ = split_arrays(arrays)
    _renderer(number, arrays).render(inputs, images)


def _write_pose_gradients(number: int, arrays: dict[str, wp.array]) -> None:
    wp.copy(arrays["of_poses"], _renderer(number, arrays).pose_gradients(*split_arrays(arrays)))


def _write_vertex_gradients(number: int, arrays: dict[str, wp.array]) -> None:
    for k, result in enumerate(_renderer(number, arrays).vertex_gradients(*split_arrays(arrays))):
        wp.utils.array_cast(result, arrays[f"of_vertices_{k}"])


def _write_parameter_gradients(number: int, arrays: dict[str, wp.array]) -> None:
    result = _renderer(number, arrays).parameter_gradients(*split_arrays(arrays))
    wp.utils.array_cast(result, arrays["of_intrinsics"])
