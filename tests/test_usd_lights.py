# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lights and backgrounds of USD stages."""

import numpy as np
import pytest
from PIL import Image

import warpvis as wv

from support import usd_stages as stages

pytest.importorskip("pxr")
from pxr import UsdLux


def lit(folder, text, header=stages.METERS):
    path = stages.write(folder, text + stages.mesh("a"), header=header)
    return wv.Scene.load(path).lights


def test_distant_lights(tmp_path):
    text = 'def DistantLight "sun"\n{\n    float inputs:angle = 2\n    color3f inputs:color = (1, 0.5, 0)\n'
    text += '    float xformOp:rotateX = 90\n    uniform token[] xformOpOrder = ["xformOp:rotateX"]\n}\n'
    (light,) = lit(tmp_path, text)
    assert light.kind == "directional" and light.color == (1, 0.5, 0)
    np.testing.assert_allclose(light.direction, (0, 1, 0), atol=1e-6)
    assert light.radius == pytest.approx(np.pi / 180)
    assert light.intensity == pytest.approx(np.pi)  # a white surface that faces it is white


def test_color_temperatures(tmp_path):
    text = 'def DistantLight "sun"\n{\n    bool inputs:enableColorTemperature = 1\n'
    (light,) = lit(tmp_path, text + "    float inputs:colorTemperature = 3000\n}\n")
    red, green, blue = light.color
    assert red > green > blue


def test_ratios_of_lights_are_physical(tmp_path):
    """A disk of 1 m2 and 100 nt at 10 m gives as much light as a distant light of its solid angle."""
    radius = np.sqrt(1 / np.pi)
    angle = 2 * np.degrees(np.arcsin(radius / 10))
    place = (
        "    double3 xformOp:translate = (0, 0, 10)\n" + '    uniform token[] xformOpOrder = ["xformOp:translate"]\n'
    )
    text = f'def DistantLight "sun"\n{{\n    float inputs:angle = {angle}\n    float inputs:intensity = 100\n}}\n'
    for kind, size in (
        ("DiskLight", f"radius = {radius}"),
        ("RectLight", "width = 1\n    float inputs:height = 1"),
        ("SphereLight", f"radius = {radius}"),
    ):
        text += f'def {kind} "{kind}"\n{{\n    float inputs:intensity = 25\n    float inputs:exposure = 2\n'
        text += f"    float inputs:{size}\n{place}}}\n"
    sun, *others = lit(tmp_path, text)
    for light in others:
        assert light.intensity * float(light.strength((0, 0, 0))) == pytest.approx(sun.intensity, rel=2e-3)
    assert [light.kind for light in others] == ["spot", "spot", "point"]


def test_normalized_lights_do_not_depend_on_their_size(tmp_path):
    text = "".join(
        f'def SphereLight "l{number}"\n{{\n    float inputs:radius = {radius}\n    bool inputs:normalize = 1\n'
        f"    double3 xformOp:translate = ({number}, 0, 5)\n"
        '    uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
        for number, radius in enumerate((0.1, 0.4))
    )
    first, second = lit(tmp_path, text)
    assert first.intensity == pytest.approx(second.intensity)
    assert (first.radius, second.radius) == pytest.approx((0.1, 0.4))


def test_shaped_lights_are_spots_in_meters(tmp_path):
    text = 'def SphereLight "lamp" (prepend apiSchemas = ["ShapingAPI"])\n{\n    float inputs:shaping:cone:angle = 30\n'
    text += "    float inputs:shaping:cone:softness = 0.5\n    double3 xformOp:translate = (0, 200, 0)\n"
    text += '    uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
    (light,) = lit(tmp_path, text, '#usda 1.0\n(\n    metersPerUnit = 0.01\n    upAxis = "Y"\n)\n')
    assert light.kind == "spot"
    np.testing.assert_allclose(light.position, (0, 0, 2), atol=1e-6)
    assert np.degrees((light.inner_angle, light.outer_angle)) == pytest.approx((15, 30))


