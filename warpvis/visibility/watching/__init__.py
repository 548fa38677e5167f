# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What a robot and people see while a depth camera measures: floor, map and visibility, frame by frame."""

from __future__ import annotations

from warpvis.visibility.watching._floor_search import FloorSearch, search_floor as search_floor
from warpvis.visibility.watching._map_points import MapPoints as MapPoints, map_points as map_points
from warpvis.visibility.watching._sights import Sight
from warpvis.visibility.watching._watcher import DepthWatcher, Watched

__all__ = ["DepthWatcher", "FloorSearch", "Sight", "Watched"]
