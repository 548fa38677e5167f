# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Mirror images in the output "color", compared with double precision, mirrored scenes and MuJoCo's pictures."""

import mujoco
import numpy as np
import pytest
import reference_layers
import reference_mirrors
import trimesh
import warp as wp
from scipy.spatial.transform import Rotation

import warpvis as wv
from warpvis.cameras import LensCamera, OrthographicCamera, Rays
from warpvis.cameras.lenses import OpenCVPinhole
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import SceneError
from warpvis.mujoco import BatchRenderer, Renderer
from warpvis.scene.lights import Background, Light
from warpvis.scene.materials import Appearance, Material

from support.mujoco_renderer import away_from_silhouettes

RNG = np.random.default_rng(3)
CAMERA = wv.Camera.from_K([[26.0, 0, 13.0], [0, 25.0, 11.5], [0, 0, 1]], 28, 21)
POSE = np.array(wv.look_at((2.2, -2.6, 1.6), (0.0, 0.1, 0.2)))
CAMERAS = {
    "pinhole": CAMERA,
    "parallel": OrthographicCamera.from_extent(24, 20, across=4.0),
    "lens": LensCamera(OpenCVPinhole(22.0, 21.0, 11.5, 9.0, (-0.2, 0.05, 0.01, -0.02, 0.0)), 24, 18),
    "origins": Rays(
        Rotation.from_euler("yx", RNG.uniform(-0.4, 0.4, (200, 2))).apply([0.0, 0, 1]).reshape(10, 20, 3),
        origins=RNG.uniform(-0.3, 0.3, (10, 20, 3)),
    ),
    "list": Rays(Rotation.from_euler("yx", RNG.uniform(-0.4, 0.4, (200, 2))).apply([0.0, 0, 1])),
}
LIGHTS = (
    Light("headlight", color=(0.3, 0.3, 0.3), ambient=(0.1, 0.1, 0.1)),
    Light("point", position=(1.0, -1.5, 2.5), color=(0.4, 0.4, 0.3), cast_shadow=False),
)
QUAD, TWO = np.array([(-1.5, -1.5, 0), (1.5, -1.5, 0), (1.5, 1.5, 0), (-1.5, 1.5, 0)]), np.array([(0, 1, 2), (0, 2, 3)])
PLAIN = {"outputs": ("color", "segmentation", "depth")}


def at(position, angles):
    """Return a pose from a position and Euler angles."""
    return np.concatenate([position, Rotation.from_euler("xyz", angles).as_quat()])


def room(device):
    """Return a floor and a tilted movable board that mirror, objects on, in and below them, and their planes."""
    scene = wv.Scene(device=device)
    matt = {"specular": (0.2, 0.2, 0.2), "shininess": 6.0}
    floor = Material(base_color=(0.3, 0.2, 0.4), reflectance=0.5, **matt)
    scene.add((QUAD, TWO), name="floor", appearance=floor)
    box = trimesh.creation.box((0.6, 0.7, 0.9))
    scene.add(box, name="sunk", pose=at((0.2, 0.5, 0.2), (0.3, 0.2, 0.6)), appearance=(0.8, 0.3, 0.2))
    scene.add(box, name="below", pose=at((0.3, 0.2, -0.9), (0, 0, 0.2)), appearance=(0.2, 0.9, 0.9))
    scene.add(box, name="moves", pose=at((-0.6, -0.5, 0.7), (0, 0.4, 0.6)), appearance=(0.2, 0.7, 0.3), movable=True)
    board = trimesh.creation.box((0.8, 0.1, 0.8))
    is_front = board.face_normals[:, 1] < -0.9
    looks = Appearance(
        (Material(base_color=(0.2, 0.2, 0.2)), Material(base_color=(0.1, 0.1, 0.3), reflectance=0.7, **matt)),
        face_materials=is_front.astype(np.int32),
    )
    place = at((-0.3, 0.9, 0.6), (0.2, 0.1, 0.3))
    scene.add(board, name="board", pose=place, appearance=looks, movable=True)
    scene.lights, scene.background = LIGHTS, Background(color=(0.2, 0.5, 0.9))
    frame = poses_to_matrices(place.astype(np.float64))
    front = frame[:3, :3] @ (0, -0.05, 0) + frame[:3, 3]
    return scene, [(0, np.zeros(3), np.array([0, 0, 1.0])), (4, front, -frame[:3, 1])]


