# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images of many views: their names, dtypes and memory."""

from __future__ import annotations

import weakref
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import warp as wp

from warpvis.core.arrays import check_out, empty_images
from warpvis.core.checks import as_items
from warpvis.core.outputs import OUTPUTS, OutputSpec, find_output
from warpvis.errors import ArrayError

_PIXEL_TYPES = {
    ("float32", 0): wp.float32,
    ("float32", 3): wp.vec3,
    ("int32", 0): wp.int32,
    ("uint8", 0): wp.uint8,
    ("uint8", 3): wp.vec3ub,
}
"""Warp's types of pixels, by the dtype of a component and the number of components of a vector."""


@cache
def pixel_type(name: str) -> type:
    """Return Warp's type of the pixels of an output."""
    spec = OUTPUTS[name]
    return _PIXEL_TYPES[spec.dtype, len(spec.components)]


def is_pixel_type(spec: OutputSpec) -> bool:
    """Return whether pixels of a dtype and a number of components are supported."""
    return (spec.dtype, len(spec.components)) in _PIXEL_TYPES


def pixel_bytes(names: Collection[str]) -> int:
    """Return the size of a pixel of some outputs, in total [bytes]."""
    return sum(wp.types.type_size_in_bytes(pixel_type(name)) for name in names)


@dataclass
class Views:
    """Images of V views, `wp.array`s indexed ``[view, y, x]``; images that were not requested are None.

    The images are consistent with each other: where depth is not finite, point and normal are NaN, the label is
    `Label.EMPTY`, and the object and the face are -1. For a renderer with a sensor, `depth` and `points` are the
    sensor's measurements, and the other images describe the surface that the exact ray hits, at any distance: they may
    be valid where depth is not finite.
    """

    # Typed as arrays rather than optional: callers read only images that they requested.
    depth: wp.array = None
    """Planar depth [m], ``(V, H, W)`` float32: +inf where nothing is hit or the hit lies beyond the camera's `far`,
    -inf where a surface is nearer than its `near` (REP 117), unless `fill` of `Renderer` replaces them. With a sensor,
    NaN where it measured no depth for another reason."""
    points: wp.array = None
    """Seen points in the world frame [m], ``(V, H, W)`` vec3."""
    normals: wp.array = None
    """Unit normals of the seen triangles in the world frame, toward the camera, ``(V, H, W)`` vec3."""
    labels: wp.array = None
    """`Label` values, ``(V, H, W)`` uint8."""
    segmentation: wp.array = None
    """Indices into the scene's objects, ``(V, H, W)`` int32."""
    faces: wp.array = None
    """Indices of the seen triangles in the object's own mesh, as it was added: rows of `SceneObject.faces`, ``(V, H,
    W)`` int32. They are also -1 for movable solids, whose surfaces are not triangles."""
    color: wp.array = None
    """Colors under the scene's lights, or base colors if it has no lights, in sRGB, ``(V, H, W)`` vec3ub: in NumPy
    ``(V, H, W, 3)`` uint8. The scene's background where nothing is hit."""
    albedo: wp.array = None
    """Base colors of surfaces without lighting, in the same format."""
    reasons: wp.array = None
    """With a sensor: the reason why a pixel has no depth, `warpvis.sensors.Reason` values, ``(V, H, W)`` uint8."""
    true_depth: wp.array = None
    """With a sensor: depth of the exact ray's hit [m], ``(V, H, W)`` float32; +inf where nothing is hit."""

    def __getstate__(self) -> dict[str, Any]:
        """Return the images as host arrays, which support pickling and copying, unlike Warp's arrays."""
        return {
            name: (np.array(value.numpy()), str(value.device)) if name in OUTPUTS and value is not None else value
            for name, value in vars(self).items()
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the images from host arrays; GPU images return to a GPU if there is one."""
        for name, value in state.items():
            if name in OUTPUTS and value is not None:
                array, device = value
                target = device if device == "cpu" or wp.is_cuda_available() else "cpu"
                value = wp.array(array, dtype=pixel_type(name), device=target)
            setattr(self, name, value)

    def __deepcopy__(self, memo: dict[int, Any]) -> Views:
        """Copy the images, on their device."""
        copied = type(self).__new__(type(self))
        for name, value in vars(self).items():
            setattr(copied, name, wp.clone(value) if name in OUTPUTS and value is not None else value)
        return copied


def check_outputs(outputs: object, *others: str) -> tuple[str, ...]:
    """Return names of outputs without duplicates; a single name may be given without a sequence.

    Args:
        outputs: The names.
        others: Further valid names, of results that are not images.

    Raises:
        ArrayError: If there is no output, or an unknown one.
    """
    names = as_items(outputs, "outputs")
    unknown = [str(n) for n in names if not isinstance(n, str) or (n not in others and find_output(n) is None)]
    if unknown or not names:
        known = ", ".join((*OUTPUTS, *others))
        raise ArrayError(f"outputs must be some of {known}, got {', '.join(unknown) or 'none'}")
    return tuple(dict.fromkeys(names))


def views_for(outputs: Sequence[str], shape: tuple[int, ...], device: wp.Device, out: Views | None = None) -> Views:
    """Return new images of these outputs, or `out` if it is given and fits.

    Raises:
        ArrayError: If `out` does not fit, or memory cannot be allocated.
    """
    if out is None:
        views, types = Views(), {}
        for name in outputs:
            types[name] = pixel_type(name)
        vars(views).update(empty_images(shape, types, device))
        return views
    if not isinstance(out, Views):
        raise ArrayError(f"out must be warpvis.Views, got {type(out).__name__}")
    for name in outputs:
        check_out(getattr(out, name, None), pixel_type(name), shape, name=f"out.{name}", device=device)
    return out


def as_views(images: Mapping[str, wp.array]) -> Views:
    """Return views of images by name, which may be outputs that users registered."""
    views = Views()
    vars(views).update(images)
    return views


class CheckedImages:
    """The images of the last `out` argument, which need not be checked again."""

    def __init__(self) -> None:
        """Create without images."""
        self._shape: tuple[int, ...] = ()
        self._outputs: tuple[str, ...] = ()
        self._images: dict[str, Any] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy or pickle without images."""
        return CheckedImages, ()

    def find(self, out: Views, shape: tuple[int, ...], outputs: tuple[str, ...]) -> dict[str, wp.array] | None:
        """Return the images of `out` by name if they are those of the last call, else None."""
        if shape != self._shape or outputs is not self._outputs or not isinstance(out, Views):
            return None
        images = {}
        for name, last in self._images.items():
            image = getattr(out, name)
            if image is None or image is not last():
                return None
            images[name] = image
        return images

    def record(self, images: dict[str, wp.array], shape: tuple[int, ...], outputs: tuple[str, ...]) -> None:
        """Record checked images without keeping them alive."""
        self._shape, self._outputs = shape, outputs
        self._images = {name: weakref.ref(image) for name, image in images.items()}
