# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The output "color": lit surfaces, compared with a double-precision reference and MuJoCo's pictures."""

import mujoco
import numpy as np
import pytest
import reference_shading
import trimesh

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.scene.lights import Background, Light
from warpvis.scene.materials import Appearance, Material, Texture

CAMERA = wv.Camera.from_fov(32, 24, hfov=0.9)
POSE = wv.look_at((2.2, -2.6, 1.8), (0.0, 0.2, 0.1))
GLOSSY = Material(base_color=(0.7, 0.5, 0.3), specular=(0.5, 0.6, 0.7), shininess=12.0, emission=(0.02, 0.0, 0.05))
MATT = Material(base_color=(0.3, 0.6, 0.8), color_space="linear")
LIGHTS = {
    "ambient": Light("ambient", ambient=(0.4, 0.5, 0.6)),
    "headlight": Light("headlight", color=(0.6, 0.5, 0.4), ambient=(0.1, 0.1, 0.1), specular=(0.3, 0.3, 0.3)),
    "directional": Light("directional", direction=(0.3, 0.5, -1.0), color=(0.8, 0.7, 0.9), intensity=0.9),
    "point": Light("point", position=(1.0, -1.5, 1.4), attenuation=(0.5, 0.2, 0.1), specular=(0.4, 0.4, 0.4)),
    "reach": Light("point", position=(1.0, -1.0, 1.0), reach=1.4),
    "spot": Light("spot", position=(1.5, -1.5, 1.5), direction=(-1.5, 1.5, -1.5), exponent=6.0, outer_angle=0.5),
    "wide spot": Light("spot", position=(1.5, -1.5, 1.5), direction=(-1, 1, -1), outer_angle=np.pi),
    "webots": Light(
        "spot", position=(1, -2, 1.5), direction=(-1, 2, -1.5), falloff="webots", inner_angle=0.2, outer_angle=0.6
    ),
    "gltf": Light(
        "spot",
        position=(1, -2, 1.5),
        direction=(-1, 2, -1.5),
        color_space="linear",
        falloff="gltf",
        inner_angle=0.2,
        outer_angle=0.7,
        attenuation=(0, 0, 1),
        intensity=20.0,
        reach=6.0,
    ),
    "gltf sun": Light("directional", direction=(0.2, 0.6, -1), color_space="linear", falloff="gltf", intensity=2.5),
}
MIXES = {**{name: (light,) for name, light in LIGHTS.items()}, "all": tuple(LIGHTS.values())}


def two_boxes(device):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((1.5, 1.2, 0.9)), name="box", appearance=GLOSSY)
    scene.add(trimesh.creation.box((6, 6, 0.1)), name="floor", pose=(0, 0, -0.6, 0, 0, 0, 1), appearance=MATT)
    return scene


@pytest.mark.smoke("*-all", "*-webots", "*-gltf sun", "*-reach", "*-wide spot")
@pytest.mark.parametrize("name", MIXES)
def test_lit_colors_match_reference(name, device):
    scene, lights = two_boxes(device), MIXES[name]
    scene.lights = lights
    views = wv.render(scene, CAMERA, POSE, outputs=("color", "points", "normals", "segmentation"), shadows=False)
    color = views.color.numpy()
    expected = reference_shading.shade_lit_colors(lights, (GLOSSY, MATT), POSE, views)
    assert np.abs(color - expected).max() <= 1
    assert len(np.unique(color.reshape(-1, 3), axis=0)) > (2 if name == "ambient" else 3)


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_textured_surfaces_are_lit(space, device):
    """sRGB light is clamped before the texture multiplies it, as in fixed-function pipelines; linear light is not."""
    scene, bright = wv.Scene(device=device), Light("ambient", ambient=(2.0, 0.5, 1.0), color_space=space)
    gray = Texture(np.full((2, 2, 3), 102, dtype=np.uint8))
    look = Appearance((Material(base_color=(0.9, 0.8, 0.5), texture=gray),), uv=np.zeros((8, 2)))
    scene.add(trimesh.creation.box((1.5, 1.2, 0.9)), name="box", appearance=look)
    scene.lights = (bright,)
    views = wv.render(scene, CAMERA, POSE, outputs=("color", "segmentation"))
    expected = np.minimum([1.8, 0.4, 0.5], 1) * 0.4
    if space == "linear":
        light = reference_shading.to_linear(np.array([0.9, 0.8, 0.5]) * 0.4) * [2.0, 0.5, 1.0]
        expected = reference_shading.to_screen(light)
    seen = views.color.numpy()[views.segmentation.numpy() == 0]
    assert len(seen) and np.abs(seen - expected * 255).max() <= 1


