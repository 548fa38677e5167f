# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Situations: people and robots in furnished rooms, what each of them sees, and questions about it."""

from __future__ import annotations

from warpvis.situations._generator import SituationGenerator
from warpvis.situations._options import QUESTION_KINDS, SituationOptions
from warpvis.situations._shortcuts import Shortcut, ShortcutReport, find_shortcuts
from warpvis.situations._situation import Moment, Participant, Question, Sight, Situation, Thing
from warpvis.situations._stage_items import StageOptions
from warpvis.situations.people import (
    JOINT_LIMITS,
    Body,
    Colors,
    Figure,
    Person,
    Posture,
    at_table,
    crouching,
    in_circle,
    in_queue,
    looking_at,
    pointing,
    posed,
    reaching,
    sitting,
    standing,
    stature,
    walking,
)
from warpvis.situations.rooms import ROOM_KINDS, Opening, Room, RoomItem, Seat, SupportPlace, generate_room

__all__ = [
    "JOINT_LIMITS",
    "QUESTION_KINDS",
    "ROOM_KINDS",
    "Body",
    "Colors",
    "Figure",
    "Moment",
    "Opening",
    "Participant",
    "Person",
    "Posture",
    "Question",
    "Room",
    "RoomItem",
    "Seat",
    "Shortcut",
    "ShortcutReport",
    "Sight",
    "Situation",
    "SituationGenerator",
    "SituationOptions",
    "StageOptions",
    "SupportPlace",
    "Thing",
    "at_table",
    "crouching",
    "find_shortcuts",
    "generate_room",
    "in_circle",
    "in_queue",
    "looking_at",
    "pointing",
    "posed",
    "reaching",
    "sitting",
    "standing",
    "stature",
    "walking",
]
