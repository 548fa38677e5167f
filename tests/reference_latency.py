# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reference of the kernel of `warpvis.kernels.sensors.latency`: stores the images of all frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def delay_images(images: NDArray, frames: NDArray, delays: NDArray) -> NDArray:
    """Return the delayed images of a series of calls: images (calls, V, ...), frames (calls, V), delays (V,)."""
    delayed = np.empty_like(images)
    for view, delay in enumerate(delays):
        begun = 0
        for call in range(len(images)):
            if call > 0 and frames[call, view] != frames[call - 1, view] + 1:
                begun = call
            delayed[call, view] = images[max(call - delay, begun), view]
    return delayed
