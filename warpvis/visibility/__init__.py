# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visibility of points and objects to cameras and agents: which are seen, how much of them, and why others are not."""

from __future__ import annotations

from warpvis.visibility._agents import Agent as Agent, FieldOfView as FieldOfView, equirectangular as equirectangular
from warpvis.visibility._candidates import Candidate, State, choose_likeliest as choose_likeliest
from warpvis.visibility._eyes import MAX_EYE_ANGLE as MAX_EYE_ANGLE, Eyes as Eyes
from warpvis.visibility._fractions import FractionMeter, ObjectFractions, visible_fractions as visible_fractions
from warpvis.visibility._line_of_sight import LineOfSight, cast_ray as cast_ray, line_of_sight
from warpvis.visibility._margins import MarginMeter, VisibilityMargins, point_margins, visibility_margins
from warpvis.visibility._measured_space import MeasuredSpace
from warpvis.visibility._measurement import perspective as perspective
from warpvis.visibility._objects import (
    BOP_DELTA,
    ObjectVisibility,
    check_canvas as check_canvas,
    choose_objects as choose_objects,
    object_visibility as object_visibility,
    see_objects as see_objects,
)
from warpvis.visibility._perspective import Perspective as Perspective
from warpvis.visibility._points import (
    point_visibility as point_visibility,
    point_visibility_from_depth as point_visibility_from_depth,
)
from warpvis.visibility._reference_model import ReferenceModel
from warpvis.visibility.watching import (
    DepthWatcher,
    FloorSearch as FloorSearch,
    Sight,
    Watched,
    map_points as map_points,
    search_floor as search_floor,
)

__all__ = [
    "BOP_DELTA",
    "Candidate",
    "DepthWatcher",
    "FractionMeter",
    "LineOfSight",
    "MarginMeter",
    "MeasuredSpace",
    "ObjectFractions",
    "ObjectVisibility",
    "ReferenceModel",
    "Sight",
    "State",
    "VisibilityMargins",
    "Watched",
    "line_of_sight",
    "point_margins",
    "visibility_margins",
]
