# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of stand-ins for PROTOs without files: capsules for people, boxes for furniture, and Webots' cache."""

import hashlib
import os
import sys

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import Label
from warpvis.errors import FileFormatError, SceneError
from warpvis.webots import load_webots, recognize
from warpvis.webots.protos._standins import KNOWN

from support.recorded_warnings import recorded_warnings


def load(folder, text, version="R2023b", **options):
    path = folder / "world.wbt"
    path.write_text(f"#VRML_SIM {version} utf8\n{text}\n")
    return load_webots(path, **options)


@pytest.mark.parametrize(("version", "up"), [("R2023b", 2), ("R2021b", 1)])
def test_pedestrian_is_a_human_of_capsules(version, up, tmp_path):
    """As tall as Webots' pedestrian, with the soles on the ground, and wider than deep."""
    place = "3 0 1.27" if up == 2 else "3 1.27 0"
    with recorded_warnings(
        r"used stand-ins for Pedestrian \(1\), .*: boxes, cylinders, and capsules for people"
    ) as caught:
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


def test_pedestrian_stands_on_the_ground_by_default(tmp_path):
    with pytest.warns(UserWarning, match="used stand-ins for Pedestrian"):
        world = load(tmp_path, "Pedestrian { rotation 0 0 1 1.5708 }")
    assert world.scene["pedestrian"].bounds[0, 2] == pytest.approx(0, abs=0.02)
    assert world.scene["pedestrian"].bounds[1, 0] > 0.3  # rotated: the arms are along x


def test_pedestrian_is_recognized(tmp_path):
    text = (
        'Robot { translation 0 0 1 children Camera { name "eye" recognition Recognition { } } } '
        "Pedestrian { translation 4 0 1.27 shirtColor 1 0 0 }"
    )
    with pytest.warns(UserWarning, match="used stand-ins for Pedestrian"):
        (person,) = recognize(load(tmp_path, text), "eye")
    np.testing.assert_allclose(person.colors, [[1, 0, 0], [0.24, 0.25, 0.5]])


SIZES = {
    **{"Sofa": (1, 1.8, 0.795), "Fridge": (0.7, 0.7, 1.8), "Chair": (0.517, 0.5, 1), "Desk": (0.7, 1.2, 0.71)},
    **{
        "Bed": (2.12, 1.75, 1.25),
        "Toilet": (0.733, 0.58, 1.018),
        "Oven": (0.5, 0.44, 0.68),
        "PottedTree": (0.3, 0.3, 1.3),
    },
}


@pytest.mark.parametrize("kind", SIZES)
def test_furniture_stands_on_its_origin(kind, tmp_path):
    with pytest.warns(UserWarning, match=rf"used stand-ins for {kind} \(2\)"):
        world = load(tmp_path, f'{kind} {{ translation 1 2 0 }} DEF OTHER {kind} {{ translation 5 0 1 name "b" }}')
    low, high = world.scene["b"].bounds
    np.testing.assert_allclose(high - low, SIZES[kind], atol=1e-6)
    assert low[2] == pytest.approx(1, abs=0.011)
    np.testing.assert_allclose(((low + high) / 2)[:2], [5, 0], atol=0.07)
    words = {"PottedTree": "potted tree"}
    assert {item.name for item in world.scene} == {words.get(kind, kind.lower()), "b"}


@pytest.mark.parametrize("kind", sorted(KNOWN))
@pytest.mark.parametrize("version", ["R2023b", "R2021b"])
def test_stand_ins_have_equal_size_in_old_worlds(kind, version, tmp_path):
    """Height, length and width, in either axis convention."""
    with pytest.warns(UserWarning, match=rf"used stand-ins for {kind} \(1\)"):
        world = load(tmp_path, f"{kind} {{ translation 0 0 0 }}", version)
    up = 2 if version == "R2023b" else 1
    size = np.ptp(world.scene.bounds, axis=0)
    low, high = (
        (np.array([np.array(middle) + sign * np.array(side) / 2 for side, middle in KNOWN[kind].pieces]))
        for sign in (-1, 1)
    )
    box = high.max(axis=0) - low.min(axis=0)
    assert size[up] == pytest.approx(box[2], abs=1e-6)
    np.testing.assert_allclose(np.sort(size), np.sort(box), atol=1e-6)


def height_at(scene, x, y):
    down = wv.look_at((x, y, 5), (x, y, 0), up=(1, 0, 0))
    depth = wv.render(scene, wv.Camera.from_fov(1, 1, hfov=0.001), down, outputs="depth").depth.numpy()
    return 5 - float(depth[0, 0, 0])


