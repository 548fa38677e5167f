# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tessellation of MuJoCo's geoms: its error bound, and comparison with MuJoCo's rays."""

import copy
import math
import os
import pickle
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
import warp as wp
from mujoco_models import SHAPES, shapes_model

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.kernels.mujoco import arrays as kernels
from warpvis.mujoco import (
    MujocoScene,
    WorldPoses,
    _tessellation as tessellation,
    camera_from_mujoco,
    camera_poses,
    geom_poses,
    scene_from_mujoco,
)
from warpvis.scene import solids
from warpvis.scene.closed import provably_closed

import reference
from support.mujoco_scene import rendered


def from_xml(body, head=""):
    return mujoco.MjModel.from_xml_string(f"<mujoco>{head}<worldbody>{body}</worldbody></mujoco>")


# Signed distances of points from the exact surface, positive outside.
def sphere_distance(points, radius):
    return np.linalg.norm(points, axis=-1) - radius


def capsule_distance(points, radius, half):
    axis = np.zeros_like(points)
    axis[..., 2] = points[..., 2].clip(-half, half)
    return np.linalg.norm(points - axis, axis=-1) - radius


def cylinder_distance(points, radius, half):
    beyond = np.stack([np.linalg.norm(points[..., :2], axis=-1) - radius, np.abs(points[..., 2]) - half], axis=-1)
    return np.linalg.norm(beyond.clip(0), axis=-1) + beyond.max(axis=-1).clip(max=0)


def ellipsoid_distance(points, axes):
    """The nearest point is p a^2 / (a^2 + t), where t, found by bisection, places it on the ellipsoid."""
    squares, points = np.square(axes), np.abs(points)
    low = np.full(points.shape[:-1], -np.min(squares) + 1e-9)
    high = np.linalg.norm(points * axes, axis=-1)
    for _ in range(100):
        middle = (low + high) / 2
        outside = (np.square(points * axes / (squares + middle[..., None])).sum(axis=-1)) > 1
        low, high = np.where(outside, middle, low), np.where(outside, high, middle)
    nearest = points * squares / (squares + low[..., None])
    return np.linalg.norm(points - nearest, axis=-1)


ROUND = {
    "sphere": (lambda t: solids.sphere(0.3, mesh_tolerance=t), lambda p: sphere_distance(p, 0.3), 0.3),
    "tiny sphere": (lambda t: solids.sphere(1e-3, mesh_tolerance=t), lambda p: sphere_distance(p, 1e-3), 1e-3),
    "huge sphere": (lambda t: solids.sphere(40.0, mesh_tolerance=t), lambda p: sphere_distance(p, 40.0), 40.0),
    "capsule": (lambda t: solids.capsule(0.1, 0.5, mesh_tolerance=t), lambda p: capsule_distance(p, 0.1, 0.5), 0.1),
    "cylinder": (lambda t: solids.cylinder(0.2, 0.1, mesh_tolerance=t), lambda p: cylinder_distance(p, 0.2, 0.1), 0.2),
    "ellipsoid": (
        lambda t: solids.ellipsoid((0.2, 0.1, 0.05), mesh_tolerance=t),
        lambda p: ellipsoid_distance(p, (0.2, 0.1, 0.05)),
        0.2,
    ),
}


def triangles_of(solid):
    return solid.vertices, solid.faces


def points_on(vertices, faces, steps=5):
    """Return a grid of points on every triangle, including corners, edges and centers."""
    grid = [(a, b, steps - a - b) for a in range(steps + 1) for b in range(steps + 1 - a)]
    return np.einsum("gc,fcx->fgx", np.array(grid) / steps, vertices[faces]).reshape(-1, 3)


