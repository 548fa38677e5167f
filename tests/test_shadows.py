# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Shadows in "color": lights that surfaces block, compared with double precision over all surfaces of a scene."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import reference_shading
import reference_shadows
import trimesh

import warpvis as wv
from warpvis.mujoco import BatchRenderer
from warpvis.scene.acceleration import traversal_plan
from warpvis.scene.lights import Light
from warpvis.scene.materials import Appearance, Material, Texture
from warpvis.scene.solids import sphere

from support.shadows import (
    CAMERA,
    LIGHTS,
    MATERIAL,
    OUTPUTS,
    POSES,
    assert_shadows,
    check,
    shine,
    table,
    under_ceiling,
    worlds_of,
)


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_shadows_match_double_precision(caster, device):
    scene = table(device)
    renderer = wv.Renderer(scene, CAMERA, outputs=OUTPUTS, caster=caster)
    shadows, views = shine(renderer, POSES)
    expected = assert_shadows(
        shadows, views, [reference_shadows.ShadowReference(scene)] * len(POSES), POSES, caster=caster
    )
    lit = expected.reshape(len(expected), -1).mean(axis=1) / 255
    assert (lit > 0.05).all() and (lit < 0.9).all()
    materials = [MATERIAL] * len(scene)
    shaded = reference_shading.shade_lit_colors(LIGHTS, materials, POSES, views, shadows=expected)
    matches = (np.abs(views.color.numpy() - shaded) <= 1).all(axis=-1)
    assert matches[(shadows == expected).all(axis=0)].all()
    without = wv.render(scene, CAMERA, POSES, outputs=OUTPUTS, caster=caster, shadows=False)
    darker = (without.color.numpy().astype(int) - views.color.numpy()).max(axis=-1)
    assert darker.min() >= 0 and (darker > 10).mean() > 0.05


@pytest.mark.smoke("*-packets")
@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_worlds_and_exclusions_cast_their_own_shadows(caster, device):
    scene = table(device)
    worlds, flags, references = worlds_of(scene)
    expected = check(scene, POSES, references, caster=caster, object_poses=worlds, exclude=flags)
    everything = [reference_shadows.ShadowReference(scene, poses=world) for world in worlds]
    views = wv.render(scene, CAMERA, POSES, outputs=OUTPUTS, object_poses=worlds, exclude=flags)
    other = reference_shadows.cast_shadow_rays(LIGHTS, everything, POSES[:, :3].astype(np.float64), views)
    assert (other != expected).mean() > 0.005  # excluded objects would have cast shadows


@pytest.mark.smoke("*-packets")
@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_scaled_objects_cast_scaled_shadows(caster, device):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((6, 6, 0.1)), name="floor", pose=(0, 0, -0.6, 0, 0, 0, 1))
    for name, x in (("ring", -0.4), ("box", 0.5)):
        shape = trimesh.creation.torus(0.4, 0.1, 16, 8) if name == "ring" else trimesh.creation.box((0.3, 0.3, 0.3))
        scene.add(shape, name=name, pose=(x, 0, 0, 0, 0.6, 0, 0.8), movable=True)
    scales = np.array([[[1, 1, 1], [1, 1, 1]], [[1.5, 0.5, 2.0], [0.3, 2.0, 1.0]]], dtype=np.float32)
    references = [reference_shadows.ShadowReference(scene, scales=rows) for rows in scales]
    expected = check(scene, POSES, references, caster=caster, object_scales=scales)
    assert 0.01 < (expected == 0).mean() < 0.99


@pytest.mark.smoke("*-packets")
@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_scaled_solids_cast_scaled_shadows(caster, device):
    """A ball that is scaled to an ellipsoid blocks what a finely triangulated ellipsoid blocks, but for its edge."""
    shadows = []
    for shape in (sphere(0.3, mesh_tolerance=1e-5), trimesh.creation.icosphere(6, 0.3)):
        scene = wv.Scene(device=device)
        scene.add(trimesh.creation.box((6, 6, 0.1)), name="floor", pose=(0, 0, -0.6, 0, 0, 0, 1))
        scene.add(shape, name="ball", pose=(0.2, 0.1, 0.3, 0, 0, 0.6, 0.8), movable=True)
        scene.lights = LIGHTS
        renderer = wv.Renderer(scene, CAMERA, outputs=OUTPUTS, caster=caster)
        found, views = shine(renderer, POSES[:1], object_scales=np.array([[2.0, 0.7, 1.2]], dtype=np.float32))
        shadows.append(np.where(views.segmentation.numpy() == 0, found, 128))
    assert (shadows[0] != shadows[1]).mean() < 0.002 and (shadows[0] == 0).mean() > 0.02


