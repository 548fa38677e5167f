# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of k cameras that see weighted targets often enough: greedily with bounds, or by integer programming."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.core.file_content import require_package
from warpvis.errors import ArrayError
from warpvis.planning._seen_pairs import SeenPairs, full_words

MAX_EXACT = 2 * 10**8
"""Maximum number of candidates times targets times worlds for `choose_exactly`, which needs a byte for each."""


@dataclass
class Tally:
    """Number of cameras that see each target in each world, counted up to `at_least`, as bits of the worlds."""

    at_least: int
    planes: NDArray[np.uint64] = field(repr=False)
    """Worlds in which at least 1, 2, ... cameras see each target, shape ``(at_least, targets, words)``."""

    @classmethod
    def of(cls, targets: int, worlds: int, at_least: int) -> Tally:
        """Return a tally without cameras."""
        return cls(at_least, np.zeros((at_least, targets, len(full_words(worlds))), dtype=np.uint64))

    def add(self, targets: NDArray[np.int32], words: NDArray[np.uint64]) -> None:
        """Add a camera, given its targets and the worlds in which it sees them."""
        for plane in range(self.at_least - 1, 0, -1):
            self.planes[plane, targets] |= self.planes[plane - 1, targets] & words
        self.planes[0, targets] |= words

    def value(self, weights: NDArray[np.float64]) -> float:
        """Return the weighted sum of the counts, divided by `at_least`."""
        return float((np.bitwise_count(self.planes).sum(axis=(0, 2)) * weights).sum()) / self.at_least

    def gain(self, targets: NDArray[np.int32], words: NDArray[np.uint64], weights: NDArray[np.float64]) -> float:
        """Return by how much a camera would increase `value`."""
        new = np.bitwise_count(words & ~self.planes[-1, targets]).sum(axis=1)
        return float((new * weights[targets]).sum()) / self.at_least


class Choice(NamedTuple):
    """Chosen candidates, each with its gain, and an upper bound for every choice of as many."""

    order: list[int]
    gains: list[float]
    bound: float


def tally_of(pairs: SeenPairs, cameras: Sequence[int], targets: int, at_least: int) -> Tally:
    """Return the tally of some cameras."""
    tally = Tally.of(targets, pairs.worlds, at_least)
    for camera in cameras:
        tally.add(*pairs.of(camera))
    return tally


def choose_greedily(
    pairs: SeenPairs, tally: Tally, candidates: Sequence[int], weights: NDArray[np.float64], count: int
) -> Choice:
    """Choose cameras one after the other, each with the greatest gain; `tally` has the fixed ones, and is updated.

    Gains never increase, so an earlier gain is an upper bound of the current one, and only the first of the queue is
    computed again (Minoux 1978). For the same reason, no choice of `count` cameras has a greater value than the current
    one plus the `count` greatest gains, at any step; the least of these is the bound.
    """
    start = value = tally.value(weights)
    queue = [(-tally.gain(*pairs.of(camera), weights), camera, 0) for camera in candidates]
    heapq.heapify(queue)
    bound = value + _greatest(queue, count)
    order: list[int] = []
    gains: list[float] = []
    while len(order) < count:
        negative, camera, num_chosen = heapq.heappop(queue)
        if num_chosen < len(order):
            heapq.heappush(queue, (-tally.gain(*pairs.of(camera), weights), camera, len(order)))
            continue
        tally.add(*pairs.of(camera))
        order.append(camera)
        gains.append(-negative)
        value += gains[-1]
        bound = min(bound, value + _greatest(queue, count))
    current = [(-tally.gain(*pairs.of(camera), weights), camera, 0) for _, camera, _ in queue]
    bound = min(bound, value + _greatest(current, count))
    return Choice(order, gains, max(bound, start + sum(gains)))


def _greatest(queue: list[tuple[float, int, int]], count: int) -> float:
    return -sum(item[0] for item in heapq.nsmallest(count, queue))


