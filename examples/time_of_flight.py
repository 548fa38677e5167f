# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Simulate an Azure Kinect in a room, without and with flying pixels, and compare it with exact depth.

The low obstacle is black. Prints the fractions of pixels without depth; writes time_of_flight.png.
"""

import dataclasses

import numpy as np
from matplotlib.figure import Figure  # noqa: TID253

import warpvis as wv

room, pose = wv.scenes.PRESETS["room"].build(), wv.look_at((-1.6, -1.3, 1.6), (0.5, 0.4, 0.3))
sensor = dataclasses.replace(wv.sensors.azure_kinect("nfov_binned"), reflectivity={"low obstacle": 0.005})
images = []
for coherence in (0.9, 0.0):
    model = dataclasses.replace(sensor, min_coherence=coherence)
    views = wv.render(room, sensor.camera(), pose, outputs=("depth", "true_depth"), sensor=model, seed=1, frame=0)
    images.append(views.depth.numpy()[0][40:240, 110:310])
    print(f"least coherence {coherence}: {np.isnan(images[-1]).mean():.1%} of the pixels say nothing")
images.insert(0, views.true_depth.numpy()[0][40:240, 110:310])
figure = Figure(figsize=(12, 3.2), layout="constrained")
axes = figure.subplots(1, 4)
for axis, image in zip(axes[:3], images, strict=True):
    axis.imshow(image, cmap="turbo", vmin=1.5, vmax=4.0)
seen = np.where(np.isfinite(images[2]), images[2], np.nan)
axes[3].imshow(1000 * (seen - images[0]), cmap="coolwarm", vmin=-30, vmax=30)
for axis in axes:
    axis.set_axis_off()
figure.savefig("time_of_flight.png", dpi=70)
