# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The appearance of all objects of a mesh file together, which are one object of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from warpvis.scene import SceneObject
from warpvis.scene.looks import Look
from warpvis.scene.materials import Appearance, Material

_GRAY = Material(base_color=(0.5, 0.5, 0.5, 1.0))
"""Of what has no color, as MuJoCo has it."""


def joined_look(items: Sequence[SceneObject]) -> Look | None:
    """Return the look of objects whose vertices and faces are joined in their order; None if none has any."""
    return Look(partial(_joined, items)) if any(item.look is not None for item in items) else None


def _joined(items: Sequence[SceneObject]) -> Appearance | None:
    found = [item.appearance for item in items]
    if not any(found):
        return None
    looks = [look or Appearance((_GRAY,)) for look in found]
    firsts = np.cumsum([0, *(len(look.materials) for look in looks)])
    rows = [
        np.zeros(len(item.faces), dtype=np.int32) if look.face_materials is None else look.face_materials
        for item, look in zip(items, looks, strict=True)
    ]
    uv = None
    if any(look.uv is not None for look in looks):
        corners = [look.corner_uv(item.faces) for item, look in zip(items, looks, strict=True)]
        uv = np.concatenate(
            [
                np.zeros((len(item.faces), 3, 2), dtype=np.float32) if part is None else part
                for item, part in zip(items, corners, strict=True)
            ]
        )
    return Appearance(
        tuple(material for look in looks for material in look.materials),
        np.concatenate([row + first for row, first in zip(rows, firsts, strict=False)]).astype(np.int32),
        uv,
        _colors([look.vertex_colors for look in looks], [len(item.vertices) for item in items]),
        _colors([look.face_colors for look in looks], [len(item.faces) for item in items]),
    )


def _colors(parts: Sequence[NDArray | None], counts: Sequence[int]) -> NDArray[np.float32] | None:
    """Join colors as floats, with white where a part has none; None if no part has any."""
    if all(part is None for part in parts):
        return None
    joined = []
    for part, count in zip(parts, counts, strict=True):
        rows = np.ones((count, 4)) if part is None else part / (255.0 if part.dtype == np.uint8 else 1.0)
        joined.append(rows.astype(np.float32))
    return np.concatenate(joined)
