# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Items of generated rooms: none overlaps another, none floats, and people reach doors and seats."""

import functools
import itertools

import manifold3d
import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from warpvis.core.poses import poses_to_matrices
from warpvis.situations import generate_room
from warpvis.situations.rooms._boxes import extents_meet
from warpvis.situations.rooms.shapes import CATEGORIES, get_shape

SEEDS = [pytest.param(range(start, start + 20), id=f"from-{start}") for start in range(0, 200, 20)]
TOUCHING = 2e-9  # volume of an overlap that is rounding [m3]


@functools.cache
def pieces_of(category, parameters):
    """Return the closed pieces of a shape."""
    shape = get_shape(category, dict(parameters))
    faces = shape.faces
    ends = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = coo_matrix((np.ones(len(ends)), ends.T), shape=(len(shape.vertices),) * 2)
    _, owner = connected_components(graph, directed=False)
    pieces = []
    for number in np.unique(owner[faces[:, 0]]):
        part, corners = np.unique(faces[owner[faces[:, 0]] == number], return_inverse=True)
        mesh = manifold3d.Mesh64(shape.vertices[part], corners.reshape(-1, 3).astype(np.uint64))
        pieces.append(manifold3d.Manifold(mesh))
    return pieces


@functools.cache
def solid_of(category, parameters):
    """Return the union of the pieces of a shape."""
    return manifold3d.Manifold.batch_boolean(pieces_of(category, parameters), manifold3d.OpType.Add)


def placed(item):
    key = tuple(sorted(item.parameters.items()))
    return solid_of(item.category, key).transform(poses_to_matrices(np.array(item.pose))[:3])


ALL = [(name, tuple(sorted(variant.items()))) for name in CATEGORIES for variant in CATEGORIES[name].variants]


@pytest.mark.parametrize(("name", "parameters"), ALL, ids=str)
def test_shapes_are_closed_and_within_their_boxes(name, parameters):
    """Each piece is a closed surface with outward normals, and the boxes of the parts contain all corners."""
    shape = get_shape(name, dict(parameters))
    for piece in pieces_of(name, parameters):
        assert piece.status() == manifold3d.Error.NoError and piece.volume() > 0
    x, y, z = shape.vertices.T
    inside = np.zeros(len(x), dtype=bool)
    for cx, cy, a, b, low, high in shape.parts:
        inside |= (abs(x - cx) <= a + 1e-6) & (abs(y - cy) <= b + 1e-6) & (low - 1e-6 <= z) & (z <= high + 1e-6)
    assert inside.all()
    assert z.min() == 0 and 12 <= len(shape.faces) <= 950
    assert CATEGORIES[name].mount != "wall" or abs(x.min()) < 1e-9
    for support in shape.supports:
        share = 0.5 if name == "stove" else 0.999  # pots may be larger than hot plates
        at = [grid.ravel() for grid in np.meshgrid(*[np.linspace(-0.99, 0.99, 9)] * 2)]
        points = np.array(support.center) + np.stack(at, axis=1) * support.half
        assert surface_at(shape, points, support.z).mean() > (0.75 if support.name in ("seat", "blanket") else share)
    for seat in shape.seats:
        assert surface_at(shape, np.array([seat.position[:2]]), seat.position[2]).all()


