# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Appearance from files: glTF, OBJ with MTL, PLY, COLLADA, MuJoCo and Webots."""

import gc
import sys
import tracemalloc
import zipfile
from importlib.util import find_spec

import mujoco
import numpy as np
import pytest
import trimesh
from gltf_files import GltfWriter
from PIL import Image

import warpvis as wv
from warpvis.scene.materials import Texture

from support.appearance_files import (
    FACES,
    IMAGE,
    KTX2,
    MTL,
    OBJ,
    QUARTERS,
    ROWS,
    UV,
    basis_textured,
    load,
    png,
    triangle,
)


def appearance(tmp_path, writer):
    (tmp_path / "a.glb").write_bytes(writer.bytes())
    return next(iter(load(tmp_path / "a.glb"))).appearance


def test_gltf_factors_and_texture(tmp_path):
    said = {"alphaMode": "MASK", "alphaCutoff": 0.75, "doubleSided": True, "emissiveFactor": [0, 0, 1]}
    more = {"extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 3}}}
    found = appearance(tmp_path, triangle({"index": 0}, **said, **more))
    (made,) = found.materials
    assert (made.name, made.base_color, made.color_space) == ("m", (1, 0.5, 0.25, 0.5), "linear")
    assert (made.alpha_mode, made.alpha_cutoff, made.double_sided) == ("mask", 0.75, True)
    assert (made.metallic, made.roughness, made.emission) == (1.0, 1.0, (0, 0, 3))
    assert (made.texture.wrap_u, made.texture.wrap_v, made.texture.filter) == ("clamp", "mirror", "nearest")
    np.testing.assert_array_equal(made.texture.image, IMAGE)
    np.testing.assert_array_equal(found.uv, np.stack([UV[:, 0], 1 - UV[:, 1]], axis=1))  # v points up


@pytest.mark.parametrize(("filter", "has_mipmaps"), [(9728, False), (9729, False), (9985, True), (9987, True)])
def test_gltf_samplers_choose_mip_maps(tmp_path, filter, has_mipmaps):
    writer = triangle({"index": 0})
    writer.content["samplers"][0]["minFilter"] = filter
    assert appearance(tmp_path, writer).materials[0].texture.mipmaps is has_mipmaps


def test_gltf_second_uv_set_and_texture_transform(tmp_path):
    second = np.array([[0, 0], [1, 0.2], [0, 1]])
    found = appearance(tmp_path, triangle({"index": 0, "texCoord": 1}))
    np.testing.assert_allclose(found.uv, second * [1, -1] + [0, 1], atol=1e-6)
    transform = {"offset": [0.5, 0.25], "rotation": np.pi / 2, "scale": [2, 4], "texCoord": 1}
    found = appearance(tmp_path, triangle({"index": 0, "extensions": {"KHR_texture_transform": transform}}))
    u, v = (second * [2, 4]).T
    np.testing.assert_allclose(found.uv, np.stack([v + 0.5, 1 - (-u + 0.25)], axis=1), atol=1e-6)


def test_gltf_image_in_a_separate_file(tmp_path):
    Image.fromarray(IMAGE).save(tmp_path / "my tex.png")
    texture = appearance(tmp_path, triangle({"index": 1})).materials[0].texture
    assert (texture.wrap_u, texture.filter) == ("repeat", "linear")
    np.testing.assert_array_equal(texture.image, IMAGE)


def test_gltf_image_in_an_archive(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("in/a.glb", triangle({"index": 1}).bytes())
        archive.writestr("in/my tex.png", png())
    (item,) = load(tmp_path / "a.zip")
    np.testing.assert_array_equal(item.appearance.materials[0].texture.image, IMAGE)


@pytest.mark.parametrize("place", ["my tex.png", "../my tex.png"])
def test_gltf_missing_image_is_white_with_a_warning(tmp_path, place):
    (tmp_path / "in").mkdir()
    Image.fromarray(IMAGE).save(tmp_path / "my tex.png")  # outside the file's folder, where nothing is read
    writer = triangle({"index": 1})
    writer.content["images"][1]["uri"] = place
    texture = appearance(tmp_path / "in", writer).materials[0].texture
    with pytest.warns(UserWarning, match=r"my tex\.png: cannot be read as an image \(no such file\); using white"):
        assert (texture.image == 255).all()


def test_gltf_vertex_colors(tmp_path):
    for rows, more in ((np.uint8([[255, 0, 51]] * 3), {"normalized": True}), (np.float32([[1, 0, 0.2]] * 3), {})):
        writer = GltfWriter()
        made = writer.primitive(ROWS, FACES)
        made["attributes"]["COLOR_0"] = writer.accessor(rows, **more)
        writer.node(made)
        found = appearance(tmp_path, writer)
        np.testing.assert_allclose(found.vertex_colors, [[1, 0, 0.2, 1]] * 3, atol=1e-7)
        assert found.materials[0].color_space == "linear"


def test_gltf_nodes_of_one_mesh_share_an_appearance(tmp_path):
    writer = triangle({"index": 0})
    writer.node(mesh=None)
    writer.content["nodes"][-1] = {"mesh": 0, "name": "mirrored", "scale": [-1, 1, 1]}
    (tmp_path / "a.glb").write_bytes(writer.bytes())
    one, other = load(tmp_path / "a.glb")
    assert one.appearance is other.appearance
    # In the flipped face, corners have the coordinates of their vertices.
    np.testing.assert_array_equal(
        other.appearance.corner_uv(other.faces)[0, ::-1], one.appearance.corner_uv(one.faces)[0]
    )


@pytest.mark.parametrize(
    "spoil",
    [
        lambda content: content["materials"][0].update(alphaMode="GLASS"),
        lambda content: content["materials"][0].update(emissiveFactor="blue"),
        lambda content: content["materials"][0]["pbrMetallicRoughness"].update(baseColorFactor=[1, 2]),
        lambda content: content["materials"][0]["pbrMetallicRoughness"].update(roughnessFactor=None),
        lambda content: content["materials"][0]["pbrMetallicRoughness"].update(baseColorTexture={"index": 9}),
        lambda content: content["materials"][0]["pbrMetallicRoughness"].update(baseColorTexture=[]),
        lambda content: content["meshes"][0]["primitives"][0].update(material=7),
        lambda content: content["meshes"][0]["primitives"][0]["attributes"].update(TEXCOORD_0=99),
        lambda content: content["images"].clear(),
        lambda content: content["images"][0].update(bufferView=99),
        lambda content: content["accessors"][2].update(count=2),
    ],
)
def test_gltf_damaged_material_keeps_the_triangles(tmp_path, spoil):
    writer = triangle({"index": 0})
    spoil(writer.content)
    (tmp_path / "a.glb").write_bytes(writer.bytes())
    (item,) = load(tmp_path / "a.glb", strict=True)
    assert len(item.faces) == 1
    with pytest.warns(UserWarning, match=r"a\.glb: left out the colors of mesh 0 \("):
        assert item.appearance is None


def test_gltf_materials_are_read_lazily(tmp_path, monkeypatch):
    from warpvis.io import _gltf_materials

    read = []
    monkeypatch.setattr(_gltf_materials, "_coordinates", lambda *arguments: read.append(arguments))
    (tmp_path / "a.glb").write_bytes(triangle({"index": 0}).bytes())
    (item,) = load(tmp_path / "a.glb")
    assert not read
    assert item.appearance.materials[0].texture is not None
    assert len(read) == 1


def test_gltf_without_textures_releases_the_file_data(tmp_path):
    writer = triangle()
    writer.content["materials"].append(dict(writer.content["materials"][0]))
    writer.view(bytes(20_000_000))
    (tmp_path / "a.glb").write_bytes(writer.bytes())
    load(tmp_path / "a.glb")  # imports modules
    gc.collect()
    tracemalloc.start()
    (item,) = load(tmp_path / "a.glb")
    gc.collect()
    stays, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert stays < 10_000_000 < peak
    assert item.appearance.materials[0].base_color == (1, 0.5, 0.25, 0.5)


def test_obj_faces_have_their_usemtl_materials(tmp_path):
    (tmp_path / "a.obj").write_text(OBJ)
    (tmp_path / "m.mtl").write_text(MTL)
    Image.fromarray(IMAGE).save(tmp_path / "my tex.png")
    scene = load(tmp_path / "a.obj")
    for item, bound, low, high in zip(scene, (3, 5, 5, 5, 5), "rbrrr", "brgbb", strict=True):
        found = item.appearance
        names = [found.materials[number].name[0] for number in found.face_materials]
        first = item.vertices[item.faces].min(axis=1)[:, 0] < bound
        if item.name != "mixed":  # its triangle uses vertex 5, which the polygon's last triangle does not
            assert names == [low if early else high for early in first], item.name
    assert [scene["mixed"].appearance.materials[n].name for n in scene["mixed"].appearance.face_materials] == [
        "red",
        "red",
        "red",
        "green",
    ]
    found = scene["triangles"].appearance
    corners = found.corner_uv(scene["triangles"].faces)
    places = scene["triangles"].vertices[scene["triangles"].faces][:, :, 0]
    # The same vertex has other coordinates in the next face.
    by_face = {
        1: {1: (0, 0), 2: (1, 0), 3: (0, 3)},
        2: {2: (0, 0), 3: (1, 0), 4: (0, 3)},
        3: {3: (0, 0), 4: (0, 0), 5: (1, 0)},
    }
    for row, uv in zip(places, corners, strict=True):
        wanted = by_face[int(row.min())]
        assert [tuple(pair) for pair in uv.tolist()] == [wanted[int(place)] for place in row]
    red, blue = found.materials
    assert (red.base_color, red.alpha_mode, red.shininess, red.specular) == (
        (1, 0, 0, 0.5),
        "blend",
        10,
        (0.1, 0.2, 0.3),
    )
    assert (blue.texture.wrap_u, blue.texture_repeat, blue.color_space) == ("clamp", (2, 3), "srgb")
    np.testing.assert_array_equal(blue.texture.image, IMAGE)


def test_invalid_mtl_values_use_defaults(tmp_path):
    invalid = b"Kd 9 nan -3\nd inf\nmap_Kd -s 1\n"
    (tmp_path / "m.mtl").write_bytes(MTL.encode() + b"\xff\0 Kd\nnewmtl\n" + invalid + b"newmtl invalid\n" + invalid)
    (tmp_path / "a.obj").write_text(
        "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\no a\nusemtl green\nf 1 2 3\no b\nusemtl invalid\nf 1 2 3\n"
    )
    (green,), (invalid,) = (item.appearance.materials for item in load(tmp_path / "a.obj"))
    assert (green.base_color, green.shininess) == ((1, 1, 1, 0.75), 0)
    assert invalid.base_color == (1, 1, 1, 1)


def test_obj_missing_mtl_warns_on_access(tmp_path):
    (tmp_path / "a.obj").write_text(OBJ)
    scene = load(tmp_path / "a.obj")
    with pytest.warns(
        UserWarning, match=r"a\.obj: no MTL file defines the material 'red', 'blue' \(m\.mtl: no such file\)"
    ):
        found = scene["triangles"].appearance
    assert [material.base_color for material in found.materials] == [(1, 1, 1, 1)] * 2


def test_ply_vertex_and_face_colors(tmp_path):
    for kind, count in (("vertex", 8), ("face", 12)):
        mesh = trimesh.creation.box()
        colors = np.arange(4 * count, dtype=np.uint8).reshape(count, 4)
        setattr(mesh.visual, f"{kind}_colors", colors)
        mesh.export(tmp_path / "a.ply")
        (item,) = load(tmp_path / "a.ply")
        np.testing.assert_array_equal(getattr(item.appearance, f"{kind}_colors"), colors)


def test_collada_base_color(tmp_path):
    pytest.importorskip("collada")
    mesh = trimesh.creation.box()
    mesh.visual = trimesh.visual.TextureVisuals(
        uv=np.zeros((8, 2)), material=trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 51, 0, 255])
    )
    (tmp_path / "a.dae").write_bytes(trimesh.exchange.dae.export_collada(mesh))
    (item,) = load(tmp_path / "a.dae")
    (made,) = item.appearance.materials
    assert made.color_space == "srgb"
    assert made.base_color == pytest.approx((1, 0.2, 0, 1), abs=1 / 255)


