# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scans with objects: each row of the tables of docs/scene_files/scans.md, and invalid files."""

import json
import re

import numpy as np
import pytest
import trimesh
from plyfile import PlyData

from warpvis import Label, Scene
from warpvis.errors import FileFormatError, WarpvisError
from warpvis.io import read_parts
from warpvis.io.datasets._ply_mesh import read_ply_mesh

from support import scans
from support.scans import CHAIR, COLORS, DUST, FLOOR, LAMP

WRITERS = {
    "ScanNet": scans.write_scannet,
    "ScanNet without table": lambda folder: scans.write_scannet(folder, table=False),
    "ScanNet++": scans.write_scannetpp,
    "Replica": scans.write_replica,
    "Matterport3D": scans.write_matterport,
    "Matterport3D of Habitat": lambda folder: scans.write_matterport(folder, objects=True),
    "region of Matterport3D": scans.write_region,
    "HM3D": scans.write_hm3d,
    "HM3D, colors of vertices": lambda folder: scans.write_hm3d(folder, textured=False),
}


def triangles(vertices, faces):
    """Return triangles in a unique order, without those of no area that close quads."""
    corners = np.asarray(vertices, dtype=np.float64)[faces].round(5).reshape(-1, 9) + 0.0
    corners = corners[(corners[:, 3:6] != corners[:, 6:]).any(axis=1)]
    return corners[np.lexsort(corners.T)]


@pytest.mark.parametrize("name", WRITERS)
def test_objects_of_scans(tmp_path, name):
    path = WRITERS[name](tmp_path)
    scene = Scene.load(path)
    found = {item.category: item for item in scene}
    lamp = "lamp, standing" if "HM3D" in name else "lamp"
    assert list(found) == ["floor", "office chair", lamp, ""]
    for word, mesh, label in (
        ("floor", FLOOR, Label.GROUND),
        ("office chair", CHAIR, Label.OBSTACLE),
        (lamp, LAMP, Label.OBJECT),
        ("", DUST, Label.OBSTACLE),
    ):
        item = found[word]
        np.testing.assert_allclose(
            triangles(item.vertices, item.faces), triangles(mesh.vertices, mesh.faces), atol=2e-5
        )
        assert item.label == label and item.name == "unlabeled" if not word else word.replace(" ", "_") in item.name
    assert scene.up == "z"


@pytest.mark.parametrize("name", [name for name in WRITERS if "HM3D" not in name])
def test_colors_are_kept(tmp_path, name):
    for item, color in zip(Scene.load(WRITERS[name](tmp_path)), COLORS, strict=True):
        assert (item.appearance.vertex_colors == [*color, 255]).all()


def test_the_texture_of_objects_is_kept(tmp_path):
    for item, color in zip(Scene.load(scans.write_hm3d(tmp_path)), COLORS, strict=True):
        shown = item.appearance
        corners = shown.corner_uv(item.faces)
        column = np.floor(corners[..., 0] * 4).astype(int)
        assert (shown.materials[0].texture.image[0, column, :3] == color).all()


def test_labels_by_category_and_by_class_of_the_table(tmp_path):
    path = scans.write_scannet(tmp_path)
    scene = Scene.load(path, labels={"office*": "human", "lamp": "robot"})
    assert [item.label for item in scene] == [Label.GROUND, Label.HUMAN, Label.ROBOT, Label.OBSTACLE]
    table = scans.TABLE.replace("\tlamp\n", "\tfurniture\n")
    scans.write_json(tmp_path / "scannetv2-labels.combined.tsv", table)
    assert next(item for item in Scene.load(path) if item.category == "lamp").label == Label.OBSTACLE
    assert Scene.load(path, labels={"furniture": "human"})["lamp_2"].label == Label.HUMAN


def test_the_table_is_found_above_and_on_the_search_path(tmp_path):
    path = scans.write_scannet(tmp_path / "scans" / "scene0000_00", table=False)
    assert "nyu40class" not in read_parts(path).parts[1].extras
    scans.write_json(tmp_path / "tables" / "scannetv2-labels.combined.tsv", scans.TABLE)
    assert read_parts(path, search_path=[tmp_path / "tables"]).parts[1].extras["nyu40class"] == "chair"
    scans.write_json(tmp_path / "scannetv2-labels.combined.tsv", scans.TABLE)
    assert read_parts(path).parts[1].extras == {"objectId": 1, "id": 6, "nyu40class": "chair", "nyu40id": "5"}


def test_high_resolution_mesh_of_scannet(tmp_path):
    path = scans.write_scannet(tmp_path)
    full = path.with_name("scene0000_00_vh_clean.ply")
    path.rename(full)
    (tmp_path / "scene0000_00_vh_clean_2.0.010000.segs.json").rename(tmp_path / "scene0000_00_vh_clean.segs.json")
    (tmp_path / "scene0000_00.aggregation.json").rename(tmp_path / "scene0000_00_vh_clean.aggregation.json")
    assert [item.category for item in Scene.load(full)] == ["floor", "office chair", "lamp", ""]


