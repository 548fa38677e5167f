# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images of many views: their names, dtypes and memory."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpvis.core.arrays import check_out, empty
from warpvis.core.checks import as_items
from warpvis.errors import ArrayError

CAST_OUTPUTS: dict[str, type] = {
    "depth": wp.float32,
    "points": wp.vec3,
    "normals": wp.vec3,
    "labels": wp.uint8,
    "segmentation": wp.int32,
    "faces": wp.int32,
}
"""Images that casters render, and the dtypes of their pixels."""

COLOR_OUTPUTS: dict[str, type] = {"color": wp.vec3ub, "albedo": wp.vec3ub}
"""Images that are computed from the casters' images, and the dtypes of their pixels."""

OUTPUTS = CAST_OUTPUTS | COLOR_OUTPUTS
"""All images that can be rendered without a sensor, and the dtypes of their pixels."""

_FACES = list(OUTPUTS).index("faces")

SENSOR_OUTPUTS: dict[str, type] = {"reasons": wp.uint8, "true_depth": wp.float32}
"""Additional images of sensor models, and the dtypes of their pixels."""

ALL_OUTPUTS = OUTPUTS | SENSOR_OUTPUTS
"""All images that can be rendered, and the dtypes of their pixels."""


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
    """With a sensor: planar depth of the exact ray's hit [m], ``(V, H, W)`` float32; +inf where nothing is hit."""

    def __getstate__(self) -> dict[str, Any]:
        """Return the images as host arrays, which support pickling and copying, unlike Warp's arrays."""
        return {name: _on_host(name, value) for name, value in self.__dict__.items()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the images from host arrays; GPU images return to a GPU if there is one."""
        self.__dict__ |= {name: _from_host(name, value) for name, value in state.items()}

    def __deepcopy__(self, memo: dict[int, Any]) -> Views:
        """Copy the images, on their device."""
        copied = {
            name: wp.clone(value) if name in ALL_OUTPUTS and value is not None else value
            for name, value in vars(self).items()
        }
        return type(self)(**copied)


def wants_ids(images: Sequence[wp.array | None]) -> bool:
    """Return whether any of the casters' images needs object ids: all images except depth and points do."""
    return any(image is not None for image in images[2 : len(CAST_OUTPUTS)])


def wants_faces(images: Sequence[wp.array | None]) -> bool:
    """Return whether faces are among the casters' images: a scene's trees contain face indices only on request."""
    return images[_FACES] is not None


def check_outputs(outputs: object, known: Collection[str] = OUTPUTS.keys()) -> tuple[str, ...]:
    """Return names of outputs without duplicates; a single name may be given without a sequence.

    Raises:
        ArrayError: If there is no output, or an unknown one.
    """
    names = as_items(outputs, "outputs")
    unknown = [str(name) for name in names if not isinstance(name, str) or name not in known]
    if unknown or not names:
        raise ArrayError(f"outputs must be some of {', '.join(known)}, got {', '.join(unknown) or 'none'}")
    return tuple(dict.fromkeys(names))


def views_for(outputs: Sequence[str], shape: tuple[int, ...], device: wp.Device, out: Views | None = None) -> Views:
    """Return new images of these outputs, or `out` if it is given and fits.

    Raises:
        ArrayError: If `out` does not fit, or memory cannot be allocated.
    """
    if out is None:
        return Views(**{name: empty(shape, ALL_OUTPUTS[name], name=name, device=device) for name in outputs})
    if not isinstance(out, Views):
        raise ArrayError(f"out must be warpvis.Views, got {type(out).__name__}")
    for name in outputs:
        check_out(getattr(out, name), ALL_OUTPUTS[name], shape, name=f"out.{name}", device=device)
    return out


def _on_host(name: str, value: Any) -> Any:
    if name not in ALL_OUTPUTS or value is None:
        return value
    return np.array(value.numpy()), str(value.device)


def _from_host(name: str, value: Any) -> Any:
    if name not in ALL_OUTPUTS or value is None:
        return value
    array, device = value
    target = device if device == "cpu" or wp.is_cuda_available() else "cpu"
    return wp.array(array, dtype=ALL_OUTPUTS[name], device=target)
