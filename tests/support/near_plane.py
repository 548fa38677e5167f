# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes clipped by the near plane."""

import numpy as np
import trimesh

import warpvis as wv
from warpvis.scene import solids

from compare import assert_matches_reference

CAMERA = wv.Camera.from_fov(48, 36, hfov=1.2, near=0.5, far=50.0)


def scene(device):
    """Return a room with a table, a housing around one camera, a ball of triangles and a sheet parallel to one view."""
    made = wv.Scene(device=device)
    made.add(trimesh.creation.box((8, 6, 0.1)), name="floor", label="ground", pose=(0, 0, -1, 0, 0, 0, 1))
    made.add(trimesh.creation.box((0.1, 6, 4)), name="wall", pose=(4, 0, 0, 0, 0, 0, 1))
    made.add(trimesh.creation.box((0.6, 0.5, 0.4)), name="housing", label="object")
    made.add(trimesh.creation.icosphere(2, 0.4), name="ball", pose=(1.0, 0.2, 0, 0, 0, 0, 1), movable=True)
    made.add(trimesh.creation.box((0.3, 0.3, 0.3)), name="cube", pose=(2, -0.4, 0, 0, 0, 0.3, 0.954), movable=True)
    made.add(solids.capsule(0.2, 0.3), name="post", pose=(3, 1.5, 0, 0, 0, 0, 1), movable=True)
    made.add(trimesh.creation.box((0.02, 1, 1)), name="sheet", pose=(0.4, 0, 0, 0, 0, 0, 1))
    return made


def poses():
    """Return poses in the housing, close to the ball so that it is clipped, in the ball, and above the floor."""
    eyes = [((0, 0, 0), (4, 0, 0)), ((0.45, 0.1, 0.05), (1, 0.2, 0)), ((1, 0.2, 0.1), (3, -0.5, 0))]
    eyes.append(((-1, 0, -0.7), (2, 0, -0.95)))
    return np.array([wv.look_at(eye, target) for eye, target in eyes], dtype=np.float32)


def assert_cut(views, scene, poses, cull_backfaces):
    """Check clipped views against the reference, with no depth below the near plane."""
    assert_matches_reference(views, scene, CAMERA, poses, cull_backfaces=cull_backfaces, near_plane="clip")
    depth = views.depth.numpy()
    assert not np.isneginf(depth).any() and depth.min() >= np.float32(CAMERA.near)


SOLIDS = {"ball": solids.sphere(0.5), "cylinder": solids.cylinder(0.5, 0.5)}


def assert_solid_is_cut(kind, device, render):
    """Check that a clipped solid shows its inner side within tessellation tolerance or, culled, the wall behind it."""
    made = wv.Scene(device=device)
    made.add(SOLIDS[kind], name=kind, pose=(0.8, 0, 0, 0, 0, 0, 1), movable=True)
    made.add(trimesh.creation.box((0.1, 6, 6)), name="wall", pose=(3, 0, 0, 0, 0, 0, 1))
    pose = np.array([wv.look_at((0, 0, 0), (1, 0, 0))], dtype=np.float32)
    for cull_backfaces, expected in ((False, 1.3), (True, 2.95)):
        views = render(made, pose, cull_backfaces)
        depth, normals = views.depth.numpy()[0], views.normals.numpy()[0]
        assert abs(depth[18, 24] - expected) < 3e-3
        assert depth.min() >= np.float32(CAMERA.near)
        assert np.linalg.norm(normals[18, 24] - [-1, 0, 0]) < 0.1
