# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Renders with gradients for JAX: against `warpvis.render`, and against central differences in float64."""

import gc
import weakref
from functools import cache, partial

import numpy as np
import pytest
import warp as wp

import warpvis as wv
from warpvis.cameras import parameter_values, with_parameters
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import SceneError
from warpvis.rendering import differentiable

from support.gradients import CAMERAS, NAMES, OBJECT_ROWS, ROW, Loss, build_scene, changes_of, flat_rays
from support.jax_devices import jax_device  # noqa: F401

jax = pytest.importorskip("jax")
jnp = jax.numpy
wvj = pytest.importorskip("warpvis.jax")

ALL = ("depth", "points", "normals", "labels", "segmentation", "faces")
PINHOLE = CAMERAS["pinhole"]


@cache
def scene_on(device):
    return build_scene(device)


def rows(count=3):
    """Return poses near `ROW`, and poses of the objects in as many worlds."""
    rng = np.random.default_rng(4)
    poses, objects = np.repeat(ROW[None], count, axis=0), np.repeat(OBJECT_ROWS[None], count, axis=0)
    poses[:, :3] += rng.normal(scale=0.1, size=(count, 3))
    objects[..., :3] += rng.normal(scale=0.1, size=(count, 2, 3))
    return poses.astype(np.float32), objects.astype(np.float32)


def weighted(images, weights):
    """Return the sum of images times weights; pixels without weight may be infinite or NaN."""
    total = 0.0
    for name, weight in weights.items():
        image = getattr(images, name)
        total += jnp.where(weight != 0, weight * jnp.where(weight != 0, image, 0.0), 0.0).sum()
    return total


