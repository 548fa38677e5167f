# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Render one revolution of an Ouster OS1-128 in a room: its range image, and points of nearly level beams from above.

Prints the number of points; writes lidar.png.
"""

import numpy as np
import trimesh
from matplotlib.figure import Figure  # noqa: TID253

import warpvis as wv

hall = wv.scenes.PRESETS["room"].build()
hall.add(trimesh.creation.box((6, 5, 3)), name="walls", pose=(0.4, 0, 1.4, 0, 0, 0, 1))
os1 = wv.sensors.lidars.ouster("OS1-128")
scan = wv.render(hall, os1, (-0.9, -0.4, 0.8, 0, 0, 0, 1), outputs=("depth", "segmentation"))
cloud = wv.sensors.point_clouds(scan, os1)[0]
level = cloud[np.abs(cloud["z"] + 0.09 * cloud["range"]) < 0.12 * cloud["range"]]
print(f"{len(cloud)} points, {len(level)} of beams between 12 degrees down and 2 degrees up")
figure = Figure(figsize=(8, 7), layout="constrained")
image, above = figure.subplots(2, 1, height_ratios=(1, 3))
image.imshow(scan.depth.numpy()[0], aspect="auto", cmap="turbo")
above.scatter(level["x"], level["y"], c=level["object"], s=0.2, cmap="tab10")
above.set_aspect("equal")
figure.savefig("lidar.png", dpi=80)
