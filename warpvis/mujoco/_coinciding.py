# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pairs of objects whose surfaces coincide at their initial poses: planes of triangles, or solids."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices
from warpvis.scene import SceneObject
from warpvis.scene.solids import Solid, SolidKind

# Every pair found here is tested again for every pixel (`warpvis.kernels.mujoco.coinciding`): no coinciding pair may be
# missed, and false positives do no harm.

_CLOSENESS = 1e-5
"""Planes coincide if, where they overlap, their distance is below this fraction of their size and distance from the
origin."""

_TURN = 5e-4
"""Largest difference between normals of coinciding planes: the rounding of corners causes such differences in triangles
of a few thousandths of the size of their object."""

_FINE = 1e-6
"""Triangles of one object share a plane if their normals and offsets are equal after rounding to this."""

_SKEW = np.array([0.3571, 0.5219, 0.7746])
"""A direction along which the normals of common shapes differ."""

_TABLE = 1 << 22
"""Bins in the table that rules out most triangles that match no other."""

_MIN_SAMPLES = 3
"""Surfaces that only touch or cross have fewer common samples."""

_Ints = NDArray[np.int64]
_Floats = NDArray[np.float64]

_NOBODY: _Ints = np.zeros(0, dtype=np.int64)
_EVERYWHERE: _Floats = np.array([[-np.inf] * 3, [np.inf] * 3])


@dataclass(frozen=True)
class Pairs:
    """Pairs of objects that coincide somewhere, sorted by the earlier object and then the later one."""

    earlier: _Ints
    later: _Ints
    same: NDArray[np.bool_]
    """Whether both objects have the same triangles."""
    boxes: _Floats
    """Minimum and maximum corner of the coinciding region, in the world, shape ``(pairs, 2, 3)`` [m]."""
    faces: dict[int, _Ints] = field(default_factory=dict)
    """Triangles of the later objects that coincide with triangles of an earlier object that is not the same."""


def find_pairs(
    objects: Sequence[SceneObject], pieces: NDArray[np.int_], *, resizable: NDArray[np.int64] = _NOBODY
) -> Pairs:
    """Find objects whose surfaces coincide somewhere and face the same way at their initial poses.

    Objects of different pieces may coincide elsewhere later: their triangles whose planes coincide at the initial poses
    are found, and their boxes enclose all such triangles. Objects of `resizable`, which may have other sizes in some
    worlds, may coincide with all objects of their piece that they touch.
    """
    boxes = np.array([_bounds(item) for item in objects], dtype=np.float64).reshape(-1, 2, 3)
    margin = _CLOSENESS * np.abs(boxes).max(axis=(1, 2), initial=0.0)[:, None]
    low, high = boxes[:, 0] - margin, boxes[:, 1] + margin
    together = np.zeros(len(objects), dtype=np.int64)
    i, j = _overlapping(low, high, together)
    i, j = np.minimum(i, j), np.maximum(i, j)
    is_solid = np.array([item.solid is not None for item in objects], dtype=bool)
    is_across, may_differ = pieces[i] != pieces[j], np.isin(i, resizable) | np.isin(j, resizable)
    resized = may_differ & ~is_across
    both, stays = is_solid[i] & is_solid[j] & ~resized, ~may_differ & ~is_across
    same = _find_same(objects, i[~both & stays], j[~both & stays])
    compared = np.array([pair not in same for pair in zip(i.tolist(), j.tolist(), strict=True)], dtype=bool) & ~resized
    found, faces = dict[tuple[int, int], _Floats](), dict[int, _Ints]()
    for kinds, pairs_of_kind in ((pieces, ~is_across), (together, is_across)):
        chosen = compared & pairs_of_kind
        new, of_later = _find_planes(objects, kinds, (i[chosen], j[chosen]), (low, high))
        found |= new
        faces |= {index: np.union1d(numbers, faces.get(index, _NOBODY)) for index, numbers in of_later.items()}
    solids = [pair for pair in zip(i[both].tolist(), j[both].tolist(), strict=True) if _share_surface(objects, pair)]
    # The triangles at the ends of cylinders do not include the rims.
    flat = [(a, b) for a, b in found if is_solid[a] or is_solid[b]]
    for a, b in [*same, *solids, *flat]:
        found[a, b] = np.stack([np.maximum(low[a], low[b]), np.minimum(high[a], high[b])])
    found |= {(a, b): _anywhere_on(objects[b], b, faces, resizable) for a, b in found if pieces[a] != pieces[b]}
    for a, b in zip(i[resized].tolist(), j[resized].tolist(), strict=True):
        found[a, b] = _EVERYWHERE
        if not is_solid[b]:
            faces[b] = np.arange(len(objects[b].faces))
    pairs = sorted(found)
    rows = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    shared = np.array([found[pair] for pair in pairs], dtype=np.float64).reshape(-1, 2, 3)
    return Pairs(rows[:, 0], rows[:, 1], np.array([pair in same for pair in pairs], dtype=bool), shared, faces)


