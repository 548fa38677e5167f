# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of objects whose appearance, vertices or normals change after they were added."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.kernels.shading.deforming import find_planes
from warpvis.scene.lights import Light
from warpvis.scene.materials import Appearance, Material, Texture

import reference

CAMERA = wv.Camera.from_fov(32, 24, hfov=0.9)
POSE = wv.look_at((2.2, -2.6, 1.8), (0.0, 0.2, 0.1))
SUN = Light("directional", direction=(0.3, 0.5, -1.0), color=(0.9, 0.8, 0.7), ambient=(0.1, 0.1, 0.1))
BALL = trimesh.creation.icosphere(2, 0.6)
CUBE = trimesh.creation.box((1.5, 1.2, 0.9))
NOISE = np.random.default_rng(0)
IMAGE = NOISE.integers(0, 256, (8, 8, 3), dtype=np.uint8)


def painted(vertices=None):
    """Return a textured box with normals."""
    vertices = CUBE.vertices if vertices is None else vertices
    uv = np.random.default_rng(1).random((len(CUBE.faces), 3, 2))
    return Appearance((Material(texture=Texture(IMAGE)),), uv=uv, normals=vertices)


def colors(scene, **options):
    return wv.render(scene, CAMERA, POSE, outputs=("color", "albedo"), **options)


def assert_same(views, expected):
    for name in ("color", "albedo"):
        np.testing.assert_array_equal(getattr(views, name).numpy(), getattr(expected, name).numpy())


def scene_of(appearance, device, *, movable=True):
    scene = wv.Scene(device=device)
    scene.lights = SUN
    scene.add(
        trimesh.creation.box((6, 6, 0.1)), name="floor", pose=(0, 0, -0.6, 0, 0, 0, 1), appearance=(0.2, 0.5, 0.3)
    )
    scene.add(CUBE, name="box", movable=movable, appearance=appearance)
    return scene


@pytest.mark.parametrize("movable", [True, False])
def test_set_appearance_equals_a_new_scene(movable, device):
    choices = [(1.0, 0.2, 0.1), painted(), None, Material(texture=Texture(IMAGE), projection="cube"), painted()]
    scene = scene_of((0.1, 0.2, 0.9), device, movable=movable)
    trees = colors(scene) and scene.triangles()
    for choice in choices:
        scene.set_appearance("box", choice)
        assert_same(colors(scene), colors(scene_of(choice, device, movable=movable)))
    assert scene.triangles() is trees, "no tree is built again"
    assert np.ptp(colors(scene).albedo.numpy(), axis=(0, 1, 2)).min() > 100


def test_set_appearance_of_an_instance_changes_no_other(device):
    scene = wv.Scene(device=device)
    poses = [(x, 0, 0, 0, 0, 0, 1) for x in (-0.8, 0.0, 0.8)]
    scene.add_instances(trimesh.creation.box((0.5, 0.5, 0.5)), poses, names="box", appearance=(0, 0, 1))
    scene.set_appearance("box_1", (1, 0, 0))
    views = wv.render(scene, CAMERA, POSE, outputs=("albedo", "segmentation"))
    albedo, segmentation = views.albedo.numpy(), views.segmentation.numpy()
    for index, expected in enumerate([(0, 0, 255), (255, 0, 0), (0, 0, 255)]):
        assert (segmentation == index).sum() > 10 and (albedo[segmentation == index] == expected).all()


def test_columns_of_tables_are_shared_unless_they_change(device):
    scene = scene_of(painted(), device)
    before = scene.device_materials(None)
    texels, planes, materials = before.texels.ptr, before.planes.ptr, before.materials.ptr
    look = scene["box"].appearance
    scene.set_appearance("box", look.with_material(Material(texture=look.materials[0].texture, base_color=(1, 0, 0))))
    after = scene.device_materials(None)
    assert (after.texels.ptr, after.planes.ptr) == (texels, planes) and after.materials.ptr != materials
    assert after.uv.ptr == before.uv.ptr and after.normals.ptr == before.normals.ptr


def test_with_material_shares_arrays():
    look = painted()
    changed = look.with_material(Material(base_color=(1, 0, 0)))
    assert changed.uv is look.uv and changed.normals is look.normals
    assert changed.materials[0].base_color == (1, 0, 0, 1) and look.materials[0].base_color == (1, 1, 1, 1)


