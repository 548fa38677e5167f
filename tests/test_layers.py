# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Transparent surfaces in the output "color", compared with a double-precision reference and MuJoCo's pictures."""

import mujoco
import numpy as np
import pytest
import reference_layers
import trimesh
import warp as wp
from scipy.spatial.transform import Rotation

import warpvis as wv
from warpvis.cameras import LensCamera, OrthographicCamera, Rays
from warpvis.cameras.lenses import OpenCVPinhole
from warpvis.core.poses import poses_to_matrices
from warpvis.mujoco import camera_from_mujoco, camera_poses, geom_poses, scene_from_mujoco
from warpvis.scene.lights import Background, Light
from warpvis.scene.materials import Appearance, Material, Texture

RNG = np.random.default_rng(8)
PINHOLE = wv.Camera.from_fov(28, 21, hfov=0.9)
POSE = np.array(wv.look_at((2.6, -2.2, 1.5), (0.0, 0.1, 0.2)))
SKY_COLOR = (0.2, 0.5, 0.9)
LEAF = RNG.integers(0, 256, (4, 4, 4), dtype=np.uint8)
QUAD = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], dtype=float)
QUAD_UV = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=np.float32)
TWO = np.array([(0, 1, 2), (0, 2, 3)])
CAMERAS = {
    "pinhole": PINHOLE,
    "parallel": OrthographicCamera.from_extent(24, 20, across=4.0),
    "lens": LensCamera(OpenCVPinhole(22.0, 21.0, 11.5, 9.0, (-0.2, 0.05, 0.01, -0.02, 0.0)), 24, 18),
    "origins": Rays(
        Rotation.from_euler("yx", RNG.uniform(-0.4, 0.4, (200, 2))).apply([0.0, 0, 1]).reshape(10, 20, 3),
        origins=RNG.uniform(-0.3, 0.3, (10, 20, 3)),
    ),
    "list": Rays(Rotation.from_euler("yx", RNG.uniform(-0.4, 0.4, (200, 2))).apply([0.0, 0, 1])),
}


def at(position, angles):
    """Return a pose from a position and Euler angles."""
    return np.concatenate([position, Rotation.from_euler("xyz", angles).as_quat()])


def glass(color, **options):
    return Material(base_color=color, alpha_mode="blend", **options)


def scene_of_glass(device, *, twice=False):
    """Return boxes and quads of all alpha modes."""
    scene = wv.Scene(device=device)
    scene.background = Background(color=SKY_COLOR)
    box = trimesh.creation.box((0.8, 0.7, 0.9))
    scene.add(box, name="red", appearance=glass((0.9, 0.1, 0.2, 0.4), blends_twice=twice))
    clear = glass((0.1, 0.8, 0.3, 0.6), double_sided=False, blends_twice=twice, color_space="linear")
    scene.add(box, name="green", pose=at((0.9, 0.3, 0.1), (0, 0, 0.6)), appearance=clear, movable=True)
    scene.add(box, name="solid", pose=at((-0.9, 0.8, -0.1), (0, 0, 0.2)), appearance=(0.8, 0.7, 0.2))
    leaf = Material(texture=Texture(LEAF, filter="nearest"), alpha_mode="mask", alpha_cutoff=0.4)
    looks = Appearance((leaf,), uv=QUAD_UV)
    scene.add((QUAD, TWO), name="leaf", pose=at((0.3, -0.4, 0.6), (0.6, 0.2, 0.4)), appearance=looks)
    for space, texels, place in (("linear", "srgb", (-0.4, -0.6, 0.3)), ("srgb", "linear", (0.8, -0.5, -0.4))):
        texture = Texture(LEAF, filter="nearest", color_space=texels)  # of another color space than its material
        looks = Appearance((glass((1, 1, 1, 0.8), texture=texture, color_space=space),), uv=QUAD_UV)
        scene.add((QUAD, TWO), name=f"{space} film", pose=at(place, (0.3, 0.8, 0.1)), appearance=looks)
    fading = np.array([(1, 1, 1, 0.1), (1, 0, 1, 0.9), (0, 1, 1, 0.3), (1, 1, 0, 1)], dtype=np.float32)
    looks = Appearance((glass((0.9, 0.9, 0.8, 0.9), blends_twice=twice),), vertex_colors=fading)
    scene.add((QUAD, TWO), name="pane", pose=at((0.2, 0.2, -0.1), (0, 1.1, 0.4)), appearance=looks)
    return scene


def rays_in_world(camera, pose):
    """Return the origins and directions of all rays."""
    matrix = poses_to_matrices(np.asarray(pose, dtype=np.float64)[None])[0]
    rays = camera.rays.reshape(-1, 3) @ matrix[:3, :3].T
    origins = np.zeros_like(rays) if camera.origins is None else camera.origins.reshape(-1, 3)
    return origins @ matrix[:3, :3].T + matrix[:3, 3], rays