@pytest.mark.parametrize("torn", [False, True])
def test_collada_texture(tmp_path, torn):
    pytest.importorskip("collada")
    mesh = trimesh.creation.box()
    uv = np.linspace(0, 1, 16).reshape(8, 2)
    material = trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 51, 0, 255])
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    text = trimesh.exchange.dae.export_collada(mesh).decode()
    color = text[text.index("<diffuse>") : text.index("</diffuse>")]
    surface = '<newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>'
    surface += '<newparam sid="p"><sampler2D><source>s</source></sampler2D></newparam>'
    text = text.replace(color, '<diffuse><texture texture="p" texcoord="T"/>')
    text = text.replace("<profile_COMMON>", f"<profile_COMMON>{surface}", 1)
    images = '<library_images><image id="i"><init_from>my%20tex.png</init_from></image></library_images>'
    (tmp_path / "a.dae").write_text(text.replace("<library_effects>", f"{images}<library_effects>", 1))
    (tmp_path / "my tex.png").write_bytes(png()[: 45 if torn else None])
    (item,) = load(tmp_path / "a.dae")
    if torn:
        with pytest.warns(UserWarning, match="cannot be read as an image"):
            assert item.appearance.materials[0].texture.image.shape == (1, 1, 3)
        return
    found = item.appearance
    np.testing.assert_array_equal(found.materials[0].texture.image, IMAGE)
    assert found.corner_uv(item.faces).shape == (12, 3, 2)


