# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Render people in all postures, in front as skinned meshes and behind as round solids; writes people.png."""

import math

import numpy as np
import trimesh

import warpvis as wv
from warpvis.scene.lights import Background, Light
from warpvis.situations import (
    Colors,
    Person,
    crouching,
    looking_at,
    pointing,
    reaching,
    sitting,
    standing,
    walking,
)

SHIRTS = ((0.25, 0.42, 0.65), (0.70, 0.30, 0.25), (0.30, 0.52, 0.35), (0.78, 0.62, 0.25), (0.48, 0.36, 0.58))
SKINS = ((0.85, 0.66, 0.54), (0.55, 0.38, 0.28), (0.72, 0.52, 0.40))
HAIRS = ((0.22, 0.15, 0.10), (0.08, 0.07, 0.07), (0.45, 0.30, 0.16))
SIZES = ((1.78, "male", 1.0), (1.63, "female", 1.0), (1.70, "average", 1.2), (1.85, "male", 0.9), (1.58, "female", 1.1))
HEADING = -math.pi / 2 + 0.5


def main() -> None:
    """Write the picture."""
    scene = wv.Scene()
    scene.lights = (
        Light("ambient", ambient=(0.50, 0.51, 0.54)),
        Light("directional", direction=(0.35, 0.8, -1.1), color=(0.62, 0.60, 0.56), radius=0.05),
    )
    scene.background = Background(color=(0.87, 0.90, 0.93))
    add_box(scene, "floor", (0, 3, -0.01), (30, 30, 0.02), (0.80, 0.79, 0.76), label="ground")
    for row, body in enumerate(("mesh", "solids")):
        for column in range(8):
            place = np.array([1.15 * (column - 3.6) + 0.45 * row, 2.4 * row, 0.0])
            add_person(scene, column, place, body, number=column + 3 * row)
    camera = wv.Camera.from_fov(1300, 500, hfov=math.radians(49))
    pose = wv.look_at((0, -10.0, 4.2), (0, 1.0, 0.62))
    image = wv.render(scene, camera, pose, outputs="color", samples=4).color.numpy()[0]
    from PIL import Image

    Image.fromarray(np.asarray(image)[..., :3]).quantize(200).save("people.png", optimize=True)
    print("16 people in people.png")


def add_person(scene: wv.Scene, column: int, place: np.ndarray, body: str, number: int) -> None:
    """Add a person in the posture of a column, with a seat, a table or a ball."""

    def at(forward: float, left: float, height: float) -> tuple[float, float, float]:
        """Return a point in front of the person."""
        c, s = math.cos(HEADING), math.sin(HEADING)
        return (place[0] + c * forward - s * left, place[1] + s * forward + c * left, height)

    name = f"{body}_{column}"
    ball = {3: at(0.42, -0.22, 1.25), 4: at(0.55, 0.0, 0.5), 6: at(1.0, -0.9, 0.08)}.get(column)
    posture = [
        standing,
        lambda: walking(0.0),
        lambda: sitting(0.45),
        lambda: looking_at(ball, reaching(ball)),
        lambda: looking_at(ball, reaching(ball)),
        lambda: pointing(direction=(-1.0, -0.9, 0.15)),
        lambda: looking_at(ball, crouching(0.75)),
        lambda: sitting(0.45, table_height=0.72),
    ][column]()
    height, sex, build = SIZES[number % len(SIZES)]
    colors = Colors(SKINS[number % 3], HAIRS[(number + 1) % 3], SHIRTS[number % len(SHIRTS)])
    person = Person(height, sex, build, posture, (place[0], place[1], HEADING), colors=colors)
    person.add_to(scene, name, body=body)
    if ball is not None:
        scene.add(
            trimesh.creation.icosphere(radius=0.05),
            name=f"{name}_ball",
            pose=(*ball, 0, 0, 0, 1),
            appearance=(0.85, 0.2, 0.15),
        )
    if column in (2, 7):
        add_box(scene, f"{name}_seat", at(-0.02, 0, 0.22), (0.42, 0.42, 0.44), (0.62, 0.50, 0.38))
    if column == 7:
        add_box(scene, f"{name}_table", at(0.42, 0, 0.70), (0.5, 0.8, 0.03), (0.72, 0.62, 0.48))


def add_box(
    scene: wv.Scene,
    name: str,
    center: tuple[float, float, float],
    size: tuple[float, float, float],
    color: tuple[float, float, float],
    *,
    label: str = "obstacle",
) -> None:
    """Add a box that is turned like the people."""
    pose = (*center, 0, 0, math.sin(HEADING / 2), math.cos(HEADING / 2))
    scene.add(trimesh.creation.box(size), name=name, label=label, pose=pose, appearance=color)


if __name__ == "__main__":
    main()
