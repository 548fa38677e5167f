# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Materials of the shading "pbr": against a double-precision reference, and facts of appendix B of glTF 2.0."""

from dataclasses import replace

import numpy as np
import pytest
import reference_pbr
import trimesh
from reference_shading import to_linear, to_screen

import warpvis as wv
from warpvis.errors import SceneError
from warpvis.scene.lights import Light
from warpvis.scene.materials import Appearance, Material, Texture

CAMERA = wv.Camera.from_fov(32, 24, hfov=0.9)
POSE = wv.look_at((2.2, -2.6, 1.8), (0.0, 0.2, 0.1))
OUTPUTS = ("color", "points", "normals", "segmentation", "faces")
PBR = Material(color_space="linear", shading="pbr")
GOLD = replace(PBR, base_color=(1.0, 0.7, 0.3), metallic=1.0, roughness=0.35)
PAINT = replace(PBR, base_color=(0.2, 0.4, 0.6), metallic=0.2, roughness=0.5, emission=(0.02, 0.0, 0.05))
RNG = np.random.default_rng(5)
NOISE = {name: RNG.integers(0, 256, (8, 8, 3), dtype=np.uint8) for name in reference_pbr.MAPS}
NOISE["normal_texture"][..., 2] = RNG.integers(180, 256, (8, 8))
MAPPED = replace(
    PBR,
    emission=(0.3, 0.2, 0.1),
    metallic=0.9,
    roughness=0.8,
    normal_scale=0.7,
    occlusion_strength=0.6,
    ambient_strength=0.8,
    **{name: Texture(image, color_space="srgb" if "emi" in name else "linear") for name, image in NOISE.items()},
)
SUN = Light("directional", direction=(0.2, 0.6, -1), color_space="linear", falloff="gltf", intensity=2.5)
AMBIENT = Light("ambient", ambient=(0.3, 0.4, 0.5), color_space="linear")
MIXES = {
    "ambient": (AMBIENT,),
    "headlight": (Light("headlight", color=(0.6, 0.5, 0.4), ambient=(0.1, 0.2, 0.1), color_space="linear"),),
    "sun": (SUN,),
    "lamps": (
        Light("point", position=(1.0, -1.5, 1.4), attenuation=(0.5, 0.2, 0.1), color_space="linear"),
        Light("spot", position=(1.5, -1.5, 1.5), direction=(-1.5, 1.5, -1.5), outer_angle=0.6, falloff="webots"),
    ),
    "display": (Light("directional", direction=(0.3, 0.5, -1.0), ambient=(0.1, 0.1, 0.1), intensity=0.6),),
    "all": (SUN, AMBIENT, Light("point", position=(0, -2, 2), color_space="linear", intensity=0.5)),
}


def scene_of(device, material, floor=PAINT):
    """Return a ball with normals and a floor, both with texture coordinates."""
    scene, ball = wv.Scene(device=device), trimesh.creation.icosphere(2, 0.7)
    uv = np.stack([3 * ball.vertices[:, 0], 2 * ball.vertices[:, 1] + ball.vertices[:, 2]], axis=1)
    scene.add(ball, name="ball", appearance=Appearance((material,), uv=uv, normals=ball.vertices))
    plate = trimesh.creation.box((6, 6, 0.1))
    look = Appearance((floor,), uv=plate.vertices[:, :2])
    scene.add(plate, name="floor", pose=(0, 0, -0.8, 0, 0, 0, 1), appearance=look)
    return scene


def render(scene, camera=CAMERA, pose=POSE, **options):
    return wv.render(scene, camera, pose, outputs=OUTPUTS, **options)


@pytest.mark.smoke("*-all-mapped", "*-display-gold", "*-ambient-mapped", "*-lamps-gold", "*-all-webots")
@pytest.mark.parametrize("kind", ["gold", "mapped", "webots"])
@pytest.mark.parametrize("name", MIXES)
def test_colors_match_reference(name, kind, device):
    webots = {"shading": "webots", "tone_mapped": True}
    material = {"gold": GOLD, "mapped": MAPPED, "webots": replace(MAPPED, metallic=0.3, **webots)}[kind]
    floor = {"gold": PAINT, "mapped": MAPPED, "webots": replace(PAINT, **webots)}[kind]
    scene = scene_of(device, material, floor=floor)
    scene.lights = MIXES[name]
    views = render(scene, shadows=False)
    expected = reference_pbr.shade_pbr_colors(scene, CAMERA, POSE, views)
    assert np.abs(views.color.numpy() - expected).max() <= 1
    assert len(np.unique(views.color.numpy().reshape(-1, 3), axis=0)) > 20


