# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the colors that stand in for Webots' missing appearances and textures, and for objects without a file."""

import warnings

import numpy as np
import pytest

import warpvis as wv
from warpvis.scene.materials import linear_color
from warpvis.webots.protos._builtin import BUILTIN
from warpvis.webots.protos._library import FINISHES, OBJECTS, UNKNOWN, VARIANTS, texture_finish
from warpvis.webots.protos._standins import KNOWN


@pytest.fixture(autouse=True)
def no_webots(monkeypatch, tmp_path):
    """Hide an installation of Webots and its cache."""
    monkeypatch.delenv("WEBOTS_HOME", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def load(tmp_path, text):
    (tmp_path / "a.wbt").write_text(f"#VRML_SIM R2023b utf8\nWorldInfo {{ }}\n{text}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene = wv.Scene.load(tmp_path / "a.wbt")
        for item in scene:
            _ = item.appearance
    return scene


def shape(appearance):
    return f'Solid {{ name "a" children [ Shape {{ appearance {appearance} geometry Box {{ }} }} ] }}'


def material(tmp_path, appearance):
    (found,) = load(tmp_path, shape(appearance))["a"].appearance.materials
    return found


def opaque(*color):
    return pytest.approx((*linear_color(color), 1), abs=1e-5)


@pytest.mark.parametrize("kind", sorted(FINISHES))
def test_appearances_of_the_library(tmp_path, kind):
    finish = FINISHES[kind]
    field, colors = VARIANTS.get(kind, ("", {}))
    plain = material(tmp_path, f"{kind} {{ }}")
    assert plain.base_color == opaque(*finish.color)
    assert (plain.roughness, plain.metallic) == (finish.roughness, finish.metalness) and plain.shading == "webots"
    for choice, color in colors.items():
        assert material(tmp_path, f'{kind} {{ {field} "{choice}" }}').base_color == opaque(*color)


def test_fields_of_appearances(tmp_path):
    assert material(tmp_path, "BrushedAluminium { IBLStrength 0.4 }").ambient_strength == 0.4
    glass = material(tmp_path, "ReflectiveSurface { metalness 0.2 emissiveColor 0 1 0 emissiveIntensity 2 }")
    assert (glass.metallic, glass.emission) == (0.2, (0, 2, 0))
    # A factor of a texture whose default is not white: the default is divided out.
    pine = material(tmp_path, "VarnishedPine { colorOverride 0.8039 0.6745 0.5764 }").base_color
    assert pine == material(tmp_path, "VarnishedPine { }").base_color
    assert min(np.array(material(tmp_path, "VarnishedPine { colorOverride 1 1 1 }").base_color) - pine) >= 0
    # Transforms of textures, and fields that are not numbers, have no effect.
    same = 'Grass { type 3 textureTransform TextureTransform { scale 2 2 } colorOverride "red" }'
    assert material(tmp_path, same).base_color == opaque(*FINISHES["Grass"].color)


@pytest.mark.parametrize(
    ("url", "color"),
    [
        ("webots://projects/default/worlds/textures/light_asphalt.jpg", (0.52, 0.52, 0.52)),
        ("textures/brushed_aluminium_base_color.jpg", FINISHES["BrushedAluminium"].color),
        ("textures\\\\Red_Brick_Wall.JPG", FINISHES["RedBricks"].color),
        ("ground_grass.jpg", FINISHES["Grass"].color),
        ("varnished_pine_base_color.jpg", (0.82, 0.66, 0.455)),
        ("barcode.png", None),
    ],
)
def test_missing_textures(tmp_path, url, color):
    """The name of a texture file reveals its color; otherwise it is white."""
    finish = texture_finish(url)
    assert (None if finish is None else finish.color) == color
    expected = np.array(linear_color(color or (1, 1, 1)))
    node = f'PBRAppearance {{ baseColor 0.5 1 1 metalness 0 baseColorMap ImageTexture {{ url "{url}" }} }}'
    assert material(tmp_path, node).base_color[:3] == pytest.approx(expected * linear_color((0.5, 1, 1)), abs=1e-5)
    node = f'Appearance {{ material Material {{ diffuseColor 0 1 0 }} texture ImageTexture {{ url "{url}" }} }}'
    assert material(tmp_path, node).base_color[:3] == pytest.approx(expected, abs=1e-5)


def test_missing_maps_have_the_finish_of_the_texture(tmp_path):
    maps = " ".join(
        f'{field} ImageTexture {{ url "t/brushed_steel_{name}.jpg" }}'
        for field, name in (("baseColorMap", "base_color"), ("roughnessMap", "roughness"))
    )
    found = material(tmp_path, f"PBRAppearance {{ metalness 0.3 {maps} }}")
    assert (found.roughness, found.metallic) == (0.4, 0.3)


def test_a_warning_names_the_missing_texture(tmp_path):
    (tmp_path / "a.wbt").write_text(
        "#VRML_SIM R2023b utf8\n" + shape('PBRAppearance { baseColorMap ImageTexture { url "x/grass.jpg" } }')
    )
    scene = wv.Scene.load(tmp_path / "a.wbt")
    with pytest.warns(UserWarning, match="used a stand-in color for an ImageTexture 'grass.jpg', whose file was not f"):
        assert scene["a"].appearance.materials[0].texture is None


@pytest.mark.parametrize("kind", sorted({*KNOWN, *BUILTIN} - {"Cabinet", "CircleArena", "RectangleArena", "Window"}))
def test_objects_are_not_plain_white(tmp_path, kind):
    """Except for Roughcast, which is white in Webots, too."""
    (item,) = load(tmp_path, f"{kind} {{ }}")
    colors = {entry.base_color for entry in item.appearance.materials}
    assert kind in ("Door", "Wall") or (1, 1, 1, 1) not in colors
    default = OBJECTS.get(kind.removesuffix("Simple"), UNKNOWN)
    if kind not in ("Door", "Table"):
        color = default if isinstance(default, tuple) else FINISHES[default].color
        (found,) = colors
        assert found == opaque(*color)


def test_colors_of_objects_come_from_their_fields(tmp_path):
    text = """Thing { name "color" size 1 1 1 color 1 0 0 }
    Thing { name "body" size 1 1 1 bodyColor 0 1 0 }
    Thing { name "look" size 1 1 1 frameAppearance Grass { } }
    Thing { name "both" size 1 1 1 color 1 0 0 appearance Grass { } }
    Thing { name "none" size 1 1 1 }
    BmwX5Simple { name "car" }"""
    scene = load(tmp_path, text)
    found = {item.name: item.appearance.materials[0].base_color for item in scene}
    grass = FINISHES["Grass"].color
    colors = {"color": (1, 0, 0), "body": (0, 1, 0), "look": grass, "both": grass, "none": UNKNOWN}
    for name, color in (colors | {"car": (0.43, 0.11, 0.1)}).items():
        assert found[name] == opaque(*color), name
