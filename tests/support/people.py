# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A person at the origin who looks along x, and things to look at."""

import math

import numpy as np
import trimesh

import warpvis as wv
from warpvis.visibility import Agent, perspective

AHEAD = wv.look_at((0, 0, 0), (1, 0, 0))
CUP = trimesh.creation.cylinder(radius=0.04, height=0.1)
BOOK = trimesh.creation.box((0.03, 0.15, 0.22))
IDENTITY = (0, 0, 0, 1)


def at(degrees, distance=1.5, height=0.0):
    """Return a place seen from the origin, `degrees` to the right of the x axis."""
    angle = math.radians(degrees)
    return np.array([distance * math.cos(angle), -distance * math.sin(angle), height])


def see(things, eyes=AHEAD, others=(), **options):
    """Return the perspective of a person on objects, ``(name, mesh, place)``."""
    scene = wv.Scene()
    for name, mesh, place in things:
        scene.add(mesh, name=name, label="object", pose=(*place, *IDENTITY))
    return perspective(scene, [*others, Agent.human("human", eyes, **options)])


def chances(found):
    return {item.object: item.probability for item in found}


CUP_AND_BOOK = [("cup", CUP, at(0)), ("book", BOOK, at(24))]
