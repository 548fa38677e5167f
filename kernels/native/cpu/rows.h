// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "cpu/workers.h"

// The number of strips of a `RowJob` of kernels/rows.py.
template <class Job>
inline int count_strips(const Job& job) {
    return job.views * ((job.height + job.strip - 1) / job.strip);
}

// Take the next strip; -1 if none remain.
template <class Job>
inline int take_strip(const Job& job) {
    const int unit = Workers::take(job.counter.data);
    return unit < count_strips(job) ? unit : -1;
}

// Call a function with the view and the number of each row that this worker takes.
template <class Job, class Function>
inline void for_rows(const Job& job, const Function& row) {
    const int strips = (job.height + job.strip - 1) / job.strip;
    Workers::enter(job.counter.data);
    Workers::run(job.counter.data, count_strips(job), [&](int unit) {
        const int view = unit / strips, first = unit % strips * job.strip;
        for (int y = first; y < first + job.strip && y < job.height; ++y) row(view, y);
    });
}
