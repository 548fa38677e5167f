# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels over rows of images on CPU cores: launches that are packed once, whose workers share the rows."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import warp as wp

from warpvis.core.threads import array_of_one, launch_shared, pack_launch, write_fields
from warpvis.kernels.constants import JOB_COUNTERS
from warpvis.rendering.casters.packets_cpu import RayCosts

# Rows of a strip have about this many pixels: few enough to balance workers, and enough that taking one is negligible.
_STRIP_PIXELS = 2048


class PackedRows:
    """A packed launch over rows of images, for one call at a time.

    Packing the arguments of a launch takes about 0.1 ms, longer than shading a small image. A call only writes
    addresses into the packed launch, without keeping the arrays alive.
    """

    def __init__(self, kernel: wp.Kernel, call_type: Any, images_type: Any, threads: int) -> None:
        """Pack a launch of a kernel of a call, whose field `job` is a `kernels.rows.RowJob`, and of its images."""
        self._counter = np.zeros(JOB_COUNTERS, dtype=np.int32)
        self._call, self._images = call_type(), images_type()
        self._job = self._call.job
        self._job.counter = wp.array(self._counter, dtype=wp.int32, device="cpu", copy=False)
        self._launch = pack_launch(
            kernel, [array_of_one(self._call, call_type), array_of_one(self._images, images_type)]
        )
        self._costs = RayCosts(threads)
        self._shape: tuple[int, int, int] | None = None

    def run(self, shape: tuple[int, int, int], images: dict[str, wp.array], **values: Any) -> None:
        """Write images of a shape ``(views, height, width)``; `values` are structs, arrays and numbers of the call."""
        views, height, width = shape
        strip = max(1, _STRIP_PIXELS // width)
        if shape != self._shape:
            write_fields(self._job, views=views, height=height, strip=strip)
            self._shape = shape
        write_fields(self._call, **values)
        write_fields(self._images, **images)
        pixels = views * height * width
        workers = min(self._costs.threads_for(pixels), views * -(-height // strip))
        start = time.perf_counter_ns()
        launch_shared(self._launch, self._counter, workers)
        self._costs.note(pixels, workers, time.perf_counter_ns() - start)
