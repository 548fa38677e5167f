# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What a RangeFinder of Webots makes of true depth, release by release: range limits, noise, resolution, and lens.

Webots does it in shaders (``encode_depth.frag``, ``merge_spherical.frag``, ``lens_distortion.frag``,
``range_noise.frag`` and ``depth_resolution.frag`` in its ``resources/wren/shaders``), in single precision, in this
order: range limits, lens, noise, resolution. A file's header names a release but not its revision: R2022a is taken to
be revision 1, which corrected the range finder.
"""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy, check_metres
from warpvis.core.checks import check_choice, check_flag, is_number, is_whole, pluralize
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.webots._devices import PROJECTIONS, Projection
from warpvis.webots._nodes import Version

# First releases that read +inf where nothing is within reach: of what is too near, and, later, too far (Webots' pull
# requests 2509 and 4167).
_INFINITE_TOO_NEAR = Version.parse("R2021a")
_INFINITE_TOO_FAR = Version.parse("R2022a")
UNBIASED = Version(2022, 1)
"""The first release whose range finders are right about depth."""

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
    """Turn true depth images into the values that a range finder of a release of Webots gives.

    ======================  ==================  ===========================
    release                 below `min_range`   from `max_range`, nothing
    ======================  ==================  ===========================
    up to R2020b            `max_range`         `max_range`
    R2021a, R2021b          +inf                `max_range`; +inf if not planar
    R2022a and later        +inf                +inf
    ======================  ==================  ===========================

    What is seen nearer than `near` hides nothing in Webots, which clips it away; here it is too near as all else below
    `min_range` is. An image that is not planar is put together there of planar ones, in which the limit `min_range` is
    of planar depth too: lengths between it and 1.73 times it may be too near, which is not reproduced.

    Args:
        depth: Planar depth, or lengths of rays as of `warpvis.rendering.render_wide` [m], shape ``(V, H, W)``, rendered
            without limits: finite, or +inf where there is nothing.
        near: Distance of the near plane [m], which only the bias depends on.
        min_range: Least distance that is measured [m].
        max_range: Distance from which on nothing is measured [m].
        version: The release, like ``"R2023b"`` or ``"V8.6"``.
        projection: ``"planar"``, ``"cylindrical"`` or ``"spherical"``.
        near_bias: Whether to reproduce the error of releases up to R2022a before its revision 1: for a true depth z
            they read ``z' = f (z - n) / (f - n)``, of the near plane n and the far one f = `max_range`. Limits are of
            z'. Later releases are right, and for them this changes nothing.

    Returns:
        Values as Webots' controllers get them [m], shape ``(V, H, W)``.

    Raises:
        ArrayError: An argument is not what it has to be.
        FileFormatError: `version` is a text that names no release.
    """
    release = as_version(version)
    images = _check_depth(depth)
    check_choice(projection, "projection", PROJECTIONS)
    near_bias = check_flag(near_bias, "near_bias")
    near, max_range = check_metres(near, "near", zero=False), check_metres(max_range, "max_range", zero=False)
    min_range = check_metres(min_range, "min_range")
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

    From R2022a on, values from `max_range` on become +inf; before, they are noisy like all others. Noisy values may lie
    outside of the range's limits, as in Webots. Its documentation says that the standard deviation is `noise` times
    the maximal range; its shaders of all releases take `noise` as metres, and so does this function. The numbers
    themselves are NumPy's: Webots draws them from the time of the simulation.

    Args:
        values: Values from `range_values` [m].
        noise: Standard deviation [m], a RangeFinder's field ``noise``.
        max_range: Distance from which on nothing is measured [m].
        version: The release, like ``"R2023b"``.
        seed: Of the random numbers: the same seed gives the same noise.

    Returns:
        Noisy values [m], of the shape of `values`; +inf stays. A `noise` of 0 changes nothing.

    Raises:
        ArrayError: An argument is not what it has to be.
        FileFormatError: `version` is a text that names no release.
    """
    release = as_version(version)
    given = as_numpy(values, name="values").astype(np.float32)
    noise, max_range = check_metres(noise, "noise"), check_metres(max_range, "max_range", zero=False)
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or seed < 0:
        raise ArrayError(f"seed must be a whole number from 0 up, got {seed!r}")
    if noise == 0:
        return given
    random = np.random.default_rng(seed).standard_normal(given.shape)
    noisy = np.asarray(given + noise * random, dtype=np.float32)
    if release >= _INFINITE_TOO_FAR:
        noisy[given >= np.float32(max_range)] = np.inf
    return noisy


