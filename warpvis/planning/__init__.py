# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""View planning: best views, places for cameras, coverage, constraints, free space, heights, and proposals."""

from __future__ import annotations

from warpvis.planning._best_views import (
    BestViews,
    Proposal,
    best_views,
    look_along as look_along,
    pose_grid,
    propose_view,
)
from warpvis.planning._check_constraints import check_constraints
from warpvis.planning._constraints import Constraint, ConstraintCheck, Term
from warpvis.planning._coverage import Coverage, Samples, coverage, surface_samples
from warpvis.planning._free_space import (
    clearance,
    corners_of as corners_of,
    inside_solids as inside_solids,
    minimum_height,
    standing_room,
)
from warpvis.planning._overlap import boxes_meet_triangles as boxes_meet_triangles
from warpvis.planning._placement import Placement, place_cameras, unknown_targets
from warpvis.planning._regions import BoxRegion, ShellRegion, SupportRegion
from warpvis.planning._sample_views import SampledPoses, sample_objects, sample_views

__all__ = [
    "BestViews",
    "BoxRegion",
    "Constraint",
    "ConstraintCheck",
    "Coverage",
    "Placement",
    "Proposal",
    "SampledPoses",
    "Samples",
    "ShellRegion",
    "SupportRegion",
    "Term",
    "best_views",
    "check_constraints",
    "clearance",
    "coverage",
    "minimum_height",
    "place_cameras",
    "pose_grid",
    "propose_view",
    "sample_objects",
    "sample_views",
    "standing_room",
    "surface_samples",
    "unknown_targets",
]
