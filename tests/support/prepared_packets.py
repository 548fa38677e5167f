# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Ray tables in one kind of packets of a GPU."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.rendering.casters import sorted_rays_cuda as sorted_rays

if TYPE_CHECKING:
    from warpvis.kernels.casting.packets_cuda import RayPackets


def prepare_all(
    rays: NDArray[np.float64],
    side: int,
    device: wp.Device,
    origins: NDArray[np.float64] | None = None,
    packet_side: int | None = None,
) -> RayPackets:
    """Prepare rays as `prepare_packets` does, in one kind of packets: squares of `side`, or points if `side` is 0.

    With `packet_side`, packets are windows of the squares.
    """
    flat, index, make = sorted_rays._flat(rays), sorted_rays._indices(rays), sorted_rays._Maker(rays, origins, device)
    if side == 0:
        full, partial_packets, without = sorted_rays._sorted(
            index.ravel(), flat.reshape(rays.shape), sorted_rays.POINTS
        )
        place = np.concatenate(
            [sorted_rays._in_points(full, partial_packets), sorted_rays._padded(without, sorted_rays.POINTS)]
        )
        return make.points(place)
    squares, scattered = sorted_rays._arrange(index, flat, side)
    place = np.concatenate(
        [squares, np.pad(scattered, ((0, 0), (0, side * side - sorted_rays.POINTS)), constant_values=-1)]
    )
    return make.windows([make.squares(place, side)], packet_side or side)
