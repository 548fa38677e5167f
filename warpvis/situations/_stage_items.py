# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Objects of interest, things that hide them, people and a robot, which a room gets in addition to its furniture."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import trimesh

from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import check_flag, check_whole
from warpvis.core.labels import Label
from warpvis.errors import SceneError
from warpvis.scene import Scene
from warpvis.situations._numbers import Numbers
from warpvis.situations._surroundings import Surroundings
from warpvis.situations.people import Colors, Person
from warpvis.situations.rooms import RoomItem
from warpvis.situations.rooms.shapes import CATEGORIES

NAMES = ("Anna", "Ben", "Carla", "David")
"""Names of the people."""
SHIRTS = {"red": (0.75, 0.12, 0.12), "blue": (0.12, 0.25, 0.7), "green": (0.1, 0.5, 0.2), "yellow": (0.9, 0.75, 0.1)}
TARGETS = (
    "mug", "bottle", "bowl", "vase", "book", "can", "teapot", "ball", "teddy bear", "toy car", "cushion", "flask",
)  # fmt: skip
TALL_BLOCKERS = ("screen", "poster stand")
BLOCKERS = ("box", "speaker", "toolbox", "books", "pot", "kettle", "monitor", "printer", "toaster", "basket")
TALL = "tall"
"""Prefix of the names of blockers that stand on the floor."""
ROBOT = "robot"
"""Name of the robot."""
ROBOT_RADIUS, ROBOT_HEIGHT, ROBOT_EYES = 0.22, 1.3, 1.2
_PICTURE = Camera.from_fov(320, 240, hfov=math.radians(80), near=0.05, far=math.inf)
_PERSON_VIEW = Camera.from_fov(320, 256, hfov=math.radians(120), near=0.01, far=math.inf)
_ROBOT_VIEW = Camera.kinect()


@dataclass(frozen=True)
class StageOptions:
    """Who and what is in a room."""

    people: int = 2
    """Number of people."""
    robot: bool = True
    """Whether there is a robot with a camera."""
    picture: Camera = _PICTURE
    """The camera of the pictures."""
    person_view: Camera = _PERSON_VIEW
    """The field of both eyes of a person about the gaze, in which both see: 120 degrees wide."""
    robot_view: Camera = _ROBOT_VIEW
    """The camera of the robot, and its range."""

    def __post_init__(self) -> None:
        check_whole(self.people, "people", minimum=0, error=SceneError)
        check_flag(self.robot, "robot", SceneError)
        if self.people > len(NAMES):
            raise SceneError(f"people must be from 0 to {len(NAMES)}, got {self.people}")
        if not self.people and not self.robot:
            raise SceneError("a stage must have at least one person or the robot")
        for name in ("picture", "person_view", "robot_view"):
            if not isinstance(getattr(self, name), Camera):
                raise SceneError(f"{name} must be a Camera, got {type(getattr(self, name)).__name__}")


def choose_items(
    categories: Sequence[str], taken: Counter[str], numbers: Numbers, prefix: str, counts: Sequence[int]
) -> list[RoomItem]:
    """Return items of random categories that a room does not have, several of one in different colors."""
    free = [categories[index] for index in numbers.order(len(categories)) if not taken[categories[index]]]
    items: list[RoomItem] = []
    for category, count in zip(free, counts, strict=False):
        kind = CATEGORIES[category]
        taken[category] += count
        colors = [kind.colors[index] for index in numbers.order(len(kind.colors))][:count]
        parameters = kind.variants[int(numbers.below(len(kind.variants), 1)[0])]
        for color in colors:
            pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
            items.append(RoomItem(f"{prefix}_{len(items)}", category, color, pose, "", parameters=parameters))
    return items


def words_of(room: Surroundings) -> dict[str, str]:
    """Return words for the room's items that are unique in it: ``"the sofa"``, or ``"the red chair"``."""
    named = [item for item in room.items if item.category]
    by_category = Counter(item.category for item in named)
    by_words = Counter(item.words for item in named)
    words = {}
    for item in named:
        if by_category[item.category] == 1:
            words[item.name] = f"the {item.category}"
        elif by_words[item.words] == 1:
            words[item.name] = f"the {item.words}"
    return words


def make_people(count: int, numbers: Numbers) -> dict[str, Person]:
    """Return people of random heights in shirts of different colors, by name."""
    people = {}
    for name, shirt in zip(NAMES[:count], SHIRTS.values(), strict=False):
        height = round(float(numbers.uniform(1.55, 1.9, 1)[0]), 2)
        people[name] = Person(height=height, colors=Colors(shirt=shirt))
    return people


def add_robot(scene: Scene) -> None:
    """Add the robot: a base, a mast and a head with a camera at `ROBOT_EYES`, which looks along x."""
    radius = ROBOT_RADIUS
    parts = [
        trimesh.creation.cylinder(radius, 0.25, sections=24).apply_translation((0, 0, 0.135)),
        trimesh.creation.box((0.08, 0.08, 0.9)).apply_translation((0, 0, 0.7)),
        trimesh.creation.box((0.12, 0.3, 0.16)).apply_translation((0, 0, ROBOT_EYES)),
    ]
    mesh = trimesh.util.concatenate(parts)
    scene.add(
        mesh,
        name=ROBOT,
        label=Label.ROBOT,
        pose=(0, 0, 0, 0, 0, 0, 1),
        movable=True,
        category=ROBOT,
        appearance=(0.92, 0.92, 0.94),
    )
