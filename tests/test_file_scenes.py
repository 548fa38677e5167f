# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Situations in scenes of files: free places in a house that the test writes, answers, and files without a floor."""

import json
import re
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.errors import FileFormatError, SceneError, WarpvisError
from warpvis.situations import SituationGenerator, SituationOptions, _generator
from warpvis.situations._file_rooms import FileRoom
from warpvis.situations._file_scenes import FileScene
from warpvis.situations._numbers import Numbers
from warpvis.situations.rooms._boxes import Box

HALF = 2.5
TABLES = {"table": (1.0, 1.2), "desk": (-1.3, -1.0)}
TOP = 0.74
SHELF = (-2.25, 0.9)
SHIFT = np.array([7.0, -3.0, 1.25])
"""Where the house is in its file."""


def box(sides, center):
    return trimesh.creation.box(sides).apply_translation(center)


def table(x, y):
    legs = [box((0.05, 0.05, TOP), (x + u, y + v, TOP / 2)) for u in (-0.5, 0.5) for v in (-0.3, 0.3)]
    return trimesh.util.concatenate([box((1.2, 0.8, 0.04), (x, y, TOP - 0.02)), *legs])


def house(up="z"):
    """Return a room with walls without thickness, two tables, a shelf and a closed cabinet, around the origin."""
    scene = wv.Scene(up="z")
    scene.add(box((2 * HALF, 2 * HALF, 0.2), (0, 0, -0.1)), name="floor")
    scene.add(box((2 * HALF, 2 * HALF, 0.1), (0, 0, 2.55)), name="ceiling")
    for number, (normal, offset) in enumerate([((1, 0), -HALF), ((-1, 0), HALF), ((0, 1), -HALF), ((0, -1), HALF)]):
        u, v = np.array(normal)[::-1] * HALF, np.array(normal) * abs(offset)
        corners = [[*(-v - u), 0], [*(u - v), 0], [*(u - v), 2.5], [*(-v - u), 2.5]]
        scene.add((np.array(corners, float), np.array([[0, 1, 2], [0, 2, 3]])), name=f"wall_{number}", category="wall")
    for name, (x, y) in TABLES.items():
        scene.add(table(x, y), name=name, category=name, appearance=(0.6, 0.4, 0.2))
    x, y = SHELF
    planks = [box((0.4, 1.2, 0.03), (x, y, z)) for z in (0.1, 0.5, 0.9, 1.3, 1.7)]
    sides = [box((0.4, 0.03, 1.72), (x, y + v, 0.86)) for v in (-0.6, 0.6)]
    scene.add(trimesh.util.concatenate([*planks, *sides]), name="robot", category="Book_Shelf")
    scene.add(box((0.5, 0.5, 1.9), (2.2, -2.2, 0.95)), name="cabinet", category="cabinet")
    shifted = wv.Scene(up="z")
    for item in scene.objects:
        mesh = item.vertices + SHIFT, item.faces
        shifted.add(mesh, name=item.name, label=item.label, category=item.category)
    return shifted


@cache
def path():
    file = Path(mkdtemp()) / "house.glb"
    house().export(file)
    return str(file)


@cache
def file_scene():
    return FileScene(path())


def room(seed=0):
    return FileRoom(file_scene(), Numbers(seed, 0, 0))


OPTIONS = {"seed": 3, "per_shard": 6, "outputs": (), "questions": ("sees", "who")}


@pytest.fixture(autouse=True)
def few_arrangements(monkeypatch):
    monkeypatch.setattr(_generator, "_WORLDS", 100)


@cache
def situations():
    return SituationGenerator(SituationOptions(scenes=(path(),), **OPTIONS)).shard(0)


def test_floor_is_found_below_furniture_and_not_on_the_roof():
    assert file_scene().floor == pytest.approx(SHIFT[2], abs=1e-5)
    standing = file_scene().standing - SHIFT
    assert len(standing) > 400 and (np.abs(standing[:, :2]) <= HALF - 0.3 + 1e-6).all()


def test_people_stand_inside_and_clear_of_everything():
    one = room()
    for radius in (0.3, 0.5):
        spots = one.standing_places(np.random.default_rng(0), 100, radius) + one.origin - SHIFT
        assert spots.shape == (100, 3) and np.abs(spots[:, 2]).max() < 1e-5
        assert (np.abs(spots[:, :2]) <= HALF - radius + 1e-5).all()
        for x, y in TABLES.values():
            gap = np.hypot(*np.maximum(np.abs(spots[:, :2] - [x, y]) - [0.6, 0.4], 0).T)
            assert (gap >= radius - 1e-5).all()
    assert not len(one.standing_places(np.random.default_rng(0), 5, 2.4))


def test_objects_stand_on_surfaces_with_free_height():
    one, size = room(), (0.2, 0.1, 0.3)
    places = one.support_places(np.random.default_rng(1), size, 150)
    assert len(places) == 150
    seen = set()
    for place in places:
        x, y, z = np.array(place.pose[:3]) + one.origin - SHIFT
        levels = [TOP] if place.support in TABLES else [0.515, 0.915, 1.315]
        assert min(abs(z - level) for level in levels) < 2e-3 and z - 1e-4 > min(levels)
        c, s = np.cos(2 * np.arctan2(*place.pose[5:])), np.sin(2 * np.arctan2(*place.pose[5:]))
        corners = [(x + c * u - s * v, y + s * u + c * v) for u in (-0.1, 0.1) for v in (-0.05, 0.05)]
        middle, half = (TABLES[place.support], (0.6, 0.4)) if place.support in TABLES else (SHELF, (0.2, 0.585))
        assert (np.abs(np.subtract(corners, middle)) <= np.add(half, 1e-4)).all()
        seen.add(place.support)
    assert seen == {"table", "desk", "file/robot"}
    tall = one.support_places(np.random.default_rng(1), (0.1, 0.1, 0.5), 60)
    assert {place.support for place in tall} == {"table", "desk"}  # planks are 0.37 m apart


