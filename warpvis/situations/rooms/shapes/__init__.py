# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Parametric shapes of furniture and objects."""

from __future__ import annotations

from warpvis.situations.rooms.shapes import _decor, _devices, _kitchen, _seating, _storage, _tables
from warpvis.situations.rooms.shapes._builder import Shape as Shape, ShapeBuilder as ShapeBuilder
from warpvis.situations.rooms.shapes._colors import COLORS as COLORS
from warpvis.situations.rooms.shapes._registry import (
    CATEGORIES as CATEGORIES,
    Category as Category,
    get_appearance as get_appearance,
    get_shape as get_shape,
)

# These modules register their shapes when they are imported.
del _decor, _devices, _kitchen, _seating, _storage, _tables