def test_seats_are_in_front_of_their_backs(tmp_path):
    """The seat is at knee height; the back is behind it, at smaller x."""
    heights = {"Sofa": (0.45, 0.7), "Armchair": (0.45, 0.7), "Chair": (0.5, 1.0), "Toilet": (0.46, 1.018)}
    for kind, (seat, back) in heights.items():
        with pytest.warns(UserWarning, match="used stand-ins"):
            scene = load(tmp_path, f"{kind} {{ translation 0 0 0 }}").scene
        assert height_at(scene, 0.15, 0) == pytest.approx(seat, abs=1e-3), kind
        low = float(scene.bounds[0, 0])
        assert height_at(scene, low + 0.02, 0) == pytest.approx(back, abs=1e-3), kind


def test_furniture_has_the_default_position_of_webots(tmp_path):
    for kind, bottom in (("WashingMachine", 0.005), ("Can", -0.0011), ("Sofa", 0.0)):
        with pytest.warns(UserWarning, match="used stand-ins"):
            world = load(tmp_path, f"{kind} {{ }}")
        assert world.scene.bounds[0, 2] == pytest.approx(bottom, abs=1e-4), kind


def test_cars_and_small_robots_are_labeled_robots(tmp_path):
    """With or without a controller; before R2022a, a car's front points along z."""
    text = 'BmwX5Simple { translation 0 0 0.4 } E-puck { translation 9 0 0 controller "walk" sensors Camera { } }'
    with recorded_warnings() as caught:
        world = load(tmp_path, text)
    assert "used stand-ins for BmwX5Simple (1), E-puck (1)" in str(caught[0].message)
    assert "'camera' is assumed to be at the origin of E-puck" in str(caught[1].message)
    assert world.robots == {"vehicle": ("vehicle",), "e-puck": ("e-puck",)}
    assert {item.label for item in world.scene} == {Label.ROBOT}
    assert world.devices["camera"].robot == "e-puck"
    np.testing.assert_allclose(world.scene["vehicle"].bounds, [[-0.9, -0.9, 0.3], [3.6, 0.9, 1.9]], atol=1e-6)
    with pytest.warns(UserWarning, match="used stand-ins for BmwX5Simple"):
        old = load(tmp_path, "BmwX5Simple { translation 0 0.4 0 }", "R2021b")
    np.testing.assert_allclose(old.scene["vehicle"].bounds, [[-0.9, 0.3, -0.9], [0.9, 1.9, 3.6]], atol=1e-6)


def test_long_lists_of_missing_files_are_truncated(tmp_path):
    """World.skipped contains all."""
    box = "Solid { children Shape { geometry Box { size 1 1 1 } } }"
    with recorded_warnings(r"skipped Thing0 \(2\), .*Thing11 \(1\), and 8 others, whose files") as caught:
        world = load(tmp_path, box + " ".join(f"Thing{k} {{ }}" for k in [*range(20), 0]))
    assert len(world.skipped) == 20 and "Thing12" not in str(caught[0].message)


def test_unknown_nodes_with_a_size_are_boxes(tmp_path):
    text = (
        'Crate { name "floor" translation 0 0 0 size 1 2 3 } Crate { name "air" translation 0 0 4 size 1 2 3 } '
        'Silo { name "silo" translation 9 0 0 radius 2 height 5 } Ghost { name "none" } Ghost { size 1 2 }'
    )
    with recorded_warnings() as caught:
        world = load(tmp_path, text)
    assert world.stand_ins == {"Crate": 2, "Silo": 1} and world.skipped == {"Ghost": 2} and len(caught) == 1
    np.testing.assert_allclose(world.scene["floor"].bounds, [[-0.5, -1, 0], [0.5, 1, 3]], atol=1e-6)
    np.testing.assert_allclose(world.scene["air"].bounds, [[-0.5, -1, 2.5], [0.5, 1, 5.5]], atol=1e-6)
    silo = world.scene["silo"]
    np.testing.assert_allclose(silo.bounds, [[7, -2, 0], [11, 2, 5]], atol=1e-6)
    assert trimesh.Trimesh(silo.vertices, silo.faces).volume == pytest.approx(np.pi * 4 * 5, rel=0.01)  # a cylinder
    with pytest.warns(UserWarning, match="used stand-ins for Silo"):
        old = load(tmp_path, "Silo { translation 9 0 0 radius 2 height 5 }", "R2021b")
    np.testing.assert_allclose(old.scene.bounds, [[7, 0, -2], [11, 5, 2]], atol=1e-6)