MODEL = """<mujoco><asset>
<texture name="t" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 1 0" width="8" height="4"/>
<texture name="c" type="cube" builtin="flat" rgb1="1 0 0" rgb2="0 1 0" width="8" height="8"/>
<material name="m" texture="t" texrepeat="3 2" texuniform="true" rgba=".25 .5 .75 1" specular=".25" shininess=".5"/>
<material name="k" texture="c"/>
<mesh name="q" vertex="0 0 0 1 0 0 0 1 0 0 0 1" face="0 2 1 0 1 3 0 3 2 1 2 3" texcoord="0 0 1 0 0 .25 1 1"/></asset>
<worldbody><geom name="p" type="plane" size="1 1 1" material="m"/>
<geom name="b" type="box" size="1 1 1" material="k" rgba="1 0 0 .5"/><geom name="s" size=".1" rgba="0 0 1 1"/>
<geom name="c" size="1" material="k"/><geom name="q" type="mesh" mesh="q" material="m"/></worldbody></mujoco>"""


def test_mujoco_colors_materials_and_textures(tmp_path):
    (tmp_path / "a.xml").write_text(MODEL)
    model = mujoco.MjModel.from_xml_string(MODEL)
    for scene in (load(tmp_path / "a.xml"), wv.mujoco.scene_from_mujoco(model).scene):
        made = {item.name: item.appearance.materials[0] for item in scene}
        assert made["p"].base_color == (0.25, 0.5, 0.75, 1)  # from the material: the geom has none
        assert (made["p"].specular, made["p"].shininess) == ((0.25,) * 3, 64)
        assert made["p"].texture.image.shape == (4, 8, 3)
        assert made["p"].texture is made["q"].texture
        assert (made["b"].base_color, made["b"].alpha_mode, made["b"].projection) == ((1, 0, 0, 0.5), "blend", "cube")
        assert (made["c"].projection, made["c"].texture_uniform) == ("cube", False)
        assert made["b"].texture.image.shape == (48, 8, 3)
        assert (made["s"].base_color, made["s"].texture) == ((0, 0, 1, 1), None)
        assert (made["s"].specular, made["s"].shininess) == ((0.5,) * 3, 64)  # MuJoCo's default without a material
        assert made["q"].projection == "uv"
        found = scene["q"].appearance.corner_uv(scene["q"].faces)
        # 3 and 2 repeats per 2 m, v upwards; sizes are those of the mesh's box.
        size = model.geom_size[model.geom("q").id][:2]
        said = {(0, 0, 0): (0, 0), (1, 0, 0): (1, 0), (0, 1, 0): (0, 0.25), (0, 0, 1): (1, 1)}
        corners = scene["q"].vertices[scene["q"].faces]
        for place, uv in zip(np.rint(corners).astype(int).reshape(-1, 3), found.reshape(-1, 2), strict=True):
            u, v = said[tuple(place.tolist())]
            np.testing.assert_allclose(uv, [3 * size[0] * u, 1 - 2 * size[1] * v], atol=1e-6)


