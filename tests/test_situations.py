# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Situations: their records."""

import json

import numpy as np

from warpvis.situations import Moment, Participant, Question, Sight, Situation, Thing

POSE = (0.0, 1.0, 2.0, 0.0, 0.0, 0.0, 1.0)


def test_records_survive_json():
    mug = Thing("mug_0", "mug", "red", POSE, (0.1, 0.1, 0.1))
    assert mug.words == "red mug"
    situation = Situation(
        "00000-0001",
        {"seed": 3, "kind": "office"},
        {"width": 64},
        (Moment((mug,), (Participant("Anna", "person", POSE, "sitting"),)), Moment((mug,), (), 1.5)),
        (Sight("Anna", "mug_0", 0, 0.25, 0.01, "visible", (("box", 0.75),), 1.5, 0.02),),
        (
            Question(
                "sees", "Can she?", ("Could she?",), ("yes", "no"), "yes", "It is.", ("Anna", "mug_0"), 0.2, "share"
            ),
        ),
        twin="00000-0002",
        changed={"object": "box", "meters": 0.05},
        images={"camera/depth": np.ones((2, 2), dtype=np.float32)},
    )
    text = json.dumps(situation.to_dict(), sort_keys=True)
    again = Situation.from_dict(json.loads(text), situation.images)
    assert json.dumps(again.to_dict(), sort_keys=True) == text
    assert again.moments == situation.moments and again.sights == situation.sights
    assert again.questions == situation.questions and again.images is situation.images
