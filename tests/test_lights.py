# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lights and backgrounds read from MuJoCo, glTF and Webots, and compared with MuJoCo's pictures."""

import copy
import io
import pickle
import warnings

import mujoco
import numpy as np
import pytest
import trimesh
from gltf_files import GltfWriter
from PIL import Image
from reference_shading import to_linear, to_screen
from scipy.spatial.transform import Rotation

import warpvis as wv
from warpvis.errors import SceneError
from warpvis.scene.lights import Background, Light, cube_coordinates
from warpvis.scene.materials import Texture

from support.lights import MODEL, WORLD, lit_file, picture

FACES = tuple(Texture(np.full((4, 4, 3), 40 * number, np.uint8), f"face {number}") for number in range(6))


def load(path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return wv.Scene.load(path, **options)


def test_lights_without_position_have_constant_strength():
    points = np.random.default_rng(0).normal(size=(2, 5, 3))
    for kind in ("ambient", "directional", "headlight"):
        np.testing.assert_array_equal(Light(kind).strength(points), np.ones((2, 5)))


def test_point_lights_attenuate_with_distance():
    points = [[1.0, 2, 3], [1, 2, 5], [1, 2, 13.5]]
    light = Light("point", position=(1, 2, 3), attenuation=(1, 0.5, 0.25), reach=10)
    np.testing.assert_allclose(light.strength(points), [1, 1 / 3, 0])
    light = Light("point", position=(1, 2, 3), attenuation=(0, 0, 1), reach=4, falloff="gltf")
    np.testing.assert_allclose(light.strength(points), [np.inf, (1 - 0.5**4) / 4, 0])


@pytest.mark.parametrize(
    ("falloff", "wanted"),
    [
        ("opengl", [1, np.cos(0.3) ** 2, np.cos(0.6) ** 2, 0]),
        ("webots", [1, 1, 0.25, 0]),
        ("gltf", [1, 1, ((np.cos(0.6) - np.cos(0.7)) / (np.cos(0.3) - np.cos(0.7))) ** 2, 0]),
    ],
)
def test_spotlights_attenuate_off_axis(falloff, wanted):
    light = Light(
        "spot", direction=(0, 2, 0), falloff=falloff, inner_angle=0.3, outer_angle=0.7, exponent=2, position=(0, 0, 1)
    )
    assert light.direction == (0, 1, 0)
    points = [[3 * np.sin(angle), 3 * np.cos(angle), 1] for angle in (0, 0.3, 0.6, 0.8)]
    np.testing.assert_allclose(light.strength(points), wanted, atol=1e-9)


def test_copies_keep_lights_and_background():
    scene = wv.Scene()
    scene.add(trimesh.creation.box())
    assert scene.lights == ()
    assert scene.background is None
    scene.lights = [Light("point", "lamp"), Light()]
    scene.background = Background((1, 0, 0), sky=FACES)
    for same in (pickle.loads(pickle.dumps(scene)), copy.deepcopy(scene), scene.to("cpu"), scene.isolated()):
        assert [light.name for light in same.lights] == ["lamp", ""]
        assert same.background.color == (1, 0, 0)
        np.testing.assert_array_equal(same.background.image[::4, 0, 0], [0, 40, 80, 120, 160, 200])


def test_skies_of_unequal_images_are_ignored_with_warning(tmp_path):
    odd = (*FACES[:5], Texture(np.zeros((3, 3, 3), np.uint8), "odd"))
    with pytest.warns(UserWarning, match="the sky is ignored: images such as face 0 are not squares of equal size"):
        assert Background(sky=odd).image is None
    clear = (*FACES[:5], Texture(np.zeros((4, 4, 4), np.uint8)))
    assert Background(sky=clear).image.shape == (24, 4, 3)


def test_cube_coordinates_match_opengl():
    # Table of OpenGL 2.1, section 3.8.6.
    ways = [[2, 1, 0.5], [-2, 1, 0.5], [0.5, 2, 1], [0.5, -2, 1], [1, 0.5, 2], [1, 0.5, -2], [0, 0, 0]]
    images, places = cube_coordinates(ways)
    assert images.tolist() == [0, 1, 2, 3, 4, 5, 0]
    wanted = [[-0.5, -1], [0.5, -1], [0.5, 1], [0.5, -1], [1, -0.5], [-1, -0.5], [0, 0]]
    np.testing.assert_allclose(places, np.array(wanted) / [2, 2] / 2 + 0.5)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Light("laser"), "kind of a light must be"),
        (lambda: Light(name="sun", direction=(0, 0, 0)), "direction of light 'sun' must not be 0"),
        (lambda: Light(direction=(0, 1)), "direction of a light must be three finite numbers"),
        (lambda: Light(position=(0, np.nan, 0)), "position of a light must be three finite numbers"),
        (lambda: Light(position=(0, 0, 1e30)), "position of a light must be at most"),
        (lambda: Light(position="here"), "position of a light must be three finite numbers"),
        (lambda: Light(color=(-1, 0, 0)), "color of a light must be three numbers of at least 0"),
        (lambda: Light(specular=1), "specular of a light must be three numbers of at least 0"),
        (lambda: Light(intensity=-1), "intensity of a light must be"),
        (lambda: Light(attenuation=(0, 0, 0)), "attenuation of a light must not be 0"),
        (lambda: Light(reach=-1), "reach of a light must be"),
        (lambda: Light(reach="far"), "reach of a light must be"),
        (lambda: Light(inner_angle=1, outer_angle=0.5), "inner_angle of a light must be at most its outer_angle 0.5"),
        (lambda: Light(outer_angle=4), "outer_angle of a light must be"),
        (lambda: Light(falloff="none"), "falloff of a light must be"),
        (lambda: Light(color_space="hsv"), "color_space of a light must be"),
        (lambda: Light(cast_shadow="maybe"), "cast_shadow of a light must be"),
        (lambda: Light(shadow_plane=2), "shadow_plane of a light must be"),
        (lambda: Background((2, np.inf, 0)), "color of a background must be three numbers of at least 0"),
        (lambda: Background(sky=FACES[:5]), "sky of a background must be six Textures or none, got 5 items"),
        (lambda: Background(sky=FACES[0]), "sky of a background must be six Textures or none"),
        (lambda: Background(world_to_cube=((1, 0, 0),)), "world_to_cube of a background must have three rows"),
        (lambda: Background(world_to_cube=((1, 0),) * 3), "each row of world_to_cube of a background must be three"),
        (lambda: setattr(wv.Scene(), "lights", ["sun"]), "lights must be Lights, got str"),
        (lambda: setattr(wv.Scene(), "background", "blue"), "background must be a Background or None, got str"),
    ],
)
def test_invalid_lights_and_backgrounds_are_rejected(make, said):
    with pytest.raises(SceneError, match=said):
        make()