def surface_at(shape, points, height):
    """Return whether horizontal triangles at a height cover points, shape ``(n, 2)``."""
    corners = shape.vertices[shape.faces]
    a, b, c = np.swapaxes(corners[(abs(corners[..., 2] - height) < 1e-6).all(axis=1)][..., :2], 0, 1)[:, None]
    sides = [(q - p)[..., 0] * (points[:, None] - p)[..., 1] - (q - p)[..., 1] * (points[:, None] - p)[..., 0]
             for p, q in ((a, b), (b, c), (c, a))]  # fmt: skip
    return (np.min(sides, axis=0) >= -1e-12).any(axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("seeds", SEEDS)
def test_no_two_items_overlap(seeds):
    """Exact intersections of the solids have no volume."""
    for seed in seeds:
        room = generate_room(seed, clutter=0.3 + 0.7 * (seed % 2))
        solids = {item.name: placed(item) for item in room.items}
        for a, b in itertools.combinations(room.items, 2):
            if extents_meet(a.extent, b.extent):
                assert (solids[a.name] ^ solids[b.name]).volume() < TOUCHING, f"{seed}: {a.name} and {b.name}"


def test_no_two_items_of_some_rooms_overlap():
    test_no_two_items_overlap(range(1000, 1006))


def test_items_are_within_the_room():
    for seed in range(24):
        room = generate_room(seed, clutter=1.0)
        for item in room.items:
            matrix = poses_to_matrices(np.array(item.pose))
            vertices = item.mesh[0] @ matrix[:3, :3].T + matrix[:3, 3]
            assert vertices[:, 2].min() > -1e-6 and vertices[:, 2].max() < room.height + 1e-6
            for x, y in vertices[:, :2].tolist():
                assert room.outline.distance_to_wall(x, y) > -1e-6, f"{seed}: {item.name} is in a wall"


def test_nothing_floats():
    """Every item touches what supports it to 1e-6 m, and its plan is on it."""
    for seed in range(40):
        room = generate_room(seed, clutter=1.0)
        for item in room.items:
            x, y, z = item.pose[:3]
            if item.support == "floor":
                assert z == 0
            elif item.support == "ceiling":
                assert abs(z + item.size[2] - room.height) < 1e-6
            elif item.support.startswith("wall_") and "shelf" not in item.support and "cabinet" not in item.support:
                wall = room.outline.walls[int(item.support.removeprefix("wall_")) - 1]
                assert abs((y - wall.y) * wall.dx - (x - wall.x) * wall.dy) < 1e-6
            else:
                below = room.item(item.support)
                tops = (
                    [below.pose[2] + s.z for s in below.shape.supports] if below.category != "rug" else [below.size[2]]
                )
                assert min(abs(z - top) for top in tops) < 1e-6, f"{seed}: {item.name} floats"
                assert below.extent[0] - 1e-6 <= item.extent[0] and item.extent[3] <= below.extent[3] + 1e-6
                assert below.extent[1] - 1e-6 <= item.extent[1] and item.extent[4] <= below.extent[4] + 1e-6


def test_doors_are_reachable():
    for seed in range(100):
        room = generate_room(seed, clutter=1.0)
        assert room.doors and room.free_floor.joins_doors
        assert room.free_floor.area > 0.1 * room.area


def test_standing_places_are_free():
    for seed in range(12):
        room = generate_room(seed)
        for radius in (0.2, 0.3, 0.42):
            places = room.standing_places(np.random.default_rng(seed), 20, radius)
            assert places.shape[0] in (0, 20)
            if radius <= 0.3:
                assert len(places) == 20
            for x, y, z in places.tolist():
                assert room.outline.distance_to_wall(x, y) >= radius
                assert 0 <= z < 0.01
                for item in room.items:
                    if item.category != "rug" and item.extent[2] < 1.9:
                        matrix = poses_to_matrices(np.array(item.pose))
                        at = item.mesh[0] @ matrix[:2, :3].T + matrix[:2, 3]
                        assert np.hypot(*(at - (x, y)).T).min() >= radius - 1e-6


def test_support_places_are_free():
    found = 0
    for seed in range(20):
        room = generate_room(seed)
        places = room.support_places(np.random.default_rng(seed), (0.08, 0.06, 0.1), 5)
        found += len(places)
        for place in places:
            box = manifold3d.Manifold.cube((0.08, 0.06, 0.1), center=True).translate((0, 0, 0.05))
            box = box.transform(poses_to_matrices(np.array(place.pose))[:3])
            below = room.item(place.support)
            level = next(level for level in below.shape.supports if level.name == place.level)
            assert abs(place.pose[2] - below.pose[2] - level.z) < 1e-6
            for item in room.items:
                assert (box ^ placed(item)).volume() < TOUCHING
    assert found > 60


def test_seats_face_away_from_backrests():
    seats = [(seat, room) for room in map(generate_room, range(60)) for seat in room.seats]
    assert len(seats) > 100
    for seat, room in seats:
        item = room.item(seat.item)
        assert 0.4 < seat.height < 0.8 and -np.pi <= seat.heading <= np.pi
        if item.category in ("chair", "office chair", "sofa", "armchair"):
            assert abs(np.sin(seat.heading - item.yaw)) < 1e-6 and np.cos(seat.heading - item.yaw) > 0
