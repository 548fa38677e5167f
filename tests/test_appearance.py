# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Appearance as data: from arguments and trimesh visuals, preserved by scene operations."""

import copy
import pickle
import warnings

import numpy as np
import pytest
import trimesh
from PIL import Image

import warpvis as wv
from warpvis.errors import SceneError
from warpvis.scene.materials import Appearance, Material, Texture

IMAGE = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
COLORS = np.arange(48, dtype=np.uint8).reshape(12, 4)


def box():
    return trimesh.creation.box()


def painted():
    mesh = box()
    mesh.visual.face_colors = COLORS
    return mesh


def added(mesh, name="box", **options):
    scene = wv.Scene()
    scene.add(mesh, name=name, **options)
    return scene


def test_object_without_appearance_has_none():
    assert added(box())["box"].appearance is None
    assert added((np.eye(3), np.array([[0, 1, 2]])))["box"].appearance is None


def test_appearance_from_color_material_or_appearance():
    for given, alpha, mode in (((1, 0.5, 0), 1.0, "opaque"), ([1.0, 0.5, 0.0, 0.25], 0.25, "blend")):
        (material,) = added(painted(), appearance=given)["box"].appearance.materials
        assert material.base_color == (1.0, 0.5, 0.0, alpha)
        assert (material.color_space, material.alpha_mode) == ("srgb", mode)
    steel = Material("steel", (0.5, 0.5, 0.5), metallic=1)
    assert added(box(), appearance=steel)["box"].appearance.materials == (steel,)
    whole = Appearance((steel, Material()), face_materials=[0] * 6 + [1] * 6, uv=np.full((12, 3, 2), -7.5))
    assert added(box(), appearance=whole)["box"].appearance is whole
    assert whole.face_materials.dtype == np.int32
    assert whole.uv.dtype == np.float32


def test_vertex_uv_is_converted_to_corner_uv():
    uv = np.random.default_rng(0).uniform(-3, 3, (8, 2)).astype(np.float32)
    faces = np.asarray(box().faces)
    np.testing.assert_array_equal(Appearance(uv=uv).corner_uv(faces), uv[faces])
    np.testing.assert_array_equal(Appearance(uv=uv[faces]).corner_uv(faces), uv[faces])


@pytest.mark.parametrize("movable", [False, True])
def test_trimesh_face_colors_are_read(movable):
    scene = added(painted(), movable=movable)
    scene.add_instances(painted(), np.tile([0.0, 0, 0, 0, 0, 0, 1], (3, 1)), names="copy", movable=movable)
    for same in (scene, pickle.loads(pickle.dumps(scene)), scene.to("cpu"), scene.isolated()):
        assert len(same) == 4
        for item in same:
            np.testing.assert_array_equal(item.appearance.face_colors, COLORS)


def test_trimesh_vertex_colors_are_read():
    mesh = box()
    mesh.visual.vertex_colors = COLORS[:8]
    np.testing.assert_array_equal(added(mesh)["box"].appearance.vertex_colors, COLORS[:8])


def test_trimesh_visual_is_read_lazily(monkeypatch):
    from warpvis.scene import appearances

    read = []
    monkeypatch.setattr(appearances, "_from_visual", lambda *arguments: read.append(arguments))
    scene = added(painted())
    wv.render(scene, wv.Camera.from_fov(8, 6, hfov=1.0), np.array([0.0, 0, 3, 1, 0, 0, 0]))
    assert not read
    assert scene["box"].appearance is None
    assert scene["box"].appearance is None
    assert len(read) == 1


def test_trimesh_pbr_material_is_linear():
    mesh = box()
    material = trimesh.visual.material.PBRMaterial(
        "tin", baseColorFactor=[255, 51, 0, 102], alphaMode="MASK", alphaCutoff=0.25, roughnessFactor=0.5
    )
    material.baseColorTexture = Image.fromarray(IMAGE)
    uv = np.linspace(-1, 2, 16).reshape(8, 2)
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    found = added(mesh)["box"].appearance
    (made,) = found.materials
    assert made.base_color == pytest.approx((1, 0.2, 0, 0.4))
    assert (made.name, made.color_space, made.alpha_mode, made.alpha_cutoff) == ("tin", "linear", "mask", 0.25)
    assert (made.metallic, made.roughness) == (1.0, 0.5)
    np.testing.assert_array_equal(made.texture.image, IMAGE)
    np.testing.assert_allclose(found.uv, uv, rtol=1e-6)


