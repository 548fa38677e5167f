# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes: objects and solids, their poses in parallel worlds, and the trees that rays traverse."""

from __future__ import annotations

from warpvis.scene import joints, lights, materials, randomization, solids, world_appearances
from warpvis.scene._mesh import Mesh as Mesh, keep_winding as keep_winding
from warpvis.scene._object import (
    SceneObject as SceneObject,
    fits_millimeters as fits_millimeters,
    looks_like_millimeters as looks_like_millimeters,
    take_snapshot as take_snapshot,
    too_large_for as too_large_for,
)
from warpvis.scene._parts import (
    Y_UP_TO_Z_UP as Y_UP_TO_Z_UP,
    Axis as Axis,
    FileParts as FileParts,
    Part as Part,
    in_file_frame as in_file_frame,
    move_with_links as move_with_links,
)
from warpvis.scene._scene import Scene as Scene, require_scene as require_scene

__all__ = [
    "joints",
    "lights",
    "materials",
    "randomization",
    "solids",
    "world_appearances",
]
