# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Fit the parameters of a depth camera model to images of six flat walls.

Prints the report; writes sensor_fit.png.
"""

import trimesh

import warpvis as wv

camera = wv.Camera.from_fov(320, 200, hfov=1.4)
model = wv.sensors.StereoDepth(0.05, sigma=0.08, noise_spacing=4, subpixel=32, dropout=0.02)
pictures = []
for number, distance in enumerate((0.6, 1.0, 1.5, 2.0, 3.0, 4.0)):
    flat = wv.Scene()
    flat.add(trimesh.creation.box((60, 0.02, 60)), name="wall", pose=(0, distance, 0, 0, 0, 0.08, 0.9968))
    views = wv.render(flat, camera, wv.look_at((0, 0, 0), (0, 1, 0)), sensor=model, frame=number, outputs="depth")
    pictures.append(views.depth.numpy()[0])
found = wv.sensors.fit(pictures, camera)
print(found.report())
wv.viz.save_sensor_fit(found, "sensor_fit.png")
