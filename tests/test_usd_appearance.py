# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Materials, colors, lights and backgrounds of USD stages: rows of the table of docs/scene_files/usd.md."""

import numpy as np
import pytest
from PIL import Image

import warpvis as wv

from support import usd_stages as stages

pytest.importorskip("pxr")

UV = [(0, 0), (1, 0), (1, 1), (0, 1)]


def picture(path, color, size=(4, 4)):
    Image.new("RGBA" if len(color) == 4 else "RGB", size, color).save(path)


def appearance(folder, text, **options):
    return next(iter(stages.load(folder, text, **options))).appearance


def plain(surface, kind="UsdPreviewSurface", mesh=""):
    """Return a square with a shader of constant inputs."""
    return f"""
def Mesh "square" (prepend apiSchemas = ["MaterialBindingAPI"])
{{{stages.SQUARE}
    rel material:binding = </Paint>
    {mesh}
}}
def Material "Paint"
{{
    token outputs:surface.connect = </Paint/Surface.outputs:surface>
    def Shader "Surface"
    {{
        uniform token info:id = "{kind}"
        {surface}
        token outputs:surface
    }}
}}
"""


def test_constant_inputs(tmp_path):
    surface = (
        "color3f inputs:diffuseColor = (0.1, 0.2, 0.3)\nfloat inputs:metallic = 0.4\nfloat inputs:roughness = 0.7\n"
    )
    surface += "color3f inputs:emissiveColor = (2, 0, 0)\nfloat inputs:opacity = 0.5\n"
    material = appearance(tmp_path, plain(surface)).materials[0]
    assert material.base_color == pytest.approx((0.1, 0.2, 0.3, 0.5))
    assert (material.metallic, material.roughness) == pytest.approx((0.4, 0.7))
    assert (material.alpha_mode, material.shading, material.color_space) == ("blend", "pbr", "linear")
    assert material.emission == (2, 0, 0)
    masked = appearance(tmp_path, plain(surface + "float inputs:opacityThreshold = 0.25\n")).materials[0]
    assert (masked.alpha_mode, masked.alpha_cutoff) == ("mask", 0.25)
    default = appearance(tmp_path, plain("")).materials[0]
    assert default.base_color == pytest.approx((0.18, 0.18, 0.18, 1)) and default.roughness == 0.5


def test_textures_have_coordinates_wrap_modes_and_scale(tmp_path):
    picture(tmp_path / "wood.png", (200, 100, 50))
    texture = 'token inputs:wrapS = "mirror"\ntoken inputs:wrapT = "black"\nfloat4 inputs:scale = (0.5, 1, 1, 1)\n'
    found = appearance(tmp_path, stages.textured("wood.png", "", texture, uv="map1"))
    material = found.materials[0]
    np.testing.assert_array_equal(found.uv, UV)
    assert (material.texture.wrap_u, material.texture.wrap_v, material.texture.color_space) == (
        "mirror",
        "clamp",
        "srgb",
    )
    assert material.base_color == (0.5, 1, 1, 1)
    assert material.texture.image[0, 0].tolist() == [200, 100, 50]
    raw = stages.textured("wood.png", "", 'token inputs:sourceColorSpace = "raw"')
    assert appearance(tmp_path, raw).materials[0].texture.color_space == "linear"


def test_texture_coordinates_are_transformed(tmp_path):
    """Scale, then rotate counterclockwise, then translate."""
    picture(tmp_path / "wood.png", (200, 100, 50))
    text = stages.textured("wood.png").replace("Coordinates.outputs:result>", "Turn.outputs:result>")
    text = (
        text[: text.rindex("}")]
        + """
    def Shader "Turn"
    {
        uniform token info:id = "UsdTransform2d"
        float2 inputs:in.connect = </Wood/Coordinates.outputs:result>
        float inputs:rotation = 90
        float2 inputs:scale = (2, 3)
        float2 inputs:translation = (10, 20)
        float2 outputs:result
    }
}
"""
    )
    found = appearance(tmp_path, text)
    np.testing.assert_allclose(found.uv, [(10, 20), (10, 22), (7, 22), (7, 20)], atol=1e-5)


