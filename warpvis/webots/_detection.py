# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The rules by which Webots recognises a Solid (``src/webots/nodes/utils/WbObjectDetection.cpp`` and ``WbCamera.cpp``).

Vectors here are in the camera's own frame: x forward, y to the left, z up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.core.camera import Camera
from warpvis.webots._extents import Bound, Extent, bound_of
from warpvis.webots.shapes._geometry import Resolve

_RIGHT, _BOTTOM, _LEFT, _TOP = range(4)


class Box(NamedTuple):
    """What of a Solid is within the frustum, as a box along the camera's axes [m]."""

    middle: NDArray[np.float64]
    size: NDArray[np.float64]
    round: bool
    """Whether spheres alone make it."""

    def corners(self) -> NDArray[np.float64]:
        """List the corners about the middle, or of a sphere the ends of its axes, to which occlusion 2 sends rays."""
        if self.round:
            ends = np.kron(np.eye(3), [[1.0], [-1.0]])
        else:
            ends = np.array([(x, y, z) for z in (1.0, -1.0) for y in (1.0, -1.0) for x in (1.0, -1.0)])
        return ends * self.size / 2


@dataclass(frozen=True)
class Frustum:
    """The four sides of what a planar camera shows, through its origin."""

    camera: Camera
    slopes: NDArray[np.float64]
    """Tangents of half the fields of view, horizontal and vertical."""
    inwards: NDArray[np.float64]
    """Normals of length 1 that point inwards, right, bottom, left and top, shape ``(4, 3)``."""

    @classmethod
    def of(cls, camera: Camera) -> Frustum:
        """Compute the sides."""
        slopes = np.array([camera.width / 2 / camera.fx, camera.height / 2 / camera.fy])
        y, z = slopes
        inwards = np.array([(y, 1, 0), (z, 0, 1), (y, -1, 0), (z, 0, -1)], dtype=np.float64)
        return cls(camera, slopes, inwards / np.linalg.norm(inwards, axis=1, keepdims=True))

    def box(self, extent: Extent, eye: NDArray[np.float64], axes: NDArray[np.float64], resolve: Resolve) -> Box | None:
        """Compute the box of what of a Solid is within; None if nothing is.

        Args:
            extent: The Solid.
            eye: The camera's place in the world [m], shape ``(3,)``.
            axes: The camera's axes in the world, a row each.
            resolve: Finds the files of meshes.
        """
        found: Box | None = None
        for solid in extent.family():
            read = [bound_of(node, transform, resolve) for node, transform in solid.bounding]
            bounds = [bound for bound in read if bound is not None]
            sphere = None if found is not None or solid.bounding or solid.is_bounded() else solid.sphere()
            if sphere is not None:
                bounds.append(Bound(sphere.center[None], sphere.radius))
            for bound in bounds:
                points = (bound.points - eye) @ axes.T
                box = self._of_round(points[0], bound, axes) if bound.radius else self._of_points(points)
                if box is not None:
                    found = box if found is None else _merge(found, box)
        return found

    def _of_points(self, points: NDArray[np.float64]) -> Box | None:
        """Move what is outside to the sides, one after the other; what is behind the camera stays where it is."""
        ahead, behind = points[points[:, 0] > 0], points[points[:, 0] <= 0]
        if not len(ahead):
            return None
        inside = np.ones(len(ahead), dtype=bool)
        beyond, within = np.zeros(4, dtype=bool), np.zeros(4, dtype=bool)
        for side, normal in enumerate(self.inwards):
            outside = ahead @ normal < 0
            ahead = np.where(outside[:, None], ahead - np.outer(ahead @ normal, normal), ahead)
            beyond[side], within[side] = outside.any(), (~outside).any()
            inside &= ~outside
        if not inside.any():  # none is inside: it may still cross what is shown
            across = beyond[[_RIGHT, _LEFT]].all() and within[[_BOTTOM, _TOP]].all()
            upright = beyond[[_BOTTOM, _TOP]].all() and within[[_RIGHT, _LEFT]].all()
            if not (across or upright):
                return None
        every = np.concatenate([ahead, behind])
        low, high = every.min(axis=0), every.max(axis=0)
        return Box((low + high) / 2, high - low, False)

    def _of_round(self, middle: NDArray[np.float64], bound: Bound, axes: NDArray[np.float64]) -> Box | None:
        """Cut off what is outside of each side, by the distance of the middle from it."""
        size = np.full(3, 2 * bound.radius)
        if bound.axis is not None:
            along = np.abs(axes @ bound.axis)
            size = along * bound.height + 2 * bound.radius * np.sqrt(np.maximum(0.0, 1 - along**2))
        half = size[[1, 2, 1, 2]] / 2
        distances = self.inwards @ middle
        if (distances < -half).any():
            return None
        cut = np.where(distances < half, half - distances, 0.0)
        if self.slopes[0] <= 1:  # a field of view of 90 degrees
            size = size - (0, cut[_RIGHT] + cut[_LEFT], cut[_BOTTOM] + cut[_TOP])
            middle = middle + 0.5 * np.array([0, cut[_RIGHT] - cut[_LEFT], cut[_BOTTOM] - cut[_TOP]])
        return Box(middle, size, bound.axis is None)

    def on_image(self, box: Box) -> tuple[tuple[int, int], tuple[int, int]]:
        """Compute the middle and the size of a box on the image [px], without the lens."""
        x, y, z = (box.middle + box.corners()).T
        ahead = np.where(np.abs(x) > 0, np.abs(x), 1e-300)
        sideways = np.stack([-y, -z], axis=1)
        place = np.where(
            x[:, None] < 0, np.where(sideways < 0, -0.5, 0.5), 0.5 * sideways / ahead[:, None] / self.slopes
        )
        limits = np.array([self.camera.width - 1, self.camera.height - 1])
        pixels = (limits * np.clip(0.5 + place, 0.0, 1.0)).astype(np.int64)
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        middle = np.floor((low + high) / 2 + 0.5).astype(np.int64)
        return (int(middle[0]), int(middle[1])), (int(high[0] - low[0]), int(high[1] - low[1]))


def _merge(one: Box, other: Box) -> Box:
    low = np.minimum(one.middle - one.size / 2, other.middle - other.size / 2)
    high = np.maximum(one.middle + one.size / 2, other.middle + other.size / 2)
    return Box((low + high) / 2, high - low, one.round and other.round)


def is_hidden(lengths: NDArray[np.float64], hits: NDArray[np.float64], size: NDArray[np.float64]) -> bool:
    """Tell whether rays to a Solid all end before it, by more than half of its size.

    Args:
        lengths: Of the rays [m], shape ``(n,)``: one to the Solid's origin, or those to the corners of its box.
        hits: How far the first obstacle is along each [m], inf for none.
        size: Of its box [m]; ray `i` is compared with the length along axis ``i // 2``, in Webots' order.
    """
    before = np.where(hits < lengths, lengths - hits, 0.0)
    axis = np.minimum(np.arange(len(lengths)) // 2, 2)  # Webots reads beyond the vector for the last two of eight
    return bool((before > 0.5 * size[axis]).all())
