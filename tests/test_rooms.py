# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Generated rooms: nothing overlaps or floats, people can walk in them, and they are the same on every machine."""

import functools
import hashlib
import json
from collections import Counter

import numpy as np
import pytest

import warpvis as wv
from warpvis.errors import PoseError, SceneError
from warpvis.situations import ROOM_KINDS, Room, generate_room

# Digests of descriptions. They change with rules and shapes, and with nothing else: no machine, no version of NumPy.
DIGESTS = {0: "cdeb4d7966aa8414", 1: "e05cf92ba23a2533", 2: "84ebaa49701b4b2d", 4711: "8bc3e913a7c9e31e"}


@functools.cache
def room_of(seed, kind=None, clutter=0.5):
    return generate_room(seed, kind, clutter=clutter)


def digest(room):
    return hashlib.sha256(json.dumps(room.to_dict(), sort_keys=True).encode()).hexdigest()[:16]


@pytest.mark.parametrize("seed", DIGESTS)
def test_the_same_seed_gives_the_same_room(seed):
    room = generate_room(seed)
    assert digest(room) == DIGESTS[seed]
    assert digest(room) == digest(generate_room(seed))
    assert digest(room) != digest(generate_room(seed + 1))


def test_kinds_and_categories_are_balanced():
    rooms = [room_of(seed) for seed in range(300)]
    kinds = Counter(room.kind for room in rooms)
    assert set(kinds) == set(ROOM_KINDS) and min(kinds.values()) > 30
    assert 0.1 < np.mean([len(room.floor) == 6 for room in rooms]) < 0.5
    found = Counter(item.category for room in rooms for item in room.items)
    assert len(found) > 80 and min(found.values()) >= 3
    objects = Counter(item.color for room in rooms for item in room.items if item.movable)
    assert min(objects.values()) > 100


@pytest.mark.parametrize("seed", range(6))
def test_a_room_survives_json(seed):
    room = room_of(seed)
    again = Room.from_dict(json.loads(json.dumps(room.to_dict())))
    assert again.to_dict() == room.to_dict()
    first, second = room.build(), again.build()
    assert [item.name for item in first.objects] == [item.name for item in second.objects]
    for a, b in zip(first.objects, second.objects, strict=True):
        np.testing.assert_array_equal(a.vertices, b.vertices)
    assert again.seats == room.seats


def test_a_scene_has_the_items():
    room = room_of(2)
    scene = room.build()
    movable = [scene.objects[index].name for index in scene.movable]
    assert movable == [item.name for item in room.items if item.movable]
    for item in room.items:
        built = scene.objects[scene.index(item.name)]
        assert built.category == item.category
        low, high = built.bounds
        assert np.allclose(low, item.extent[:3], atol=1e-5) or (low >= np.array(item.extent[:3]) - 1e-5).all()
        assert (high <= np.array(item.extent[3:]) + 1e-5).all()


def test_a_y_up_scene_is_the_rotated_room():
    room = room_of(5)
    z, y = room.build(), room.build(up="y")
    for a, b in zip(z.objects, y.objects, strict=True):
        np.testing.assert_allclose(a.vertices[:, [0, 2, 1]] * (1, 1, -1), b.vertices, atol=1e-5)


