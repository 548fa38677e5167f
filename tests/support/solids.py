# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes of solids and equivalent triangle meshes."""

import trimesh

import warpvis as wv
from warpvis.scene import solids

SHAPES = {
    "sphere": (solids.sphere(0.4), 1.0),
    "ellipsoid": (solids.ellipsoid((0.6, 0.2, 0.4)), 1.0),
    "capsule": (solids.capsule(0.2, 0.5), 1.0),
    "short capsule": (solids.capsule(0.4, 0.05), 1.0),
    "cylinder": (solids.cylinder(0.3, 0.5), 1.0),
    "disc": (solids.cylinder(0.6, 0.02), 1.0),
    "stretched capsule": (solids.capsule(0.2, 0.3), (1.0, 2.0, 1.5)),
    "stretched cylinder": (solids.cylinder(0.2, 0.3), (3.0, 1.0, 0.5)),
}


def build(device, poses, *, names=tuple(SHAPES), extra=()):
    """Return a scene with a static floor, movable solids at the poses, and movable meshes."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((6, 6, 0.02)), name="floor", label="ground")
    for index, name in enumerate(names):
        shape, scale = SHAPES[name]
        label = ("object", "human", "robot", "obstacle")[index % 4]
        scene.add(shape, name=name, label=label, scale=scale, pose=poses[index], movable=True)
    for index, mesh in enumerate(extra):
        scene.add(mesh, name=f"mesh_{index}", pose=poses[len(names) + index], movable=True)
    return scene
