# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reasons for missing depth."""

from __future__ import annotations

import enum

from warpvis.kernels import constants


class Reason(enum.IntEnum):
    """Why a pixel has no depth: the first condition that is true, in the order of the sensor model."""

    VALID = constants.REASON_VALID
    """The pixel has depth."""
    EMPTY = constants.REASON_EMPTY
    """The ray hits nothing; depth is +inf."""
    RANGE = constants.REASON_RANGE
    """The surface is out of range; depth is -inf or +inf. Depth is NaN for all reasons below."""
    SHADOW = constants.REASON_SHADOW
    """The other eye of the sensor, a projector or a second imager, does not see the surface."""
    BAND = constants.REASON_BAND
    """The surface is outside of the image of the other eye."""
    EDGE = constants.REASON_EDGE
    """Too many surrounding pixels have another depth, or the pixel sees several depths."""
    GRAZING = constants.REASON_GRAZING
    """Too little light is reflected because of the angle of incidence."""
    DROPOUT = constants.REASON_DROPOUT
    """The pixel was lost at random, or because the surface is dark or far."""
    SATURATED = constants.REASON_SATURATED
    """The reflected light saturates the pixel."""
