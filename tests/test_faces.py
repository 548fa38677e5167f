# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Output ``faces``: index of the hit triangle in the object's original mesh."""

import pickle

import mujoco
import numpy as np
import pytest

import warpvis as wv
from warpvis.cameras import Rays
from warpvis.cameras.orthographic import OrthographicCamera
from warpvis.cameras.rays import WideCamera
from warpvis.scene import solids
from warpvis.sensors import Corruptions, Motion, RollingShutter

import reference
from compare import wrong_depth
from support import instances as instance_scenes
from support.ray_patterns import sphere_of_rays
from support.triangle_faces import BALL, BOX, COUNT, FACES, TORUS, assert_faces_hold, build, odd, worlds_of
from support.worlds import ALL, SMALL, assert_bits_equal, eyes

STILL = (0, 0, 0, 0, 0, 0, 1)


few_share = instance_scenes.shared  # a fixture


def test_faces_in_worlds(device, caster, few_share):
    """With instances, attached objects, solids, and exclusion of static, attached and movable objects."""
    scene, given = build(device)
    worlds, names = worlds_of(scene), {item.name: number for number, item in enumerate(scene)}
    assert instance_scenes.instances_of(scene) == COUNT
    renderer = wv.Renderer(scene, SMALL, outputs=FACES, caster=caster)
    views = renderer.render(eyes(4), object_poses=worlds, world_index=[0, 1, 1, 0])
    seen = assert_faces_hold(views, scene, given, worlds[[0, 1, 1, 0]])
    assert seen >= {names[name] for name in ("object_0", "torus", "table", "lamp", "twin", "ring", "sphere", "post")}
    assert len(seen) >= 15
    gone = ("torus", "lamp", "twin", "ball_3")
    fewer = assert_faces_hold(renderer.render(eyes(2), object_poses=worlds, exclude=gone), scene, given, worlds)
    assert not fewer & {names[name] for name in gone} and names["table"] in fewer
    larger = renderer.render(eyes(2), object_poses=worlds, object_scales=np.full((len(scene.movable), 3), 1.25))
    np.testing.assert_array_equal(larger.faces.numpy() < 0, np.isin(larger.segmentation.numpy(), [-1, *_round(given)]))


def _round(given):
    return [index for index, mesh in enumerate(given) if mesh is None]


def test_faces_match_the_reference(device, caster):
    """The nearest triangle in double precision, except where a ray passes through an edge."""
    scene, given = build(device, moving=False)
    views, pose = wv.render(scene, SMALL, eyes(1), outputs=FACES, caster=caster), eyes(1)[0]
    expected = reference.cast_rays(scene, SMALL, pose)
    same = ~wrong_depth(views.depth.numpy()[0], expected.depth) & (expected.gap > 1e-5) & (expected.faces >= 0)
    assert same.mean() > 0.5
    faces = np.array([views.faces.numpy()[0][same], expected.faces[same]])
    of = expected.objects[same]
    # Duplicate triangles are equivalent.
    corners = [np.sort(np.array([given[index][1][face] for index, face in zip(of, row, strict=True)])) for row in faces]
    assert (corners[0] != corners[1]).any(axis=1).mean() <= 1e-3


def test_faces_do_not_affect_other_outputs(device, caster):
    """Other outputs are bit-identical, and face data is built on first request."""
    scene, _ = build(device)
    worlds = worlds_of(scene)
    before = wv.render(scene, SMALL, eyes(2), outputs=ALL, object_poses=worlds, caster=caster)
    assert scene.bvh().struct.slot_face is None and scene.triangles().struct.triangle_face is None
    assert before.faces is None
    views = wv.render(scene, SMALL, eyes(2), outputs=FACES, object_poses=worlds, caster=caster)
    assert_bits_equal(views, before)
    built = scene.bvh()
    alone = wv.render(scene, SMALL, eyes(2), outputs=("faces",), object_poses=worlds, caster=caster)
    np.testing.assert_array_equal(alone.faces.numpy(), views.faces.numpy())
    assert scene.bvh() is built
    assert "faces" not in wv.Renderer(scene, SMALL).outputs


def test_faces_of_image_points(device, caster):
    """A list with points inside and outside the image; a map; pixel centers as in an image."""
    scene, given = build(device)
    worlds = worlds_of(scene)
    renderer = wv.Renderer(scene, SMALL, outputs=FACES, caster=caster)
    pixels = np.random.default_rng(0).uniform((-3, -3), (99, 75), (2, 500, 2)).astype(np.float32)
    assert_faces_hold(renderer.render_at(eyes(2), pixels, object_poses=worlds), scene, given, worlds)
    y, x = np.mgrid[:72, :96] + 0.5
    centers = np.tile(np.stack([x, y], axis=-1)[None], (2, 1, 1, 1)).astype(np.float32)
    views = renderer.render_at(eyes(2), centers, object_poses=worlds)
    assert_faces_hold(views, scene, given, worlds)


@pytest.mark.parametrize("kind", ["wide", "list", "parallel"])
def test_faces_of_other_cameras(kind, device, few_share):
    scene, given = build(device)
    worlds = worlds_of(scene)
    if kind == "parallel":
        camera, casters = OrthographicCamera(60, 50, 15, 15, 30, 25), ("rays",)
    else:
        casters = ("packets", "rays")
        camera = WideCamera(90, 70, 3.0, "spherical") if kind == "wide" else Rays(sphere_of_rays(999))
    for caster in casters:
        views = wv.render(
            scene, camera, eyes(2), outputs=FACES, object_poses=worlds, caster=caster, convention="opencv"
        )
        assert views.faces.shape == views.depth.shape
        assert len(assert_faces_hold(views, scene, given, worlds)) > 5