@pytest.mark.parametrize("scale", [0.001, 300.0])
@pytest.mark.parametrize("offset", [0.0, 2000.0])
def test_scales_and_distant_origins(scale, offset, device):
    """Points of surfaces are not shadowed by their own triangles, at any size and place."""
    place = np.array([offset, -offset, 0.5 * offset]) * scale
    scene = wv.Scene(device=device)
    for mesh, pose in (
        (trimesh.creation.box((6, 6, 0.1)), (0, 0, -0.6)),
        (trimesh.creation.torus(0.5, 0.16, 24, 12), (0.3, 0.5, -0.3)),
    ):
        mesh.apply_scale(scale)
        mesh.apply_translation(np.array(pose) * scale + place)
        scene.add(mesh)
    camera = wv.Camera.from_fov(48, 36, hfov=0.9, near=1e-3 * scale, far=100 * scale)
    poses = POSES[:1].astype(np.float64) * 1.0
    poses[:, :3] = poses[:, :3] * scale + place
    sun, lamp = LIGHTS[1], Light("point", position=tuple(np.array([-1.0, -1.5, 1.4]) * scale + place))
    scene.lights = (sun, lamp)
    shadows, views = shine(wv.Renderer(scene, camera, outputs=OUTPUTS), poses)
    reference = reference_shadows.ShadowReference(scene)
    expected = reference_shadows.cast_shadow_rays(scene.lights, [reference], poses[:, :3], views)
    assert 0.02 < (expected == 0).mean() < 0.98
    assert (shadows != expected).mean() < 2e-3
    top = (views.segmentation.numpy() == 0) & (np.abs(views.normals.numpy()[..., 2] - 1) < 1e-3)
    far_from_ring = np.linalg.norm((views.points.numpy() - place)[..., :2] / scale - [0.3, 0.5], axis=-1) > 2.5
    assert (top & far_from_ring).sum() > 20 and (shadows[:, top & far_from_ring] == 255).all()


def test_no_light_passes_between_triangles(device):
    """A plane of triangles with exact coordinates, whose corners and edges are exactly between points and lights."""
    scene = under_ceiling(device)
    # Pixels see points with coordinates that are multiples of 1/16.
    camera = wv.Camera(48, 48, 16.0, 16.0, 24.5, 24.5)
    pose = np.array([[0, 0, 0.75, 1, 0, 0, 0]])
    scene.lights = (
        Light("directional", direction=(0, 0, -1)),
        Light("directional", direction=(0.25, 0.5, -1)),
        Light("point", position=(0, 0, 2.0)),
        Light("point", position=(0.5, 0.25, 2.0)),
    )
    shadows, views = shine(wv.Renderer(scene, camera, outputs=OUTPUTS), pose)
    on_floor = views.segmentation.numpy() == 1
    assert on_floor.sum() > 1000 and (shadows[:, on_floor] == 0).all()


@pytest.mark.smoke("*-packets")
@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_fine_meshes_and_instances(caster, device, monkeypatch):
    """Triangles smaller than pixels, and static objects that share a mesh."""
    for name in ("_MIN_USES", "_MIN_SAVED", "_MIN_SAVED_CUDA"):
        monkeypatch.setattr(traversal_plan, name, 1)
    scene, rng = wv.Scene(device=device), np.random.default_rng(4)
    scene.add(trimesh.creation.box((6, 6, 0.1)), name="floor", pose=(0, 0, -0.6, 0, 0, 0, 1))
    blob = trimesh.creation.icosphere(3, 0.2)
    blob.vertices *= 1 + 0.15 * np.sin(17 * blob.vertices[:, :1])
    for _ in range(12):
        scene.add(blob, pose=(*rng.uniform(-0.8, 0.8, 2), rng.uniform(-0.4, 0.4), 0, 0, 0.6, 0.8))
    assert scene.bvh().struct.drawn_count > 0  # instances
    camera = wv.Camera.from_fov(24, 18, hfov=0.9)
    references = [reference_shadows.ShadowReference(scene)] * 2
    expected = check(scene, POSES, references, camera, LIGHTS[1:3], caster)
    assert 0.1 < (expected == 0).mean() < 0.9


