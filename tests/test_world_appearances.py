# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors, materials, lights and backgrounds that differ between worlds, compared with scenes that have them."""

from dataclasses import replace

import numpy as np
import pytest
import reference_shading
import trimesh
import warp as wp

import warpvis as wv
from warpvis.errors import ArrayError, SceneError
from warpvis.scene.lights import Background, Light
from warpvis.scene.materials import Appearance, Material, Texture
from warpvis.scene.world_appearances import WorldAppearances

CAMERA = wv.Camera.from_fov(32, 24, hfov=0.9)
POSE = wv.look_at((2.2, -2.6, 1.8), (0.0, 0.2, 0.1))
GLOSSY = Material(base_color=(0.7, 0.5, 0.3), specular=(0.5, 0.6, 0.7), shininess=12.0, emission=(0.02, 0.0, 0.05))
MATT = Material(base_color=(0.3, 0.6, 0.8), color_space="linear")
LIGHTS = (
    Light("headlight", color=(0.6, 0.5, 0.4), ambient=(0.1, 0.1, 0.1)),
    Light("directional", direction=(0.3, 0.5, -1.0), color=(0.8, 0.7, 0.9), intensity=0.9),
    Light("point", position=(1.0, -1.5, 1.4), attenuation=(0.5, 0.2, 0.1), specular=(0.4, 0.4, 0.4)),
)
OUTPUTS = ("color", "albedo", "points", "normals", "segmentation")
WORLDS = 3
FIELDS = {
    "light_positions": lambda rng: rng.uniform(0.5, 1.5, (WORLDS, 3, 3)) * [1, -1, 1],
    "light_directions": lambda rng: rng.uniform(-1, 1, (WORLDS, 3, 3)) - [0, 0, 2],
    "light_colors": lambda rng: rng.uniform(0, 1, (WORLDS, 3, 3)),
    "light_ambients": lambda rng: rng.uniform(0, 0.3, (WORLDS, 3, 3)),
    "light_speculars": lambda rng: rng.uniform(0, 1, (WORLDS, 3, 3)),
    "light_intensities": lambda rng: rng.uniform(0, 1, (WORLDS, 3)),
}


def two_boxes(device, *, movable=False, looks=(GLOSSY, MATT)):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((1.5, 1.2, 0.9)), name="box", appearance=looks[0], movable=movable)
    scene.add(trimesh.creation.box((6, 6, 0.1)), name="floor", pose=(0, 0, -0.6, 0, 0, 0, 1), appearance=looks[1])
    scene.lights = LIGHTS
    return scene


@pytest.mark.parametrize(
    ("names", "space"),
    [*(((name,), "srgb") for name in FIELDS), (("light_colors",), "linear"), (tuple(FIELDS), "linear")],
    ids=lambda value: value if isinstance(value, str) else "-".join(value[:2]),
)
def test_lights_of_worlds_match_reference(names, space, device):
    rng, scene = np.random.default_rng(5), two_boxes(device)
    if space == "linear":  # one linear light makes all of them linear
        scene.lights = (*LIGHTS[:2], replace(LIGHTS[2], color_space="linear"))
    fields = {name: FIELDS[name](rng).astype(np.float32) for name in names}
    poses = np.tile(POSE, (WORLDS, 1))
    look = WorldAppearances(**fields)
    views = wv.render(scene, CAMERA, poses, outputs=OUTPUTS, appearances=look, shadows=False)
    lights = reference_shading.write_lights(scene.lights, WORLDS, fields)
    expected = reference_shading.shade_lit_colors(lights, (GLOSSY, MATT), poses, views)
    color = views.color.numpy()
    assert np.abs(color - expected).max() <= 1
    assert (color[0] != color[1]).any() and (color[1] != color[2]).any()


