# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A table with a cup, a book and a board, a robot and a person on its two sides, for tests of picked points."""

import trimesh

import warpvis as wv

CUP, BOOK = (1.6, 0.3, 0.85), (1.6, -0.4, 0.85)
"""Centers of the cup and the book, which are boxes 0.1 m wide."""
BOARD = 1.2
"""Where the board's front is, the side of the robot."""
EYES, HEAD = (0.0, 0.3, 0.85), (3.0, 0.0, 1.2)
"""The robot's eyes, at the height of the cup and behind the board, and the person's."""


def table():
    """Return the scene: the board stands between the robot and the cup."""
    scene, box = wv.Scene(), trimesh.creation.box
    scene.add(box((6, 4, 0.1)), name="floor", label="ground", pose=(1.5, 0, -0.05, 0, 0, 0, 1))
    scene.add(box((1, 1.4, 0.8)), name="table", pose=(1.6, 0, 0.4, 0, 0, 0, 1))
    scene.add(box((0.1, 0.1, 0.1)), name="cup", label="object", pose=(*CUP, 0, 0, 0, 1))
    scene.add(box((0.1, 0.1, 0.1)), name="book", label="object", pose=(*BOOK, 0, 0, 0, 1))
    scene.add(box((0.04, 0.3, 0.3)), name="board", pose=(BOARD + 0.02, 0.3, 0.95, 0, 0, 0, 1))
    scene.add(box((0.3, 0.3, 1.1)), name="anna's body", label="human", pose=(3.2, 0, 0.55, 0, 0, 0, 1))
    head = trimesh.creation.icosphere(radius=0.12)
    scene.add(head, name="anna's head", label="human", pose=(3.1, 0, 1.25, 0, 0, 0, 1))
    return scene


def agents():
    """Return the robot, which looks at the board, and anna, who looks between the cup and the book."""
    robot = wv.Agent.kinect("robot", wv.look_at(EYES, CUP))
    body = ("anna's body", "anna's head")
    return [robot, wv.Agent.human("anna", wv.look_at(HEAD, (1.6, -0.05, 0.85)), body=body)]
