# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of `Scene.load` for every kind of file: options, search paths, warnings and errors."""

import warnings

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import Label, Scene
from warpvis.errors import FileFormatError, SceneError

from support.recorded_warnings import recorded_warnings

BOX = "Solid { translation 0 0 3 name %s children [ Shape { geometry Box { size 1 2 4 } } ] }"


@pytest.fixture
def folder(tmp_path):
    """Write a GLB file of two boxes and a line, a glTF file with an external buffer, an STL file, and Webots worlds."""
    whole = trimesh.Scene()
    for name, x in (("ball", 0.0), ("wall", 3.0)):
        where = trimesh.transformations.translation_matrix([x, 0, 0])
        whole.add_geometry(trimesh.creation.box((1, 2, 4)), node_name=name, transform=where)
    files = trimesh.exchange.gltf.export_gltf(whole)
    (tmp_path / "buffers").mkdir()
    for name, data in files.items():
        (tmp_path / ("boxes.gltf" if name == "model.gltf" else f"buffers/{name}")).write_bytes(data)
    whole.add_geometry(trimesh.load_path(np.array([[[0, 0, 0], [1, 1, 1]]])), node_name="laser")
    whole.export(tmp_path / "boxes.glb")
    trimesh.creation.box((1, 2, 4)).export(tmp_path / "box.stl")
    (tmp_path / "box.wbt").write_text("#VRML_SIM R2023b utf8\n" + BOX % '"tall"')
    (tmp_path / "old.wbt").write_text("#VRML_SIM R2019a utf8\n" + BOX % '"tall"')
    (tmp_path / "unknown.wbt").write_text("#VRML_SIM R2023b utf8\nUnheardOf { }\n" + BOX % '"tall"')
    return tmp_path


