# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Posable people: bodies by stature, postures, objects of a scene, and agents that see from their eyes."""

from __future__ import annotations

from warpvis.situations.people._body import Body, stature
from warpvis.situations.people._figure import Figure
from warpvis.situations.people._groups import at_table, in_circle, in_queue
from warpvis.situations.people._person import Colors, Person
from warpvis.situations.people._postures import (
    Posture,
    crouching,
    looking_at,
    pointing,
    posed,
    reaching,
    sitting,
    standing,
    walking,
)
from warpvis.situations.people._skeleton import JOINT_LIMITS

__all__ = [
    "JOINT_LIMITS",
    "Body",
    "Colors",
    "Figure",
    "Person",
    "Posture",
    "at_table",
    "crouching",
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