def test_mujoco_lights(tmp_path):
    (tmp_path / "a.xml").write_text(MODEL)
    model = mujoco.MjModel.from_xml_string(MODEL)
    for scene in (load(tmp_path / "a.xml"), wv.mujoco.scene_from_mujoco(model).scene):
        head, lamp, sun = scene.lights if scene.lights[1].name == "lamp" else (scene.lights[i] for i in (0, 2, 1))
        assert (head.kind, lamp.kind, sun.kind) == ("headlight", "spot", "directional")
        np.testing.assert_allclose(lamp.position, [0.5, 0, 1], atol=1e-6)
        np.testing.assert_allclose(lamp.direction, np.array([-1, 0, -2]) / np.sqrt(5), atol=1e-6)
        assert lamp.outer_angle == pytest.approx(np.radians(40))
        assert (lamp.exponent, lamp.cast_shadow, lamp.color_space) == (5, False, "srgb")
        np.testing.assert_allclose(lamp.attenuation, [1, 0.2, 0.1], atol=1e-6)
        assert scene.background.sky == ()
    dark = mujoco.MjModel.from_xml_string(
        '<mujoco><visual><headlight active="0"/></visual><worldbody><geom size="1"/></worldbody></mujoco>'
    )
    (light,) = wv.mujoco.scene_from_mujoco(dark).scene.lights
    assert (light.kind, light.ambient) == ("ambient", (0.3, 0.3, 0.3))