@pytest.mark.parametrize("rounded", [False, True])
def test_faces_of_rays_with_distinct_origins(rounded, device):
    """Cast in packets on CPU cores, but as single rays if there are solids."""
    scene, given = build(device, rounded=rounded)
    worlds = worlds_of(scene)
    directions = sphere_of_rays(2000)
    lidar = Rays(directions, origins=np.random.default_rng(2).uniform(-0.02, 0.02, (2000, 3)))
    views = wv.render(scene, lidar, eyes(2, radius=1.9), outputs=FACES, object_poses=worlds)
    assert len(assert_faces_hold(views, scene, given, worlds)) > 5


def test_faces_with_motion_within_a_frame(device):
    """A rolling shutter, and objects whose motion leaves them in place, which use the kernel of moving objects."""
    scene, given = build(device)
    worlds = worlds_of(scene, 1)
    shutter = RollingShutter(SMALL, 0.04)
    renderer = wv.Renderer(scene, shutter, outputs=FACES)
    eye = eyes(1)[0]
    sensor = Motion([eye, eye + np.array([0.1, 0, 0, 0, 0, 0, 0], dtype=np.float32)], [0, 0.04])
    views = renderer.render(sensor, object_poses=worlds)
    assert len(assert_faces_hold(views, scene, given, worlds)) > 5
    standing = Motion(np.stack([worlds[0], worlds[0]]), [0, 0.04])
    again = renderer.render(sensor, object_poses=standing)
    assert_faces_hold(again, scene, given, worlds)
    assert (again.faces.numpy() != views.faces.numpy()).mean() <= 1e-3


def test_faces_with_a_sensor_are_exact(device):
    scene, _ = build(device)
    outputs = ("depth", "faces", "reasons")
    sensed = wv.render(scene, SMALL, eyes(1), outputs=outputs, frame=0, sensor=Corruptions())
    exact = wv.render(scene, SMALL, eyes(1), outputs=("faces",))
    np.testing.assert_array_equal(sensed.faces.numpy(), exact.faces.numpy())


def test_faces_of_changing_meshes(device, caster):
    """Deformed vertices, a replaced mesh, an added object, and a pickled copy."""
    scene, given = build(device)
    worlds = worlds_of(scene)
    renderer = wv.Renderer(scene, SMALL, outputs=FACES, caster=caster)

    def check():
        assert_faces_hold(renderer.render(eyes(2), object_poses=worlds), scene, given, worlds)

    check()
    for name, mesh in (("twin", odd(TORUS)), ("torus", odd(BALL)), ("sphere", odd(BOX))):
        index = scene.index(name)
        scene.update_mesh(name, *mesh)
        given[index] = mesh
        check()
    ring = scene.index("ring")
    given[ring] = given[ring][0] * [1, 1.5, 0.7], given[ring][1]
    scene.update_vertices("ring", given[ring][0])
    check()
    given.append(odd(TORUS))
    scene.add(given[-1], name="last")
    check()
    scene, renderer = pickle.loads(pickle.dumps((scene, renderer)))
    renderer.scene = scene
    check()


@pytest.mark.parametrize("height", [0.0, -6.0], ids=["inside", "outside"])
def test_solid_has_no_faces(height, device, caster):
    """From inside, the solid's internal triangles are rendered, which have no user index."""
    scene = wv.Scene(device=device)
    scene.add(solids.sphere(3.0), name="dome", movable=True)
    scene.add(BOX, name="box", pose=(0, 0, height + 2, 0, 0, 0, 1))
    pose = np.array([[0, 0, height, 0, 0, 0, 1]], dtype=np.float32)
    views = wv.render(scene, SMALL, pose, outputs=("segmentation", "faces"), caster=caster)
    objects, faces = views.segmentation.numpy(), views.faces.numpy()
    assert (faces[objects == 0] == -1).all() and (faces[objects == 1] >= 0).all()
    assert {0, 1} <= set(np.unique(objects))


def test_mujoco_batch_shows_faces_of_the_later_coinciding_geom():
    """The later mesh has the same triangles in reverse order."""
    vertex, faces = "0 0 0 1 0 0 0 1 0 0 0 1", ("0 2 1 0 1 3 0 3 2 1 2 3", "1 2 3 0 3 2 0 1 3 0 2 1")
    meshes = "".join(f'<mesh name="m{k}" vertex="{vertex}" face="{some}"/>' for k, some in enumerate(faces))
    text = """<mujoco><asset>{}</asset><worldbody><camera pos="2 2 2" xyaxes="-1 1 0 -1 -1 2"/>
      <body><freejoint/>{}</body></worldbody></mujoco>"""
    found = []
    for names in (("m0", "m1"), ("m1",)):
        geoms = "".join(f'<geom type="mesh" mesh="{name}"/>' for name in names)
        model = mujoco.MjModel.from_xml_string(text.format(meshes, geoms))
        batch = wv.mujoco.BatchRenderer(model, height=30, width=40, outputs=("segmentation", "faces"))
        views = batch.render(model.qpos0)
        assert set(np.unique(views.segmentation.numpy())) == {-1, len(names) - 1}
        found.append(views.faces.numpy())
    assert np.array_equal(*found) and (found[0] >= 0).sum() > 50
