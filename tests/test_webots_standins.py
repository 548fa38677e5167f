# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What stands in for PROTOs whose files are not at hand: people of capsules, furniture of boxes."""

import numpy as np
import pytest
import trimesh

from warpvis import Label
from warpvis.errors import FileFormatError, SceneError
from warpvis.webots import load_webots, recognise


def load(folder, text, version="R2023b", **options):
    path = folder / "world.wbt"
    path.write_text(f"#VRML_SIM {version} utf8\n{text}\n")
    return load_webots(path, **options)


@pytest.mark.parametrize(("version", "up"), [("R2023b", 2), ("R2021b", 1)])
def test_a_pedestrian_is_a_human_of_capsules(version, up, tmp_path):
    """As tall as Webots' own, with the soles on the ground, and wider than thick."""
    place = "3 0 1.27" if up == 2 else "3 1.27 0"
    with pytest.warns(UserWarning, match=r"capsules for people, stand in for Pedestrian \(1\)") as caught:
        world = load(tmp_path, f'Pedestrian {{ translation {place} name "Ada" }}', version)
    assert len(caught) == 1 and world.stand_ins == {"Pedestrian": 1} and not world.skipped
    person = world.scene["Ada"]
    assert person.label == Label.HUMAN and "Pedestrian: a stand-in" in world.tree
    low, high = person.bounds
    assert low[up] == pytest.approx(0, abs=0.02) and high[up] == pytest.approx(1.27 + 0.57, abs=0.02)
    across, along = (0, 1) if up == 2 else (2, 0)
    assert high[along] - low[along] == pytest.approx(0.66, abs=0.05)
    assert 0.25 < high[across] - low[across] < 0.4
    assert person.bounds.mean(axis=0)[along] == pytest.approx(3 if up == 1 else 0, abs=0.01)


def test_a_pedestrian_stands_on_the_ground_by_default(tmp_path):
    with pytest.warns(UserWarning, match="stand in for Pedestrian"):
        world = load(tmp_path, "Pedestrian { rotation 0 0 1 1.5708 }")
    assert world.scene["pedestrian"].bounds[0, 2] == pytest.approx(0, abs=0.02)
    assert world.scene["pedestrian"].bounds[1, 0] > 0.3  # it is turned: its arms are along x


def test_a_pedestrian_is_recognised(tmp_path):
    text = (
        'Robot { translation 0 0 1 children Camera { name "eye" recognition Recognition { } } } '
        "Pedestrian { translation 4 0 1.27 shirtColor 1 0 0 }"
    )
    with pytest.warns(UserWarning, match="stand in for Pedestrian"):
        (person,) = recognise(load(tmp_path, text), "eye")
    np.testing.assert_allclose(person.colors, [[1, 0, 0], [0.24, 0.25, 0.5]])


SIZES = {"Sofa": (1, 1.8, 0.8), "Fridge": (0.7, 0.7, 1.8), "Chair": (0.5, 0.5, 1), "Desk": (0.7, 1.2, 0.72)}


@pytest.mark.parametrize("kind", SIZES)
def test_furniture_is_a_box_on_its_origin(kind, tmp_path):
    with pytest.warns(UserWarning, match=rf"stand in for {kind} \(2\)"):
        world = load(tmp_path, f'{kind} {{ translation 1 2 0 }} DEF OTHER {kind} {{ translation 5 0 1 name "b" }}')
    size = np.array(SIZES[kind])
    low, high = world.scene["b"].bounds
    np.testing.assert_allclose(high - low, size, atol=1e-6)
    np.testing.assert_allclose((low + high) / 2, [5, 0, 1 + size[2] / 2], atol=1e-6)
    assert len(world.scene) == 2
    words = {"OfficeChair": "office chair", "PottedTree": "potted tree", "WoodenChair": "wooden chair"}
    assert {item.name for item in world.scene} == {words.get(kind, kind.lower()), "b"}
    with pytest.warns(UserWarning, match=rf"stand in for {kind} \(1\)"):
        old = load(tmp_path, f"{kind} {{ translation 1 0 2 }}", "R2021b")
    np.testing.assert_allclose(np.ptp(old.scene.bounds, axis=0), size[[1, 2, 0]], atol=1e-6)
    assert old.scene.bounds[0, 1] == pytest.approx(0)