def test_trimesh_simple_material_is_srgb():
    mesh = box()
    material = trimesh.visual.material.SimpleMaterial(diffuse=[255, 51, 0, 255], specular=[51, 0, 0], glossiness=20)
    mesh.visual = trimesh.visual.TextureVisuals(material=material)
    (made,) = added(mesh)["box"].appearance.materials
    assert made.base_color == pytest.approx((1, 0.2, 0, 1))
    assert made.specular == pytest.approx((0.2, 0, 0))
    assert (made.color_space, made.shininess) == ("srgb", 20)


def test_trimesh_default_color_does_not_darken_a_texture():
    mesh = box()
    mesh.visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), image=Image.fromarray(IMAGE))
    (made,) = added(mesh)["box"].appearance.materials
    assert (made.base_color, made.specular) == ((1, 1, 1, 1), (0, 0, 0))
    np.testing.assert_array_equal(made.texture.image, IMAGE)


def test_trimesh_multi_material():
    mesh = box()
    two = [trimesh.visual.material.SimpleMaterial(diffuse=color) for color in ([255, 0, 0], [0, 0, 255])]
    rows = np.arange(12) % 2
    mesh.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.MultiMaterial(two), face_materials=rows
    )
    found = added(mesh)["box"].appearance
    assert [material.base_color[:3] for material in found.materials] == [(1, 0, 0), (0, 0, 1)]
    np.testing.assert_array_equal(found.face_materials, rows)


def test_mismatched_visual_is_ignored_with_a_warning():
    mesh = box()
    mesh.visual = trimesh.visual.TextureVisuals(uv=np.zeros((5, 2)))
    scene = added(mesh)
    with pytest.warns(UserWarning, match=r"the colors of 'box' are ignored: uv of 'box' must be one for each of its 8"):
        assert scene["box"].appearance is None


def test_appearance_after_deforming_or_replacing_a_mesh():
    red = Material(base_color=(1, 0, 0))
    look = Appearance((red, Material()), face_materials=np.arange(12) % 2)
    scene = added(box(), appearance=look, movable=True)
    scene.update_mesh("box", 2 * box().vertices)
    assert scene["box"].appearance is look
    scene.update_vertices("box", np.asarray(box().vertices))
    assert scene["box"].appearance is look
    scene = added(box(), appearance=look)
    scene.update_mesh("box", np.eye(3), np.array([[0, 1, 2]]))
    for _ in range(2000):  # must not build a chain of earlier appearances
        scene.update_mesh("box", np.eye(3), np.array([[0, 1, 2]]))
        scene.update_mesh("box", np.eye(3), np.array([[0, 2, 1]]))
    assert scene["box"].appearance.materials == (red,)
    assert scene["box"].appearance.face_materials is None


def test_attached_and_replaced_objects_keep_their_appearance():
    scene = added(painted(), movable=True)
    scene.add(painted(), name="hat", attach_to="box", appearance=(1, 0, 0))
    scene.replace_objects([*scene, *added(painted(), name="new", movable=True)])
    for same in (scene, pickle.loads(pickle.dumps(scene)), copy.deepcopy(scene), scene.to("cpu"), scene.isolated()):
        assert [item.appearance.materials[0].base_color[:3] for item in same] == [(1, 1, 1), (1, 0, 0), (1, 1, 1)]
        np.testing.assert_array_equal(same["new"].appearance.face_colors, COLORS)


def test_texture_file_is_decoded_lazily(tmp_path):
    path = tmp_path / "a.png"
    texture = Texture(path)
    Image.fromarray(IMAGE).save(path)
    np.testing.assert_array_equal(texture.image, IMAGE)
    assert texture.image is texture.image
    again = pickle.loads(pickle.dumps(texture))
    assert "_decoded" not in again.__dict__
    np.testing.assert_array_equal(again.image, IMAGE)
    np.testing.assert_array_equal(Texture(path.read_bytes()).image, IMAGE)


@pytest.mark.parametrize(
    ("mode", "shape"), [("L", (2, 4, 3)), ("LA", (2, 4, 4)), ("P", (2, 4, 3)), ("RGBA", (2, 4, 4)), ("I;16", (2, 4, 3))]
)
def test_image_modes_are_converted_to_rgb(tmp_path, mode, shape):
    source = Image.fromarray(np.full((2, 4), 0x8012, np.uint16)) if mode == "I;16" else Image.new(mode, (4, 2))
    source.save(tmp_path / "a.png")
    found = Texture(tmp_path / "a.png").image
    assert (found.shape, found.dtype) == (shape, np.uint8)
    assert mode != "I;16" or (found == 0x80).all()


