# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Distributions of depth-camera models on a wall, by their formulas.

`scores` maps measurements to values that are standard normal if the formulas hold, by the probability integral
transform. For a quantized measurement, the probability is drawn uniformly between the distribution function's values
before and after its step (randomized quantile residuals, Dunn and Smyth 1996).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import reference_kinect_noise
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from warpvis import Camera
from warpvis.sensors import (
    Corruptions,
    KhoshelhamNoise,
    NguyenNoise,
    RedwoodNoise,
    SimKinect,
    StereoDepth,
    TimeOfFlight,
)

LIGHT = 299792458.0
_PARTS = 801
"""Number of equal parts that a shift is divided into."""

Distribution = Callable[[NDArray], NDArray]


def scores(model: object, camera: Camera, angle: float, seen: dict[str, NDArray]) -> NDArray[np.float64]:
    """Return standard normal scores, (V, H, W), NaN where nothing is measured or the formula does not apply.

    Args:
        model: The sensor.
        camera: Its camera.
        angle: Rotation of the wall about the vertical [rad].
        seen: `depth` and `true_depth`, (V, H, W); `true_depth` is the same in all views.
    """
    depth, exact = seen["depth"].astype(np.float64), seen["true_depth"][:1].astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        found, below = _LAWS[type(model)](model, camera, angle, np.where(np.isfinite(depth), depth, np.nan), exact)
        if steps_of(model, camera) is None:
            return ndtri(below(found))
        level = np.rint(found)
        shares = np.random.default_rng(0).random(level.shape)
        lower = below(level - 0.5)
        return ndtri(lower + shares * (below(level + 0.5) - lower))


def steps_of(model: object, camera: Camera) -> float | None:
    """Return s [m] such that s / depth is a whole number for a quantized model; None if depth is continuous."""
    if isinstance(model, StereoDepth) and model.subpixel:
        return _disparity_scale(model, camera) * model.subpixel
    if isinstance(model, KhoshelhamNoise) and model.rounds:
        return 1 / model.step
    if isinstance(model, SimKinect):
        return 35130 / model.units
    return 8 * 35.130 if isinstance(model, RedwoodNoise) else None


def spacing_of(model: object) -> int:
    """Return the pixel distance from which noise is independent."""
    if isinstance(model, StereoDepth) and model.noise_spacing > 1:
        return 2 * model.noise_spacing
    return 1


def _disparity_scale(model: StereoDepth | SimKinect, camera: Camera) -> float:
    return (camera.fx if model.focal_length is None else model.focal_length) * model.baseline


def _stereo(
    model: StereoDepth, camera: Camera, angle: float, depth: NDArray, exact: NDArray
) -> tuple[NDArray, Distribution]:
    scale, steps = _disparity_scale(model, camera), model.subpixel or 1
    mean = scale / exact + model.locking * np.sin(2 * np.pi * scale / exact)
    return scale * steps / depth, lambda found: ndtr((found / steps - mean) / model.sigma)


def _time_of_flight(
    model: TimeOfFlight, camera: Camera, angle: float, depth: NDArray, exact: NDArray
) -> tuple[NDArray, Distribution]:
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)
    length = np.linalg.norm(rays, axis=-1)
    cosine = np.abs(rays @ [-np.sin(angle), 0, np.cos(angle)]) / length
    electrons = model.signal * cosine / (exact * length) ** 2
    noise = np.sqrt(electrons + model.background) / (model.contrast * electrons)
    sigma = LIGHT / (4 * np.sqrt(2) * np.pi * model.frequencies[0]) * noise
    phase = 4 * np.pi * model.frequencies[0] * exact * length / LIGHT
    mean = exact * length + model.offset + model.wiggle * np.sin(4 * phase + model.wiggle_phase)
    return depth * length, lambda found: ndtr((found - mean) / sigma)


def _nguyen(
    model: NguyenNoise, camera: Camera, angle: float, depth: NDArray, exact: NDArray
) -> tuple[NDArray, Distribution]:
    sigma = reference_kinect_noise.nguyen_axial(model, exact, angle)
    return depth, lambda found: ndtr((found - exact) / sigma)