@pytest.mark.smoke("*-0.0005", "*-0.002", "sphere-*", "capsule-*")
@pytest.mark.parametrize("tolerance", [2e-3, 5e-4, 5e-5])
@pytest.mark.parametrize("name", ROUND)
def test_triangles_are_within_tolerance_of_exact_surface(name, tolerance):
    make, distance, radius = ROUND[name]
    vertices, faces = triangles_of(make(tolerance))
    most = solids.largest_error(tolerance, radius)
    assert most == max(tolerance, 1e-4 * radius)
    error = np.abs(distance(points_on(vertices, faces)))
    assert error.max() <= most * (1 + 1e-6)
    if most < 0.02 * radius:  # the minimum number of triangles applies to coarser shapes
        assert error.max() >= 0.5 * most


@pytest.mark.parametrize("name", ROUND)
def test_exact_surface_is_within_tolerance_of_triangles(name):
    make, _, radius = ROUND[name]
    tolerance = 0.02 * radius
    vertices, faces = triangles_of(make(tolerance))
    finer = make(1e-3 * radius)  # fine enough to stand for the exact surface
    true = points_on(finer.vertices, finer.faces, steps=2)[::7]
    found = trimesh.Trimesh(vertices, faces, process=False).ray.intersects_location
    # Along rays from the center, the distance is at least that to the nearest point.
    hits, rays, _ = found(np.zeros_like(true), true / np.linalg.norm(true, axis=1, keepdims=True), multiple_hits=False)
    assert len(np.unique(rays)) == len(true)
    gap = np.abs(np.linalg.norm(hits, axis=1) - np.linalg.norm(true[rays], axis=1))
    steepest = 6 if name == "capsule" else 4  # upper bound of the ratio of both distances
    assert gap.max() <= (tolerance + 1e-3 * radius) * steepest


SOLIDS = {
    **{name: triangles_of(make(1e-3)) for name, (make, _, _) in ROUND.items()},
    "box": tessellation.box((0.1, 0.2, 0.3)),
    "plane": tessellation.plane(2.0, 3.0),
    "hills": tessellation.height_field(np.random.default_rng(0).random((5, 7)), np.array([0.4, 0.3, 0.2, 0.05])),
}
VOLUMES = {
    "sphere": 4 / 3 * math.pi * 0.3**3,
    "capsule": math.pi * 0.1**2 * 1.0 + 4 / 3 * math.pi * 0.1**3,
    "cylinder": math.pi * 0.2**2 * 0.2,
    "ellipsoid": 4 / 3 * math.pi * 0.2 * 0.1 * 0.05,
    "box": 8 * 0.1 * 0.2 * 0.3,
}


@pytest.mark.parametrize("name", SOLIDS)
def test_shapes_are_watertight_and_oriented_outward(name):
    vertices, faces = SOLIDS[name]
    assert vertices.dtype == np.float64 and faces.dtype == np.int32
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    assert provably_closed(vertices.astype(np.float32), faces) == (name != "hills")
    if name in VOLUMES:
        assert mesh.volume == pytest.approx(VOLUMES[name], rel=0.03)


def test_height_field_matches_mujoco_heights():
    elevation = np.arange(12.0).reshape(3, 4) / 11
    vertices, _ = tessellation.height_field(elevation, np.array([0.6, 0.2, 0.5, 0.1]))
    assert vertices[0] == pytest.approx([-0.6, -0.2, 0])
    assert vertices[3] == pytest.approx([0.6, -0.2, 0.5 * 3 / 11])
    assert vertices[11] == pytest.approx([0.6, 0.2, 0.5])
    assert vertices[:, 2].min() == pytest.approx(-0.1)