def choose_exactly(
    pairs: SeenPairs,
    fixed: Tally,
    candidates: Sequence[int],
    weights: NDArray[np.float64],
    count: int,
    time_limit: float,
) -> Choice | None:
    """Choose the best cameras with HiGHS, in the order of `choose_greedily`; None without a choice in time.

    Variables are whether each candidate is chosen, and the counts of targets and worlds, up to the number that the
    fixed cameras leave open. Targets and worlds that the same candidates see share a variable. `fixed` is not changed.
    """
    optimize = require_package("scipy.optimize", 'method="exact" needs SciPy', "planning")
    from scipy.sparse import csr_array, hstack, identity

    seen, needed, shares = _merge_targets(pairs, fixed, candidates, weights)
    start = fixed.value(weights)
    chosen: list[int] = []
    bound = start
    if len(needed):
        columns = hstack([csr_array(-seen.astype(np.float64)), identity(len(needed), format="csr")])
        values = np.concatenate([np.zeros(len(candidates)), -shares / fixed.at_least])
        number = np.concatenate([np.ones(len(candidates)), np.zeros(len(needed))])
        found = optimize.milp(
            values,
            constraints=[
                optimize.LinearConstraint(columns, -np.inf, 0.0),
                optimize.LinearConstraint(number[None], count, count),
            ],
            integrality=number,
            bounds=optimize.Bounds(0.0, np.concatenate([np.ones(len(candidates)), needed])),
            options={"time_limit": time_limit, "mip_rel_gap": 0.0},
        )
        if found.x is None:
            return None
        chosen = [candidates[index] for index in np.flatnonzero(found.x[: len(candidates)] > 0.5).tolist()]
        bound -= float(found.mip_dual_bound)
    chosen += [camera for camera in candidates if camera not in chosen][: count - len(chosen)]
    tally = Tally(fixed.at_least, fixed.planes.copy())
    ordered = choose_greedily(pairs, tally, chosen, weights, count)
    return Choice(ordered.order, ordered.gains, max(bound, start + sum(ordered.gains)))


def _merge_targets(
    pairs: SeenPairs, fixed: Tally, candidates: Sequence[int], weights: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.float64]]:
    """Return groups of targets and worlds that the same candidates see and that need as many cameras.

    Returns:
        Which candidates see each of G groups, ``(G, candidates)``; the number of cameras that it needs, ``(G,)``; and
        the sum of its weights, ``(G,)``.
    """
    size = len(candidates) * len(weights) * pairs.worlds
    if size > MAX_EXACT:
        raise ArrayError(
            f'method="exact" takes at most {MAX_EXACT:g} candidates times targets times worlds, got {size:.3g}; use '
            'method="greedy"'
        )
    seen = np.zeros((len(candidates), len(weights), pairs.worlds), dtype=np.uint8)
    for row, camera in zip(seen, candidates, strict=True):
        targets, worlds = pairs.unpack(camera)
        row[targets] = worlds
    octets = fixed.planes.astype("<u8", copy=False).view(np.uint8)
    counted = np.unpackbits(octets, axis=2, count=pairs.worlds, bitorder="little").sum(axis=0, dtype=np.int64)
    needed = (fixed.at_least - counted).ravel()
    packed = np.packbits(seen.reshape(len(candidates), -1), axis=0).T
    parts = [packed[needed == number] for number in range(1, fixed.at_least + 1)]
    repeated = np.repeat(weights, pairs.worlds)
    groups, counts, sums = [], [], []
    for number, part in enumerate(parts, start=1):
        if not len(part):
            continue
        distinct, inverse = np.unique(part, axis=0, return_inverse=True)
        total = np.bincount(inverse.ravel(), repeated[needed == number], minlength=len(distinct))
        kept = distinct.any(axis=1) & (total > 0)
        groups.append(np.unpackbits(distinct[kept], axis=1, count=len(candidates)).astype(bool))
        counts.append(np.full(int(kept.sum()), float(number)))
        sums.append(total[kept])
    if not groups:
        return np.zeros((0, len(candidates)), dtype=bool), np.zeros(0), np.zeros(0)
    return np.concatenate(groups), np.concatenate(counts), np.concatenate(sums)