BAD = {
    "clutter of 5": (lambda: generate_room(0, clutter=5), "clutter must be a number from 0 to 1, got 5"),
    "size in cm": (lambda: generate_room(0, size=(400, 500)), "size must be from 2.4 to 12 m, got 400; sizes are"),
    "one size": (lambda: generate_room(0, size=[4]), "size must be two numbers"),
    "size of words": (lambda: generate_room(0, size=("a", "b")), "size must be a finite number, got 'a'"),
    "no kind": (lambda: generate_room(0, "garage"), 'kind must be "living room", "office"'),
    "a negative seed": (lambda: generate_room(-1), "seed must be a whole number from 0 up, got -1"),
    "a half seed": (lambda: generate_room(0.5), "seed must be a whole number from 0 up, got 0.5"),
    "a seed for a generator": (lambda: room_of(0).standing_places(0, 1), "rng must be a numpy.random.Generator"),
    "a negative radius": (
        lambda: room_of(0).standing_places(np.random.default_rng(0), 1, -1),
        "radius must be a number from 0.05 to 5, got -1",
    ),
    "a negative count": (
        lambda: room_of(0).standing_places(np.random.default_rng(0), -1),
        "count must be a whole number",
    ),
    "a flat object": (
        lambda: room_of(0).support_places(np.random.default_rng(0), (0.1, 0.1, 0), 1),
        "size must be a number from 0.001 to 5, got 0",
    ),
    "supports of no category": (
        lambda: room_of(0).support_places(np.random.default_rng(0), (0.1, 0.1, 0.1), 1, categories=["sofas"]),
        "categories must be names of categories of items, got 'sofas'",
    ),
    "an unknown item": (lambda: room_of(0).item("mug_99"), "the room has no item 'mug_99'"),
    "x up": (lambda: room_of(0).build(up="x"), 'up must be "z" or "y", got'),
    "no format": (lambda: Room.from_dict({}), "format of a room must be 1, got None"),
    "a list": (lambda: Room.from_dict([]), "a description of a room must be a mapping"),
    "no floor": (lambda: Room.from_dict(without("floor")), "the description of a room lacks 'floor'"),
    "an unknown category": (
        lambda: Room.from_dict(with_item(category="unicorn")),
        "category of item 'stool_1' of a room",
    ),
    "an unknown color": (
        lambda: Room.from_dict(with_item(color="plaid")),
        "color of item 'stool_1' of a room must be one of",
    ),
    "a short pose": (
        lambda: Room.from_dict(with_item(pose=[0, 0])),
        "pose of item 'stool_1' of a room must be 7 numbers",
    ),
    "unknown parameters": (lambda: Room.from_dict(with_item(parameters={"x": 1})), "parameters of item 'stool_1' of a"),
}


def without(name):
    data = room_of(0).to_dict()
    del data[name]
    return data


def with_item(**changes):
    data = room_of(0).to_dict()
    item = {**data["items"][0], "name": "stool_1", **changes}
    return {**data, "items": [item]}


@pytest.mark.parametrize("case", BAD)
def test_invalid_input_is_one_sentence(case):
    call, message = BAD[case]
    with pytest.raises((SceneError, PoseError)) as error:
        call()
    assert message in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("seed", range(8))
def test_rays_from_inside_leave_through_openings_only(seed):
    """A closed room: rays in all directions hit something, or pass a door or a window."""
    room = room_of(seed)
    scene = room.build()
    x, y, _ = room.standing_places(np.random.default_rng(0), 1)[0]
    eye = np.array([x, y, 1.6])
    camera = wv.Camera.from_fov(64, 64, hfov=np.pi / 2 + 0.02)
    targets = eye + np.concatenate([np.eye(3), -np.eye(3)])
    for target in targets:
        up = (1.0, 0.0, 0.0) if abs(target[2] - eye[2]) > 0.5 else (0.0, 0.0, 1.0)
        pose = wv.look_at(eye, target, up=up)
        views = wv.render(scene, camera, pose, outputs=("depth", "points"))
        depth = views.depth.numpy()[0]
        missed = ~np.isfinite(depth) | (depth <= 0)
        for row, column in np.argwhere(missed):
            ray = direction_of(camera, pose, row, column)
            assert any(passes(room, opening, eye, ray) for opening in room.outline.openings)


def direction_of(camera, pose, row, column):
    """Return the direction of a pixel in the world."""
    local = np.array([(column + 0.5 - camera.cx) / camera.fx, (row + 0.5 - camera.cy) / camera.fy, 1.0])
    x, y, z, w = np.asarray(pose).ravel()[3:]
    q = np.array([x, y, z])
    return local + 2 * np.cross(q, np.cross(q, local) + w * local)


def passes(room, opening, eye, ray):
    """Return whether a ray crosses an opening of a wall."""
    wall = room.outline.walls[opening.wall]
    normal, along = np.array([-wall.dy, wall.dx, 0.0]), np.array([wall.dx, wall.dy, 0.0])
    speed = ray @ normal
    if speed >= 0:
        return False
    point = eye + ray * ((np.array([wall.x, wall.y, 0.0]) - eye) @ normal / speed)
    at = (point - (wall.x, wall.y, 0.0)) @ along
    return -1e-4 <= at - opening.start <= opening.width + 1e-4 and opening.low - 1e-4 <= point[2] <= opening.high + 1e-4