def test_visible_geoms_become_objects():
    model, _ = shapes_model()
    geoms = scene_from_mujoco(model)
    scene = geoms.scene
    assert isinstance(geoms, MujocoScene) and geoms.geom_count == model.ngeom
    left_out = {"hidden", "hidden_by_material", "no_color", "collision"}
    names = [model.geom(geom).name for geom in range(model.ngeom)]
    assert geoms.geom_ids.tolist() == [geom for geom, name in enumerate(names) if name not in left_out]
    assert {int(model.geom_type[geom]) for geom in geoms.geom_ids} == set(range(9))  # all types of geoms
    for index, geom in enumerate(geoms.geom_ids):
        item = scene.objects[index]
        assert item.name == (names[geom] or item.name)
        assert item.label == (wv.Label.GROUND if names[geom] in ("the_floor", "shelf", "hills") else wv.Label.OBSTACLE)


def test_unnamed_geoms_are_named_after_their_body():
    model = from_xml("""
      <geom size="1"/><geom size="1"/>
      <body name="cup"><geom size="1"/><geom name="cup_1" size="1"/><geom size="1"/></body>
      <body><geom size="1"/></body>""")
    names = [item.name for item in scene_from_mujoco(model).scene]
    assert names == ["world", "world_1", "cup", "cup_1", "cup_2", "body_2"]


def test_geom_groups_select_geoms():
    model, _ = shapes_model()
    assert [item.name for item in scene_from_mujoco(model, geom_groups=(3,)).scene] == ["collision"]
    assert len(scene_from_mujoco(model, geom_groups=range(6)).scene) == len(scene_from_mujoco(model).scene) + 1
    assert len(scene_from_mujoco(model, geom_groups=()).scene) == 0


def test_labels_and_exclude_match_geom_or_body_names():
    model, _ = shapes_model()
    labels = {"*": "object", "hand": "robot", "the_*": "obstacle"}
    scene = scene_from_mujoco(model, labels=labels, exclude=["ball", "hil*"]).scene
    assert scene["hand"].label == wv.Label.ROBOT
    assert scene["the_floor"].label == wv.Label.OBSTACLE
    assert scene["egg"].label == wv.Label.OBJECT
    assert not {"ball", "ball_1", "ball_2", "hills"} & {item.name for item in scene}


def test_movable_geoms():
    model, _ = shapes_model()
    geoms = scene_from_mujoco(model)
    scene = geoms.scene
    moving = {item.name for item in scene if item.movable}
    still = {"the_floor", "shelf", "hills", "fixed_box", "field"}
    assert moving == {item.name for item in scene} - still
    assert "own_color" in moving and scene["own_color"].solid  # shapes with poses are exact surfaces
    assert {"target", "under_target"} <= moving  # a mocap body and its child
    assert geoms.movable_geoms.tolist() == [geoms.geom_ids[index] for index in scene.movable]
    assert len(scene_from_mujoco(model, movable="all").movable_geoms) == len(scene)
    assert {item.name for item in scene_from_mujoco(model, static=False).scene} == moving - {"own_color"}


def test_rigidly_attached_geoms_share_a_pose():
    """Geoms of a body, and of bodies welded to it, share a pose; round shapes have separate poses."""
    model = from_xml(
        """<geom type="box" size="1 1 .1"/>
           <body name="a"><freejoint/><geom type="box" size=".1 .2 .3"/><geom size=".1" pos="1 0 0"/>
             <body name="b" pos="0 0 1"><geom type="box" size=".3 .2 .1" euler="30 0 0"/></body>
             <body name="c" pos="0 1 0"><joint/><geom type="box" size=".3 .2 .1"/></body></body>
           <body name="m" mocap="true"><geom type="box" size=".1 .1 .1"/><geom type="box" size=".2 .1 .1"/></body>"""
    )
    geoms = scene_from_mujoco(model)
    scene = geoms.scene
    parents = [None if item.parent is None else scene.objects[item.parent].name for item in scene]
    assert [item.name for item in scene] == ["world", "a", "a_1", "b", "c", "m", "m_1"]
    assert parents == [None, None, None, "a", None, None, "m"]
    assert geoms.movable_geoms.tolist() == [1, 2, 4, 5]
    data = mujoco.MjData(model)
    data.qpos[:7] = [0.3, 0.2, 0.5, 0.5, 0.5, 0.5, 0.5]
    mujoco.mj_kinematics(model, data)
    place = poses_to_matrices(geom_poses(data, geoms)[0].astype(np.float64))
    corners = scene["b"].mesh_vertices @ place[:3, :3].T + place[:3, 3]
    true = tessellation.box((0.3, 0.2, 0.1))[0] @ data.geom_xmat[3].reshape(3, 3).T + data.geom_xpos[3]
    np.testing.assert_allclose(corners, true, atol=1e-6)
    assert all(item.parent is None for item in scene_from_mujoco(model, movable="all").scene)