def test_worlds_equal_scenes_with_their_appearances(device):
    """Every world has the bytes of a scene that was made with its colors, materials, lights and background."""
    rng = np.random.default_rng(6)
    image = Texture(rng.integers(0, 255, (8, 8, 3), dtype=np.uint8))
    palette = [
        Material(base_color=(0.9, 0.8, 0.7), texture=image, shininess=5.0, specular=(0.2, 0.3, 0.4)),
        Material(base_color=(0.2, 0.5, 0.1), color_space="linear"),
        Material(texture=Texture(np.concatenate([image.image] * 6)), projection="cube"),
    ]
    box = trimesh.creation.box((1.5, 1.2, 0.9))
    uv = rng.uniform(0, 2, (len(box.faces), 3, 2))
    own = Appearance((GLOSSY,), uv=uv)
    scene = two_boxes(device, movable=True, looks=(own, MATT))
    colors = rng.uniform(0.1, 1, (4, 2, 4)).astype(np.float32)
    colors[1, 0] = colors[2, 1] = np.nan
    materials = np.array([[-1, 0], [0, 1], [2, 2], [1, -1]])
    backgrounds = rng.uniform(0, 1, (4, 3)).astype(np.float32)
    intensities = rng.uniform(0, 1, (4, 3)).astype(np.float32)
    moved = np.tile(np.array([0, 0, 0, 0, 0, 0, 1.0]), (4, 1, 1))
    moved[:, 0, 0] = np.linspace(0, 0.4, 4)
    look = {"object_colors": colors, "object_materials": materials, "materials": palette}
    look |= {"backgrounds": backgrounds, "light_intensities": intensities}
    index = [2, 0, 3, 1, 2]
    poses = np.tile(wv.look_at((2.2, -2.6, 1.8), (0, 0, 0.8)), (5, 1))
    renderer = wv.Renderer(scene, CAMERA, outputs=("color", "albedo"))
    views = renderer.render(poses, object_poses=moved, world_index=index, appearances=WorldAppearances(**look))
    for view, world in enumerate(index):
        looks = []
        for k, first in enumerate((own, Appearance((MATT,)))):
            material = first.materials[0] if materials[world, k] < 0 else palette[materials[world, k]]
            if not np.isnan(colors[world, k, 0]):
                color = colors[world, k].astype(np.float64)
                if material.color_space == "linear":
                    color[:3] = reference_shading.to_linear(color[:3])
                material = replace(material, base_color=tuple(color))
            looks.append(replace(first, materials=(material,)))
        single = two_boxes(device, movable=True, looks=looks)
        single.lights = [
            replace(light, intensity=float(row)) for light, row in zip(LIGHTS, intensities[world], strict=True)
        ]
        single.background = Background(tuple(backgrounds[world].tolist()))
        expected = wv.render(single, CAMERA, poses[view], outputs=("color", "albedo"), object_poses=moved[world])
        for name in ("color", "albedo"):
            found = getattr(views, name).numpy()[view].astype(int)
            assert np.abs(found - getattr(expected, name).numpy()[0]).max() <= 1, (name, view)
            assert len(np.unique(found.reshape(-1, 3), axis=0)) > 2


@pytest.mark.parametrize("movable", [False, True])
def test_views_are_split_by_world(movable, device):
    """A large call that is rendered in parts, and views of any world, have the images of single worlds."""
    rng, scene = np.random.default_rng(7), two_boxes(device, movable=movable)
    colors = rng.uniform(0, 1, (6, 2, 3))
    look = WorldAppearances(object_colors=colors, light_colors=rng.uniform(0, 1, (6, 3, 3)))
    renderer = wv.Renderer(scene, CAMERA, outputs=("color",))
    whole = renderer.render(np.tile(POSE, (6, 1)), appearances=look).color.numpy()
    assert all((whole[k] != whole[k + 1]).any() for k in range(5))
    some = renderer.render(np.tile(POSE, (4, 1)), appearances=look, world_index=[5, 0, 0, 3]).color.numpy()
    np.testing.assert_array_equal(some, whole[[5, 0, 0, 3]])
    views = renderer._view_batch(
        renderer._caster.parse_poses(np.tile(POSE, (6, 1)), "opencv"), None, (None, None, None), look
    )
    part = wv.Views(color=wp.zeros((2, 24, 32), dtype=wp.vec3ub, device=device))
    renderer._run(views.part(slice(2, 4)), {"color": part.color})
    np.testing.assert_array_equal(part.color.numpy(), whole[2:4])
    points = np.tile([[[16.5, 12.5], [3.5, 4.5]]], (6, 1, 1))
    at = renderer.render_at(np.tile(POSE, (6, 1)), points, appearances=look).color.numpy()
    np.testing.assert_array_equal(at, whole[:, [12, 4], [16, 3]])


def test_device_arrays_equal_host_arrays(device):
    rng, scene = np.random.default_rng(8), two_boxes(device)
    palette = [Material(base_color=(0.9, 0.1, 0.1)), Material(base_color=(0.1, 0.9, 0.1), shininess=3.0)]
    host = {
        "object_colors": rng.uniform(0, 1, (3, 2, 4)).astype(np.float32),
        "object_materials": np.array([[0, -1], [1, 0], [-1, 1]], dtype=np.int32),
        "light_positions": rng.uniform(0, 1, (3, 3, 3)).astype(np.float32),
        "light_intensities": rng.uniform(0, 1, (1, 3)).astype(np.float32),
    }
    types = {"object_colors": wp.vec4, "light_positions": wp.vec3}
    shared = {
        name: wp.array(rows, dtype=types.get(name, wp.int32 if rows.dtype == np.int32 else wp.float32), device=device)
        for name, rows in host.items()
    }
    poses = np.tile(POSE, (3, 1))
    images = [
        wv.render(scene, CAMERA, poses, outputs=("color",), appearances=WorldAppearances(materials=palette, **arrays))
        for arrays in (host, shared)
    ]
    np.testing.assert_array_equal(images[0].color.numpy(), images[1].color.numpy())


