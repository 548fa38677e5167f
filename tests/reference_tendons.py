# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision twins of `warpvis.kernels.mujoco.tendons`, with bisection instead of Newton's method."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PULLEY = -2


def hanging_points(
    start: NDArray[np.float64], end: NDArray[np.float64], up: NDArray[np.float64], length: float, count: int
) -> NDArray[np.float64]:
    """Return the points of a slack tendon: a catenary, or two lines if the ends are nearly above each other."""
    between = end - start
    height = between @ up
    level = between - height * up
    across = np.linalg.norm(level)
    if length > 100 * across:
        down = (height - np.sqrt(length**2 - across**2)) / 2
        share = 0.0 if across == 0 else down / (2 * down - height)
        return np.array([start, start + down * up + share * level, end])
    # Two points at the ends of a cosh(x / a) of this length and height: 2 a sinh(across / 2 a) is known.
    target = np.sqrt(length**2 - height**2)
    low, high = 1e-6 * across, 1e6 * across
    for _ in range(200):
        scale = np.sqrt(low * high)
        with np.errstate(over="ignore"):
            is_flat = 2 * scale * np.sinh(across / (2 * scale)) < target
        low, high = (low, scale) if is_flat else (scale, high)
    lowest = across / 2 - scale * np.arctanh(height / length)
    x = np.append(np.arange(count - 1) / count, 1.0) * across
    z = scale * (np.cosh((x - lowest) / scale) - np.cosh(lowest / scale))
    return start + x[:, None] * level / across + z[:, None] * up


def tendon_capsules(
    wrap_xpos: NDArray,
    wrap_obj: NDArray,
    ten_wrapadr: NDArray,
    ten_wrapnum: NDArray,
    worlds: NDArray,
    segments: NDArray,
    sizes: NDArray,
    up: NDArray,
    curve_points: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return the ends of the capsules, (worlds, S, 2, 3), their radii, and which are shown, (worlds, S)."""
    ends = np.zeros((len(worlds), len(segments), 2, 3))
    radii, shown = np.zeros(ends.shape[:2]), np.zeros(ends.shape[:2], dtype=bool)
    for row, world in enumerate(worlds):
        points, objects = wrap_xpos[world].reshape(-1, 3).astype(np.float64), wrap_obj[world].ravel()
        for column, (tendon, segment) in enumerate(segments):
            path = slice(ten_wrapadr[world, tendon], ten_wrapadr[world, tendon] + ten_wrapnum[world, tendon])
            curve, kinds, (radius, slack) = points[path], objects[path], sizes[tendon].astype(np.float64)
            if slack > 0 and np.linalg.norm(curve[1] - curve[0]) < slack:
                curve = hanging_points(*curve[:2], np.asarray(up, dtype=np.float64), slack, curve_points)
                kinds = np.full(len(curve), -1)
            pair = kinds[segment : segment + 2]
            if segment + 1 >= len(curve) or PULLEY in pair or (pair >= 0).all():
                continue
            ends[row, column], radii[row, column], shown[row, column] = curve[segment : segment + 2], radius, True
    return ends, radii, shown


def tendon_arcs(
    wrap_xpos: NDArray,
    wrap_obj: NDArray,
    ten_wrapadr: NDArray,
    ten_wrapnum: NDArray,
    geom_xpos: NDArray,
    geom_xmat: NDArray,
    is_cylinder: NDArray,
    worlds: NDArray,
    arcs: NDArray,
    sizes: NDArray,
    slices: float,
    max_pieces: int,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the ends of the capsules of arcs, (worlds, A, 2, 3), and which are shown, in planes of complex numbers."""
    ends, shown = np.zeros((len(worlds), len(arcs), 2, 3)), np.zeros((len(worlds), len(arcs)), dtype=bool)
    for row, world in enumerate(worlds):
        points, objects = wrap_xpos[world].reshape(-1, 3).astype(np.float64), wrap_obj[world].ravel()
        for column, (tendon, number, piece) in enumerate(arcs):
            first = ten_wrapadr[world, tendon]
            path = range(first, first + ten_wrapnum[world, tendon] - 1)
            pairs = [index for index in path if objects[index] >= 0 and objects[index + 1] >= 0]
            if number >= len(pairs):
                continue
            index = pairs[number]
            geom = objects[index]
            before, low, high = points[index - 1 : index + 2] - geom_xpos[world, geom]
            z = geom_xmat[world, geom][:, 2] if is_cylinder[geom] else np.cross(low, high)
            z = z / np.linalg.norm(z)
            x = (low - z * (low @ z)) / np.linalg.norm(low - z * (low @ z))
            y = np.cross(z, x)
            if (low - before) @ y < 0:
                y = -y
            radius, angle = low @ x, np.angle(high @ x + 1j * (high @ y)) % (2 * np.pi)
            pieces = int(np.clip(np.round(angle * slices / np.pi), 1, max_pieces))
            if piece >= pieces:
                continue
            for end in range(2):
                share = (piece + end) / pieces
                spot = radius * np.exp(1j * angle * share)
                height = z * (low @ z + share * ((high - low) @ z))
                ends[row, column, end] = geom_xpos[world, geom] + spot.real * x + spot.imag * y + height
            shown[row, column] = True
    return ends, shown
