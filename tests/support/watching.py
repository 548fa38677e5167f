# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A rendered room with a board and two balls, and a camera that looks at it, for tests of `DepthWatcher`."""

import json

import numpy as np
import trimesh

import warpvis as wv

CAMERA = wv.Camera.from_fov(160, 120, hfov=1.4, near=0.1, far=8.0)
BALL, BOX = (2.0, 0.5, 0.6, 0.2), (2.2, -1.0, 0.6, 0.2)
"""Two places of interest, x y z diameter: balls on high tables. The board stands beside the first."""
EYES = (4.2, 0.6, 1.4)
"""Where a person stands who looks back at the board."""
FLOOR = 0.4
"""Height of the floor."""


def room():
    """Return a floor, walls, a board, and a ball at each place of interest, all above `FLOOR`."""
    scene = wv.Scene()
    up = FLOOR
    box = trimesh.creation.box
    scene.add(box((8, 8, 0.1)), name="floor", label="ground", pose=(2, 0, up - 0.05, 0, 0, 0, 1))
    scene.add(box((0.1, 8, 3)), name="wall", pose=(5.5, 0, up + 1.5, 0, 0, 0, 1))
    scene.add(box((0.06, 1.2, 0.9)), name="board", pose=(2.6, 0.6, up + 0.45, 0, 0, 0, 1))
    for name, (x, y, z, diameter) in (("ball", BALL), ("box", BOX)):
        scene.add(trimesh.creation.icosphere(radius=diameter / 2), name=name, pose=(x, y, up + z, 0, 0, 0, 1))
        height = z - diameter / 2
        scene.add(box((0.15, 0.15, height)), name=f"{name} table", pose=(x, y, up + height / 2, 0, 0, 0, 1))
    return scene


def trajectory(count=8):
    """Return poses of a camera that moves sideways at a height of 1.1 m."""
    sides = np.linspace(-0.6, 0.6, count)
    return np.array([wv.look_at((0, side, FLOOR + 1.1), (2.4, 0, FLOOR + 0.4)) for side in sides])


def raised(place):
    """Return a place in the world of the scene."""
    x, y, z, *rest = place
    return (x, y, z + FLOOR, *rest)


def person(name="anna", eyes=EYES, target=BALL):
    return wv.Agent.human(name, wv.look_at(raised(eyes), raised(target)[:3]))


def depths(poses, scene=None):
    return wv.render(room() if scene is None else scene, CAMERA, poses, outputs="depth").depth.numpy()


def save_folder(folder, count=8):
    """Write depth images in millimeters, and poses at 0, 1, 2, ... s; return the file of the camera."""
    (folder / "depth").mkdir(parents=True)
    poses = trajectory(count)
    for index, depth in enumerate(depths(poses)):
        wv.io.save_depth_png(depth, folder / "depth" / f"{index:06d}.png")
    lines = [f"{index} " + " ".join(f"{value:.9f}" for value in row) for index, row in enumerate(poses)]
    (folder / "groundtruth.txt").write_text("\n".join(lines) + "\n")
    k = {"width": CAMERA.width, "height": CAMERA.height, "hfov": CAMERA.hfov, "near": CAMERA.near, "far": CAMERA.far}
    (folder.parent / "camera.json").write_text(json.dumps(k))
    return folder.parent / "camera.json"