def test_equal_geoms_have_equal_meshes():
    model = from_xml(
        """<body><freejoint/><geom type="mesh" mesh="tetra"/><geom type="mesh" mesh="tetra" pos="1 0 0"/>
           <geom size=".1 .2 .3" type="box"/><geom size=".1 .2 .3" type="box" pos="0 1 0"/><geom size=".2"/></body>""",
        '<asset><mesh name="tetra" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>',
    )
    scene = scene_from_mujoco(model, movable="all").scene
    first, second, box, other_box, sphere = (item.mesh_vertices for item in scene)
    assert np.array_equal(first, second) and np.array_equal(box, other_box)
    assert not np.array_equal(box[: len(first)], first[: len(box)]) and len(sphere) > len(box)


def test_scene_is_copied_to_device(device):
    model, _ = shapes_model()
    geoms = scene_from_mujoco(model, exclude=["egg"], labels={"hand": "robot"}).to(device)
    scene = geoms.scene
    assert isinstance(geoms, MujocoScene) and str(scene.device) == device
    assert "egg" not in scene and scene["hand"].label == wv.Label.ROBOT
    assert len(geoms.geom_ids) == len(scene)


ANOTHER_PROCESS = """
import pickle, sys
from support.mujoco_scene import rendered
from mujoco_models import shapes_model
sys.stdout.buffer.write(rendered(pickle.load(sys.stdin.buffer), shapes_model()[1]))
"""


@pytest.mark.slow
def test_pickle_renders_equal_images_in_another_process():
    model, data = shapes_model()
    geoms = scene_from_mujoco(model)
    geoms.scene.add(trimesh.creation.box((0.1, 0.2, 0.3)), name="crate", pose=(0, -1, 0.5, 0, 0, 0, 1), movable=True)
    expected = rendered(geoms, data)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    command = [sys.executable, "-c", ANOTHER_PROCESS]
    result = subprocess.run(command, input=pickle.dumps(geoms), capture_output=True, env=environment, check=True)
    assert result.stdout[-len(expected) :] == expected


@pytest.mark.smoke("deep")
@pytest.mark.parametrize("make", [copy.copy, copy.deepcopy, lambda geoms: geoms.to("cpu")], ids=["copy", "deep", "to"])
def test_copies_render_equal_images_and_are_independent(make):
    model, data = shapes_model()
    geoms = scene_from_mujoco(model, labels={"hand": "robot"})
    expected = rendered(geoms, data)
    again = make(geoms)
    assert isinstance(again, MujocoScene) and rendered(again, data) == expected
    again.scene.add(trimesh.creation.box((0.1, 0.2, 0.3)), name="crate", pose=(0, -1, 0.5, 0, 0, 0, 1))
    assert rendered(again, data) != expected and rendered(geoms, data) == expected
    assert "crate" not in geoms.scene


