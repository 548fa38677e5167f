# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Label the floor of a D435 that is carried through a room, without knowing its pose.

`fit_floor` finds the floor in each image. Prints its heights; writes measured_floor.png: depth, labels with a tolerance
of 1 cm, and labels with a tolerance that grows with the noise, in which points below the floor have their own color.
"""

import numpy as np
import trimesh
from matplotlib.figure import Figure  # noqa: TID253

import warpvis as wv

BELOW = 9
COLORS = np.zeros((256, 3), dtype=np.uint8)
COLORS[wv.Label.GROUND], COLORS[wv.Label.OBSTACLE], COLORS[BELOW] = (120, 180, 120), (200, 90, 70), (70, 90, 200)


def build_room():
    """Return a room with boxes, and a stair that leads down behind the floor."""
    scene = wv.Scene(device="cpu")
    parts = {"floor": ((7, 5, 0.1), (0, 1.5, -0.05)), "wall": ((0.1, 8, 3), (-2.5, 3, 1.0))}
    parts |= {"table": ((1.4, 0.8, 0.05), (1.2, 3.2, 0.72)), "box": ((0.5, 0.5, 0.4), (-0.6, 3.0, 0.2))}
    parts |= {f"step {k}": ((7, 0.3, 0.1), (0, 4.15 + 0.3 * k, -0.22 - 0.17 * k)) for k in range(6)}
    parts |= {"lower floor": ((7, 4, 0.1), (0, 7.8, -1.24))}
    for name, (size, center) in parts.items():
        scene.add(trimesh.creation.box(size), name=name, pose=(*center, 0, 0, 0, 1))
    return scene


scene, sensor = build_room(), wv.sensors.realsense_d435(424, 240)
camera = sensor.camera()
poses = np.stack([
    wv.look_at((-0.8, -0.6, 1.3), (0.2, 3.0, 0.2), up=(0.12, 0, 1)),
    wv.look_at((0.0, 0.2, 1.1), (0.1, 3.2, 0.0), up=(-0.2, 0, 1)),
    wv.look_at((0.6, 0.9, 1.4), (-0.2, 4.2, -0.1), up=(0.3, 0, 1)),
])  # fmt: skip
images = wv.render(scene, camera, poses, outputs="depth", sensor=sensor, seed=1, frame=0).depth.numpy()
figure = Figure(figsize=(10, 6), layout="constrained")
for column, depth, pose in zip(figure.subplots(3, 3).T, images, poses, strict=True):
    fit = wv.fit_floor(depth, camera)
    print(f"height {fit.camera_height:.3f} m instead of {pose[2]:.3f} m, confidence {fit.confidence:.2f}")
    fixed = wv.classify(depth, camera, fit.camera_to_world).numpy()[0]
    grown = wv.classify(depth, camera, fit.camera_to_world, sigma=sensor, below_label=BELOW).numpy()[0]
    column[0].imshow(np.where(np.isfinite(depth), depth, np.nan), cmap="turbo", vmin=0.5, vmax=6.0)
    column[1].imshow(COLORS[fixed])
    column[2].imshow(COLORS[grown])
    titles = f"depth, {fit.camera_height:.2f} m above the floor", "tolerance of 1 cm", "1 cm and 3 standard deviations"
    for axis, title in zip(column, titles, strict=True):
        axis.set_title(title)
        axis.set_axis_off()
figure.savefig("measured_floor.png", dpi=80)