@pytest.mark.smoke("*-pinhole", "*-origins")
@pytest.mark.parametrize("name", CAMERAS)
def test_reflections_match_reference(name, device):
    scene, planes = room(device)
    camera, pose = CAMERAS[name], poses_to_matrices(POSE.astype(np.float64))
    shown = wv.render(scene, camera, POSE, outputs=("color",)).color.numpy()[0].reshape(-1, 3)
    triangles = reference_layers.world_triangles(scene)
    errors, images = [], 0
    rays = camera.rays.reshape(-1, 3) @ pose[:3, :3].T
    origins = np.zeros_like(rays) if camera.origins is None else camera.origins.reshape(-1, 3)
    for ray, origin, color in zip(rays, origins @ pose[:3, :3].T + pose[:3, 3], shown, strict=True):
        expected, has_image = reference_mirrors.reflected_color(scene, triangles, planes, pose, origin, ray)
        expected = (0.2, 0.5, 0.9) if expected is None else expected
        errors.append(np.abs(np.array(expected) * 255 - color).max())
        images += has_image
    errors = np.array(errors)
    assert images > 0.08 * len(errors)
    assert np.quantile(errors, 0.985) < 1.6, errors.max()  # each image is rounded to 8 bits
    assert (errors > 6).mean() < 0.012  # rays through edges
    plain = wv.render(scene, camera, POSE, reflections=False, **PLAIN)
    assert np.abs(plain.color.numpy().astype(int).reshape(-1, 3) - shown).max() > 20


def test_kernels_of_planes_match_reference(device):
    """The pose of the mirrored camera, its lights, and the objects behind the plane."""
    from warpvis.kernels.shading import mirrors
    from warpvis.kernels.shading.lighting import DeviceLight

    scene, planes = room(device)
    found = scene.mirrors()
    assert [plane.owner for plane in found.planes] == [0, 4]
    poses = wp.array(np.stack([POSE, POSE]).astype(np.float32), dtype=wp.transform, device=device)
    worlds = wv.scene.worlds.parse_worlds(scene, 2, None, np.zeros(2, dtype=np.int32), ["moves"])
    pose = poses_to_matrices(POSE.astype(np.float32).astype(np.float64))
    for plane, (index, point, normal) in zip(found.planes, planes, strict=True):
        mirror = mirrors.Mirror()
        mirror.index, mirror.column = plane.owner, plane.column
        mirror.point, mirror.normal = wp.vec3d(*plane.point), wp.vec3d(*plane.normal)
        out = [wp.empty(2, dtype=dtype, device=device) for dtype in (wp.vec4d, wp.transform)]
        excluded = wp.empty((2, len(scene)), dtype=wp.uint8, device=device)
        boxes = [found.columns, found.centers, found.halves]
        inputs = [mirror, *boxes, poses, worlds, *out, excluded]
        wp.launch(mirrors.mirror_views, excluded.shape, inputs=inputs, device=device)
        corners = [item.vertices for item in scene.objects]
        (along, offset), mirrored, behind = reference_mirrors.mirror_views(point, normal, pose, corners)
        np.testing.assert_allclose(out[0].numpy()[1], [*along, offset], atol=1e-6)
        np.testing.assert_allclose(poses_to_matrices(out[1].numpy()[1].astype(np.float64)), mirrored, atol=1e-6)
        expected = np.array(behind) | [item.name in ("moves", scene.objects[index].name) for item in scene.objects]
        np.testing.assert_array_equal(excluded.numpy()[0], expected)
    assert behind == [False, False, False, False, False] or any(behind)
    lights = scene.device_lights(scene.lights)
    rows = wp.empty((2, len(LIGHTS)), dtype=DeviceLight, device=device)
    wp.launch(mirrors.mirror_lights, rows.shape, inputs=[lights, poses, worlds, rows], device=device)
    for row, light in zip(rows.numpy()[1], reference_mirrors.mirror_lights(scene.lights, pose), strict=True):
        assert row["kind"] == ("ambient", "directional", "point").index(light.kind)
        np.testing.assert_allclose(row["direction"], light.direction, atol=1e-6)
    pixels = RNG.uniform(0, 28, (2, 1, 5, 2)).astype(np.float32)
    flipped = wp.empty(pixels.shape[:3], dtype=wp.vec2, device=device)
    inputs = [28.0, wp.array(pixels, dtype=wp.vec2, device=device), flipped]
    wp.launch(mirrors.flip_points, flipped.shape, inputs=inputs, device=device)
    np.testing.assert_allclose(flipped.numpy(), reference_mirrors.flip_points(28.0, pixels), atol=1e-5)