def test_added_objects_keep_their_initial_poses(device):
    model, data = shapes_model()
    geoms = scene_from_mujoco(model, device=device)
    crate = (0.5, -1, 0.25, 0, 0, 0.6, 0.8)
    geoms.scene.add(trimesh.creation.box((0.1, 0.2, 0.3)), name="crate", pose=crate, movable=True)
    geoms.scene.add(
        trimesh.creation.box((0.1, 0.2, 0.3)), name="lid", pose=(0.5, -1, 0.5, 0, 0, 0, 1), attach_to="crate"
    )
    rows = geom_poses(data, geoms)
    alone = geom_poses(data, scene_from_mujoco(model, device=device))
    assert rows.shape == (len(alone) + 1, 7) and np.array_equal(rows[:-1], alone)
    np.testing.assert_allclose(rows[-1], crate, atol=1e-6)
    several = geom_poses(WorldPoses.of([data, data]), geoms)
    assert several.shape == (2, *rows.shape) and np.array_equal(several[1], rows)
    assert geoms.geoms_of_objects().tolist() == [*geoms.geom_ids.tolist(), -1, -1]


def place(data, rng):
    """Set random rotations and positions."""
    data.qpos[:] = rng.normal(size=len(data.qpos))
    data.mocap_quat[:] = rng.normal(size=data.mocap_quat.shape)


def test_poses_match_mujoco():
    model, data = shapes_model()
    scene = scene_from_mujoco(model)
    rng = np.random.default_rng(2)
    worlds = []
    for _ in range(5):
        place(data, rng)
        mujoco.mj_forward(model, data)
        worlds.append(WorldPoses.of([data]))
        rows = geom_poses(data, scene)
        assert rows.shape == (len(scene.movable_geoms), 7) and rows.dtype == np.float32
        expected = reference.geom_transforms(data.geom_xpos[None], data.geom_xmat[None], [0], scene.movable_geoms)[0]
        assert np.abs(poses_to_matrices(rows) - expected).max() < 1e-6
        eyes = camera_poses(data, model, [0, 4])
        expected = reference.camera_transforms(data.cam_xpos[None], data.cam_xmat[None], [0, 4], [0])[:, 0]
        assert np.abs(poses_to_matrices(eyes) - expected).max() < 1e-6
    # Several worlds, with rotations as rows of nine or as matrices.
    xpos = np.concatenate([world.geom_xpos for world in worlds])
    xmat = np.concatenate([world.geom_xmat for world in worlds])
    rows = geom_poses(WorldPoses(xpos, xmat), scene)
    assert rows.shape == (5, len(scene.movable_geoms), 7)
    assert np.array_equal(rows, geom_poses(WorldPoses(xpos, xmat.reshape(5, -1, 3, 3)), scene))
    assert np.array_equal(rows[3], geom_poses(worlds[3], scene)[0])


def test_half_revolutions_keep_their_axes():
    """Near the minimum trace of a matrix, a naive conversion loses all digits."""
    model = from_xml('<body><freejoint/><geom size="1"/></body>')
    scene, data = scene_from_mujoco(model), mujoco.MjData(model)
    for quaternion in np.eye(4).tolist() + [[0, 1, 1, 0], [0, 0, 1, 1], [1e-4, 1, 0, 0], [0, 1, -1, 1]]:
        data.qpos[3:] = quaternion
        mujoco.mj_forward(model, data)
        assert np.abs(poses_to_matrices(geom_poses(data, scene))[0, :3, :3].ravel() - data.geom_xmat[0]).max() < 1e-6