def test_unreadable_image_is_white_with_a_warning(tmp_path):
    (tmp_path / "torn.png").write_bytes(b"\x89PNG\r\n\x1a\n torn")
    for texture, said in (
        (Texture(tmp_path / "torn.png"), r"torn\.png: cannot be read as an image"),
        (Texture(tmp_path / "none.png"), r"none\.png: cannot be read as an image \(no such file\); using white"),
        (Texture(b"", "wood"), r"wood: cannot be read as an image \(no such file\)"),
        (Texture(b"\0" * 99, "wood"), r"wood: cannot be read as an image \(no known format\)"),
        (Texture(tmp_path), "cannot be read as an image"),
    ):
        with pytest.warns(UserWarning, match=said):
            assert (texture.image == [[[255, 255, 255]]]).all()
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert texture.image.shape == (1, 1, 3)


BAD = {
    "appearance of 'box' must be an Appearance, a Material or three or four numbers": [
        "red",
        (1, 0),
        (2, 0, 0),
        (np.nan, 0, 0),
        (-1, 0, 0),
        [[1, 0, 0]],
        (True, False, True),
        object(),
        {},
    ],
    "face_materials of 'box' must be one for each of its 12 faces, got 3": [Appearance(face_materials=[0, 0, 0])],
    "uv of 'box' must be one for each of its 8 vertices, got 12": [Appearance(uv=np.zeros((12, 2)))],
    "uv of 'box' must be one for each of its 12 faces, got 8": [Appearance(uv=np.zeros((8, 3, 2)))],
    "vertex_colors of 'box' must be one for each of its 8 vertices, got 12": [Appearance(vertex_colors=COLORS)],
    "face_colors of 'box' must be one for each of its 12 faces, got 8": [Appearance(face_colors=COLORS[:8])],
}


@pytest.mark.parametrize(("said", "given"), [(said, given) for said, many in BAD.items() for given in many])
def test_invalid_appearance_raises_and_adds_nothing(said, given):
    scene = wv.Scene()
    with pytest.raises(SceneError, match=said):
        scene.add(box(), name="box", appearance=given)
    with pytest.raises(SceneError, match=said):
        scene.add_instances(box(), [[0.0, 0, 0, 0, 0, 0, 1]], names=["box"], appearance=given)
    assert len(scene) == 0


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Texture(np.zeros((2, 2))), "must be uint8 of shape"),
        (lambda: Texture(np.zeros((0, 2, 3), np.uint8)), "must be uint8 of shape"),
        (lambda: Texture(None), "must be an array of numbers"),
        (lambda: Texture(IMAGE, wrap_u="mirrored"), "wrap_u must be"),
        (lambda: Texture(IMAGE, filter="cubic"), "filter must be"),
        (lambda: Texture(IMAGE, color_space="hsv"), "color_space must be"),
        (lambda: Material("tin", base_color=(1, 1)), "base_color of material 'tin' must be three or four numbers"),
        (lambda: Material(base_color=1.0), "base_color of a material must be three or four numbers"),
        (lambda: Material(roughness=1.5), "roughness of a material must be from 0 to 1, got 1.5"),
        (lambda: Material(shininess=-1), "shininess of a material must be at least 0, got -1"),
        (lambda: Material(metallic="no"), "metallic of a material must be a finite number"),
        (lambda: Material(emission=(np.inf, 0, 0)), "emission of a material must be three numbers of at least 0"),
        (lambda: Material(alpha_mode="glass"), "alpha_mode must be"),
        (lambda: Material(double_sided="maybe"), "double_sided must be"),
        (lambda: Material(texture=IMAGE), "texture of a material must be a Texture, got ndarray"),
        (lambda: Material(texture_repeat=(1,)), "texture_repeat of a material must be two numbers"),
        (lambda: Appearance(()), "materials must be at least one Material"),
        (lambda: Appearance(7), "materials must be at least one Material"),
        (lambda: Appearance(face_materials=[0, 1]), "face_materials must be material indices from 0 to 0, got 0 to 1"),
        (lambda: Appearance(face_materials=[0.5]), "face_materials must be whole numbers"),
        (lambda: Appearance(uv=np.zeros((3, 3))), "uv must have shape"),
        (lambda: Appearance(uv=[[np.nan, 0]]), "uv must be finite: 1 are not, the first at 0"),
        (lambda: Appearance(uv="seam"), "uv must be an array of numbers"),
        (lambda: Appearance(vertex_colors=[[255, 0, 0]]), "vertex_colors must be uint8 or floats"),
        (lambda: Appearance(face_colors=[[255.0, 0, 0]]), "face_colors of floats must be from 0 to 1"),
    ],
)
def test_malformed_appearance_raises(make, said):
    with pytest.raises(SceneError, match=said):
        make()
