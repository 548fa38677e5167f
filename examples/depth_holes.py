# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Show the holes of a RealSense D435: one decision per pixel, windows, and images that are rendered and matched.

Prints the number of holes and the fraction of lost pixels; writes depth_holes.png.
"""

import dataclasses
import math

import numpy as np
import trimesh
from matplotlib.figure import Figure  # noqa: TID253
from scipy import ndimage

import warpvis as wv

scene = wv.Scene()
scene.add(trimesh.creation.box((9, 9, 0.1)), name="floor", pose=(1, 0, -0.05, 0, 0, 0, 1))
scene.add(trimesh.creation.box((0.1, 9, 6)), name="wall", pose=(4, 0, 2, 0, 0, 0, 1))
scene.add(trimesh.creation.box((9, 0.1, 6)), name="side", pose=(1, -3, 2, 0, 0, 0, 1))
scene.add(trimesh.creation.box((1.0, 1.6, 0.1)), name="table", pose=(2.2, 0, 0.75, 0, 0, 0, 1))
scene.add(trimesh.creation.box((0.2, 0.25, 0.3)), name="box", pose=(2.2, 0.45, 0.95, 0, 0, 0, 1))
scene.add(trimesh.creation.box((0.3, 0.4, 0.06)), name="book", pose=(2.1, -0.5, 0.83, 0, 0, 0, 1))
scene.add(trimesh.creation.icosphere(radius=0.1), name="ball", pose=(2.0, -0.05, 0.9, 0, 0, 0, 1))
pose = wv.look_at((0.9, 0.4, 1.4), (2.2, 0, 0.8))

windows = dataclasses.replace(wv.sensors.realsense_d435(640, 480), reflectivity={"book": 0.045})
angles = {"min_signal": math.cos(math.radians(85)), "full_signal": math.cos(math.radians(60))}
sensors = {
    "one decision per pixel": dataclasses.replace(windows, fattening=0, hole_spacing=1, **angles),
    "realsense_d435": windows,
    "MatchedStereo": wv.sensors.MatchedStereo(
        windows.baseline, reflectivity=windows.reflectivity, native_camera=windows.camera()
    ),
}
images = {"exact": wv.render(scene, windows.camera(), pose).depth.numpy()[0]}
for name, sensor in sensors.items():
    depth = wv.render(scene, sensor.camera(), pose, outputs="depth", sensor=sensor, seed=1, frame=0).depth.numpy()[0]
    images[name] = depth
    lost = ~np.isfinite(depth)
    print(f"{name}: {lost.mean():.1%} lost, {ndimage.label(lost)[1]} holes")

figure = Figure(figsize=(10, 7.8), layout="constrained")
for axis, (name, depth) in zip(figure.subplots(2, 2).flat, images.items(), strict=True):
    axis.imshow(np.where(np.isfinite(depth), depth, np.nan), cmap="turbo", vmin=0.3, vmax=4.5, interpolation="nearest")
    axis.set_title(name)
    axis.set_axis_off()
figure.savefig("depth_holes.png", dpi=80)
