# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of `quaternion="wxyz"`: every function that accepts poses of 7 numbers accepts both orders."""

import inspect

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis import viz
from warpvis.core.poses import poses_to_matrices, to_xyzw

from support.garbage import public_callables

CAMERA = wv.Camera.from_fov(16, 12, hfov=1.2, near=0.1, far=20.0)
POSES = np.array([wv.look_at((-2, 0.3, 0.8), (0.5, 0, 0.2)), wv.look_at((0.3, 2, 1.0), (0, 0, 0.2), up=(0.3, 0, 1))])
MOVED = np.array([[[0.4, 0.2, 0.4, 0.1, 0.5, 0.2, 0.83666]]])
POINTS = np.array([[0.0, 0, 0.3], [0.4, 0.2, 0.4], [1.5, 1.0, 0.1]])
DEPTH = np.full((2, 12, 16), 2.0, dtype=np.float32)
BOX = {"bounds": [[-1, -1, -0.2], [1, 1, 1]], "cell_size": 0.2}


def w_first(rows):
    return np.asarray(rows)[..., [0, 1, 2, 6, 3, 4, 5]]


def scene(device="cpu"):
    made = wv.Scene(device=device)
    made.add(trimesh.creation.box((6, 6, 0.1)), name="floor", label="ground", pose=(0, 0, -0.05, 0, 0, 0, 1))
    made.add(trimesh.creation.box((0.2, 0.7, 0.4)), name="block", label="object", pose=(0, 0, 0.2, 0, 0, 0, 1))
    made.add(trimesh.creation.box((0.3, 0.1, 0.6)), name="moved", movable=True, pose=(0, 1, 0.3, 0, 0, 0, 1))
    return made


def both(call):
    """Return the results of a call for poses in xyzw order and in wxyz order."""
    return call(POSES, MOVED), call(w_first(POSES), w_first(MOVED), quaternion="wxyz")


def arrays_in(result):
    """Return all arrays of a result, in a fixed order."""
    if isinstance(result, wp.array):
        return [result.numpy()]
    if isinstance(result, tuple | list):
        return [array for item in result for array in arrays_in(item)]
    if hasattr(result, "__dataclass_fields__"):
        return [array for name in result.__dataclass_fields__ for array in arrays_in(getattr(result, name))]
    return [result] if isinstance(result, np.ndarray) else []