def test_export_writes_no_colors(tmp_path):
    scene = wv.Scene()
    scene.add(trimesh.creation.box(), appearance=(1, 0, 0))
    scene.export(tmp_path / "a.glb")
    (item,) = load(tmp_path / "a.glb")
    assert item.appearance is None


WORLD = """#VRML_SIM R2023b utf8
WorldInfo {}
Solid { name "two" children [
  Shape { appearance PBRAppearance { baseColor 1 0.5 0 transparency 0.25 metalness 0 roughness 0.5 }
          geometry Box { size 1 1 1 } }
  Shape { appearance DEF A Appearance { material Material { diffuseColor 0 0 1 specularColor 1 0 0 } }
          geometry Plane {} }
  Shape { geometry Plane {} } ] }
Solid { name "none" children [ Shape { appearance Unknown {} geometry Plane {} } ] }
Solid { name "bad" children [ Shape { appearance PBRAppearance { baseColor "red" } geometry Plane {} } ] }
"""


def test_webots_base_colors(tmp_path):
    (tmp_path / "a.wbt").write_text(WORLD)
    scene = wv.Scene.load(tmp_path / "a.wbt")
    found = scene["two"].appearance
    orange, blue, white = found.materials
    assert orange.base_color == pytest.approx((1, 0.21404, 0, 0.75), abs=1e-5)
    assert orange.alpha_mode == "blend"
    assert orange.color_space == blue.color_space == "linear"  # Webots multiplies linear values; the file has sRGB
    assert (orange.metallic, orange.roughness) == (0, 0.5)
    assert (blue.base_color, blue.specular, blue.shininess) == ((0, 0, 1, 1), (1, 0, 0), pytest.approx(25.6))
    assert white.base_color == (1, 1, 1, 1)
    planes = (len(found.face_materials) - 12) // 2
    assert found.face_materials.tolist() == [0] * 12 + [1] * planes + [2] * planes
    with pytest.warns(UserWarning, match="used white for Unknown, whose file was not found"):
        assert scene["none"].appearance is None
    assert scene["bad"].appearance is None