def shaded(scene, points, eye, forward):
    """Return the floor's colors by the formula of `Light`."""
    (material,) = scene["floor"].appearance.materials
    base, shine = np.array(material.base_color[:3]), np.array(material.specular)
    normal, total = np.array([0.0, 0, 1]), 0.0
    views = eye - points
    views /= np.linalg.norm(views, axis=-1, keepdims=True)
    for light in scene.lights:
        way = np.array(light.direction if light.kind == "directional" else forward)
        ways = np.broadcast_to(-way / np.linalg.norm(way), points.shape)
        if light.kind == "spot":
            ways = light.position - points
            ways = ways / np.linalg.norm(ways, axis=-1, keepdims=True)
        facing = (ways @ normal)[..., None]
        half = ways + views
        half = half / np.linalg.norm(half, axis=-1, keepdims=True)
        gloss = (facing > 0) * np.maximum(half @ normal, 0)[..., None] ** material.shininess
        specular = light.color if light.specular is None else light.specular
        share = light.ambient * base + np.maximum(facing, 0) * light.color * base + gloss * specular * shine
        total = total + light.intensity * light.strength(points)[..., None] * share
    return np.minimum(total, 1)


@pytest.mark.gl
def test_mujoco_picture_matches_light_formula():
    model = mujoco.MjModel.from_xml_string(MODEL)
    scene = wv.mujoco.scene_from_mujoco(model).scene
    eye, forward = np.array([0.3, -1.5, 1.8]), np.array([0.0, 1.5, -1.6])
    image, rays = picture(model, eye, forward)
    points = eye - rays * (eye[2] / rays[..., 2:])
    inside = np.abs(points[..., :2]).max(axis=-1) < 1.9
    wanted = shaded(scene, points, eye, forward)
    error = np.abs(image - wanted).max(axis=-1)[inside]
    assert wanted[inside].max() - wanted[inside].min() > 0.4
    assert np.median(error) < 1 / 255
    assert np.quantile(error, 0.95) < 1 / 255  # MuJoCo interpolates vertex colors, and the edge of the cone is jagged


