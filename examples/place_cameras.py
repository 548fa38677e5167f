# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Place six cameras in a lab, so that two of them see each part of the floor while four people walk.

Prints the choice and its bound; writes place_cameras.png, or the path that is given.
"""

import math
import sys

import numpy as np
import trimesh

import warpvis as wv

rng = np.random.default_rng(3)
lab = wv.Scene()
lab.add(trimesh.creation.box((10, 8, 0.1)), name="floor", label="ground", pose=(0, 0, -0.05, 0, 0, 0, 1))
for number, (x, y, width, depth, height) in enumerate(
    [
        (-3, 2.6, 2.4, 0.8, 0.75),
        (-3, -1.2, 0.8, 2.4, 0.75),
        (1.2, 0.4, 1.6, 0.8, 0.75),
        (2.2, 2.8, 0.4, 2.2, 2.0),
        (0.2, -2.9, 3.0, 0.4, 2.0),
        (3.6, -1.5, 0.4, 2.0, 1.6),
        (-0.9, 1.9, 0.4, 1.6, 2.0),
    ]
):
    lab.add(
        trimesh.creation.box((width, depth, height)), name=f"furniture_{number}", pose=(x, y, height / 2, 0, 0, 0, 1)
    )
person = trimesh.creation.capsule(height=1.2, radius=0.25, count=(16, 16))  # its center is where poses are
names = ["ada", "ben", "cleo", "dan"]
for name in names:
    lab.add(person, name=name, label="human", pose=(0, 0, 0.85, 0, 0, 0, 1), movable=True)

# Each person walks between random places, for two minutes with a pose each second.
times, stops = np.arange(120), np.arange(0, 121, 8)
walks = np.zeros((len(times), len(names), 7))
walks[..., 2], walks[..., 6] = 0.85, 1
for number in range(len(names)):
    goals = rng.uniform((-4.5, -3.5), (4.5, 3.5), (len(stops), 2))
    walks[:, number, 0], walks[:, number, 1] = (np.interp(times, stops, goals[:, axis]) for axis in (0, 1))

# Candidates: on the walls and the ceiling, looking down at 20 to 50 degrees in eight directions.
places = [(x, y) for x in np.linspace(-4.9, 4.9, 11) for y in np.linspace(-3.9, 3.9, 9)]
directions = [(a, p) for a in np.arange(8) * math.pi / 4 for p in np.radians([20, 50])]
candidates = np.array(
    [
        wv.look_at((x, y, 2.7), (x + math.cos(a), y + math.sin(a), 2.7 - math.tan(p)))
        for x, y in places
        for a, p in directions
    ]
)
camera = wv.Camera.from_fov(640, 480, hfov=math.radians(87), near=0.3, far=8.0)

# Targets: the floor in steps of 10 cm, apart from what is within 20 cm of furniture.
axes = np.arange(-4.85, 4.9, 0.1), np.arange(-3.85, 3.9, 0.1)
points = np.stack([*np.meshgrid(*axes), np.zeros((len(axes[1]), len(axes[0])))], axis=-1).reshape(-1, 3)
points = points[wv.planning.clearance(lab, points + [0, 0, 0.21], exclude=names).numpy() > 0.2]
placed = wv.planning.place_cameras(lab, camera, candidates, points, 6, at_least=2, object_poses=walks)
print(f"{len(candidates)} candidates, {len(points)} targets, {len(walks)} worlds")
print(f"chosen: {placed.order.tolist()}, objective {placed.fraction:.3f}, at most {placed.bound:.3f}")
print(f"two cameras see {placed.covered_fraction:.1%}, none sees {len(placed.blind_spots(1)) / placed.counts.size:.1%}")
wv.viz.save_placement(lab, placed, sys.argv[1] if len(sys.argv) > 1 else "place_cameras.png")
