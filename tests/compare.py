# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Assertions of section 6 of the design: tolerances of images."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from warpvis import Camera, Scene, Views

import reference


def assert_matches_reference(
    views: Views,
    scene: Scene,
    camera: Camera,
    poses: np.ndarray,
    *,
    cull_backfaces: bool = False,
    near_plane: str = "occlude",
) -> None:
    """Check that every image of every view agrees with the float64 reference.

    Depth must agree within ``1e-5 * max(1, z)`` on 99.99 % of the pixels; on the rest, a ray must pass within 1e-4 px
    of
    an edge. Points must agree within that distance plus the rounding of their coordinates; objects and labels exactly.
    """
    for view, pose in enumerate(poses):
        expected = reference.cast_rays(scene, camera, pose, cull_backfaces=cull_backfaces, near_plane=near_plane)
        wrong = wrong_depth(views.depth.numpy()[view], expected.depth)
        if views.segmentation is not None:
            # Where surfaces of two objects coincide, either object is correct.
            wrong |= (views.segmentation.numpy()[view] != expected.objects) & (expected.gap > 1e-5)
        assert wrong.mean() <= 1e-4, f"view {view}: {wrong.sum()} of {wrong.size} pixels differ"
        pixels = np.argwhere(wrong)
        if len(pixels):
            distance = reference.edge_distance(scene, camera, pose, pixels)
            distance[reference.near_silhouette(scene, camera, pose, pixels, 1e-4)] = 0
            assert distance.max() <= 1e-4, f"view {view}: pixel {pixels[distance.argmax()]} is not at an edge"

        same = ~wrong & (expected.gap > 1e-5)
        hit = same & np.isfinite(expected.depth)
        if views.labels is not None:
            assert (views.labels.numpy()[view][same] == expected.labels[same]).all()
        if views.points is not None:
            points = views.points.numpy()[view].astype(np.float64)
            assert np.isnan(points[~np.isfinite(views.depth.numpy()[view])]).all()
            error = np.linalg.norm(points[hit] - expected.points[hit], axis=-1)
            rounding = 1.2e-7 * np.abs(expected.points[hit]).max(axis=-1, initial=0)
            ray_length = np.linalg.norm(reference.pixel_rays(camera)[hit], axis=-1)
            assert (error <= 1e-5 * np.maximum(1, expected.depth[hit]) * ray_length + rounding).all()
        if views.normals is not None:
            normals = views.normals.numpy()[view]
            assert np.isnan(normals[~np.isfinite(views.depth.numpy()[view])]).all()
            # At an edge between adjacent triangles of one object, either normal is correct.
            apart = np.abs(normals[hit] - expected.normals[hit]).max(axis=-1) > 1e-4
            assert apart.mean() <= 1e-3 if apart.size else True


def assert_view_matches(
    views: Views, view: int, expected: reference.Images, depth_beside: Callable[[int, int], np.ndarray]
) -> None:
    """Check that a view of any ray camera, with all images, agrees with the float64 reference.

    Depth and points must agree within ``1e-5 * max(1, length)``. Where a pixel differs, a slightly perturbed ray must
    agree:
    `depth_beside` returns the depths of perturbed rays for a column and row.
    """
    depth = views.depth.numpy()[view]
    wrong = wrong_depth(depth, expected.depth)
    wrong |= (views.segmentation.numpy()[view] != expected.objects) & (expected.gap > 1e-5)
    for y, x in np.argwhere(wrong):
        beside = depth_beside(x, y)
        got = np.full(beside.shape, depth[y, x])
        assert not wrong_depth(got, beside).all(), f"view {view}: pixel {(y, x)} is not at an edge"
    assert wrong.mean() <= 1e-3
    same = ~wrong & (expected.gap > 1e-5)
    hit = same & np.isfinite(expected.depth)
    assert (views.labels.numpy()[view][same] == expected.labels[same]).all()
    points, normals = (image.numpy()[view].astype(np.float64) for image in (views.points, views.normals))
    for image in (points, normals):
        assert np.isnan(image[~np.isfinite(depth)]).all()
    error = np.linalg.norm(points[hit] - expected.points[hit], axis=-1)
    assert (error <= 1e-5 * np.maximum(1, np.abs(expected.points[hit]).max(axis=-1, initial=0))).all()
    assert (np.abs(normals[hit] - expected.normals[hit]).max(axis=-1) > 1e-4).mean() <= 1e-3


def hair(size: float, axes: int) -> np.ndarray:
    """Return random small offsets, shape ``(1, 64, axes)``."""
    return size * np.random.default_rng(0).normal(size=(1, 64, axes))


def wrong_depth(depth: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Return where depth differs from the expected by more than ``1e-5 * max(1, z)``, or infinities differ."""
    assert not np.isnan(depth).any()
    with np.errstate(invalid="ignore"):
        close = np.abs(depth.astype(np.float64) - expected) <= 1e-5 * np.maximum(1, np.abs(expected))
    return ~np.where(np.isfinite(expected) & np.isfinite(depth), close, depth == expected)