def test_shadows_match_reference(device):
    """Only direct light is blocked; the floor next to it is Blinn-Phong."""
    phong = Material(base_color=(0.5, 0.6, 0.4), specular=(0.3, 0.3, 0.3), shininess=9.0)
    scene = scene_of(device, MAPPED, floor=phong)
    scene.lights = (SUN, AMBIENT)
    lit = render(scene, shadows=False).color.numpy()
    views = render(scene)
    differs = (np.abs(lit.astype(int) - views.color.numpy()) > 2).any(axis=-1)
    is_floor = views.segmentation.numpy() == 1
    assert 10 < differs[is_floor].sum() < is_floor.sum() / 2
    shadows = np.where(differs, 0, 255)[None]
    expected = reference_pbr.shade_pbr_colors(scene, CAMERA, POSE, views, shadows)
    assert np.abs(views.color.numpy() - expected)[is_floor].max() <= 1


def plate_color(device, material, lights, *, uv=None, normals=None, up=(0, 0, 1), size=(4, 4), height=2.0, **options):
    """Return the linear color of the center of a plate at the origin, seen from above, before rounding to bytes."""
    scene = wv.Scene(device=device)
    rows = np.array([[-size[0], -size[1], 0], [size[0], -size[1], 0], [size[0], size[1], 0], [-size[0], size[1], 0]])
    turn = trimesh.geometry.align_vectors((0, 0, 1), up)[:3, :3]
    look = Appearance((material,), uv=uv, normals=None if normals is None else np.tile(normals, (4, 1)))
    scene.add((rows / 2 @ turn.T, np.array([[0, 1, 2], [0, 2, 3]])), name="plate", appearance=look, **options)
    scene.lights = lights
    camera = wv.Camera.from_fov(3, 3, hfov=1e-3)
    pose = wv.look_at((0.02, 0.01, height), (0.02, 0.01, 0), up=(0, 1, 0))
    poses = {"object_poses": [[options["pose"]]]} if options.get("movable") else {}
    color = wv.render(scene, camera, pose, outputs=("color",), **poses).color.numpy()[0, 1, 1]
    return to_linear(color / 255.0)


def test_reflection_along_the_normal(device):
    """Light and camera at the normal: diffuse (1 - f) c / pi, and specular f / (4 pi alpha^2)."""
    down = replace(SUN, direction=(0, 0, -1), intensity=1.5)
    for metallic, roughness in ((0.0, 1.0), (0.0, 0.6), (1.0, 0.9), (1.0, 0.7), (0.5, 0.8)):
        base = np.array([0.8, 0.5, 0.2])
        color = plate_color(
            device, replace(PBR, base_color=tuple(base), metallic=metallic, roughness=roughness), (down,)
        )
        facing = 0.04 * (1 - metallic) + base * metallic
        diffuse = (1 - facing) * base * (1 - metallic) / np.pi
        wanted = 1.5 * (diffuse + facing / (4 * np.pi * roughness**4))
        assert np.abs(to_screen(color) - to_screen(np.minimum(wanted, 1))).max() * 255 <= 1


def test_a_metal_reflects_its_color(device):
    """At normal incidence by its base color; a dielectric reflects white light by 0.04, and scatters its color."""
    sun = replace(SUN, direction=(0, 0, -1), intensity=0.5)
    gold = plate_color(device, replace(GOLD, roughness=0.5), (sun,))
    np.testing.assert_allclose(gold / gold[0], [1.0, 0.7, 0.3], atol=0.02)
    black = replace(PBR, base_color=(0, 0, 0), roughness=0.5)
    np.testing.assert_allclose(plate_color(device, black, (replace(sun, intensity=5.0),)) / gold[0], 0.4, atol=0.02)