def check(scene, camera, pose, shown, **world):
    """Compare colors with the reference, and return the number of surfaces of each ray."""
    triangles = reference_layers.world_triangles(scene, **world)
    counts, errors = [], []
    background = np.array(SKY_COLOR)
    for origin, ray, color in zip(*rays_in_world(camera, pose), shown.reshape(-1, 3), strict=True):
        expected, count = reference_layers.blended_color(scene, triangles, origin, ray, background)
        counts.append(count)
        errors.append(np.abs(np.clip(expected, 0, 1) * 255 - color).max())
    errors = np.array(errors)
    assert np.quantile(errors, 0.985) < 2.0, errors.max()  # each layer is rounded to 8 bits
    assert (errors > 6).mean() < 0.01  # rays through edges
    return np.array(counts)


@pytest.mark.parametrize("twice", [False, True])
@pytest.mark.smoke("*-pinhole-False", "*-pinhole-True", "*-origins-False")
@pytest.mark.parametrize("name", CAMERAS)
def test_layers_match_reference(name, twice, device):
    scene, camera = scene_of_glass(device, twice=twice), CAMERAS[name]
    views = wv.render(scene, camera, POSE, outputs=("color", "depth", "segmentation"))
    counts = check(scene, camera, POSE, views.color.numpy()[0])
    assert counts.max() >= 5
    assert (counts >= 3).mean() > 0.1
    solid = wv.Scene(device=device)
    for item in scene.objects:
        solid.add((item.vertices, item.faces), name=item.name)
    plain = wv.render(solid, camera, POSE, outputs=("depth", "segmentation"))
    np.testing.assert_allclose(views.depth.numpy(), plain.depth.numpy(), rtol=1e-6)
    np.testing.assert_array_equal(views.segmentation.numpy(), plain.segmentation.numpy())


def test_worlds_scales_and_exclude(device):
    scene = scene_of_glass(device)
    poses = np.array([[at((0.9, 0.3, 0.1), (0, 0, 0.6))], [at((0.4, -0.6, 0.5), (0.4, 0.2, 0.6))]])
    scales = np.array([[[1.0, 1.0, 1.0]], [[0.5, 1.6, 0.7]]])
    views = wv.render(
        scene,
        PINHOLE,
        np.tile(POSE, (2, 1)),
        object_poses=poses,
        object_scales=scales,
        exclude=["red"],
        outputs=("color",),
    )
    for world in range(2):
        shown = views.color.numpy()[world]
        check(scene, PINHOLE, POSE, shown, poses=poses[world], scales=scales[world], exclude=("red",))


def test_listed_pixels_match_reference():
    """Pixels that show what is behind their surfaces are listed in blocks, for each view, in images of any size."""
    from warpvis.rendering._computed import Frame
    from warpvis.rendering._layer_lists import _LayerLists
    from warpvis.rendering.casters.base import Scratch
    from warpvis.scene.worlds import parse_worlds

    scene = scene_of_glass("cpu")
    poses = np.stack(
        [POSE, np.array(wv.look_at((-3.0, 0.4, 0.3), (-9.0, 0.0, 0.0))), wv.look_at((1.9, 2, 2), (0, 0, 0))]
    )
    for width, height in ((83, 62), (5, 3)):
        camera = wv.Camera.from_fov(width, height, hfov=0.9)
        views = wv.render(scene, camera, poses, outputs=("points", "segmentation", "faces", "albedo"))
        images = {name: getattr(views, name) for name in ("points", "segmentation", "faces")}
        placed = wp.array(poses.astype(np.float32), dtype=wp.transform, device="cpu")
        frame = Frame(scene, camera, placed, parse_worlds(scene, 3, None, None, ()), images, 2)
        lists = _LayerLists(frame, Scratch(scene.device))
        assert lists.find(views.albedo)
        listed = lists.pixels.numpy()
        assert (listed[1] == -1).all()
        for view in (0, 2):
            found = np.isin(np.arange(height * width), listed[view]).reshape(height, width)
            ordered = reference_layers.list_transparent_rows(found, listed.shape[2])
            np.testing.assert_array_equal(listed[view, : len(ordered)], ordered)
            assert (listed[view, len(ordered) :] == -1).all()
            expected = np.zeros_like(found)
            for y, x in np.argwhere(images["segmentation"].numpy()[view] >= 0):
                item, face = (
                    scene.objects[images["segmentation"].numpy()[view, y, x]],
                    images["faces"].numpy()[view, y, x],
                )
                corners, point = (
                    item.vertices[item.faces[face]].astype(np.float64),
                    images["points"].numpy()[view, y, x],
                )
                expected[y, x] = (
                    reference_layers.find_transparent_rows(item, face, corners, point, is_back=False)[0] < 1
                )
            assert expected.any()
            assert (expected != found).mean() < 0.002


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_layers_do_not_depend_on_threads(threads):
    scene, camera = scene_of_glass("cpu", twice=True), wv.Camera.from_fov(140, 90, hfov=0.9)
    scene.lights = (Light("point", position=(1.0, 2.0, 4.0)), Light("ambient", ambient=(0.2, 0.2, 0.2)))
    scene.background = Background(gradient=((0.1, 0.3, 0.9), (0.9, 0.8, 0.4), (0.1, 0.1, 0.1)))
    renderer = wv.Renderer(scene, camera, outputs=("color",), threads=threads)
    poses = np.stack([POSE, wv.look_at((1.9, 2, 2), (0, 0, 0))])
    expected = [wv.render(scene, camera, pose, outputs=("color",), threads=1).color.numpy()[0] for pose in poses]
    for _ in range(3):
        np.testing.assert_array_equal(renderer.render(poses).color.numpy(), expected)


