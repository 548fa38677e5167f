# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Output "albedo": base colors of materials, vertices, faces and textures against a double-precision reference."""

import itertools

import numpy as np
import pytest
import reference_shading
import trimesh

import warpvis as wv
from warpvis.cameras import Rays
from warpvis.cameras.orthographic import OrthographicCamera
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import CameraError
from warpvis.scene import solids
from warpvis.scene._mip_levels import mip_levels
from warpvis.scene.materials import Appearance, Material, Texture
from warpvis.sensors import Motion

from support.worlds import random_poses

CAMERA = wv.Camera.from_fov(36, 28, hfov=0.9)
POSE = wv.look_at((2.2, -2.6, 1.8), (0.0, 0.2, 0.1))
NOISE = np.random.default_rng(0).integers(0, 256, (24, 40, 3), dtype=np.uint8)
BOX = trimesh.creation.box((1.5, 1.2, 0.9))
PLATE = (np.array([[-4, -4, -0.5], [4, -4, -0.5], [4, 4, -0.5], [-4, 4, -0.5]]), np.array([[0, 1, 2], [0, 2, 3]]))


def uv_of(faces, seed, scale=2.0):
    return np.random.default_rng(seed).uniform(-scale, scale, (len(faces), 3, 2)).astype(np.float32)


def appearances():
    rng = np.random.default_rng(1)
    faces, vertices = BOX.faces, BOX.vertices
    wraps = [(u, v) for u in ("repeat", "mirror", "clamp") for v in ("repeat", "mirror", "clamp")]
    made = {}
    for u, v in wraps:
        texture = Texture(NOISE, wrap_u=u, wrap_v=v)
        made[f"{u} {v}"] = Appearance((Material(texture=texture),), uv=uv_of(faces, 2))
    for space in ("srgb", "linear"):
        for stored in ("srgb", "linear"):
            texture = Texture(NOISE, color_space=stored)
            material = Material(base_color=(0.9, 0.5, 0.7), color_space=space, texture=texture)
            made[f"{space} of {stored}"] = Appearance((material,), uv=uv_of(faces, 3, 0.3))
    made["nearest"] = Appearance((Material(texture=Texture(NOISE, filter="nearest")),), uv=uv_of(faces, 4, 0.1))
    fine = rng.integers(0, 256, (256, 256, 4), dtype=np.uint8)
    made["fine"] = Appearance((Material(texture=Texture(fine)),), uv=uv_of(faces, 5))
    unfiltered = Material(texture=Texture(fine, mipmaps=False))
    made["fine without mip maps"] = Appearance((unfiltered,), uv=uv_of(faces, 5, 0.2))
    material = Material(texture=Texture(NOISE), texture_repeat=(3.0, 0.5))
    made["repeated, of vertices"] = Appearance((material,), uv=rng.uniform(0, 1, (len(vertices), 2)))
    colors = rng.integers(0, 256, (len(vertices), 4), dtype=np.uint8)
    made["vertices"] = Appearance((Material(base_color=(1, 0.5, 0.25)),), vertex_colors=colors)
    made["linear vertices"] = Appearance(
        (Material(color_space="linear"),), vertex_colors=rng.random((len(vertices), 3)).astype(np.float32)
    )
    made["faces"] = Appearance(face_colors=rng.integers(0, 256, (len(faces), 4), dtype=np.uint8))
    materials = (Material(base_color=(0.2, 0.4, 0.9)), Material(texture=Texture(NOISE)), Material(color_space="linear"))
    rows = rng.integers(0, 3, len(faces))
    made["several materials"] = Appearance(materials, face_materials=rows, uv=uv_of(faces, 6))
    return made


APPEARANCES = appearances()


@pytest.mark.smoke("*-mirror clamp", "*-repeated, of vertices", "*-clamp repeat", "*-srgb of linear", "*-nearest")
@pytest.mark.parametrize("name", APPEARANCES)
def test_colors_match_the_double_precision_reference(name, device):
    scene = wv.Scene(device=device)
    scene.add(BOX, name="box", pose=(0, 0, 0, 0, 0, 0.3826834, 0.9238795), appearance=APPEARANCES[name])
    views = wv.render(scene, CAMERA, POSE, outputs=("albedo", "segmentation", "faces"))
    expected = reference_shading.shade_base_colors(scene, CAMERA, POSE, views)
    assert len(np.unique(views.faces.numpy())) > 4
    apart = np.abs(views.albedo.numpy() - expected).max(axis=-1)
    if name == "nearest":  # a sample near a texel's border may round to either texel
        assert (apart > 1).mean() < 0.01
    else:
        assert apart.max() <= 1