def test_uniform_light_is_conserved(device):
    """No surface reflects more than it receives, and a smooth white metal nearly all."""
    light = (Light("ambient", ambient=(0.5, 0.5, 0.5), color_space="linear"),)
    for metallic in (0.0, 1.0):
        for roughness in (0.0, 0.3, 0.6, 1.0):
            material = replace(PBR, metallic=metallic, roughness=roughness)
            for place in ((0, 0, 2.0), (2.0, 0, 0.3)):
                scene = wv.Scene(device=device)
                scene.add(trimesh.creation.box((40, 40, 0.1)), name="a", appearance=material)
                scene.lights = light
                pose = wv.look_at(place, (0, 0, 0.05), up=(0, 1, 0))
                views = wv.render(scene, wv.Camera.from_fov(1, 1, hfov=0.01), pose, outputs=("color",))
                color = to_linear(views.color.numpy() / 255.0)
                cosine = (place[2] - 0.05) / np.linalg.norm(np.array(place) - (0, 0, 0.05))
                part = reference_pbr.uniform_reflection(np.ones(3), metallic, roughness, cosine)
                assert np.abs(color - 0.5 * part).max() < 0.005
                assert color.max() < 0.505
                assert color.min() > 0.48 or (metallic and roughness)


def tilted_map(angle, toward):
    """Return a normal map of one direction, and that direction after rounding to bytes."""
    exact = np.array([np.sin(angle) * np.cos(toward), np.sin(angle) * np.sin(toward), np.cos(angle)])
    stored = np.round((exact + 1) / 2 * 255).astype(np.uint8)
    value = stored / 255 * 2 - 1
    return Texture(np.tile(stored, (2, 2, 1)), color_space="linear"), value / np.linalg.norm(value)


UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
SIDE_SUN = (replace(SUN, direction=(-0.5, 0.3, -1), intensity=2.0),)


@pytest.mark.parametrize("angle", [0.3, -0.5])
def test_a_normal_map_equals_a_tilted_plate(angle, device):
    """At the same point, lit and seen from the same directions, a tilted plate has the same color."""
    texture, normal = tilted_map(angle, 0.0)
    glossy = replace(PAINT, roughness=0.4)
    flat = plate_color(device, glossy, SIDE_SUN)
    mapped = plate_color(device, replace(glossy, normal_texture=texture), SIDE_SUN, uv=UV)
    far = {"height": 200.0}
    camera_far = plate_color(device, replace(glossy, normal_texture=texture), SIDE_SUN, uv=UV, **far)
    tilted = plate_color(device, glossy, SIDE_SUN, up=normal, **far)
    assert np.abs(to_screen(camera_far) - to_screen(tilted)).max() * 255 <= 1
    assert np.abs(to_screen(mapped) - to_screen(flat)).max() * 255 > 10


@pytest.mark.parametrize("kind", ["plain", "rotated", "mirrored", "stretched", "scaled", "movable", "behind"])
def test_normal_maps_follow_texture_coordinates(kind, device):
    """x of a map is along u and y along v, wherever texture coordinates point."""
    texture, (x, y, z) = tilted_map(0.4, 0.7)
    material, options, uv = replace(PAINT, normal_texture=texture, roughness=0.4), {}, UV
    normal = np.array([x, y, z])
    if kind == "rotated":  # u along +y, v along -x
        uv, normal = np.stack([UV[:, 1], 1 - UV[:, 0]], axis=1), np.array([-y, x, z])
    elif kind == "mirrored":
        uv, normal = np.stack([1 - UV[:, 0], UV[:, 1]], axis=1), np.array([-x, y, z])
    elif kind == "stretched":
        uv = 3 * UV * [1, 5] + 0.2
    elif kind == "scaled":
        options["size"] = (2, 6)
    elif kind == "movable":
        options |= {"movable": True, "pose": np.array([0, 0, 0, 0, 0, np.sin(0.25), np.cos(0.25)])}
        c, s = np.cos(0.5), np.sin(0.5)
        normal = np.array([c * x - s * y, s * x + c * y, z])
    plain = replace(PAINT, roughness=0.4)
    lights = SIDE_SUN
    if kind == "behind":  # the surface is turned over as a whole: its normal map, too
        options["height"], lights = -2.0, (replace(SIDE_SUN[0], direction=(-0.5, 0.3, 1)),)
    if kind == "movable":
        normal_in_object = np.array([x, y, z])
        wanted = plate_color(device, plain, lights, normals=normal_in_object, **options)
    else:
        wanted = plate_color(device, plain, lights, normals=normal, **options)
    found = plate_color(device, material, lights, uv=uv, **options)
    assert np.abs(to_screen(found) - to_screen(wanted)).max() * 255 <= 1
    bare = plate_color(device, plain, lights, uv=uv, **options)
    assert np.abs(to_screen(found) - to_screen(bare)).max() * 255 > 10


