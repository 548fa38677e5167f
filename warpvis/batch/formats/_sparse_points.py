# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Sparse points of a scene with colors and the images that show them, from which Gaussian splatting starts.

Photogrammetry reconstructs such points from images. Here they are points of the scene's surfaces at pixel centers of
some images, and the images that show a point are known exactly, by casting rays.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import Visibility
from warpvis.core.poses import poses_to_matrices
from warpvis.rendering import Renderer
from warpvis.visibility import point_visibility

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.cameras.frames import Frames
    from warpvis.scene import Scene

_MAX_SOURCES = 100
"""Maximum number of frames whose pixels become points."""
_MAX_OBSERVED = 1000
"""Maximum number of frames with observations, unless they are the source of points."""
_MAX_OBSERVATIONS = 500
"""Maximum number of observations in a frame, besides its own points."""
_FRAMES_AT_ONCE = 64

# Steps of a sequence of pixels that covers the image evenly, however many are used. Source: M. Roberts, "The
# Unreasonable Effectiveness of Quasirandom Sequences", 2018: powers of the inverse of 1.3247..., root of x^3 = x + 1.
_STEPS = np.array([0.7548776662466927, 0.5698402909980532])


@dataclass(frozen=True, eq=False)
class SparsePoints:
    """Points of a scene, each at a pixel center of a frame."""

    points: NDArray[np.float32]
    """Positions in the world [m], shape ``(P, 3)``."""
    colors: NDArray[np.uint8]
    """sRGB colors, shape ``(P, 3)``."""
    frames: NDArray[np.int64]
    """Number of the frame of each point, in ascending order, shape ``(P,)``."""
    pixels: NDArray[np.float64]
    """Coordinates in that frame's image [px], pixel centers at +0.5, shape ``(P, 2)``."""


def sample_points(scene: Scene, plan: Plan, count: int) -> SparsePoints:
    """Return points at up to `count` pixels of up to 100 frames, evenly distributed.

    Pixels without a surface within the camera's range have no point, and neither have objects that move between frames.
    """
    sources = _spread(len(plan.frames), min(_MAX_SOURCES, count))
    camera, per_frame = plan.camera, count // len(sources)
    size = np.array([camera.width, camera.height])
    renderer = Renderer(scene, camera, outputs=("points", "segmentation", "color"))
    moves = _moving(plan)
    found = []
    for first in range(0, len(sources), _FRAMES_AT_ONCE):
        part = sources[first : first + _FRAMES_AT_ONCE]
        numbers = per_frame * (first + np.arange(len(part)))[:, None] + np.arange(per_frame)
        pixels = np.floor((numbers[..., None] * _STEPS) % 1 * size) + 0.5
        poses, options = _views(plan, part)
        views = renderer.render_at(poses, pixels.astype(np.float32), **options)
        points, objects, colors = (
            array.numpy() for array in (views.points, views.segmentation, views.color) if array is not None
        )
        rows, columns = np.nonzero(np.isfinite(points).all(axis=-1) & ~moves[objects])
        found.append((points[rows, columns], colors[rows, columns], part[rows], pixels[rows, columns]))
    return SparsePoints(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))


def observations(
    scene: Scene, plan: Plan, sparse: SparsePoints
) -> Iterator[tuple[int, NDArray[np.int64], NDArray[np.float64]]]:
    """Yield the number of each observed frame, the indices of points that it shows, and their coordinates [px].

    A frame shows its own points, and at most 500 of the others.
    """
    if not len(sparse.points):
        return
    observed = np.union1d(_spread(len(plan.frames), _MAX_OBSERVED), sparse.frames)
    places = sparse.points.astype(np.float64)
    numbers = np.arange(len(places))
    for first in range(0, len(observed), _FRAMES_AT_ONCE):
        part = observed[first : first + _FRAMES_AT_ONCE]
        poses, options = _views(plan, part)
        status: Any = point_visibility(scene, plan.camera, poses, sparse.points, **options)
        visible = status.numpy() == Visibility.VISIBLE
        matrices = poses_to_matrices(poses)
        for frame, seen, matrix in zip(part.tolist(), visible, matrices, strict=True):
            own = sparse.frames == frame
            # Different points in each frame, so that points are shared by several frames.
            step = -(-int(np.count_nonzero(seen & ~own)) // _MAX_OBSERVATIONS)
            chosen = np.flatnonzero(own | (seen & ((numbers + frame) % max(1, step) == 0)))
            pixels = plan.camera.project((places[chosen] - matrix[:3, 3]) @ matrix[:3, :3])
            pixels[own[chosen]] = sparse.pixels[own]
            yield frame, chosen, pixels


def _spread(total: int, count: int) -> NDArray[np.int64]:
    """Return `count` whole numbers below `total`, evenly distributed; all of them if there are fewer."""
    return np.unique(np.linspace(0, total - 1, min(total, count)).astype(np.int64))


def _moving(plan: Plan) -> NDArray[np.bool_]:
    """Return which objects have different poses in different frames; the last value, of no object, is True."""
    columns = np.array([*plan.object_columns, -1])
    if plan.frames.object_poses is None:
        moves = np.zeros(len(columns), dtype=bool)
    else:
        varies = (plan.frames.object_poses != plan.frames.object_poses[:1]).any(axis=(0, 2))
        moves = np.append(varies, False)[columns]
    moves[-1] = True
    return moves


def _views(plan: Plan, numbers: NDArray[np.int64]) -> tuple[NDArray[np.float64], dict[str, Any]]:
    """Return the camera poses of frames, and arguments of a renderer with only the worlds that they use."""
    frames: Frames = plan.frames.take(numbers)
    options: dict[str, Any] = {"exclude": list(plan.exclude) or None}
    if frames.object_poses is not None:
        worlds, index = np.unique([frames.world_of(row) for row in range(len(frames))], return_inverse=True)
        options |= {"object_poses": frames.object_poses[worlds], "world_index": index.astype(np.int32)}
    return frames.camera_to_world, options
