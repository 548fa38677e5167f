# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compare measured depth with the depth that a scene predicts: print what changed, and write a picture.

Prints a line per object; writes a picture to an optional file argument.
"""

import sys

import matplotlib.pyplot as plt  # noqa: TID253
import numpy as np
import trimesh
from matplotlib.colors import BoundaryNorm, ListedColormap  # noqa: TID253

import warpvis as wv
from warpvis.maps import Agreement

PLACES = {"cup": (0.0, 0.25), "box": (0.1, -0.15), "ball": (-0.1, 0.0), "book": (0.15, -0.5)}
MESHES = {
    "cup": trimesh.creation.cylinder(0.05, 0.14),
    "box": trimesh.creation.box((0.16, 0.16, 0.2)),
    "ball": trimesh.creation.icosphere(4, radius=0.08),
    "book": trimesh.creation.box((0.2, 0.28, 0.08)),
}


def build(places):
    """Return a room with a table and things on it."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((5, 5, 0.1)), name="floor", label="ground", pose=(1, 0, -0.05, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.1, 5, 3)), name="wall", pose=(1.2, 0, 1.5, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.7, 1.5, 0.05)), name="table", pose=(0, 0, 0.7, 0, 0, 0, 1))
    for name, (x, y) in places.items():
        height = 0.725 + MESHES[name].extents[2] / 2
        scene.add(MESHES[name], name=name, label="object", pose=(x, y, height, 0, 0, 0, 1))
    return scene


expected = build(PLACES)
# Somebody moved the box by 12 cm, took the cup away, and left a basket.
now = build({"box": (0.1, -0.27), "ball": PLACES["ball"], "book": PLACES["book"]})
now.add(trimesh.creation.box((0.3, 0.3, 0.2)), name="basket", pose=(-0.1, 0.5, 0.825, 0, 0, 0, 1))

sensor = wv.sensors.realsense_d435(424, 240)
camera = sensor.camera()
pose = wv.look_at((-0.9, 0.0, 1.25), (0.1, 0.0, 0.75))
depth = wv.render(now, camera, pose, sensor=sensor, frame=0).depth
found = wv.compare_depth(expected, camera, pose, depth, sigma=sensor)
print(*found.changes(), sep="\n")

if len(sys.argv) > 1:
    figure, axes = plt.subplots(1, 3, figsize=(10, 1.9), layout="constrained")
    measured = depth.numpy()[0]
    shown = {"expected depth": found.expected.numpy()[0], "measured depth": np.where(measured > 0, measured, np.nan)}
    for axis, (title, image) in zip(axes, shown.items(), strict=False):
        picture = axis.imshow(np.where(np.isfinite(image), image, np.nan), cmap="viridis", vmin=0.6, vmax=2.4)
        axis.set_title(title, fontsize=9)
    figure.colorbar(picture, ax=axes[1], label="m", shrink=0.9)
    colors = ListedColormap(["black", "lightgray", "tab:red", "tab:blue", "gold"])
    labels = axes[2].imshow(found.labels.numpy()[0], cmap=colors, norm=BoundaryNorm(np.arange(-0.5, 5), 5))
    axes[2].set_title("agreement", fontsize=9)
    bar = figure.colorbar(labels, ax=axes[2], ticks=range(5), shrink=0.9)
    bar.ax.set_yticklabels([state.name.lower().replace("_", " ") for state in Agreement], fontsize=7)
    for axis in axes:
        axis.set_axis_off()
    figure.savefig(sys.argv[1], dpi=130)
