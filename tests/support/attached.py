# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes of objects that are attached to others."""

import trimesh

import warpvis as wv
from warpvis.core.poses import poses_to_matrices

from support.worlds import OPEN_BOX

PARTS = {
    "table": (trimesh.creation.box((0.9, 0.6, 0.05)), (0, 0, 0, 0, 0, 0, 1)),
    "lamp": (trimesh.creation.icosphere(subdivisions=2, radius=0.15), (0.3, 0.1, 0.2, 0, 0, 0.6, 0.8)),
    "tray": ((OPEN_BOX.vertices * 0.5, OPEN_BOX.faces[2:]), (-0.2, 0, 0.2, 0, 0.6, 0, 0.8)),
}


def build(device, table, ball, *, attached=True):
    """Return a table with objects on it and a ball in front, either attached or with separate poses."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((6, 6, 0.02)), name="floor", label="ground")
    for name, (mesh, offset) in PARTS.items():
        place = poses_to_matrices(table) @ poses_to_matrices(offset)
        if attached and name != "table":
            scene.add(mesh, name=name, label="object", pose=place, attach_to="table")
        else:
            scene.add(mesh, name=name, label="object", pose=place, movable=True)
    scene.add(trimesh.creation.icosphere(subdivisions=2, radius=0.3), name="ball", pose=ball, movable=True)
    return scene