def test_textures_and_normals_follow_vertices(device):
    scene = scene_of(painted(), device)
    before, stages = colors(scene), [CUBE.vertices, CUBE.vertices * (0.7, 1.1, 1.4), CUBE.vertices + (0.2, 0, 0.1)]
    for vertices in stages:
        scene.update_vertices("box", vertices, normals=vertices)
        fresh = scene_of(None, device)
        fresh.update_mesh("box", vertices)
        fresh.set_appearance("box", painted(vertices))
        assert_same(colors(scene), colors(fresh))
    assert not np.array_equal(colors(scene).color.numpy(), before.color.numpy())
    # Normals of corners; without normals, triangles are flat.
    corners = np.broadcast_to([0.0, 0.0, 1.0], (len(CUBE.faces), 3, 3))
    scene.update_vertices("box", CUBE.vertices, normals=corners)
    assert not np.array_equal(colors(scene).color.numpy(), before.color.numpy())
    scene.update_vertices("box", CUBE.vertices)
    assert_same(colors(scene), colors(scene_of(replace(painted(), normals=None), device)))
    plain = scene_of(painted().with_material(Material()), device)
    plain.update_vertices("box", CUBE.vertices, normals=corners)
    lit = wv.render(plain, CAMERA, POSE, outputs=("color", "segmentation"), shadows=False)
    assert len(np.unique(lit.color.numpy()[lit.segmentation.numpy() == 1], axis=0)) == 1, "one normal, one color"


def test_cube_textures_follow_vertices(device):
    """The directions into a cube map depend on the size of the object."""
    cube = Material(texture=Texture(np.repeat(IMAGE, 6, axis=0).reshape(48, 8, 3)), projection="cube")
    scene = scene_of(cube, device)
    colors(scene)
    for factor in (0.8, 1.2):
        stretched = CUBE.vertices * (factor, 1.0, 1.0)
        scene.update_vertices("box", stretched)
        fresh = scene_of(None, device)
        fresh.update_mesh("box", stretched)
        fresh.set_appearance("box", cube)
        assert_same(colors(scene), colors(fresh))


def test_planes_match_reference(device):
    points, frame = NOISE.normal(size=(9, 3)), np.array([0.3, -0.2, 0.1, 0.0, 0.6, 0.0, 0.8])
    faces = np.array([[0, 1, 2], [3, 4, 5], [6, 7, 8], [2, 5, 7]], dtype=np.int32)
    found = wp.zeros((6, 9), dtype=float, device=device)
    inputs = [wp.array(points, dtype=wp.vec3, device=device), wp.array(faces, device=device), wp.transform(*frame), 2]
    wp.launch(find_planes, len(faces), inputs=[*inputs, found], device=device)
    expected = np.concatenate([np.zeros((2, 9)), reference.find_planes(points, faces, frame)])
    np.testing.assert_allclose(found.numpy(), expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize(
    ("normals", "message"),
    [
        (np.ones((7, 3)), "normals of 'box' must be one for each of its 8 vertices, got 7"),
        (np.zeros((8, 3)), "normals must be finite and not 0: 8 are not, the first at 0"),
        ("up", "normals of 'box' must"),
    ],
)
def test_invalid_normals_are_rejected(normals, message):
    scene = scene_of(None, "cpu")
    with pytest.raises(wv.WarpvisError, match=message):
        scene.update_vertices("box", CUBE.vertices, normals=normals)


def test_invalid_appearances_are_rejected():
    scene = scene_of(None, "cpu")
    with pytest.raises(wv.WarpvisError, match="appearance of 'box' must be an Appearance, a Material or three or four"):
        scene.set_appearance("box", "red")
    with pytest.raises(wv.WarpvisError, match="'ball'"):
        scene.set_appearance("ball", None)
    with pytest.raises(wv.WarpvisError, match="face_colors of 'box' must be one for each of its 12 faces, got 2"):
        scene.set_appearance("box", Appearance(face_colors=np.zeros((2, 3), dtype=np.uint8)))


def test_copies_keep_changed_appearances():
    scene = scene_of(None, "cpu")
    scene.set_appearance("box", (1.0, 0.0, 0.0))
    again = copy.deepcopy(scene)
    scene.set_appearance("box", (0.0, 1.0, 0.0))
    assert again["box"].appearance.materials[0].base_color == (1, 0, 0, 1)