def test_pallet_stack_has_the_given_height(tmp_path):
    text = 'WoodenPalletStack { } WoodenPalletStack { name "b" translation 5 0 0 palletNumber 3 palletSize 1 2 0.2 }'
    with pytest.warns(UserWarning, match=r"used stand-ins for WoodenPalletStack \(2\)"):
        world = load(tmp_path, text)
    sizes = [np.ptp(item.bounds, axis=0) for item in world.scene]
    np.testing.assert_allclose(sizes, [[1.2, 0.8, 1.12], [1, 2, 0.6]], atol=1e-6)
    assert world.scene.bounds[0, 2] == pytest.approx(0)


def test_terrain_and_hollow_objects_get_no_boxes(tmp_path):
    box = "Solid { children Shape { geometry Box { size 1 1 1 } } }"
    text = box + "UnevenTerrain { size 50 50 5 } Pit { size 1 1 1 } SolidPipe { radius 1 height 1 }"
    with pytest.warns(UserWarning, match=r"skipped UnevenTerrain \(1\), Pit \(1\), SolidPipe \(1\)"):
        world = load(tmp_path, text)
    assert len(world.scene) == 1 and not world.stand_ins


def test_unknown_geometry_with_a_size_is_a_box(tmp_path):
    text = 'Solid { name "it" children Shape { geometry TexturedBox { size 1 2 3 mapping "flat" } } }'
    with pytest.warns(UserWarning, match=r"used stand-ins for TexturedBox \(1\)"):
        world = load(tmp_path, text)
    item = world.scene["it"]
    assert trimesh.Trimesh(item.vertices, item.faces).volume == pytest.approx(6)


def test_devices_in_slots_of_a_stand_in_are_loaded(tmp_path):
    slot = 'slot Solid { children Camera { name "eye" } }'
    with recorded_warnings() as caught:
        world = load(tmp_path, f"Cart {{ translation 2 0 0 size 1 1 1 {slot} }}")
    assert "'eye' is assumed to be at the origin of Cart" in str(caught[1].message)
    assert list(world.devices) == ["eye"] and len(world.scene) == 1


def test_strict_rejects_stand_ins(tmp_path):
    box = "Solid { children Shape { geometry Box { size 1 1 1 } } }"
    for text in ("Sofa { }", "Pedestrian { }", "Crate { size 1 1 1 }"):
        with pytest.raises(FileFormatError, match=r"skipped \w+ \(1\)"):
            load(tmp_path, box + text, strict=True)


def test_webots_home_provides_proto_files(tmp_path, monkeypatch):
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
    with pytest.raises((FileFormatError, SceneError), match="skipped Sofa"):
        load(tmp_path / "lab", "Sofa { }", strict=True)


# ----------------------------------------------------------------------------------------------------- Webots' cache

RELEASE = "https://raw.githubusercontent.com/cyberbotics/webots/R2023b/"
MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
SOFA = """#VRML_SIM R2023b utf8
EXTERNPROTO "webots://projects/objects/feet/protos/Foot.proto"
EXTERNPROTO "../../legs/protos/Leg.proto"
PROTO Sofa [ ] {
  Solid { name "real" children [
    Shape { geometry Mesh { url "meshes/seat.obj" } } Foot { } Leg { }
  ] }
}
"""
PART = """#VRML_SIM R2023b utf8
PROTO %s [ ] { Solid { translation 0 0 %s children Shape { geometry Mesh { url "webots://projects/a.obj" } } } }
"""
CACHED = {
    "projects/objects/sofa/protos/Sofa.proto": SOFA,
    "projects/objects/sofa/protos/meshes/seat.obj": MESH,
    "projects/objects/feet/protos/Foot.proto": PART % ("Foot", -1),
    "projects/objects/legs/protos/Leg.proto": PART % ("Leg", -2),
    "projects/a.obj": MESH,
}


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """Create a Webots cache, in which files are named by the SHA-1 of their URLs."""
    folder = tmp_path / "assets"
    folder.mkdir()
    for url, text in CACHED.items():
        (folder / hashlib.sha1((RELEASE + url).encode()).hexdigest()).write_text(text)
    monkeypatch.setattr("warpvis.webots._world.webots_cache", lambda: folder)
    monkeypatch.delenv("WEBOTS_HOME", raising=False)
    (tmp_path / "lab").mkdir()
    return folder


