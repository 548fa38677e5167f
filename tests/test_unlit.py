# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Materials of the shading "unlit", and KHR_materials_unlit of glTF: surfaces that show their base color."""

import io
import itertools
from dataclasses import replace

import numpy as np
import pytest
import reference_pbr
import trimesh
from gltf_files import GltfWriter
from PIL import Image
from reference_shading import to_linear

import warpvis as wv
from warpvis.scene.lights import Background, Light
from warpvis.scene.materials import Appearance, Material, Texture
from warpvis.scene.world_appearances import WorldAppearances

CAMERA = wv.Camera.from_fov(40, 30, hfov=0.9)
POSE = wv.look_at((2.2, -2.6, 1.8), (0.0, 0.2, 0.1))
OUTPUTS = ("color", "albedo", "points", "normals", "segmentation", "faces")
DISPLAY = (
    Light("directional", direction=(0.3, 0.5, -1.0), ambient=(0.3, 0.2, 0.1), intensity=1.6),
    Light("headlight", color=(0.5, 0.5, 0.5), specular=(0.5, 0.5, 0.5)),
)
LINEAR = tuple(replace(light, color_space="linear") for light in DISPLAY)
RNG = np.random.default_rng(3)
IMAGE = Texture(RNG.integers(0, 256, (8, 8, 3), dtype=np.uint8))
UNLIT = Material(
    base_color=(0.9, 0.7, 0.5), shading="unlit", texture=IMAGE, specular=(1, 1, 1), emission=(0.5, 0.5, 0.5)
)
PHONG = Material(base_color=(0.5, 0.6, 0.7), specular=(0.4, 0.4, 0.4), shininess=8.0)


def scene_of(device, material, other):
    """Return a ball of one material over a floor of another; the ball has vertex colors and texture coordinates."""
    scene, ball = wv.Scene(device=device), trimesh.creation.icosphere(2, 0.7)
    colors = RNG.integers(100, 256, (len(ball.vertices), 3), dtype=np.uint8)
    uv = 2 * ball.vertices[:, :2]
    scene.add(ball, name="ball", appearance=Appearance((material,), uv=uv, vertex_colors=colors, normals=ball.vertices))
    plate = trimesh.creation.box((6, 6, 0.1))
    look = Appearance((other,), uv=plate.vertices[:, :2])
    scene.add(plate, name="floor", pose=(0, 0, -0.8, 0, 0, 0, 1), appearance=look)
    return scene


@pytest.mark.parametrize("shading", ["phong", "pbr"])
@pytest.mark.parametrize("lights", [DISPLAY, LINEAR], ids=["display", "linear"])
@pytest.mark.parametrize("color_space", ["srgb", "linear"])
def test_unlit_surfaces_show_their_base_color(color_space, lights, shading, device):
    """Next to materials that are lit, whose colors do not change."""
    other, unlit = replace(PHONG, shading=shading), replace(UNLIT, color_space=color_space)
    scene = scene_of(device, unlit, other)
    scene.lights = lights
    views = wv.render(scene, CAMERA, POSE, outputs=OUTPUTS, shadows=False)
    seen, color = views.segmentation.numpy(), views.color.numpy().astype(int)
    assert np.abs(color - views.albedo.numpy())[seen == 0].max() <= 1
    assert np.abs(color - reference_pbr.shade_pbr_colors(scene, CAMERA, POSE, views)).max() <= 1
    assert len(np.unique(color[seen == 0], axis=0)) > 20
    lit = scene_of(device, replace(unlit, shading=shading), other)
    lit.lights = lights
    others = wv.render(lit, CAMERA, POSE, outputs=OUTPUTS, shadows=False).color.numpy()
    assert np.abs(color - others)[seen == 1].max() <= 1
    assert np.abs(color - others)[seen == 0].max() > 20


@pytest.mark.parametrize("lights", [DISPLAY, LINEAR], ids=["display", "linear"])
@pytest.mark.parametrize("lighting", ["pixel", "vertex"])
def test_shadows_and_occlusion_do_not_darken_unlit_surfaces(lighting, lights, device):
    from warpvis.scene.lights import AmbientOcclusion

    scene = scene_of(device, PHONG, UNLIT)
    scene.lights = lights
    options = {"outputs": OUTPUTS, "lighting": lighting}
    views = wv.render(scene, CAMERA, POSE, ambient_occlusion=AmbientOcclusion(1.0), **options)
    is_floor = views.segmentation.numpy() == 1
    assert np.abs(views.color.numpy().astype(int) - views.albedo.numpy())[is_floor].max() <= 1
    scene.set_appearance("floor", PHONG)
    lit, dark = (wv.render(scene, CAMERA, POSE, shadows=on, **options).color.numpy() for on in (False, True))
    assert (lit != dark)[is_floor].any()


