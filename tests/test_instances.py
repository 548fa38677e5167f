# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Static objects that share a mesh and its tree render like the same triangles as one mesh."""

import pickle

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.cameras.orthographic import OrthographicCamera
from warpvis.scene import solids
from warpvis.scene._object import Instances
from warpvis.scene.acceleration import traversal_plan

from compare import assert_matches_reference
from support import instances as instance_scenes
from support.instances import (
    COUNT,
    MESH,
    assert_alike,
    assert_missing_world_is_empty,
    build,
    instances_of,
    rows,
    twin,
)
from support.worlds import ALL, SMALL, STILL, assert_bits_equal, eyes, random_poses

shared = instance_scenes.shared  # a fixture


@pytest.mark.smoke("*-packets-False")
@pytest.mark.parametrize("cull_backfaces", [False, True])
def test_instances_match_the_reference(shared, cull_backfaces, device, caster):
    scene = build(device)
    assert instances_of(scene) == COUNT
    assert scene.movable == ()
    poses = eyes(3)
    views = wv.render(scene, SMALL, poses, outputs=ALL, caster=caster, cull_backfaces=cull_backfaces)
    assert len(np.unique(views.segmentation.numpy())) > 25
    assert_matches_reference(views, twin(scene), SMALL, poses, cull_backfaces=cull_backfaces)


def test_instances_far_from_the_origin(shared, device, caster):
    """At 10 km, poses of instances, and vertices of the merged mesh, are rounded by half a millimeter."""
    scene = build(device, offset=1e4)
    poses = eyes(3)
    poses[:, :3] += np.float32(1e4)
    one, other = (
        wv.render(which, SMALL, poses, outputs=ALL, caster=caster).depth.numpy() for which in (scene, twin(scene))
    )
    assert (np.isfinite(one) == np.isfinite(other)).mean() > 0.999
    assert np.isclose(one, other, rtol=0, atol=5e-3).mean() > 0.99


def test_movable_objects_render_among_instances(shared, device, caster):
    """With worlds, scales and exclusion; columns of poses refer to movable objects only."""
    scene = build(device, movable=3)
    alone = twin(scene)
    assert instances_of(scene) == COUNT
    assert scene.movable == alone.movable == (21, 22, 23)
    rng = np.random.default_rng(3)
    given = {
        "object_poses": random_poses(rng, 4, 3),
        "object_scales": rng.uniform(0.5, 2, (4, 3, 3)).astype(np.float32),
        "world_index": np.array([2, 0, 3]),
        "exclude": ["early_3", "late_1", "mover_0"],
    }
    one, other = (wv.render(which, SMALL, eyes(3), outputs=ALL, caster=caster, **given) for which in (scene, alone))
    assert_alike(one, other)
    seen = {scene.objects[index].name for index in np.unique(one.segmentation.numpy()) if index >= 0}
    assert {"mover_1", "mover_2"} <= seen
    assert not seen & {"early_3", "late_1", "mover_0"}
    flags = np.zeros((3, len(scene)), dtype=np.uint8)
    flags[1, [3, 25]] = 1
    given["exclude"] = flags
    one, other = (wv.render(which, SMALL, eyes(3), outputs=ALL, caster=caster, **given) for which in (scene, alone))
    assert_alike(one, other)


def test_missing_world_renders_empty(shared, device, caster):
    renderer = wv.Renderer(build(device, movable=2), SMALL, outputs=ALL, caster=caster)
    assert_missing_world_is_empty(renderer, random_poses(np.random.default_rng(5), 2, 2))


def test_instances_in_other_projections(shared, device, caster):
    """A clipping near plane, image points, and an orthographic camera."""
    scene = build(device, movable=2)
    alone = twin(scene)
    near = wv.Camera.from_fov(96, 72, hfov=0.994837, near=2.2, far=100.0)
    options = {"outputs": ALL, "caster": caster, "near_plane": "clip"}
    assert_alike(*(wv.render(which, near, eyes(2), **options) for which in (scene, alone)))
    at = np.random.default_rng(0).uniform(0, 72, (2, 500, 2)).astype(np.float32)
    renderers = [wv.Renderer(which, SMALL, outputs=ALL, caster=caster) for which in (scene, alone)]
    assert_alike(*(renderer.render_at(eyes(2), at) for renderer in renderers))
    parallel = OrthographicCamera.from_extent(60, 50, across=3.0, far=50.0)
    assert_alike(*(wv.render(which, parallel, eyes(2), outputs=ALL) for which in (scene, alone)))


