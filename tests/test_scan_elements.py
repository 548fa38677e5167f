# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of the table of docs/scene_files/scans.md that `test_scans` does not cover."""

import json

import numpy as np
import pytest
import trimesh
from PIL import Image

from warpvis import Scene
from warpvis.errors import FileFormatError
from warpvis.io import read_parts

from support import scans


def categories(path):
    return [item.category for item in Scene.load(path)]


def faces_of(path):
    return {item.category: len(item.faces) for item in Scene.load(path)}


ALL = ["floor", "office chair", "lamp", ""]


def test_corners_of_three_objects_belong_to_the_first(tmp_path):
    path = scans.write_scannet(tmp_path)
    vertices, faces, *_ = scans.joined()
    segments = np.full(len(vertices), 20)
    segments[faces[0]] = [30, 10, 20]
    scans.write_json(
        tmp_path / "scene0000_00_vh_clean_2.0.010000.segs.json", {"segIndices": segments.tolist(), "sceneId": "x"}
    )
    loaded = read_parts(path)
    (lamp,) = [part for part in loaded.parts if part.category == "lamp"]
    np.testing.assert_allclose(lamp.mesh[0][lamp.mesh[1]][0], vertices[faces[0]], atol=1e-6)


def test_oriented_boxes_poses_and_depth_images_are_ignored(tmp_path):
    path = scans.write_scannet(tmp_path)
    expected = faces_of(path)
    groups = [{**group, "obb": {"centroid": "x"}, "dominantNormal": 3} for group in scans.GROUPS]
    scans.write_json(tmp_path / "scene0000_00.aggregation.json", {"segGroups": groups})
    scans.write_json(tmp_path / "pose" / "0.txt", "nothing")
    (tmp_path / "depth").mkdir()
    Image.new("I;16", (2, 2)).save(tmp_path / "depth" / "0.png")
    assert faces_of(path) == expected


def test_other_lines_of_a_house_are_ignored(tmp_path):
    path = scans.write_matterport(tmp_path)
    expected = faces_of(path)
    lines = scans.HOUSE.splitlines()
    invalid = [f"{line[0]} x y z" if line[0] in "HLR" else line for line in lines[1:]]
    scans.write_json(tmp_path / "house.house", "\n".join([lines[0], *invalid, "P x", "S x", "V x", "I x"]) + "\n")
    assert list(expected) == ALL and faces_of(path) == expected


def test_objects_of_hm3d_are_those_of_the_texel_at_the_center_of_a_triangle(tmp_path):
    """The corners of triangles are in the texels of other objects."""
    path = scans.write_hm3d(tmp_path)
    expected = faces_of(path)
    vertices, faces, _, of_faces = scans.joined()
    u = (of_faces[:, None] + 0.5) / 4 + np.array([-0.4, 0.2, 0.2])
    image = Image.fromarray(scans.COLORS[None].repeat(2, axis=0))
    mesh = trimesh.Trimesh(vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3), process=False)
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image)
    uv = np.stack([u.reshape(-1), np.full(u.size, 0.5)], axis=1)
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    mesh.export(path)
    assert faces_of(path) == expected


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_colors_of_corners_of_hm3d(tmp_path, space):
    path = scans.write_hm3d(tmp_path, textured=False)
    if space == "linear":
        _decode_colors(path)
    assert categories(path) == ["floor", "office chair", "lamp, standing", ""]


def _decode_colors(path):
    """Replace sRGB colors in a GLB by linear ones, as glTF specifies, with 16 bits."""
    data = path.read_bytes()
    length = int.from_bytes(data[12:16], "little")
    content, body = json.loads(data[20 : 20 + length]), bytearray(data[28 + length :])
    primitive = content["meshes"][0]["primitives"][0]
    accessor = content["accessors"][primitive["attributes"]["COLOR_0"]]
    assert accessor["componentType"] == 5121
    count = 4 if accessor["type"] == "VEC4" else 3
    view = content["bufferViews"][accessor["bufferView"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    colors = np.frombuffer(bytes(body[start : start + accessor["count"] * count]), np.uint8).reshape(-1, count) / 255
    colors = np.where(colors <= 0.04045, colors / 12.92, ((colors + 0.055) / 1.055) ** 2.4)
    body += b"\0" * (-len(body) % 4)
    added = np.round(colors * 65535).astype("<u2").tobytes()
    content["bufferViews"].append({"buffer": 0, "byteOffset": len(body), "byteLength": len(added)})
    accessor.update(bufferView=len(content["bufferViews"]) - 1, byteOffset=0, componentType=5123, normalized=True)
    for key in ("min", "max"):
        accessor.pop(key, None)
    body += added + b"\0" * (-len(added) % 4)
    content["buffers"][0]["byteLength"] = len(body)
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    chunks = [(text, b"JSON"), (bytes(body), b"BIN\0")]
    packed = b"".join(len(chunk).to_bytes(4, "little") + kind + chunk for chunk, kind in chunks)
    path.write_bytes(b"glTF" + (2).to_bytes(4, "little") + (12 + len(packed)).to_bytes(4, "little") + packed)


def test_sens_files_are_not_read(tmp_path):
    (tmp_path / "scene0000_00.sens").write_bytes(b"\4\0\0\0")
    with pytest.raises(FileFormatError, match=r"scene0000_00.sens: '.sens' is not a scene format"):
        Scene.load(tmp_path / "scene0000_00.sens")


def test_mesh_of_replica_with_ptex_has_no_colors(tmp_path):
    """Its textures are in the same folder, and the objects in another mesh."""
    _, triangles, _, _ = scans.joined()
    scans.write_replica(tmp_path / "habitat")
    path = scans.write_ply(tmp_path / "mesh.ply", faces=triangles[:, [0, 1, 2, 2]], colors=False)
    (tmp_path / "textures").mkdir()
    (tmp_path / "textures" / "0-color-ptex.hdr").write_bytes(b"x")
    (item,) = Scene.load(path)
    assert item.name == "mesh" and item.appearance is None