def test_color_without_lights_equals_albedo(device):
    scene = two_boxes(device)
    views = wv.render(scene, CAMERA, POSE, outputs=("color", "albedo"))
    np.testing.assert_array_equal(views.color.numpy(), views.albedo.numpy())
    scene.lights = (LIGHTS["headlight"],)
    views = wv.render(scene, CAMERA, POSE, outputs=("color", "albedo"))
    assert (views.color.numpy() < views.albedo.numpy()).mean() > 0.3


def test_background_color_fills_empty_pixels(device):
    scene = two_boxes(device)
    renderer = wv.Renderer(scene, CAMERA, outputs=("color", "segmentation"))
    for lights in ((), (LIGHTS["headlight"],)):
        scene.lights = lights
        for space, expected in (("srgb", [51, 102, 153]), ("linear", [124, 170, 203])):
            scene.background = Background(color=(0.2, 0.4, 0.6), color_space=space)
            views = renderer.render(wv.look_at((2.2, -2.6, 1.8), (0, 0, 2.0)))
            empty = views.segmentation.numpy() < 0
            assert empty.any() and (views.color.numpy()[empty] == expected).all()


@pytest.mark.parametrize("kind", ["stays", "movable", "attached"])
def test_vertex_normals_shade_smoothly(kind, device):
    """A coarse ball with the normals of a sphere is shaded like a sphere, static, moved or attached."""
    ball, place = trimesh.creation.icosphere(2, 0.5), np.array([0.3, 0.2, 0.1, 0.0, 0.6, 0.0, 0.8])
    hub, pose = np.array([0, 0, 0, 0, 0, 0.6, 0.8]), np.array([[0.5, -0.4, 0.2, 0, 0.28, 0, 0.96]])
    for normals in (ball.vertices, ball.vertices[ball.faces]):
        scene, look = wv.Scene(device=device), Appearance((GLOSSY,), normals=normals)
        scene.lights, options, middle = (LIGHTS["directional"],), {"shadows": False}, place[:3]
        if kind == "attached":
            scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="hub", pose=hub, movable=True)
            scene.add(ball, name="ball", pose=place, attach_to="hub", appearance=look)
            middle = (poses_to_matrices(pose[0]) @ np.linalg.inv(poses_to_matrices(hub)) @ [*place[:3], 1])[:3]
        else:
            scene.add(ball, name="ball", pose=place, movable=kind == "movable", appearance=look)
            middle = pose[0, :3] if kind == "movable" else middle
        if kind != "stays":
            options["object_poses"] = pose[None]
        views = wv.render(scene, CAMERA, POSE, outputs=("color", "points", "segmentation"), **options)
        seen = views.segmentation.numpy()[0] == (1 if kind == "attached" else 0)
        assert seen.sum() > 20
        points, matrix = views.points.numpy()[0].astype(np.float64), poses_to_matrices(POSE)
        for y, x in np.argwhere(seen):
            out = points[y, x] - middle
            normal = out / np.linalg.norm(out)
            view = points[y, x], normal, matrix[:3, 3], matrix[:3, 2]
            wanted = reference_shading.lit_color(scene.lights, GLOSSY, *view) * 255
            # Interpolated normals deviate slightly from a sphere's.
            assert np.abs(views.color.numpy()[0, y, x] - wanted).max() <= 5


