# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Silhouettes: masks of the pixels next to them, against a twin and against renders of a moved scene."""

import numpy as np
import pytest
import reference_soft_visibility as twin
import torch
import trimesh

import warpvis as wv
import warpvis.torch as wt
from warpvis.errors import CameraError

from support.gradients import CAMERAS, OBJECT_ROWS, ROW, STEP, build_scene, cast_depth, changes_of, flat_rays

IMAGES = ("depth", "normals", "segmentation")
WITH_IMAGES = [name for name in CAMERAS if name != "lidar"]


def tensor(values, device):
    return torch.tensor(np.asarray(values), dtype=torch.float32, device=device.replace("cpu:0", "cpu"))


def mask_of(name, device):
    scene, poses = build_scene(device), tensor(ROW[None], device)
    images = wt.render(scene, CAMERAS[name], poses, object_poses=tensor(OBJECT_ROWS, device), outputs=IMAGES)
    return images, wt.silhouette_mask(scene, CAMERAS[name], poses, images)


@pytest.mark.parametrize("name", WITH_IMAGES)
def test_mask_matches_twin(name, device):
    images, mask = mask_of(name, device)
    assert mask.dtype == torch.bool
    seen = {key: getattr(images, key)[0].cpu().numpy() for key in IMAGES}
    np.testing.assert_array_equal(mask[0].cpu().numpy(), twin.mark_silhouettes(CAMERAS[name], ROW, seen))
    assert 0.05 < mask.float().mean() < 0.6


def test_vmap_marks_the_same_pixels(device):
    scene, camera = build_scene(device), CAMERAS["pinhole"]
    objects = tensor(OBJECT_ROWS, device)
    poses = tensor(np.stack([ROW, ROW + [0.1, 0, 0, 0, 0, 0, 0]])[:, None], device)

    def mark(pose):
        images = wt.render(scene, camera, pose, object_poses=objects, outputs=IMAGES)
        return wt.silhouette_mask(scene, camera, pose, images)

    assert torch.equal(torch.vmap(mark)(poses), torch.stack([mark(poses[0]), mark(poses[1])]))


@pytest.mark.parametrize("name", WITH_IMAGES)
def test_other_pixels_see_the_same_surface_after_a_small_motion(name, device):
    """Motions by a third of a pixel change the object only within the mask."""
    images, mask = mask_of(name, device)
    scene, camera = build_scene(device), CAMERAS[name]
    segmentation = images.segmentation.cpu().numpy()
    free, entered = ~mask.cpu().numpy(), False
    rng = np.random.default_rng(0)
    for _ in range(10):
        angles = rng.uniform(-1, 1, 3)
        twist = np.array([*angles / np.linalg.norm(angles) * _pixel_angle(camera) / 3, 0, 0, 0])
        row = wt.apply_twists(torch.tensor(ROW[None]), torch.tensor(twist[None])).numpy()
        moved = wv.render(scene, camera, row, object_poses=OBJECT_ROWS[None], outputs=IMAGES)
        assert (moved.segmentation.numpy() == segmentation)[free].all()
        entered |= (moved.segmentation.numpy() != segmentation).any()
    assert entered


def _pixel_angle(camera):
    """Return the smallest angle between the rays of neighbors [rad], or for parallel rays a small one."""
    rays = np.asarray(camera.rays) / np.linalg.norm(camera.rays, axis=-1, keepdims=True)
    steps = np.linalg.norm(np.diff(rays, axis=1), axis=-1)
    return np.nanmin(np.where(steps > 0, steps, 0.01))