def test_shadows_do_not_depend_on_threads():
    scene = table("cpu")
    camera = wv.Camera.from_fov(203, 131, hfov=0.9)
    images = [
        wv.Renderer(scene, camera, outputs=("color",), threads=threads).render(POSES).color.numpy()
        for threads in (1, 2, 3, 7)
    ]
    for other in images[1:]:
        np.testing.assert_array_equal(images[0], other)
    again = wv.Renderer(scene, camera, outputs=("color",), threads=2).render(POSES[1:]).color.numpy()
    np.testing.assert_array_equal(images[0][1:], again)


def test_points_of_the_image_have_shadows(device):
    """Points of the image get the shadows of the pixels whose rays they are."""
    scene = table(device)
    image = wv.render(scene, CAMERA, POSES, outputs=("color",)).color.numpy()
    y, x = np.mgrid[:24, :32]
    pixels = np.stack([x + 0.5, y + 0.5], axis=-1).reshape(1, -1, 2).repeat(2, axis=0).astype(np.float32)
    renderer = wv.Renderer(scene, CAMERA, outputs=("color",))
    found = renderer.render_at(POSES, pixels).color.numpy()
    assert (np.abs(found.reshape(image.shape).astype(int) - image).max(axis=-1) <= 1).mean() > 0.998


def test_lights_without_shadows_cast_none(device):
    scene = table(device)
    scene.lights = tuple(light for light in LIGHTS if not light.casts_shadow)
    with_shadows, without = (
        wv.render(scene, CAMERA, POSES, outputs=("color",), shadows=flag).color.numpy() for flag in (True, False)
    )
    np.testing.assert_array_equal(with_shadows, without)


def test_shadows_must_be_a_flag():
    with pytest.raises(wv.WarpvisError, match="shadows must be"):
        wv.Renderer(table("cpu"), CAMERA, shadows="soft")


def test_lights_with_shadows_are_added_after_clamping(device):
    """In display color space; a plate above one half of a textured box blocks two lights, and the ambient part of one.

    The background light is not blocked.
    """
    gray = Texture(np.full((2, 2, 3), 102, dtype=np.uint8))
    scene, base = wv.Scene(device=device), np.array([0.9, 0.8, 0.5])
    look = Appearance((Material(base_color=tuple(base), texture=gray),), uv=np.zeros((8, 2)))
    scene.add(trimesh.creation.box((2, 2, 0.2)), name="box", appearance=look)
    scene.add(trimesh.creation.box((1, 4, 0.1)), name="plate", pose=(0.7, 0, 3, 0, 0, 0, 1))
    colors, fill = np.array([[1.0, 0.9, 0.4], [0.8, 1.4, 0.2]]), np.array([0.2, 0.1, 0.3])
    lamps = [Light("directional", color=tuple(color), ambient=(0.1, 0, 0)) for color in colors]
    scene.lights = [*lamps, Light("ambient", ambient=tuple(fill))]
    camera, pose = wv.Camera.from_fov(32, 24, hfov=0.6), wv.look_at((0, 0, 2.5), (0, 0, 0), up=(0, 1, 0))
    parts = [np.minimum((color + (0.1, 0, 0)) * base, 1) for color in colors]
    dark = np.minimum(fill * base, 1) * 0.4
    bright = np.minimum((np.minimum(fill * base, 1) + sum(parts)) * 0.4, 1)
    together = np.minimum((fill + colors.sum(axis=0) + (0.2, 0, 0)) * base, 1) * 0.4
    for shadows, left, right in ((True, bright, dark), (False, together, together)):
        color = wv.render(scene, camera, pose, outputs="color", shadows=shadows).color.numpy()[0]
        np.testing.assert_allclose(color[12, 8], left * 255, atol=1)
        np.testing.assert_allclose(color[12, 24], right * 255, atol=1)
    assert np.abs(bright - together).max() > 0.1


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_light_at_vertices_has_shadows_outside_of_cones(caster, device):
    """Between vertices, light is interpolated, also where a point itself is outside of the cone."""
    scene = table(device)
    references = [reference_shadows.ShadowReference(scene)] * len(POSES)
    scene.lights = LIGHTS[4:5]
    shadows, views = shine(wv.Renderer(scene, CAMERA, outputs=OUTPUTS, caster=caster, lighting="vertex"), POSES)
    open_cone = (replace(LIGHTS[4], outer_angle=np.pi, exponent=0.0),)
    assert_shadows(shadows, views, references, POSES, scene_lights=open_cone, caster=caster)
    scene.lights = (replace(LIGHTS[4], radius=1e-4),)
    soft = shine(wv.Renderer(scene, CAMERA, outputs=OUTPUTS, caster=caster, lighting="vertex"), POSES)[0]
    assert (soft == shadows).mean() > 0.99
    within = shine(wv.Renderer(scene, CAMERA, outputs=OUTPUTS, caster=caster), POSES)[0]
    assert (shadows > 0).mean() > 1.5 * (within > 0).mean() > 0