def _anywhere_on(item: SceneObject, index: int, faces: dict[int, _Ints], resizable: NDArray[np.int64]) -> _Floats:
    """Return the box of an object's triangles that coincide with others; unbounded for solids and resizable objects."""
    if item.solid is not None or index in resizable:
        return _EVERYWHERE
    corners = item.vertices[item.faces[faces[index]]].reshape(-1, 3).astype(np.float64)
    return np.stack([corners.min(axis=0), corners.max(axis=0)])


def _bounds(item: SceneObject) -> _Floats:
    """Return the bounds of an object, including the true surface of a solid, shape ``(2, 3)`` [m]."""
    bounds = np.array(item.bounds, dtype=np.float64)
    if item.solid is None or item.pose is None:
        return bounds
    place = poses_to_matrices(item.pose)
    axes = place[:3, :3] * item.solid.radii
    curved = axes[:, : 2 if item.solid.kind == SolidKind.CYLINDER else 3]
    reach = np.linalg.norm(curved, axis=1) + np.abs(axes[:, 2]) * item.solid.half
    return np.stack([np.minimum(bounds[0], place[:3, 3] - reach), np.maximum(bounds[1], place[:3, 3] + reach)])


def _find_same(objects: Sequence[SceneObject], i: _Ints, j: _Ints) -> set[tuple[int, int]]:
    """Find pairs of meshes with the same triangles, in the world and in the frames that they move with."""
    sizes = np.array([(len(item.vertices), len(item.faces)) for item in objects]).reshape(-1, 2)
    alike = np.flatnonzero((sizes[i] == sizes[j]).all(axis=1))
    same = set()
    for a, b in zip(i[alike].tolist(), j[alike].tolist(), strict=True):
        one, other = objects[a], objects[b]
        has_solid = one.solid is not None or other.solid is not None
        if one.movable == other.movable and not has_solid and np.array_equal(one.faces, other.faces):
            pairs = [(one.vertices, other.vertices), (one.frame_vertices, other.frame_vertices)]
            if all(np.abs(p - q).max() <= _CLOSENESS * np.abs(p).max() for p, q in pairs):
                same.add((a, b))
    return same


def _share_surface(objects: Sequence[SceneObject], pair: tuple[int, int]) -> bool:
    """Return whether part of a solid's true surface lies on that of another one."""
    one, other = (objects[index] for index in pair)
    assert one.solid is not None and other.solid is not None and one.pose is not None and other.pose is not None
    one_pose, other_pose = poses_to_matrices(one.pose), poses_to_matrices(other.pose)
    points = _samples(one.solid) @ one_pose[:3, :3].T + one_pose[:3, 3]
    shape = ((points - other_pose[:3, 3]) @ other_pose[:3, :3]) / other.solid.radii
    across, along = np.hypot(shape[:, 0], shape[:, 1]), np.abs(shape[:, 2]) - other.solid.half
    beyond = np.hypot(across, np.maximum(along, 0)) - 1
    if other.solid.kind == SolidKind.CYLINDER:
        beyond = np.maximum(across - 1, along)
    return int(np.count_nonzero(np.abs(beyond) < _CLOSENESS)) >= _MIN_SAMPLES


