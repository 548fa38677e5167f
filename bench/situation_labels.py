# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compare answers of generated situations with a reference in double precision, and print how many are wrong.

The reference builds the scene of each situation again, casts a grid of rays through the silhouette of the object
against every triangle and round solid (`tests/reference_fractions.py`), with another grid than the library's, and
decides by the same limits. An answer is wrong if the reference decides otherwise.

  python bench/situation_labels.py --count 2000 --seed 0        about 20 minutes on two cores
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from functools import partial
from multiprocessing import get_context
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import numpy as np
import warp as wp

from warpvis import Scene
from warpvis.scene import SceneObject
from warpvis.situations import Question, Situation, SituationGenerator, SituationOptions
from warpvis.situations._panel import LIMIT

import reference

_KINDS = ("sees", "who", "meant", "how_much")
_SAMPLES = 100
_HALF = 0.5


def share(options: SituationOptions, scene: Scene, situation: Situation, agent: str, thing: str) -> float:
    """Return the visible share of an object for a participant."""
    who = next(one for one in situation.moments[0].participants if one.name == agent)
    camera = options.stage.person_view if who.kind == "person" else options.stage.robot_view
    pose = np.array(who.eyes)
    others = [item for item in scene if item.name != agent and not item.name.startswith(f"{agent}/")]
    seen = _Seen(others, scene)
    member = [index for index, item in enumerate(others) if item.name == thing]
    canvas = (camera.width, camera.height, camera.width, camera.height)
    found = reference.measure_fractions(seen, camera, pose, member, canvas=canvas, least=_SAMPLES)
    return reference.judge_fractions(found, camera, 0)["fraction"]


class _Seen:
    """What the reference reads of a scene, without some of its objects."""

    def __init__(self, objects: list[SceneObject], scene: Scene) -> None:
        self.objects, self.movable = tuple(objects), [i for i, item in enumerate(objects) if item.pose is not None]
        self.device = scene.device

    def attached(self) -> dict[int, int]:
        return {}

    def __iter__(self):
        return iter(self.objects)

    def __len__(self) -> int:
        return len(self.objects)


def is_right(question: Question, shares: list[float]) -> bool:
    """Return whether the answer is that of the shares of the question's participants and objects."""
    seen = [value >= LIMIT for value in shares]
    if question.kind == "sees":
        return (question.answer == "yes") == seen[0]
    if question.kind == "how_much":
        level = 0 if shares[0] < LIMIT / 2 else 1 if shares[0] < _HALF else 2
        return question.choices.index(question.answer) == level
    if question.kind == "meant":
        return sum(seen) == 1 and question.choices.index(question.answer) == seen.index(True)
    return question.choices.index(question.answer) == {(1, 0): 0, (0, 1): 1, (1, 1): 2, (0, 0): 3}[seen[0], seen[1]]


def check_shard(options: SituationOptions, count: int, shard: int) -> list[tuple[str, bool, str]]:
    """Return kind and correctness of at most `count` answers of a shard, and what differs."""
    generator, results = SituationGenerator(options), []
    for situation in generator.shard(shard):
        asked = [question for question in situation.questions if question.kind in _KINDS]
        if not asked or len(situation.moments) > 1:
            continue
        scene = generator.scene(situation)
        for question in asked:
            if question.kind == "who":
                pairs = [(agent, question.about[2]) for agent in question.about[:2]]
            else:
                pairs = [(question.about[0], thing) for thing in question.about[1:]]
            shares = [share(options, scene, situation, *pair) for pair in pairs]
            told = f"{situation.name} {question.text} {question.answer}; shares {np.round(shares, 3).tolist()}"
            results.append((question.kind, is_right(question, shares), told))
            if len(results) >= count:
                return results
    return results


def main() -> int:
    """Check, print, and return 1 if an answer is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=2000, help="answers to check")
    parser.add_argument("--per-shard", type=int, default=100, help="answers to check of a shard")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    chosen = SituationOptions(seed=options.seed, outputs=(), per_shard=min(100, options.per_shard))
    shards = range(options.count)  # a shard may have few answers
    start, results = time.perf_counter(), []
    with get_context("spawn").Pool(options.processes) as pool:
        for found in pool.imap_unordered(partial(check_shard, chosen, options.per_shard), shards):
            results += found
            wrong = [told for _, right, told in found if not right]
            print(f"[{time.perf_counter() - start:.0f} s] {len(results)} answers", *wrong, sep="\n  ", flush=True)
            if len(results) >= options.count:
                break
    kinds, wrong = Counter(kind for kind, *_ in results), [told for _, right, told in results if not right]
    print(f"{len(results)} answers {dict(kinds)}: {len(wrong)} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
