# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Silhouettes in JAX: masks of the pixels next to them, and areas with gradients, against twins and PyTorch."""

from functools import cache, partial

import numpy as np
import pytest
import reference_soft_visibility as twin

import warpvis as wv
from warpvis.scene import solids

from support.gradients import CAMERAS, OBJECT_ROWS, ROW, build_scene
from support.hidden_ball import START, hidden_scene
from support.jax_devices import import_torch, jax_device  # noqa: F401

jax = pytest.importorskip("jax")
jnp = jax.numpy
wvj = pytest.importorskip("warpvis.jax")

PINHOLE = CAMERAS["pinhole"]
WITH_IMAGES = [name for name in CAMERAS if name != "lidar"]
MASKED = ("depth", "normals", "segmentation")
POSE, OBJECTS = np.float32(ROW), np.float32(OBJECT_ROWS)


@cache
def scene_on(device):
    return build_scene(device)


def assert_close(got, expected, tolerance):
    np.testing.assert_allclose(got, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def mask_of(scene, camera, poses, objects=OBJECTS):
    images = wvj.render(scene, camera, poses, object_poses=objects, outputs=MASKED)
    return wvj.silhouette_mask(scene, camera, poses, images), images


@pytest.mark.parametrize("name", WITH_IMAGES)
def test_mask_matches_twin(name, device):
    """With the camera's pose as a row and as a matrix."""
    camera = CAMERAS[name]
    mask, images = jax.jit(partial(mask_of, scene_on(device), camera))(POSE)
    assert mask.dtype == bool
    seen = {key: np.asarray(getattr(images, key)[0]) for key in MASKED}
    np.testing.assert_array_equal(mask[0], twin.mark_silhouettes(camera, ROW, seen))
    assert 0.05 < mask.mean() < 0.6
    matrix = np.float32(wv.core.poses.poses_to_matrices(ROW[None]))
    assert (wvj.silhouette_mask(scene_on(device), camera, matrix, images) != mask).mean() < 0.002


def test_mask_equals_that_of_torch(device):
    torch, wt, place = import_torch(device)
    mask, images = mask_of(scene_on(device), PINHOLE, POSE)
    tensors = wt.Images(**{name: torch.tensor(np.array(getattr(images, name)), device=place) for name in MASKED})
    expected = wt.silhouette_mask(scene_on(device), PINHOLE, torch.tensor(POSE, device=place), tensors)
    np.testing.assert_array_equal(mask, expected.cpu().numpy())


def test_vmap_and_gradients_of_masks(device):
    """Masks of a batch equal those one after the other; they are constants of a loss."""
    scene, poses = scene_on(device), np.repeat(POSE[None, None], 3, axis=0)
    poses[:, 0, 1] += (0.0, 0.1, 0.2)

    def loss(pose):
        mask, images = mask_of(scene, PINHOLE, pose)
        free = ~mask & jnp.isfinite(images.depth)
        return jnp.where(free, images.depth, 0.0).sum(), (mask, images)

    got, (masks, _) = jax.jit(jax.vmap(jax.grad(loss, has_aux=True)))(poses)
    for k, pose in enumerate(poses):
        expected, (mask, images) = jax.grad(loss, has_aux=True)(pose)
        np.testing.assert_array_equal(masks[k], mask)
        assert_close(got[k], expected, 1e-6)
        weights = ~mask & np.isfinite(images.depth)

        def weighted(pose, weights=weights):
            depth = wvj.render(scene, PINHOLE, pose, object_poses=OBJECTS).depth
            return jnp.where(weights, depth, 0.0).sum()

        assert_close(expected, jax.grad(weighted)(pose), 1e-6)


BAD_MASKS = {
    "images": ({"images": None}, "images must be warpvis.jax.Images, got NoneType"),
    "missing": ({"images": wvj.Images()}, "images must have depth, normals, segmentation, got none of depth, normals"),
    "poses": ({"poses": np.zeros((2, 7), np.float32)}, r"images must have the axes \(2, 28, 36\) of poses and camera"),
    "lidar": ({"camera": CAMERAS["lidar"]}, "images must have the axes"),
}


@pytest.mark.parametrize("case", BAD_MASKS)
def test_bad_input_of_masks_is_one_sentence(case):
    _, images = mask_of(scene_on("cpu"), PINHOLE, POSE)
    change, message = BAD_MASKS[case]
    arguments = {"camera": PINHOLE, "poses": POSE, "images": images, **change}
    with pytest.raises(wv.WarpvisError, match=message):
        wvj.silhouette_mask(scene_on("cpu"), **arguments)
    shifted = images._replace(depth=images.segmentation)
    with pytest.raises(wv.WarpvisError, match=r"images\.depth must be float32, got int32"):
        wvj.silhouette_mask(scene_on("cpu"), PINHOLE, POSE, shifted)


def test_rays_without_neighbors_have_no_mask():
    with pytest.raises(wv.errors.CameraError, match=r"camera must have pixels with neighbors .*, got a list of rays"):
        mask_of(scene_on("cpu"), CAMERAS["lidar"], POSE)


SMALL = wv.Camera.from_fov(60, 45, hfov=0.7)
HIDDEN_POSE = np.float32(START)
HIDDEN_ROWS = np.float32([item.pose for item in hidden_scene().objects])


def stone_vertices(scene):
    return np.asarray(scene.objects[2].mesh_vertices, dtype=np.float32)


@pytest.mark.parametrize("names", [("stone",), ("box", "stone"), ("wall",)], ids="-".join)
@pytest.mark.parametrize("name", WITH_IMAGES)
def test_areas_and_gradients_match_twin(name, names, device):
    """The twin's gradients are central differences in float64."""
    scene, camera = build_scene(device), CAMERAS[name]

    @jax.jit
    @partial(jax.value_and_grad, argnums=(0, 1, 2))
    def measure(pose, objects, stone):
        return wvj.coverage(scene, camera, pose, names, object_poses=objects, vertices={"stone": stone}).sum()

    area, got = measure(POSE, OBJECTS, stone_vertices(scene))
    outputs = ("segmentation", "faces")
    views = wv.render(scene, camera, POSE[None], object_poses=OBJECTS[None], outputs=outputs)
    images = {key: getattr(views, key).numpy()[0] for key in outputs}
    rows, reference = (POSE.astype(float), OBJECTS.astype(float)), build_scene()
    targets = [scene.index(chosen) for chosen in names]
    assert area == pytest.approx(twin.sum_coverage(camera, reference, images, targets, *rows), rel=1e-5)
    expected = twin.sum_coverage_gradients(camera, reference, images, targets, *rows, "stone")
    for part, gradient in zip((np.s_[:7], np.s_[7:21], np.s_[21:]), got, strict=True):
        np.testing.assert_allclose(gradient.ravel(), expected[part], rtol=0, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("name", WITH_IMAGES)
@pytest.mark.parametrize("measure", ["coverage", "soft_mask", "visible_fraction"])
def test_values_and_gradients_equal_those_of_torch(measure, name, device):
    torch, wt, place = import_torch(device)
    scene, camera = scene_on(device), CAMERAS[name]
    tensors = [torch.tensor(value, device=place, requires_grad=True) for value in (POSE[None], OBJECTS)]
    expected = getattr(wt, measure)(scene, camera, tensors[0], "wall", object_poses=tensors[1])
    weights = np.random.default_rng(2).uniform(-1, 1, expected.shape).astype(np.float32)
    (expected * torch.tensor(weights, device=place)).sum().backward()

    @jax.jit
    @partial(jax.grad, argnums=(0, 1), has_aux=True)
    def gradient(poses, objects):
        result = getattr(wvj, measure)(scene, camera, poses, "wall", object_poses=objects)
        return (result * weights).sum(), result

    got, result = gradient(POSE[None], OBJECTS)
    np.testing.assert_allclose(result, expected.detach().cpu().numpy(), rtol=2e-7, atol=0)
    for one, given in zip(got, tensors, strict=True):
        assert_close(one, given.grad.cpu().numpy(), 1e-6)
        assert np.any(one)


@pytest.mark.parametrize("name", WITH_IMAGES)
def test_soft_masks_match_twin(name, device):
    scene, camera = scene_on(device), CAMERAS[name]
    mask = wvj.soft_mask(scene, camera, POSE, ("box", "stone"), object_poses=OBJECTS)
    outputs = ("segmentation", "faces")
    views = wv.render(scene, camera, POSE[None], object_poses=OBJECTS[None], outputs=outputs)
    images = {key: getattr(views, key).numpy()[0] for key in outputs}
    expected = twin.write_masks(camera, scene, images, [2, 3], POSE.astype(float), OBJECTS.astype(float))
    np.testing.assert_allclose(mask[0], expected, atol=1e-4)
    area = wvj.coverage(scene, camera, POSE, ("box", "stone"), object_poses=OBJECTS)
    assert mask.sum() == pytest.approx(area.item(), rel=1e-5)


def test_ascent_shows_a_hidden_object(device):
    """A compiled scan moves a camera from where a box hides most of a ball to where it is visible."""
    scene = hidden_scene(device)

    def fraction_of(move):
        pose = jnp.concatenate([HIDDEN_POSE[:3] + move, HIDDEN_POSE[3:]])
        return wvj.visible_fraction(scene, SMALL, pose, "ball")[0]

    def step(move, _):
        value, gradient = jax.value_and_grad(fraction_of)(move)
        return move + 0.02 * gradient / jnp.maximum(jnp.linalg.norm(gradient), 1e-6), value

    _, fractions = jax.jit(lambda start: jax.lax.scan(step, start, length=60))(jnp.zeros(3))
    assert fractions[0] < 0.3
    assert fractions.max() > 0.9


def test_hidden_objects_have_no_gradient(device):
    scene = hidden_scene(device)
    behind = HIDDEN_ROWS.copy()
    behind[0, 0] = -3.0
    function = jax.value_and_grad(
        lambda rows: wvj.visible_fraction(scene, SMALL, HIDDEN_POSE, "ball", object_poses=rows)[0]
    )
    value, gradient = function(behind)
    assert value == 0
    assert not gradient.any()
    free = function(np.float32(HIDDEN_ROWS + [[0] * 7, [0, 2, 0, 0, 0, 0, 0]]))[0]
    assert free == pytest.approx(1.0, abs=1e-6)


def test_worlds_share_gradients_of_their_views(device):
    scene, poses = hidden_scene(device), np.repeat(HIDDEN_POSE[None], 3, axis=0)
    worlds = np.stack([HIDDEN_ROWS, HIDDEN_ROWS + np.float32([0, 0.1, 0, 0, 0, 0, 0])])

    def areas_of(objects, poses=poses[:1], index=None):
        areas = wvj.coverage(scene, SMALL, poses, "ball", object_poses=objects, world_index=index)
        return areas.sum(), areas

    function = jax.grad(areas_of, has_aux=True)
    got, areas = function(worlds, poses, np.array([1, 0, 1], np.int32))
    for world, views in enumerate((1, 2)):
        expected, area = function(worlds[world])
        np.testing.assert_allclose(areas[1 - world], area[0], rtol=2e-7)
        assert_close(got[world], views * np.asarray(expected), 1e-6)


@pytest.mark.parametrize("in_axes", [(0, None), (None, 0), (0, 0)], ids=str)
@pytest.mark.parametrize("measure", ["coverage", "soft_mask", "visible_fraction"])
def test_vmap(measure, in_axes, device):
    """Measures of a batch, and their gradients, equal those one after the other."""
    scene = hidden_scene(device)
    arrays = [np.repeat(HIDDEN_POSE[None, None], 3, axis=0), np.stack([HIDDEN_ROWS] * 3)]
    arrays[0][:, 0, 1] += (0.0, 0.05, 0.1)
    arrays[1][:, 0, 2] += (0.0, 0.1, 0.05)
    given = [array if axis == 0 else array[0] for array, axis in zip(arrays, in_axes, strict=True)]

    def loss(poses, objects):
        result = getattr(wvj, measure)(scene, SMALL, poses, "ball", object_poses=objects)
        return jnp.square(result).sum(), result

    function = jax.grad(loss, argnums=(0, 1), has_aux=True)
    got, results = jax.jit(jax.vmap(function, in_axes=in_axes))(*given)
    for k in range(3):
        one = [array[k] if axis == 0 else array for array, axis in zip(given, in_axes, strict=True)]
        expected, result = function(*one)
        np.testing.assert_allclose(results[k], result, rtol=2e-7, atol=0)
        for gradient, alone in zip(got, expected, strict=True):
            assert_close(gradient[k], alone, 1e-6)


@pytest.mark.parametrize("is_batched", [True, False], ids=["batched", "shared"])
def test_vmap_of_vertices(is_batched, device):
    """Batched vertices are measured one after the other; shared ones have a gradient for each member."""
    scene = build_scene(device)
    base, poses = stone_vertices(scene), np.stack([POSE, POSE])
    poses[1, 1] += 0.1
    shapes = np.stack([base, 0.8 * base]) if is_batched else base

    def loss(pose, shape):
        return wvj.coverage(scene, PINHOLE, pose, "stone", vertices={"stone": shape}).sum()

    function = jax.value_and_grad(loss, argnums=(0, 1))
    values, got = jax.vmap(function, in_axes=(0, 0 if is_batched else None))(poses, shapes)
    for k in range(2):
        value, expected = function(poses[k], shapes[k] if is_batched else shapes)
        np.testing.assert_allclose(values[k], value, rtol=2e-7)
        for gradient, alone in zip(got, expected, strict=True):
            assert_close(gradient[k], alone, 1e-6)


def test_objects_that_do_not_hide(device):
    """With `occluded=False`, the box contributes neither to the area nor to the gradient."""
    scene = hidden_scene(device)

    def area(objects, **options):
        return wvj.coverage(scene, SMALL, HIDDEN_POSE, "ball", object_poses=objects, **options)[0]

    hidden, of_hidden = jax.value_and_grad(area)(HIDDEN_ROWS)
    alone, of_alone = jax.value_and_grad(partial(area, occluded=False))(HIDDEN_ROWS)
    assert hidden < 0.5 * alone
    assert of_hidden[1].any() and of_alone[0].any()
    assert not of_alone[1].any()


def test_traced_function_follows_changed_vertices(device):
    scene = hidden_scene(device)
    measure = jax.jit(lambda pose: wvj.coverage(scene, SMALL, pose, "ball", occluded=False)[0])
    before = float(measure(HIDDEN_POSE))
    scene.update_vertices("ball", 0.5 * scene.objects[0].mesh_vertices)
    assert 0.2 < float(measure(HIDDEN_POSE)) / before < 0.3


BAD_AREAS = {
    "name": ({"names": "cup"}, "the scene has no object 'cup'"),
    "names": ({"names": ()}, "names must contain at least one object, got none"),
    "camera": ({"camera": CAMERAS["lidar"]}, "camera must have pixels with neighbors for areas of objects, got a list"),
    "poses": ({"poses": np.zeros((1, 6), np.float32)}, "poses must be rows of 7 numbers or matrices"),
    "vertices": ({"vertices": {"ball": np.zeros(3, np.float32)}}, r"vertices\['ball'\] must have shape"),
    "static": ({"vertices": {"wall": np.zeros(3, np.float32)}}, "wall"),
    "occluded": ({"occluded": "no"}, "occluded must be True or False, got 'no'"),
}


@pytest.mark.parametrize("case", BAD_AREAS)
def test_bad_input_of_areas_is_one_sentence(case):
    change, message = BAD_AREAS[case]
    arguments = {"camera": PINHOLE, "poses": HIDDEN_POSE, "names": "ball", **change}
    for function in (wvj.coverage, wvj.soft_mask, wvj.visible_fraction):
        if function is wvj.visible_fraction and "occluded" in change:
            continue
        with pytest.raises(wv.WarpvisError, match=message) as caught:
            function(hidden_scene(), **arguments)
        assert "\n" not in str(caught.value)


def test_round_solids_are_an_error():
    scene = hidden_scene()
    scene.add(solids.sphere(0.1), name="round", pose=(1, 1, 1, 0, 0, 0, 1), movable=True)
    with pytest.raises(wv.WarpvisError, match=r"scene must contain only meshes for areas of objects, got .* 'round'"):
        wvj.coverage(scene, PINHOLE, HIDDEN_POSE, "ball")