@pytest.mark.parametrize(("columns", "limits"), [(24, (0.7, 16)), (96, (0.2, 6))])
def test_tangents_of_triangles_are_near_those_of_vertices(columns, limits, device):
    """On a globe, whose tangents of vertices are exact: mean and largest difference of colors."""
    lon, lat = np.meshgrid(np.linspace(0, 2 * np.pi, columns + 1), np.linspace(-1.5, 1.5, columns // 2 + 1))
    vertices = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1).reshape(-1, 3)
    tangents = np.stack([-np.sin(lon), np.cos(lon), 0 * lon], axis=-1).reshape(-1, 3)
    first = np.arange(len(vertices)).reshape(lon.shape)[:-1, :-1].reshape(-1, 1)
    faces = np.concatenate([first + [0, 1, columns + 2], first + [0, columns + 2, columns + 1]])
    phase = np.arange(64) / 64 * 2 * np.pi
    tilts = np.stack([*np.meshgrid(0.5 * np.sin(2 * phase), 0.5 * np.sin(2 * phase)), np.ones((64, 64))], axis=-1)
    tilts = (tilts / np.linalg.norm(tilts, axis=-1, keepdims=True) + 1) / 2
    bumps = Texture(np.round(255 * tilts).astype(np.uint8), color_space="linear")
    uv = np.stack([4 * lon / (2 * np.pi), 2 * lat / np.pi], axis=-1).reshape(-1, 2)
    look = Appearance((replace(GOLD, metallic=0.0, normal_texture=bumps),), uv=uv, normals=vertices)
    scene = wv.Scene(device=device)
    scene.add((vertices, faces), name="globe", appearance=look)
    scene.lights = (SUN,)
    pose = wv.look_at((2.4, -1.2, 0.5), (0, 0, 0))
    camera = wv.Camera.from_fov(40, 30, hfov=0.9)
    views = render(scene, camera, pose, shadows=False)
    found, is_seen = views.color.numpy().astype(float), views.segmentation.numpy() == 0
    assert np.abs(found - reference_pbr.shade_pbr_colors(scene, camera, pose, views)).max() <= 1
    errors = np.abs(found - np.round(reference_pbr.shade_pbr_colors(scene, camera, pose, views, tangents=tangents)))
    assert 0 < errors[is_seen].mean() < limits[0] and errors.max() <= limits[1]


def gray(value, space="linear"):
    return Texture(np.full((2, 2, 3), value, dtype=np.uint8), color_space=space)


def test_occlusion_only_reduces_ambient_light(device):
    sun = (replace(SUN, direction=(0.3, 0.2, -1), intensity=1.0),)
    for strength, share in ((1.0, 0.4), (0.5, 0.7)):
        dark = replace(PAINT, emission=(0, 0, 0), occlusion_texture=gray(102), occlusion_strength=strength)
        bare = replace(dark, occlusion_texture=None)
        np.testing.assert_array_equal(plate_color(device, dark, sun, uv=UV), plate_color(device, bare, sun, uv=UV))
        one, other = (plate_color(device, item, (AMBIENT,), uv=UV) for item in (dark, bare))
        np.testing.assert_allclose(one / other, share, rtol=0.02)


def test_emission_adds_its_map_times_its_factor(device):
    glowing = replace(PAINT, emission=(0.5, 0.2, 0.0), emissive_texture=gray(188, "srgb"))
    bare = replace(glowing, emission=(0, 0, 0))
    for lights in ((SUN,), (AMBIENT,)):
        added = plate_color(device, glowing, lights, uv=UV) - plate_color(device, bare, lights, uv=UV)
        np.testing.assert_allclose(added, to_linear(188 / 255) * np.array([0.5, 0.2, 0.0]), atol=0.006)


def test_maps_are_factors_of_metallic_and_roughness(device):
    """Roughness is green, metallic is blue."""
    texture = Texture(np.tile(np.uint8([0, 153, 204]), (2, 2, 1)), color_space="linear")
    mapped = replace(GOLD, metallic=0.5, roughness=0.75, metallic_roughness_texture=texture)
    plain = replace(GOLD, metallic=0.5 * 0.8, roughness=0.75 * 0.6)
    lights = (*SIDE_SUN, AMBIENT)
    found, wanted = plate_color(device, mapped, lights, uv=UV), plate_color(device, plain, lights, uv=UV)
    assert np.abs(to_screen(found) - to_screen(wanted)).max() * 255 <= 1


def test_webots_squares_the_intensity_of_diffuse_light(device):
    """At normal incidence: I (I 0.96^2 c / pi + 0.04 / (4 pi)) without tone mapping, for a roughness of 1."""
    base = np.array([0.8, 0.5, 0.2])
    material = replace(PBR, base_color=tuple(base), shading="webots")
    for intensity in (0.5, 1.5):
        sun = Light("directional", direction=(0, 0, -1), color_space="linear", intensity=intensity, falloff="webots")
        wanted = intensity * (intensity * 0.96**2 * base + 0.01) / np.pi
        found = plate_color(device, material, (sun,))
        assert np.abs(to_screen(found) - to_screen(wanted)).max() * 255 <= 1


@pytest.mark.parametrize("shading", ["phong", "webots"])
def test_tone_mapping_of_webots(shading, device):
    glow = np.array([0.2, 0.9, 3.0])
    material = replace(PBR, base_color=(0, 0, 0), emission=tuple(glow), shading=shading, tone_mapped=True)
    found = to_screen(plate_color(device, material, (replace(SUN, intensity=0.0),)))
    assert np.abs(found - (1 - np.exp(-glow)) ** (1 / 2.2)).max() * 255 <= 1


def test_phong_ignores_metallic_and_maps(device):
    plain = Material(base_color=(0.4, 0.5, 0.6), specular=(0.4, 0.4, 0.4), shininess=20.0)
    other = replace(plain, metallic=1.0, roughness=0.2, normal_texture=tilted_map(0.5, 0.0)[0])
    found = [plate_color(device, item, SIDE_SUN, uv=UV) for item in (plain, other)]
    np.testing.assert_array_equal(*found)


def test_other_objects_keep_their_colors(device):
    """One pbr object in the scene does not change what others show."""
    colors = []
    for extra in (None, PAINT):
        scene = wv.Scene(device=device)
        look = Material(base_color=(0.7, 0.5, 0.3), specular=(0.5, 0.6, 0.7), shininess=12.0)
        scene.add(trimesh.creation.box((1, 1, 1)), name="box", appearance=look)
        if extra is not None:
            scene.add(trimesh.creation.box((1, 1, 1)), name="hidden", pose=(0, 0, -50, 0, 0, 0, 1), appearance=extra)
        scene.lights = (Light("directional", direction=(0.3, 0.5, -1.0), ambient=(0.1, 0.2, 0.1)),)
        colors.append(wv.render(scene, CAMERA, POSE, outputs=("color",)).color.numpy().astype(int))
    assert np.abs(colors[0] - colors[1]).max() <= 1


def test_worlds_replace_the_base_color(device):
    from warpvis.scene.world_appearances import WorldAppearances

    scene = scene_of(device, replace(GOLD, base_color=(0.2, 0.2, 0.2)))
    scene.lights = (SUN, AMBIENT)
    worlds = WorldAppearances(object_colors=[[[1.0, 0.5, 0.0], [np.nan] * 3]])
    found = wv.render(scene, CAMERA, POSE, outputs=("color",), appearances=worlds).color.numpy()
    other = scene_of(device, replace(GOLD, base_color=tuple(to_linear(np.array([1.0, 0.5, 0.0])))))
    other.lights = scene.lights
    wanted = wv.render(other, CAMERA, POSE, outputs=("color",)).color.numpy()
    assert np.abs(found.astype(int) - wanted).max() <= 1


def test_invalid_shading_is_rejected():
    with pytest.raises(SceneError, match='shading must be "phong", "pbr", "webots" or "unlit", got'):
        Material(shading="toon")
    with pytest.raises(SceneError, match="ambient_strength of a material must be at least 0, got -1"):
        Material(ambient_strength=-1)
