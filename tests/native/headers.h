// SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
// SPDX-License-Identifier: Apache-2.0
//
// The headers for the CPU: each group that Warp pastes into a function, in a separate namespace.

#pragma once

#include <sanitizer/asan_interface.h>

#include "memory.h"

namespace casting {
#include "shared/constants.h"
#include "shared/images.h"
#include "shared/stretch.h"
#include "shared/pose.h"
#include "shared/edges.h"
#include "cpu/plain_rays.h"
#include "cpu/lanes.h"
#include "guarded_arena.h"
#include "cpu/workers.h"
#include "cpu/image.h"
#include "cpu/ray_tree.h"
#include "cpu/bvh.h"
#include "cpu/camera.h"
#include "cpu/setup.h"
#include "cpu/pixels.h"
#include "cpu/raster.h"
#include "cpu/solids.h"
#include "cpu/worlds.h"
#include "cpu/output.h"
#include "cpu/sparse.h"
#include "cpu/ray_leaf.h"
#include "cpu/ray_raster.h"
#include "cpu/walk.h"
#include "cpu/movables.h"
#include "cpu/packets.h"
#include "cpu/point_bins.h"
#include "cpu/points.h"
#include "cpu/silhouettes.h"
}  // namespace casting

namespace casting_tables {
#include "shared/constants.h"
#include "shared/images.h"
#include "shared/stretch.h"
#include "shared/pose.h"
#include "shared/edges.h"
#include "cpu/table_rays.h"
#include "cpu/lanes.h"
#include "guarded_arena.h"
#include "cpu/workers.h"
#include "cpu/image.h"
#include "cpu/ray_tree.h"
#include "cpu/bvh.h"
#include "cpu/camera.h"
#include "cpu/setup.h"
#include "cpu/pixels.h"
#include "cpu/raster.h"
#include "cpu/solids.h"
#include "cpu/worlds.h"
#include "cpu/output.h"
#include "cpu/sparse.h"
#include "cpu/ray_leaf.h"
#include "cpu/ray_raster.h"
#include "cpu/walk.h"
#include "cpu/movables.h"
#include "cpu/packets.h"
#include "cpu/table.h"
#include "cpu/remap_map.h"
#include "cpu/remap_tree.h"
#include "cpu/remap.h"
}  // namespace casting_tables

namespace building_16 {
enum { LANES = 16 };
#include "shared/constants.h"
#include "cpu/bvh_split.h"
#include "cpu/bvh_collapse.h"
#include "cpu/bvh_bounds.h"
#include "build.h"
}  // namespace building_16

namespace building_32 {
enum { LANES = 32 };
#include "shared/constants.h"
#include "cpu/bvh_split.h"
#include "cpu/bvh_collapse.h"
#include "cpu/bvh_bounds.h"
#include "build.h"
}  // namespace building_32