def test_distant_textures_are_averaged(device):
    """A fine pattern averages to its mean instead of aliasing."""
    fine = np.kron(np.indices((128, 128)).sum(axis=0) % 2, np.ones((2, 2)))[..., None] * np.array([250, 200, 100])
    look = Appearance((Material(texture=Texture(fine.astype(np.uint8))),), uv=[[0, 0], [8, 0], [8, 8], [0, 8]])
    scene = wv.Scene(device=device)
    scene.add(PLATE, name="plate", appearance=look)
    views = wv.render(scene, CAMERA, wv.look_at((0, -20, 12), (0, 0, 0)), outputs=("albedo", "segmentation", "faces"))
    seen = views.albedo.numpy()[views.segmentation.numpy() == 0]
    assert len(seen) > 20
    assert np.abs(seen - np.array([125, 100, 50])).max() <= 2


@pytest.mark.slow
def test_movable_objects_keep_their_colors(device):
    scene = wv.Scene(device=device)
    scene.add(BOX, name="box", movable=True, appearance=APPEARANCES["repeat mirror"])
    scene.add(PLATE, name="plate")
    rows = random_poses(np.random.default_rng(0), 3, spread=0.4)
    views = wv.render(
        scene, CAMERA, np.tile(POSE, (3, 1)), outputs=("albedo", "segmentation", "faces"), object_poses=rows[:, None]
    )
    expected = reference_shading.shade_base_colors(scene, CAMERA, np.tile(POSE, (3, 1)), views, object_poses=rows)
    assert np.abs(views.albedo.numpy() - expected).max() <= 1
    assert (views.segmentation.numpy() == 0).any(axis=(1, 2)).all()


def test_textures_scale_with_objects(device):
    """An object of twice the size at twice the distance has the same colors."""
    scene = wv.Scene(device=device)
    scene.add(BOX, name="box", movable=True, appearance=APPEARANCES["clamp repeat"])
    eyes = np.stack([wv.look_at(np.array([2.2, -2.6, 1.8]) * by, (0, 0, 0)) for by in (1, 2)])
    at_origin = np.tile([0, 0, 0, 0, 0, 0, 1.0], (2, 1, 1))
    scales = np.array([[[1, 1, 1]], [[2, 2, 2]]], dtype=np.float64)
    albedo = wv.render(
        scene, CAMERA, eyes, outputs="albedo", object_poses=at_origin, object_scales=scales
    ).albedo.numpy()
    assert (np.abs(albedo[0].astype(int) - albedo[1]) > 1).mean() < 0.01


def test_colors_of_solids_and_of_objects_without_appearance(device):
    scene = wv.Scene(device=device)
    scene.add(solids.sphere(0.5), name="ball", movable=True, appearance=(0.2, 0.4, 0.6))
    scene.add(BOX, name="box", pose=(0, 3, 0, 0, 0, 0, 1))
    views = wv.render(scene, CAMERA, wv.look_at((4, 1.5, 0.5), (0, 1.5, 0)), outputs=("albedo", "segmentation"))
    albedo, seg = views.albedo.numpy(), views.segmentation.numpy()
    assert (albedo[seg == 0] == [51, 102, 153]).all() and (seg == 0).any()
    assert (albedo[seg == 1] == 255).all() and (seg == 1).any()
    assert (albedo[seg < 0] == 0).all() and (seg < 0).any()


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_solids_show_the_mean_color_of_a_texture_with_coordinates(space, device):
    ball, texture = solids.sphere(0.5), Texture(np.uint8([[[255, 40, 0], [55, 40, 0]]] * 2).repeat(8, axis=1))
    mapped = Appearance(
        (Material(base_color=(0.5, 1, 1), texture=texture, color_space=space),), uv=uv_of(ball.faces, 0)
    )
    scene = wv.Scene(device=device)
    scene.add(ball, name="mapped", movable=True, appearance=mapped)
    scene.add(ball, name="bare", pose=(0, 3, 0, 0, 0, 0, 1), movable=True, appearance=mapped.materials[0])
    views = wv.render(scene, CAMERA, wv.look_at((4, 1.5, 0.5), (0, 1.5, 0)), outputs=("albedo", "segmentation"))
    albedo, seg = views.albedo.numpy().astype(int), views.segmentation.numpy()
    red, half = np.array([255, 55]) / 255, np.array(0.5)
    if space == "srgb":
        red = red.mean() / 2
    else:
        red = reference_shading.to_screen(reference_shading.to_linear(red).mean() / 2)
        half = reference_shading.to_screen(half)
    assert (seg == 0).any() and np.abs(albedo[seg == 0] - [255 * red, 40, 0]).max() <= 2
    assert (seg == 1).any() and np.abs(albedo[seg == 1] - [255 * half, 255, 255]).max() <= 1