@pytest.mark.parametrize("cull", [False, True])
@pytest.mark.parametrize("near_plane", ["occlude", "clip"])
def test_packets_match_rays(cull, near_plane):
    """Behind glass, packets and rays meet the same surfaces: solids and meshes, stretched, excluded, inside and cut."""
    rng = np.random.default_rng(11)
    scene = wv.Scene(device="cpu")
    scene.background = Background(color=SKY_COLOR)
    scene.add(
        trimesh.creation.box((6, 6, 0.2)), name="floor", pose=(0, 0, -1.5, 0, 0, 0, 1), appearance=(0.7, 0.6, 0.5)
    )
    scene.add(
        trimesh.creation.box((3, 0.2, 1)), name="wall", pose=(0, -1.5, 0, 0, 0, 0, 1), appearance=glass((0, 1, 1, 0.4))
    )
    shapes = (
        wv.scene.solids.sphere(0.4),
        wv.scene.solids.capsule(0.2, 0.6),
        wv.scene.solids.cylinder(0.3, 0.5),
        trimesh.creation.icosphere(2, radius=0.4),
        trimesh.creation.box((0.5, 0.6, 0.4)),
        (QUAD * 0.7, TWO),
    )
    poses = []
    for number in range(18):
        look = glass((*rng.uniform(0, 1, 3), 0.3 + 0.1 * (number % 8)), double_sided=bool(number // 3 % 2))
        poses.append(at(rng.uniform(-1, 1, 3), rng.uniform(-3, 3, 3)))
        scene.add(shapes[number % 6], name=f"thing {number}", pose=poses[-1], movable=True, appearance=look)
    worlds = np.stack([poses, poses[::-1]])
    sizes = rng.uniform(0.7, 1.4, (2, 18, 1)) * np.ones(3)
    camera = wv.Camera.from_fov(93, 70, hfov=0.9, near=0.4)
    eyes = np.stack([wv.look_at(place, (0, 0, 0)) for place in ((2.4, -1.0, 0.9), (1.0, 0.6, 0.5))])
    options = {"object_poses": worlds, "object_scales": sizes, "exclude": ["thing 4"], "near_plane": near_plane}
    packets, rays = (
        wv.render(scene, camera, eyes, outputs=("color", "segmentation"), caster=caster, cull_backfaces=cull, **options)
        for caster in ("packets", "rays")
    )
    assert (packets.segmentation.numpy() > 0).mean() > 0.5
    error = np.abs(packets.color.numpy().astype(int) - rays.color.numpy()).max(axis=-1)
    assert (error > 1).mean() < 2e-3, np.unique(error, return_counts=True)


def test_number_of_layers_is_limited(device):
    scene = wv.Scene(device=device)
    for number in range(12):
        color = (0.1 * (number % 8), 0.5, 1 - 0.08 * number, 0.3)
        scene.add((QUAD, TWO), name=f"pane {number}", pose=(0, 0, 0.1 * number, 0, 0, 0, 1), appearance=glass(color))
    scene.background = Background(color=SKY_COLOR)
    pose = wv.look_at((0.1, 0.05, 6.0), (0.0, 0.0, 0.0), up=(0, 1, 0))
    camera = wv.Camera.from_fov(8, 6, hfov=0.4)
    counts = check(scene, camera, pose, wv.render(scene, camera, pose, outputs=("color",)).color.numpy()[0])
    assert counts.max() == 12


def test_solids_have_one_front(device):
    """Behind the true surface of a transparent ball is its back, if it has one, and not the front of its triangles."""
    for double_sided, alpha in ((False, 0.5), (True, 0.75)):
        scene = wv.Scene(device=device)
        scene.background = Background(color=SKY_COLOR)
        material = glass((1.0, 0.0, 0.0, 0.5), double_sided=double_sided)
        scene.add(wv.scene.solids.sphere(0.5), name="ball", appearance=material, movable=True)
        pose, camera = wv.look_at((2.0, -2.0, 1.0), (0.0, 0.0, 0.0)), wv.Camera.from_fov(9, 9, hfov=0.2)
        shown = wv.render(scene, camera, pose, outputs=("color",)).color.numpy()[0]
        expected = (alpha * np.array((1.0, 0, 0)) + (1 - alpha) * np.array(SKY_COLOR)) * 255
        assert np.abs(shown - expected).max() <= 1.01


def test_light_shadows_and_sky_behind_glass(device):
    """Surfaces behind glass have the colors that they have without it."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((6, 6, 0.1)), name="floor", appearance=(0.7, 0.6, 0.5))
    scene.add(trimesh.creation.box((0.5, 0.5, 0.5)), name="block", pose=(0, 0, 1.0, 0, 0, 0, 1))
    dark = glass((0.0, 0.0, 0.0, 0.25), double_sided=False)
    scene.add(trimesh.creation.box((0.01, 9, 9)), name="pane", pose=(4, 0, 0, 0, 0, 0, 1), appearance=dark)
    scene.lights = (Light("directional", direction=(0.2, 0.1, -1.0)), Light("ambient", ambient=(0.2, 0.2, 0.2)))
    scene.background = Background(gradient=((0.1, 0.3, 0.9), (0.9, 0.8, 0.4), (0.1, 0.1, 0.1)))
    pose = wv.look_at((6.0, 0.3, 1.5), (0.0, 0.0, 0.4))
    seen, free = (
        wv.render(scene, PINHOLE, pose, exclude=out, outputs=("color", "segmentation")) for out in ((), ["pane"])
    )
    assert (seen.segmentation.numpy() == 2).all()
    assert {-1, 0, 1} <= set(np.unique(free.segmentation.numpy()))
    assert np.abs(seen.color.numpy() - 0.75 * free.color.numpy()).max() <= 1.01


def test_albedo_is_that_of_the_first_surface(device):
    scene = scene_of_glass(device)
    views = wv.render(scene, PINHOLE, POSE, exclude=["pane", "leaf"], outputs=("albedo", "segmentation"))
    red = views.segmentation.numpy() == 0
    assert red.sum() > 10
    assert (views.albedo.numpy()[red] == np.rint(np.array((0.9, 0.1, 0.2)) * 255)).all()


MODEL = """<mujoco><visual><headlight diffuse=".6 .6 .6" ambient=".3 .3 .3" specular="0 0 0"/>
<quality offsamples="0"/></visual>
<asset><texture type="skybox" builtin="gradient" rgb1="0.3 0.5 0.7" rgb2="0 0 0" width="100" height="600"/></asset>
<worldbody><geom type="plane" size="5 5 .1" rgba=".5 .6 .5 1"/>
<geom type="box" size=".3 .3 .3" pos="0 0 .3" rgba=".9 .1 .1 .5"/>
<geom type="ellipsoid" size=".3 .2 .4" pos="-.9 .2 .4" rgba=".1 .2 .9 .4"/>
<geom type="capsule" size=".1 .6" pos=".9 .2 .7" rgba=".1 .8 .1 1"/>
<geom type="box" size=".2 .2 .2" pos="0 .9 .4" rgba="1 0 0 0"/>
<body pos="-2 0 .5"><freejoint/><geom type="box" size=".02 .8 .5" rgba=".2 .9 .9 .2"/></body>
<camera name="a" pos="-4 0 1.5" xyaxes="0 -1 0 .25 0 1"/><camera name="b" pos="-1 -4 1.2" xyaxes="1 -.2 0 0 .25 1"/>
</worldbody></mujoco>"""


@pytest.mark.gl
@pytest.mark.parametrize("camera", ["a", "b"])
def test_transparent_geoms_of_mujoco(camera):
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    seen = scene_from_mujoco(model)
    with mujoco.Renderer(model, 120, 160) as renderer:
        renderer.update_scene(data, camera)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            renderer.scene.flags[flag] = 0
        picture = renderer.render().astype(np.int32)
    pinhole, pose = camera_from_mujoco(model, camera, 160, 120), camera_poses(data, model, [model.camera(camera).id])
    options = {"object_poses": geom_poses(data, seen), "shadows": False}
    views = wv.render(seen.scene, pinhole, pose, outputs=("color", "segmentation"), **options)
    error = np.abs(views.color.numpy()[0] - picture).max(axis=-1)
    objects = views.segmentation.numpy()[0]
    clear = [index for index, item in enumerate(seen.scene.objects) if item.appearance.materials[0].base_color[3] < 1]
    assert np.isin(objects, clear).mean() > 0.05
    assert error.mean() < 0.6
    assert np.quantile(error, 0.97) <= 2