def test_domes_are_ambient_light_and_background(tmp_path):
    (light,) = lit(tmp_path, 'def DomeLight "sky"\n{\n    color3f inputs:color = (0.5, 1, 1)\n}\n')
    assert light.kind == "ambient" and light.ambient == (0.5, 1, 1)
    image = np.zeros((4, 8, 3), np.uint8)
    image[:2] = (0, 0, 255)  # the upper half
    image[:, 4:5] = (255, 0, 0)  # right of the center
    Image.fromarray(image).save(tmp_path / "sky.png")
    text = 'def DomeLight "sky"\n{\n    asset inputs:texture:file = @sky.png@\n}\n'
    path = stages.write(tmp_path, text + stages.mesh("a"), header='#usda 1.0\n(\n    upAxis = "Y"\n)\n')
    background = wv.Scene.load(path, up="y").background
    rows = np.array(background.world_to_cube)
    np.testing.assert_allclose(rows @ (0, 0, 1), (1, 0, 0), atol=1e-9)  # the center of the image is +z of the dome
    np.testing.assert_allclose(rows @ (0, 1, 0), (0, 0, 1), atol=1e-9)
    np.testing.assert_allclose(rows @ (1, 0, 0), (0, 1, 0), atol=1e-9)  # +x is left of the center
    with pytest.warns(UserWarning, match=r"texture 'no.hdr' was not found"):
        lit(tmp_path, text.replace("sky.png", "no.hdr"))


def test_stages_without_lights_have_a_headlight(tmp_path):
    (light,) = lit(tmp_path, "")
    assert light.kind == "headlight"


def test_other_lights_are_listed(tmp_path):
    with pytest.warns(UserWarning, match="PortalLight </window>"):
        lit(tmp_path, 'def PortalLight "window" {}\n')


def at_height(kind, *properties, height=5, apis=""):
    """Return the text of a light above the origin, which shines down."""
    lines = "".join(f"    {line}\n" for line in properties)
    schemas = f"(prepend apiSchemas = [{apis}])" if apis else ""
    return (
        f'def {kind} "lamp" {schemas}\n{{\n{lines}    double3 xformOp:translate = (0, 0, {height})\n'
        '    uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
    )


def test_color_temperatures_are_those_of_usd(tmp_path):
    text = at_height("SphereLight", "bool inputs:enableColorTemperature = 1", "float inputs:colorTemperature = 4000")
    (light,) = lit(tmp_path, text)
    expected = np.array(UsdLux.BlackbodyTemperatureAsRgb(4000.0))
    np.testing.assert_allclose(light.color, expected, rtol=1e-5)
    (unused,) = lit(tmp_path, text.replace("Temperature = 1", "Temperature = 0"))
    assert unused.color == (1, 1, 1)


def test_cylinder_lights_are_points_or_spots(tmp_path):
    size = "float inputs:radius = 0.1", "float inputs:length = 2"
    (light,) = lit(tmp_path, at_height("CylinderLight", *size))
    assert light.kind == "point" and light.position == (0, 0, 5)
    shaped = at_height("CylinderLight", *size, "float inputs:shaping:cone:angle = 40", apis='"ShapingAPI"')
    (light,) = lit(tmp_path, shaped)
    assert light.kind == "spot" and np.degrees(light.outer_angle) == pytest.approx(40)


@pytest.mark.parametrize("kind", ["RectLight", "DiskLight"])
def test_light_of_flat_lights_falls_with_the_cosine(tmp_path, kind):
    (light,) = lit(tmp_path, at_height(kind))
    below, aside = (0, 0, 0), (5 * np.sqrt(3), 0, 0)  # 60 degrees off the axis, and twice as far
    assert light.kind == "spot"
    assert float(light.strength(aside)) == pytest.approx(0.5 * 0.25 * float(light.strength(below)), rel=1e-6)