def test_albedo_does_not_change_other_outputs(device):
    scene = wv.scenes.PRESETS["room"].build(device)
    pose = wv.look_at((0.1, 0.2, 0.9), (0.5, 0.4, 0.3))
    names = ("depth", "points", "normals", "labels", "segmentation", "faces")
    with_colors = wv.render(scene, CAMERA, pose, outputs=(*names, "albedo"))
    without = wv.render(scene, CAMERA, pose, outputs=names)
    for name in names:
        np.testing.assert_array_equal(getattr(with_colors, name).numpy(), getattr(without, name).numpy())


def test_albedo_does_not_depend_on_batching_threads_or_pixel_lists(device):
    scene = wv.Scene(device=device)
    scene.add(BOX, name="box", appearance=APPEARANCES["fine"])
    poses = np.stack([POSE, wv.look_at((3, 1, 1), (0, 0, 0))])
    one = wv.render(scene, CAMERA, poses, outputs="albedo", threads=1)
    other = wv.render(scene, CAMERA, poses, outputs="albedo", threads=2)
    np.testing.assert_array_equal(one.albedo.numpy(), other.albedo.numpy())
    alone = wv.render(scene, CAMERA, poses[1], outputs="albedo")
    np.testing.assert_array_equal(alone.albedo.numpy()[0], one.albedo.numpy()[1])
    renderer = wv.Renderer(scene, CAMERA, outputs=("albedo",))
    np.testing.assert_array_equal(renderer.render(poses).albedo.numpy(), one.albedo.numpy())
    y, x = np.mgrid[: CAMERA.height, : CAMERA.width] + 0.5
    points = np.tile(np.stack([x, y], axis=-1).reshape(1, -1, 2), (2, 1, 1))
    at = renderer.render_at(poses, points).albedo.numpy().reshape(one.albedo.numpy().shape)
    assert (np.abs(at.astype(int) - one.albedo.numpy()) > 1).mean() < 0.01


def test_lens_cameras_and_lidars_return_albedo(device):
    scene = wv.Scene(device=device)
    scene.add(BOX, name="box", appearance=APPEARANCES["repeat repeat"])
    lens = wv.Camera.from_opencv([[40.0, 0, 17.5], [0, 40.0, 13.5], [0, 0, 1]], [1e-9, 0, 0, 0], 36, 28)
    pinhole = wv.Camera(36, 28, 40, 40, 18, 14)
    one, other = (wv.render(scene, camera, POSE, outputs="albedo").albedo.numpy() for camera in (lens, pinhole))
    # Pixels of a lens cover equal angles; a pinhole's pixels cover smaller angles toward the border.
    assert np.abs(one.astype(int) - other).mean() < 6
    rays = lens.rays.reshape(-1, 3)
    scan = Rays(rays / np.linalg.norm(rays, axis=-1, keepdims=True))
    assert wv.render(scene, scan, POSE, outputs="albedo").albedo.shape == (1, 36 * 28)


def test_orthographic_camera_returns_albedo(device):
    """The image of a plate seen from above is its texture if pixels and texels coincide."""
    image = np.random.default_rng(0).integers(0, 256, (8, 8, 3), dtype=np.uint8)
    for kind in ("nearest", "linear"):
        look = Appearance((Material(texture=Texture(image, filter=kind)),), uv=[[0, 0], [1, 0], [1, 1], [0, 1]])
        scene = wv.Scene(device=device)
        scene.add(PLATE, name="plate", appearance=look)
        camera = OrthographicCamera.from_extent(8, 8, across=8.0)
        albedo = wv.render(scene, camera, [0, 0, 2, 1, 0, 0, 0], outputs="albedo").albedo.numpy()[0]
        np.testing.assert_array_equal(albedo, image)