def _khoshelham(
    model: KhoshelhamNoise, camera: Camera, angle: float, depth: NDArray, exact: NDArray
) -> tuple[NDArray, Distribution]:
    return 1 / (model.step * depth), lambda found: ndtr((found - 1 / (model.step * exact)) / model.sigma)


def _corruptions(
    model: Corruptions, camera: Camera, angle: float, depth: NDArray, exact: NDArray
) -> tuple[NDArray, Distribution]:
    sigma = np.hypot(model.multiplied * exact, model.added)
    return depth, lambda found: ndtr((found - exact) / sigma)


def _redwood(
    model: RedwoodNoise, camera: Camera, angle: float, depth: NDArray, exact: NDArray
) -> tuple[NDArray, Distribution]:
    """Evaluate a table of ones: a pixel's column is shifted by whole pixels, then rounded down to an even one."""
    shifts = np.arange(-3, 4)
    deviation = 0.25 * model.multiplier
    shares = np.diff(ndtr((np.append(shifts, 4) - 0.5) / deviation))
    columns = np.clip(np.arange(camera.width) + shifts[:, None], 0, camera.width - 1) // 2 * 2
    means = [8 * 35.130 / exact[:, :, moved] for moved in columns]
    sigma = 8 * 0.027778 * model.multiplier

    def below(found: NDArray) -> NDArray:
        return sum(share * ndtr((found - mean) / sigma) for share, mean in zip(shares, means, strict=True))

    inside = np.where((np.arange(camera.width) >= 3) & (np.arange(camera.width) < camera.width - 3), 1.0, np.nan)
    return 8 * 35.130 / depth * inside, below


def see_dots(model: SimKinect, camera: Camera, exact: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return columns, disparities by shift, and detection probabilities of dots that are alone in their windows."""
    shifts = model.shift * ndtri((np.arange(_PARTS) + 0.5) / _PARTS)
    scale = _disparity_scale(model, camera)
    at = np.unique(np.nonzero(np.asarray(model.pattern)[: camera.height, : camera.width])[1])
    about = at[:, None] + np.arange(-4, 5)
    looked = np.interp(about[..., None] + shifts, np.arange(camera.width), exact[0, camera.height // 2])
    found = np.rint(8 * scale / looked) / 8
    # A dot is detected if its disparity is within 0.1 px of the mean of its window, which has 80 other pixels.
    apart = 80 / 81 * (found[:, 4] - found.mean(axis=(1, 2))[:, None])
    error = 80 / 81 * np.sqrt(found.var(axis=2).mean(axis=1) / 80)[:, None] + 1e-9
    return at, found[:, 4], ndtr((0.1 - apart) / error) - ndtr((-0.1 - apart) / error)


def _simkinect(
    model: SimKinect, camera: Camera, angle: float, depth: NDArray, exact: NDArray
) -> tuple[NDArray, Distribution]:
    """Evaluate the distribution at dots, over all shifts with which they are detected."""
    at, found, kept = see_dots(model, camera, exact)
    weights = kept / kept.sum(axis=1, keepdims=True)
    centers = 35130 / np.rint(_disparity_scale(model, camera) / found * model.units) + 0.5
    rows, columns = np.nonzero(np.asarray(model.pattern)[: camera.height, : camera.width])

    def below(level: NDArray) -> NDArray:
        shares = np.full(level.shape, np.nan)
        for place, column in enumerate(at):
            of_column = rows[columns == column]
            away = level[:, of_column, column][..., None] - centers[place]
            shares[:, of_column, column] = ndtr(away / model.sigma) @ weights[place]
        return shares

    return 35130 / model.units / depth, below


_LAWS = {
    StereoDepth: _stereo,
    TimeOfFlight: _time_of_flight,
    NguyenNoise: _nguyen,
    KhoshelhamNoise: _khoshelham,
    Corruptions: _corruptions,
    RedwoodNoise: _redwood,
    SimKinect: _simkinect,
}