def test_mirror_image_is_the_picture_of_the_mirrored_scene(device):
    """A black floor of reflectance 1 shows what there would be below a floor without a surface."""
    camera, pose = wv.Camera.from_fov(64, 48, hfov=0.9), np.array(wv.look_at((2.2, -2.6, 1.6), (0.0, 0.1, 0.2)))
    shapes = {
        "box": (trimesh.creation.box((0.6, 0.7, 0.9)), (0.2, 0.5, 0.6)),
        "ball": (trimesh.creation.icosphere(2, 0.4), (-0.7, -0.4, 0.5)),
    }
    lights = LIGHTS[1:], (Light("point", position=(1.0, -1.5, -2.5), color=(0.4, 0.4, 0.3), cast_shadow=False),)
    scenes = wv.Scene(device=device), wv.Scene(device=device)
    black = Material(base_color=(0, 0, 0), reflectance=1.0)
    scenes[0].add((QUAD, TWO), name="floor", appearance=black)
    for name, (mesh, place) in shapes.items():
        material = Material(base_color=(0.8, 0.6, 0.3), specular=(0.5, 0.5, 0.5), shininess=9.0)
        scenes[0].add(mesh, name=name, pose=(*place, 0, 0, 0, 1), appearance=material)
        vertices = (mesh.vertices + place) * (1, 1, -1)
        scenes[1].add((vertices, mesh.faces[:, ::-1]), name=name, appearance=material)
    pictures = []
    for scene, of_scene in zip(scenes, lights, strict=True):
        scene.lights = of_scene
        pictures.append(wv.render(scene, camera, pose, **PLAIN))
    is_floor = pictures[0].segmentation.numpy() == 0
    shown, expected = (views.color.numpy()[is_floor].astype(int) for views in pictures)
    assert (expected.max(axis=1) > 40).sum() > 100
    errors = np.abs(shown - expected).max(axis=1)
    assert np.quantile(errors, 0.98) <= 1 and (errors > 1).mean() < 0.02


def test_worlds_materials_and_views(device):
    """Mirrors move with their objects, follow other materials of worlds, and are seen by each view from its place."""
    scene, _ = room(device)
    poses = np.stack([POSE, np.array(wv.look_at((-2.0, -2.4, 1.2), (0.0, 0.3, 0.4)))])
    places = np.stack([scene["moves"].pose, scene["board"].pose])
    moved = np.stack([places, places + np.array([[0.1, 0.2, 0.3, 0, 0, 0, 0], [0.2, -0.3, 0.1, 0, 0, 0, 0]])])
    both = wv.render(scene, CAMERA, poses, object_poses=moved, outputs=("color",)).color.numpy()
    for view in range(2):
        alone = wv.render(scene, CAMERA, poses[view], object_poses=moved[view], outputs=("color",))
        np.testing.assert_array_equal(alone.color.numpy()[0], both[view])
    dull = Material(base_color=(0.3, 0.2, 0.4), specular=(0.2, 0.2, 0.2), shininess=6.0)
    chosen = np.full((1, len(scene)), -1)
    chosen[0, 0] = 0
    looks = wv.scene.world_appearances.WorldAppearances(object_materials=chosen, materials=[dull])
    worlds = wv.render(scene, CAMERA, POSE, appearances=looks, outputs=("color", "segmentation"))
    plain = wv.render(scene, CAMERA, POSE, reflections=False, outputs=("color",)).color.numpy()
    is_floor = worlds.segmentation.numpy() == 0
    np.testing.assert_array_equal(worlds.color.numpy()[is_floor], plain[is_floor])
    scene.set_appearance("floor", dull)
    after = wv.render(scene, CAMERA, POSE, outputs=("color",)).color.numpy()
    np.testing.assert_array_equal(after, worlds.color.numpy())


