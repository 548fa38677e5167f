# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Situations: who is where among which objects, what each of them sees, and questions about it with exact answers."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from warpvis.core.types import Json

Pose = tuple[float, ...]
"""``x y z qx qy qz qw``."""


@dataclass(frozen=True)
class Thing:
    """An object of interest in a situation."""

    name: str
    """Its name in the scene."""
    category: str
    """Its class in words: ``"mug"``."""
    color: str
    """The word for its color: ``"red"``; empty if it has none."""
    pose: Pose
    """Object to world."""
    size: tuple[float, float, float]
    """Sides of its box in its own frame [m]."""

    @property
    def words(self) -> str:
        """Color and category: ``"red mug"``."""
        return f"{self.color} {self.category}".strip()


@dataclass(frozen=True)
class Participant:
    """A person or a robot in a situation."""

    name: str
    """Its name: ``"Anna"``."""
    kind: str
    """``"person"`` or ``"robot"``."""
    eyes: Pose
    """Camera to world, in OpenCV's axes: z is the direction of the gaze."""
    posture: str = "standing"
    """Posture of a person: ``"standing"``, ``"sitting"``, ...; ``"fixed"`` for a robot."""
    words: str = ""
    """How questions refer to it: ``"the person in the blue shirt"``."""


@dataclass(frozen=True)
class Sight:
    """How much of an object a participant, or the camera, sees at a time."""

    agent: str
    """Name of the participant; ``"camera"`` for the camera of the pictures."""
    thing: str
    """Name of the object."""
    time: int
    """Index of the moment in `Situation.moments`."""
    fraction: float
    """Visible share of its silhouette, from 0 to 1."""
    error: float
    """Bound of the error of `fraction`."""
    state: str
    """``"visible"``, ``"occluded"``, ``"out_of_view"``, ``"too_near"`` or ``"too_far"``."""
    blockers: tuple[tuple[str, float], ...] = ()
    """Objects that hide it, and the share of the silhouette that each hides, in descending order."""
    degrees: float | None = None
    """Angle between the nearest change of visibility and the object, positive if it is visible; None if not known."""
    meters: float | None = None
    """Least sideways movement of the blocker that may change the answer [m]; None if not known."""


@dataclass(frozen=True)
class Question:
    """A question about a situation."""

    kind: str
    """Its type: ``"sees"``, ``"why_not"``, ``"left_right"``, ..."""
    text: str
    """The question in words."""
    paraphrases: tuple[str, ...]
    """Other wordings with the same answer."""
    choices: tuple[str, ...]
    """The possible answers."""
    answer: str
    """The correct one."""
    reason: str
    """Why, in words."""
    about: tuple[str, ...]
    """Names of the participants and objects that it is about."""
    margin: float
    """How far the answer is from changing, in units of its decision: a share of a silhouette, degrees or meters."""
    unit: str
    """Unit of `margin`: ``"share"``, ``"degrees"`` or ``"meters"``."""


@dataclass(frozen=True)
class Moment:
    """Places of objects, people and robots at a time."""

    things: tuple[Thing, ...]
    """The objects of interest."""
    participants: tuple[Participant, ...]
    """The people and robots."""
    time: float = 0.0
    """Time since the first moment [s]."""
    poses: dict[str, Pose] = field(default_factory=dict)
    """Poses of all movable objects of the scene, bodies of people among them, object to world."""


@dataclass(frozen=True, eq=False)
class Situation:
    """A situation: its moments, what each participant sees, questions with answers, and pictures."""

    name: str
    """Its unique name in a data set: ``"00012-0037"``, the numbers of its room and of the situation in it."""
    room: dict[str, Json]
    """The room: its seed and kind, and everything else that rebuilds it."""
    camera: dict[str, Json]
    """Intrinsics and pose of the camera of the pictures, and intrinsics of the participants' views."""
    moments: tuple[Moment, ...]
    """One moment, or several for situations over time."""
    sights: tuple[Sight, ...]
    """What each participant and the camera see of each object, at each moment."""
    questions: tuple[Question, ...]
    """Questions about it."""
    twin: str | None = None
    """Name of the other situation of a matched pair: only one object differs, and one answer is the opposite."""
    changed: dict[str, Json] = field(default_factory=dict)
    """For a twin, the object that differs, and by how much [m]."""
    images: dict[str, np.ndarray] = field(default_factory=dict)
    """Pictures by view and output: ``"camera/color"``, ``"camera/depth"``, ``"Anna/color"``, ...; of several moments,
    ``"camera/color/1"``."""

    def to_dict(self) -> dict[str, Json]:
        """Return everything but the pictures, for JSON."""
        described = asdict(replace(self, images={}))
        del described["images"]
        return described

    @classmethod
    def from_dict(cls, data: dict[str, Any], images: dict[str, np.ndarray] | None = None) -> Situation:
        """Restore a situation from `to_dict`, and from its pictures."""
        moments = tuple(
            Moment(
                tuple(Thing(**{**t, "pose": tuple(t["pose"]), "size": tuple(t["size"])}) for t in moment["things"]),
                tuple(Participant(**{**p, "eyes": tuple(p["eyes"])}) for p in moment["participants"]),
                moment["time"],
                {name: tuple(pose) for name, pose in moment["poses"].items()},
            )
            for moment in data["moments"]
        )
        sights = tuple(
            Sight(**{**s, "blockers": tuple((name, share) for name, share in s["blockers"])}) for s in data["sights"]
        )
        lists = ("paraphrases", "choices", "about")
        questions = tuple(Question(**{**q, **{name: tuple(q[name]) for name in lists}}) for q in data["questions"])
        replaced = {"moments": moments, "sights": sights, "questions": questions, "images": images or {}}
        return cls(**{**data, **replaced})