def load(path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return Scene.load(path, **options)


def test_load_creates_one_scene(folder, monkeypatch):
    made = []
    initialize = Scene.__init__
    monkeypatch.setattr(Scene, "__init__", lambda self, **given: (made.append(given), initialize(self, **given))[1])
    scene = load(folder / "box.wbt")
    assert len(made) == 1 and [item.name for item in scene] == ["tall"]


@pytest.mark.parametrize(
    ("name", "up", "size", "middle"),
    [
        ("box.wbt", None, (1, 2, 4), (0, 0, 3)),
        ("box.wbt", "z", (1, 2, 4), (0, 0, 3)),
        ("box.wbt", "y", (1, 4, 2), (0, 3, 0)),
        ("old.wbt", None, (1, 2, 4), (0, 0, 3)),
        ("old.wbt", "y", (1, 2, 4), (0, 0, 3)),
        ("old.wbt", "z", (1, 4, 2), (0, -3, 0)),
    ],
)
def test_world_is_rotated_to_the_requested_up_axis(folder, name, up, size, middle):
    scene = load(folder / name, up=up)
    assert scene.up == (up or {"box.wbt": "z", "old.wbt": "y"}[name])
    np.testing.assert_allclose(np.ptp(scene.bounds, axis=0), size, atol=1e-6)
    np.testing.assert_allclose(scene.bounds.mean(axis=0), middle, atol=1e-6)


@pytest.mark.parametrize("name", ["box.wbt", "box.stl", "boxes.gltf"])
def test_labels_and_movable_reach_every_reader(folder, name):
    search_path = folder / "buffers" if name == "boxes.gltf" else ()
    still = load(folder / name, search_path=search_path)
    scene = load(folder / name, labels={"*": "human"}, movable=["*"], search_path=search_path)
    assert {item.label for item in scene} == {Label.HUMAN}
    assert scene.movable == tuple(range(len(scene))) and still.movable == ()
    for item in scene:
        assert item.pose.tolist() == [0, 0, 0, 0, 0, 0, 1]
        np.testing.assert_array_equal(item.vertices, still[item.name].vertices)


def test_movable_selects_objects_by_name(folder):
    scene = load(folder / "boxes.gltf", movable=["wall"], search_path=[folder / "buffers"])
    assert [scene.objects[index].name for index in scene.movable] == ["wall"]
    pose = wv.look_at((-3, 0, 0), (1, 0, 0))
    camera = wv.Camera.from_fov(8, 8, hfov=0.1)
    views = wv.render(scene, camera, pose, object_poses=[[-4.0, 0, 0, 0, 0, 0, 1]], outputs=("depth", "segmentation"))
    assert (views.segmentation.numpy() == scene.index("wall")).all()
    np.testing.assert_allclose(views.depth.numpy(), 1.5, rtol=1e-5)


def test_buffers_are_found_on_the_search_path(folder):
    with pytest.raises(FileFormatError, match=r"boxes.gltf: cannot be read as GLTF"):
        load(folder / "boxes.gltf")
    scene = load(folder / "boxes.gltf", search_path=folder / "buffers")
    assert {item.name for item in scene} == {"ball", "wall"}


def test_geometry_without_triangles_warns_or_raises(folder):
    with recorded_warnings("boxes.glb: left out 'laser', which hold lines or points") as caught:
        scene = Scene.load(folder / "boxes.glb")
    assert len(caught) == 1 and caught[0].filename == __file__
    assert {item.name for item in scene} == {"ball", "wall"}
    with pytest.raises(FileFormatError, match="left out 'laser'"):
        load(folder / "boxes.glb", strict=True)


def test_strict_applies_to_worlds(folder):
    with recorded_warnings("skipped UnheardOf") as caught:
        Scene.load(folder / "unknown.wbt")
    assert len(caught) == 1 and caught[0].filename == __file__
    with pytest.raises(FileFormatError, match="skipped UnheardOf"):
        load(folder / "unknown.wbt", strict=True)


def test_protos_are_found_on_the_search_path(folder):
    (folder / "protos").mkdir()
    text = "#VRML_SIM R2023b utf8\nPROTO UnheardOf [ ] { " + BOX % '"found"' + " }"
    (folder / "protos" / "UnheardOf.proto").write_text(text)
    for place in (folder / "protos", [str(folder), str(folder / "protos")]):
        scene = load(folder / "unknown.wbt", search_path=place, strict=True)
        assert "found" in [item.name for item in scene]


BAD = {
    "search_path": ("box.stl", {"search_path": "."}, SceneError, "geometry is in a single file; leave out search_path"),
    "no folder": ("box.wbt", {"search_path": ["nowhere"]}, FileFormatError, "nowhere: search_path must be folders"),
    "scale": ("box.wbt", {"scale": 0.1}, SceneError, "leave out scale and file_up"),
    "file_up": ("box.wbt", {"file_up": "y"}, SceneError, "leave out scale and file_up"),
    "up": ("box.stl", {"up": "x"}, wv.WarpvisError, 'up must be "z" or "y"'),
    "labels": ("box.stl", {"labels": {"cat": "human"}}, SceneError, "labels for 'cat' fit no object of .*'box'"),
    "movable": ("box.stl", {"movable": ["cat"]}, SceneError, "movable 'cat' matches no object of .*'box'"),
    "nothing moves": ("box.stl", {"movable": True}, SceneError, "it defines no moving objects; name those"),
    "numbers": ("box.stl", {"movable": [0]}, SceneError, "movable must be true, false, or names of objects"),
    "suffix": ("box.xyzw", {}, FileFormatError, "no such file"),
    "folder": ("buffers", {}, FileFormatError, "buffers: is a folder"),
    "no format": ("plain", {}, FileFormatError, "plain: a name without a suffix is not a scene format"),
    "format": (
        "box.docx",
        {},
        FileFormatError,
        r"box.docx: '.docx' is not a scene format; supported are wbt, xml, urdf, .*usd, .*sdf, .*, and .*glb",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_invalid_input_raises_one_line_message(folder, case):
    name, options, kind, message = BAD[case]
    (folder / "box.docx").write_text("no mesh")
    (folder / "plain").write_text("no mesh")
    with pytest.raises(kind, match=message) as caught:
        load(folder / name, **options)
    assert "\n" not in str(caught.value)
