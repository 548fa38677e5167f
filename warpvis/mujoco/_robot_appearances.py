# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The joint appearance of all objects of a mesh file, which become one object of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from warpvis.scene import SceneObject
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.materials import Appearance, Material

_GRAY = Material(base_color=(0.5, 0.5, 0.5, 1.0))
"""MuJoCo's default material."""


def join_appearances(items: Sequence[SceneObject]) -> LazyAppearance | None:
    """Return the lazily loaded appearance of objects that are concatenated in order; None if no object has any."""
    return LazyAppearance(partial(_joined, items)) if any(item.lazy_appearance is not None for item in items) else None


def _joined(items: Sequence[SceneObject]) -> Appearance | None:
    found = [item.appearance for item in items]
    if not any(found):
        return None
    appearances = [appearance or Appearance((_GRAY,)) for appearance in found]
    firsts = np.cumsum([0, *(len(appearance.materials) for appearance in appearances)])
    rows = [
        np.zeros(len(item.faces), dtype=np.int32) if appearance.face_materials is None else appearance.face_materials
        for item, appearance in zip(items, appearances, strict=True)
    ]
    uv = None
    if any(appearance.uv is not None for appearance in appearances):
        corners = [appearance.corner_uv(item.faces) for item, appearance in zip(items, appearances, strict=True)]
        uv = np.concatenate(
            [
                np.zeros((len(item.faces), 3, 2), dtype=np.float32) if corner is None else corner
                for item, corner in zip(items, corners, strict=True)
            ]
        )
    return Appearance(
        tuple(material for appearance in appearances for material in appearance.materials),
        np.concatenate([row + first for row, first in zip(rows, firsts, strict=False)]).astype(np.int32),
        uv,
        _colors([appearance.vertex_colors for appearance in appearances], [len(item.vertices) for item in items]),
        _colors([appearance.face_colors for appearance in appearances], [len(item.faces) for item in items]),
    )


def _colors(parts: Sequence[NDArray | None], counts: Sequence[int]) -> NDArray[np.float32] | None:
    """Concatenate colors as floats, with white for parts without any; None if no part has any."""
    if all(part is None for part in parts):
        return None
    joined = []
    for part, count in zip(parts, counts, strict=True):
        rows = np.ones((count, 4)) if part is None else part / (255.0 if part.dtype == np.uint8 else 1.0)
        joined.append(rows.astype(np.float32))
    return np.concatenate(joined)