SCENE = scene()
CALLS = {
    "render": lambda c, o, **q: wv.render(SCENE, CAMERA, c, object_poses=o, **q),
    "Renderer.render": lambda c, o, **q: wv.Renderer(SCENE, CAMERA).render(c, object_poses=o, **q),
    "Renderer.render_at": lambda c, o, **q: wv.Renderer(SCENE, CAMERA).render_at(
        c, np.full((2, 3, 2), 5.5, dtype=np.float32), object_poses=o, **q
    ),
    "Motion": lambda c, o, **q: wv.sensors.Motion([c, c], [0, 1], **q).at(0.5),
    "Motion.from_twist": lambda c, o, **q: wv.sensors.Motion.from_twist(c, (1, 0, 0), (0, 1, 0), **q).at(0.5),
    "Motion.per_ray": lambda c, o, **q: wv.render(
        SCENE, CAMERA, wv.sensors.Motion.per_ray(np.tile(c[:, None, None], (1, 12, 1, 1)), **q)
    ),
    "render_wide": lambda c, o, **q: wv.rendering.render_wide(SCENE, 16, 8, 4.0, c, object_poses=o, **q),
    "point_visibility": lambda c, o, **q: wv.point_visibility(SCENE, CAMERA, c, POINTS, object_poses=o, **q),
    "point_visibility_from_depth": lambda c, o, **q: wv.point_visibility_from_depth(DEPTH, CAMERA, c, POINTS, **q),
    "object_visibility": lambda c, o, **q: wv.object_visibility(SCENE, CAMERA, c, object_poses=o, **q),
    "perspective": lambda c, o, **q: wv.perspective(
        SCENE, [wv.Agent("a", CAMERA, c, **q), wv.Agent.kinect("b", c, **q)], object_poses=o, **q
    ),
    "Agent.human": lambda c, o, **q: wv.Agent.human("a", c, **q).poses,
    "back_project": lambda c, o, **q: wv.back_project(DEPTH, CAMERA, c, **q),
    "classify": lambda c, o, **q: wv.classify(DEPTH, CAMERA, c, **q),
    "plan_visibility": lambda c, o, **q: wv.maps.plan_visibility(SCENE, CAMERA, c, **q),
    "voxel_map": lambda c, o, **q: wv.voxel_map(DEPTH, CAMERA, c, **BOX, **q),
    "voxel_map_from_scene": lambda c, o, **q: wv.voxel_map_from_scene(SCENE, CAMERA, c, object_poses=o, **BOX, **q),
    "best_views": lambda c, o, **q: wv.planning.best_views(SCENE, CAMERA, c, objects=["moved"], object_poses=o, **q),
    "check_constraints": lambda c, o, **q: wv.planning.check_constraints(
        SCENE, CAMERA, c, {"moved": wv.planning.Constraint(fraction=(0, 1), distance=(0, 9))}, object_poses=o, **q
    ),
    "sample_views": lambda c, o, **q: wv.planning.sample_views(
        SCENE,
        CAMERA,
        {"moved": wv.planning.Constraint(angle=(0, 1), direction=(1, 0, 0))},
        wv.planning.ShellRegion("moved", (1, 2)),
        count=2,
        seed=0,
        object_poses=o,
        **q,
    ),
    "coverage": lambda c, o, **q: wv.planning.coverage(SCENE, CAMERA, c, object_poses=o, **q),
    "surface_samples": lambda c, o, **q: wv.planning.surface_samples(SCENE, spacing=0.5, object_poses=o, **q),
    "clearance": lambda c, o, **q: wv.planning.clearance(SCENE, POINTS + (0.05, 0.1, 0.25), object_poses=o, **q),
    "minimum_height": lambda c, o, **q: wv.planning.minimum_height(SCENE, POINTS + 1, POINTS, object_poses=o, **q),
    "standing_room": lambda c, o, **q: wv.planning.standing_room(SCENE, c, radius=0.3, object_poses=o, **q),
    "Frames.from_poses": lambda c, o, **q: wv.Frames.from_poses(c, object_poses=o, **q),
}


@pytest.mark.parametrize("name", CALLS)
def test_wxyz_order_gives_equal_results(name):
    one, other = both(CALLS[name])
    arrays = arrays_in(one)
    assert arrays
    for first, second in zip(arrays, arrays_in(other), strict=True):
        np.testing.assert_array_equal(first, second)
    wrong = CALLS[name](w_first(POSES), w_first(MOVED))  # the order matters
    assert name in {"plan_visibility", "standing_room"} or any(
        first.shape != second.shape or not np.array_equal(first, second, equal_nan=first.dtype.kind == "f")
        for first, second in zip(arrays, arrays_in(wrong), strict=True)
    )


def test_scene_add_accepts_wxyz():
    one, other = scene(), wv.Scene()
    for item in one:
        other.add((item.vertices, item.faces), name=item.name)
    mesh, row = trimesh.creation.box(), MOVED[0, 0]
    for made, pose, order in ((one, row, "xyzw"), (other, w_first(row), "wxyz")):
        made.add(mesh, name="new", pose=pose, quaternion=order)
    np.testing.assert_array_equal(one["new"].vertices, other["new"].vertices)


def test_matrices_ignore_quaternion_order():
    matrices = poses_to_matrices(POSES)
    one, other = (wv.render(SCENE, CAMERA, matrices, quaternion=order) for order in ("xyzw", "wxyz"))
    np.testing.assert_array_equal(one.depth.numpy(), other.depth.numpy())


@pytest.mark.parametrize("form", ["rows", "transforms", "objects", "matrices"])
def test_device_arrays_are_reordered(form, device):
    """Arrays on a GPU are reordered on that GPU."""
    rows = np.float32(POSES)
    given, expected = {
        "rows": lambda: (wp.array(w_first(rows), dtype=wp.float32, device=device), rows),
        "transforms": lambda: (wp.array(w_first(rows), dtype=wp.transform, device=device), rows),
        "objects": lambda: (wp.array(w_first(rows)[None], dtype=wp.transform, device=device), rows[None]),
        "matrices": lambda: (wp.array(poses_to_matrices(rows), dtype=wp.mat44, device=device), poses_to_matrices(rows)),
    }[form]()
    got = to_xyzw(given, "wxyz", "poses")
    got = got.numpy() if isinstance(got, wp.array) else got
    np.testing.assert_allclose(got.view(np.float32).reshape(expected.shape), expected, atol=1e-6)