def _samples(solid: Solid) -> _Floats:
    """Sample points on a solid's surface, none of them on an edge or a line of symmetry, in its frame [m]."""
    azimuth, up = (part.ravel() for part in np.meshgrid(np.arange(9) * 0.7 + 0.1, np.linspace(-0.93, 0.97, 8)))
    circle = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    ball = np.c_[np.sqrt(1 - up**2)[:, None] * circle, up]
    if solid.kind == SolidKind.BALL:
        return ball * solid.radii
    side = np.c_[circle, up * solid.half]
    ends = ball + np.c_[np.zeros((len(ball), 2)), np.sign(up) * solid.half]
    if solid.kind == SolidKind.CYLINDER:
        ends = np.c_[np.abs(up)[:, None] * circle, np.sign(up) * solid.half]
    return np.concatenate([side, ends]) * solid.radii


def _flat_faces(item: SceneObject) -> NDArray[np.int32]:
    """Return the triangles that lie on the true surface: all of a mesh, the ends of a cylinder."""
    if item.solid is None:
        return item.faces
    if item.solid.kind != SolidKind.CYLINDER:
        return item.faces[:0]
    first_pole = len(item.vertices) - 2
    return item.faces[(item.faces >= first_pole).any(axis=1)]


@dataclass(frozen=True)
class _Triangles:
    """N triangles of several objects."""

    owner: _Ints
    """(N,): the object."""
    piece: _Ints
    """(N,): the rigid piece of the object."""
    face: _Ints
    """(N,): its index among the object's triangles; 0 for a solid."""
    low: _Floats
    """(N, 3): minimum corner of its box [m]."""
    high: _Floats
    normal: _Floats
    """(N, 3)."""
    offset: _Floats
    """(N,): its plane is ``normal . x = offset``, relative to `middle` [m]."""
    middle: _Floats
    """(N, 3): a reference point on its piece [m]."""

    @classmethod
    def of(cls, corners: _Floats, faces: _Ints, owners: _Ints, pieces: NDArray[np.int_]) -> _Triangles:
        """Make them from corners, ``(N, 3, 3)``, face indices, object indices, and every object's piece.

        Triangles without an area are omitted, and so are most of those whose planes match no other object's.
        """
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        normal = np.cross(b - a, c - a)
        length = np.sqrt(np.einsum("nk,nk->n", normal, normal))
        normal /= np.where(length > 0, length, 1)[:, None]
        # Measured from a corner of the object's piece, offsets are small numbers with more significant digits.
        _, first, dense = np.unique(pieces, return_index=True, return_inverse=True)
        start = np.zeros((len(first), 3))
        start[dense[owners]] = a
        middle = start[dense[owners]]
        offset = np.einsum("nk,nk->n", normal, a - middle)
        matches = _may_match(normal, offset, np.linalg.norm(a - middle, axis=1), pieces[owners], owners)
        chosen = np.flatnonzero(matches & (length > 0))
        a, b, c = a[chosen], b[chosen], c[chosen]
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        owners = owners[chosen]
        return cls(owners, pieces[owners], faces[chosen], low, high, normal[chosen], offset[chosen], middle[chosen])

    def take(self, chosen: NDArray[np.int64 | np.bool_]) -> _Triangles:
        """Return the selected triangles."""
        return _Triangles(**{name: part[chosen] for name, part in vars(self).items()})