@pytest.mark.parametrize("lighting", ["pixel", "vertex"])
def test_unlit_surfaces_are_blended(lighting, device):
    """By the opacity of the base color: a c + (1 - a) B in display color space."""
    scene = wv.Scene(device=device)
    glass = replace(UNLIT, texture=None, base_color=(0.9, 0.7, 0.5, 0.25), alpha_mode="blend")
    scene.add(trimesh.creation.box((9, 9, 0.1)), appearance=glass)
    scene.lights, scene.background = LINEAR, Background(color=(0.2, 0.4, 0.6))
    views = wv.render(scene, CAMERA, wv.look_at((0, 0, 3), (0, 0, 0), up="y"), outputs=("color",), lighting=lighting)
    wanted = np.array([0.9, 0.7, 0.5]) * 0.25 * (1 + 0.75) + 0.75**2 * np.array([0.2, 0.4, 0.6])
    assert np.abs(views.color.numpy() - 255 * wanted).max() <= 1.5


@pytest.mark.parametrize("lights", [DISPLAY, LINEAR], ids=["display", "linear"])
def test_mirrors_show_unlit_surfaces(lights, device):
    """Their display color times the reflectance with display lights, and their light with linear ones."""
    scene, base = wv.Scene(device=device), np.array([0.9, 0.7, 0.5])
    mirror = replace(PHONG, base_color=(0, 0, 0), specular=(0, 0, 0), reflectance=0.5)
    scene.add(trimesh.creation.box((4, 4, 0.1)), appearance=mirror)
    ceiling = trimesh.creation.box((40, 40, 0.1))
    scene.add(ceiling, pose=(0, 0, 4, 0, 0, 0, 1), appearance=replace(UNLIT, texture=None))
    scene.lights = lights
    pose = wv.look_at((0, -1, 2), (0, 0, 0.05))
    color = wv.render(scene, wv.Camera.from_fov(4, 3, hfov=0.1), pose, outputs=("color",)).color.numpy()
    assert np.abs(color - 255 * 0.5 * base).max() <= 1


def test_worlds_replace_the_color_of_unlit_surfaces(device):
    scene = scene_of(device, replace(UNLIT, texture=None), PHONG)
    scene.lights = LINEAR
    scene.set_appearance("ball", replace(UNLIT, texture=None))
    worlds = WorldAppearances(object_colors=[[[0.2, 0.6, 1.0], [np.nan] * 3]])
    views = wv.render(scene, CAMERA, POSE, outputs=("color", "segmentation"), appearances=worlds)
    shown = views.color.numpy()[views.segmentation.numpy() == 0]
    assert np.abs(shown - 255 * np.array([0.2, 0.6, 1.0])).max() <= 1


def test_gltf_unlit(tmp_path, device):
    """Factor times texture times vertex color; maps and emission are fallbacks for readers without the extension."""
    writer = GltfWriter(extensionsUsed=["KHR_materials_unlit"])
    made = writer.primitive([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 1, 2], [1, 3, 2]], material=0)
    made["attributes"]["TEXCOORD_0"] = writer.accessor(np.float32([[0, 0], [1, 0], [0, 1], [1, 1]]))
    made["attributes"]["COLOR_0"] = writer.accessor(np.float32([[0.5, 1, 1]] * 4))
    writer.node(made, name="r")
    file = io.BytesIO()
    Image.fromarray(np.full((2, 2, 3), 200, np.uint8)).save(file, "PNG")
    writer.content["images"] = [{"bufferView": writer.view(file.getvalue()), "mimeType": "image/png"}]
    writer.content["textures"] = [{"source": 0}]
    texture, factor = {"index": 0}, [0.8, 0.25, 1, 1]
    writer.content["materials"] = [
        {
            "pbrMetallicRoughness": {"baseColorFactor": factor, "baseColorTexture": texture, "metallicFactor": 0},
            "normalTexture": texture,
            "emissiveTexture": texture,
            "emissiveFactor": [1, 1, 1],
            "extensions": {"KHR_materials_unlit": {}},
        }
    ]
    (tmp_path / "a.glb").write_bytes(writer.bytes())
    scene = wv.Scene.load(tmp_path / "a.glb", up="y", device=device)
    (material,) = scene["r"].appearance.materials
    assert material.shading == "unlit" and material.normal_texture is None and material.emissive_texture is None
    linear = to_linear(200 / 255) * np.array(factor[:3]) * [0.5, 1, 1]
    wanted = 255 * reference_pbr.converted(np.array([*linear, 1.0]), "linear", "srgb")[:3]
    for eye, lights in itertools.product(((0.5, 0.5, 3), (2.5, 0.5, 2)), (scene.lights, LINEAR)):
        scene.lights = lights
        pose = wv.look_at(eye, (0.5, 0.5, 0), up="y")
        views = wv.render(scene, wv.Camera.from_fov(4, 3, hfov=0.1), pose, outputs=("color", "albedo"))
        assert np.abs(views.color.numpy() - wanted).max() <= 1
        assert np.abs(views.albedo.numpy() - wanted).max() <= 1