def test_entries_match_reference(device):
    from warpvis.kernels.shading.world_appearances import write_entries

    rng = np.random.default_rng(9)
    materials = rng.integers(-3, 6, (7, 5)).astype(np.int32)
    entries = rng.integers(0, 99, (5, 4)).astype(np.int32)
    found = wp.zeros((7, 5), dtype=wp.int32, device=device)
    inputs = [wp.array(rows, dtype=wp.int32, device=device) for rows in (materials, entries)]
    wp.launch(write_entries, (7, 5), [*inputs, found], device=device)
    np.testing.assert_array_equal(found.numpy(), reference_shading.write_entries(materials, entries))


def test_depth_does_not_depend_on_appearances(device):
    scene = two_boxes(device)
    look = WorldAppearances(object_colors=np.random.default_rng(1).uniform(0, 1, (2, 2, 3)))
    poses = np.tile(POSE, (2, 1))
    plain = wv.render(scene, CAMERA, poses, outputs=("depth", "segmentation"))
    views = wv.render(scene, CAMERA, poses, outputs=("depth", "segmentation", "color"), appearances=look)
    for name in ("depth", "segmentation"):
        np.testing.assert_array_equal(getattr(views, name).numpy(), getattr(plain, name).numpy())


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"object_colors": np.full((2, 2, 3), 1.5)}, "object_colors must be from 0 to 1, or NaN"),
        ({"object_colors": np.zeros((2, 3, 3))}, r"object_colors must have shape \(W, 2, 3 or 4\), got \(2, 3, 3\)"),
        ({"object_colors": np.zeros((2, 2, 5))}, "3 or 4 numbers for each object"),
        ({"object_colors": np.zeros((0, 2, 3))}, "at least one world"),
        ({"object_materials": [[0, 5]], "materials": [MATT]}, "from -1 to 0, indices of materials, got 5 for object 1"),
        ({"object_materials": [[0.0, 0.0]], "materials": [MATT]}, "object_materials must be int32, got float64"),
        ({"light_directions": np.zeros((1, 3, 3))}, "light_directions must be finite and not 0"),
        ({"light_positions": np.full((1, 3, 3), np.nan)}, "light_positions must be at most"),
        ({"light_intensities": [[1.0, -1.0, 0.0]]}, "light_intensities must be finite and at least 0, got -1.0 for"),
        ({"light_colors": np.zeros((1, 2, 3))}, r"light_colors must have shape \(W, 3, 3\)"),
        ({"backgrounds": [[0.0, 0.0, 2.0]]}, r"backgrounds must be from 0 to 1, got \[0.0, 0.0, 2.0\] for world 0"),
        ({"backgrounds": np.zeros((2, 3)), "object_colors": np.zeros((3, 2, 3))}, "backgrounds must have 1 or 3 rows"),
        ({"world_skies": [0, 2], "skies": [Background()] * 2}, "from -1 to 1, indices of skies, got 2 for world 1"),
        ({"world_skies": [[0]], "skies": [Background()]}, r"world_skies must have shape \(W,\), got \(1, 1\)"),
        ({"world_skies": [0.5], "skies": [Background()]}, "world_skies must be int32, got float64"),
        ({"backgrounds": np.zeros((5, 3))}, "appearances have 5 worlds for 2 views"),
    ],
)
def test_bad_arrays_are_refused(arrays, message, device):
    scene = two_boxes(device)
    with pytest.raises(ArrayError, match=message):
        wv.render(scene, CAMERA, np.tile(POSE, (2, 1)), outputs=("color",), appearances=WorldAppearances(**arrays))


def test_bad_appearances_are_refused(device):
    scene = two_boxes(device, movable=True)
    with pytest.raises(ArrayError, match="appearances must be a WorldAppearances, got dict"):
        wv.render(scene, CAMERA, POSE, outputs=("color",), appearances={})
    with pytest.raises(SceneError, match="object_materials require materials="):
        WorldAppearances(object_materials=[[0, 0]])
    with pytest.raises(SceneError, match="world_skies require skies="):
        WorldAppearances(world_skies=[0])
    with pytest.raises(SceneError, match="skies of WorldAppearances must be a list of Background"):
        WorldAppearances(skies=Background())
    with pytest.raises(SceneError, match="must be a list of Material"):
        WorldAppearances(materials=[(1, 0, 0)])
    moved = np.tile(np.array([0, 0, 0, 0, 0, 0, 1.0]), (2, 1, 1))
    with pytest.raises(ArrayError, match="appearances must be of 1 world or of 2, like object_poses, got 3"):
        look = WorldAppearances(backgrounds=np.zeros((3, 3)))
        wv.render(scene, CAMERA, POSE, outputs=("color",), object_poses=moved, appearances=look)
    scene.lights = ()
    with pytest.raises(ArrayError, match="light_colors require lights of the scene"):
        wv.render(scene, CAMERA, POSE, appearances=WorldAppearances(light_colors=np.zeros((1, 0, 3))))
