# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of another meaning: world to camera, other axes, other orders or units; found by the depth of several views."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.core.checks import format_percent
from warpvis.core.poses import Convention, opencv_frame, poses_to_matrices, poses_to_opencv
from warpvis.errors import PoseError

# Minimum agreement of the right poses, and maximum ratio of that of wrong ones. On recordings of 5 cameras, the right
# poses agree in 64 to 98 % of the pixels.
_RIGHT, _WRONG_RATIO = 0.6, 0.6

# Pairs of views that are compared, and points of a view.
_MAX_PAIRS, _MAX_POINTS = 8, 400

MIN_MOTION = 0.25
"""Minimum motion between two views: a shift along an axis [m], or the change of a component of an axis, 15 degrees."""

# Difference of depths of the same surface: constant [m], and by depth.
_CONSTANT, _BY_DEPTH = 0.03, 0.03

# Minimum number of compared pixels, and fraction of a view's points that must be in the other image.
_MIN_COMPARED, _MIN_OVERLAP = 50, 0.2


def other_meanings(
    matrices: NDArray[np.float64], convention: Convention = "opencv", *, world: bool = False
) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yield what poses may be instead, with the remedy, and the poses with OpenCV axes that they would be then.

    Args:
        matrices: Camera to world with OpenCV axes, shape ``(V, 4, 4)``, converted from `convention`.
        convention: The axes that were given.
        world: Whether the world may have another vertical axis.
    """
    frame = opencv_frame(convention)
    given = matrices @ np.linalg.inv(frame)
    inverse = np.linalg.inv(given)
    yield "they are world to camera: pass their inverses", inverse @ frame
    for name in ("opencv", "opengl", "ros_body"):
        if name != convention:
            yield f'their axes are others: pass convention="{name}"', given @ opencv_frame(name)
    if convention == "opencv":
        remedy = 'they are world to camera with OpenGL axes: pass their inverses and convention="opengl"'
        yield remedy, inverse @ opencv_frame("opengl")
    rows = poses_to_opencv(given)[:, [0, 1, 2, 4, 5, 6, 3]]
    yield 'their quaternions have w first: pass quaternion="wxyz"', poses_to_matrices(rows) @ frame
    small = matrices.copy()
    small[:, :3, 3] /= 1000
    yield "their positions are in millimeters: divide them by 1000", small
    for sign, up in ((1, "y"), (-1, "z")) if world else ():
        turned = poses_to_matrices([0.0, 0, 0, sign * 0.5**0.5, 0, 0, 0.5**0.5]) @ matrices
        yield f'the vertical axis of their world is {up}: pass up="{up}", or rotate them about x by 90 degrees', turned


def refuse_other_meaning(
    matrices: NDArray[np.float64],
    agreement: Callable[[NDArray[np.float64]], float],
    convention: Convention,
    evidence: str,
    name: str = "camera_to_world",
    *,
    minimum: float = _RIGHT,
    world: bool = False,
) -> float:
    """Return the agreement of poses; raise `PoseError` if poses of another meaning fit the depth images much better.

    Args:
        matrices: Camera to world with OpenCV axes, shape ``(V, 4, 4)``.
        agreement: Returns the fraction of the pixels that agree with poses, from 0 to 1.
        convention: The axes that were given.
        evidence: With what pixels agree, for the message.
        name: Name of the poses in the message.
        minimum: Minimum agreement of the right poses.
        world: Whether the world may have another vertical axis.
    """
    given = agreement(matrices)
    if given > _WRONG_RATIO:
        return given
    scores = [(agreement(other), remedy) for remedy, other in other_meanings(matrices, convention, world=world)]
    best, remedy = max(scores)
    if best >= minimum and given <= _WRONG_RATIO * best:
        raise PoseError(
            f"{name} must fit the depth images: {format_percent(given)} of the pixels agree with {evidence}, but "
            f"{format_percent(best)} if {remedy}"
        )
    return given


def refuse_inconsistent_views(
    depth: NDArray[np.floating],
    camera: ImageCamera,
    poses: NDArray[np.floating],
    convention: Convention = "opencv",
    name: str = "camera_to_world",
) -> None:
    """Raise `PoseError` if the views of a static world contradict each other, and would not with another meaning.

    Args:
        depth: Depth images on the host [m], shape ``(V, H, W)``.
        camera: Their camera.
        poses: Rows with OpenCV axes, shape ``(V, 7)``; views without a pose, NaN, are ignored.
        convention: The axes that were given.
        name: Name of the poses in the message.
    """
    known = np.flatnonzero(np.isfinite(poses).all(axis=1))
    matrices = poses_to_matrices(poses[known])
    pairs = _choose_pairs(matrices)
    if pairs:
        refuse_other_meaning(
            matrices, lambda other: _view_agreement(depth, known, camera, other, pairs), convention, "other views", name
        )


def _choose_pairs(matrices: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return pairs of views between which the camera moved, spread over the sequence."""
    pairs = []
    for first in range(0, len(matrices), max(1, len(matrices) // _MAX_PAIRS)):
        moved = np.abs(matrices[first + 1 :, :3] - matrices[first, :3]).max(axis=(1, 2)) > MIN_MOTION
        if moved.any():
            pairs.append((first, first + 1 + int(moved.argmax())))
    return pairs


def _view_agreement(
    depth: NDArray[np.floating],
    known: NDArray[np.intp],
    camera: ImageCamera,
    matrices: NDArray[np.float64],
    pairs: list[tuple[int, int]],
) -> float:
    """Return the fraction of points of a view that have the same depth in the other view of a pair.

    `known` has the view of each pose.
    """
    step = max(1, int(np.sqrt(camera.width * camera.height / _MAX_POINTS)))
    y, x = np.mgrid[step // 2 : camera.height : step, step // 2 : camera.width : step].reshape(2, -1)
    rays = camera.depth_rays(np.stack([x, y], axis=-1) + 0.5)
    points = agreed = compared = 0
    for first, second in pairs:
        z = depth[known[first], y, x].astype(np.float64)
        valid = (z > 0) & (z >= camera.near) & (z <= min(camera.far, 1e6))
        world = (rays[valid] * z[valid][:, None]) @ matrices[first, :3, :3].T + matrices[first, :3, 3]
        local = (world - matrices[second, :3, 3]) @ matrices[second, :3, :3]
        pixels = camera.project(local)
        expected = local[:, 2] if camera.kind == "z" else np.linalg.norm(local, axis=-1)
        inside = ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(axis=-1) & (expected > 0)
        column, row = pixels[inside].astype(np.intp).T
        found, expected = depth[known[second], row, column], expected[inside]
        measured = (found > 0) & np.isfinite(found)
        points += int(valid.sum())
        compared += int(measured.sum())
        agreed += int((np.abs(found - expected)[measured] < _CONSTANT + _BY_DEPTH * expected[measured]).sum())
    if compared < max(_MIN_COMPARED, _MIN_OVERLAP * points):
        return 0.0
    return agreed / compared
