# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Place a mug that the person sees and the robot does not, then cameras that see it half hidden.

Prints how many samples were needed; writes sample_views.png, or the file that is given.
"""

import sys

import matplotlib.pyplot as plt  # noqa: TID253
import numpy as np
import trimesh

import warpvis as wv
from warpvis.planning import Constraint, ShellRegion, SupportRegion, sample_objects, sample_views
from warpvis.scene.lights import Background, Light

box = trimesh.creation.box
SIZES = {  # on the table: size, place, color
    "cereal": ((0.09, 0.24, 0.34), (0.0, 0.18), (0.85, 0.55, 0.15)),
    "crate": ((0.3, 0.3, 0.2), (-0.12, -0.4), (0.45, 0.6, 0.4)),
    "books": ((0.2, 0.28, 0.12), (0.25, -0.05), (0.35, 0.4, 0.65)),
}
scene = wv.Scene()
scene.lights = [
    Light(direction=(0.4, 0.5, -1.0), color=(0.55, 0.55, 0.55)),
    Light(kind="ambient", ambient=(0.45, 0.45, 0.45)),
]
scene.background = Background(color=(0.88, 0.91, 0.95))
scene.add(box((6, 6, 0.1)), name="floor", label="ground", pose=(0, 0, -0.05, 0, 0, 0, 1), appearance=(0.75, 0.72, 0.68))
scene.add(box((0.9, 1.5, 0.7)), name="table", pose=(0, 0, 0.35, 0, 0, 0, 1), appearance=(0.6, 0.45, 0.32))
for name, (size, (x, y), color) in SIZES.items():
    scene.add(box(size), name=name, pose=(x, y, 0.7 + size[2] / 2, 0, 0, 0, 1), appearance=color)
scene.add(
    trimesh.creation.cylinder(0.04, 0.11), name="mug", label="object", movable=True, appearance=(0.8, 0.1, 0.15),
    pose=(0.3, 0.4, 0.755, 0, 0, 0, 1),
)  # fmt: skip

camera = wv.Camera.from_fov(320, 240, hfov=1.0)
robot = wv.Agent("robot", camera, wv.look_at((-1.4, 0.0, 1.1), (0, 0, 0.75)))
person = wv.Agent("person", camera, wv.look_at((1.3, 0.2, 1.45), (0, 0, 0.7)))
table = SupportRegion("table", margin=0.03)
tasks = [(person, {"mug": (0.9, 1.0)}), (robot, {"mug": Constraint(status="occluded")})]
placed = sample_objects(scene, {"mug": table}, tasks, count=150, seed=0)
print(f"{placed.tries} places of the mug tried, {placed.accepted} accepted; most failed by the {placed.hardest}")

world = placed.object_poses[:1]
half_hidden = {"mug": Constraint(fraction=(0.4, 0.6), pixels=(300, None), margin=10)}
shell = ShellRegion("mug", (0.5, 1.2), elevation=(0.05, 0.9), jitter=0.1)
views = sample_views(scene, camera, half_hidden, shell, count=3, seed=0, object_poses=world)
print(f"{views.tries} cameras tried, {views.accepted} accepted, {views.refined} of them refined")

poses = np.concatenate([robot.poses, person.poses, views.poses])
moved = {"object_poses": world, "world_index": [0] * len(poses)}
images = wv.render(scene, camera, poses, outputs="color", samples=4, **moved)
seen = wv.visible_fractions(scene, camera, poses, objects=["mug"], **moved)
figure, axes = plt.subplots(2, 3, figsize=(9, 4.7), layout="constrained")
plan = axes[0, 0]
for name, (size, (x, y), color) in {"table": ((0.9, 1.5), (0, 0), (0.85, 0.78, 0.7)), **SIZES}.items():
    plan.add_patch(plt.Rectangle((x - size[0] / 2, y - size[1] / 2), *size[:2], color=color, label=name))
plan.plot(*placed.object_poses[:, 0, :2].T, ".", color="crimson", markersize=4)
for agent, marker in ((robot, ">"), (person, "<")):
    plan.plot(*agent.poses[0, :2], marker, color="black")
    plan.annotate(agent.name, agent.poses[0, :2], (0, 6), textcoords="offset points", ha="center", fontsize=8)
plan.set_aspect("equal")
plan.set_title(f"{len(placed.object_poses)} places of the mug", fontsize=9)
names = ["robot", "person", "camera 1", "camera 2", "camera 3"]
for axis, name, image, fraction in zip(
    axes.flat[1:], names, images.color.numpy(), seen.fraction.numpy()[:, 0], strict=True
):
    axis.imshow(image)
    axis.set_title(f"{name}: {fraction:.0%} of the mug", fontsize=9)
for axis in axes.flat:
    axis.set_axis_off()
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "sample_views.png", dpi=100)
