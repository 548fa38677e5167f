# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision references of the kernels of `warpvis.kernels.sensors.stereo`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from reference_random import draw_normals, random_words, to_uniform
from scipy.stats import norm

from warpvis import Camera
from warpvis.core.poses import poses_to_matrices
from warpvis.kernels.constants import STREAM_DISPARITY, STREAM_DROPOUT
from warpvis.sensors import Reason, StereoDepth


def place_other_eyes(poses: NDArray, baseline: float) -> tuple[NDArray[np.float32], NDArray, NDArray]:
    """Return poses of the other eyes, their offsets from the first eyes in world axes, and the first eyes' axes."""
    axes = poses_to_matrices(poses)[:, :3, :3]
    origin = np.asarray(poses, dtype=np.float32)[:, :3].astype(np.float64)
    other = np.array(poses, dtype=np.float32)
    other[:, :3] = origin + baseline * axes[:, :, 0]
    place = np.einsum("vij,vi->vj", axes, other[:, :3].astype(np.float64) - origin)
    return other, place, axes


def points_in_view(camera: Camera, depth: NDArray) -> NDArray[np.float64]:
    """Return points of depth images (V, H, W) in the camera's frame."""
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)
    with np.errstate(invalid="ignore"):
        return depth.astype(np.float64)[..., None] * rays


def place_in_other_eyes(
    camera: Camera, other: Camera, place: NDArray, depth: NDArray, min_depth: float
) -> NDArray[np.float64]:
    """Return pixels of points in the other eye's image, (V, H, W, 2); NaN outside it."""
    with np.errstate(invalid="ignore"):
        p = points_in_view(camera, depth) - place[:, None, None]
        column, row = other.fx * p[..., 0] / p[..., 2] + other.cx, other.fy * p[..., 1] / p[..., 2] + other.cy
        there = np.isfinite(depth) & (depth >= min_depth) & (column >= 0) & (column < other.width)
    row = np.clip(row, 0, np.nextafter(np.float32(other.height), np.float32(0)))
    return np.where(there[..., None], np.stack([column, row], axis=-1), np.nan)


def measure_cosine(camera: Camera, axes: NDArray, normals: NDArray) -> NDArray[np.float64]:
    """Return cosines between pixel rays and world normals (V, H, W, 3); `axes` (V, 3, 3) as columns."""
    rays = points_in_view(camera, np.ones((1, camera.height, camera.width)))[0]
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return np.abs(np.einsum("vij,yxj,vyxi->vyx", axes, rays, normals.astype(np.float64)))


