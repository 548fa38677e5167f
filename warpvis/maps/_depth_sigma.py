# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Standard deviations of measured depth as arguments of functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.core.arrays import as_numpy, check_length
from warpvis.core.checks import is_number
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.rendering import DepthSensor

Sigma: TypeAlias = float | DepthSensor | Callable[[NDArray[np.float64]], ArrayInput]
"""Standard deviation of depth: a number of meters, a model of `warpvis.sensors`, or a function of depth."""

# Depths whose standard deviation is tabulated: single-precision numbers from 1/1024 m to 131 km whose binary
# representations are KNOT_STEP apart, 0.4 to 0.8 % of the depth. Kernels find the knots of a depth by its bits; linear
# interpolation of z^2 between them has a relative error of 2e-5.
KNOT_STEP = 1 << 16
_FIRST, _LAST = np.array([2.0**-10, 2.0**17], dtype=np.float32).view(np.int32).tolist()
KNOTS = np.arange(_FIRST, _LAST + 1, KNOT_STEP, dtype=np.int32).view(np.float32).astype(np.float64)

# Largest standard deviation of a depth camera [m]: larger numbers are millimeters.
_MAX_SIGMA = 1.0

# Limits of tabulated standard deviations [m]: residuals stay finite.
_SIGMA_LIMITS = 1e-6, 1e6

# Depths at which a polynomial is fitted [m], and its largest relative error.
_FITTED, _MAX_DEVIATION = (0.1, 20.0), 0.25


def tabulate_sigma(sigma: Sigma, camera: ImageCamera) -> NDArray[np.float32]:
    """Return the standard deviation [m] at the depths `KNOTS`, constant beyond the camera's range."""
    depths = np.clip(KNOTS, max(camera.near, KNOTS[0]), min(camera.far, KNOTS[-1]))
    if is_number(sigma):
        number = check_length(sigma, "sigma", zero=False)
        if number >= _MAX_SIGMA:
            raise ArrayError(
                f"sigma must be a standard deviation below {_MAX_SIGMA:g} m, got {number:g}; divide millimeters by 1000"
            )
        values = np.full_like(depths, number)
    elif isinstance(sigma, DepthSensor):
        values = sigma.depth_sigma(depths, camera)  # type: ignore[arg-type]  # `takes_lens` is that of `measure`
    elif callable(sigma) and not isinstance(sigma, type):
        values = as_numpy(sigma(depths.copy()), name="the result of sigma").astype(np.float64)
    else:
        raise ArrayError(f"sigma must be a number of meters, a model of warpvis.sensors or a function, got {sigma!r}")
    if values.shape != depths.shape or not (values >= 0).all():
        raise ArrayError(
            f"sigma must return standard deviations from 0 m up, one for each of {len(depths)} depths, got shape "
            f"{values.shape}"
        )
    return np.clip(values, *_SIGMA_LIMITS).astype(np.float32)


def fit_sigma(sigma: Sigma, camera: ImageCamera, max_range: float) -> tuple[float, float, float]:
    """Return the coefficients of 1, z and z^2 of the polynomial that is closest to a standard deviation [m].

    It is fitted to the range of the camera up to `max_range` and 20 m.
    """
    values = tabulate_sigma(sigma, camera).astype(np.float64)
    low, high = max(camera.near, _FITTED[0]), min(camera.far, max_range, _FITTED[1])
    chosen = (KNOTS >= low) & (KNOTS <= high) if high > 1.1 * low else KNOTS >= KNOTS[-3]
    depths, expected = KNOTS[chosen], values[chosen]
    powers = np.stack([np.ones_like(depths), depths, depths**2], axis=-1)
    coefficients = np.linalg.lstsq(powers / expected[:, None], np.ones_like(depths), rcond=None)[0]
    deviation = float(np.abs(powers @ coefficients / expected - 1).max())
    if deviation > _MAX_DEVIATION:
        raise ArrayError(
            f"sigma must be close to a quadratic polynomial of depth from {low:g} to {high:g} m, got a function that "
            f"differs by {deviation:.0%}"
        )
    constant, linear, quadratic = coefficients.tolist()
    return constant, linear, quadratic
