// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The headers for the CPU. Their cpu/arena.h is the one of this folder.

#pragma once

#include <sanitizer/asan_interface.h>

#include "memory.h"

namespace warpvis {
#include "cpu/bvh_bounds.h"
#include "cpu/bvh_collapse.h"
#include "cpu/depth_rows.h"
#include "cpu/points.h"
#include "cpu/remap.h"
#include "cpu/silhouettes.h"
}  // namespace warpvis

#include "build.h"
