# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Sensor model of Webots' RangeFinder by release: range limits, lens distortion, noise and resolution.

Webots computes these in shaders (``encode_depth.frag``, ``merge_spherical.frag``, ``lens_distortion.frag``,
``range_noise.frag`` and ``depth_resolution.frag`` in its ``resources/wren/shaders``), in single precision, in this
order: range limits, lens, noise, resolution. A file's header specifies a release but not its revision: R2022a is
assumed to be revision 1, which corrected the range finder.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy, check_length
from warpvis.core.checks import check_choice, check_flag, is_number, is_whole, pluralize
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.webots._devices import PROJECTIONS, Projection
from warpvis.webots._nodes import Version

# First releases whose ranges below the minimum, and from the maximum on, are +inf (Webots' pull requests 2509 and
# 4167).
_INFINITE_TOO_NEAR = Version.parse("R2021a")
_INFINITE_TOO_FAR = Version.parse("R2022a")
UNBIASED = Version(2022, 1)
"""The first release whose range finders have no depth bias."""

_LAST_BIASED = Version.parse("R2022a")  # before its revision 1: pull request 4309


def range_values(
    depth: ArrayInput,
    *,
    near: float,
    min_range: float,
    max_range: float,
    version: Version | str,
    projection: Projection = "planar",
    near_bias: bool = False,
) -> NDArray[np.float32]:
    """Convert exact depth images to the values of a range finder in a Webots release.

    ======================  ==================  ===========================
    release                 below `min_range`   from `max_range`, no hit
    ======================  ==================  ===========================
    up to R2020b            `max_range`         `max_range`
    R2021a, R2021b          +inf                `max_range`; +inf if not planar
    R2022a and later        +inf                +inf
    ======================  ==================  ===========================

    Webots clips geometry nearer than `near`, which then does not occlude; this function treats it like all depth below
    `min_range`. Webots composes images that are not planar from planar ones and compares `min_range` with planar depth:
    lengths of up to 1.73 `min_range` may be too near, which is not reproduced.

    Args:
        depth: Planar depth, or lengths of rays as from `warpvis.rendering.render_wide` [m], shape ``(V, H, W)``,
            rendered without limits: finite, or +inf for no hit.
        near: Distance of the near plane [m], used only for the bias.
        min_range: Minimum range [m].
        max_range: Maximum range [m], itself excluded.
        version: The release, like ``"R2023b"`` or ``"V8.6"``.
        projection: ``"planar"``, ``"cylindrical"`` or ``"spherical"``.
        near_bias: Whether to reproduce the bias of releases up to R2022a before its revision 1: for a true depth z
            they return ``z' = f (z - n) / (f - n)``, with the near plane n and the far plane f = `max_range`. Limits
            apply to z'. This has no effect on later releases.

    Returns:
        Values as received by Webots' controllers [m], shape ``(V, H, W)``.
    """
    release = as_version(version)
    images = _check_depth(depth)
    check_choice(projection, "projection", PROJECTIONS)
    near_bias = check_flag(near_bias, "near_bias")
    near, max_range = check_length(near, "near", zero=False), check_length(max_range, "max_range", zero=False)
    min_range = check_length(min_range, "min_range")
    if max(near, min_range) >= max_range:
        raise ArrayError(f"max_range must be beyond near and min_range, got {max_range}, {near} and {min_range}")
    if near_bias and projection != "planar":
        raise ArrayError(f"near_bias is known for planar projection only, got {projection!r}")

    values = images.astype(np.float32)
    if near_bias and release <= _LAST_BIASED:
        values = (max_range * (images.astype(np.float64) - near) / (max_range - near)).astype(np.float32)
    too_near, too_far = values < np.float32(min_range), values >= np.float32(max_range)
    values[too_near] = np.inf if release >= _INFINITE_TOO_NEAR else max_range
    first_infinite = _INFINITE_TOO_FAR if projection == "planar" else _INFINITE_TOO_NEAR
    values[too_far] = np.inf if release >= first_infinite else max_range
    return values


def add_noise(
    values: ArrayLike, noise: float, max_range: float, version: Version | str, seed: int
) -> NDArray[np.float32]:
    """Add Gaussian noise to range values.

    From R2022a on, values from `max_range` on become +inf; before, noise is added to them like to all others. Noisy
    values may be outside the range limits, as in Webots. Webots' documentation defines the standard deviation as
    `noise` times the maximum range, but the shaders of all releases use `noise` in meters, as does this function.
    Random numbers come from NumPy, whereas Webots seeds them with the simulation time.

    Args:
        values: Values from `range_values` [m].
        noise: Standard deviation [m], a RangeFinder's field ``noise``.
        max_range: Maximum range [m].
        version: The release, like ``"R2023b"``.
        seed: Seed of the random numbers.

    Returns:
        Noisy values [m], of the shape of `values`; +inf is unchanged. If `noise` is 0, all values are.
    """
    release = as_version(version)
    ranges = as_numpy(values, name="values").astype(np.float32)
    noise, max_range = check_length(noise, "noise"), check_length(max_range, "max_range", zero=False)
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or seed < 0:
        raise ArrayError(f"seed must be a whole number from 0 up, got {seed!r}")
    if noise == 0:
        return ranges
    random = np.random.default_rng(seed).standard_normal(ranges.shape)
    noisy = np.asarray(ranges + noise * random, dtype=np.float32)
    if release >= _INFINITE_TOO_FAR:
        noisy[ranges >= np.float32(max_range)] = np.inf
    return noisy


