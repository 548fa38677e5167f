# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Vertex normals of mesh files: read lazily, transformed with the mesh, replaced where they are invalid, shaded."""

import warnings

import numpy as np
import pytest
import reference_shading
import trimesh
from gltf_files import GltfWriter

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.scene.lights import Light
from warpvis.scene.materials import Appearance, Material

from support.gltf_rest import QUARTER, ROWS, SECOND, WHOLE, skinned

SUN = Light("directional", direction=(0.3, 0.5, -1.0), color=(0.8, 0.7, 0.9))
UPRIGHT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
CUBE = trimesh.creation.box((2, 2, 2))


def load(path, content=None, **options):
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return wv.Scene.load(path, **options)


def unit(rows):
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def ball(**node):
    """Return a coarse ball whose normals are those of a sphere, at a node."""
    mesh, writer = trimesh.creation.icosphere(2, 0.5), GltfWriter()
    made = writer.primitive(mesh.vertices, mesh.faces)
    made["attributes"]["NORMAL"] = writer.accessor(np.float32(unit(mesh.vertices)))
    writer.node(made, name="ball", **node)
    return mesh, writer


def frame_rotation(item):
    """Return the rotation from the frame of a static object's normals to the world."""
    return np.eye(3) if item.origin is None else poses_to_matrices(item.origin)[:3, :3]


def inverse_transpose(rows, linear):
    return unit(rows @ np.linalg.inv(linear))


@pytest.mark.parametrize(
    ("node", "linear"),
    [
        ({}, np.eye(3)),
        ({"rotation": [0.6, 0, 0, 0.8]}, poses_to_matrices(np.array([0, 0, 0, 0.6, 0, 0, 0.8]))[:3, :3]),
        ({"scale": [1, 2, 3]}, np.diag([1.0, 2, 3])),
        ({"scale": [-1, 1, 1]}, np.diag([-1.0, 1, 1])),
        (
            {"matrix": [1, 0.5, 0, 0, 0, 1, 0, 0, 0.3, 0, 2, 0, 4, 5, 6, 1]},
            np.array([[1, 0, 0.3], [0.5, 1, 0], [0, 0, 2]]),
        ),
    ],
)
def test_gltf_normals_follow_the_node(tmp_path, node, linear):
    mesh, writer = ball(**node)
    for up, upright in (("y", np.eye(3)), ("z", UPRIGHT)):
        (item,) = load(tmp_path / "a.glb", writer.bytes(), up=up)
        expected = inverse_transpose(unit(mesh.vertices), upright @ linear)
        np.testing.assert_allclose(item.appearance.normals, expected, atol=1e-6)
    (item,) = load(tmp_path / "a.glb", writer.bytes(), up="y", scale=2.0)
    np.testing.assert_allclose(item.appearance.normals, inverse_transpose(unit(mesh.vertices), linear), atol=1e-6)


def test_gltf_nodes_of_one_mesh_share_normals(tmp_path):
    mesh, writer = ball(translation=[5, 0, 0])
    for scale in ([1, 1, 1], [2, 2, 2], [1, 2, 3], [-1, -1, -1]):
        writer.content["nodes"].append({"mesh": 0, "name": str(scale), "scale": scale})
    scene = load(tmp_path / "a.glb", writer.bytes(), up="y")
    normals = [item.appearance.normals for item in scene]
    assert normals[0] is normals[1] is normals[2]
    np.testing.assert_allclose(normals[0], unit(mesh.vertices), atol=1e-6)
    stretched = inverse_transpose(unit(mesh.vertices), np.diag([1.0, 2, 3]))
    np.testing.assert_allclose(normals[3], stretched, atol=1e-6)
    mirrored = scene["[-1, -1, -1]"]
    np.testing.assert_allclose(normals[4] @ frame_rotation(mirrored).T, -unit(mesh.vertices), atol=1e-6)


