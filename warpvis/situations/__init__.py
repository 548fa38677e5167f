# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Situations: people and robots in furnished rooms, what each of them sees, and questions about it."""

from __future__ import annotations

from warpvis.situations._shortcuts import Shortcut, ShortcutReport, find_shortcuts
from warpvis.situations._situation import Moment, Participant, Question, Sight, Situation, Thing

__all__ = [
    "Moment",
    "Participant",
    "Question",
    "Shortcut",
    "ShortcutReport",
    "Sight",
    "Situation",
    "Thing",
    "find_shortcuts",
]
