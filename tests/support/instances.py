# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes of many instances, and checks of their images."""

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.rendering.casters.base import ViewBatch
from warpvis.scene import solids
from warpvis.scene.acceleration import traversal_plan
from warpvis.scene.worlds import parse_worlds

from compare import wrong_depth
from support.worlds import eyes, random_poses

MESH = trimesh.creation.icosphere(subdivisions=1, radius=0.25)
COUNT = 35  # several full groups of lanes and a partial one


@pytest.fixture
def shared(monkeypatch):
    """Lower the number of instances that share a tree: the brute-force reference has to render them."""
    monkeypatch.setattr(traversal_plan, "_MIN_USES", 10)
    monkeypatch.setattr(traversal_plan, "_MIN_SAVED", 1000)
    monkeypatch.setattr(traversal_plan, "_MIN_SAVED_CUDA", 1000)


def rows(seed=0):
    return random_poses(np.random.default_rng(seed), COUNT)


def build(device="cpu", *, mesh=MESH, offset=0.0, movable=0):
    """Return a floor, instances from two calls, some movable objects among them, and a few unshared objects."""
    scene = wv.Scene(device=device)
    places = rows().astype(np.float64)
    places[:, :3] += offset
    scene.add_instances(mesh, places[:20], names="early", label="object", movable=False)
    floor = trimesh.creation.box((5, 5, 0.02))
    scene.add(floor, name="floor", label="ground", pose=[*np.broadcast_to(offset, 3), 0, 0, 0, 1])
    for number in range(movable):
        mover = solids.sphere(0.2) if number == 1 else trimesh.creation.box((0.3, 0.4, 0.5))
        scene.add(mover, name=f"mover_{number}", label="robot", movable=True)
    scene.add_instances(mesh, places[20:], names="late", label="human", movable=False)
    return scene


def twin(scene):
    """Return a scene with the same objects without shared meshes."""
    apart = wv.Scene()
    for item in scene:
        pose = {} if item.pose is None else {"pose": item.pose, "movable": True}
        mesh = item.solid or (item.vertices if item.pose is None else item.mesh_vertices, item.faces)
        apart.add(mesh, name=item.name, label=item.label, **pose)
    return apart


def instances_of(scene):
    return len(traversal_plan.plan_traversal(scene.objects, scene.device).instances)


def assert_alike(one, other):
    for view in range(len(one.depth.numpy())):
        wrong = wrong_depth(one.depth.numpy()[view], other.depth.numpy()[view].astype(np.float64))
        assert wrong.mean() <= 1e-4
    assert (one.segmentation.numpy() != other.segmentation.numpy()).mean() <= 1e-4
    assert (one.labels.numpy() != other.labels.numpy()).mean() <= 1e-4


def assert_missing_world_is_empty(renderer, places):
    """Check that a view of an out-of-range world index, which GPUs do not validate, is empty."""
    worlds = parse_worlds(renderer.scene, 3, places, np.zeros(3, dtype=np.int32), None)
    worlds.world = wp.array([1, 2, -1], dtype=wp.int32, device=renderer.scene.device)
    views = renderer.render(eyes(3), object_poses=places, world_index=[1, 0, 0])
    before = views.depth.numpy().copy()
    poses = renderer._caster.parse_poses(eyes(3), "opencv")
    renderer._caster.cast(ViewBatch(poses, worlds), renderer._images_of(views))
    np.testing.assert_array_equal(views.depth.numpy()[0], before[0])
    assert np.isposinf(views.depth.numpy()[1:]).all()
