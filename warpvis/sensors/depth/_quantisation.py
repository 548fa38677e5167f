# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Which steps of 1 / z pictures of walls are made of, and how far noise spreads them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.sensors.depth._walls import Wall

# A picture has steps if its values are so few, as a share of its pixels, and so near whole steps.
_MAX_VALUES, _MAX_APART, _MIN_VALUES = 0.05, 0.12, 4
# Rounding alone spreads values about the plane by 0.29 of a step.
_MIN_SPREAD = 0.15
# Steps of 1 / z have to be so many times what depth's own rounding makes of it.
_MIN_ROUNDINGS = 3.0
# Depth in single precision, as a part of it.
_SINGLE = 2.0**-23
# So many pixels of a wall say how far noise spreads, in so many rounds; less of a step cannot be told from none.
_SAMPLES, _ROUNDS, _MIN_SIGMA = 6000, 25, 1e-3


def find_quantum(walls: list[Wall], resolution: float) -> float:
    """Return the step of 1 / z [1/m] that pictures agree on, by the median; 0 if most have none."""
    found = [_quantum_of(wall, resolution) for wall in walls]
    steps = [quantum for quantum in found if quantum > 0]
    # Near walls may have steps that are finer than what depth is rounded to.
    if not steps or (resolution == 0.0 and len(steps) <= len(found) / 2):
        return 0.0
    middle = float(np.median(steps))
    return float(np.median([_refined(wall, middle) for wall, quantum in zip(walls, found, strict=True) if quantum > 0]))


def _quantum_of(wall: Wall, resolution: float) -> float:
    values, rounding = _values(wall, resolution)
    if not _MIN_VALUES <= len(values) <= _MAX_VALUES * wall.known.sum():
        return 0.0
    gaps = np.diff(values)
    least = float(np.percentile(gaps, 10))
    quantum = float(np.median(gaps[gaps < 1.5 * least])) if (gaps < 1.5 * least).any() else least
    if quantum < _MIN_ROUNDINGS * rounding:
        return 0.0
    # From one value to the next there are a few whole steps, so that no count is in doubt.
    for _ in range(4):
        steps = np.concatenate([[0.0], np.cumsum(np.round(gaps / quantum))])
        quantum, first = np.polyfit(steps, values, 1)
    apart = np.sqrt(np.mean((values - first - quantum * steps) ** 2)) / quantum
    # A wall that leans sideways has a value a column, evenly apart: but none of them is far from the plane.
    spread = np.sqrt(np.mean(wall.residuals[wall.known] ** 2)) / quantum
    return float(quantum) if apart <= _MAX_APART and spread >= _MIN_SPREAD else 0.0


def _values(wall: Wall, resolution: float) -> tuple[NDArray[np.float64], float]:
    """Return the values of 1 / z that a picture has, those within rounding of each other as one, and that rounding."""
    inverse = np.sort(wall.inverse[wall.known])
    rounding = float(inverse[-1]) * _SINGLE + resolution * float(inverse[-1]) ** 2
    ends = np.flatnonzero(np.diff(inverse) > 2 * rounding)
    firsts = np.concatenate([[0], ends + 1])
    return np.add.reduceat(inverse, firsts) / np.diff(np.concatenate([firsts, [len(inverse)]])), rounding


def _refined(wall: Wall, quantum: float) -> float:
    """Count steps from 1 / z = 0, which tells more of them than from one value to another, if all values fit."""
    values = wall.inverse[wall.known]
    steps = np.round(values / quantum)
    refined = float((values * steps).sum() / (steps**2).sum())
    apart = np.sqrt(np.mean((values - refined * steps) ** 2)) / refined
    return refined if apart <= _MAX_APART else quantum


def fit_spread(walls: list[Wall], quantum: float) -> tuple[list[Wall], float]:
    """Return walls with planes that are fitted again, and the deviation of 1 / z about them before it was rounded.

    Without steps, planes stay. With them, planes and the deviation are the ones of the greatest likelihood: a value is
    seen where the plane plus noise is within half a step of it. That holds also where noise is less than a step, of
    which the mean square says little, and where a wall that is faced has few steps. Maximised by scoring with the
    outer product of gradients (Berndt, Hall, Hall and Hausman 1974), of the planes and the deviation by turns.
    """
    if quantum == 0.0:
        return walls, float(np.sqrt(np.mean(np.concatenate([wall.residuals[wall.known] for wall in walls]) ** 2)))
    samples = [_Sample.of(wall, quantum, seed) for seed, wall in enumerate(walls)]
    apart = np.concatenate([sample.value - sample.rows @ sample.plane for sample in samples])
    sigma = max(float(np.sqrt(max(np.mean(apart**2) - 1 / 12, 0.0))), _MIN_SIGMA)
    for _ in range(_ROUNDS):
        slopes = [sample.improve(sigma) for sample in samples]
        slope = np.concatenate(slopes)
        step = float(slope.sum() / max((slope**2).sum(), 1e-30))
        sigma = max(sigma * math.exp(min(max(step, -0.5), 0.5)), _MIN_SIGMA)
    fitted = [wall.with_plane(sample.plane * quantum) for wall, sample in zip(walls, samples, strict=True)]
    return fitted, sigma * quantum


@dataclass
class _Sample:
    """Some pixels of a wall, in steps."""

    value: NDArray[np.float64]
    rows: NDArray[np.float64]
    plane: NDArray[np.float64]

    @classmethod
    def of(cls, wall: Wall, quantum: float, seed: int) -> _Sample:
        """Take pixels at random."""
        known = np.flatnonzero(wall.known)
        some = np.random.default_rng(seed).choice(known, min(_SAMPLES, len(known)), replace=False)
        return cls(wall.inverse.ravel()[some] / quantum, wall.rows(some), np.array(wall.coefficients) / quantum)

    def improve(self, sigma: float) -> NDArray[np.float64]:
        """Go a step towards the plane of the greatest likelihood; return its slopes by the deviation's logarithm."""
        middle = self.value - self.rows @ self.plane
        below, above = (middle - 0.5) / sigma, (middle + 0.5) / sigma
        chance = np.maximum(_normal_share(above) - _normal_share(below), 1e-12)
        at_below, at_above = _normal_density(below), _normal_density(above)
        slopes = ((at_below - at_above) / (chance * sigma))[:, None] * self.rows
        self.plane = self.plane + np.linalg.lstsq(slopes.T @ slopes, slopes.sum(axis=0), rcond=None)[0]
        return (below * at_below - above * at_above) / chance


_erf = np.frompyfunc(math.erf, 1, 1)


def _normal_share(at: NDArray[np.float64]) -> NDArray[np.float64]:
    return (1.0 + np.asarray(_erf(at / math.sqrt(2.0)), dtype=np.float64)) / 2


def _normal_density(at: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.exp(-(at**2) / 2) / math.sqrt(2 * math.pi)