@pytest.mark.parametrize("table", [False, True])
def test_labels_of_vertices(tmp_path, table):
    _, _, of_vertices, _ = scans.joined()
    labels = np.array([2, 5, 35, 0])[of_vertices]
    path = scans.write_ply(tmp_path / "scene0000_00_vh_clean_2.labels.ply", vertex={"label": ("u2", labels)})
    if table:
        text = scans.TABLE.replace("\tlamp\n", "\tlight\n")
        scans.write_json(tmp_path / "scannetv2-labels.combined.tsv", text)
    scene = Scene.load(path)
    assert [item.category for item in scene] == ["floor", "chair", "light" if table else "lamp", ""]
    assert [item.name for item in scene] == ["floor_2", "chair_5", f"{'light' if table else 'lamp'}_35", "unlabeled"]
    assert [len(item.faces) for item in scene] == [len(mesh.faces) for mesh in scans.MESHES]


def test_faces_between_objects_go_to_most_corners(tmp_path):
    path = scans.write_scannet(tmp_path)
    place = tmp_path / "scene0000_00_vh_clean_2.0.010000.segs.json"
    segments = np.full(len(scans.joined()[0]), 10)
    corner = scans.joined()[1][0, 0]
    segments[corner] = 20
    scans.write_json(place, {"segIndices": segments.tolist()})
    assert [item.category for item in Scene.load(path)] == ["floor"]


def test_a_segment_of_several_objects_belongs_to_the_last(tmp_path):
    path = scans.write_scannet(tmp_path)
    groups = [*scans.GROUPS, {"id": 8, "objectId": 9, "segments": [30], "label": "mirror"}]
    scans.write_json(tmp_path / "scene0000_00.aggregation.json", {"segGroups": groups})
    assert [item.name for item in Scene.load(path)] == ["floor_0", "office_chair_1", "mirror_9", "unlabeled"]


def test_scans_without_files_of_objects_are_meshes(tmp_path):
    path = scans.write_ply(tmp_path / "scene0000_00_vh_clean_2.ply")
    assert [item.name for item in Scene.load(path)] == ["scene0000_00_vh_clean_2"]


def test_metadata(tmp_path):
    def extras(path):
        return read_parts(path).parts[1].extras

    assert extras(scans.write_replica(tmp_path / "a")) == {"object_id": 4}
    assert extras(scans.write_matterport(tmp_path / "b")) == {"object_id": 1, "region_id": 0}
    assert extras(scans.write_hm3d(tmp_path / "c")) == {"instance_id": 2, "region_id": 1}
    part = read_parts(scans.write_matterport(tmp_path / "d")).parts[2]
    assert (part.category, part.aliases) == ("lamp", ("lighting",))


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("order", ["<", ">"])
def test_ply_with_all_properties(tmp_path, text, order):
    """Compare with plyfile and trimesh, also for faces with different numbers of corners."""
    _, faces, _, of_faces = scans.joined()
    polygons = [*faces[:10], faces[10][[0, 1, 2, 0]], *faces[11:]]
    path = scans.write_ply(
        tmp_path / "a.ply", faces=polygons, face={"object_id": ("i4", of_faces)}, text=text, order=order
    )
    mesh, expected = read_ply_mesh(path), PlyData.read(path)
    assert (mesh.face["object_id"] == expected["face"]["object_id"][mesh.polygons]).all()
    for axis, name in enumerate("xyz"):
        assert (mesh.shape.vertices[:, axis] == expected["vertex"][name]).all()
    assert mesh.face_count == len(polygons) and len(mesh.shape.faces) == len(polygons) + 1
    if text:  # trimesh requires binary faces to have equal numbers of corners
        loaded = trimesh.load(path, process=False)
        low, high = mesh.shape.vertices.min(axis=0), mesh.shape.vertices.max(axis=0)
        np.testing.assert_allclose(loaded.bounds, (low, high), atol=1e-6)


def broken(writer, name, change):
    def make(folder):
        path = writer(folder)
        place = next(folder.glob(name))
        place.write_text(change(place.read_text()))
        return path

    return make


def without(key):
    return lambda text: json.dumps({name: value for name, value in json.loads(text).items() if name != key})


def swap(before, after):
    return lambda text: text.replace(before, after)