def quantize(values: ArrayLike, resolution: float) -> NDArray[np.float32]:
    """Round range values to steps of a range finder's resolution: ``floor(d / resolution + 0.5) * resolution``.

    Args:
        values: Values [m].
        resolution: The step [m]; or -1, as in Webots, for no rounding.

    Returns:
        Values [m], of the same shape; +inf is unchanged.
    """
    ranges = as_numpy(values, name="values").astype(np.float32)
    if is_number(resolution) and resolution == -1:
        return ranges
    step = np.float32(check_length(resolution, "resolution", zero=False))
    return np.floor(ranges / step + np.float32(0.5)) * step


def distort_pixels(
    width: int, height: int, center: ArrayLike, radial: ArrayLike, tangential: ArrayLike
) -> NDArray[np.float32]:
    """Map each pixel of an image distorted by Webots' Lens to coordinates in the undistorted image.

    The mapping is Brown's model in coordinates from 0 to 1 across and down the image, in the approximate inverse of
    Lambers, Sommerhoff and Kolb, "Realistic Lens Distortion Rendering" (2018). For a pixel at (x, y) relative to
    `center`, ``r2 = x^2 + y^2``, radial coefficients k1 and k2 and tangential ones p1 and p2, the coordinates in the
    undistorted image relative to `center` are ::

        x - c ((k1 r2 + k2 r2^2) x + 2 p1 x y + p2 (r2 + 2 x^2))
        y - c ((k1 r2 + k2 r2^2) y + 2 p2 x y + p1 (r2 + 2 y^2))
        1 / c = 1 + 4 k1 r2 + 6 k2 r2^2 + 8 p1 y + 8 p2 x

    Example:
        >>> pixels = distort_pixels(camera.width, camera.height, (0.5, 0.5), (0.1, 0.0), (0.0, 0.0))
        >>> views = renderer.render_at(pose, pixels.reshape(1, -1, 2))  # depth: reshape it to (1, height, width)

    Args:
        width: Image width [px].
        height: Image height [px].
        center: Center of distortion, from 0 to 1 across and down the image, shape ``(2,)``.
        radial: Coefficients k1 and k2, shape ``(2,)``.
        tangential: Coefficients p1 and p2, shape ``(2,)``.

    Returns:
        Coordinates ``(x, y)`` [px] for `Renderer.render_at`, shape ``(height, width, 2)``; NaN where the formula is
        undefined. For coordinates outside the image, Webots writes 0.
    """
    for name, value in (("width", width), ("height", height)):
        if not is_whole(value) or not 1 <= value < 2**31:
            raise ArrayError(f"{name} must be a whole number of pixels from 1 up, got {value!r}")
    middle = _check_pair(center, "center")
    (k1, k2), (p1, p2) = _check_pair(radial, "radial"), _check_pair(tangential, "tangential")
    size = np.array([width, height], dtype=np.float64)
    place = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1) / size
    x, y = np.moveaxis(place - middle, -1, 0)
    r2 = x * x + y * y
    bent = k1 * r2 + k2 * r2 * r2
    with np.errstate(divide="ignore", invalid="ignore"):
        c = 1 / (1 + 4 * k1 * r2 + 6 * k2 * r2 * r2 + 8 * p1 * y + 8 * p2 * x)
        dx = c * (bent * x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x))
        dy = c * (bent * y + 2 * p2 * x * y + p1 * (r2 + 2 * y * y))
    pixels = (place - np.stack([dx, dy], axis=-1)) * size
    return np.where(np.isfinite(pixels), pixels, np.nan).astype(np.float32)


def as_version(version: Version | str) -> Version:
    """Convert the name of a release to a `Version`; return a `Version` unchanged."""
    if isinstance(version, str):
        return Version.parse(version)
    if not isinstance(version, Version):
        raise ArrayError(f'version must be a Version or a text like "R2023b", got {version!r}')
    return version


def _check_depth(depth: ArrayInput) -> np.ndarray:
    images = as_numpy(depth, name="depth")
    if images.ndim != 3:
        raise ArrayError(f"depth must have shape (V, H, W), got {images.shape}")
    bad = np.argwhere(~(images >= 0))
    if len(bad):
        first = tuple(bad[0].tolist())
        raise ArrayError(
            f"depth must be from 0 up or +inf, rendered with near 0 and far inf, got "
            f"{len(bad)} other of {pluralize(images.size, 'value')}, "
            f"the first {images[first]} at {first}"
        )
    return images


def _check_pair(value: ArrayLike, name: str) -> NDArray[np.float64]:
    pair = as_numpy(value, name=name).astype(np.float64)
    if pair.shape != (2,) or not np.isfinite(pair).all():
        raise ArrayError(f"{name} must be two finite numbers, got {pair.tolist()}")
    return pair