@pytest.mark.parametrize("root", [RELEASE, "webots://"])
def test_downloaded_files_are_found(cache, root, tmp_path):
    """A PROTO, a mesh next to it, other PROTOs by relative path and in Webots' tree, with meshes."""
    text = f'EXTERNPROTO "{root}projects/objects/sofa/protos/Sofa.proto"\nSofa {{ }}'
    world = load(tmp_path / "lab", text, strict=True)
    assert len(world.scene) == 1 and not world.stand_ins
    assert len(world.scene["real"].faces) == 12
    np.testing.assert_allclose(world.scene.bounds, [[0, 0, -2], [1, 1, 1]], atol=1e-6)


def test_cache_serves_other_releases_for_urls_without_one(cache, tmp_path):
    text = 'Solid { children Shape { geometry Mesh { url "webots://projects/a.obj" } } }'
    assert len(load(tmp_path / "lab", text, "R2022b", strict=True).scene["solid"].faces) == 4
    named = text.replace("webots://", RELEASE.replace("R2023b", "R2022b"))
    with pytest.raises(SceneError, match="skipped Mesh"):
        load(tmp_path / "lab", named, "R2022b")


def test_warning_suggests_download_by_webots(tmp_path):
    """For releases that download files."""
    for version, said in (("R2023b", True), ("R2022a", False)):
        with pytest.raises(SceneError) as caught:
            load(tmp_path, "Spaceship { }", version)
        assert ("or open the world once in Webots, which downloads them" in str(caught.value)) == said


def test_search_path_precedes_the_cache(cache, tmp_path):
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "Sofa.proto").write_text(
        SOFA.split("EXTERN", maxsplit=1)[0] + 'PROTO Sofa [ ] { Solid { name "mine" children '
        "Shape { geometry Box { size 1 1 1 } } } }\n"
    )
    text = f'EXTERNPROTO "{RELEASE}projects/objects/sofa/protos/Sofa.proto"\nSofa {{ }}'
    assert "mine" in load(tmp_path / "lab", text, search_path=[tmp_path / "own"], strict=True).scene


def test_messages_name_the_url_of_a_download(cache, tmp_path):
    url = RELEASE + "projects/objects/sofa/protos/Sofa.proto"
    (cache / hashlib.sha1(url.encode()).hexdigest()).write_text(SOFA.replace("Solid {", "Solid ["))
    with pytest.warns(UserWarning, match=rf"ignored the file of Sofa: {url}:5: expected"):
        world = load(tmp_path / "lab", f'EXTERNPROTO "{url}"\nSofa {{ }}')
    assert world.stand_ins == {"Sofa": 1}


def check_cache(place, folder):
    """Check that a world finds a mesh in a cache folder, and that it finds none before the folder exists."""
    text = 'Solid { children Shape { geometry Mesh { url "webots://projects/a.obj" } } }'
    with pytest.raises(SceneError, match="skipped Mesh"):
        load(place, text, "R2022b")
    folder.mkdir(parents=True)
    (folder / hashlib.sha1((RELEASE + "projects/a.obj").encode()).hexdigest()).write_text(MESH)
    assert len(load(place, text, "R2022b", strict=True).scene["solid"].faces) == 4


def test_cache_location_by_system(tmp_path, monkeypatch):
    """According to Webots' user guide."""
    monkeypatch.delenv("WEBOTS_HOME", raising=False)
    places = {
        "linux": ({"XDG_CACHE_HOME": str(tmp_path / "x")}, "x/Cyberbotics/Webots/assets"),
        "darwin": ({"HOME": str(tmp_path)}, "Library/Caches/Cyberbotics/Webots/assets"),
    }
    if os.name == "nt":
        places = {"win32": ({"LOCALAPPDATA": str(tmp_path)}, "Cyberbotics/Webots/cache/assets")}
    for system, (variables, folder) in places.items():
        with monkeypatch.context() as patched:
            patched.setattr(sys, "platform", system)
            for name, value in variables.items():
                patched.setenv(name, value)
            check_cache(tmp_path, tmp_path / folder)
    with monkeypatch.context() as patched:
        patched.delenv("XDG_CACHE_HOME", raising=False)
        patched.setenv("HOME", str(tmp_path))
        patched.setattr(sys, "platform", "linux")
        if os.name != "nt":
            check_cache(tmp_path, tmp_path / ".cache/Cyberbotics/Webots/assets")


# ------------------------------------------------------------------------------------- files whose parts are missing