def test_glass_in_mirrors_and_smooth_edges(device):
    """Glass is seen in a mirror, and pixels at edges are means of mirror images."""
    scene, _ = room(device)
    before = wv.render(scene, CAMERA, POSE, **PLAIN)
    glow = {"alpha_mode": "blend", "emission": (0.6, 0.3, 0.1)}
    looks = [Material(base_color=(0.9, 0.2, 0.2, alpha), **glow) for alpha in (0.5, 1.0, 0.0)]
    pictures = []
    for look in looks:
        scene.add((QUAD * 0.2 + (0.6, -0.6, 0.4), TWO), name=f"{len(scene)}", appearance=look)
        pictures.append(wv.render(scene, CAMERA, POSE, exclude=range(5, len(scene) - 1), **PLAIN))
    half, full, none = (views.color.numpy().astype(int) for views in pictures)
    is_floor = (before.segmentation.numpy() == 0) & (pictures[0].segmentation.numpy() == 0)
    shown = is_floor & (np.abs(full - none).max(axis=-1) > 20)
    assert shown.sum() > 10
    assert np.abs(half - (full + none) / 2)[shown].max() <= 2
    np.testing.assert_array_equal(none[is_floor], before.color.numpy()[is_floor])
    scene, _ = room(device)
    smooth = wv.render(scene, CAMERA, POSE, samples=4, **PLAIN).color.numpy().astype(int)
    fine = wv.Camera.from_K([[104.0, 0, 52.0], [0, 100.0, 46.0], [0, 0, 1]], 112, 84)
    exact = wv.render(scene, fine, POSE, **PLAIN).color.numpy()[0].reshape(21, 4, 28, 4, 3).mean(axis=(1, 3))
    rough = before.color.numpy().astype(int)
    changed = (smooth != rough).any(axis=-1)[0]
    assert np.abs(smooth[0] - exact)[changed].mean() < 0.6 * np.abs(rough[0] - exact)[changed].mean()


def test_what_does_not_mirror(device):
    scene = wv.Scene(device=device)
    scene.add((QUAD, TWO), name="floor", appearance=(0.3, 0.3, 0.3))
    mirror = Material(reflectance=0.5)
    scene.add(wv.scene.solids.sphere(0.3), name="solid", pose=(0, 0, 0.5, 0, 0, 0, 1), appearance=mirror, movable=True)
    scene.add((QUAD + (0, 0, 2), TWO), name="glass", appearance=Material(alpha_mode="blend", reflectance=0.5))
    assert scene.mirrors() is None
    scene.add(trimesh.creation.icosphere(1, 0.3), name="round", appearance=mirror)
    with pytest.warns(UserWarning, match="'round' does not mirror: its surfaces with reflectance are in more than 6"):
        assert scene.mirrors() is None
    with pytest.raises(SceneError, match=r"reflectance of a material must be from 0 to 1, got 1.5"):
        Material(reflectance=1.5)
    with pytest.raises(wv.WarpvisError, match="reflections must be"):
        wv.Renderer(scene, CAMERA, reflections="all")


