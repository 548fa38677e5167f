# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Soft shadows and ambient occlusion, compared with double precision and with fractions known in closed form."""

from dataclasses import replace

import numpy as np
import pytest
import reference_shading
import reference_shadows
import trimesh
import warp as wp

import warpvis as wv
from warpvis.errors import SceneError
from warpvis.rendering._computed import Frame
from warpvis.rendering._shadows import cast_occlusion, cast_shadows
from warpvis.rendering.casters.base import Scratch
from warpvis.scene.light_samples import CLASSES, direction_samples, sphere_samples
from warpvis.scene.lights import AmbientOcclusion, Light
from warpvis.scene.materials import Material
from warpvis.scene.solids import capsule, sphere
from warpvis.scene.worlds import parse_worlds

CAMERA = wv.Camera.from_fov(34, 21, hfov=0.9)
POSES = np.stack([wv.look_at((2.2, -2.6, 1.8), (0.0, 0.2, 0.1)), wv.look_at((-1.5, -2.0, 2.5), (0.2, 0.1, 0.0))])
LIGHTS = (
    Light("ambient", ambient=(0.3, 0.2, 0.3)),
    Light("directional", direction=(0.5, 0.3, -1.0), color=(0.3, 0.3, 0.3), radius=0.1, shadow_samples=7),
    Light("point", position=(-1.0, -1.5, 1.4), color=(0.3, 0.2, 0.2), radius=0.3),
    Light("spot", position=(1.5, 1.2, 2.0), direction=(-1.4, -1.0, -2.0), outer_angle=0.5, radius=0.2),
    Light("point", position=(0.4, -0.9, 2.0), color=(0.1, 0.1, 0.2)),
)
NEEDS = ("points", "normals", "segmentation", "faces", "color")
QUAD, TWO = np.array([(-1.0, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]), np.array([(0, 1, 2), (0, 2, 3)])
MATERIAL = Material(base_color=(0.7, 0.6, 0.5))


def table(device):
    """Return a floor with static and movable meshes and solids on it."""
    scene = wv.Scene(device=device)
    for name, shape, place, movable in (
        ("floor", trimesh.creation.box((6, 6, 0.1)), (0, 0, -0.6), False),
        ("ring", trimesh.creation.torus(0.5, 0.16, 24, 12), (0.3, 0.5, -0.3), False),
        ("box", trimesh.creation.box((0.3, 0.5, 0.7)), (-0.6, 0, -0.1), True),
        ("ball", sphere(0.25), (0.5, -0.4, 0.1), True),
        ("capsule", capsule(0.12, 0.3), (0.1, -0.9, 0.0), True),
    ):
        scene.add(shape, name=name, pose=(*place, 0, 0, 0, 1), movable=movable, appearance=MATERIAL)
    scene.lights = LIGHTS
    return scene


def cast(scene, poses, caster, cast_images, camera=CAMERA, threads=2, **worlds):
    """Return the result of a function of a frame, and the views of the scene."""
    views = wv.render(scene, camera, poses, outputs=NEEDS, caster=caster, shadows=False, **worlds)
    images = {name: getattr(views, name) for name in NEEDS[:-1]}
    device = scene.device
    place = wp.array(poses.astype(np.float32), dtype=wp.transform, device=device)
    parsed = parse_worlds(scene, len(poses), None, np.zeros(len(poses), dtype=np.int32), worlds.get("exclude"))
    return cast_images(Frame(scene, camera, place, parsed, images, threads), caster, Scratch(device)).numpy(), views


@pytest.mark.smoke("*-packets")
@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_soft_shadows_match_double_precision(caster, device):
    scene = table(device)
    shadows, views = cast(scene, POSES, caster, cast_shadows, exclude=["capsule"])
    places = POSES[:, :3].astype(np.float64)
    references = [reference_shadows.ShadowReference(scene, excluded={4})] * len(POSES)
    packets, rays = reference_shadows.cast_soft_shadow_packets, reference_shadows.cast_soft_shadow_rays
    expected = (packets if caster == "packets" else rays)(LIGHTS, references, places, views)
    assert (shadows[:3] != expected[:3]).mean() < 0.003  # rays through edges
    assert np.abs(shadows[:3].astype(int) - expected[:3]).mean() < 0.05
    partly = (shadows > 0) & (shadows < 255)
    assert (partly[:3].reshape(3, -1).mean(axis=1) > 0.02).all() and not partly[3].any()
    hard = reference_shadows.cast_shadow_rays(LIGHTS, references, places, views)
    assert (shadows[3] != hard[3]).mean() < 0.001
    renderer = wv.Renderer(scene, CAMERA, outputs=NEEDS, caster=caster)
    color = renderer.render(POSES, exclude=["capsule"]).color.numpy()
    shaded = reference_shading.shade_lit_colors(LIGHTS, [MATERIAL] * len(scene), POSES, views, shadows=shadows)
    assert np.abs(color - shaded).max() <= 1


@pytest.mark.smoke("*-packets")
@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_occlusion_matches_double_precision(caster, device):
    scene, occlusion = table(device), AmbientOcclusion(0.7, samples=11)
    fraction, views = cast(scene, POSES, caster, lambda frame, *given: cast_occlusion(frame, occlusion, *given))
    references = [reference_shadows.ShadowReference(scene)] * len(POSES)
    packets, rays = reference_shadows.cast_occlusion_packets, reference_shadows.cast_occlusion_rays
    expected = (packets if caster == "packets" else rays)(occlusion, references, POSES[:, :3].astype(np.float64), views)
    errors = np.abs(fraction.astype(int) - expected)
    assert (errors > 1).mean() < 0.005 and errors.mean() < 0.1
    assert 0.1 < (fraction < 200).mean() < 0.9
    scene.lights = LIGHTS[:1]
    shown = wv.render(scene, CAMERA, POSES, outputs=NEEDS, caster=caster, ambient_occlusion=occlusion).color.numpy()
    seen = views.segmentation.numpy() >= 0
    wanted = 255 * 0.3 * 0.7 * fraction / 255
    assert np.abs(shown[..., 0] - wanted)[seen].max() <= 1


def test_any_number_of_threads_and_objects_gives_the_same_bytes():
    """More movable objects than fit in one group of boxes; odd image sizes; lists of points."""
    scene = table("cpu")
    ball = trimesh.creation.icosphere(0, 0.04)
    for number, place in enumerate(np.random.default_rng(2).uniform(-1, 1, (530, 3))):
        scene.add(ball, name=f"{number}", pose=(*place, 0, 0, 0, 1), movable=True)
    options = {"outputs": ("color",), "ambient_occlusion": AmbientOcclusion(0.5, samples=3)}
    scene.lights = [replace(light, shadow_samples=3) for light in LIGHTS]
    pictures = [wv.Renderer(scene, CAMERA, threads=n, **options).render(POSES).color.numpy() for n in (1, 3)]
    np.testing.assert_array_equal(*pictures)
    rays = wv.render(scene, CAMERA, POSES, caster="rays", **options).color.numpy().astype(int)
    assert (np.abs(rays - pictures[0]) > 1).mean() < 0.01


def segment(offset):
    """Return the fraction of a unit disk beyond a line at a distance from its center."""
    offset = np.clip(offset, -1, 1)
    return (np.arccos(offset) - offset * np.sqrt(1 - offset**2)) / np.pi


@pytest.mark.parametrize("kind", ["point", "spot", "directional"])
def test_half_covered_light_matches_closed_form(kind, device):
    """A plate whose edge crosses the disk of a light covers the segment beyond the edge."""
    scene = wv.Scene(device=device)
    scene.add((QUAD * 3, TWO), name="floor")
    scene.add((QUAD * (1.5, 3, 1) + (1.5, 0, 1.0), TWO), name="plate")
    height, radius = 40.0, 2.0
    if kind == "directional":
        light = Light(kind, radius=0.05, shadow_samples=64)
    else:
        light = Light(kind, position=(0, 0, height), radius=radius, outer_angle=1.0, shadow_samples=64)
    scene.lights = (light,)
    camera = wv.Camera.from_fov(160, 120, hfov=0.8)
    pose = np.array([wv.look_at((-0.6, 0.0, 0.7), (0.0, 0.0, 0.0))])
    shadows, views = cast(scene, pose, "packets", cast_shadows, camera)
    points = views.points.numpy()[0]
    floor = views.segmentation.numpy()[0] == 0
    # The ray from x to the light's point at X crosses the plate, at x + (X - x) / height, if that is positive.
    x = points[..., 0]
    expected = segment(x * (height - 1) / radius) if kind != "directional" else segment(x / np.tan(0.05))
    errors = np.where(floor, shadows[0, 0] / 255 - expected, 0.0)
    assert floor.mean() > 0.4 and (floor & (expected > 0.05) & (expected < 0.95)).sum() > 800
    assert np.abs(errors).max() < 0.07
    smooth = errors.reshape(30, 4, 40, 4).mean(axis=(1, 3))
    assert np.abs(smooth).max() < 0.02 and np.abs(errors).mean() < 0.01


def test_occlusion_beside_a_wall_matches_closed_form(device):
    """A wall at the distance a blocks the directions with a sine of at least a / distance toward it."""
    scene = wv.Scene(device=device)
    scene.add((QUAD * 30, TWO), name="floor")
    wall = np.array([(0, -30, 0), (0, 30, 0), (0, 30, 30), (0, -30, 30)], dtype=float)
    scene.add((wall, TWO), name="wall")
    scene.lights = (Light("ambient", ambient=(1, 1, 1)),)
    camera, distance = wv.Camera.from_fov(160, 120, hfov=0.9), 2.0
    pose = np.array([wv.look_at((2.5, -1.0, 2.0), (0.9, 0.3, 0.0))])
    occlusion = AmbientOcclusion(distance, samples=256)
    fraction, views = cast(
        scene, pose, "packets", lambda frame, *given: cast_occlusion(frame, occlusion, *given), camera
    )
    floor = views.segmentation.numpy()[0] == 0
    expected = 1 - segment(views.points.numpy()[0, ..., 0] / distance)
    errors = np.where(floor, fraction[0] / 255 - expected, 0.0)
    assert floor.mean() > 0.5 and np.ptp(expected[floor]) > 0.4
    assert np.abs(errors).max() < 0.06
    assert np.abs(errors.reshape(30, 4, 40, 4).mean(axis=(1, 3))).max() < 0.015


def test_surfaces_behind_glass_receive_all_ambient_light(device):
    scene = table(device)
    scene.lights = LIGHTS[:1]
    before = wv.render(scene, CAMERA, POSES, outputs=NEEDS)
    glass = Material(base_color=(0, 0, 0, 0.5), alpha_mode="blend")
    scene.add((QUAD * 0.5 + (0.4, -0.6, 0.5), TWO), name="pane", appearance=glass)
    views = wv.render(scene, CAMERA, POSES, outputs=NEEDS, ambient_occlusion=AmbientOcclusion(0.7, samples=5))
    seen = views.segmentation.numpy() == len(scene) - 1
    assert seen.sum() > 20
    assert np.abs(views.color.numpy()[seen] - before.color.numpy()[seen] / 2).max() <= 1


def test_samples_are_uniform():
    """Points of a light look like a uniform disk from all sides, and directions are uniform on the sphere."""
    points = sphere_samples(64).reshape(-1, 3).astype(np.float64)
    assert points.shape == (64 * CLASSES, 3)
    for axis in np.random.default_rng(5).normal(size=(20, 3)):
        axis /= np.linalg.norm(axis)
        across = points - np.outer(points @ axis, axis)
        square = np.sort((across**2).sum(axis=1))
        assert np.abs(square - (np.arange(len(square)) + 0.5) / len(square)).max() < 0.06
        side = across @ np.cross(axis, (0.3, 0.5, -0.8))
        assert abs((side > 0).mean() - 0.5) < 0.03
    directions = direction_samples(64).reshape(-1, 3).astype(np.float64)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(directions.T @ directions / len(directions), np.eye(3) / 3, atol=0.01)
    assert len({tuple(row) for row in sphere_samples(1)[:, 0].tolist()}) == CLASSES


def test_invalid_options_are_named(device):
    for options, message in (
        ({"radius": -1.0}, "radius of a light must be"),
        ({"radius": 2.0}, "radius of a light must be less than pi / 2, in radians, got 2"),
        ({"shadow_samples": 0}, "shadow_samples of a light must be a whole number from 1 up, got 0"),
        ({"shadow_samples": 5000}, "shadow_samples of a light must be at most 1024, got 5000"),
    ):
        with pytest.raises(SceneError, match=message):
            Light(**options)
    with pytest.raises(SceneError, match="distance of ambient occlusion must be greater than 0"):
        AmbientOcclusion(0.0)
    with pytest.raises(SceneError, match="ambient_occlusion must be an AmbientOcclusion or None, got float"):
        wv.Renderer(table(device), CAMERA, ambient_occlusion=0.5)
