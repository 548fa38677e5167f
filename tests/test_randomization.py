# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Random appearances: the same for a world in every batch, uniform, within limits, and visible in images."""

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.errors import SceneError
from warpvis.scene.lights import Background, Light
from warpvis.scene.materials import Appearance, Material, Texture
from warpvis.scene.randomization import randomize_appearances

CAMERA = wv.Camera.from_fov(48, 36, hfov=0.9)
POSE = wv.look_at((2.2, -2.6, 1.8), (0.0, 0.2, 0.1))
NOISE = [Texture(np.random.default_rng(k).integers(0, 255, (4, 4, 3), dtype=np.uint8)) for k in range(3)]
ARRAYS = (
    *("object_colors", "object_materials", "light_positions", "light_directions", "light_colors"),
    *("light_intensities", "backgrounds"),
)


def room(device):
    scene, box = wv.Scene(device=device), trimesh.creation.box((0.8, 0.6, 0.5))
    uv = np.tile(np.array([[[0, 0], [1, 0], [0, 1]]]), (12, 1, 1))
    corners = np.array([[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
    scene.add(corners, name="floor", pose=(0, 0, -0.5, 0, 0, 0, 1), appearance=(0.5, 0.5, 0.5))
    scene.add(box, name="box", appearance=Appearance((Material(),), uv=uv))
    scene.add(wv.scene.solids.sphere(0.3), name="ball", pose=(-0.6, 0.8, 0, 0, 0, 0, 1), movable=True)
    scene.lights = [
        Light("directional", direction=(0.3, 0.5, -1.0), color=(0.8, 0.7, 0.9)),
        Light("point", position=(1.0, -1.5, 1.4), ambient=(0.2, 0.2, 0.2)),
    ]
    return scene


def test_draw_of_a_world_does_not_depend_on_others():
    scene = room("cpu")
    whole = randomize_appearances(scene, 40, seed=7, textures=NOISE)
    for worlds in (5, [3], [11, 12, 30, 2], np.arange(39, -1, -1)):
        some = randomize_appearances(scene, worlds, seed=7, textures=NOISE)
        rows = np.arange(worlds) if isinstance(worlds, int) else np.asarray(worlds)
        for name in ARRAYS:
            np.testing.assert_array_equal(getattr(some, name), getattr(whole, name)[rows])
    other = randomize_appearances(scene, 40, seed=8, textures=NOISE)
    for name in ARRAYS:
        found = getattr(whole, name)
        assert len(found) == 40 and not np.array_equal(found, getattr(other, name), equal_nan=True), name
        assert len(np.unique(found.reshape(40, -1), axis=0, equal_nan=False)) > 15, name
    fixed = randomize_appearances(scene, 2, seed=1).object_colors[1, 2]
    np.testing.assert_allclose(fixed, KNOWN, atol=1e-6)  # the same in all versions and on all platforms


KNOWN = (0.7628959, 0.9180694, 0.9719208)


def test_draws_are_uniform_within_limits():
    scene = room("cpu")
    look = randomize_appearances(
        scene,
        4000,
        seed=3,
        colors=(0.2, 0.6),
        textures=NOISE,
        textured=0.25,
        light_intensities=(0.5, 2.0),
        light_colors=(0.4, 1.0),
        light_angle=0.3,
        light_distance=0.1,
        backgrounds=(0.9, 1.0),
    )
    textured = look.object_materials >= 0
    assert np.array_equal(np.isnan(look.object_colors[..., 0]), textured) and abs(textured.mean() - 0.25) < 0.02
    colors = look.object_colors[~textured]
    for rows, low, high in (
        (colors, 0.2, 0.6),
        (look.light_intensities, 0.5, 2.0),
        (look.light_colors / np.array([light.color for light in scene.lights]), 0.4, 1.0),
        (look.light_positions - np.array([light.position for light in scene.lights]), -0.1, 0.1),
        (look.backgrounds, 0.9, 1.0),
    ):
        assert rows.min() >= low - 1e-5 and rows.max() <= high + 1e-5
        assert abs(rows.mean() - (low + high) / 2) < 0.02 * (high - low)
        assert abs(rows.std() - (high - low) / np.sqrt(12)) < 0.02 * (high - low)
    directions = np.array([light.direction for light in scene.lights])
    cosine = np.einsum("wlk,lk->wl", look.light_directions, directions)
    np.testing.assert_allclose(np.linalg.norm(look.light_directions, axis=2), 1, atol=1e-6)
    assert cosine.min() >= np.cos(0.3) - 1e-6  # uniform on the cap: the cosine is uniform
    assert abs(cosine.mean() - (1 + np.cos(0.3)) / 2) < 0.001
    across = look.light_directions - cosine[..., None] * directions
    assert np.abs(across.mean(axis=0)).max() < 0.01


def test_only_chosen_objects_and_fields_change():
    scene = room("cpu")
    look = randomize_appearances(
        scene, 20, seed=1, objects=["b*"], light_intensities=None, light_colors=None, light_angle=0, light_distance=0
    )
    assert np.isnan(look.object_colors[:, 0]).all() and np.isfinite(look.object_colors[:, 1:]).all()
    np.testing.assert_allclose(look.light_intensities, 1)
    for name in ("color", "position", "direction"):
        own = np.array([getattr(light, name) for light in scene.lights])
        np.testing.assert_allclose(getattr(look, f"light_{name}s"), np.tile(own, (20, 1, 1)), atol=1e-6)
    none = randomize_appearances(scene, 2, seed=1, colors=None, backgrounds=None)
    assert none.object_colors is None and none.object_materials is None and none.backgrounds is None


def test_images_show_the_draws(device):
    """Colors and textures of every kind of object show; depth does not depend on them."""
    scene = room(device)
    poses = np.tile(POSE, (8, 1))
    plain = wv.render(scene, CAMERA, poses, outputs=("depth", "segmentation"))
    for share in (0.0, 1.0):
        look = randomize_appearances(scene, 8, seed=5, textures=NOISE, textured=share)
        views = wv.render(scene, CAMERA, poses, outputs=("albedo", "color", "depth"), appearances=look)
        np.testing.assert_array_equal(views.depth.numpy(), plain.depth.numpy())
        albedo, color, seg = views.albedo.numpy(), views.color.numpy(), plain.segmentation.numpy()
        assert all((color[k] != color[k + 1]).any() for k in range(7))
        for world in range(8):
            for index in range(3):
                seen = albedo[world][seg[world] == index].astype(float)
                assert len(seen) > 10
                if share:
                    assert seen.std(axis=0).max() > 20, (world, index)  # the noise of a texture
                else:
                    assert np.abs(seen - look.object_colors[world, index] * 255).max() <= 1
            empty = color[world][seg[world] < 0]
            assert np.abs(empty - look.backgrounds[world] * 255).max() <= 1


def test_skies_of_worlds_are_drawn():
    scene, skies = room("cpu"), [Background(gradient=((0, 0, k / 4), (1, k / 4, 0))) for k in range(4)]
    look = randomize_appearances(scene, 4000, seed=2, skies=skies)
    assert look.backgrounds is None and look.skies == tuple(skies) and look.world_skies.dtype == np.int32
    np.testing.assert_allclose(np.bincount(look.world_skies, minlength=4) / 4000, 0.25, atol=0.03)
    some = randomize_appearances(scene, [1234, 7], seed=2, skies=skies)
    assert some.world_skies.tolist() == look.world_skies[[1234, 7]].tolist()
    assert (randomize_appearances(scene, 4000, seed=3, skies=skies).world_skies != look.world_skies).mean() > 0.6
    np.testing.assert_array_equal(look.light_colors, randomize_appearances(scene, 4000, seed=2).light_colors)
    poses = np.tile(POSE, (3, 1))
    shown = wv.render(
        scene, CAMERA, poses, outputs=("albedo",), appearances=randomize_appearances(scene, 3, seed=2, skies=skies)
    ).albedo.numpy()
    for world, number in enumerate(look.world_skies[:3]):
        scene.background = skies[number]
        plain = wv.render(scene, CAMERA, POSE, outputs=("albedo", "segmentation"))
        empty = plain.segmentation.numpy()[0] < 0
        assert empty.any()
        np.testing.assert_array_equal(shown[world][empty], plain.albedo.numpy()[0][empty])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"worlds": 0}, "worlds must be a whole number from 1 up, got 0"),
        ({"worlds": [-1]}, "worlds must be a number of worlds, or numbers of worlds from 0"),
        ({"worlds": "a"}, "worlds must be a number of worlds"),
        ({"skies": ["sunset"]}, r"skies must be of Background, got \['sunset'\]"),
        ({"seed": -1}, "seed must be a whole number from 0 up, got -1"),
        ({"seed": 1 << 64}, r"seed must be at most 2\^64 - 1"),
        ({"objects": ["chair*"]}, r"objects must be names or patterns of the scene's objects, got 'chair\*'"),
        ({"colors": (0.5, 2.0)}, "colors must be a number from 0 to 1, got 2.0"),
        ({"colors": (0.5, 0.2)}, "colors must be a minimum and a maximum, got 0.5 and 0.2"),
        ({"light_intensities": (1.0,)}, "light_intensities must be a minimum and a maximum"),
        ({"textures": [np.zeros((2, 2, 3))]}, "textures must be of Texture"),
        ({"textured": 2}, "textured must be a number from 0 to 1"),
        ({"light_angle": 4.0}, "light_angle must be a number from 0 to 3.14"),
    ],
)
def test_bad_arguments_are_refused(options, message):
    with pytest.raises(SceneError, match=message):
        randomize_appearances(room("cpu"), **{"worlds": 2, "seed": 1, **options})