def test_kernels_match_reference(device):
    rng = np.random.default_rng(3)
    rotations = poses_to_matrices(rng.normal(size=(4, 6, 7)))[..., :3, :3].astype(np.float32)
    positions = rng.normal(size=(4, 6, 3)).astype(np.float32)
    xpos, xmat = wp.array(positions, dtype=wp.vec3, device=device), wp.array(rotations, dtype=wp.mat33, device=device)
    rows, columns = wp.array([2, 0, 3], dtype=int, device=device), wp.array([5, 1], dtype=int, device=device)
    for kernel in (kernels.geom_transforms, kernels.camera_transforms):
        out = wp.zeros((3, 2), dtype=wp.transform, device=device)
        first, second = (rows, columns) if kernel is kernels.geom_transforms else (columns, rows)
        out = wp.zeros((len(first), len(second)), dtype=wp.transform, device=device)
        wp.launch(kernel, dim=out.shape, inputs=[xpos, xmat, first, second, out], device=device)
        expected = getattr(reference, kernel.key)(positions, rotations, first.numpy(), second.numpy())
        assert np.abs(poses_to_matrices(out.numpy()) - expected).max() < 1e-6
    objects = rng.integers(-1, 4, size=100).astype(np.int32)
    out = wp.zeros(100, dtype=int, device=device)
    ids = np.array([7, 3, 9, 1], dtype=np.int32)
    inputs = [wp.array(objects, device=device), wp.array(ids, device=device), out]
    wp.launch(kernels.geoms_of_objects, dim=100, inputs=inputs, device=device)
    assert np.array_equal(out.numpy(), reference.geoms_of_objects(objects, ids))


@pytest.mark.smoke("*-packets-wrist", "*-packets-lens", "*-rays-side")
@pytest.mark.parametrize("camera", ["front", "side", "follower", "wrist", "lens"])
def test_pixels_match_mj_ray(camera, device, caster, tolerance=2e-4):
    model, data = shapes_model()
    for name in ("field", "hidden", "hidden_by_material", "own_color", "no_color"):
        model.geom(
            name
        ).group = 4  # rays hit another surface of signed distance fields, and colors are handled differently
    scene = scene_from_mujoco(model, mesh_tolerance=tolerance, device=device)
    eye = camera_from_mujoco(model, camera, 64, 48)
    pose = camera_poses(data, model, [model.camera(camera).id])[0]
    renderer = wv.Renderer(scene.scene, eye, outputs=("depth", "segmentation", "normals"), caster=caster)
    views = renderer.render(pose, object_poses=geom_poses(data, scene))
    depth, normals = views.depth.numpy()[0].astype(np.float64), views.normals.numpy()[0].astype(np.float64)
    geoms = reference.geoms_of_objects(views.segmentation.numpy()[0], scene.geom_ids)

    matrix = poses_to_matrices(pose)
    rays = reference.pixel_rays(eye)
    lengths = np.linalg.norm(rays, axis=-1)
    rays = rays / lengths[..., None] @ matrix[:3, :3].T
    expected, hit_geoms, hit = np.full(depth.shape, np.inf), np.full(depth.shape, -1), np.zeros(1, dtype=np.int32)
    for pixel in np.ndindex(depth.shape):
        groups = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
        distance = mujoco.mj_ray(model, data, matrix[:3, 3].copy(), rays[pixel], groups, 1, -1, hit)
        if 0 <= distance / lengths[pixel] <= eye.far:
            expected[pixel], hit_geoms[pixel] = distance / lengths[pixel], hit[0]

    assert (geoms != hit_geoms).mean() <= 4e-3  # silhouettes move by the tolerance
    same = (geoms == hit_geoms) & np.isfinite(depth)
    assert same.mean() > 0.5 and len(np.unique(geoms)) >= 6
    # The tolerance is measured along the normal: oblique rays deviate more, most at silhouettes.
    slant = np.abs((normals * rays).sum(axis=-1))[same]
    allowed = tolerance / np.maximum(slant, 1e-3) / lengths[same] + 1e-5 * np.maximum(1, expected[same])
    error = np.abs(depth[same] - expected[same])
    assert (error <= allowed).mean() >= 0.998
    flat = np.isin(model.geom_type[geoms[same]], [0, 1, 6, 7])
    assert error[flat].max() <= 1e-4


def test_camera_with_resolution_needs_no_size():
    model, _ = shapes_model()
    camera = camera_from_mujoco(model, "lens")
    assert (camera.width, camera.height) == (200, 120)
    assert (camera.fx, camera.fy) == pytest.approx((150, 125))  # focal lengths 3 and 2.5 mm of a sensor of 4 by 2.4 mm
    # Principal point: the sensor's y points up, so the axis is left of the center by x and above it by y.
    assert (camera.cx, camera.cy) == pytest.approx((100 - 25, 60 + 15))
    assert (camera.near, camera.far) == pytest.approx((0.01, 40))