def test_opacity_of_the_same_and_of_another_image(tmp_path):
    picture(tmp_path / "wood.png", (200, 100, 50, 128))
    same = stages.textured("wood.png", "float inputs:opacity.connect = </Wood/Image.outputs:a>")
    material = appearance(tmp_path, same).materials[0]
    assert material.alpha_mode == "blend" and material.texture.image[0, 0].tolist() == [200, 100, 50, 128]
    picture(tmp_path / "mask.png", (64, 0, 0), size=(8, 8))
    other = stages.textured("wood.png", "float inputs:opacity.connect = </Wood/Mask.outputs:r>")
    mask = 'def Shader "Mask"\n{\nuniform token info:id = "UsdUVTexture"\nasset inputs:file = @mask.png@\n'
    mask += "float2 inputs:st.connect = </Wood/Coordinates.outputs:result>\nfloat outputs:r\n}\n"
    other = other[: other.rindex("}")] + mask + "}\n"
    assert appearance(tmp_path, other).materials[0].texture.image[0, 0].tolist() == [200, 100, 50, 64]


def test_metallic_and_roughness_of_separate_images(tmp_path):
    picture(tmp_path / "wood.png", (200, 100, 50))
    picture(tmp_path / "rough.png", (10, 20, 30))
    picture(tmp_path / "metal.png", (40, 50, 60), size=(8, 8))
    surface = (
        "float inputs:roughness.connect = </Wood/R.outputs:r>\nfloat inputs:metallic.connect = </Wood/M.outputs:b>"
    )
    text = stages.textured("wood.png", surface)
    for name, file in (("R", "rough.png"), ("M", "metal.png")):
        shader = f'def Shader "{name}"\n{{\nuniform token info:id = "UsdUVTexture"\nasset inputs:file = @{file}@\n'
        shader += "float2 inputs:st.connect = </Wood/Coordinates.outputs:result>\nfloat outputs:r\nfloat outputs:b\n}\n"
        text = text[: text.rindex("}")] + shader + "}\n"
    material = appearance(tmp_path, text).materials[0]
    assert (material.metallic, material.roughness) == (1, 1)
    assert material.metallic_roughness_texture.image[0, 0].tolist() == [255, 10, 60]


def test_missing_textures_use_their_fallback(tmp_path):
    text = stages.textured("none.png", "", "float4 inputs:fallback = (0.3, 0.2, 0.1, 1)")
    with pytest.warns(UserWarning, match=r"texture 'none.png', which was not found"):
        scene = stages.load(tmp_path, text)
    assert next(iter(scene)).appearance.materials[0].base_color == pytest.approx((0.3, 0.2, 0.1, 1))
    with pytest.warns(UserWarning, match="UDIM"):
        stages.load(tmp_path, stages.textured("wood.<UDIM>.png"))


def test_subsets_have_materials(tmp_path):
    shape = stages.SQUARE.replace("[4]", "[3, 3]").replace("[0, 1, 2, 3]", "[0, 1, 2, 0, 2, 3]")
    subset = """
    uniform token subsetFamily:materialBind:familyType = "nonOverlapping"
    def GeomSubset "part" (prepend apiSchemas = ["MaterialBindingAPI"])
    {
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [1]
        rel material:binding = </Red>
    }
    color3f[] primvars:displayColor = [(0, 0, 1)]
    """
    red = plain("color3f inputs:diffuseColor = (1, 0, 0)").replace("Paint", "Red")
    red = red[red.index("def Material") :]
    found = appearance(tmp_path, stages.mesh("a", subset, shape) + red)
    assert [found.materials[index].base_color for index in found.face_materials] == [(0, 0, 1, 1), (1, 0, 0, 1)]


COLORS = {
    "constant": ("[(1, 0.5, 0)]", None),
    "vertex": ("[(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)]", "vertex_colors"),
    "uniform": ("[(1, 0.5, 0)]", "face_colors"),
    "faceVarying": ("[(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)]", "face_colors"),
}


@pytest.mark.parametrize("interpolation", COLORS)
def test_display_colors(tmp_path, interpolation):
    values, name = COLORS[interpolation]
    text = f'color3f[] primvars:displayColor = {values} (\n    interpolation = "{interpolation}"\n)'
    found = appearance(tmp_path, stages.mesh("a", text, stages.SQUARE))
    if name is None or interpolation == "uniform":
        color = found.materials[0].base_color[:3]
        assert color == (1, 0.5, 0)
    elif name == "vertex_colors":
        np.testing.assert_array_equal(found.vertex_colors[:, :3], [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)])
    else:
        np.testing.assert_allclose(found.face_colors[0, :3], np.full(3, 1 / 3), atol=1e-6)