def test_mujoco_worlds_render_colors(device):
    """A red box lit from above, at two positions."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><light pos="0 0 3" dir="0 0 -1" type="directional"/>
    <camera name="c" pos="0 0 4"/><body><freejoint/><geom type="box" size=".3 .3 .3" rgba="1 0 0 1"/></body></worldbody>
    </mujoco>""")
    states = []
    for x in (-0.5, 0.5):
        states.append(mujoco.MjData(model))
        states[-1].qpos[:3] = x, 0, 0.5
        mujoco.mj_forward(model, states[-1])
    renderer = wv.mujoco.BatchRenderer(model, 2, height=24, width=32, outputs=("color", "depth"), device=device)
    color = renderer.render(states).color.numpy().reshape(2, 24, 32, 3)
    red = color[..., 0].astype(int) > color[..., 1] + 50
    assert red[0, :, :16].any() and not red[0, :, 20:].any()
    assert red[1, :, 16:].any() and not red[1, :, :12].any()


@pytest.mark.gl
def test_colors_match_mujoco_pictures():
    """Silhouettes are excluded. MuJoCo interpolates vertex light, and highlights are smaller than its triangles."""
    points = " ".join(map(str, trimesh.creation.icosphere(2, 0.3).vertices.ravel().round(5)))
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco>
    <visual><headlight ambient=".2 .2 .2" diffuse=".4 .4 .4" specular=".3 .3 .3"/><quality offsamples="0"/></visual>
    <asset><texture name="t" type="2d" builtin="checker" rgb1=".2 .3 .4" rgb2=".9 .8 .3" width="64" height="64"/>
    <material name="m" texture="t" texrepeat="3 2" specular=".6" shininess=".4"/><material name="n" rgba=".5 .6 .7 1"/>
    <mesh name="ball" vertex="{points}"/></asset><worldbody>
    <light pos="0 0 3" dir="0.3 -0.2 -1" type="directional" diffuse=".2 .2 .3" castshadow="false"/>
    <geom name="floor" type="plane" size="3 2 .1" material="m"/>
    <geom name="crate" type="box" size=".3 .2 .4" pos="-.6 0 .4" material="m" euler="0 0 20"/>
    <geom name="case" type="box" size=".3 .4 .2" pos=".6 0 .2" material="n" euler="0 0 40"/>
    <body pos="0 .8 .5"><freejoint/><geom name="mesh" type="mesh" mesh="ball" material="n"/>
    <geom name="arm" type="capsule" size=".1 .3" pos=".4 0 .2" euler="40 30 0" rgba=".8 .4 .2 1"/></body>
    <geom name="can" type="cylinder" size=".2 .3" pos=".2 -.7 .3" rgba=".3 .7 .4 1"/></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = [0, 0, 0.3], 4.0, 100, -35
    with mujoco.Renderer(model, 240, 320) as renderer:
        renderer.update_scene(data, camera)
        for flag in ("SHADOW", "REFLECTION", "HAZE", "SKYBOX"):
            renderer.scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = 0
        picture = renderer.render().astype(int)
        eyes = renderer.scene.camera
        forward, up = np.array(eyes[0].forward), np.array(eyes[0].up)
        place = (np.array(eyes[0].pos) + np.array(eyes[1].pos)) / 2
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.stack([np.cross(forward, up), -up, forward], axis=1), place
    focal = 120 / np.tan(np.radians(model.vis.global_.fovy) / 2)
    views = wv.render(
        wv.mujoco.scene_from_mujoco(model).scene,
        wv.Camera(320, 240, focal, focal, 160, 120),
        pose,
        outputs=("color", "segmentation", "faces"),
    )
    seg = views.segmentation.numpy()[0]
    inside = np.ones_like(seg, dtype=bool)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            inside &= (np.roll(seg, (dy, dx), (0, 1)) == seg) & (seg >= 0)
    error = np.abs(views.color.numpy()[0].astype(int) - picture).mean(axis=-1)
    for index in np.unique(seg[seg >= 0]):
        of_object = error[inside & (seg == index)]
        assert len(of_object) > 200
        assert of_object.mean() <= 2
    assert error[inside].mean() <= 0.5
