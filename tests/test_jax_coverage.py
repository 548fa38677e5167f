# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Silhouettes in JAX: masks of the pixels beside them, against a twin and PyTorch."""

from functools import cache, partial

import numpy as np
import pytest
import reference_soft_visibility as twin
import warp as wp

import warpvis as wv

from support.gradients import CAMERAS, OBJECT_ROWS, ROW, build_scene

jax = pytest.importorskip("jax")
jnp = jax.numpy
wvj = pytest.importorskip("warpvis.jax")

PINHOLE = CAMERAS["pinhole"]
WITH_IMAGES = [name for name in CAMERAS if name != "lidar"]
MASKED = ("depth", "normals", "segmentation")
POSE, OBJECTS = np.float32(ROW), np.float32(OBJECT_ROWS)


@pytest.fixture(autouse=True)
def jax_device(request):
    """Use the JAX device of the test's `device`, or the CPU."""
    device = request.getfixturevalue("device") if "device" in request.fixturenames else "cpu"
    try:
        default = wp.device_to_jax(device)
    except RuntimeError:
        pytest.skip(f"JAX has no device {device}")
    with jax.default_device(default):
        yield


@cache
def scene_on(device):
    return build_scene(device)


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
    torch, wt = pytest.importorskip("torch"), pytest.importorskip("warpvis.torch")
    mask, images = mask_of(scene_on(device), PINHOLE, POSE)
    place = device.replace("cpu:0", "cpu")
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
        np.testing.assert_allclose(got[k], expected, rtol=0, atol=1e-6 * np.abs(expected).max())
        weights = ~mask & np.isfinite(images.depth)

        def weighted(pose, weights=weights):
            depth = wvj.render(scene, PINHOLE, pose, object_poses=OBJECTS).depth
            return jnp.where(weights, depth, 0.0).sum()

        np.testing.assert_array_equal(expected, jax.grad(weighted)(pose))


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