def test_camera_from_field_of_view_has_square_pixels():
    model, _ = shapes_model()
    for camera in ("front", model.camera("front").id, np.int32(model.camera("front").id)):
        got = camera_from_mujoco(model, camera, 320, 200)
        expected = wv.Camera.from_fov(320, 200, vfov=math.radians(50), near=0.01, far=40)
        for name in ("fx", "fy", "cx", "cy", "near", "far"):
            assert getattr(got, name) == pytest.approx(getattr(expected, name), rel=1e-6)
    free = camera_from_mujoco(model, -1, 320, 200)
    assert free.vfov == pytest.approx(math.radians(model.vis.global_.fovy))


MODEL = mujoco.MjModel.from_xml_string(SHAPES)
SMALL = from_xml('<geom name="ball" size="1"/><camera name="eye"/>')

BAD = {
    "no model": (lambda: scene_from_mujoco("model.xml"), "model must be a mujoco.MjModel, got str"),
    "bad tolerance": (
        lambda: scene_from_mujoco(SMALL, mesh_tolerance=0),
        "mesh_tolerance must be a positive number of meters",
    ),
    "NaN tolerance": (
        lambda: scene_from_mujoco(SMALL, mesh_tolerance=math.nan),
        "mesh_tolerance must be a positive number",
    ),
    "group 6": (lambda: scene_from_mujoco(SMALL, geom_groups=(0, 6)), r"geom_groups must be of 0 to 5, got \(0, 6\)"),
    "bad movable": (lambda: scene_from_mujoco(SMALL, movable="none"), 'movable must be "bodies" or "all"'),
    "no such geom": (lambda: scene_from_mujoco(SMALL, exclude=["bal"]), "'bal' in exclude must match a geom or body"),
    "no such label": (lambda: scene_from_mujoco(SMALL, labels={"x*": 1}), r"'x\*' in labels must match a geom or body"),
    "bad label": (lambda: scene_from_mujoco(SMALL, labels={"*": "wall"}), "label must be one of"),
    "no such camera": (lambda: camera_from_mujoco(SMALL, "I", 8, 8), "camera 'I' is not in the model, which has 'eye'"),
    "no such id": (lambda: camera_from_mujoco(SMALL, 1, 8, 8), "camera 1 is not in the model"),
    "no size": (
        lambda: camera_from_mujoco(SMALL, "eye"),
        "width and height must be given for a camera without a resolution",
    ),
    "half a size": (lambda: camera_from_mujoco(SMALL, "eye", 8), "width and height must both be given"),
    "size 0": (
        lambda: camera_from_mujoco(SMALL, "eye", 8, 0),
        "height must be a whole number of pixels from 1 up",
    ),
    "no poses": (
        lambda: geom_poses(3, scene_from_mujoco(MODEL)),
        "poses must be a mujoco.MjData, a WorldPoses, or an object with geom_xpos",
    ),
    "other model": (
        lambda: geom_poses(mujoco.MjData(SMALL), scene_from_mujoco(MODEL)),
        r"geom_xpos must have shape \(W, \d+\), got \(1, 1, 3\)|geom_xpos must have shape \(W, \d+, 3\)",
    ),
    "unequal worlds": (
        lambda: geom_poses(WorldPoses(np.zeros((2, 1, 3)), np.zeros((1, 1, 9))), scene_from_mujoco(SMALL)),
        "geom_xpos and geom_xmat must be of the same worlds, got 2 and 1",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_invalid_arguments_are_rejected(name):
    call, message = BAD[name]
    with pytest.raises(wv.WarpvisError, match=message):
        call()
