# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Materials and colors of USD stages."""

import warnings

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


def with_images(surface, files):
    """Return a textured square with further images, by the names of their shaders."""
    text = stages.textured("wood.png", surface)
    for name, file in files.items():
        shader = f'def Shader "{name}"\n{{\nuniform token info:id = "UsdUVTexture"\nasset inputs:file = @{file}@\n'
        shader += "float2 inputs:st.connect = </Wood/Coordinates.outputs:result>\n"
        shader += "float outputs:r\nfloat outputs:b\nfloat3 outputs:rgb\n}\n"
        text = text[: text.rindex("}")] + shader + "}\n"
    return text


def test_maps_of_normals_occlusion_and_emission(tmp_path):
    colors = {"wood.png": (200, 100, 50), "n.png": (128, 128, 255), "o.png": (90, 0, 0), "e.png": (10, 20, 30)}
    for name, color in colors.items():
        picture(tmp_path / name, color)
    surface = "normal3f inputs:normal.connect = </Wood/N.outputs:rgb>\n"
    surface += "float inputs:occlusion.connect = </Wood/O.outputs:r>\n"
    surface += "color3f inputs:emissiveColor.connect = </Wood/E.outputs:rgb>\n"
    material = appearance(tmp_path, with_images(surface, {"N": "n.png", "O": "o.png", "E": "e.png"})).materials[0]
    normal, occlusion, emission = material.normal_texture, material.occlusion_texture, material.emissive_texture
    assert [item.image[0, 0].tolist() for item in (normal, emission)] == [[128, 128, 255], [10, 20, 30]]
    assert occlusion.image[0, 0, 0] == 90
    assert [item.color_space for item in (normal, occlusion, emission)] == ["linear", "linear", "srgb"]
    assert material.emission == (1, 1, 1)


@pytest.mark.parametrize(
    ("usd", "expected"),
    [("useMetadata", "repeat"), ("black", "clamp"), ("clamp", "clamp"), ("repeat", "repeat"), ("mirror", "mirror")],
)
def test_wrap_modes(tmp_path, usd, expected):
    picture(tmp_path / "wood.png", (200, 100, 50))
    found = appearance(tmp_path, stages.textured("wood.png", "", f'token inputs:wrapT = "{usd}"')).materials[0].texture
    assert (found.wrap_u, found.wrap_v) == ("repeat", expected)


def test_other_inputs_of_surfaces_are_ignored(tmp_path):
    surface = "color3f inputs:diffuseColor = (0.1, 0.2, 0.3)\n"
    more = "float inputs:ior = 2\nfloat inputs:clearcoat = 1\nfloat inputs:clearcoatRoughness = 0.5\n"
    more += (
        "float inputs:displacement = 1\nint inputs:useSpecularWorkflow = 1\ncolor3f inputs:specularColor = (1, 0, 0)\n"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        first, second = (appearance(tmp_path, plain(text)).materials[0] for text in (surface, surface + more))
    assert str(first) == str(second)


def test_missing_textures_use_their_fallback(tmp_path):
    text = stages.textured("none.png", "", "float4 inputs:fallback = (0.3, 0.2, 0.1, 1)")
    with pytest.warns(UserWarning, match=r"texture 'none.png', which was not found"):
        scene = stages.load(tmp_path, text)
    assert next(iter(scene)).appearance.materials[0].base_color == pytest.approx((0.3, 0.2, 0.1, 1))


@pytest.mark.parametrize("tiles", ["<UDIM>", "<UVTILE>"])
def test_textures_of_tiles_are_left_out(tmp_path, tiles):
    """The warning names the material and a tool; the tiles are not read, also if they exist."""
    folder = "textures_of_the_living_room_in_4k"
    (tmp_path / folder).mkdir()
    picture(tmp_path / folder / "wood.1001.png", (200, 100, 50))
    text = stages.textured(f"{folder}/wood.{tiles}.png").replace("Wood", "Wood_of_the_large_cupboard_door")
    message = f"not read: UDIM texture '{folder}/wood.{tiles}.png' of material </Wood_of_the_large_cupboard_door>, "
    message += "which Blender can bake into one image"
    with pytest.warns(UserWarning, match=message):
        scene = stages.load(tmp_path, text)
    (item,) = scene
    assert item.appearance.materials[0].texture is None


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


def test_materials_of_renderers_have_their_constant_color(tmp_path):
    """The surface of a renderer's own context, without one for all renderers."""
    text = plain("color3f inputs:diffuseColor = (0.1, 0.2, 0.3)", "PxrDisney")
    text = text.replace("token outputs:surface.connect", "token outputs:ri:surface.connect")
    assert appearance(tmp_path, text).materials[0].base_color == pytest.approx((0.1, 0.2, 0.3, 1))


def test_materialx_surfaces_have_their_constant_color(tmp_path):
    text = plain("color3f inputs:base_color = (0.1, 0.2, 0.3)", "ND_standard_surface_surfaceshader")
    assert appearance(tmp_path, text).materials[0].base_color == pytest.approx((0.1, 0.2, 0.3, 1))


def test_colors_are_rendered(tmp_path):
    text = 'def DistantLight "sun" {}\n' + plain("color3f inputs:diffuseColor = (1, 0, 0)\nfloat inputs:roughness = 1")
    scene = stages.load(tmp_path, text)
    camera = wv.Camera.from_fov(8, 8, hfov=0.3)
    color = wv.render(scene, camera, wv.look_at((1, 0.5, 3), (1, 0.5, 0), up=(0, 1, 0)), outputs=("color",)).color
    red, green, blue = color.numpy()[0, 4, 4, :3].tolist()
    assert red > 200 and green < 80 and blue < 80
