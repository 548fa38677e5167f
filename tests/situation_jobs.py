# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A generator of small situations without geometry, for tests of datasets and of the shortcut test."""

from dataclasses import dataclass

import numpy as np

from warpvis.situations import Moment, Participant, Question, Sight, Situation, Thing

COLORS = ("red", "blue", "green", "white")


@dataclass(frozen=True)
class FakeOptions:
    """Options of `FakeGenerator`."""

    seed: int = 0
    shortcut: str = ""
    """``"distance"``: only near mugs are seen; ``"text"``: Anna sees everything, others nothing."""
    moments: int = 1
    single: int = 0
    """Number of situations of a room, from the first on, with one moment only."""
    per_shard: int = 10
    empty: tuple[int, ...] = ()
    """Numbers of rooms without situations."""
    far: float = 4.0
    limit: float = np.inf


class FakeGenerator:
    """Generates a camera, a person and two mugs, and whether the person sees the first mug by a coin."""

    def __init__(self, options, *, device=None, threads=None):
        self.options = options

    def shard(self, number):
        count = 0 if number in self.options.empty else self.options.per_shard
        return [self._situation(number, index) for index in range(count)]

    def _situation(self, number, index):
        options = self.options
        random = np.random.default_rng((options.seed, number, index))
        name = str(random.choice(["Anna", "Ben"]))
        places = random.uniform((-1, -0.5, 1), (1, 0.5, 3), (3, 3))
        seen = bool(random.random() < 0.5)
        if options.shortcut == "distance":
            seen = bool(np.linalg.norm(places[0]) < 2.1)
        elif options.shortcut == "text":
            seen = name == "Anna"
        things = tuple(
            Thing(f"mug_{k}", "mug", COLORS[k + 2 * int(random.integers(2))], (*place, 0, 0, 0, 1.0), (0.1, 0.1, 0.1))
            for k, place in enumerate(places[:2].tolist())
        )
        person = Participant(name, "person", (*places[2].tolist(), 0, 0, 0, 1.0))
        state = "visible" if seen else "occluded"
        answer = "yes" if seen else "no"
        which = int(random.integers(2))
        margin = np.inf if index == 3 else 0.1
        questions = (
            Question(
                "sees", f"Can {name} see the {things[0].words}?", (f"Is the {things[0].words} visible to {name}?",),
                ("yes", "no"), answer, f"It is {state}.", (name, "mug_0"), 0.2, "share",
            ),
            Question(
                "which", f"Which mug does {name} mean?", (), tuple(f"the {thing.words}" for thing in things),
                f"the {things[which].words}", "Only this one is visible.", (name, "mug_0", "mug_1"), margin, "meters",
            ),
        )  # fmt: skip
        images = {}
        moments = 1 if index < options.single else options.moments
        for time in range(moments):
            end = f"/{time}" if moments > 1 else ""
            images[f"camera/color{end}"] = random.integers(0, 255, (6, 8, 3), dtype=np.uint8)
            depth = random.uniform(0.5, options.far, (6, 8)).astype(np.float32)
            depth[0, 0] = np.inf
            images[f"camera/depth{end}"] = depth
            images[f"camera/segmentation{end}"] = random.integers(-1, 5, (6, 8)).astype(np.int32)
            images[f"camera/masks{end}"] = random.random((2, 6, 8)) < 0.5
            images[f"{name}/color{end}"] = random.integers(0, 255, (6, 8, 3), dtype=np.uint8)
        twin = index ^ 1
        return Situation(
            f"{number:05d}-{index:04d}",
            {"seed": number, "kind": "office" if number % 2 else "kitchen"},
            {"pose": [0, 0, 0, 0, 0, 0, 1], "width": 8, "height": 6},
            tuple(Moment(things, (person,), 0.5 * time) for time in range(moments)),
            (Sight(name, "mug_0", 0, 0.8 if seen else 0.1, 0.01, state, () if seen else (("box", 0.9),), 1.5, None),),
            questions,
            twin=f"{number:05d}-{twin:04d}" if twin < options.per_shard else None,
            changed={"object": "box", "meters": 0.05} if index % 2 else {},
            images=images,
        )
