# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Appearances of Webots worlds that are PROTO nodes, with and without their files; light of their backgrounds."""

import pickle
import warnings

import numpy as np
import pytest
import reference_pbr
import trimesh
from PIL import Image
from reference_shading import to_linear

import warpvis as wv
from warpvis.scene.materials import linear_color

HEAD = "#VRML_SIM R2023b utf8\n"
CHROME = (
    HEAD
    + """PROTO Chrome [ field SFColor tint 1 1 1 field SFBool used TRUE field MFString url [ ] ]
{ PBRAppearance { baseColor IS tint metalness 0 baseColorMap ImageTexture { url IS url } } }"""
)
SHAPE = 'Solid { name "%s" children [ Shape { appearance %s geometry Box { } } ] }\n'
FACES = ("right", "left", "top", "bottom", "front", "back")


@pytest.fixture(autouse=True)
def no_webots(monkeypatch, tmp_path):
    """Hide an installation of Webots and its cache."""
    monkeypatch.delenv("WEBOTS_HOME", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def load(tmp_path, text, head=HEAD, **options):
    (tmp_path / "worlds").mkdir(exist_ok=True)
    (tmp_path / "worlds" / "a.wbt").write_text(head + "WorldInfo {}\n" + text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return wv.Scene.load(tmp_path / "worlds" / "a.wbt", **options)


def color_of(item):
    (material,) = item.appearance.materials
    assert material.color_space == "linear"
    return material.base_color[:3]


def test_appearance_protos_are_read_from_their_files(tmp_path):
    (tmp_path / "protos" / "textures").mkdir(parents=True)
    (tmp_path / "protos" / "Chrome.proto").write_text(CHROME)
    Image.fromarray(np.full((2, 2, 3), 51, np.uint8)).save(tmp_path / "protos" / "textures" / "a.png")
    textured = 'Chrome { tint 1 0.5 0 url [ "../protos/textures/a.png" ] }'
    scene = load(tmp_path, SHAPE % ("plain", "Chrome { tint 0.5 0.5 1 }") + SHAPE % ("textured", textured))
    scene = pickle.loads(pickle.dumps(scene))
    assert color_of(scene["plain"]) == pytest.approx((0.21404, 0.21404, 1), abs=1e-5)
    material = scene["textured"].appearance.materials[0]
    assert material.base_color[:3] == pytest.approx((1, 0.21404, 0), abs=1e-5)
    assert (material.texture.image == 51).all()
    assert scene["textured"].appearance.uv.shape == (12, 3, 2)


def test_appearance_files_are_read_lazily(tmp_path, monkeypatch):
    from warpvis.webots._walk import Reader

    (tmp_path / "protos").mkdir()
    (tmp_path / "protos" / "Chrome.proto").write_text(CHROME.replace("baseColor IS", "baseColor IS nothing baseColor"))
    calls, expand = [], Reader.expand_appearance
    monkeypatch.setattr(Reader, "expand_appearance", lambda self, node: calls.append(node.type) or expand(self, node))
    scene = load(tmp_path, SHAPE % ("a", "Chrome { }"), strict=True)  # an unreadable file does not affect depth
    assert not calls
    with pytest.warns(UserWarning, match=r"a\.wbt: used white for Chrome, whose file was not found"):
        assert scene["a"].appearance is None
    assert calls == ["Chrome"]


def test_appearances_without_files_have_stand_in_colors(tmp_path):
    text = SHAPE % ("grass", "Grass { colorOverride 0.5 1 1 }") + SHAPE % ("paint", "MattePaint { baseColor 1 0 0.5 }")
    text += SHAPE % ("floor", 'Parquetry { type "dark strip" }') + SHAPE % ("steel", "BrushedSteel { }")
    scene = load(tmp_path, text + SHAPE % ("other", "Nothing { }") + SHAPE % ("colored", "Nothing { color 1 0 0 }"))
    with pytest.warns(
        UserWarning, match=r"a\.wbt: used a stand-in color for Grass, whose file was not found"
    ) as caught:
        grass, paint, floor, steel, other, colored = (item.appearance for item in scene)
    assert len(caught) == 1
    assert grass.materials[0].base_color[:3] == pytest.approx(
        np.array(linear_color((0.28, 0.4, 0.17))) * linear_color((0.5, 1, 1)), abs=1e-6
    )
    assert paint.materials[0].base_color[:3] == pytest.approx((1, 0, 0.21404), abs=1e-5)
    assert sum(floor.materials[0].base_color[:3]) < 0.3
    assert (steel.materials[0].metallic, paint.materials[0].metallic) == (1, 0)
    assert other is None
    assert colored.materials[0].base_color[:3] == pytest.approx((1, 0, 0), abs=1e-6)


def test_appearances_without_textures_have_stand_in_colors(tmp_path):
    (tmp_path / "protos").mkdir()
    text = CHROME.replace("Chrome", "Grass").replace("url [ ]", 'url [ "missing.jpg" ]')
    (tmp_path / "protos" / "Grass.proto").write_text(text)
    scene = load(tmp_path, SHAPE % ("grass", "Grass { }"))
    with pytest.warns(UserWarning, match="used a stand-in color for Grass, whose texture was not found"):
        assert color_of(scene["grass"]) == pytest.approx(linear_color((0.28, 0.4, 0.17)), abs=1e-6)


def opaque(*color):
    """Return an opaque linear color, rounded."""
    return (*np.round(linear_color(color), 3), 1)


OBJECTS = """RectangleArena { floorAppearance Grass { } }
Table { translation 0 0 1 trayAppearance MattePaint { baseColor 0 0 1 } }
Wall { translation 1 0 0 appearance PBRAppearance { baseColor 1 0 0 metalness 0 } }
Window { translation 2 0 0 }
Fridge { translation 3 0 0 }
Desk { translation 4 0 0 color 0 1 0 }
Pedestrian { translation 5 0 1.27 shirtColor 1 0 0 }
PlasticCrate { name "crate" translation 6 0 0 size 1 1 1 color 0 0 1 }
"""


def test_objects_without_files_have_appearances(tmp_path):
    (tmp_path / "a.wbt").write_text(HEAD + "WorldInfo {}\n" + OBJECTS)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene = wv.Scene.load(tmp_path / "a.wbt")
        found = {item.name: item.appearance for item in scene}
    colors = {
        name: {tuple(np.round(material.base_color, 3)) for material in look.materials}
        for name, look in found.items()
        if look is not None
    }
    assert colors["rectangle arena floor"] == {opaque(0.28, 0.4, 0.17)}
    assert colors["rectangle arena"] == {opaque(0.78, 0.78, 0.79)}
    assert colors["table"] == {(0, 0, 1, 1), opaque(0.66, 0.44, 0.25)}
    assert colors["wall"] == {(1, 0, 0, 1)}
    assert (1, 1, 1, 1) in colors["window"] and any(color[3] < 1 for color in colors["window"])
    assert colors["fridge"] == {opaque(0.74, 0.72, 0.71)}
    assert colors["desk"] == {(0, 1, 0, 1)}
    assert (1, 0, 0, 1) in colors["pedestrian"] and len(colors["pedestrian"]) == 4
    assert colors["crate"] == {(0, 0, 1, 1)}


@pytest.mark.parametrize(("system", "direction"), [("ENU", (0.55, -0.6, -1)), ("NUE", (-0.6, -1, 0.55))])
def test_light_of_a_textured_background(tmp_path, system, direction):
    text = f'WorldInfo {{ coordinateSystem "{system}" }}\n'
    text += (
        "TexturedBackgroundLight { luminosity 2 castShadows FALSE } TexturedBackground { luminosity 3 }\n"
        + SHAPE % ("a", "PBRAppearance { metalness 0 }")
    )
    (tmp_path / "a.wbt").write_text(HEAD + text)
    scene = wv.Scene.load(tmp_path / "a.wbt")
    ambient, sun = scene.lights
    np.testing.assert_allclose(sun.direction, np.array(direction) / np.linalg.norm(direction), atol=1e-12)
    assert (sun.kind, sun.intensity, sun.color, sun.cast_shadow) == ("directional", 2 * 2.7, (1, 1, 1), False)
    expected = 3 * np.array(linear_color(scene.background.color))
    assert (ambient.kind, ambient.color_space) == ("ambient", "linear")
    np.testing.assert_allclose(ambient.ambient, expected, rtol=1e-6)
    assert scene.background.luminosity == 3


def test_backgrounds_without_direct_light(tmp_path):
    text = 'TexturedBackground { texture "factory" } TexturedBackgroundLight { texture "factory" }'
    scene = load(tmp_path, text + SHAPE % ("a", "PBRAppearance { }"))
    assert [light.kind for light in scene.lights] == ["ambient"]
    scene = load(
        tmp_path,
        "TexturedBackground { skybox FALSE reflections FALSE skyColor [ 0 0.5 1 ] }"
        + SHAPE % ("a", "PBRAppearance { }"),
    )
    assert scene.background.color == (0, 0.5, 1)
    np.testing.assert_allclose(scene.lights[0].ambient, linear_color((0, 0.5, 1)), rtol=1e-6)


@pytest.mark.parametrize(
    ("fields", "light"),
    [
        ('texture "factory"', (0.75, 0.75, 0.72)),
        ('texture "factory" skybox FALSE luminosity 2', (1.5, 1.5, 1.44)),
        ('texture "entrance_hall" skybox FALSE luminosity 0.5', (0.625, 0.525, 0.39)),
        ('texture "mountains" skybox FALSE', linear_color((0.58, 0.63, 0.68))),
        ('texture "noon_park_empty"', linear_color((0.58, 0.63, 0.68))),
        ('texture "dusk" skybox FALSE', linear_color((0.5, 0.44, 0.42))),
        ('texture "noon_sunny_empty" skybox FALSE skyColor [ 0 0 0.5 ]', linear_color((0, 0, 0.5))),
        ("skybox FALSE reflections FALSE skyColor [ 0 0 0.5 ]", linear_color((0, 0, 0.5))),
    ],
)
def test_light_of_a_background_without_images(tmp_path, fields, light):
    """Irradiance images light surfaces also without a sky; without reflections, the color of the sky does."""
    scene = load(tmp_path, f"TexturedBackground {{ {fields} }}" + SHAPE % ("a", "PBRAppearance { }"))
    (ambient,) = scene.lights
    np.testing.assert_allclose(ambient.ambient, light, rtol=1e-6)
    assert scene.background.has_sky == ("skybox" not in fields and "factory" not in fields)


@pytest.mark.parametrize(("system", "up"), [("ENU", (0, 0, 1)), ("NUE", (0, 1, 0))])
@pytest.mark.parametrize("texture", ["mountains", "mars", "noon_cloudy_empty"])
def test_sky_without_images_is_a_gradient(tmp_path, texture, system, up, device):
    text = f'WorldInfo {{ coordinateSystem "{system}" }} TexturedBackground {{ texture "{texture}" }}\n'
    (tmp_path / "a.wbt").write_text(HEAD + text + SHAPE % ("a", "PBRAppearance { }"))
    scene = wv.Scene.load(tmp_path / "a.wbt", device=device)
    camera, eye, found = wv.Camera.from_fov(3, 3, hfov=0.02), np.full(3, 9.0), []
    for sign in (1, -1):
        pose = wv.look_at(eye, eye + sign * np.array(up), up=np.roll(up, 1))
        found.append(wv.render(scene, camera, pose, outputs=("color",)).color.numpy()[0, 1, 1] / 255)
    np.testing.assert_allclose(found, [scene.background.gradient[0], scene.background.gradient[-1]], atol=0.01)


def test_images_of_a_textured_background(tmp_path, monkeypatch):
    folder = tmp_path / "webots" / "projects" / "default" / "worlds" / "textures" / "cubic"
    folder.mkdir(parents=True)
    for number, face in enumerate(FACES):
        Image.fromarray(np.full((64, 64, 3), 40 * number, np.uint8)).save(folder / f"dusk_{face}.jpg", quality=100)
    monkeypatch.setenv("WEBOTS_HOME", str(tmp_path / "webots"))
    scene = load(tmp_path, 'TexturedBackground { texture "dusk" luminosity 2 }' + SHAPE % ("a", "PBRAppearance { }"))
    assert [face.image[0, 0, 0] for face in scene.background.sky] == [40 * number for number in range(6)]
    expected = 2 * np.mean(linear_color(np.arange(6) * 40 / 255))
    np.testing.assert_allclose(scene.lights[0].ambient, [expected] * 3, rtol=1e-6)


def test_irradiance_images_are_the_ambient_light(tmp_path, monkeypatch):
    """TexturedBackground has them, unless its reflections are off, and a Background may have its own."""
    cv2 = pytest.importorskip("cv2")
    folder = tmp_path / "webots" / "projects" / "default" / "worlds" / "textures" / "cubic"
    folder.mkdir(parents=True)
    light = np.random.default_rng(0).uniform(0, 30, (6, 8, 8, 3)).astype(np.float32)
    for number, face in enumerate(FACES):
        Image.fromarray(np.full((16, 16, 3), 100, np.uint8)).save(folder / f"dusk_{face}.jpg", quality=100)
        cv2.imwrite(str(folder / f"dusk_{face}.hdr"), light[number][..., ::-1])
    monkeypatch.setenv("WEBOTS_HOME", str(tmp_path / "webots"))
    text = 'TexturedBackground { texture "dusk" luminosity 2 reflections %s }' + SHAPE % ("a", "PBRAppearance { }")
    ambient = load(tmp_path, text % "TRUE").lights[0].ambient
    np.testing.assert_allclose(ambient, 2 * light.mean(axis=(0, 1, 2)), rtol=0.01)  # of bytes with an exponent
    ambient = load(tmp_path, text % "FALSE").lights[0].ambient
    np.testing.assert_allclose(ambient, [2 * linear_color((100 / 255,))[0]] * 3, rtol=0.02)
    urls = " ".join(f'{face}IrradianceUrl [ "{(folder / f"dusk_{face}.hdr").as_posix()}" ]' for face in FACES)
    own = f"Background {{ skyColor [ 0 0 0.5 ] {urls} }}" + SHAPE % ("a", "PBRAppearance { }")
    scene = load(tmp_path, own)
    np.testing.assert_allclose(scene.lights[0].ambient, light.mean(axis=(0, 1, 2)), rtol=0.01)
    assert not scene.background.has_sky and scene.background.color == (0, 0, 0.5)
    (folder / "dusk_top.hdr").write_bytes(b"damaged")
    np.testing.assert_allclose(load(tmp_path, own).lights[0].ambient, linear_color((0, 0, 0.5)), atol=1e-6)


@pytest.mark.parametrize(
    ("looks", "ambient"),
    [
        (("PBRAppearance { }", "Grass { }", "Appearance { }"), 2 * 0.21404),
        (("PBRAppearance { }", "Appearance { }", "Appearance { }"), 0.5),
        (("PBRAppearance { }", "Appearance { }"), 0.5),
    ],
)
def test_ambient_light_is_that_of_most_materials(tmp_path, looks, ambient):
    """PBRAppearances reflect the background's light, Appearances the ambient light of the lights."""
    text = (
        "Background { skyColor [ 0.5 0.5 0.5 ] luminosity 2 }\nDirectionalLight { ambientIntensity 0.5 intensity 2 }\n"
    )
    scene = load(tmp_path, text + "".join(SHAPE % (f"s{number}", look) for number, look in enumerate(looks)))
    assert [light.kind for light in scene.lights] == ["ambient", "directional"]
    assert scene.lights[0].ambient == pytest.approx((ambient,) * 3, abs=1e-4)
    assert scene.lights[1].intensity == 2


def test_textured_background_lights_the_floor(tmp_path, device):
    text = 'TexturedBackground { texture "stadium" } TexturedBackgroundLight { texture "stadium" luminosity 0.2 }'
    floor = "Floor { size 10 10 appearance PBRAppearance { baseColor 0.5 0.6 0.7 metalness 0 roughness 1 } }"
    scene = load(tmp_path, text + floor, device=device)
    camera, pose = wv.Camera.from_fov(8, 6, hfov=0.5), wv.look_at((1, 1, 2), (0, 0, 0))
    views = wv.render(scene, camera, pose, outputs=("color", "points", "segmentation", "faces"))
    assert scene.lights[1].intensity == pytest.approx(0.2 * 2.9)
    assert scene.lights[0].ambient == pytest.approx(to_linear(np.array(scene.background.color)))
    expected = reference_pbr.shade_pbr_colors(scene, camera, pose, views)
    assert np.abs(views.color.numpy() - expected).max() <= 1


def test_maps_of_a_pbr_appearance_replace_its_numbers(tmp_path):
    (tmp_path / "worlds").mkdir()
    for name, value, size in (("r", 51, 4), ("m", 153, 2), ("n", 128, 2), ("o", 100, 2), ("e", 200, 2)):
        Image.fromarray(np.full((size, size, 3), value, np.uint8)).save(tmp_path / "worlds" / f"{name}.png")
    names = {"r": "roughnessMap", "m": "metalnessMap", "n": "normalMap", "o": "occlusionMap", "e": "emissiveColorMap"}
    maps = " ".join(f'{field} ImageTexture {{ url "{name}.png" }}' for name, field in names.items())
    numbers = "roughness 0.3 metalness 0.2 IBLStrength 2 normalMapFactor 0.5 occlusionMapStrength 0.25"
    numbers += " emissiveColor 1 0 0 emissiveIntensity 3"
    looks = (
        f"PBRAppearance {{ {numbers} {maps} }}",
        f"PBRAppearance {{ {numbers} }}",
        "Appearance { material Material { } }",
    )
    scene = load(tmp_path, "".join(SHAPE % (f"s{number}", look) for number, look in enumerate(looks)))
    mapped, plain, classic = (scene[f"s{number}"].appearance.materials[0] for number in range(3))
    assert (mapped.shading, plain.shading, classic.shading) == ("webots", "webots", "phong")
    assert mapped.tone_mapped and plain.tone_mapped and classic.tone_mapped
    packed = mapped.metallic_roughness_texture.image
    assert packed.shape == (4, 4, 3) and (packed == (255, 51, 153)).all()
    assert (mapped.roughness, mapped.metallic, mapped.emission) == (1, 1, (3, 3, 3))
    assert (plain.roughness, plain.metallic, plain.emission) == (0.3, 0.2, (3, 0, 0))
    assert (mapped.normal_scale, mapped.occlusion_strength, mapped.ambient_strength) == (0.5, 0.25, 2)
    assert [getattr(mapped, f"{name}_texture").image[0, 0, 0] for name in ("normal", "occlusion", "emissive")] == [
        128,
        100,
        200,
    ]
    assert mapped.emissive_texture.color_space == "linear"
    assert scene["s0"].appearance.uv.shape == (12, 3, 2)


BALL = trimesh.creation.icosphere(2, 0.5)


def ball_file(tmp_path):
    """Write a coarse ball with the normals of a sphere, and texture coordinates of its x and y."""
    (tmp_path / "worlds").mkdir()
    lines = [f"v {x} {y} {z}" for x, y, z in BALL.vertices] + [f"vn {x} {y} {z}" for x, y, z in 2 * BALL.vertices]
    lines += [f"vt {x + 0.5} {y + 0.5}" for x, y, _ in BALL.vertices]
    lines += ["f " + " ".join(f"{corner}/{corner}/{corner}" for corner in face) for face in BALL.faces + 1]
    (tmp_path / "worlds" / "ball.obj").write_text("\n".join(lines))
    Image.fromarray(np.full((2, 2, 3), 51, np.uint8)).save(tmp_path / "worlds" / "a.png")


@pytest.mark.parametrize("scale", [(1, 1, 1), (1, 2, 3), (-1, 1, 1)])
@pytest.mark.parametrize("ccw", ["TRUE", "FALSE"])
def test_mesh_files_have_normals_and_coordinates(tmp_path, scale, ccw):
    ball_file(tmp_path)
    text = """Solid { name "ball" children [ Transform { rotation 0 0 1 1.5707963267948966 scale %g %g %g children [
      Shape { appearance PBRAppearance { metalness 0 baseColorMap ImageTexture { url "a.png" } }
              geometry Mesh { url "ball.obj" ccw %s } } ] } Shape { geometry Box { size 0.1 0.1 0.1 } } ] }"""
    item = load(tmp_path, text % (*scale, ccw))["ball"]
    found, corners = item.appearance, item.vertices[item.faces].astype(np.float64)
    count = len(BALL.faces)
    turned = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    local = corners @ turned / scale  # in the frame of the mesh
    normals = local[:count] / scale @ turned.T
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    np.testing.assert_allclose(found.normals[:count], normals, atol=1e-5)
    flat = np.cross(corners[count:, 1] - corners[count:, 0], corners[count:, 2] - corners[count:, 0])
    flat /= np.linalg.norm(flat, axis=-1, keepdims=True)
    np.testing.assert_allclose(found.normals[count:], np.repeat(flat[:, None], 3, axis=1), atol=1e-5)
    np.testing.assert_allclose(found.uv[:count], local[:count, :, :2] + 0.5, atol=1e-5)


def test_invalid_normals_of_mesh_files_are_flat(tmp_path):
    (tmp_path / "worlds").mkdir()
    (tmp_path / "worlds" / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 0\nvn 1 0 0\nf 1//1 2//2 3//2\n")
    scene = load(tmp_path, 'Solid { name "a" children [ Shape { geometry Mesh { url "a.obj" } } ] }')
    np.testing.assert_allclose(scene["a"].appearance.normals, [[(0, 0, 1), (1, 0, 0), (1, 0, 0)]], atol=1e-6)


def test_mesh_files_without_attributes_have_no_appearance(tmp_path):
    (tmp_path / "worlds").mkdir()
    (tmp_path / "worlds" / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    scene = load(tmp_path, 'Solid { name "a" children [ Shape { geometry Mesh { url "a.obj" } } ] }')
    assert scene["a"].appearance is None
