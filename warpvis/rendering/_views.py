# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The images of many views: which there are, what their pixels are, and memory for them."""

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
"""The images that casters make and the dtypes of their pixels."""

COLOR_OUTPUTS: dict[str, type] = {"color": wp.vec3ub, "albedo": wp.vec3ub}
"""Those that are made of what casters say."""

OUTPUTS = CAST_OUTPUTS | COLOR_OUTPUTS
"""The images that can be rendered and the dtypes of their pixels."""

_FACES = list(OUTPUTS).index("faces")

SENSOR_OUTPUTS: dict[str, type] = {"reasons": wp.uint8, "true_depth": wp.float32}
"""Those that a sensor's model makes, too."""

ALL_OUTPUTS = OUTPUTS | SENSOR_OUTPUTS
"""Both."""


@dataclass
class Views:
    """Images of V views, `wp.array`s indexed ``[view, y, x]``; those not asked for are None.

    Every image says the same of a pixel: where depth is not finite, point and normal are NaN, the label is
    `Label.EMPTY`, and the object and the face are -1. Of a renderer with a sensor, `depth` and `points` are what the
    sensor says, and the others what the exact ray meets, however near or far that is: where depth is not finite, they
    may be.
    """

    # Typed as what was asked for: who reads an image has asked for it.
    depth: wp.array = None
    """Planar depth [m], ``(V, H, W)`` float32: +inf where nothing is hit or it lies beyond the camera's `far`, -inf
    where something is nearer than its `near` (REP 117), unless `Renderer` was told to `fill` them. Of a sensor, NaN
    where it measured none for another reason."""
    points: wp.array = None
    """Seen points in the world frame [m], ``(V, H, W)`` vec3."""
    normals: wp.array = None
    """Unit normals of the seen triangles in the world frame, towards the camera, ``(V, H, W)`` vec3."""
    labels: wp.array = None
    """`Label` values, ``(V, H, W)`` uint8."""
    segmentation: wp.array = None
    """Indices into the scene's objects, ``(V, H, W)`` int32."""
    faces: wp.array = None
    """Indices of the seen triangles in the object's own mesh, as it was added: rows of `SceneObject.faces`,
    ``(V, H, W)`` int32. They are -1 of movable solids, too, whose surface is no triangle's."""
    color: wp.array = None
    """Colours under the scene's lights, or base colours if it has none, as screens show them (sRGB), ``(V, H, W)`` of
    three uint8: in NumPy ``(V, H, W, 3)``. Where nothing is seen, the scene's background."""
    albedo: wp.array = None
    """Base colours of surfaces without any light, likewise."""
    reasons: wp.array = None
    """Of a sensor: why a pixel has no depth, `warpvis.sensors.Reason` values, ``(V, H, W)`` uint8."""
    true_depth: wp.array = None
    """Of a sensor: planar depth of what the exact ray meets [m], ``(V, H, W)`` float32; +inf where that is nothing."""

    def __getstate__(self) -> dict[str, Any]:
        """Return the images as the host's arrays, which pickle and copy; Warp's do not."""
        return {name: _on_host(name, value) for name, value in self.__dict__.items()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take over such arrays; a GPU's images are on a GPU again if there is one."""
        self.__dict__ |= {name: _from_host(name, value) for name, value in state.items()}

    def __deepcopy__(self, memo: dict[int, Any]) -> Views:
        """Copy the images, on their device."""
        copied = {
            name: wp.clone(value) if name in ALL_OUTPUTS and value is not None else value
            for name, value in vars(self).items()
        }
        return type(self)(**copied)


def wants_ids(images: Sequence[wp.array | None]) -> bool:
    """Tell whether any of the casters' images needs to know what is seen: all but depth and points do."""
    return any(image is not None for image in images[2 : len(CAST_OUTPUTS)])


def wants_faces(images: Sequence[wp.array | None]) -> bool:
    """Tell whether faces are among the casters' images: a scene's trees know of them only where they are asked."""
    return images[_FACES] is not None


def check_outputs(outputs: object, known: Collection[str] = OUTPUTS.keys()) -> tuple[str, ...]:
    """Take names of outputs, each once, of which a single one may stand alone.

    Raises:
        ArrayError: There is none, or an unknown one.
    """
    names = as_items(outputs, "outputs")
    unknown = [str(name) for name in names if not isinstance(name, str) or name not in known]
    if unknown or not names:
        raise ArrayError(f"outputs must be some of {', '.join(known)}, got {', '.join(unknown) or 'none'}")
    return tuple(dict.fromkeys(names))


def views_for(outputs: Sequence[str], shape: tuple[int, ...], device: wp.Device, out: Views | None = None) -> Views:
    """Return new images of these outputs, or `out` if that is there and fits.

    Raises:
        ArrayError: `out` does not fit, or memory could not be had.
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
    there = device if device == "cpu" or wp.is_cuda_available() else "cpu"
    return wp.array(array, dtype=ALL_OUTPUTS[name], device=there)
