# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A skinned mesh of a body: made once at rest, and deformed to postures by linear blend skinning."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.scene.solids import sphere
from warpvis.situations.people._body import Body
from warpvis.situations.people._skeleton import PARENTS, SEGMENTS, Frames
from warpvis.situations.people._solids import make_pieces
from warpvis.situations.people._surface import Surface, make_surface

_BLEND = 0.012
"""Distance over which a vertex changes from one segment to the next, relative to the stature."""

_COLOR_BLEND = 0.004
"""Distance over which colors change, relative to the stature."""

PARTS = ("skin", "hair", "shirt", "trousers", "shoes", "white", "pupil")
"""Names of the colors of a skin."""

_EYE_RADIUS = 0.0068
"""Radius of an eyeball, relative to the stature: 12 mm at 1.7 m."""

# Steps of the grid along each axis, (end, step), relative to the stature, from the middle or the bottom: small at
# hands, feet and head.
_X_STEPS = ((-0.150, 0.0), (-0.085, 0.022), (0.075, 0.0134), (0.150, 0.020))
_Y_STEPS = ((0.0, 0.0), (0.054, 0.0120), (0.17, 0.0166), (0.42, 0.036), (0.62, 0.0135))
_Z_STEPS = ((-0.025, 0.0), (0.055, 0.0115), (0.48, 0.036), (0.775, 0.0250), (0.865, 0.0130), (1.03, 0.0110))

_COARSE = 3
"""Nodes of the grid between those where the distance to the surface is computed first."""


@dataclass(frozen=True, eq=False)
class Skin:
    """A closed mesh at rest, and how it follows the segments."""

    vertices: NDArray[np.float64]
    """Corners at rest [m], shape ``(n, 3)``."""
    faces: NDArray[np.int32]
    """Corner indices, shape ``(m, 3)``."""
    normals: NDArray[np.float64]
    """Unit normals of the corners at rest, shape ``(n, 3)``."""
    weights: NDArray[np.float64]
    """Share of each segment of `SEGMENTS`, shape ``(n, segments)``; rows add up to 1."""
    colors: NDArray[np.float64]
    """Share of each color of `PARTS` in that of a corner, shape ``(n, parts)``."""
    frames: Frames
    """Frames of the segments at rest."""

    def posed(self, frames: Frames) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return corners [m] and normals in W postures, in the body's frame, shapes ``(W, n, 3)``."""
        worlds = len(frames.origins["pelvis"])
        linear, shift = np.zeros((worlds, len(SEGMENTS), 3, 3)), np.zeros((worlds, len(SEGMENTS), 3))
        for index, name in enumerate(SEGMENTS):
            linear[:, index] = frames.rotations[name] @ self.frames.rotations[name][0].T
            shift[:, index] = frames.origins[name] - linear[:, index] @ self.frames.origins[name][0]
        count = len(self.vertices)
        vertices, normals = np.empty((worlds, count, 3)), np.empty((worlds, count, 3))
        for world in range(worlds):
            blended = (self.weights @ linear[world].reshape(-1, 9)).reshape(-1, 3, 3)
            vertices[world] = np.einsum("nij,nj->ni", blended, self.vertices) + self.weights @ shift[world]
            normals[world] = np.einsum("nij,nj->ni", blended, self.normals)
        return vertices, normals


@lru_cache(maxsize=64)
def make_skin(body: Body) -> Skin:
    """Return the mesh of a body."""
    surface = make_surface(body)
    grids = [_grid(steps, body.height) for steps in (_X_STEPS, _Y_STEPS, _Z_STEPS)]
    grids[1] = np.concatenate([-grids[1][:0:-1], grids[1]])
    # No node is on a plane of symmetry, so that left and right are alike but no value is 0.
    grids = [grid + 1e-7 for grid in grids]
    values = _without_ambiguous_faces(_distances(surface, grids))
    vertices, faces = surface_nets(values, grids)
    vertices = _project(surface, vertices, 0.006 * body.height)
    normals = surface.gradient(vertices)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    weights = _weights(surface, vertices, _BLEND * body.height)
    colors = _color_shares(body, surface, vertices)
    skin: tuple[list[NDArray[Any]], ...] = ([vertices], [faces], [normals], [weights], [colors])
    for side in (1, -1):
        _add_eye(body, surface, side, skin)
    merged: list[NDArray[Any]] = [np.concatenate(items) for items in skin]
    return Skin(merged[0], merged[1].astype(np.int32), merged[2], merged[3], merged[4], surface.frames)