def test_what_says_its_size_is_a_box_as_large(tmp_path):
    text = (
        'Crate { name "floor" translation 0 0 0 size 1 2 3 } Crate { name "air" translation 0 0 4 size 1 2 3 } '
        'Silo { name "silo" translation 9 0 0 radius 2 height 5 } Ghost { name "none" } Ghost { size 1 2 }'
    )
    with pytest.warns(UserWarning) as caught:
        world = load(tmp_path, text)
    assert world.stand_ins == {"Crate": 2, "Silo": 1} and world.skipped == {"Ghost": 2} and len(caught) == 1
    np.testing.assert_allclose(world.scene["floor"].bounds, [[-0.5, -1, 0], [0.5, 1, 3]], atol=1e-6)
    np.testing.assert_allclose(world.scene["air"].bounds, [[-0.5, -1, 2.5], [0.5, 1, 5.5]], atol=1e-6)
    np.testing.assert_allclose(world.scene["silo"].bounds, [[7, -2, 0], [11, 2, 5]], atol=1e-6)


def test_the_ground_and_what_is_hollow_are_no_boxes(tmp_path):
    box = "Solid { children Shape { geometry Box { size 1 1 1 } } }"
    text = box + "UnevenTerrain { size 50 50 5 } Pit { size 1 1 1 } SolidPipe { radius 1 height 1 }"
    with pytest.warns(UserWarning, match=r"left out UnevenTerrain \(1\), Pit \(1\), SolidPipe \(1\)"):
        world = load(tmp_path, text)
    assert len(world.scene) == 1 and not world.stand_ins


def test_geometry_that_says_its_size_is_a_box(tmp_path):
    text = 'Solid { name "it" children Shape { geometry TexturedBox { size 1 2 3 mapping "flat" } } }'
    with pytest.warns(UserWarning, match=r"stand in for TexturedBox \(1\)"):
        world = load(tmp_path, text)
    item = world.scene["it"]
    assert trimesh.Trimesh(item.vertices, item.faces).volume == pytest.approx(6)


def test_devices_in_the_slots_of_a_stand_in_are_known(tmp_path):
    slot = 'slot Solid { children Camera { name "eye" } }'
    with pytest.warns(UserWarning) as caught:
        world = load(tmp_path, f"Cart {{ translation 2 0 0 size 1 1 1 {slot} }}")
    assert "'eye' is taken to be at the origin of Cart" in str(caught[1].message)
    assert list(world.devices) == ["eye"] and len(world.scene) == 1


def test_strict_refuses_them(tmp_path):
    box = "Solid { children Shape { geometry Box { size 1 1 1 } } }"
    for text in ("Sofa { }", "Pedestrian { }", "Crate { size 1 1 1 }"):
        with pytest.raises(FileFormatError, match=r"left out \w+ \(1\)"):
            load(tmp_path, box + text, strict=True)


def test_webots_own_files_are_found_by_webots_home(tmp_path, monkeypatch):
    folder = tmp_path / "home" / "projects" / "objects" / "protos"
    folder.mkdir(parents=True)
    (folder / "Sofa.proto").write_text(
        '#VRML_SIM R2023b utf8\nPROTO Sofa [ ] {\nSolid { name "real" children Shape { geometry Mesh {\n'
        'url "webots://projects/objects/protos/a.obj" } } } }\n'
    )
    (folder / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    (tmp_path / "lab").mkdir()
    monkeypatch.setenv("WEBOTS_HOME", str(tmp_path / "home"))
    world = load(tmp_path / "lab", "Sofa { }", strict=True)
    assert len(world.scene["real"].faces) == 4
    monkeypatch.setenv("WEBOTS_HOME", str(tmp_path / "nowhere"))
    with pytest.raises((FileFormatError, SceneError), match="left out Sofa"):
        load(tmp_path / "lab", "Sofa { }", strict=True)