TABLE = """<mujoco><statistic extent="2"/><visual><map znear=".01"/><quality offsamples="0"/>
  <headlight ambient=".2 .2 .2" diffuse=".3 .3 .3" specular="0 0 0"/></visual>
  <asset>
    <texture name="check" type="2d" builtin="checker" rgb1=".4 .4 .2" rgb2=".1 .2 .3" width="64" height="64"/>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".3 .5 .7" rgb2="0 .1 .2" width="32" height="32"/>
    <material name="check" texture="check" texrepeat="2 2" specular="0" reflectance="{floor}"/>
    <material name="shiny" rgba=".3 .1 .1 1" specular="0" reflectance="{box}"/>
    <material name="matt" rgba=".3 .8 .4 1" specular="0"/>
  </asset>
  <worldbody><geom name="below" type="box" size=".2 .2 .1" pos="0 .4 -.4" material="matt"/>
    <geom name="floor" type="plane" size="1.2 1.2 .1" material="check"/>
    <light name="lamp" pos="-.8 -.8 2" dir=".4 .4 -1" diffuse=".4 .4 .4" specular="0 0 0" type="directional"/>
    <geom name="box" type="box" size=".5 .4 .2" pos="0 .1 .2" euler="0 0 25" material="shiny"/>
    <body pos=".3 .2 .7"><joint type="slide" axis="1 0 0"/><geom name="ball" size=".2" material="matt"/>
      <geom name="rod" type="box" size=".05 .3 .05" pos="-.6 0 0" euler="20 0 0" rgba=".2 .3 .9 1"/></body>
    <camera name="eye" pos="0 -2.2 1.6" xyaxes="1 0 0 0 .6 .8" fovy="45"/>
    <camera name="low" pos="-1.8 -1 .6" xyaxes=".5 -.9 0 .2 .1 .95" fovy="50"/></worldbody></mujoco>"""


@pytest.mark.parametrize(("floor", "box"), [(0.6, 0.5), (0.0, 0.7), (0.5, 0.0)])
def test_pictures_match_mujoco(floor, box):
    """The first plane or box mirrors, without shadows and without the sky, and a flag turns it off."""
    model = mujoco.MjModel.from_xml_string(TABLE.format(floor=floor, box=box))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    flag = int(mujoco.mjtRndFlag.mjRND_REFLECTION)
    mirrored = model.geom("floor" if floor else "box").id
    with mujoco.Renderer(model, 120, 160) as theirs, Renderer(model, 120, 160) as ours:
        for camera in ("eye", "low"):
            pictures, off = [], []
            for renderer in (theirs, ours):
                renderer.disable_segmentation_rendering()
                renderer.update_scene(data, camera)
                pictures.append(renderer.render().astype(int))
                renderer.scene.flags[flag] = 0
                off.append(renderer.render().astype(int))
                renderer.scene.flags[flag] = 1
                renderer.enable_segmentation_rendering()
                ids = renderer.render()[..., 0]
            gains = [with_it - without for with_it, without in zip(pictures, off, strict=True)]
            seen = ids == mirrored
            assert (gains[0][seen].max(axis=1) > 10).sum() > (100 if floor or camera == "eye" else -1)
            assert (gains[0][~seen] == 0).all() and (gains[1][~seen] == 0).all()
            depth = np.where(gains[0].max(axis=2) > 0, 1.0, 2.0)
            inner = away_from_silhouettes(depth, 2) & seen
            assert np.abs(gains[0] - gains[1])[inner].mean() < 0.7
            assert np.quantile(np.abs(gains[0] - gains[1])[inner], 0.97) <= 4


def test_batches_follow_the_model(device):
    model = mujoco.MjModel.from_xml_string(TABLE.format(floor=0.0, box=0.4))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    pictures = {}
    for value in (0.4, 0.8):
        model.mat_reflectance[1] = value
        batch = BatchRenderer(model, height=60, width=80, outputs=("color", "segmentation"), device=device)
        pictures[value] = batch.render(data, cameras=["eye"]).color.numpy()[0].astype(int)
    plain = BatchRenderer(model, height=60, width=80, outputs=("color",), reflections=False, device=device)
    dull = plain.render(data, cameras=["eye"]).color.numpy()[0].astype(int)
    gain = pictures[0.4] - dull
    assert (gain > 10).sum() > 40
    below = pictures[0.8] < 255
    assert np.abs(2 * gain - (pictures[0.8] - dull))[below].max() <= 2
    renderer = Renderer(model, 60, 80, lighting="pixel")
    renderer.update_scene(data, "eye")
    np.testing.assert_array_equal(renderer.render(), pictures[0.8])
    model.mat_reflectance[1] = 0.4
    renderer.update_scene(data, "eye")
    np.testing.assert_array_equal(renderer.render(), pictures[0.4])
