# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of questions whose answers do not follow from their words, or from what a picture shows at first sight."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.situations._numbers import Numbers
from warpvis.situations._situation import Question


@dataclass(frozen=True, eq=False)
class Pool:
    """Questions of one kind that can be asked about arrangements of a room: n rows."""

    kind: str
    """Their kind."""
    world: NDArray[np.int64]
    """Arrangement of each, shape ``(n,)``."""
    words: NDArray[np.int64]
    """Number of its words: equal for questions with the same text, shape ``(n,)``."""
    answer: NDArray[np.int64]
    """Number of its answer, equal for the same answer to the same words, shape ``(n,)``."""
    stratum: NDArray[np.int64]
    """A number that must be as frequent for one answer as for another, shape ``(n,)``."""
    features: NDArray[np.float64]
    """Numbers that must not tell the answer, such as distances and places in the picture, shape ``(n, F)``."""
    write: Callable[[int], Question]
    """Writes the question of a row."""

    def choose(self, count: int, random: Numbers) -> list[int]:
        """Choose about `count` rows: for the same words, each answer as often as the others, in similar pictures.

        For each row, the rows with the same words and the other answers that resemble it most are chosen, too.
        """
        groups: dict[int, dict[tuple[int, int], list[int]]] = defaultdict(lambda: defaultdict(list))
        for row, (words, answer, stratum) in enumerate(
            zip(self.words.tolist(), self.answer.tolist(), self.stratum.tolist(), strict=True)
        ):
            groups[words][answer, stratum].append(row)
        strata = set(self.stratum.tolist())
        usable = [group for group in groups.values() if _is_balanced(group, strata)]
        if not usable:
            return []
        scale = self.features.std(axis=0)
        features = self.features / np.where(scale > 0, scale, 1)
        chosen: list[int] = []
        order = [usable[index] for index in random.order(len(usable)).tolist()]
        while order and len(chosen) < count:
            order = [group for group in order if all(group.values())]
            for group in order:
                if len(chosen) >= count:
                    break
                chosen += _take_alike(group, features, random)
        return chosen


def _is_balanced(group: dict[tuple[int, int], list[int]], strata: set[int]) -> bool:
    """Return whether the same words have several answers, each of them in all strata."""
    answers = {answer for answer, _ in group}
    return len(answers) > 1 and len(group) == len(answers) * len(strata)


def _take_alike(group: dict[tuple[int, int], list[int]], features: NDArray[np.float64], random: Numbers) -> list[int]:
    """Remove and return a row of each list: a random one of the shortest list, and those that resemble it most."""
    lists = sorted(group.values(), key=len)
    anchor = lists[0].pop(int(random.below(len(lists[0]), 1)[0]))
    taken = [anchor]
    for rows in lists[1:]:
        apart = np.abs(features[rows] - features[anchor]).sum(axis=1)
        taken.append(rows.pop(int(apart.argmin())))
    return taken