def _grid(steps: tuple[tuple[float, float], ...], height: float) -> NDArray[np.float64]:
    """Return coordinates that divide each interval evenly, with at most its step."""
    nodes = [np.array([steps[0][0]])]
    for (start, _), (end, step) in itertools.pairwise(steps):
        count = int(np.ceil((end - start) / step - 1e-9))
        nodes.append(np.linspace(start, end, count + 1)[1:])
    return np.concatenate(nodes) * height


def _distances(surface: Surface, grids: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the distance to the surface at the nodes of a grid; only the sign is exact far from the surface."""
    coarse = [grid[::_COARSE] for grid in grids]
    nodes = np.stack(np.meshgrid(*coarse, indexing="ij"), axis=-1)
    rough = surface.distance(nodes.reshape(-1, 3)).reshape(nodes.shape[:3])
    nearest = [np.abs(grid[:, None] - few).argmin(axis=1) for grid, few in zip(grids, coarse, strict=True)]
    away = [np.abs(grid - few[index]) for grid, few, index in zip(grids, coarse, nearest, strict=True)]
    values = rough[np.ix_(*nearest)]
    reach = np.sqrt(sum(step**2 for step in np.meshgrid(*away, indexing="ij", sparse=True)))
    # Distances to ellipsoids are approximate: twice the way to the coarse node, and a margin.
    near = np.abs(values) < 2 * reach + 0.02 * (grids[2][-1] - grids[2][0])
    points = np.stack([grid[index] for grid, index in zip(grids, np.nonzero(near), strict=True)], axis=1)
    values[near] = surface.distance(points)
    return values


def _without_ambiguous_faces(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values whose zeros are a manifold: no face of a cell has two inner nodes at opposite corners only."""
    values = values.copy()
    for _ in range(10):
        inside, changed = values < 0, False
        for axis in range(3):
            first, second = (k for k in range(3) if k != axis)
            corners = []
            for one, two in ((0, 0), (0, 1), (1, 1), (1, 0)):
                part = [slice(None)] * 3
                part[first] = slice(one, values.shape[first] - 1 + one)
                part[second] = slice(two, values.shape[second] - 1 + two)
                corners.append(tuple(part))
            a, b, c, d = (inside[corner] for corner in corners)
            for ambiguous, filled in ((a & c & ~b & ~d, (1, 3)), (b & d & ~a & ~c, (0, 2))):
                for k in filled:
                    values[corners[k]] = np.where(ambiguous, -1e-6, values[corners[k]])
                changed |= bool(ambiguous.any())
        if not changed:
            return values
    return values


def surface_nets(
    values: NDArray[np.float64], grids: list[NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the surface where values on a grid are 0, with one vertex in every cell that it crosses (Gibson 1998).

    Args:
        values: Values at the nodes, negative inside, shape ``(X, Y, Z)``.
        grids: Coordinates of the nodes along x, y and z.

    Returns:
        Vertices, shape ``(n, 3)``, and corner indices of triangles, wound outwards, shape ``(m, 3)``.
    """
    inside = values < 0
    shape = np.array(values.shape) - 1
    total, count = np.zeros((*shape, 3)), np.zeros(shape)
    quads = []
    for axis in range(3):
        low = [slice(None)] * 3
        high = [slice(None)] * 3
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        first, second = values[tuple(low)], values[tuple(high)]
        crossed = inside[tuple(low)] != inside[tuple(high)]
        edges = np.argwhere(crossed)
        a, b = first[crossed], second[crossed]
        places = np.stack([grids[k][edges[:, k]] for k in range(3)], axis=1)
        step = np.diff(grids[axis])[edges[:, axis]]
        places[:, axis] += step * a / (a - b)
        others = [k for k in range(3) if k != axis]
        cells = []
        for one, two in ((0, 0), (1, 0), (1, 1), (0, 1)):
            cell = edges.copy()
            cell[:, others[0]] -= one
            cell[:, others[1]] -= two
            np.add.at(total, tuple(cell.T), places)
            np.add.at(count, tuple(cell.T), 1)
            cells.append(cell)
        quad = np.stack(cells, axis=1)
        # Counterclockwise as seen from outside: the cells go around the axis, clockwise for y between z and x.
        flip = (a < 0) == (axis == 1)
        quad[flip] = quad[flip][:, ::-1]
        quads.append(quad)
    crossing = count > 0
    index = np.full(tuple(shape), -1)
    index[crossing] = np.arange(crossing.sum())
    vertices = total[crossing] / count[crossing][:, None]
    corners = index[tuple(np.moveaxis(np.concatenate(quads), -1, 0))]
    # Split along the shorter diagonal.
    diagonals = [np.linalg.norm(vertices[corners[:, k]] - vertices[corners[:, k + 2]], axis=1) for k in (0, 1)]
    turned = np.where((diagonals[1] < diagonals[0])[:, None], np.roll(corners, -1, axis=1), corners)
    return vertices, np.concatenate([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]])


def _project(surface: Surface, vertices: NDArray[np.float64], longest: float) -> NDArray[np.float64]:
    """Move vertices onto the surface along its gradient, by at most `longest` per step [m]."""
    for _ in range(3):
        gradient = surface.gradient(vertices)
        length = np.maximum(np.linalg.norm(gradient, axis=1), 0.3)
        step = np.clip(surface.distance(vertices) / length, -longest, longest)
        vertices = vertices - (step / length)[:, None] * gradient
    return vertices


def _weights(surface: Surface, vertices: NDArray[np.float64], blend: float) -> NDArray[np.float64]:
    """Return the share of each segment: of the nearest one and of those that it is joined to."""
    distances = surface.segment_distances(vertices).T
    joined = np.eye(len(SEGMENTS), dtype=bool)
    for child, parent in PARENTS.items():
        if parent is not None:
            i, j = SEGMENTS.index(child), SEGMENTS.index(parent)
            joined[i, j] = joined[j, i] = True
    nearest = distances.argmin(axis=1)
    shares = np.exp((distances.min(axis=1, keepdims=True) - distances) / blend) * joined[nearest]
    return shares / shares.sum(axis=1, keepdims=True)


def _color_shares(body: Body, surface: Surface, vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the share of each color of `PARTS`: those of the nearest segments, and hair on the head."""
    of_segment = {piece.segment: piece.color for piece in make_pieces(body) if piece.name != "hair"}
    blend = _COLOR_BLEND * body.height
    distances = surface.segment_distances(vertices)
    near = np.exp((distances.min(axis=0) - distances) / blend)
    shares = np.zeros((len(vertices), len(PARTS)))
    for name, row in zip(SEGMENTS, near, strict=True):
        column = PARTS.index(of_segment[name])
        shares[:, column] = np.maximum(shares[:, column], row)
    shares /= shares.sum(axis=1, keepdims=True)
    # Hair is on the head, but not below the hairline in front, and not on the nape.
    center, half = body.head
    x, _, z = ((vertices - center) / half).T
    in_face = np.minimum(x - 0.28, 0.56 - z) / 0.1 + 0.5
    has_hair = (np.clip(1 - in_face, 0, 1) * np.clip((z + 0.5) / 0.1, 0, 1))[:, None]
    has_hair = np.where(distances.argmin(axis=0)[:, None] == SEGMENTS.index("head"), has_hair, 0)
    return shares * (1 - has_hair) + has_hair * (np.arange(len(PARTS)) == PARTS.index("hair"))


def _add_eye(body: Body, surface: Surface, side: int, skin: tuple[list[NDArray[Any]], ...]) -> None:
    """Add an eyeball that looks out of the head by a fifth of its radius."""
    radius = _EYE_RADIUS * body.height
    ball = sphere(radius, mesh_tolerance=0.06 * radius)
    place = body.eyes + np.array([0.0, side * body.interpupillary_distance / 2, 0.0])
    low, high = place[0] - 0.05 * body.height, place[0] + 0.05 * body.height
    for _ in range(40):
        place[0] = (low + high) / 2
        low, high = (place[0], high) if surface.distance(place[None])[0] < 0 else (low, place[0])
    place[0] -= 0.80 * radius
    vertices, faces, normals, weights, colors = skin
    start = sum(map(len, vertices))
    rotated = ball.vertices[:, [2, 0, 1]]  # poles forward and backward
    vertices.append(rotated + place)
    faces.append(ball.faces + start)
    normals.append(rotated / radius)
    row = np.zeros((len(rotated), len(SEGMENTS)))
    row[:, SEGMENTS.index("head")] = 1
    weights.append(row)
    colored = np.where(rotated[:, 0] > 0.9 * radius, PARTS.index("pupil"), PARTS.index("white"))
    colors.append(np.eye(len(PARTS))[colored])