def quantise(values: ArrayLike, resolution: float) -> NDArray[np.float32]:
    """Round range values to steps of a range finder's resolution: ``floor(d / resolution + 0.5) * resolution``.

    Args:
        values: Values [m].
        resolution: The step [m]; or -1, as in Webots, for values as they are.

    Returns:
        Values [m], of the same shape; +inf stays.

    Raises:
        ArrayError: `resolution` is neither positive nor -1.
    """
    given = as_numpy(values, name="values").astype(np.float32)
    if is_number(resolution) and resolution == -1:
        return given
    step = np.float32(check_metres(resolution, "resolution", zero=False))
    return np.floor(given / step + np.float32(0.5)) * step


def distort_pixels(
    width: int, height: int, center: ArrayLike, radial: ArrayLike, tangential: ArrayLike
) -> NDArray[np.float32]:
    """Compute where in the undistorted image each pixel of an image through a Lens of Webots looks.

    Brown's model in coordinates from 0 to 1 across and down the image, in the approximate inverse of Lambers,
    Sommerhoff and Kolb, "Realistic Lens Distortion Rendering" (2018). With (x, y) the pixel's place from the `center`,
    ``r2 = x^2 + y^2``, radial coefficients k1 and k2 and tangential ones p1 and p2, it looks, from there, at ::

        x - c ((k1 r2 + k2 r2^2) x + 2 p1 x y + p2 (r2 + 2 x^2))
        y - c ((k1 r2 + k2 r2^2) y + 2 p2 x y + p1 (r2 + 2 y^2))
        1 / c = 1 + 4 k1 r2 + 6 k2 r2^2 + 8 p1 y + 8 p2 x

    Example:
        >>> pixels = distort_pixels(camera.width, camera.height, (0.5, 0.5), (0.1, 0.0), (0.0, 0.0))
        >>> views = renderer.render_at(pose, pixels.reshape(1, -1, 2))  # depth: reshape it to (1, height, width)

    Args:
        width: Image width [px].
        height: Image height [px].
        center: The lens' centre, from 0 to 1 across and down the image, shape ``(2,)``.
        radial: Coefficients k1 and k2, shape ``(2,)``.
        tangential: Coefficients p1 and p2, shape ``(2,)``.

    Returns:
        Coordinates ``(x, y)`` [px] as `Renderer.render_at` takes them, shape ``(height, width, 2)``; NaN where the
        formula has none. Outside of the image it sees nothing; Webots writes 0 there.

    Raises:
        ArrayError: An argument is not what it has to be.
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
    """Return a release, from itself or from its name.

    Raises:
        ArrayError: It is neither.
        FileFormatError: There is no release of that name.
    """
    if isinstance(version, str):
        return Version.parse(version)
    if not isinstance(version, Version):
        raise ArrayError(f'version must be a Version or a text like "R2023b", got {version!r}')
    return version


def _check_depth(depth: ArrayInput) -> np.ndarray:
    images = as_numpy(depth.numpy() if isinstance(depth, wp.array) else depth, name="depth")
    if images.ndim != 3:
        raise ArrayError(f"depth must have shape (V, H, W), got {images.shape}")
    bad = np.argwhere(~(images >= 0))
    if len(bad):
        first = tuple(bad[0].tolist())
        raise ArrayError(
            f"depth must be from 0 up or +inf, rendered with near 0 and far inf: not so "
            f"{len(bad)} of {pluralize(images.size, 'value')}, "
            f"the first {images[first]} at {first}"
        )
    return images


def _check_pair(value: ArrayLike, name: str) -> NDArray[np.float64]:
    pair = as_numpy(value, name=name).astype(np.float64)
    if pair.shape != (2,) or not np.isfinite(pair).all():
        raise ArrayError(f"{name} must be two finite numbers, got {pair.tolist()}")
    return pair
