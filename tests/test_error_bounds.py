# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Error bounds of ``kernels/native/shared/error_bounds.h``, compared with errors of random triangles.

Triangle setup of both devices is repeated in NumPy, in single precision and without fused operations, which would only
lower the errors. The exact values are of double precision, from the corners as stored.
"""

import re
from pathlib import Path

import numpy as np
import pytest

HEADER = Path(__file__).parents[1] / "kernels/native/shared/error_bounds.h"
CONSTANTS = dict(re.findall(r"(\w+) = ([\d.e-]+)f?[,;]", HEADER.read_text(encoding="utf-8")))
EDGE_ERROR_BOUND, EDGE_MARGIN, ROUNDING = (float(CONSTANTS[n]) for n in ("EDGE_ERROR_BOUND", "EDGE_MARGIN", "ROUNDING"))
WIDTH, HEIGHT = 640, 480
COUNT = 40_000
SINGLE = np.float32
COARSE = 4.0  # of ``native/cuda/setup.h``


class Triangles:
    """Triangles in front of a camera, their corners in its coordinates, exact and in single precision, and a pixel."""

    def __init__(self, seed: int, focal: float, device: str) -> None:
        rng = np.random.default_rng(seed)
        rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        origin = rng.uniform(-1, 1, 3) * 10 ** rng.uniform(-1, 2)
        depth = 10 ** rng.uniform(-1, 2, (COUNT, 1, 1))
        size = depth * 10 ** rng.uniform(-4, 0, (COUNT, 1, 1))
        pixel = rng.uniform(-0.5, 0.5, (COUNT, 1, 2)) * [WIDTH, HEIGHT]
        place = np.concatenate([pixel / focal, np.ones((COUNT, 1, 1))], axis=-1) * depth
        shape = rng.normal(size=(COUNT, 3, 3))
        sliver = rng.random(COUNT) < 0.3
        along = rng.random((COUNT, 1))
        flat = shape[:, 0] * along + shape[:, 1] * (1 - along) + 1e-3 * shape[:, 2]
        shape[sliver, 2] = flat[sliver]
        stored = ((place + size * shape) @ rotation + origin).astype(SINGLE)

        rows = rotation * [[focal], [focal], [1.0]]
        exact = (stored - origin) @ rows.T
        in_front = exact[..., 2].min(axis=-1) > 1e-3
        stored, exact = stored[in_front], exact[in_front]
        rounded_origin, rounded_rows = origin.astype(SINGLE), rows.astype(SINGLE)
        relative = stored - rounded_origin
        separate = _rotate(rounded_rows, relative) - ((origin - rounded_origin) @ rows.T).astype(SINGLE)
        self.extent = SINGLE(max(focal, WIDTH / 2))
        self.factor = 1 + WIDTH / 2 / focal if device == "cpu" else 1.0
        self.exact, self.corners = exact, separate
        self.sides = [self.corners[:, k] - self.corners[:, 0] for k in (1, 2)]
        self.lengths = [np.abs(relative[:, 0]).sum(-1)] + [np.abs(stored[:, k] - stored[:, 0]).sum(-1) for k in (1, 2)]
        if device == "cuda":
            self.extent = SINGLE((2 * focal + WIDTH + HEIGHT - 2) / 2)
            # CUDA packets have the rounding of the origin in exact rays: world coordinates relative to the rounded one.
            self.exact = exact = (stored.astype(np.float64) - rounded_origin) @ rows.T
            self.corners = first = _rotate(rounded_rows, relative)
            self.sides = [_rotate(rounded_rows, stored[:, k] - stored[:, 0]) for k in (1, 2)]
            joined = np.stack([first[:, 0], *(first[:, 0] + side for side in self.sides)], axis=1)
            z = joined[..., 2]
            coarse = (z.max(-1) > 0) & (self._extents(z) > COARSE * self.extent * z.min(-1))
            self.corners = np.where(coarse[:, None, None], first, joined)
        z = self.corners[..., 2]
        self.spread = self._extents(z)
        self.distance = 2 * self.extent * z.max(-1) + self.spread

        # A point of the triangle in the image, for which the error of the functions counts.
        weights = rng.dirichlet((0.3, 0.3, 0.3), len(exact))
        point = (exact * weights[..., None]).sum(1)
        self.ray = np.concatenate([point[:, :2] / point[:, 2:], np.ones((len(exact), 1))], axis=-1).astype(SINGLE)
        self.seen = (np.abs(self.ray[:, 0]) < WIDTH / 2) & (np.abs(self.ray[:, 1]) < HEIGHT / 2)

    def _extents(self, z: np.ndarray) -> np.ndarray:
        ab, ac = (np.abs(side) for side in self.sides)
        return ((ab[:, 0] + ac[:, 0]) + (ab[:, 1] + ac[:, 1])) + self.extent * (z.max(-1) - z.min(-1))


def _rotate(rows: np.ndarray, points: np.ndarray) -> np.ndarray:
    x, y, z = (points[..., k, None] * rows[:, k] for k in range(3))
    return x + (y + z)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    x, y, z = range(3)
    products = [a[:, i] * b[:, j] - a[:, j] * b[:, i] for i, j in ((y, z), (z, x), (x, y))]
    return np.stack(products, axis=-1)


def _along(linear: np.ndarray, ray: np.ndarray) -> np.ndarray:
    return ray[:, 0] * linear[:, 0] + (ray[:, 1] * linear[:, 1] + linear[:, 2])


@pytest.fixture(params=["cpu", "cuda"])
def device(request):
    return request.param


@pytest.mark.parametrize("focal", [150.0, 550.0, 5000.0])
def test_errors_of_edge_functions_are_within_their_bound(device, focal):
    worst = 0.0
    for seed in range(3):
        t = Triangles(seed, focal, device)
        bound = t.factor * EDGE_ERROR_BOUND * t.distance * (t.spread + EDGE_MARGIN / t.extent * t.distance)
        for one, other in ((1, 2), (2, 0), (0, 1)):
            a, b = t.corners[:, one], t.corners[:, other]
            error = _along(_cross(a - b, a + b), t.ray) - 2 * _along(
                _cross(t.exact[:, one], t.exact[:, other]), t.ray.astype(np.float64)
            )
            worst = max(worst, (np.abs(error) / bound)[t.seen].max())
    assert 0.05 < worst < 1.0


def test_errors_of_volumes_are_within_their_bound(device):
    worst = 0.0
    for seed in range(3):
        t = Triangles(seed, 550.0, device)
        volume = (_cross(*t.sides) * t.corners[:, 0]).sum(-1)
        exact = (_cross(t.exact[:, 1] - t.exact[:, 0], t.exact[:, 2] - t.exact[:, 0]) * t.exact[:, 0]).sum(-1)
        if device == "cuda":
            bound = 28 * ROUNDING * 550.0**2 * np.prod(t.lengths, axis=0)
        else:
            bound = t.factor * EDGE_ERROR_BOUND * t.distance * t.spread * (t.distance / t.extent)
        seen = t.seen & (bound > 0)
        worst = max(worst, (np.abs(volume - exact)[seen] / bound[seen]).max())
    assert 0.001 < worst < 1.0