def test_visibility_of_instances_matches_merged_mesh(shared, device):
    scene = build(device, movable=2)
    alone = twin(scene)
    points = np.random.default_rng(1).uniform(-2, 2, (400, 3)).astype(np.float32)
    for caster in ("rays", "packets"):
        one, other = (
            wv.point_visibility(which, SMALL, eyes(3), points, caster=caster, occluders=True)
            for which in (scene, alone)
        )
        for mine, its in zip(one, other, strict=True):
            assert (mine.numpy() != its.numpy()).mean() <= 2e-3
        reports = [wv.object_visibility(which, SMALL, eyes(3), caster=caster) for which in (scene, alone)]
        mine, its = (report.fraction.numpy() for report in reports)
        np.testing.assert_allclose(mine, its, atol=0.05)
        counts, others = (report.silhouette_pixels.numpy() for report in reports)
        assert np.abs(counts - others).max() <= 2
        assert counts.max() > 100


def test_static_solids_share_triangles(shared, device, caster):
    scene = build(device, mesh=solids.sphere(0.2))
    assert instances_of(scene) == COUNT
    views = wv.render(scene, SMALL, eyes(2), outputs=ALL, caster=caster)
    assert_alike(views, wv.render(twin(scene), SMALL, eyes(2), outputs=ALL, caster=caster))


def test_instances_added_one_by_one_share_mesh(shared):
    """`Scene.add` shares a mesh from its second use on, and its objects return world-space vertices."""
    scene, places = wv.Scene(), rows()
    for number, row in enumerate(places):
        scene.add(MESH, name=f"ball_{number}", pose=row, scale=(1, 2, 1))
    assert instances_of(scene) == COUNT - 1
    assert "vertices" not in vars(scene["ball_5"])
    expected = trimesh.transform_points(MESH.vertices * [1, 2, 1], wv.core.poses.poses_to_matrices(places[5]))
    np.testing.assert_allclose(scene["ball_5"].vertices, expected, atol=1e-6)
    views = wv.render(scene, SMALL, eyes(2), outputs=ALL)
    assert_matches_reference(views, twin(scene), SMALL, eyes(2))
    for other in (pickle.loads(pickle.dumps(scene)), scene.to("cpu")):
        assert_bits_equal(wv.render(other, SMALL, eyes(2), outputs=ALL), views)


@pytest.mark.smoke("*packets*")
def test_update_mesh_detaches_instance(shared, device, caster):
    scene = build(device)
    before = scene["early_4"].vertices
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    scene.update_mesh("early_3", box.vertices + [0, 0, 1.5], box.faces)
    assert instances_of(scene) == COUNT - 1
    np.testing.assert_array_equal(scene["early_4"].vertices, before)
    views = wv.render(scene, SMALL, eyes(2), outputs=ALL, caster=caster)
    assert (views.segmentation.numpy() == scene.index("early_3")).any()
    assert_matches_reference(views, twin(scene), SMALL, eyes(2))


def test_update_mesh_of_movable_object_among_instances(shared, device, caster):
    """Only the tree of the updated object is replaced."""
    scene = build(device, movable=2)
    wv.render(scene, SMALL, eyes(2), outputs=ALL, caster=caster)
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.6)
    scene.update_mesh("mover_0", ball.vertices, ball.faces)
    views, others = (wv.render(which, SMALL, eyes(2), outputs=ALL, caster=caster) for which in (scene, twin(scene)))
    assert_alike(views, others)
    assert (views.segmentation.numpy() == scene.index("mover_0")).sum() > 100


@pytest.mark.parametrize(
    ("uses", "subdivisions", "instances"), [(63, 5, 0), (64, 5, 64), (60000, 0, 0), (205, 4, 0), (206, 4, 206)]
)
def test_tree_sharing_thresholds(uses, subdivisions, instances):
    """At least 64 objects of at least 64 triangles share a tree if that saves 2^20 triangles."""
    scene = wv.Scene()
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    scene.add_instances(mesh, np.tile(STILL, (uses, 1)), movable=False)
    assert len(traversal_plan.plan_traversal(scene._objects, scene.device).instances) == instances


def test_100000_instances_use_little_memory():
    """Instances of 10,000 triangles, a billion in total, allocate neither objects nor transformed vertices."""
    scene, mesh = wv.Scene(), trimesh.creation.uv_sphere(count=(51, 50), radius=0.3)
    side = np.arange(316)
    places = np.zeros((side.size**2, 7))
    places[:, 0], places[:, 1] = np.repeat(side, side.size), np.tile(side, side.size)
    places[:, 6] = 1
    assert len(places) * len(mesh.faces) > 9e8
    scene.add_instances(mesh, places, movable=False, names="ball", label="object")
    struct = scene.bvh().struct
    names = ("leaves", "owners", "nodes", "children", "movable_object", "movable_root", "movable_leaf", "instance_pose")
    names += ("movable_first_id", "movable_closed", "movable_boxes", "movable_solid", "movable_size")
    arrays = [getattr(struct, name) for name in names]
    assert sum(array.size * wp.types.type_size_in_bytes(array.dtype) for array in arrays) < 15e6
    assert scene.triangle_count == len(places) * len(mesh.faces)
    assert all(isinstance(item, Instances) for item in scene._objects._items)
