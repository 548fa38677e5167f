# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of the kernels of `warpvis.kernels.maps.voxels`. A grid is its min corner, cell size and shape."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from warpvis import Camera, Label
from warpvis.cameras import LensCamera
from warpvis.core.poses import poses_to_matrices
from warpvis.maps import Voxel


def precedence(labels: NDArray, ground: Collection[int] = (1,)) -> NDArray[np.int64]:
    """Return the precedence of labels: a cell shows the label of the greatest."""
    labels = np.asarray(labels, dtype=np.int64)
    above = np.isin(labels, [Label.OBJECT, Label.HUMAN, Label.ROBOT])
    low = np.isin(labels, list(ground)) | (labels == Label.EMPTY)
    return labels + np.select([low, above], [0, 512], 256)


def highest(labels: NDArray, axis: int, ground: Collection[int] = (1,)) -> NDArray[np.uint8]:
    """Return the label of the greatest precedence along an axis."""
    return (precedence(labels, ground).max(axis=axis) % 256).astype(np.uint8)


def shown_depth(camera: Camera, depth: NDArray) -> NDArray[np.float64]:
    """Return depth by REP 117: -inf is too near, +inf is nothing in range, NaN is not measured."""
    depth = np.asarray(depth, dtype=np.float32)
    result = np.where((depth > 0) | np.isneginf(depth), depth, np.nan).astype(np.float64)
    result[result < np.float32(camera.near)] = -np.inf
    result[result > np.float32(camera.far)] = np.inf
    return result


def mark_surface_points(
    camera: Camera,
    poses: NDArray,
    depth: NDArray,
    labels: NDArray | None,
    origin: NDArray,
    cell: float,
    size: tuple[int, int, int],
    ground: Collection[int] = (1,),
) -> NDArray[np.int32]:
    """Return the highest precedence of the points' labels in every voxel, plus 1; 0 without points."""
    import reference

    marks = np.zeros(size, dtype=np.int32)
    for view, matrix in enumerate(poses_to_matrices(np.asarray(poses, dtype=np.float32))):
        shown = shown_depth(camera, depth[view])
        measured = np.where(np.isfinite(shown), shown, np.nan)
        points = (reference.pixel_rays(camera) * measured[..., None]) @ matrix[:3, :3].T + matrix[:3, 3]
        label = np.full(shown.shape, Label.OBSTACLE) if labels is None else labels[view]
        with np.errstate(invalid="ignore"):
            at = np.floor((points - origin) / cell)
            inside = (at >= 0).all(axis=-1) & (at < size).all(axis=-1)
        np.maximum.at(marks, tuple(at[inside].astype(int).T), precedence(label[inside], ground) + 1)
    return marks


mark_surface_rays = mark_surface_points


def judge_voxels(
    camera: Camera,
    poses: NDArray,
    depth: NDArray,
    labels: NDArray | None,
    origin: NDArray,
    cell: float,
    marks: NDArray,
    ground: Collection[int] = (1,),
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return states and labels of a grid with no previous data."""
    centers = np.asarray(origin) + cell * (np.stack(np.indices(marks.shape), axis=-1).reshape(-1, 3) + 0.5)
    states = np.where(marks.ravel() > 0, Voxel.SURFACE, Voxel.UNKNOWN)
    order = np.maximum(marks.ravel() - 1, 0)
    for view, matrix in enumerate(poses_to_matrices(np.asarray(poses, dtype=np.float32))):
        seen = (centers - matrix[:3, 3]) @ matrix[:3, :3]
        at = camera.project(seen)
        in_image = ((at >= 0) & (at < [camera.width, camera.height])).all(axis=1)
        if isinstance(camera, LensCamera):
            in_image[in_image] = ~camera.mask[tuple(at[in_image].astype(int).T[::-1])]
        column, row = at[in_image].astype(int).T
        sight = centers[in_image] - matrix[:3, 3]
        by_length = getattr(camera, "kind", "z") == "range"
        z = np.linalg.norm(sight, axis=1) if by_length else sight @ matrix[:3, 2]
        shown = shown_depth(camera, depth[view])[row, column]
        label = np.full(len(z), Label.OBSTACLE) if labels is None else labels[view][row, column]

        on_surface = np.isfinite(shown)
        met = sight[on_surface] * (shown[on_surface] / z[on_surface])[:, None]
        on_surface[on_surface] = np.abs(met - sight[on_surface]).max(axis=1) <= cell / 2
        in_range = (z.astype(np.float32) >= np.float32(camera.near)) & (z.astype(np.float32) <= np.float32(camera.far))
        says = np.where(z < shown, Voxel.FREE, Voxel.HIDDEN)
        says = np.where(in_range & ~np.isnan(shown), says, Voxel.UNKNOWN)
        says = np.where(on_surface, Voxel.SURFACE, says)
        states[in_image] = np.maximum(states[in_image], says)
        order[in_image] = np.maximum(order[in_image], np.where(on_surface, precedence(label, ground), 0))
    return states.reshape(marks.shape).astype(np.uint8), (order % 256).reshape(marks.shape).astype(np.uint8)


judge_voxels_at = judge_voxels


def merge_voxels(
    first: tuple[NDArray, NDArray], second: tuple[NDArray, NDArray], ground: Collection[int] = (1,)
) -> tuple[NDArray, NDArray]:
    """Return states and labels of the union of two maps."""
    states, labels = (np.stack(both) for both in zip(first, second, strict=True))
    return states.max(axis=0), highest(labels, 0, ground)


def highest_labels(labels: NDArray, up_axis: int, ground: Collection[int] = (1,)) -> NDArray:
    """Return rows and columns of a floor map: y and x, or x and z if y is up."""
    found = highest(labels, up_axis, ground)
    return found.T if up_axis == 2 else found
