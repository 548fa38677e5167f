# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Render posts with a rotating rolling-shutter camera and a fast-moving lidar, whose points are then de-skewed.

Prints the maximum displacement by de-skewing; writes motion.png.
"""

import numpy as np
import trimesh
from matplotlib.figure import Figure  # noqa: TID253

import warpvis as wv

posts = wv.Scene()
for x in range(-6, 7):
    posts.add(trimesh.creation.box((0.3, 0.3, 4)), name=f"post_{x}", pose=(x, 3 + 0.3 * (x % 2), 0, 0, 0, 0, 1))
posts.add(trimesh.creation.box((14, 10, 4)), name="walls")
turning = wv.sensors.Motion.from_twist(wv.look_at((0, 0, 0), (0, 1, 0)), (0, 0, 0), (0, 3.0, 0))
shutter = wv.sensors.RollingShutter(wv.Camera.from_fov(320, 240, hfov=1.2), readout=0.05)
depth = wv.render(posts, shutter, turning, outputs="depth").depth.numpy()[0]

os1 = wv.sensors.lidars.ouster("OS1-64")
drive = wv.sensors.Motion.from_twist((0, 0, 0, 0, 0, 0, 1), (15.0, 0, 0), (0, 0, 2.0))
measured = wv.sensors.point_clouds(wv.render(posts, os1, drive), os1)
straight = wv.sensors.deskew(measured, drive)
moved = np.hypot(*(straight[0][axis] - measured[0][axis] for axis in "xy")).max()
print(f"de-skewing {len(measured[0])} points moves them by up to {moved:.2f} m")
figure = Figure(figsize=(12, 3.2), layout="constrained")
axes = figure.subplots(1, 3)
axes[0].imshow(depth, cmap="turbo")
for axis, cloud in zip(axes[1:], (measured[0], straight[0]), strict=True):
    level = cloud[np.abs(cloud["z"]) < 0.5]
    axis.scatter(level["x"], level["y"], c=level["time"], s=0.2, cmap="viridis")
    axis.set_aspect("equal")
figure.savefig("motion.png", dpi=70)