def assert_close(got, expected, tolerance=1e-4):
    np.testing.assert_allclose(got, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def assert_same(images, views, names=ALL):
    for name in names:
        np.testing.assert_array_equal(np.asarray(getattr(images, name)), getattr(views, name).numpy(), err_msg=name)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("compiled", [False, True], ids=["eager", "jit"])
def test_images_equal_those_of_render(name, compiled, device):
    scene, camera = scene_on(device), CAMERAS[name]
    poses, objects = rows()
    function = partial(wvj.render, scene, camera, outputs=ALL)
    images = (jax.jit(function) if compiled else function)(jnp.asarray(poses), object_poses=jnp.asarray(objects))
    assert_same(images, wv.render(scene, camera, poses, object_poses=objects, outputs=ALL))


def test_default_is_depth_alone(device):
    images = wvj.render(scene_on(device), PINHOLE, jnp.asarray(ROW))
    assert images.depth.shape == (1, *PINHOLE.shape)
    assert images[1:] == (None,) * 6


def test_world_index(device):
    scene = scene_on(device)
    poses, objects = rows()
    index = np.array([2, 0, 0], dtype=np.int32)
    images = wvj.render(scene, PINHOLE, poses, object_poses=objects, world_index=index, outputs=ALL)
    assert_same(images, wv.render(scene, PINHOLE, poses, object_poses=objects, world_index=index, outputs=ALL))


@cache
def pose_loss(name):
    return Loss(build_scene(), CAMERAS[name], changes_of("row", ROW) + changes_of("object_rows", OBJECT_ROWS))


@pytest.mark.parametrize(
    ("name", "names"),
    [*((name, NAMES) for name in CAMERAS), ("pinhole", ("depth",)), ("lidar", ("points",))],
    ids=lambda value: value if isinstance(value, str) else "-".join(value),
)
def test_pose_gradients_match_central_differences(name, names, device):
    loss, scene, camera = pose_loss(name), scene_on(device), CAMERAS[name]
    weights = loss.image_gradients(names)

    @jax.jit
    @partial(jax.grad, argnums=(0, 1))
    def gradient(pose, objects):
        return weighted(wvj.render(scene, camera, pose, object_poses=objects, outputs=names), weights)

    got = gradient(jnp.asarray(ROW, jnp.float32), jnp.asarray(OBJECT_ROWS, jnp.float32))
    expected = loss.differences(names).sum(axis=1)
    assert_close(got[0], expected[:7])
    assert_close(got[1].reshape(-1), expected[7:])


def test_vertex_gradients_match_central_differences(device):
    scene = build_scene(device)
    base = np.asarray(scene.objects[scene.index("box")].mesh_vertices, dtype=np.float64)
    changes = [{"vertices": {"box": change["box"]}} for change in changes_of("box", base)]
    loss = Loss(build_scene(), PINHOLE, changes)
    weights = loss.image_gradients()

    @jax.jit
    @jax.grad
    def gradient(vertices):
        images = wvj.render(
            scene, PINHOLE, ROW, object_poses=OBJECT_ROWS[None], vertices={"box": vertices}, outputs=NAMES
        )
        return weighted(images, weights)

    expected = loss.differences().sum(axis=1)
    assert_close(gradient(jnp.asarray(base, jnp.float32)).reshape(-1), expected)


@pytest.mark.parametrize("name", ["pinhole", "distorted", "fisheye", "panorama", "orthographic"])
def test_intrinsic_gradients_match_central_differences(name, device):
    scene, camera, changes = scene_on(device), CAMERAS[name], []
    values = parameter_values(camera)
    steps = 1e-6 * np.maximum(np.abs(values), 0.1)
    for step in steps[:, None] * np.eye(len(values)):
        for changed in (values + step, values - step):
            rays, origins, _ = flat_rays(with_parameters(camera, changed))
            changes.append({"rays": rays} if origins is None else {"rays": rays, "origins": origins})
    names = ("depth", "points")
    loss = Loss(build_scene(), camera, changes)
    weights = loss.image_gradients(names)

    @jax.jit
    @jax.grad
    def gradient(intrinsics):
        images = wvj.render(scene, camera, ROW, object_poses=OBJECT_ROWS, intrinsics=intrinsics, outputs=names)
        return weighted(images, weights)

    expected = loss.differences(names, step=1.0).sum(axis=1)
    assert_close(gradient(jnp.asarray(values, jnp.float32)) * steps, expected)


def test_vmap_over_intrinsics(device):
    """Cameras of a batch are rendered one after the other."""
    scene = scene_on(device)
    values = jnp.asarray(parameter_values(PINHOLE) * np.array([[1.0], [1.1]]), jnp.float32)

    def loss(pose, intrinsics):
        return finite_sum(wvj.render(scene, PINHOLE, pose, intrinsics=intrinsics), {"depth": 1.0})

    function = jax.value_and_grad(loss, argnums=(0, 1))
    pose = jnp.asarray(ROW, jnp.float32)
    got = jax.vmap(function, in_axes=(None, 0))(pose, values)
    for k in range(2):
        for one, expected in zip(jax.tree.leaves(got), jax.tree.leaves(function(pose, values[k])), strict=True):
            assert_close(one[k], expected, 1e-5)


def random_weights(shape, names=NAMES):
    """Return weights of images; smooth scenes give finite losses."""
    rng = np.random.default_rng(8)
    sizes = {"depth": shape, "points": (*shape, 3), "normals": (*shape, 3)}
    return {name: rng.uniform(0.5, 1.5, sizes[name]).astype(np.float32) for name in names}


def finite_sum(images, weights):
    """Return the weighted sum of the finite pixels."""
    total = 0.0
    for name, weight in weights.items():
        image = getattr(images, name)
        total += (weight * jnp.where(jnp.isfinite(image), image, 0.0)).sum()
    return total


def gradients_of_views(scene, poses, objects, weights, index):
    """Return gradients of the views, each alone, added for each world."""
    of_objects, of_poses = np.zeros_like(objects), []
    for view, world in enumerate(index):
        alone = {name: weight[view : view + 1] for name, weight in weights.items()}
        function = partial(wvj.render, scene, PINHOLE, outputs=tuple(weights))
        got = jax.grad(
            lambda pose, rows, function=function, alone=alone: finite_sum(function(pose, object_poses=rows), alone),
            argnums=(0, 1),
        )(jnp.asarray(poses[view]), jnp.asarray(objects[world]))
        of_poses.append(np.asarray(got[0]))
        of_objects[world] += np.asarray(got[1])
    return np.array(of_poses), of_objects


@pytest.mark.parametrize("index", [None, (2, 0, 0), (0, 0, 0)], ids=["own", "index", "one"])
def test_gradients_of_several_worlds_are_sums_of_views(index, device):
    scene = scene_on(device)
    poses, objects = rows()
    weights = random_weights((3, *PINHOLE.shape))
    objects = objects[:1] if index == (0, 0, 0) else objects
    given = jnp.asarray(index, jnp.int32) if index == (2, 0, 0) else None

    @partial(jax.grad, argnums=(0, 1))
    def gradient(poses, objects):
        images = wvj.render(scene, PINHOLE, poses, object_poses=objects, world_index=given, outputs=NAMES)
        return finite_sum(images, weights)

    got = gradient(jnp.asarray(poses), jnp.asarray(objects))
    expected = gradients_of_views(scene, poses, objects, weights, (0, 1, 2) if index is None else index)
    assert_close(got[0], expected[0], 1e-6)
    assert_close(got[1], expected[1], 1e-5)


@pytest.mark.parametrize("in_axes", [(0, 0), (None, 0), (0, None)], ids=str)
@pytest.mark.parametrize("worlds", [1, 2], ids=["one-world", "own-worlds"])
def test_vmap(in_axes, worlds, device):
    """A batch of renders, and its gradients, equal renders one after the other."""
    scene, batch, views = scene_on(device), 3, 2
    poses, objects = rows(6)
    poses = poses.reshape(batch, views, 7)
    objects = objects.reshape(batch, 2, *objects.shape[1:])[:, :worlds]
    poses, objects = (x if axis == 0 else x[0] for x, axis in zip((poses, objects), in_axes, strict=True))
    weights = random_weights((views, *PINHOLE.shape))

    def render(poses, objects):
        images = wvj.render(scene, PINHOLE, poses, object_poses=objects, outputs=NAMES)
        return finite_sum(images, weights), images

    function = jax.value_and_grad(render, argnums=(0, 1), has_aux=True)
    (_, images), got = jax.jit(jax.vmap(function, in_axes=in_axes))(jnp.asarray(poses), jnp.asarray(objects))
    for k in range(batch):
        one = [x[k] if axis == 0 else x for x, axis in zip((poses, objects), in_axes, strict=True)]
        (_, alone), expected = function(*map(jnp.asarray, one))
        for name in NAMES:
            np.testing.assert_array_equal(getattr(images, name)[k], getattr(alone, name))
        assert_close(got[0][k], expected[0], 1e-6)
        assert_close(got[1][k], expected[1], 1e-5)


def test_vmap_over_world_index_and_nested(device):
    scene = scene_on(device)
    poses, objects = rows(4)
    index = np.array([[[0, 3], [1, 1]], [[2, 0], [3, 3]]], dtype=np.int32)

    def render(index):
        return wvj.render(scene, PINHOLE, poses[:2], object_poses=objects, world_index=index).depth

    got = jax.vmap(jax.vmap(render))(jnp.asarray(index))
    for i in range(2):
        for k in range(2):
            np.testing.assert_array_equal(got[i, k], render(index[i, k]))


def test_vmap_over_vertices(device):
    scene = build_scene(device)
    base = np.asarray(scene.objects[scene.index("box")].mesh_vertices, dtype=np.float32)
    shapes = jnp.asarray(base) * jnp.array([0.8, 1.0, 1.3])[:, None, None]

    def loss(vertices):
        return finite_sum(
            wvj.render(scene, PINHOLE, ROW, object_poses=OBJECT_ROWS, vertices={"box": vertices}), {"depth": 1.0}
        )

    got = jax.vmap(jax.value_and_grad(loss))(shapes)
    for k in range(3):
        value, gradient = jax.value_and_grad(loss)(shapes[k])
        assert_close(got[0][k], value, 1e-6)
        assert_close(got[1][k], gradient, 1e-5)


def test_jacobian_of_depth(device):
    """Reverse-mode Jacobians map the backward pass over images that are not batched."""
    scene, camera = scene_on(device), wv.Camera.from_fov(4, 3, hfov=0.6, near=0.1, far=8.0)

    def depth(pose):
        return wvj.render(scene, camera, pose).depth

    jacobian = jax.jacrev(depth)(jnp.asarray(ROW, jnp.float32))
    gradient = jax.grad(lambda pose: depth(pose)[0, 1, 2])(jnp.asarray(ROW, jnp.float32))
    assert jacobian.shape == (1, 3, 4, 7)
    np.testing.assert_allclose(jacobian[0, 1, 2], gradient, rtol=1e-5, atol=1e-6)


def test_scan_and_checkpoint_equal_a_loop(device):
    scene = scene_on(device)
    target = wvj.render(scene, PINHOLE, ROW).depth

    def loss(twist):
        depth = wvj.render(scene, PINHOLE, wvj.apply_twists(jnp.asarray(ROW, jnp.float32), twist)).depth
        difference = jnp.where(jnp.isfinite(depth) & jnp.isfinite(target), depth - target, 0.0)
        return jnp.minimum(difference**2, 0.01).mean()  # silhouettes do not count

    def step(twist, _):
        value, gradient = jax.value_and_grad(jax.checkpoint(loss))(twist)
        return twist - 0.1 * gradient, value

    start = jnp.array([0.01, -0.01, 0.01, 0.02, -0.02, 0.03])
    twist, losses = jax.jit(lambda twist: jax.lax.scan(step, twist, length=5))(start)
    one_step = jax.jit(jax.value_and_grad(loss))
    for expected in losses:
        value, gradient = one_step(start)
        np.testing.assert_allclose(value, expected, rtol=1e-3)
        start = start - 0.1 * gradient
    np.testing.assert_allclose(twist, start, rtol=1e-3)
    assert losses[-1] < losses[0]


def test_matrices_have_the_gradients_of_rows(device):
    scene = scene_on(device)
    weights = random_weights((1, *PINHOLE.shape), ("depth", "points"))
    names = tuple(weights)

    def loss(twist, with_matrix):
        row = wvj.apply_twists(jnp.asarray(ROW, jnp.float32), twist)
        x, y, z, w = row[3:]
        rotation = jnp.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        matrix = jnp.eye(4).at[:3, :3].set(rotation).at[:3, 3].set(row[:3])
        return finite_sum(wvj.render(scene, PINHOLE, matrix if with_matrix else row, outputs=names), weights)

    of_rows, of_matrices = (jax.grad(loss)(jnp.zeros(6), flag) for flag in (False, True))
    assert_close(of_matrices, of_rows, 1e-4)


@pytest.mark.parametrize("quaternion", [(0, 0, 0, 1), (1, 0, 0, 0), (0, -1, 0, 0), (0.5, -0.5, 0.5, 0.5)], ids=str)
def test_matrices_to_rows(quaternion):
    row = np.array([1.0, 2.0, 3.0, *quaternion])
    got = np.asarray(wvj.matrices_to_rows(poses_to_matrices(row)))
    np.testing.assert_allclose(got[:3], row[:3])
    np.testing.assert_allclose(abs(got[3:] @ row[3:]), 1.0, atol=1e-6)


@pytest.mark.parametrize("angle", [0.0, 1e-3, 9e-3, 0.02, 2.0])
def test_apply_twists(angle):
    from scipy.spatial.transform import Rotation

    vector, translation = angle * np.array([0.6, 0.0, -0.8]), np.array([0.1, 0.2, 0.3])
    got = np.asarray(wvj.apply_twists(ROW.astype(np.float32), np.concatenate([vector, translation])))
    rotation = Rotation.from_quat(ROW[3:])
    expected = rotation * Rotation.from_rotvec(vector)
    np.testing.assert_allclose(Rotation.from_quat(got[3:]).as_matrix(), expected.as_matrix(), atol=1e-6)
    np.testing.assert_allclose(got[:3], ROW[:3] + rotation.apply(translation), atol=1e-6)
    jacobian = jax.jacfwd(partial(wvj.apply_twists, jnp.asarray(ROW)))(jnp.asarray([*vector, *translation]))
    assert np.isfinite(jacobian).all()


def test_integer_images_have_no_gradients(device):
    scene = scene_on(device)
    pose = jnp.asarray(ROW, jnp.float32)
    gradient = jax.grad(lambda pose: wvj.render(scene, PINHOLE, pose, outputs=("labels",)).labels.astype(float).sum())
    assert not gradient(pose).any()


def test_normals_of_round_solids_have_no_gradients(device):
    scene = wv.Scene(device=device)
    scene.add(wv.scene.solids.sphere(0.5), name="ball", pose=(2, 0, 0, 0, 0, 0, 1), movable=True)
    for names in (("depth", "points"), ("depth", "normals")):
        total = partial(wvj.render, scene, PINHOLE, outputs=names)
        gradient = jax.grad(lambda pose, total=total: finite_sum(total(pose), {"depth": 1.0}))
        if "normals" not in names:
            assert gradient(jnp.asarray(ROW, jnp.float32)).any()
            continue
        with pytest.raises(SceneError, match=r"normals must be left out of the loss .* got 'ball'"):
            gradient(jnp.asarray(ROW, jnp.float32))


def test_arrays_of_double_precision(device):
    enable_x64 = jax.enable_x64 if hasattr(jax, "enable_x64") else jax.experimental.enable_x64
    with enable_x64(True):
        gradient = jax.grad(lambda pose: finite_sum(wvj.render(scene_on(device), PINHOLE, pose), {"depth": 1.0}))
        assert gradient(jnp.asarray(ROW)).dtype == jnp.float64


def test_renderers_of_a_scene_are_reused(device):
    scene = build_scene(device)
    for _ in range(3):
        wvj.render(scene, PINHOLE, ROW)
    assert len(scene.differentiable) == 1


def test_traced_functions_outlive_the_cache(device, monkeypatch):
    """A scene keeps a limited number of renderers; those that traced functions need are made again."""
    monkeypatch.setattr(differentiable, "_MAX_CACHED", 2)
    scene, camera = build_scene(device), wv.Camera.from_fov(8, 6, hfov=0.6)
    gradient = jax.jit(jax.grad(lambda pose: finite_sum(wvj.render(scene, camera, pose), {"depth": 1.0})))
    pose = jnp.asarray(ROW, jnp.float32)
    expected = gradient(pose)
    for width in range(4, 8):
        wvj.render(scene, wv.Camera.from_fov(width, 6, hfov=0.6), pose)
    assert len(scene.differentiable) == 2
    np.testing.assert_array_equal(gradient(pose), expected)


def test_scenes_are_released():
    """Neither JAX's caches nor those of warpvis keep a scene."""
    scene = build_scene()
    wvj.render(scene, PINHOLE, ROW).depth.block_until_ready()
    known = weakref.ref(scene)
    del scene
    gc.collect()
    assert known() is None


BAD = {
    "poses-shape": ({"poses": np.zeros((2, 6), np.float32)}, "poses must be rows of 7 numbers or matrices"),
    "poses-axes": ({"poses": np.zeros((2, 2, 7), np.float32)}, "poses must have 0 or 1 axes"),
    "poses-dtype": ({"poses": np.zeros((2, 7), np.int32)}, "poses must be float32, got int32"),
    "poses-text": ({"poses": "front"}, "poses must be an array of numbers"),
    "poses-scale": ({"poses": 2 * np.eye(4, dtype=np.float32)}, "poses must .* wrong in 1 of 1"),
    "poses-mirror": ({"poses": np.diag([1, 1, -1, 1]).astype(np.float32)}, "poses must be rotations, not mirrors"),
    "vertices-table": ({"vertices": np.zeros((3, 3), np.float32)}, "vertices must be arrays by name of the object"),
    "poses-zero": ({"poses": np.zeros((2, 7), np.float32)}, "poses must"),
    "poses-nan": ({"poses": np.full((1, 7), np.nan, np.float32)}, "poses must be finite"),
    "objects-count": ({"object_poses": np.ones((1, 3, 7), np.float32)}, "object_poses must be those of the 2 movable"),
    "objects-zero": ({"object_poses": np.zeros((1, 2, 7), np.float32)}, "object_poses must"),
    "worlds": ({"object_poses": np.ones((3, 2, 7), np.float32)}, "object_poses have 3 worlds for 1 views"),
    "index": ({"world_index": np.zeros(3, np.int32)}, r"world_index must have shape \(1,\)"),
    "index-dtype": ({"world_index": np.zeros(1, np.float32)}, "world_index must be int32"),
    "vertices": ({"vertices": {"box": np.zeros((3, 3), np.float32)}}, r"vertices\['box'\] must have shape \(8, 3\)"),
    "static": ({"vertices": {"wall": np.zeros((3, 3), np.float32)}}, "vertices must be those of movable objects"),
    "intrinsics": ({"intrinsics": np.ones(3, np.float32)}, "intrinsics must be the 4 numbers fx, fy, cx, cy, got"),
    "outputs": ({"outputs": ("albedo",)}, "outputs must be some of depth"),
}


@pytest.mark.parametrize("case", BAD)
def test_errors(case):
    changes, message = BAD[case]
    arguments = {"poses": ROW.astype(np.float32), **changes}
    with pytest.raises(wv.WarpvisError, match=message) as caught:
        wvj.render(scene_on("cpu"), PINHOLE, arguments.pop("poses"), **arguments)
    assert "\n" not in str(caught.value)


def test_values_of_traced_poses_are_checked_on_the_cpu():
    function = jax.jit(lambda pose: wvj.render(scene_on("cpu"), PINHOLE, pose).depth)
    with pytest.raises(Exception, match="camera_to_world must be finite"):
        function(jnp.full(7, jnp.nan)).block_until_ready()


def test_arrays_on_another_device():
    if not wp.is_cuda_available() or "cuda" not in str(jax.devices()).lower():
        pytest.skip("needs a GPU")
    scene = scene_on("cuda:0")
    poses = jax.device_put(jnp.asarray(ROW, jnp.float32), jax.devices("cpu")[0])
    with pytest.raises(wv.WarpvisError, match="poses must be on the scene's device, cuda:0"):
        wvj.render(scene, PINHOLE, poses)