@pytest.mark.parametrize("mode", KTX2)
def test_gltf_ktx2_texture(tmp_path, mode):
    """ETC1S is lossy."""
    pytest.importorskip("opengl_basisu")
    texture = appearance(tmp_path, basis_textured(KTX2[mode])).materials[0].texture
    image = texture.image
    assert image.dtype == np.uint8 and image.shape == (8, 8, 3 if mode == "ETC1S" else 4)
    assert np.abs(image[..., :3].astype(int) - QUARTERS.repeat(4, 0).repeat(4, 1)).max() <= (
        3 if mode == "ETC1S" else 0
    )
    if mode == "UASTC":
        np.testing.assert_array_equal(image[..., 3], np.repeat([255, 64], 4)[:, None].repeat(8, 1))
    path = tmp_path / "a.ktx2"
    path.write_bytes(KTX2[mode])
    np.testing.assert_array_equal(Texture(path).image, image)


def test_ktx2_that_cannot_be_decoded_is_white(tmp_path, monkeypatch):
    cases = {
        "truncated KTX 2 file: 40 bytes": KTX2["UASTC"][:40],
        "vkFormat 37 holds no Basis": KTX2["UASTC"][:12] + (37).to_bytes(4, "little") + KTX2["UASTC"][16:],
    }
    if find_spec("opengl_basisu"):
        for reason, data in cases.items():
            with pytest.warns(UserWarning, match=f"bricks: cannot be read as an image .*{reason}"):
                assert (Texture(data, "bricks").image == 255).all()
    monkeypatch.setitem(sys.modules, "opengl_basisu", None)
    found = appearance(tmp_path, basis_textured(KTX2["ETC1S"]))
    wanted = r"bricks: cannot be read .*KTX2, and reading that needs opengl-basisu: pip install 'warpvis\[gltf\]'"
    with pytest.warns(UserWarning, match=wanted):
        assert found.materials[0].texture.image.shape == (1, 1, 3)
