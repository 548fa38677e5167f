# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Why a depth sensor measured nothing at a pixel."""

from __future__ import annotations

import enum

from warpvis.kernels import constants


class Reason(enum.IntEnum):
    """Why a sensor has no depth of a pixel; the first that holds, in the order in which a model asks."""

    VALID = constants.REASON_VALID
    """It has."""
    EMPTY = constants.REASON_EMPTY
    """Nothing is there: depth is +inf."""
    RANGE = constants.REASON_RANGE
    """Nearer or farther than it measures: depth is -inf or +inf. All other reasons make it NaN."""
    SHADOW = constants.REASON_SHADOW
    """The sensor's other eye, a projector or a second imager, does not see the surface."""
    BAND = constants.REASON_BAND
    """The surface is beside the other eye's image."""
    EDGE = constants.REASON_EDGE
    """Too much about the pixel is of another depth."""
    GRAZING = constants.REASON_GRAZING
    """The surface is seen along itself, and too little comes back."""
    DROPOUT = constants.REASON_DROPOUT
    """It was lost by chance, or because the surface is dark."""
    SATURATED = constants.REASON_SATURATED
    """More light comes back than it can count."""