@pytest.mark.parametrize("movable", [False, True])
def test_gltf_ball_is_shaded_as_a_sphere(tmp_path, device, movable):
    _, writer = ball(translation=[0.1, 0.2, -0.3], scale=[1.5, 1.5, 1.5])
    scene = load(tmp_path / "a.glb", writer.bytes(), device=device, movable=["ball"] if movable else False)
    scene.lights = (SUN,)
    pose = wv.look_at((2.2, -2.6, 1.8), (0.1, 0.3, 0.2))
    views = wv.render(scene, wv.Camera.from_fov(32, 24, hfov=0.5), pose, outputs=("color", "points", "segmentation"))
    seen, points = views.segmentation.numpy()[0] == 0, views.points.numpy()[0].astype(np.float64)
    assert seen.sum() > 100
    matrix, center = poses_to_matrices(pose), np.array([0.1, 0.3, 0.2])
    for y, x in np.argwhere(seen):
        view = points[y, x], unit(points[y, x] - center), matrix[:3, 3], matrix[:3, 2]
        expected = reference_shading.lit_color((SUN,), Material(color_space="linear"), *view) * 255
        assert np.abs(views.color.numpy()[0, y, x] - expected).max() <= 4  # interpolated normals deviate slightly


def test_gltf_without_normals_is_flat(tmp_path):
    writer = GltfWriter(materials=[{"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}}])
    writer.node(writer.primitive(CUBE.vertices, CUBE.faces, material=0))
    (item,) = load(tmp_path / "a.glb", writer.bytes())
    assert item.appearance.normals is None
    assert item.appearance.materials[0].base_color == (1, 0, 0, 1)


def test_gltf_skinned_and_morphed_normals(tmp_path):
    writer = skinned(SECOND, WHOLE)
    at = writer.content["meshes"][0]["primitives"][0]
    at["attributes"]["NORMAL"] = writer.accessor(np.float32([[1, 0, 0], [0, 1, 0], [0, 0, 1]]))
    moved = {"POSITION": writer.accessor(0 * ROWS), "NORMAL": writer.accessor(np.float32([[0, 0, 0.5]] * 3))}
    at["targets"] = [moved]
    writer.content["meshes"][0]["weights"] = [2.0]
    (item,) = load(tmp_path / "a.glb", writer.bytes(roots=[0, 2]), up="y")
    # The second joint is rotated by a quarter turn about z.
    expected = unit(np.array([[0, 1.0, 1], [-1, 0, 1], [0, 0, 2]]))
    np.testing.assert_allclose(item.appearance.normals, expected, atol=1e-6)
    assert QUARTER[2] > 0


def test_quantized_gltf_normals(tmp_path):
    mesh, writer = ball()
    rows = np.int8(np.round(127 * unit(mesh.vertices)))
    padded = writer.view(np.concatenate([rows, 0 * rows[:, :1]], axis=1).tobytes(), byteStride=4)
    number = writer.accessor(rows, padded, normalized=True)
    writer.content["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = number
    (item,) = load(tmp_path / "a.glb", writer.bytes(), up="y")
    np.testing.assert_allclose(item.appearance.normals, unit(mesh.vertices), atol=0.01)


def spoiled(rows, number):
    """Return rows with an invalid one; its other numbers are unchanged."""
    rows = rows.copy()
    rows[3] = (0, 0, 0) if number == 0 else (number, 1, 0)
    return rows


@pytest.mark.parametrize("number", [0, np.nan, np.inf])
def test_single_invalid_normals_become_face_normals(tmp_path, number):
    mesh, writer = ball(scale=[1, 2, 1])
    rows = writer.accessor(spoiled(np.float32(unit(mesh.vertices)), number))
    writer.content["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = rows
    writer.content["nodes"].append({**writer.content["nodes"][0], "scale": [-1, 2, 1]})
    one, mirrored = load(tmp_path / "a.glb", writer.bytes(), up="y")
    with pytest.warns(UserWarning, match=r"a\.glb: using face normals where vertex normals of mesh 0 .* 1 of 162"):
        normals = one.appearance.normals
    for item, linear in ((one, np.diag([1.0, 2, 1])), (mirrored, np.diag([-1.0, 2, 1]))):
        normals = item.appearance.normals  # no second warning
        turned = frame_rotation(item)
        bad = item.faces == 3
        a, b, c = np.moveaxis(item.vertices[item.faces].astype(np.float64), 1, 0)
        flat = unit(np.cross(b - a, c - a))
        np.testing.assert_allclose((normals @ turned.T)[bad], np.repeat(flat[:, None], 3, axis=1)[bad], atol=1e-5)
        expected = inverse_transpose(unit(mesh.vertices), linear)[item.faces]
        np.testing.assert_allclose((normals @ turned.T)[~bad], expected[~bad], atol=1e-5)


@pytest.mark.parametrize("spoil", ["count", "zero", "missing", "two"])
def test_invalid_gltf_normals_keep_the_color(tmp_path, spoil):
    writer = GltfWriter(materials=[{"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}}])
    made = writer.primitive(CUBE.vertices, CUBE.faces, material=0)
    rows = {"count": np.ones((3, 3)), "zero": np.zeros((8, 3)), "missing": np.ones((8, 3)), "two": np.ones((8, 2))}
    made["attributes"]["NORMAL"] = 99 if spoil == "missing" else writer.accessor(np.float32(rows[spoil]))
    for name in ("a", "b"):
        writer.node(dict(made), name=name)
    scene = load(tmp_path / "a.glb", writer.bytes(), strict=True)
    with pytest.warns(UserWarning, match="using face normals where vertex normals of mesh 0 are invalid") as caught:
        found = [item.appearance for item in scene]
    assert len(caught) == 1
    assert [item.normals for item in found] == [None, None]
    assert found[1].materials[0].base_color == (1, 0, 0, 1)


def obj(normals="vn 1 0 0\nvn 0 2 0\nvn 0 0 3\n", faces="f 1//1 2//1 3//2\nf 3//3 2//3 4//3\n"):
    return "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\n" + normals + "o a\n" + faces


@pytest.mark.parametrize(
    "faces", [None, "f 1/1/1 2/1/1 3/1/2\nf 3/1/3 2/1/3 4/1/3\n", "f 1//1 2//1 3//2\nf -2//-1 2//3 4//3\n"]
)
@pytest.mark.parametrize("material", [False, True])
def test_obj_normals_of_corners(tmp_path, faces, material):
    (tmp_path / "m.mtl").write_text("newmtl red\nKd 1 0 0\n")
    text = obj() if faces is None else obj(faces=faces)
    text = "mtllib m.mtl\n" + text.replace("o a\n", "o a\nusemtl red\n") if material else text
    (item,) = load(tmp_path / "a.obj", text)
    corners = item.appearance.corner_normals(item.faces)
    expected = np.array([[[1, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 1]] * 3], dtype=np.float64)
    np.testing.assert_allclose(corners, expected, atol=1e-6)
    assert item.appearance.materials[0].base_color == ((1, 0, 0, 1) if material else (1, 1, 1, 1))


@pytest.mark.parametrize(
    "text",
    [
        obj(normals="vn 0 0 0\nvn 0 0 0\nvn 0 0 0\n"),
        obj(normals="vn 1 0 0\n"),
        obj(faces="f 1//1 2//1 3//2\nf 3 2 4\n"),
        obj(normals="vn nan 0 0\nvn nan 0 0\nvn nan 0 0\n"),
    ],
)
def test_invalid_obj_normals_are_flat(tmp_path, text):
    (item,) = load(tmp_path / "a.obj", text)
    with pytest.warns(UserWarning, match=r"a\.obj: using face normals where vertex normals of 'a' are invalid"):
        found = item.appearance
    assert found is None or found.normals is None


def test_obj_without_normals_has_no_appearance(tmp_path):
    (item,) = load(tmp_path / "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1 2 3\n")
    assert item.appearance is None


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("quads", [False, True])
def test_ply_normals(tmp_path, kind, quads):
    rows, normals = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.float32([[0, 0, 2], [0, 1, 0]] * 2)
    faces = [[0, 1, 2, 3], [0, 1, 2]] if quads else [[0, 1, 2], [0, 2, 3]]
    head = f"ply\nformat {kind} 1.0\nelement vertex 4\n" + "".join(
        f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz")
    )
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    table = np.concatenate([rows, normals], axis=1)
    if kind == "ascii":
        lines = [" ".join(map(str, row)) for row in table.tolist()] + [" ".join(map(str, [len(f), *f])) for f in faces]
        body = "\n".join(lines).encode() + b"\n"
    else:
        order = "<" if kind == "binary_little_endian" else ">"
        body = table.astype(order + "f4").tobytes()
        body += b"".join(bytes([len(f)]) + np.array(f, order + "i4").tobytes() for f in faces)
    (item,) = load(tmp_path / "a.ply", head.encode() + body)
    np.testing.assert_allclose(item.appearance.normals, unit(normals), atol=1e-6)
    (tmp_path / "a.ply").write_bytes(head.encode() + body)
    (item,) = load(tmp_path / "a.ply", file_up="y")
    np.testing.assert_allclose(item.appearance.normals, unit(normals) @ UPRIGHT.T, atol=1e-6)


def test_collada_normals_follow_its_axis(tmp_path):
    pytest.importorskip("collada")
    mesh = trimesh.creation.icosphere(1, 0.5)
    text = trimesh.exchange.dae.export_collada(mesh).replace(b"<up_axis>Y_UP", b"<up_axis>X_UP")
    assert b"X_UP" in text
    (item,) = load(tmp_path / "a.dae", text, up="y")
    np.testing.assert_allclose(item.appearance.normals, unit(item.vertices), atol=0.02)


def test_normals_follow_the_scale_of_an_object():
    mesh = trimesh.creation.icosphere(2, 0.5)
    given = Appearance(normals=mesh.vertices)
    scene = wv.Scene()
    scene.add(mesh, name="stretched", scale=(1, 2, 3), appearance=given)
    scene.add(mesh, name="larger", scale=2, appearance=given)
    found = scene["stretched"].appearance.normals
    np.testing.assert_allclose(found, inverse_transpose(unit(mesh.vertices), np.diag([1.0, 2, 3])), atol=1e-6)
    assert scene["larger"].appearance is given


def test_changed_vertices_are_shaded_flat(device):
    mesh = trimesh.creation.icosphere(2, 0.5)
    look, plain = Appearance(normals=mesh.vertices), Appearance()
    camera, pose = wv.Camera.from_fov(16, 12, hfov=0.6), wv.look_at((2, -2, 1), (0, 0, 0))
    pictures = {}
    for name, appearance in (("smooth", look), ("flat", plain)):
        for change in ("none", "update_vertices", "update_mesh"):
            scene = wv.Scene(device=device)
            scene.add(mesh, name="ball", movable=change == "update_vertices", appearance=appearance)
            scene.lights = (SUN,)
            if change != "none":
                getattr(scene, change)("ball", np.float32(mesh.vertices))
            pictures[name, change] = wv.render(scene, camera, pose, outputs=("color",)).color.numpy()
    assert (pictures["smooth", "none"] != pictures["flat", "none"]).any()
    for change in ("update_vertices", "update_mesh"):
        np.testing.assert_array_equal(pictures["smooth", change], pictures["flat", change])


def test_normals_are_read_lazily(tmp_path, monkeypatch):
    from warpvis.io import _gltf

    read = []
    monkeypatch.setattr(_gltf, "_rest_normals", lambda *arguments: read.append(arguments))
    _, writer = ball()
    (item,) = load(tmp_path / "a.glb", writer.bytes())
    assert not read
    with pytest.warns(UserWarning, match="using face normals"):
        assert item.appearance is None
    assert len(read) == 1


def test_urdf_meshes_with_normals_only_stay_gray(tmp_path):
    (tmp_path / "a.obj").write_text(obj())
    text = (
        '<robot name="r"><link name="l"><visual><geometry><mesh filename="a.obj"/></geometry></visual></link></robot>'
    )
    (tmp_path / "r.urdf").write_text(text)
    (item,) = load(tmp_path / "r.urdf")
    assert item.appearance.materials[0].base_color == (0.5, 0.5, 0.5, 1.0)
