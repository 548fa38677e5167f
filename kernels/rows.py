# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Work on rows of images that the workers of a launch on CPU cores share; see ``native/cpu/rows.h``."""

import warp as wp


@wp.struct
class RowJob:
    """The rows of all views, in strips that workers take, and the counters that they share."""

    counter: wp.array[wp.int32]  # JOB_COUNTERS of ``native/shared/constants.h``
    views: int
    height: int
    strip: int  # rows of a strip


@wp.func_native("warpvis::Workers::enter(job.counter.data);")
def enter_rows(job: RowJob): ...


@wp.func_native("return warpvis::take_strip(job);")
def take_rows(job: RowJob) -> int: ...


@wp.func_native("warpvis::Workers::finish(job.counter.data);")
def finish_rows(job: RowJob): ...


@wp.func
def rows_of(job: RowJob, unit: int) -> wp.vec3i:
    """Return the view of a strip, its first row and the end of its rows."""
    strips = (job.height + job.strip - 1) // job.strip
    first = (unit % strips) * job.strip
    return wp.vec3i(unit // strips, first, wp.min(first + job.strip, job.height))