@pytest.mark.gl
def test_shadows_match_mujoco_pictures():
    """Away from silhouettes and from edges of shadows, which MuJoCo draws with the resolution of its shadow maps."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><visual><headlight ambient=".2 .2 .2" diffuse=".3 .3 .3" specular="0 0 0"/>
    <quality offsamples="0" shadowsize="8192"/><map shadowclip="1.5" shadowscale=".9"/></visual>
    <asset><texture name="t" type="2d" builtin="checker" rgb1=".2 .3 .4" rgb2=".9 .8 .3" width="64" height="64"/>
    <material name="m" texture="t" texrepeat="3 2" specular="0"/></asset><worldbody>
    <light pos="0.5 0 3" dir="0.3 -0.2 -1" type="directional" diffuse=".5 .5 .6" specular="0 0 0"/>
    <light pos="-1 1 2.5" dir="0.4 -0.4 -1" cutoff="60" exponent="0" diffuse=".4 .3 .3" specular="0 0 0"/>
    <geom name="floor" type="box" size="2 2 .05" pos="0 0 -.05" material="m"/>
    <geom name="crate" type="box" size=".3 .2 .4" pos="-.6 0 .4" euler="0 0 20" rgba=".7 .7 .7 1"/>
    <body pos="0 .8 .6"><freejoint/><geom name="ball" type="sphere" size=".3" rgba=".3 .7 .4 1"/></body>
    <geom name="can" type="cylinder" size=".2 .3" pos=".4 -.7 .6" euler="30 0 0" rgba=".8 .4 .2 1"/>
    </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = [0, 0, 0.3], 4.0, 100, -45
    with mujoco.Renderer(model, 240, 320) as renderer:
        renderer.update_scene(data, camera)
        for flag in ("REFLECTION", "HAZE", "SKYBOX"):
            renderer.scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = 0
        picture = renderer.render().astype(int)
    batch = BatchRenderer(model, 1, height=240, width=320, outputs=("color", "segmentation"))
    views = batch.render([data], cameras=[camera])
    color, seg = views.color.numpy().reshape(240, 320, 3).astype(int), views.segmentation.numpy().reshape(240, 320)
    bright = BatchRenderer(model, 1, height=240, width=320, outputs=("color",), shadows=False)
    lit = bright.render([data], cameras=[camera]).color.numpy().reshape(240, 320, 3).astype(int)
    darker = (lit - color).max(axis=-1) > 8
    inside = seg >= 0
    for dy, dx in np.mgrid[-2:3, -2:3].reshape(2, -1).T:
        for image in (seg, darker):
            inside &= np.roll(image, (dy, dx), (0, 1)) == image
    error = np.abs(color - picture).mean(axis=-1)
    assert (inside & darker).sum() > 2000 and (inside & ~darker).sum() > 20000
    assert error[inside & darker].mean() <= 2 and error[inside].mean() <= 2
    assert (error[inside] > 20).mean() < 0.01


@pytest.mark.smoke("*-packets")
@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_shadow_planes_limit_directional_lights(caster, device):
    """A directional light from a plane, as in MuJoCo, is blocked only by surfaces beyond the plane."""
    scene = table(device)
    plane = Light("directional", position=(0.3, 0.2, 0.05), direction=(0.5, 0.3, -1.0), shadow_plane=True)
    references = [reference_shadows.ShadowReference(scene)] * 2
    expected = check(scene, POSES, references, lights=(LIGHTS[1], plane), caster=caster)
    assert (expected[1] >= expected[0]).all() and (expected[1] > expected[0]).mean() > 0.01
    assert (expected[1] == 0).mean() > 0.2
