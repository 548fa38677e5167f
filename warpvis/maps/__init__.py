# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Labels, floor maps and voxel maps from measured or rendered depth images.

`plan_visibility` computes visibility on a 2D floor plan for comparison.
"""

from __future__ import annotations

from warpvis.maps._classification import Sphere, back_project as back_project, classify as classify, classify_rendered
from warpvis.maps._compare_depth import Agreement, DepthComparison, compare_depth as compare_depth
from warpvis.maps._depth_sigma import Sigma as Sigma
from warpvis.maps._floor_fit import FloorFit, fit_floor as fit_floor
from warpvis.maps._floor_map import (
    MAP_LEGEND,
    FloorMap as FloorMap,
    floor_map as floor_map,
    label_colors,
)
from warpvis.maps._floor_plan import PlanVisibility, plan_visibility
from warpvis.maps._occupancy_grid import OccupancyGrid
from warpvis.maps._occupancy_map import OccupancyMap as OccupancyMap
from warpvis.maps._register import register as register
from warpvis.maps._registration import Registration
from warpvis.maps._scene_changes import SceneChange
from warpvis.maps._voxel_map import Voxel, VoxelMap as VoxelMap
from warpvis.maps._voxel_views import voxel_map as voxel_map, voxel_map_from_scene as voxel_map_from_scene

__all__ = [
    "MAP_LEGEND",
    "Agreement",
    "DepthComparison",
    "FloorFit",
    "OccupancyGrid",
    "PlanVisibility",
    "Registration",
    "SceneChange",
    "Sphere",
    "Voxel",
    "classify_rendered",
    "label_colors",
    "plan_visibility",
]