@pytest.mark.slow
@pytest.mark.gl
def test_mujoco_picture_matches_sky():
    xml = """<mujoco><asset><texture name="sky" type="skybox" builtin="flat" width="16" height="16"/></asset>
    <worldbody><geom size=".001" pos="0 0 -90"/></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    sky = np.random.default_rng(1).integers(0, 255, (6, 2, 2, 3), dtype=np.uint8).repeat(8, 1).repeat(8, 2)
    model.tex_data[:] = sky.reshape(-1)
    background = wv.mujoco.scene_from_mujoco(model).scene.background
    np.testing.assert_array_equal(background.image, sky.reshape(96, 16, 3))
    for forward in np.random.default_rng(0).normal(size=(6, 3)):
        image, rays = picture(model, np.zeros(3), forward)
        number, place = cube_coordinates(rays @ np.array(background.world_to_cube).T)
        row, column = np.minimum(place * 16, 15).astype(int)[..., ::-1].transpose(2, 0, 1)
        inside = (np.abs(place * 2 % 1 - 0.5) < 0.4).all(axis=-1)  # colors are interpolated at texel borders
        np.testing.assert_allclose(image[inside], sky[number[inside], row[inside], column[inside]] / 255, atol=2 / 255)


def test_gltf_lights(tmp_path):
    (tmp_path / "a.glb").write_bytes(lit_file())
    with pytest.warns(
        UserWarning, match=r"left out the lights of node 4 .*got 'area'.*node 5 \(it references light 9 of 4"
    ):
        scene = wv.Scene.load(tmp_path / "a.glb", scale=10, strict=True)
    sun, spot, point = scene.lights
    assert (sun.kind, sun.color, sun.intensity, sun.color_space) == ("directional", (1, 0.5, 0), 3, "linear")
    # Rotated about x, -z becomes y, which is up in glTF; then scaled by 10 and converted to z-up.
    np.testing.assert_allclose(sun.direction, [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(spot.position, [10, -30, 20], atol=1e-5)
    assert (spot.name, spot.reach, spot.inner_angle, spot.outer_angle) == ("spot", 20, 0.1, 0.5)
    assert (spot.falloff, spot.attenuation) == ("gltf", (0, 0, 1))
    assert (point.kind, point.name, point.reach) == ("point", "n2", np.inf)


def test_webots_lights(tmp_path):
    (tmp_path / "a.wbt").write_text(WORLD % "")
    scene = load(tmp_path / "a.wbt")
    added, sun, lamp, spot = scene.lights
    linear = (1, pytest.approx(0.21404, abs=1e-5), 0)
    assert tuple(sun.color) == linear
    assert (added.kind, added.ambient) == ("ambient", (0.5, pytest.approx(0.10702, abs=1e-5), 0))
    assert (sun.kind, sun.intensity, sun.cast_shadow, sun.color_space) == ("directional", 2, True, "linear")
    np.testing.assert_allclose(sun.direction, np.array([0, 1, -1]) / np.sqrt(2))
    np.testing.assert_allclose(lamp.position, [0, 1, 1], atol=1e-9)
    assert (lamp.name, lamp.reach, lamp.attenuation, lamp.falloff) == ("LAMP", 5, (0, 0, 1), "webots")
    np.testing.assert_allclose(spot.direction, [0, 1, 0], atol=1e-9)
    np.testing.assert_allclose(spot.position, [0, 0, 11], atol=1e-9)
    assert (spot.inner_angle, spot.outer_angle, spot.cast_shadow) == (0.2, 0.6, False)
    assert (scene.background.color, scene.background.luminosity, scene.background.sky) == ((0.5, 0.25, 0), 2, ())


def test_webots_sky(tmp_path):
    names = ("right", "left", "top", "bottom", "front", "back")
    for number, name in enumerate(names):
        Image.fromarray(np.full((4, 4, 3), number, np.uint8)).save(tmp_path / f"{name}.png")
    urls = " ".join(f'{name}Url [ "{name}.png" ]' for name in names)
    (tmp_path / "a.wbt").write_text(WORLD % urls)
    background = load(tmp_path / "a.wbt").background
    # WbBackground.cpp maps the images in z-up worlds so that x is backward and y is right.
    ways = {"back": [1, 0, 0], "front": [-1, 0, 0], "right": [0, 1, 0], "left": [0, -1, 0], "top": [0, 0, 1]}
    for name, way in {**ways, "bottom": [0, 0, -1]}.items():
        number, _ = cube_coordinates(np.array(background.world_to_cube) @ way)
        assert names[background.image[4 * int(number), 0, 0]] == name
    (tmp_path / "top.png").unlink()
    assert load(tmp_path / "a.wbt").background.sky == ()


def test_mesh_files_without_lights_have_a_headlight(tmp_path, device):
    (tmp_path / "a.obj").write_text("mtllib m.mtl\nusemtl m\nv -1 -1 0\nv 1 -1 0\nv 0 2 0\nf 1 2 3\n")
    (tmp_path / "m.mtl").write_text("newmtl m\nKd 0.2 0.5 0.8\n")
    scene = wv.Scene.load(tmp_path / "a.obj", scale=2.0, device=device)
    (light,) = scene.lights
    assert (light.kind, light.name, light.color, light.ambient) == ("headlight", "headlight", (0.8,) * 3, (0.2,) * 3)
    outputs = ("color", "albedo")
    camera = wv.Camera.from_fov(5, 5, hfov=0.1)
    poses = [wv.look_at(eye, (0, 0, 0), up="y") for eye in ((0, 0, 3), (0.01, 3, 3))]
    color, albedo = (getattr(wv.render(scene, camera, poses, outputs=outputs), name).numpy() for name in outputs)
    assert (albedo == [51, 128, 204]).all()
    assert np.abs(color[0].astype(int) - albedo[0]).max() <= 1  # facing the camera
    oblique = 255 * to_screen(to_linear(np.array([0.2, 0.5, 0.8])) * (0.2 + 0.8 * np.cos(np.pi / 4)))
    assert np.abs(color[1, 2, 2] - oblique).max() <= 1
    scene.lights = ()
    np.testing.assert_array_equal(wv.render(scene, camera, poses, outputs=("color",)).color.numpy(), albedo)


def test_files_with_lights_or_worlds_have_no_headlight(tmp_path):
    (tmp_path / "a.glb").write_bytes(lit_file())
    with pytest.warns(UserWarning, match="left out the lights"):
        assert "headlight" not in [light.kind for light in wv.Scene.load(tmp_path / "a.glb").lights]
    (tmp_path / "a.wbt").write_text("#VRML_SIM R2023b utf8\nSolid { children [ Shape { geometry Box { } } ] }")
    assert wv.Scene.load(tmp_path / "a.wbt").lights == ()


def image_lit(light=0, **more):
    """Return a glTF file with an image-based light whose irradiance is 2, 1 and 0.5 on average."""
    writer = GltfWriter(extensions={"EXT_lights_image_based": {"lights": [more]}})
    writer.node(writer.primitive([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    return writer.bytes(extensions={"EXT_lights_image_based": {"light": light}})


def test_gltf_image_based_light_is_ambient(tmp_path):
    """The mean over all directions of the irradiance of spherical harmonics is what Lambertian surfaces reflect."""
    rng = np.random.default_rng(1)
    rows = np.concatenate([2 * np.sqrt(np.pi) * np.array([[2, 1, 0.5]]), rng.uniform(-0.3, 0.3, (8, 3))])
    (tmp_path / "a.glb").write_bytes(image_lit(irradianceCoefficients=rows.tolist(), intensity=3.0, name="sky"))
    (light,) = load(tmp_path / "a.glb").lights
    assert (light.kind, light.name, light.color_space, light.color) == ("ambient", "sky", "linear", (0, 0, 0))
    # Numerical integration over the sphere.
    x, y, z = np.moveaxis(rng.normal(size=(400_000, 3)), -1, 0)
    length = np.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    basis = [0.282095 + 0 * x, 0.488603 * y, 0.488603 * z, 0.488603 * x, 1.092548 * x * y, 1.092548 * y * z]
    basis += [0.315392 * (3 * z * z - 1), 1.092548 * x * z, 0.546274 * (x * x - y * y)]
    irradiance = (np.stack(basis, axis=-1) @ rows).mean(axis=0)
    np.testing.assert_allclose(light.ambient, 3 * irradiance / np.pi, rtol=5e-3)


def with_sky(faces, **more):
    """Return a glTF file whose image-based light has six images as PNG."""
    light = {"irradianceCoefficients": [[0, 0, 0]] * 9, "specularImages": [list(range(6)), [0] * 6], **more}
    writer = GltfWriter(extensions={"EXT_lights_image_based": {"lights": [light]}}, images=[])
    writer.node(writer.primitive([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    for face in faces:
        buffer = io.BytesIO()
        Image.fromarray(face).save(buffer, "png")
        writer.content["images"].append({"bufferView": writer.view(buffer.getvalue()), "mimeType": "image/png"})
    return writer.bytes(extensions={"EXT_lights_image_based": {"light": 0}})


def sky_colors(path, directions):
    """Return the colors of a file's background in directions of the file's frame."""
    scene = wv.Scene.load(path, show_environment=True, up="y")
    camera = wv.Camera.from_fov(1, 1, hfov=1e-3)
    eye = np.array([9.0, 9, 9])
    up = ["z" if abs(direction[1]) > 0.99 else "y" for direction in directions]
    poses = [wv.look_at(eye, eye + direction, up=axis) for direction, axis in zip(directions, up, strict=True)]
    views = wv.render(scene, camera, poses, outputs=("color", "segmentation"))
    assert (views.segmentation.numpy() == -1).all()
    return views.color.numpy()[:, 0, 0]


def test_images_of_an_image_based_light_are_a_sky_on_request(tmp_path, device):
    """Faces +x, -x, +y, -y, +z, -z are in their directions, also in a scene with z up."""
    colors = np.array([[255, 0, 0], [0, 255, 255], [0, 255, 0], [255, 0, 255], [0, 0, 255], [255, 255, 0]])
    faces = [np.tile(color.astype(np.uint8), (4, 4, 1)) for color in colors]
    (tmp_path / "a.glb").write_bytes(with_sky(faces))
    axes = np.repeat(np.eye(3), 2, axis=0) * np.tile([1, -1], 3)[:, None]
    np.testing.assert_array_equal(sky_colors(tmp_path / "a.glb", axes), colors)
    assert wv.Scene.load(tmp_path / "a.glb").background is None
    upright = wv.Scene.load(tmp_path / "a.glb", show_environment=True, device=device)
    pose = wv.look_at((0, 0, 5), (0, -1, 5))  # +z of the file is -y of a scene with z up
    camera = wv.Camera.from_fov(1, 1, hfov=1e-3)
    assert wv.render(upright, camera, pose, outputs=("color",)).color.numpy()[0, 0, 0].tolist() == [0, 0, 255]


def test_environment_is_rotated_scaled_and_unpacked(tmp_path):
    """Directions are looked up as OpenGL does, with the first row of an image at the top."""
    rng = np.random.default_rng(2)
    blocks = rng.integers(20, 200, (6, 2, 2, 4), dtype=np.uint8)
    blocks[..., 3] = np.where(rng.random((6, 2, 2)) < 0.5, 255, 128)
    rotation = Rotation.from_rotvec([0.3, -0.8, 0.5])
    (tmp_path / "a.glb").write_bytes(
        with_sky(
            np.kron(blocks, np.ones((1, 8, 8, 1), dtype=np.uint8)), intensity=0.7, rotation=rotation.as_quat().tolist()
        )
    )
    inside = rng.uniform(-0.9, 0.9, (40, 3))
    inside[np.abs(inside) < 0.15] = 0.3  # not between blocks
    axis, sign = rng.integers(0, 3, 40), rng.choice([-1.0, 1.0], 40)
    inside[np.arange(40), axis] = sign
    x, y, z = inside.T
    face = 2 * axis + (sign < 0)
    u = np.choose(face, [-z, z, x, x, x, -x])  # to the right, and v upwards: OpenGL 4.6, table 8.19
    v = np.choose(face, [y, y, -z, z, y, y])
    stored = blocks[face, (v < 0).astype(int), (u > 0).astype(int)] / 255
    expected = 255 * to_screen(np.minimum(0.7 * to_linear(stored[:, :3]) / stored[:, 3:], 1))
    found = sky_colors(tmp_path / "a.glb", rotation.apply(inside / np.linalg.norm(inside, axis=1, keepdims=True)))
    assert np.abs(found - expected).max() <= 1


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"specularImages": [[0, 1]]}, "six squares of equal size"),
        ({"specularImages": []}, "index out of range"),
        ({"rotation": [0, 0, 0, 0]}, "must be a quaternion"),
    ],
)
def test_invalid_environment_is_left_out(tmp_path, more, message):
    (tmp_path / "a.glb").write_bytes(with_sky(np.zeros((6, 4, 4, 3), dtype=np.uint8), **more))
    with pytest.warns(UserWarning, match=rf"a\.glb: left out the sky of the scene \(.*{message}"):
        scene = wv.Scene.load(tmp_path / "a.glb", show_environment=True)
    assert scene.background is None


@pytest.mark.parametrize(
    "more", [{"irradianceCoefficients": [[1, 1, 1]]}, {"light": 7, "irradianceCoefficients": [[1] * 3] * 9}, {}]
)
def test_invalid_image_based_light_is_left_out(tmp_path, more):
    (tmp_path / "a.glb").write_bytes(image_lit(**more))
    with pytest.warns(UserWarning, match=r"left out the lights of the scene \("):
        (light,) = wv.Scene.load(tmp_path / "a.glb", strict=True).lights
    assert light.kind == "headlight"
