# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A ball that a box hides, and a camera in front, for tests of visible fractions."""

import numpy as np
import trimesh

import warpvis as wv


def hidden_scene(device="cpu"):
    """Return a ball behind a box that hides most of it."""
    scene = wv.Scene(device=device)
    scene.add(
        trimesh.creation.icosphere(subdivisions=3, radius=0.4), name="ball", pose=(3, 0, 0, 0, 0, 0, 1), movable=True
    )
    scene.add(trimesh.creation.box(extents=(0.4, 1.0, 2.0)), name="box", pose=(1.5, 0.38, 0, 0, 0, 0, 1), movable=True)
    return scene


START = np.array([*(0, 0, 0.05), *wv.look_at((0, 0, 0.05), (3, 0, 0)).reshape(-1)[3:7]])