def test_kernel_matches_reference(device):
    from warpvis.kernels import poses as kernels

    import reference

    rows = np.float32(np.random.default_rng(0).normal(size=(20, 7)))
    out = wp.empty(rows.shape, dtype=wp.float32, device=device)
    inputs = [wp.array(rows, dtype=wp.float32, device=device), out]
    wp.launch(kernels.quaternions_to_xyzw, dim=len(rows), inputs=inputs, device=device)
    np.testing.assert_array_equal(out.numpy(), reference.quaternions_to_xyzw(rows))


def test_invalid_orders_raise():
    for order in ("xyz", "WXYZ", None, 4, ["w"]):
        with pytest.raises(wv.errors.PoseError, match='quaternion must be "xyzw" or "wxyz"'):
            wv.render(SCENE, CAMERA, POSES, quaternion=order)


def test_webots_range_finder_accepts_wxyz():
    class RangeFinder:
        getWidth = getHeight = lambda self: 4
        getFov = getMaxRange = lambda self: 1.0

        def getMinRange(self):
            return 0.1

        def getRangeImage(self, data_type):
            return [0.5] * 16

    eye = wv.webots.DepthEye(RangeFinder())
    bounds = {"bounds": [[-4, -4], [4, 4]], "cell_size": 0.5}
    calls = {
        "pose": eye.pose,
        "points": eye.points,
        "classify": lambda pose, **q: eye.classify(pose, ground_height=0.9, **q),
        "floor_map": lambda pose, **q: eye.floor_map(pose, **bounds, **q).cells,
    }
    for name, call in calls.items():
        one, other, wrong = (
            arrays_in(call(pose, **order))[0]
            for pose, order in ((POSES[0], {}), (w_first(POSES[0]), {"quaternion": "wxyz"}), (w_first(POSES[0]), {}))
        )
        np.testing.assert_array_equal(one, other)
        assert name == "floor_map" or not np.array_equal(one, wrong), name


@pytest.mark.slow
def test_pictures_accept_wxyz(tmp_path):
    seen = wv.render(SCENE, CAMERA, POSES[0])
    image = seen.depth.numpy()[0], seen.segmentation.numpy()[0]
    plan = wv.floor_map(seen.points, seen.labels, bounds=[[-3, -3], [3, 3]], cell_size=0.5)
    agents = [wv.Agent("a", CAMERA, POSES[0]), wv.Agent("b", CAMERA, POSES[1])]
    found = wv.perspective(SCENE, agents)
    from_here = {"title": "t", "eye": (-3, -3, 3), "target": (0, 0, 0)}
    pictures = {
        "view_from_outside": lambda pose, objects, path, **q: viz.view_from_outside(
            SCENE, CAMERA, pose, CAMERA, pose, *image, **q
        ),
        "save_overview": lambda pose, objects, path, **q: viz.save_overview(
            SCENE, CAMERA, pose, seen, plan, path, **from_here, **q
        ),
        "save_perspective": lambda pose, objects, path, **q: viz.save_perspective(
            SCENE, agents, found, path, labels=None, proposed=pose, object_poses=objects, **from_here, **q
        ),
    }
    for name, picture in pictures.items():
        made = []
        for pose, objects, order in (
            (POSES[1], MOVED[0], {}),
            (w_first(POSES[1]), w_first(MOVED[0]), {"quaternion": "wxyz"}),
            (w_first(POSES[1]), w_first(MOVED[0]), {}),
        ):
            path = tmp_path / f"{name}.png"
            pixels = picture(pose, objects, path, **order)
            made.append(path.read_bytes() if pixels is None else pixels.tobytes())
        assert made[0] == made[1] != made[2], name


_POSES = {"convention", "object_poses", "camera_to_world", "node_pose", "proposed", "pose"}


def test_pose_functions_have_quaternion_argument():
    for name, function in public_callables().items():
        parameters = inspect.signature(function).parameters
        if parameters.keys() & _POSES and not inspect.isclass(function):
            assert "quaternion" in parameters, name
