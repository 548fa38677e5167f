# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Apply noise models to one exact depth image; print the errors, and write a picture to an optional file argument."""

import sys

import matplotlib.pyplot as plt  # noqa: TID253
import numpy as np
import trimesh

import warpvis as wv

scene = wv.Scene()
scene.add(trimesh.creation.box((8, 8, 0.1)), name="floor", pose=(0, 0, -0.05, 0, 0, 0, 1))
scene.add(trimesh.creation.box((8, 0.1, 4)), name="wall", pose=(0, 1.5, 1, 0, 0, 0, 1))
scene.add(trimesh.creation.box((0.5, 0.5, 0.5)), name="box", pose=(-0.4, 0.2, 0.25, 0, 0, 0, 1))
scene.add(trimesh.creation.icosphere(4, radius=0.3), name="ball", pose=(0.4, 0.0, 0.3, 0, 0, 0, 1))
camera = wv.Camera.from_fov(200, 150, hfov=1.0, near=0.5, far=5.0)
pose = wv.look_at((0.1, -1.6, 0.8), (0, 0.2, 0.35))

kinect = wv.sensors.NguyenNoise()
models = [
    kinect,
    wv.sensors.KhoshelhamNoise(),
    wv.sensors.SimKinect(focal_length=480.0),
    wv.sensors.RedwoodNoise(np.ones((80, 80, 5))),  # a table without distortion
    wv.sensors.Corruptions(multiplied=0.003, dropout=0.03, rectangles=(4, 8), sides=(6, 30), of=kinect),
]
errors = {}
for model in models:
    views = wv.render(scene, camera, pose, outputs=("depth", "true_depth"), sensor=model, seed=1, frame=0)
    exact = views.true_depth.numpy()[0]
    error = np.where(np.isfinite(views.depth.numpy()[0]), views.depth.numpy()[0] - exact, np.nan)
    name = type(model).__name__
    errors[name] = 1000 * error
    middle, lost = np.nanmedian(np.abs(errors[name])), np.isnan(error).mean()
    print(f"{name:16} {middle:.1f} mm of error in the middle, {lost:.1%} lost")

if len(sys.argv) > 1:
    figure, axes = plt.subplots(1, 1 + len(errors), figsize=(2.1 * (1 + len(errors)), 1.9), layout="constrained")
    axes[0].imshow(exact, cmap="viridis_r")
    axes[0].set_title("exact depth", fontsize=9)
    for place, (name, error) in zip(axes[1:], errors.items(), strict=True):
        place.set_facecolor("black")
        place.imshow(error, cmap=plt.get_cmap("RdBu_r", 13), vmin=-30, vmax=30, interpolation="nearest")
        place.set_title(name, fontsize=9)
    for place in axes:
        place.set(xticks=[], yticks=[])
    figure.savefig(sys.argv[1], dpi=77)