def _find_planes(
    objects: Sequence[SceneObject],
    pieces: NDArray[np.int_],
    pairs: tuple[_Ints, _Ints],
    boxes: tuple[_Floats, _Floats],
) -> tuple[dict[tuple[int, int], _Floats], dict[int, _Ints]]:
    """Find pairs of objects that share planes of triangles, with bounding boxes, and the later objects' triangles.

    `pairs` are the earlier and the later objects to test, and `boxes` the slightly enlarged boxes of all objects.
    """
    parts = [_read_triangles(objects, index, pairs, boxes) for index in np.unique(np.concatenate(pairs)).tolist()]
    if not parts:
        return {}, {}
    corners, numbers, owners = (np.concatenate(part) for part in zip(*parts, strict=True))
    triangles = _Triangles.of(corners, numbers, owners, pieces)
    planes, plane_of = _join_planes(triangles)
    p, q = _matching(planes)
    # Encode a pair of objects as one number.
    is_pair = np.isin(planes.owner[p] * len(objects) + planes.owner[q], pairs[0] * len(objects) + pairs[1])
    p, q = p[is_pair], q[is_pair]
    found, pair_of = np.unique(planes.owner[p] * len(objects) + planes.owner[q], return_inverse=True)
    shared = np.stack([np.full((len(found), 3), np.inf), np.full((len(found), 3), -np.inf)], axis=1)
    np.minimum.at(shared[:, 0], pair_of, np.maximum(planes.low[p], planes.low[q]))
    np.maximum.at(shared[:, 1], pair_of, np.minimum(planes.high[p], planes.high[q]))
    chosen = np.zeros(len(planes.owner), dtype=bool)
    chosen[q] = True
    taken = chosen[plane_of]
    owner, face = triangles.owner[taken], triangles.face[taken]
    faces_of = {int(k): np.sort(face[owner == k]) for k in np.unique(owner) if objects[k].solid is None}
    for index, faces in faces_of.items():
        if 2 * len(faces) > len(objects[index].faces):  # the rest are slivers, whose normals are dominated by rounding
            faces_of[index] = np.arange(len(objects[index].faces))
    return {divmod(int(pair), len(objects)): box for pair, box in zip(found, shared, strict=True)}, faces_of


def _read_triangles(
    objects: Sequence[SceneObject], index: int, pairs: tuple[_Ints, _Ints], boxes: tuple[_Floats, _Floats]
) -> tuple[_Floats, _Ints, _Ints]:
    """Read an object's flat triangles near other objects: corners ``(n, 3, 3)``, face indices, and object indices."""
    item, (low, high) = objects[index], boxes
    neighbors = np.r_[pairs[1][pairs[0] == index], pairs[0][pairs[1] == index]]
    lower, upper = low[neighbors].min(axis=0), high[neighbors].max(axis=0)
    triangles = _flat_faces(item)
    inside = (item.vertices <= upper) & (item.vertices >= lower)
    if not inside.all():
        below, above = item.vertices < lower, item.vertices > upper
        outside = np.zeros(len(triangles), dtype=bool)
        for axis, side in product(range(3), (below, above)):
            outside |= side[:, axis][triangles].all(axis=1)
        numbers = np.flatnonzero(~outside)
    else:
        numbers = np.arange(len(triangles))
    corners = item.vertices[triangles[numbers]].astype(np.float64)
    return corners, numbers if item.solid is None else 0 * numbers, np.full(len(numbers), index)


def _bins(normal: _Floats, offset: _Floats, distance: _Floats, piece: NDArray[np.int_]) -> Iterator[NDArray[np.uint64]]:
    """Hash planes into bins by a coordinate of their normals and by their offsets.

    Four hashes are made, shifted by half a bin, so that planes closer than half a bin share a bin at least once. An
    error in a normal changes an offset by the error times the distance from the reference point.
    """
    reach = max(float(np.median(distance)), _FINE) if len(distance) else 1.0
    angle, away = normal @ _SKEW / (2 * _TURN), offset / (2 * _TURN * reach)
    for shift, other_shift in product((0.0, 0.5), repeat=2):
        yield _mixed(np.floor(angle + shift).astype(np.int64), np.floor(away + other_shift).astype(np.int64), piece)


def _may_match(
    normal: _Floats, offset: _Floats, distance: _Floats, piece: NDArray[np.int_], owner: NDArray[np.int_]
) -> NDArray[np.bool_]:
    """Return which triangles may share a plane with another object's: a quick test by a table, which most fail."""
    matches = np.zeros(len(owner), dtype=bool)
    table, short = np.zeros(_TABLE, dtype=np.int32), owner.astype(np.int32)
    for bins in _bins(normal, offset, distance, piece):
        places = (bins & np.uint64(_TABLE - 1)).astype(np.int64)
        table[places] = short
        shared = np.zeros(_TABLE, dtype=bool)
        shared[places[table[places] != short]] = True
        matches |= shared[places]
    return matches