def test_white_surfaces_that_face_all_lights_are_white(tmp_path):
    """Two lights are exposed together, so that their sum is white; their ratio is that of the stage."""
    text = "\n{\n    float inputs:angle = 0\n    float inputs:intensity = INTENSITY\n}\n"
    suns = "".join(f'def DistantLight "sun{number}"' + text.replace("INTENSITY", number) for number in "13")
    stages.write(tmp_path, suns + stages.mesh("a", "color3f[] primvars:displayColor = [(1, 1, 1)]", stages.SQUARE))
    scene = wv.Scene.load(tmp_path / "stage.usda")
    first, second = scene.lights
    assert second.intensity == pytest.approx(3 * first.intensity)
    camera, pose = wv.Camera.from_fov(8, 8, hfov=0.3), wv.look_at((1, 0.5, 3), (1, 0.5, 0), up=(0, 1, 0))
    assert wv.render(scene, camera, pose, outputs=("color",)).color.numpy()[0, 4, 4, :3].tolist() == [255, 255, 255]
    stages.write(tmp_path, suns.replace("= 3", "= 0") + stages.mesh("a"))
    (only,) = wv.Scene.load(tmp_path / "stage.usda").lights
    assert only.intensity == pytest.approx(np.pi)


def test_domes_about_z(tmp_path):
    """The pole of DomeLight_1 is its own axis, or that of the stage; the center of its image is -y about z."""
    Image.new("RGB", (8, 4), (0, 0, 255)).save(tmp_path / "sky.png")
    text = 'def DomeLight_1 "sky"\n{\n    asset inputs:texture:file = @sky.png@\n    token poleAxis = "Z"\n}\n'
    for pole in ("Z", "scene"):
        path = stages.write(tmp_path, text.replace('"Z"', f'"{pole}"') + stages.mesh("a"))
        rows = np.array(wv.Scene.load(path).background.world_to_cube)
        np.testing.assert_allclose(rows, [(0, -1, 0), (1, 0, 0), (0, 0, 1)], atol=1e-9)
    stages.write(tmp_path, text.replace('"Z"', '"Y"') + stages.mesh("a"))
    np.testing.assert_allclose(
        wv.Scene.load(tmp_path / "stage.usda").background.world_to_cube, [(0, 0, 1), (1, 0, 0), (0, 1, 0)], atol=1e-9
    )
    (ambient,) = wv.Scene.load(tmp_path / "stage.usda").lights
    assert ambient.kind == "ambient" and ambient.ambient == pytest.approx((0, 0, 1))


def test_domes_of_linear_light(tmp_path):
    cv2 = pytest.importorskip("cv2")
    panorama = np.full((4, 8, 3), (0.25, 1.0, 4.0), dtype=np.float32)
    assert cv2.imwrite(str(tmp_path / "sky.hdr"), panorama)  # blue, green, red
    text = 'def DomeLight "sky"\n{\n    asset inputs:texture:file = @sky.hdr@\n}\n'
    scene = stages.load(tmp_path, text + stages.mesh("a"))
    (ambient,) = scene.lights
    np.testing.assert_allclose(ambient.ambient, (4, 1, 0.25), rtol=0.02)
    assert scene.background.panorama.dtype == np.float32


IGNORED = {
    "IES profile": ("asset inputs:shaping:ies:file = @lamp.ies@", '"ShapingAPI"'),
    "light linking": ("rel collection:lightLink:includes = </nothing>", '"CollectionAPI:lightLink"'),
}


@pytest.mark.parametrize("case", IGNORED)
def test_profiles_and_linking_are_ignored(tmp_path, case):
    line, api = IGNORED[case]
    plain, changed = lit(tmp_path, at_height("SphereLight")), lit(tmp_path, at_height("SphereLight", line, apis=api))
    assert str(changed) == str(plain)


def test_lights_with_a_mesh_are_listed(tmp_path):
    with pytest.warns(UserWarning, match=r"not read: GeometryLight </lamp>"):
        lit(tmp_path, at_height("GeometryLight"))
