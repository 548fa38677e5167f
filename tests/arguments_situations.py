# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of public functions of `situations`: ``name: (function, arguments)``."""

import numpy as np
from situation_jobs import FakeGenerator, FakeOptions

import warpvis as wv

OPTIONS = wv.situations.SituationOptions(rooms=("office",), per_shard=2, outputs=())


def situation_cases(folder):
    """Return the cases."""
    room = wv.situations.generate_room(0, "lab", clutter=0.2)
    generator = wv.situations.SituationGenerator(OPTIONS)
    rng = np.random.default_rng(0)
    return {
        "find_shortcuts": (
            wv.situations.find_shortcuts,
            {"situations": FakeGenerator(FakeOptions()).shard(0), "folds": 2, "threshold": 0.2},
        ),
        "SituationOptions": (
            wv.situations.SituationOptions,
            {
                "seed": 0,
                "rooms": ("office",),
                "per_shard": 2,
                "questions": ("sees",),
                "outputs": ("color",),
                "views": "camera",
                "stage": wv.situations.StageOptions(),
                "clutter": (0.2, 0.3),
                "scenes": ("procedural",),
            },
        ),
        "StageOptions": (
            wv.situations.StageOptions,
            {
                "people": 1,
                "robot": True,
                "picture": wv.Camera.kinect(),
                "person_view": wv.Camera.kinect(),
                "robot_view": wv.Camera.kinect(),
            },
        ),
        "SituationGenerator": (wv.situations.SituationGenerator, {"options": OPTIONS, "device": "cpu", "threads": 1}),
        "SituationGenerator.shard": (generator.shard, {"number": 0}),
        "SituationGenerator.scene": (generator.scene, {"situation": generator.shard(0)[0], "moment": 0}),
        "generate_room": (
            wv.situations.generate_room,
            {"seed": 0, "kind": "office", "size": (4.0, 5.0), "clutter": 0.5},
        ),
        "Room.build": (room.build, {"device": "cpu", "up": "z", "ceiling": True}),
        "Room.from_dict": (wv.situations.Room.from_dict, {"data": room.to_dict()}),
        "Room.item": (room.item, {"name": room.items[0].name}),
        "Room.standing_places": (room.standing_places, {"rng": rng, "count": 2, "radius": 0.3}),
        "Room.support_places": (
            room.support_places,
            {"rng": rng, "size": (0.1, 0.1, 0.1), "count": 2, "categories": ["lab bench"]},
        ),
    }