def test_objects_added_later_have_their_color(device):
    scene = wv.Scene(device=device)
    scene.add(BOX, name="box", appearance=(1.0, 0.0, 0.0))
    renderer = wv.Renderer(scene, CAMERA, outputs=("albedo",))
    assert (renderer.render(POSE).albedo.numpy() == [255, 0, 0]).all(axis=-1).any()
    scene.add(PLATE, name="plate", appearance=(0.0, 1.0, 0.0))
    assert (renderer.render(POSE).albedo.numpy() == [0, 255, 0]).all(axis=-1).any()


def test_updated_vertices_keep_their_colors(device):
    scene, twin = wv.Scene(device=device), wv.Scene(device=device)
    scene.add(BOX, name="box", movable=True, appearance=APPEARANCES["clamp mirror"])
    renderer = wv.Renderer(scene, CAMERA, outputs=("albedo",))
    for factor in (1.5, 0.7):
        moved = BOX.vertices * factor + [0.1, 0.0, 0.2]
        scene.update_vertices("box", moved)
        twin = wv.Scene(device=device)
        twin.add((moved, BOX.faces), name="box", movable=True, appearance=APPEARANCES["clamp mirror"])
        expected = wv.render(twin, CAMERA, POSE, outputs="albedo").albedo.numpy().astype(int)
        assert (np.abs(renderer.render(POSE).albedo.numpy() - expected) > 1).mean() < 0.01


@pytest.mark.parametrize("is_encoded", [False, True])
@pytest.mark.parametrize("size", [(16, 8), (10, 7), (1, 5), (301, 3)])
def test_mip_levels_interpolate_linearly(size, is_encoded):
    image = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
    levels = mip_levels(image, is_encoded=is_encoded)
    assert [level.shape[:2] for level in levels[:2]] == [size, (max(size[0] // 2, 1), max(size[1] // 2, 1))]
    for finer, level in itertools.pairwise(levels):  # of rounded levels, as in the tables
        np.testing.assert_allclose(level, reference_shading.levels_of(finer, is_encoded)[1], rtol=0, atol=1)
        assert (level == reference_shading.levels_of(finer, is_encoded)[1]).mean() > 0.98


def test_last_texel_of_odd_image_is_in_next_level():
    """Mesa's `glGenerateMipmap` of the same image."""
    image = np.array([10, 20, 30, 40, 250], dtype=np.uint8)[None, :, None].repeat(3, axis=2)
    level = mip_levels(image)[1]
    assert level[0, :, 0].tolist() == [18, 93]  # at 0.75 and 3.25 from the first texel


def test_mip_levels_of_cube_sides_are_separate():
    cube = np.random.default_rng(0).integers(0, 256, (6 * 8, 8, 3), dtype=np.uint8)
    for side in range(6):
        alone = mip_levels(cube[8 * side : 8 * side + 8])
        for number, level in enumerate(mip_levels(cube, 6)):
            size = 8 >> number
            np.testing.assert_array_equal(level[size * side : size * side + size], alone[number])


def test_cube_map_faces_have_their_colors(device):
    """A sphere with a cube map of six colors, seen from each side."""
    colors = np.array([[200, 0, 0], [0, 200, 0], [0, 0, 200], [200, 200, 0], [0, 200, 200], [200, 0, 200]])
    cube = np.repeat(colors, 4, axis=0)[:, None].repeat(4, axis=1).astype(np.uint8)
    place = np.array([1.0, -2.0, 0.5, 0, 0, np.sqrt(0.5), np.sqrt(0.5)])  # rotated by 90 degrees
    turn = poses_to_matrices(place)[:3, :3]
    for movable in (False, True):
        scene, look = wv.Scene(device=device), Material(texture=Texture(cube), projection="cube")
        scene.add(trimesh.creation.icosphere(2, 0.5), name="ball", pose=place, movable=movable, appearance=look)
        for (axis, sign), color in zip(reference_shading.SIDES, colors, strict=True):
            away = turn[:, axis] * 3 * sign
            up = (0, 0, 1) if axis < 2 else (0, 1, 0)
            pose = wv.look_at(place[:3] + away, place[:3], up=up)
            albedo = wv.render(scene, CAMERA, pose, outputs="albedo").albedo.numpy()
            np.testing.assert_array_equal(albedo[0, 14, 18], color)


def test_albedo_of_moving_camera_raises():
    scene = wv.Scene(device="cpu")
    scene.add(BOX, name="box")
    motion = Motion([POSE, POSE], [0.0, 1.0])
    with pytest.raises(CameraError, match="outputs must not contain albedo for a Motion"):
        wv.render(scene, CAMERA, motion, outputs="albedo")