INVALID = {
    "segments": (
        scans.write_scannet,
        "*.segs.json",
        without("segIndices"),
        "'segIndices' must be a list of whole numbers, got nothing",
    ),
    "number of segments": (
        scans.write_scannet,
        "*.segs.json",
        lambda text: '{"segIndices": [1, 2]}',
        r"segs.json: 'segIndices' must have a segment for each of the 66 vertices of .*_vh_clean_2.ply, got 2",
    ),
    "groups": (
        scans.write_scannet,
        "*.aggregation.json",
        without("segGroups"),
        "'segGroups' must be a list of objects, got nothing",
    ),
    "label": (
        scans.write_scannet,
        "*.aggregation.json",
        swap('"lamp"', "3"),
        r"'segGroups'\[2\]\['label'\] must be a text, got 3",
    ),
    "table": (
        scans.write_scannet,
        "*.tsv",
        swap("raw_category", "raw"),
        "must have the column 'raw_category', got id, raw, cat",
    ),
    "faces": (
        scans.write_region,
        "*.fsegs.json",
        lambda text: '{"segIndices": [1]}',
        r"must have a segment for each of the 116 faces of region0.ply, got 1",
    ),
    "objects": (
        scans.write_replica,
        "info*.json",
        without("objects"),
        "'objects' must be a list of objects, got nothing",
    ),
    "object id": (
        scans.write_replica,
        "info*.json",
        swap('"id": 3,', '"id": "3",'),
        r"'objects'\[0\]\['id'\] must be a whole number",
    ),
    "house": (
        scans.write_matterport,
        "*.house",
        swap("ASCII 1.1", "BINARY"),
        r"house.house:1: must begin with 'ASCII 1.1', got 'BINARY'",
    ),
    "house line": (
        scans.write_matterport,
        "*.house",
        swap("O 1 0 1", "O 1 x 1"),
        r"house.house:9: must be a line of a category, object",
    ),
    "header": (
        scans.write_hm3d,
        "*.txt",
        swap("HM3D", "MP3D"),
        r"semantic.txt:1: must begin with 'HM3D Semantic Annotations', got 'MP3D",
    ),
    "line": (
        scans.write_hm3d,
        "*.txt",
        swap("FA141E", "red"),
        r'semantic.txt:3: must be ID,RRGGBB,"category",region, got \'2,red',
    ),
}


@pytest.mark.parametrize("case", INVALID)
def test_invalid_files_of_objects(tmp_path, case):
    writer, name, change, message = INVALID[case]
    with pytest.raises(FileFormatError, match=message):
        Scene.load(broken(writer, name, change)(tmp_path))


HEADER = "ply\nformat ascii 1.0\n{}end_header\n"
VERTEX = "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
FACE = "element face 1\nproperty list uchar int vertex_indices\n"
INVALID_PLY = {
    "no header": ("hello", r"cannot be read as PLY: it must begin with a header"),
    "format": (HEADER.replace("ascii", "morse").format(VERTEX), r"its format must be one of ascii, binary_little"),
    "no faces": (HEADER.format(VERTEX) + "0 0 0", r"must have the elements vertex and face, got vertex"),
    "no z": (
        HEADER.format(VERTEX.replace(" z", " w") + FACE) + "0 0 0 3 0 0 0",
        r"vertices must have the properties x, y and z",
    ),
    "short": (HEADER.format(VERTEX.replace("1", "9", 1) + FACE) + "0 0 0", r"it ends before its 9 elements"),
    "corner": (HEADER.format(VERTEX + FACE) + "0 0 0 3 0 0 7", r"corners of faces must be vertices from 0 to 0, got 7"),
    "no corners": (
        HEADER.format(VERTEX + FACE.replace("vertex_", "v")) + "0 0 0 3 0 0 0",
        r"must have the property vertex_indices",
    ),
    "no object": (HEADER.format(VERTEX + FACE) + "0 0 0 3 0 0 0", r"faces must have the property object_id, got none"),
    "negative": (
        HEADER.format(VERTEX.replace("1", "-1", 1) + FACE),
        r"the number of elements 'vertex' must not be negative",
    ),
}


@pytest.mark.parametrize("case", INVALID_PLY)
def test_invalid_ply(tmp_path, case):
    content, message = INVALID_PLY[case]
    path = scans.write_replica(tmp_path)
    path.write_text(content)
    with pytest.raises(WarpvisError, match=message) as caught:
        Scene.load(path)
    assert re.match(rf"{re.escape(str(path))}: ", str(caught.value)) and "\n" not in str(caught.value)


def test_corners_that_are_no_vertices(tmp_path):
    path = scans.write_hm3d(tmp_path)
    content = path.read_bytes()
    first = scans.joined()[1][:2].astype("<u4").tobytes()
    assert first in content
    path.write_bytes(content.replace(first, b"\xff\xff\xff\x0f" + first[4:]))
    with pytest.raises(
        FileFormatError, match=r"semantic.glb: corners of .* must be vertices from 0 to 65, got 268435455"
    ):
        Scene.load(path)