def _join_planes(triangles: _Triangles) -> tuple[_Triangles, _Ints]:
    """Merge an object's triangles that share a plane, with their common box; return planes and triangles' planes."""
    scale = np.maximum(np.abs(triangles.low), np.abs(triangles.high)).max(axis=1, initial=_FINE)
    digits = np.rint(np.c_[triangles.normal, triangles.offset / scale] / _FINE).astype(np.int64)
    _, first, plane = np.unique(_mixed(*digits.T, triangles.owner), return_index=True, return_inverse=True)
    planes = triangles.take(first)
    np.minimum.at(planes.low, plane, triangles.low)
    np.maximum.at(planes.high, plane, triangles.high)
    return planes, plane.astype(np.int64)


def _matching(planes: _Triangles) -> tuple[_Ints, _Ints]:
    """Find pairs of planes, the earlier object's first, that coincide where their boxes overlap."""
    margin = _CLOSENESS * np.maximum(np.abs(planes.low), np.abs(planes.high)).max(axis=1, initial=0.0)[:, None]
    low, high = planes.low - margin, planes.high + margin
    distance = np.linalg.norm((planes.low + planes.high) / 2 - planes.middle, axis=1)
    every = _bins(planes.normal, planes.offset, distance, planes.piece)
    found = [np.stack(_overlapping(low, high, bins)) for bins in every]
    p, q = np.concatenate(found, axis=1)
    p, q = np.where(planes.owner[p] < planes.owner[q], (p, q), (q, p))
    different = planes.owner[p] != planes.owner[q]
    p, q = p[different], q[different]
    lower, upper = np.maximum(planes.low[p], planes.low[q]), np.minimum(planes.high[p], planes.high[q])
    middle, size = (lower + upper) / 2, np.linalg.norm(upper - lower, axis=1)
    above = [np.einsum("nk,nk->n", planes.normal[k], middle - planes.middle[p]) - planes.offset[k] for k in (p, q)]
    close = np.abs(above[0] - above[1]) <= _CLOSENESS * (np.linalg.norm(middle, axis=1) + size)
    close &= np.abs(planes.normal[p] - planes.normal[q]).max(axis=1, initial=0.0) <= _TURN
    return p[close], q[close]


def _mixed(*columns: NDArray[np.int_]) -> NDArray[np.uint64]:
    """Hash rows of integers; rows that differ have different hashes, except for collisions."""
    mixed = np.zeros(len(columns[0]), dtype=np.uint64)
    for column in columns:
        mixed ^= column.astype(np.uint64)
        mixed *= np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    return mixed


def _overlapping(low: _Floats, high: _Floats, kinds: NDArray[np.integer[Any]]) -> tuple[_Ints, _Ints]:
    """Find overlapping pairs of boxes of one kind, each once, by sweeping along the axis of largest spread."""
    if len(low) < 2:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    _, kind = np.unique(kinds, return_inverse=True)
    axis = int(np.std(low, axis=0).argmax())
    origin, span = low[:, axis].min(), np.ptp(np.r_[low[:, axis], high[:, axis]])
    scale = 0.5 / span if span > 0 else 0.0
    begin, end = (kind + (part[:, axis] - origin) * scale for part in (low, high))
    order = np.argsort(begin, kind="stable")
    last = np.searchsorted(begin[order], end[order], side="right")
    counts = last - np.arange(1, len(order) + 1)
    one = np.repeat(np.arange(len(order)), counts)
    other = one + 1 + np.arange(len(one)) - np.repeat(np.cumsum(counts) - counts, counts)
    one, other = order[one], order[other]
    overlap = ((low[one] <= high[other]) & (low[other] <= high[one])).all(axis=1)
    return one[overlap], other[overlap]
