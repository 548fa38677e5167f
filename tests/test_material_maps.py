# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of materials apart from the base color: read from glTF, MTL and trimesh, with their texture coordinates."""

import io
import pickle
import warnings

import numpy as np
import pytest
import trimesh
from gltf_files import GltfWriter
from PIL import Image

import warpvis as wv
from warpvis.errors import SceneError
from warpvis.scene.materials import Appearance, Material, Texture

ROWS, FACES = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 1, 2], [1, 3, 2]]
UV = np.float32([[0, 0], [1, 0.25], [0, 2], [1, 1]])
MAPS = ("metallic_roughness_texture", "normal_texture", "occlusion_texture", "emissive_texture")


def png(value):
    file = io.BytesIO()
    Image.fromarray(np.full((2, 2, 3), value, np.uint8)).save(file, "PNG")
    return file.getvalue()


def load(path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return wv.Scene.load(path, **options)


def mapped(rough, **material):
    """Return a rectangle with two sets of texture coordinates and a material with textures 0 to 4."""
    writer = GltfWriter()
    made = writer.primitive(ROWS, FACES, material=0)
    made["attributes"]["TEXCOORD_0"] = writer.accessor(UV)
    made["attributes"]["TEXCOORD_1"] = writer.accessor(2 * UV)
    writer.node(made, name="r")
    views = [writer.view(png(50 * number)) for number in range(5)]
    writer.content["images"] = [{"bufferView": view, "mimeType": "image/png"} for view in views]
    writer.content["samplers"] = [{"wrapS": 33071}]
    writer.content["textures"] = [{"source": number, "sampler": 0} for number in range(5)]
    writer.content["materials"] = [{"name": "m", "pbrMetallicRoughness": rough, **material}]
    return writer


def upwards(uv):
    return np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1)


def test_gltf_maps_have_factors_and_coordinates(tmp_path):
    shifted = {"KHR_texture_transform": {"offset": [0.5, 0.25], "scale": [2, 2]}}
    writer = mapped(
        {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 1}, "roughnessFactor": 0.5},
        normalTexture={"index": 2, "scale": 0.75, "texCoord": 1},
        occlusionTexture={"index": 3, "strength": 0.25, "texCoord": 1},
        emissiveTexture={"index": 4, "extensions": shifted},
        emissiveFactor=[1, 0.5, 0],
    )
    (tmp_path / "a.glb").write_bytes(writer.bytes())
    (item,) = load(tmp_path / "a.glb", up="y")
    found = pickle.loads(pickle.dumps(item.appearance))
    (material,) = found.materials
    textures = [material.texture, *(getattr(material, name) for name in MAPS)]
    assert [texture.image[0, 0, 0] for texture in textures] == [0, 50, 100, 150, 200]
    assert [texture.color_space for texture in textures] == ["srgb", "linear", "linear", "linear", "srgb"]
    assert all(texture.wrap_u == "clamp" for texture in textures)
    assert (material.metallic, material.roughness, material.emission) == (1, 0.5, (1, 0.5, 0))
    assert (material.normal_scale, material.occlusion_strength) == (0.75, 0.25)
    assert set(found.map_uv) == {"normal_texture", "occlusion_texture", "emissive_texture"}
    faces = np.array(FACES)
    expected = {
        None: UV,
        "metallic_roughness_texture": UV,
        "normal_texture": 2 * UV,
        "occlusion_texture": 2 * UV,
        "emissive_texture": 2 * UV + (0.5, 0.25),
    }
    for name, uv in expected.items():
        np.testing.assert_allclose(found.corner_uv(faces, name), upwards(uv)[faces], atol=1e-6)


def test_gltf_map_without_base_color_texture(tmp_path):
    writer = mapped({}, normalTexture={"index": 2, "texCoord": 1})
    (tmp_path / "a.glb").write_bytes(writer.bytes())
    found = load(tmp_path / "a.glb", up="y")["r"].appearance
    assert found.materials[0].texture is None
    assert not found.map_uv
    np.testing.assert_allclose(found.uv, upwards(2 * UV), atol=1e-6)


def test_unreadable_map_keeps_the_other_textures(tmp_path):
    writer = mapped({"baseColorTexture": {"index": 0}}, normalTexture={"index": 99}, emissiveTexture={"index": 4})
    (tmp_path / "a.glb").write_bytes(writer.bytes())
    (item,) = load(tmp_path / "a.glb", strict=True)
    with pytest.warns(UserWarning, match=r"a\.glb: left out the normal_texture of material 'm' \(.*99 of 5"):
        material = item.appearance.materials[0]
    assert material.normal_texture is None
    assert material.texture is not None and material.emissive_texture is not None