def noise_weights(spacing: int) -> NDArray[np.float64]:
    """Return the weights of a pixel's two nodes by its position between them, (spacing, 2)."""
    angles = np.arange(spacing) / spacing * np.pi / 2
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def smooth_noise(
    views: NDArray, frames: NDArray, shape: tuple[int, int], seed: int, spacing: int, stream: int = STREAM_DISPARITY
) -> NDArray[np.float64]:
    """Return standard normal numbers of a stream, interpolated between nodes, (V, H, W)."""
    if spacing == 1:
        return draw_normals(views, frames, shape, seed, stream)
    nodes = draw_normals(views, frames, ((shape[0] - 1) // spacing + 2, (shape[1] - 1) // spacing + 2), seed, stream)
    weights = noise_weights(spacing)
    rows, columns = np.arange(shape[0]), np.arange(shape[1])
    down, across = weights[rows % spacing], weights[columns % spacing]
    rows, columns = rows // spacing, columns // spacing
    above = nodes[:, rows] * down[:, 0, None] + nodes[:, rows + 1] * down[:, 1, None]
    return above[:, :, columns] * across[:, 0] + above[:, :, columns + 1] * across[:, 1]


def noise_correlations(spacing: int, lag: int) -> NDArray[np.float64]:
    """Return the correlation of pixels `lag` apart along one axis, by the first one's position between nodes."""
    weights, found = noise_weights(spacing), np.zeros(spacing)
    for first in range(spacing):
        second = first + lag
        apart = second // spacing
        one, two = weights[first], weights[second % spacing]
        found[first] = sum(one[i] * two[i - apart] for i in range(2) if 0 <= i - apart < 2)
    return found


def noise_correlation(spacing: int, lag: int) -> float:
    """Return the correlation of pixels `lag` apart along one axis, averaged over positions between nodes."""
    return float(noise_correlations(spacing, lag).mean())


def edge_supports(sensor: StereoDepth, scale: float, depth: NDArray) -> NDArray[np.float64]:
    """Return the share of window pixels on the center's surface, rows times columns, (V, H, W)."""
    reach = sensor.edge_window // 2
    disparity = np.where(np.isfinite(depth), scale / depth.astype(np.float64), np.nan)
    support = np.ones(depth.shape)
    for axis in (1, 2):
        same, seen = np.zeros(depth.shape), np.zeros(depth.shape)
        for lag in range(-reach, reach + 1):
            index = np.arange(depth.shape[axis]) + lag
            inside = (index >= 0) & (index < depth.shape[axis])
            inside = inside[:, None] if axis == 1 else inside
            other = np.take(disparity, np.clip(index, 0, depth.shape[axis] - 1), axis=axis)
            same += inside & (np.abs(other - disparity) < sensor.edge_step)
            seen += inside
        support *= same / seen
    return support


@dataclass
class StereoSight:
    """Inputs of a stereo sensor: images (V, H, W) in single precision and results of additional rays."""

    depth: NDArray
    other_depth: NDArray | None = None
    """Depth seen by the other eye at the points' pixels, +inf for the background."""
    cosine: NDArray | float = 1.0
    reflectivity: NDArray | float = 1.0


@np.errstate(divide="ignore", invalid="ignore")
def measure_stereo(
    sensor: StereoDepth, camera: Camera, sight: StereoSight, draws: NDArray, seed: int = 0
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Return measured depth, reasons, and the relative margin of the nearest decision."""
    views, frames = np.asarray(draws).T
    shape = sight.depth.shape[1:]
    scale = (camera.fx if sensor.focal_length is None else sensor.focal_length) * sensor.baseline
    depth = sight.depth.astype(np.float64)
    disparity = scale / depth
    noise = smooth_noise(views, frames, shape, seed, sensor.noise_spacing)
    found = disparity + sensor.locking * np.sin(2 * np.pi * disparity) + sensor.sigma * noise
    margins = []
    if sensor.subpixel:
        margins.append(np.abs((found * sensor.subpixel) % 1 - 0.5))
        found = np.floor(found * sensor.subpixel + 0.5) / sensor.subpixel
    with np.errstate(divide="ignore"):
        said = scale / found
    if sensor.hole_spacing > 1:
        chance = norm.cdf(smooth_noise(views, frames, shape, seed, sensor.hole_spacing, STREAM_DROPOUT))
    else:
        chance = to_uniform(random_words(views, frames, shape, seed, STREAM_DROPOUT))
    reason = np.full(depth.shape, int(Reason.VALID))

    def decide(which: NDArray, what: Reason, margin: NDArray) -> None:
        reason[which] = what
        margins.append(np.where(np.isfinite(margin), np.abs(margin), np.inf))

    decide((said < camera.near) | (said > camera.far) | (found <= 0), Reason.RANGE, (said - camera.near) / said)
    decide(np.zeros(depth.shape, dtype=bool), Reason.RANGE, (said - camera.far) / said)
    kept = _found_share(sensor, sight.reflectivity * np.asarray(sight.cosine)) * (1 - sensor.dropout)
    plain = np.broadcast_to(_found_share(sensor, np.asarray(sight.cosine)), depth.shape)
    decide(chance >= kept, Reason.DROPOUT, chance - kept)
    decide((chance >= kept) & (chance >= plain), Reason.GRAZING, chance - plain)
    support = edge_supports(sensor, scale, sight.depth) if sensor.edge_window > 1 else np.ones(depth.shape)
    decide(support < sensor.min_support, Reason.EDGE, support - sensor.min_support)
    shift = camera.fx * sensor.baseline
    if sight.other_depth is not None:
        ahead = shift / sight.other_depth - shift / depth - 2.0**-6
        decide(ahead > 0, Reason.SHADOW, ahead)
    if sensor.band:
        x = np.arange(shape[1]) + 0.5
        column = x - shift / depth if sensor.other_eye == "right" else x + shift / depth
        decide((column < 0) | (column > shape[1]), Reason.BAND, np.minimum(np.abs(column), np.abs(column - shape[1])))
    decide(disparity > sensor.max_disparity, Reason.RANGE, (disparity - sensor.max_disparity) / disparity)
    reason[~np.isfinite(depth)] = Reason.EMPTY
    margin = np.where(np.isfinite(depth), np.min(margins, axis=0), np.inf)
    return _as_said(sensor, camera, said, found, reason, disparity), reason, margin


def _found_share(sensor: StereoDepth, signal: NDArray) -> NDArray[np.float64]:
    if sensor.full_signal <= (0.05 if sensor.reflectivity == 1.0 else 0.0):
        return np.ones(signal.shape)
    return np.clip((signal - sensor.min_signal) / (sensor.full_signal - sensor.min_signal), 0, 1)


def _as_said(
    sensor: StereoDepth, camera: Camera, said: NDArray, found: NDArray, reason: NDArray, disparity: NDArray
) -> NDArray[np.float64]:
    """Return depth by REP 117, NaN where it was lost for reasons other than range."""
    said = np.where((said > camera.far) | (found <= 0), np.inf, np.where(said < camera.near, -np.inf, said))
    said = np.where(disparity > sensor.max_disparity, -np.inf, said)
    return np.where(reason > Reason.RANGE, np.nan, np.where(reason == Reason.EMPTY, np.inf, said))
