# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Skinned meshes of people, groups that do not touch, and figures of one's own."""

import itertools
import math

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.errors import FileFormatError, PoseError, SceneError
from warpvis.situations import (
    Body,
    Figure,
    Person,
    at_table,
    crouching,
    in_circle,
    in_queue,
    looking_at,
    reaching,
    sitting,
    standing,
    walking,
)
from warpvis.situations.people._skin import make_skin

from support.bodies import penetration, placed
from support.figures import mixamo_arrays, write_glb

POSTURES = {
    "standing": standing(),
    "sitting": sitting(),
    "crouching": crouching(0.7),
    "walking": walking(0.6),
    "reaching": looking_at((0.5, -0.2, 1.2), reaching((0.5, -0.2, 1.2))),
}
BODIES = {"man": (1.76, "male", 1.0), "woman": (1.63, "female", 1.0), "stout": (1.7, "average", 1.3)}


@pytest.mark.parametrize("size", BODIES.values(), ids=BODIES)
def test_a_skin_is_closed(size):
    skin = make_skin(Body(*size))
    mesh = trimesh.Trimesh(skin.vertices, skin.faces, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert 3000 <= len(skin.faces) <= 9000
    # About as much volume as the mass of soldiers of that height, at the density of water.
    assert 0.7 * 25 * size[0] ** 2 < 1000 * mesh.volume < 1.7 * 25 * size[0] ** 2
    np.testing.assert_allclose(skin.weights.sum(axis=1), 1)
    np.testing.assert_allclose(skin.colors.sum(axis=1), 1)
    facing = (mesh.vertex_normals * skin.normals).sum(axis=1)
    assert (facing > 0.3).mean() > 0.99
    assert skin.vertices[:, 2].max() == pytest.approx(size[0], abs=0.01)


def silhouette(scene, eye, target):
    camera = wv.Camera.from_fov(160, 160, hfov=0.8)
    return wv.render(scene, camera, wv.look_at(eye, target), outputs=("depth",)).depth.numpy()[0] > 0


@pytest.mark.parametrize("posture", POSTURES.values(), ids=POSTURES)
def test_silhouettes_of_solids_and_mesh_agree(posture):
    scenes = []
    person = Person(height=1.75, sex="male", posture=posture)
    for body in ("solids", "mesh"):
        scenes.append(wv.Scene())
        person.add_to(scenes[-1], "anna", body=body)
    middle = scenes[0].bounds.mean(axis=0)
    for azimuth in np.arange(6) * math.pi / 3:
        eye = middle + 2.6 * np.array([math.cos(azimuth), math.sin(azimuth), 0.15])
        first, second = (silhouette(scene, eye, middle) for scene in scenes)
        overlap = (first & second).sum() / (first | second).sum()
        assert overlap > 0.9 - 0.05 * (posture.kind == "crouching"), azimuth


def test_a_mesh_follows_new_postures():
    scene = wv.Scene()
    person = Person(height=1.7)
    agent = person.add_to(scene, "anna", body="mesh")
    assert agent.body == ("anna/body",) and agent.head is None
    person.doing(sitting()).update(scene, "anna")
    moved = scene["anna/body"].vertices
    np.testing.assert_allclose(moved, person.doing(sitting()).mesh_vertices()[0][0], atol=1e-5)
    assert abs(moved[:, 2].min()) < 0.02
    poses = Person(pose=np.array([[0, 0, 0], [1, 2, 0.5]])).object_poses("mesh")
    np.testing.assert_allclose(poses[1, 0], [1, 2, 0, 0, 0, math.sin(0.25), math.cos(0.25)], atol=1e-12)


def test_meshes_are_deterministic():
    first, second = (make_skin.__wrapped__(Body(1.66)) for _ in range(2))
    assert first.vertices.tobytes() == second.vertices.tobytes() and first.faces.tobytes() == second.faces.tobytes()


PEOPLE = [Person(height=h, build=b) for h, b in ((1.5, 1.0), (1.9, 1.3), (1.7, 0.8), (1.75, 1.0), (1.62, 1.2))]
GROUPS = {
    "circle": lambda: in_circle(PEOPLE),
    "two": lambda: in_circle(PEOPLE[:2], center=(3, 1), start=1.0),
    "queue": lambda: in_queue(PEOPLE, heading=1.0),
    "walkers": lambda: in_queue([person.doing(walking(0.0)) for person in PEOPLE]),
    "table": lambda: at_table(PEOPLE, size=(2.6, 0.8)),
    "turned table": lambda: at_table(PEOPLE[:4], size=(1.8, 0.8), heading=0.7, center=(1, 2)),
}


@pytest.mark.parametrize("group", GROUPS.values(), ids=GROUPS)
def test_people_of_a_group_do_not_touch(group):
    for one, other in itertools.combinations(group(), 2):
        for (first, at), (second, there) in itertools.product(placed(one), placed(other)):
            if np.linalg.norm(at[:3, 3] - there[:3, 3]) < 0.9:
                assert penetration((first.solid, at), (second.solid, there)) < 0


def test_people_in_a_circle_face_its_center():
    for person in in_circle(PEOPLE, center=(3, 1)):
        forward = wv.core.poses.poses_to_matrices(person.eye_pose)[:3, 2]
        line = np.array([3, 1]) - person.eye_pose[:2]
        np.testing.assert_allclose(forward[:2], line / np.linalg.norm(line), atol=1e-6)


@pytest.fixture(scope="module")
def figure():
    return Figure(**mixamo_arrays())


@pytest.mark.parametrize("posture", POSTURES.values(), ids=POSTURES)
def test_a_figure_moves_like_the_skin_that_it_is_made_of(figure, posture):
    own, ours = Person(figure=figure, posture=posture), Person(height=1.75, sex="male", posture=posture)
    np.testing.assert_allclose(own.mesh_vertices()[0], ours.mesh_vertices()[0], atol=0.025)
    np.testing.assert_allclose(own.eye_pose[:3], ours.eye_pose[:3], atol=0.025)
    assert own.mesh_vertices()[0][0, :, 2].min() == pytest.approx(0, abs=0.015)


def test_a_figure_reaches(figure):
    target = (0.45, -0.2, 1.1)
    person = Person(figure=figure, posture=reaching(target))
    np.testing.assert_allclose(person.hand_positions()[0], target, atol=1e-9)
    scene = wv.Scene()
    agent = person.add_to(scene, "anna", body="mesh")
    assert scene[agent.body[0]].label == wv.Label.HUMAN


@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
def test_figures_of_any_axes_are_turned_upright(figure, axes):
    arrays = mixamo_arrays()
    turned = Figure(**{**arrays, **{name: arrays[name][:, list(axes)] for name in ("vertices", "joints")}})
    np.testing.assert_allclose(
        Person(figure=turned).mesh_vertices()[0], Person(figure=figure).mesh_vertices()[0], atol=1e-9
    )
    small = Figure(**{**arrays, "vertices": arrays["vertices"] * 100, "joints": arrays["joints"] * 100}, height=1.75)
    assert small.body.height == pytest.approx(1.75)


def test_figures_are_read_from_gltf(tmp_path):
    arrays = mixamo_arrays()
    weights = write_glb(tmp_path / "own.glb", arrays)
    read = wv.io.read_figure(tmp_path / "own.glb")
    same = Figure(**{**arrays, "weights": weights})
    first, second = (Person(figure=one, posture=walking(0.2)).mesh_vertices()[0] for one in (read, same))
    np.testing.assert_allclose(first, second, atol=1e-5)
    assert read.appearance.materials[0].base_color[:3] == pytest.approx((0.5, 0.4, 0.3))


def _without(**changes):
    return {**mixamo_arrays(), **changes}


BAD = {
    "circle": (lambda: in_circle(PEOPLE, radius=0.3), "radius must be at least"),
    "queue": (lambda: in_queue(PEOPLE, spacing=0.1), "spacing must be at least"),
    "table": (lambda: at_table(PEOPLE, size=(1.0, 0.8)), "size must give a length of at least"),
    "nobody": (lambda: in_circle([]), "people must be a list of at least one Person"),
    "worlds": (lambda: in_queue([Person(posture=walking([0, 0.1]))]), "in one world each"),
    "body": (lambda: Person().object_poses("bones"), 'body must be "solids" or "mesh"'),
    "figure": (lambda: Person(figure="me.glb"), "figure of a person must be a Figure"),
    "two heights": (lambda: Person(figure=Figure(**mixamo_arrays()), height=1.8), "are those of the figure"),
    "centimeters": (lambda: Figure(**_without(vertices=mixamo_arrays()["vertices"] * 100)), "pass height="),
    "names": (lambda: Figure(**_without(names=None)), "only those of SMPL's 24 are known"),
    "no knee": (
        lambda: Figure(**_without(names=[n.replace("LeftLeg", "Strut") for n in mixamo_arrays()["names"]])),
        "no joint of the figure was found for shank_left",
    ),
    "no joint": (lambda: Figure(**_without(segments={"head": "Kopf"})), "there is no joint 'Kopf'"),
    "parents": (lambda: Figure(**_without(parents=[0] * 17)), "parents of a figure must be one index"),
    "weights": (lambda: Figure(**_without(weights=np.ones((3, 17)))), "weights of a figure must be numbers"),
    "no file": (lambda: wv.io.read_figure("none.glb"), "none.glb: cannot be read"),
    "no glTF": (lambda: wv.io.read_figure("person.fbx"), "must be a glTF file"),
}


@pytest.mark.parametrize(("call", "message"), BAD.values(), ids=BAD)
def test_wrong_input_is_one_sentence(call, message):
    with pytest.raises((PoseError, SceneError, FileFormatError)) as caught:
        call()
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_without_people_are_refused(tmp_path):
    trimesh.creation.box().export(tmp_path / "box.glb")
    with pytest.raises(FileFormatError, match="has no skinned mesh"):
        wv.io.read_figure(tmp_path / "box.glb")
    (tmp_path / "bad.glb").write_bytes(b"glTF\2\0\0\0")
    with pytest.raises(FileFormatError, match="cannot be read as a figure"):
        wv.io.read_figure(tmp_path / "bad.glb")