def test_moved_objects_stay_on_their_support_and_clear_of_walls():
    one = room()
    for x, expected in ((1.0, True), (1.55, False), (2.45, False)):
        at = np.array([x, 1.2, TOP + 1e-3]) + SHIFT - one.origin
        assert one.holds([Box(*at[:2], 1.0, 0.0, 0.1, 0.1, at[2], at[2] + 0.2)], 0.0) == expected
    low = np.array([1.0, 1.2, TOP - 0.01]) + SHIFT - one.origin
    assert not one.holds([Box(*low[:2], 1.0, 0.0, 0.1, 0.1, low[2], low[2] + 0.2)], 0.0)


def test_words_are_categories_that_are_unique():
    words = wv.situations._stage_items.words_of(room())
    assert words["table"] == "the table" and words["file/robot"] == "the book shelf"
    assert not any(name.startswith("wall") or name in ("floor", "ceiling") for name in words)


def test_answers_are_those_of_the_scene():
    options = SituationOptions(scenes=(path(),), **OPTIONS)
    checked, attempt, scene = 0, None, wv.Scene()
    for one in situations()[::2]:
        if one.room["attempt"] != attempt:
            attempt, scene = one.room["attempt"], SituationGenerator(options).scene(one)
        now = one.moments[0]
        poses = np.array([[now.poses[scene.objects[index].name] for index in scene.movable]])
        for who in now.participants:
            camera = options.stage.person_view if who.kind == "person" else options.stage.robot_view
            body = [item.name for item in scene if item.name.split("/")[0] == who.name]
            names = [thing.name for thing in now.things]
            found = wv.visible_fractions(scene, camera, who.eyes, objects=names, exclude=body, object_poses=poses)
            sights = {s.thing: s.fraction for s in one.sights if (s.agent, s.time) == (who.name, 0)}
            expected = dict(zip(names, found.fraction.numpy()[0].tolist(), strict=True))
            assert sights == pytest.approx(expected, abs=6e-3)
            for question in one.questions:
                if question.kind == "sees" and question.about[0] == who.name and one.twin is None:
                    assert (expected[question.about[1]] >= 0.1) == (question.answer == "yes")
                    checked += 1
    assert checked


def test_shards_use_scenes_in_turns_and_are_deterministic():
    few = {**OPTIONS, "per_shard": 2}
    generator = SituationGenerator(SituationOptions(scenes=(path(), "procedural"), **few))
    first, second = generator.shard(0), generator.shard(1)
    assert {one.room["kind"] for one in first} == {"house.glb"}
    for number, found, scenes in ((0, first, (path(),)), (1, second, ("procedural",))):
        again = SituationGenerator(SituationOptions(scenes=scenes, **few)).shard(number)
        assert json.dumps([one.to_dict() for one in found]) == json.dumps([one.to_dict() for one in again])


def write(folder, name, parts):
    scene = wv.Scene()
    for number, part in enumerate(parts):
        scene.add(part, name=f"part_{number}")
    scene.export(folder / name)
    return str(folder / name)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([box((4, 4, 0.01), (0, 0, 0))], "must have a floor and furniture, got flat objects only"),
        ([box((0.005, 0.005, 1), (0, 0, 0))], "must have a floor, got a scene of 0.005 m x 0.005 m"),
        ([trimesh.creation.icosphere(radius=1)], "must have a floor with at least 1 m2 where a person can stand"),
        ([box((1.2, 1.2, 0.1), (0, 0, -0.05)), box((0.2, 0.2, 1), (0.5, 0.5, 0.5))], "must have a floor with at least"),
        (
            [box((4, 4, 0.1), (0, 0, -0.05)), box((0.3, 0.3, 0.2), (0, 0, 0.1))],
            "must have at least 4 free places for objects on supports 0.3 to 1.6 m above the floor, next to places "
            "where a person can stand, got 0",
        ),
    ],
)
def test_scenes_without_places_are_one_sentence(tmp_path, parts, message):
    file = write(tmp_path, "scene.glb", parts)
    with pytest.raises(SceneError, match=rf"^{re.escape(file)}: {re.escape(message)}"):
        SituationGenerator(SituationOptions(scenes=(file,))).shard(0)


def test_wrong_files_are_one_sentence(tmp_path):
    (tmp_path / "empty.glb").write_bytes(b"")
    (tmp_path / "text.glb").write_bytes(b"no glTF at all")
    for name, message in (("none.glb", "no such file"), ("", "is a folder"), ("empty.glb", ""), ("text.glb", "")):
        file = str(tmp_path / name) if name else str(tmp_path)
        with pytest.raises(WarpvisError, match=rf"^{re.escape(file)}: [^\n]*{message}"):
            SituationGenerator(SituationOptions(scenes=(file,))).shard(0)
    with pytest.raises(SceneError, match=r"^scenes must be one or more of"):
        SituationOptions(scenes=())
    with pytest.raises(FileFormatError, match=r"^scenes must be the name of a file"):
        SituationOptions(scenes=(3,))