def test_display_colors_are_inherited_and_indexed(tmp_path):
    text = 'def Xform "x"\n{\n    color3f[] primvars:displayColor = [(0, 1, 0), (1, 0, 0)]\n'
    text += "    int[] primvars:displayColor:indices = [1]\n    float[] primvars:displayOpacity = [0.5]\n"
    material = appearance(tmp_path, text + stages.mesh("a") + "}\n").materials[0]
    assert (material.base_color, material.alpha_mode) == ((1, 0, 0, 0.5), "blend")


def test_primvar_readers_color_materials(tmp_path):
    surface = "color3f inputs:diffuseColor.connect = </Paint/Color.outputs:result>"
    colors = 'color3f[] primvars:paint = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)] (interpolation = "vertex")'
    text = plain(surface, mesh=colors)
    shader = (
        'def Shader "Color"\n{\nuniform token info:id = "UsdPrimvarReader_float3"\nstring inputs:varname = "paint"\n'
    )
    text = text[: text.rindex("}")] + shader + "float3 outputs:result\n}\n}\n"
    found = appearance(tmp_path, text)
    np.testing.assert_array_equal(found.vertex_colors[1], (0, 1, 0, 1))


def test_arrays_that_do_not_fit_are_left_out(tmp_path):
    text = 'color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0)] (interpolation = "vertex")'
    item = next(iter(stages.load(tmp_path, stages.mesh("a", text))))
    with pytest.warns(UserWarning, match=r"</a>: primvar displayColor must have 3 values, got 2"):
        assert item.appearance is None or item.appearance.vertex_colors is None


def mdl(name, inputs):
    text = plain(inputs)
    shader = (
        f'uniform token info:implementationSource = "sourceAsset"\nuniform asset info:mdl:sourceAsset = @{name}.mdl@\n'
    )
    shader += f'uniform token info:mdl:sourceAsset:subIdentifier = "{name}"'
    text = text.replace('uniform token info:id = "UsdPreviewSurface"', shader).replace("outputs:surface", "outputs:out")
    return text.replace("token outputs:out.connect", "token outputs:mdl:surface.connect")


def test_mdl_materials_have_their_constant_color(tmp_path):
    inputs = (
        "color3f inputs:diffuse_color_constant = (0.1, 0.2, 0.3)\nfloat inputs:reflection_roughness_constant = 0.9\n"
    )
    material = appearance(tmp_path, mdl("OmniPBR", inputs + "float inputs:metallic_constant = 1")).materials[0]
    assert material.base_color == pytest.approx((0.1, 0.2, 0.3, 1))
    assert (material.roughness, material.metallic) == pytest.approx((0.9, 1))
    assert appearance(tmp_path, mdl("OmniPBR", "")).materials[0].base_color == pytest.approx((0.2, 0.2, 0.2, 1))
    with pytest.warns(UserWarning, match=r"Marble of material </Paint>, which is gray"):
        scene = stages.load(tmp_path, mdl("Marble", ""))
    assert next(iter(scene)).appearance.materials[0].base_color[:3] == pytest.approx((0.18, 0.18, 0.18))
    picture(tmp_path / "wood.png", (200, 100, 50))
    textured = appearance(tmp_path, mdl("OmniPBR", "asset inputs:diffuse_texture = @wood.png@"))
    assert textured.materials[0].texture.image[0, 0].tolist() == [200, 100, 50]


def test_materialx_surfaces_have_their_constant_color(tmp_path):
    text = plain("color3f inputs:base_color = (0.1, 0.2, 0.3)", "ND_standard_surface_surfaceshader")
    assert appearance(tmp_path, text).materials[0].base_color == pytest.approx((0.1, 0.2, 0.3, 1))


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


def test_colors_are_rendered(tmp_path):
    text = 'def DistantLight "sun" {}\n' + plain("color3f inputs:diffuseColor = (1, 0, 0)\nfloat inputs:roughness = 1")
    scene = stages.load(tmp_path, text)
    camera = wv.Camera.from_fov(8, 8, hfov=0.3)
    color = wv.render(scene, camera, wv.look_at((1, 0.5, 3), (1, 0.5, 0), up=(0, 1, 0)), outputs=("color",)).color
    red, green, blue = color.numpy()[0, 4, 4, :3].tolist()
    assert red > 200 and green < 80 and blue < 80
