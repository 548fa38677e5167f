# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A scene with shadows, and comparison of shadows with double precision over all surfaces."""

import numpy as np
import pytest
import reference_shadows
import trimesh

import warpvis as wv
from warpvis.rendering import _renderer as rendering
from warpvis.rendering._shadows import cast_shadows
from warpvis.scene.lights import Light
from warpvis.scene.materials import Material
from warpvis.scene.solids import capsule, cylinder, sphere

CAMERA = wv.Camera.from_fov(32, 24, hfov=0.9)
POSES = np.stack([wv.look_at((2.2, -2.6, 1.8), (0.0, 0.2, 0.1)), wv.look_at((-1.5, -2.0, 2.5), (0.2, 0.1, 0.0))])
LIGHTS = (
    Light("ambient", ambient=(0.1, 0.2, 0.3)),
    Light("directional", direction=(0.5, 0.3, -1.0), color=(0.5, 0.5, 0.5)),
    Light("point", position=(-1.0, -1.5, 1.4), color=(0.4, 0.3, 0.2), attenuation=(0.5, 0.2, 0.1)),
    Light("headlight", color=(0.1, 0.1, 0.1)),
    Light("spot", position=(1.5, 1.2, 2.0), direction=(-1.4, -1.0, -2.0), outer_angle=0.5, exponent=3.0),
    Light("point", position=(0.4, -0.9, 2.0), color=(0.1, 0.1, 0.2), cast_shadow=False),
)
OUTPUTS = ("color", "points", "normals", "segmentation", "faces")
MATERIAL = Material(base_color=(0.7, 0.6, 0.5), specular=(0.3, 0.3, 0.3), shininess=8.0)


def table(device):
    """Return a floor with static and movable meshes and solids on it."""

    def at(x, y, z, *quaternion):
        return np.array([x, y, z, *(np.array(quaternion) / np.linalg.norm(quaternion))])

    scene = wv.Scene(device=device)
    for name, shape, pose, movable in (
        ("floor", trimesh.creation.box((6, 6, 0.1)), at(0, 0, -0.6, 0, 0, 0, 1), False),
        ("ring", trimesh.creation.torus(0.5, 0.16, 24, 12), at(0.3, 0.5, -0.3, 0.4, 0, 0, 0.9), False),
        ("box", trimesh.creation.box((0.3, 0.5, 0.7)), at(-0.6, 0, -0.1, 0, 0, 0.3, 0.95), True),
        ("ball", sphere(0.25), at(0.5, -0.4, 0.1, 0, 0, 0, 1), True),
        ("capsule", capsule(0.12, 0.3), at(0.1, -0.9, 0.0, 0.5, 0.1, 0, 0.8), True),
        ("can", cylinder(0.2, 0.15), at(-0.5, -0.9, -0.2, 0.1, 0.3, 0, 0.9), True),
    ):
        scene.add(shape, name=name, pose=pose, movable=movable, appearance=MATERIAL)
    scene.lights = LIGHTS
    return scene


def under_ceiling(device):
    """Return a floor, and a plane of triangles above it whose corners are multiples of 1/4."""
    lines = np.arange(-8, 9, dtype=np.float64) / 4
    x, y = np.meshgrid(lines, lines)
    vertices = np.stack([x.ravel(), y.ravel(), np.full(x.size, 1.0)], axis=1)
    corner = (np.arange(16)[:, None] * 17 + np.arange(16)).ravel()
    faces = np.stack([corner, corner + 1, corner + 18, corner, corner + 18, corner + 17], axis=1).reshape(-1, 3)
    scene = wv.Scene(device=device)
    scene.add(trimesh.Trimesh(vertices, faces, process=False), name="ceiling")
    scene.add(trimesh.creation.box((3.0, 3.0, 0.5)), name="floor", pose=(0, 0, -0.25, 0, 0, 0, 1))
    return scene


def worlds_of(scene):
    """Return poses of movable objects in two worlds, flags of the objects that each excludes, and their references."""
    rng = np.random.default_rng(1)
    poses = np.stack([scene.objects[index].pose for index in scene.movable]).astype(np.float32)
    worlds = np.stack([poses, poses])
    worlds[1, :, :2] += rng.uniform(-0.5, 0.5, (len(poses), 2))
    flags = np.zeros((2, len(scene)), dtype=np.uint8)
    flags[0, 1], flags[1, [2, 4]] = 1, 1
    references = [
        reference_shadows.ShadowReference(scene, poses=world, excluded=set(np.flatnonzero(flag)))
        for world, flag in zip(worlds, flags, strict=True)
    ]
    return worlds, flags, references


def shine(renderer, poses, **worlds):
    """Return the images of a scene's lights with shadows, (light, view, y, x) uint8, and the views."""
    found = {}

    def cast(*arguments):
        found["shadows"] = cast_shadows(*arguments)
        return found["shadows"]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rendering, "cast_shadows", cast)
        views = renderer.render(poses, **worlds)
    return found["shadows"].numpy().copy(), views


def assert_shadows(shadows, views, references, poses, camera=CAMERA, scene_lights=LIGHTS, caster="packets"):
    """Pixels are lit or not as in double precision, except within 1e-4 pixels of the boundary of a shadow."""
    cameras = poses[:, :3].astype(np.float64)
    lights = reference_shadows.lights_with_shadows(scene_lights)
    reference = reference_shadows.cast_shadow_packets if caster == "packets" else reference_shadows.cast_shadow_rays
    expected = reference(scene_lights, references, cameras, views)
    assert set(np.unique(shadows)) <= {0, 255}
    for number, view, y, x in np.argwhere(shadows != expected):
        point, normal = (image.numpy()[view, y, x].astype(np.float64) for image in (views.points, views.normals))
        distance = 1e-4 * np.linalg.norm(point - cameras[view]) / camera.fx
        assert reference_shadows.is_near_boundary(
            references[view], lights[number], point, normal, cameras[view], distance
        ), (number, view, y, x)
    return expected


def check(scene, poses, references, camera=CAMERA, lights=LIGHTS, caster="packets", **worlds):
    """Compare shadows with the double-precision references of the views; return the expected images."""
    scene.lights = lights
    options = {name: worlds.pop(name) for name in ("threads",) if name in worlds}
    shadows, views = shine(wv.Renderer(scene, camera, outputs=OUTPUTS, caster=caster, **options), poses, **worlds)
    return assert_shadows(shadows, views, references, poses, camera, lights, caster)