def test_steps_of_depth_within_an_object_are_marked(device):
    """A bent floor has no silhouettes, whereas a box in front of a wall of the same mesh has."""
    wall = trimesh.creation.box(
        extents=(0.2, 4.0, 4.0), transform=trimesh.transformations.translation_matrix([3, 0, 0])
    )
    box = trimesh.creation.box(extents=(0.5, 0.6, 0.6), transform=trimesh.transformations.translation_matrix([2, 0, 0]))
    ramp = trimesh.Trimesh([[2.9, -2, 0], [2.9, 2, 0], [1, -2, -1], [1, 2, -1]], [[0, 1, 2], [1, 3, 2]])
    camera, row = wv.Camera.from_fov(60, 60, hfov=0.9), wv.look_at((0, 0, 0), (1, 0, 0)).reshape(1, 7)
    marked = []
    for parts in ([wall, ramp], [wall, ramp, box]):
        scene = wv.Scene(device=device)
        scene.add(trimesh.util.concatenate(parts), name="room")
        poses = tensor(row, device)
        images = wt.render(scene, camera, poses, outputs=IMAGES)
        marked.append(wt.silhouette_mask(scene, camera, poses, images)[0].cpu().numpy())
    assert not marked[0].any()
    near = np.isclose(images.depth[0].cpu().numpy(), 1.75, atol=1e-4)
    assert near.any()
    upper = np.s_[:30]  # below, the box meets the ramp
    inside = near.copy()
    inside[1:-1, 1:-1] &= near[:-2, 1:-1] & near[2:, 1:-1] & near[1:-1, :-2] & near[1:-1, 2:]
    assert (marked[1] & near)[upper].sum() == (near & ~inside)[upper].sum()


@pytest.mark.parametrize("name", WITH_IMAGES)
def test_gradients_of_other_pixels_equal_central_differences(name, device):
    """Of all of them, also of those that see another triangle after the step."""
    _, mask = mask_of(name, device)
    scene, camera = build_scene(device), CAMERAS[name]
    poses, objects = tensor(ROW[None], device).requires_grad_(), tensor(OBJECT_ROWS, device).requires_grad_()
    depth = wt.render(scene, camera, poses, object_poses=objects).depth
    free = ~mask & depth.isfinite()
    depth[free].sum().backward()
    got = np.concatenate([poses.grad.cpu().numpy().reshape(-1), objects.grad.cpu().numpy().reshape(-1)])
    rays, origins, _ = flat_rays(camera)
    chosen = free.cpu().numpy().reshape(-1)
    rays, origins = rays[chosen], None if origins is None else origins[chosen]
    values = []
    for change in changes_of("row", ROW) + changes_of("object_rows", OBJECT_ROWS):
        given = {"row": ROW, "object_rows": OBJECT_ROWS, **change}
        values.append(cast_depth(build_scene(), rays, origins, **given)[0].sum())
    expected = np.subtract(values[::2], values[1::2]) / (2 * STEP)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"images": None}, "images must be warpvis.torch.Images, got NoneType"),
        ({"images": wt.Images()}, "images must have depth, normals, segmentation, got none of depth, normals"),
        ({"poses": torch.eye(4).expand(2, 4, 4)}, r"images must have the axes \(2, 28, 36\) of poses and camera"),
        ({"camera": CAMERAS["lidar"]}, "images must have the axes"),
    ],
)  # fmt: skip
def test_bad_input_of_masks_is_one_sentence(change, message):
    images, _ = mask_of("pinhole", "cpu")
    arguments = {"camera": CAMERAS["pinhole"], "poses": tensor(ROW[None], "cpu"), "images": images, **change}
    with pytest.raises(wv.WarpvisError, match=message):
        wt.silhouette_mask(build_scene(), **arguments)


def test_rays_without_neighbors_have_no_mask():
    scene, poses = build_scene(), tensor(ROW[None], "cpu")
    images = wt.render(scene, CAMERAS["lidar"], poses, outputs=IMAGES)
    with pytest.raises(CameraError, match=r"camera must have pixels with neighbors .*, got a list of rays"):
        wt.silhouette_mask(scene, CAMERAS["lidar"], poses, images)


def test_mask_is_compiled(device):
    scene, camera, poses = build_scene(device), CAMERAS["pinhole"], tensor(ROW[None], device)

    def mask(poses):
        return wt.silhouette_mask(scene, camera, poses, wt.render(scene, camera, poses, outputs=IMAGES))

    compiled = torch.compile(mask, fullgraph=True, backend="aot_eager")
    assert torch.equal(mask(poses), compiled(poses))
