# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Draw pictures: a depth image in metres, a floor map with its legend, a scene from outside, who sees what."""

from __future__ import annotations

from warpvis.viz._overview import save_depth, save_map, save_overview, view_from_outside
from warpvis.viz._perspective import save_perspective
from warpvis.viz._sightings import save_sightings

__all__ = [
    "save_depth",
    "save_map",
    "save_overview",
    "save_perspective",
    "save_sightings",
    "view_from_outside",
]