LACKING = """#VRML_SIM R2023b utf8
PROTO %s [ field SFVec3f translation 0 0 0 %s ] { Solid { translation IS translation %s } }
"""
LOST = 'Shape { geometry Mesh { url "meshes/lost.obj" } }'


def lacking(folder, kind, children, fields=""):
    (folder / f"{kind}.proto").write_text(LACKING % (kind, fields, f"children [ {children} ]"))


def test_backlash_joints_do_not_count_as_missing(tmp_path):
    """The robot's own file is preferred to its stand-in."""
    ball = "Shape { geometry Sphere { radius 9 } }"
    lacking(tmp_path, "Sofa", f"HingeJointWithBacklash {{ endPoint Solid {{ children {ball} }} }}")
    world = load(tmp_path, "Sofa { }")
    assert not world.stand_ins and world.scene.bounds[1, 2] == pytest.approx(9)


def test_furniture_without_meshes_has_a_stand_in(tmp_path):
    """Not the incomplete object."""
    lacking(tmp_path, "Sofa", f"Shape {{ geometry Sphere {{ radius 9 }} }} {LOST}")
    with recorded_warnings() as caught:
        world = load(tmp_path, "Sofa { translation 1 0 0 } Sofa { translation 4 0 0 }")
    assert len(caught) == 1 and not world.skipped and world.stand_ins == {"Sofa": 2}
    message = str(caught[0].message)
    assert "used stand-ins for Sofa (2)" in message
    assert f"ignored the file of Sofa: {tmp_path / 'Sofa.proto'}: its Mesh meshes/lost.obj not found" in message
    np.testing.assert_allclose(world.scene.bounds[1], [4.5, 0.9, 0.795], atol=1e-5)
    with pytest.raises(FileFormatError, match=r"skipped Mesh meshes/lost\.obj"):
        load(tmp_path, "Sofa { }", strict=True)


def test_pedestrian_without_meshes_is_a_human(tmp_path):
    lacking(tmp_path, "Pedestrian", f"Pose {{ children [ {LOST} {LOST} ] }}")
    with pytest.warns(UserWarning, match=r"its Mesh meshes/lost\.obj and 1 more not found"):
        world = load(tmp_path, "Pedestrian { translation 0 0 1.27 }")
    assert world.scene["pedestrian"].label == Label.HUMAN and world.stand_ins == {"Pedestrian": 1}


def test_builtin_types_precede_incomplete_files(tmp_path):
    lacking(tmp_path, "Wall", "WallBoard { }")
    with recorded_warnings(r"ignored the file of Wall: .*: its WallBoard not found") as caught:
        world = load(tmp_path, "Wall { size 0.2 3 2 }")
    assert len(caught) == 1 and not world.stand_ins and not world.skipped
    np.testing.assert_allclose(np.ptp(world.scene["wall"].bounds, axis=0), [0.2, 3, 2], atol=1e-6)


def test_size_box_replaces_only_fully_missing_objects(tmp_path):
    lacking(tmp_path, "Crate", LOST, "field SFVec3f size 1 1 1")
    lacking(tmp_path, "Cart", f"{LOST} Shape {{ geometry Box {{ size 1 1 1 }} }}", "field SFVec3f size 5 5 5")
    with pytest.warns(UserWarning, match=r"skipped Mesh meshes/lost\.obj \(1\).*used stand-ins for Crate \(1\)"):
        world = load(tmp_path, "Crate { translation 0 0 4 size 1 2 3 } Cart { translation 9 0 0 size 5 5 5 }")
    assert world.stand_ins == {"Crate": 1}
    sizes = sorted(np.ptp(item.bounds, axis=0).tolist() for item in world.scene)
    np.testing.assert_allclose(sizes, [[1, 1, 1], [1, 2, 3]], atol=1e-6)


def test_incomplete_file_with_a_camera_is_kept(tmp_path):
    """No stand-in contains the camera's pose."""
    for kind in ("E-puck", "Crate"):
        lacking(tmp_path, kind, f'{LOST} Camera {{ name "eye" }}', "field SFVec3f size 1 1 1")
        box = 'Solid { name "box" children Shape { geometry Box { size 1 1 1 } } }'
        with pytest.warns(UserWarning, match=r"skipped Mesh meshes/lost\.obj \(1\)"):
            world = load(tmp_path, f"{box} {kind} {{ translation 1 0 0 size 1 1 1 }}")
        assert list(world.devices) == ["eye"] and not world.stand_ins and not world.devices["eye"].notes