def test_mirrored_mesh_keeps_map_coordinates_at_their_vertices(tmp_path):
    writer = mapped({"baseColorTexture": {"index": 0}}, normalTexture={"index": 2, "texCoord": 1})
    writer.content["nodes"][0]["scale"] = [-1, 1, 1]
    (tmp_path / "a.glb").write_bytes(writer.bytes())
    (item,) = load(tmp_path / "a.glb", up="y")
    corners = item.appearance.corner_uv(item.faces, "normal_texture")
    np.testing.assert_allclose(corners, upwards(2 * UV)[item.faces], atol=1e-6)
    given = Appearance(uv=UV[np.array(FACES)], map_uv={"normal_texture": 2 * UV[np.array(FACES)]})
    scene = wv.Scene()
    scene.add((np.array(ROWS), np.array(FACES)), name="a", scale=(1, 2, 1), appearance=given)
    np.testing.assert_array_equal(scene["a"].appearance.map_uv["normal_texture"], given.map_uv["normal_texture"])


def test_emission_is_multiplied_by_its_texture(tmp_path, device):
    for texture, light in (({}, 255), ({"emissiveTexture": {"index": 4}}, 200), ({"emissiveTexture": {"index": 0}}, 0)):
        writer = mapped({"baseColorFactor": [0, 0, 0, 1]}, emissiveFactor=[1, 1, 1], **texture)
        (tmp_path / "a.glb").write_bytes(writer.bytes())
        scene = load(tmp_path / "a.glb", up="y", device=device)
        pose = wv.look_at((0.5, 0.5, 3), (0.5, 0.5, 0), up="y")
        color = wv.render(scene, wv.Camera.from_fov(4, 3, hfov=0.1), pose, outputs=("color",)).color.numpy()
        assert (color == light).all()


def test_mtl_maps(tmp_path):
    (tmp_path / "a.obj").write_text("mtllib m.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    (tmp_path / "m.mtl").write_text("newmtl m\nKd 1 0 0\nnorm -bm 2 n.png\nmap_Ke e.png\n")
    (tmp_path / "n.png").write_bytes(png(128))
    (tmp_path / "e.png").write_bytes(png(60))
    material = load(tmp_path / "a.obj")["a"].appearance.materials[0]
    assert (material.normal_texture.image == 128).all() and material.normal_texture.color_space == "linear"
    assert (material.emissive_texture.image == 60).all() and material.emissive_texture.color_space == "srgb"
    assert material.emission == (1, 1, 1)


def test_trimesh_maps():
    images = {name: Image.fromarray(np.full((2, 2, 3), 30 * number, np.uint8)) for number, name in enumerate(MAPS)}
    keys = ("metallicRoughnessTexture", "normalTexture", "occlusionTexture", "emissiveTexture")
    look = trimesh.visual.material.PBRMaterial(**{key: images[name] for key, name in zip(keys, MAPS, strict=True)})
    mesh = trimesh.Trimesh(ROWS, FACES, process=False, visual=trimesh.visual.TextureVisuals(UV, material=look))
    scene = wv.Scene()
    scene.add(mesh, name="a")
    material = scene["a"].appearance.materials[0]
    assert [getattr(material, name).image[0, 0, 0] for name in MAPS] == [0, 30, 60, 90]
    assert [getattr(material, name).color_space for name in MAPS] == ["linear", "linear", "linear", "srgb"]


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Material(normal_texture="a.png"), "normal_texture of a material must be a Texture, got str"),
        (lambda: Material(occlusion_strength=2), "occlusion_strength of a material must be from 0 to 1, got 2"),
        (lambda: Material(normal_scale=np.nan), "normal_scale of a material must be"),
        (lambda: Appearance(map_uv={"texture": UV}), "map_uv must be arrays by any of metallic_roughness_texture"),
        (lambda: Appearance(map_uv=UV), "map_uv must be arrays by any of"),
        (lambda: Appearance(map_uv={"normal_texture": np.nan * UV}), r"map_uv\['normal_texture'\] must be finite"),
        (
            lambda: wv.Scene().add((ROWS, FACES), appearance=Appearance(map_uv={"normal_texture": UV[:3]})),
            r"map_uv\['normal_texture'\] of 'object_0' must be one for each of its 4 vertices, got 3",
        ),
    ],
)
def test_invalid_maps_are_rejected(make, said):
    with pytest.raises(SceneError, match=said):
        make()


def test_maps_are_part_of_a_dataset_hash():
    from warpvis.batch._manifest import _describe_colors

    hashes = set()
    for value in (None, 10, 20):
        scene = wv.Scene()
        texture = None if value is None else Texture(np.full((2, 2, 3), value, np.uint8))
        for scale in (1, 2):
            look = Appearance((Material(normal_texture=texture),), uv=UV, map_uv={"normal_texture": scale * UV})
            scene.add((ROWS, FACES), appearance=look)
            hashes.add(_describe_colors(scene)["appearances"]["sha256"])
    assert len(hashes) == 6
