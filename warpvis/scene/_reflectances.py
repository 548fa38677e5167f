# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The specular reflection of uniform light by the surfaces of appendix B of glTF 2.0, as a table."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

_SIZE = 32  # rows and columns
_NODES = 20  # of quadrature in each of two angles


@cache
def reflectances() -> NDArray[np.float32]:
    """Return the fractions of uniform light that surfaces reflect by microfacets, shape ``(32, 32, 2)``.

    Rows are the cosine of the viewing angle, the square of 0 to 1, and columns the roughness from 0 to 1. The numbers
    are integrals over the hemisphere, for a reflectance at normal incidence of 1, and of 0 (B. Karis, "Real Shading in
    Unreal Engine 4", 2013). Their errors, with linear interpolation in the table, are below 0.005 for cosines above
    0.03.
    """
    cosine = np.maximum(np.linspace(0, 1, _SIZE) ** 2, 1e-3)[:, None, None, None]
    alpha = np.maximum(np.linspace(0, 1, _SIZE), 0.03)[None, :, None, None] ** 2
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    nodes, weights = (nodes + 1) / 2, weights / 2
    eye = np.sqrt(1 - cosine**2)
    # Half vectors are distributed by the specular part's microfacets: `share` of them are closer to the normal.
    share = nodes[:, None]
    along = np.sqrt((1 - share) / (1 + (alpha**2 - 1) * share))
    aside = np.sqrt(1 - along**2)
    # Up to this angle around the normal, light comes from above the surface.
    limit = cosine * (1 - 2 * along**2) / np.maximum(2 * along * aside * eye, 1e-12)
    longest = np.arccos(np.clip(limit, -1, 1))
    facing = np.maximum(eye * aside * np.cos(longest * nodes) + cosine * along, 0)
    light = np.maximum(2 * facing * along - cosine, 0)

    def masking(angle: NDArray[np.float64]) -> NDArray[np.float64]:
        return 2 * angle / (angle + np.sqrt(alpha**2 + (1 - alpha**2) * angle**2))

    weight = (
        masking(light) * masking(cosine) * facing / (along * cosine) * (longest / np.pi * weights[:, None] * weights)
    )
    whole, least = weight.sum(axis=(2, 3)), (weight * (1 - facing) ** 5).sum(axis=(2, 3))
    return np.stack([whole, least], axis=2).astype(np.float32)
