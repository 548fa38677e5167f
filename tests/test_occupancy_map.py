# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of occupancy maps: against the reference, against geometry, with noise, people and changing scenes."""

import re

import numpy as np
import pytest
import reference_occupancy
import trimesh
import warp as wp

import warpvis as wv
from warpvis import Camera
from warpvis.cameras import LensCamera, lenses
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import ArrayError, CameraError, PoseError, WarpvisError
from warpvis.maps import OccupancyMap, Voxel, _occupancy_batch
from warpvis.maps._rectified import Rectification, rectify

from support.voxels import build

CAMERA = Camera.from_fov(160, 120, hfov=1.0, near=0.2, far=4.0)
BOX = np.array([(-1.5, -1.2, -0.2), (1.5, 1.2, 1.3)])


def sigma(depth):
    return 0.0012 + 0.0019 * (depth - 0.4) ** 2


def around(count, radius=1.9, height=1.1):
    """Return poses on a circle that look at a point above the origin."""
    poses = []
    for angle in np.linspace(0, 2 * np.pi, count, endpoint=False) + 0.3:
        eye = np.array([radius * np.cos(angle), radius * np.sin(angle), height])
        poses.append(wv.look_at(eye, (0.05, 0.02, 0.3)))
    return np.array(poses, dtype=np.float32)


def noisy_depth(scene, poses, seed=0):
    """Render depth with noise and pixels without a measurement."""
    depth = wv.render(scene, CAMERA, poses, outputs="depth").depth.numpy()
    random = np.random.default_rng(seed)
    finite = np.isfinite(depth)
    depth[finite] += random.normal(size=depth.shape)[finite] * sigma(depth[finite])
    depth[random.random(depth.shape) < 0.02] = np.nan
    depth[:, 30:50, 100:130] = 0.0
    depth[:, 90:95, 20:30] = -np.inf
    return depth.astype(np.float32)


def values_of(occupancy, dense):
    """Return a map's values in the voxels of a dense map."""
    centers = (dense.first + np.moveaxis(np.indices(dense.size), 0, -1) + 0.5) * dense.cell
    points = centers.reshape(-1, 3).astype(np.float32)
    states = occupancy.states(points).numpy().reshape(dense.size)
    return states, occupancy.probabilities(points).numpy().reshape(dense.size)


def assert_matches_twin(occupancy, dense):
    states, probabilities = values_of(occupancy, dense)
    certain = ~dense.uncertain
    assert certain.mean() > 0.9
    expected_states = reference_occupancy.write_states(dense)
    np.testing.assert_array_equal(states[certain], expected_states[certain])
    measured = certain & (dense.values > reference_occupancy.NOT_MEASURED)
    expected = 1 / (1 + np.exp(-dense.values * reference_occupancy.UNIT))
    np.testing.assert_allclose(probabilities[measured], expected[measured], atol=1e-6)
    assert np.isnan(probabilities[certain & ~measured]).all()
    # Where rounding decides, most voxels agree, too.
    assert (states != expected_states).mean() < 2e-3


@pytest.mark.parametrize("by_rows", [True, False])
@pytest.mark.parametrize("cell", [0.03, 0.1])
def test_map_matches_reference(device, by_rows, cell):
    if by_rows and device != "cpu":
        pytest.skip("rows are for CPU cores")
    scene, poses = build(device), around(4)
    depth = noisy_depth(scene, poses)
    occupancy, dense = OccupancyMap(cell, device=device), reference_occupancy.DenseMap(BOX, cell)
    occupancy._integrator.batch.by_rows = by_rows
    for image, pose in zip(depth, poses, strict=True):
        occupancy.integrate(image[None], CAMERA, pose[None], sigma=sigma)
        reference_occupancy.update_voxels(dense, image, CAMERA, pose, sigma)
    assert_matches_twin(occupancy, dense)
    assert set(np.unique(dense.states())) == set(Voxel)


def test_batches_and_threads_change_nothing(device):
    scene, poses = build(device), around(5)
    depth = noisy_depth(scene, poses)
    maps = [OccupancyMap(0.03, device=device) for _ in range(3)]
    maps[0].integrate(depth, CAMERA, poses, sigma=sigma)
    maps[1].integrate(depth, CAMERA, poses, sigma=sigma, threads=1)
    for image, pose in zip(depth, poses, strict=True):
        maps[2].integrate(image[None], CAMERA, pose[None], sigma=sigma, threads=7)
    first = maps[0].voxel_map(BOX)
    for other in maps[1:]:
        assert (other.voxel_map(BOX).states.numpy() == first.states.numpy()).all()


def test_poses_may_be_on_the_device_or_in_host_memory(device):
    scene, poses = build(device), around(3)
    depth = wv.render(scene, CAMERA, poses, outputs="depth").depth
    maps = []
    for given in (poses, poses_to_matrices(poses), wp.array(poses, dtype=wp.transform, device=device)):
        maps.append(OccupancyMap(0.05, device=device))
        maps[-1].integrate(depth, CAMERA, given)
    first, *others = (one.voxel_map(BOX).states.numpy() for one in maps)
    for other in others:
        assert (other != first).mean() < 1e-4


def test_blocks_are_merged(device):
    """In a room that is seen for long, voxels take memory only near surfaces and at the ends of the image."""
    scene, poses = build(device), around(1)
    depth = wv.render(scene, CAMERA, poses, outputs="depth").depth
    occupancy = OccupancyMap(0.03, device=device)
    for _ in range(3):
        occupancy.integrate(depth, CAMERA, poses)
    early = occupancy._blocks.used_slots
    states = occupancy.voxel_map().states.numpy()
    blocks = states.reshape(*(side for count in states.shape for side in (count // 8, 8))).transpose(0, 2, 4, 1, 3, 5)
    mixed = (blocks != blocks[..., :1, :1, :1]).any(axis=(3, 4, 5)).sum()
    assert mixed <= early < 1.2 * mixed
    for _ in range(10):
        occupancy.integrate(depth, CAMERA, poses)
    assert occupancy._blocks.used_slots <= early


def test_someone_who_walks_by_leaves_no_trail(device):
    scene, poses = wv.Scene(device=device), around(1)
    scene.add(trimesh.creation.box(bounds=[(-4, -4, -0.13), (4, 4, -0.03)]), name="floor")
    scene.add(trimesh.creation.cylinder(0.2, 1.0), name="person", movable=True)
    occupancy = OccupancyMap(0.04, device=device)
    empty = OccupancyMap(0.04, device=device)
    path = np.zeros((160, 1, 7), dtype=np.float32)
    path[..., 6] = 1
    path[:, 0, 2] = 0.6
    path[:, 0, 0], path[:, 0, 1] = np.linspace(-4, 4, 160), np.linspace(-2, 2, 160)
    camera = Camera.from_fov(160, 120, hfov=1.0, near=0.2, far=6.0)
    was_there = np.zeros(0)
    for step in path:
        depth = wv.render(scene, camera, poses, object_poses=step[None], outputs="depth").depth
        occupancy.integrate(depth, camera, poses)
        surface = (occupancy.voxel_map(BOX).states.numpy() == Voxel.SURFACE)[:, :, 10:]
        was_there = np.maximum(was_there, surface) if was_there.size else surface
    depth = wv.render(scene, camera, poses, exclude=["person"], outputs="depth").depth
    for _ in range(10):
        occupancy.integrate(depth, camera, poses)
        empty.integrate(depth, camera, poses)
    assert was_there.sum() > 100
    after, clean = (one.voxel_map(BOX).states.numpy() for one in (occupancy, empty))
    assert (after == clean).all()


def test_map_forgets_by_decay(device):
    scene, poses = build(device), around(2)
    depth = noisy_depth(scene, poses)
    occupancy, dense = OccupancyMap(0.05, device=device), reference_occupancy.DenseMap(BOX, 0.05)
    occupancy.integrate(depth, CAMERA, poses, sigma=sigma)
    for image, pose in zip(depth, poses, strict=True):
        reference_occupancy.update_voxels(dense, image, CAMERA, pose, sigma)
    for factor in (0.5, 0.3):
        occupancy.decay(factor)
        dense.values = reference_occupancy.fade(dense.values, factor)
        assert_matches_twin(occupancy, dense)
    occupancy.decay(0.0)
    _, after = values_of(occupancy, dense)
    assert (after[np.isfinite(after)] == 0.5).all()


def test_map_grows_in_all_directions(device):
    """Voxels of a map that grew have the states of a map that was large from the beginning."""
    scene = build(device)
    poses = np.array([wv.look_at((x, y, 1.0), (x - 2.0 * x, y - 2.0 * y, 0.2)) for x, y in ((1, 1), (-2, 1), (9, -9))])
    depth = wv.render(scene, CAMERA, poses, outputs="depth").depth.numpy()
    grown, large = OccupancyMap(0.05, device=device), OccupancyMap(0.05, device=device)
    large.integrate(np.full((1, 120, 160), np.nan, np.float32), CAMERA, poses[2:])
    for one in (grown, large):
        one.integrate(depth[:2], CAMERA, poses[:2])
    assert (grown.voxel_map(BOX).states.numpy() == large.voxel_map(BOX).states.numpy()).all()
    far = grown.states(np.array([(90.0, 0, 0), (-1e30, 0, 0), (0, 0, 1e30)])).numpy()
    assert far.tolist() == [Voxel.UNKNOWN] * 3


def test_bounds_limit_the_map(device):
    scene, poses = build(device), around(3)
    depth = wv.render(scene, CAMERA, poses, outputs="depth").depth
    bounds = [(-0.8, -0.8, 0.0), (0.8, 0.8, 0.8)]
    limited, whole = OccupancyMap(0.05, bounds=bounds, device=device), OccupancyMap(0.05, device=device)
    for one in (limited, whole):
        one.integrate(depth, CAMERA, poses)
    assert (limited.voxel_map(bounds).states.numpy() == whole.voxel_map(bounds).states.numpy()).all()
    assert limited.states([(1.3, 0.0, 0.0)]).numpy() == [Voxel.UNKNOWN]
    assert whole.states([(1.3, 0.0, 0.0)]).numpy() != [Voxel.UNKNOWN]


def test_voxel_map_labels_the_ground(device):
    scene, poses = build(device), around(3)
    occupancy = OccupancyMap(0.05, device=device)
    occupancy.integrate(wv.render(scene, CAMERA, poses, outputs="depth").depth, CAMERA, poses)
    dense = occupancy.voxel_map(BOX)
    surface = dense.states.numpy() == Voxel.SURFACE
    labels = dense.labels.numpy()
    assert ((labels != wv.Label.EMPTY) == surface).all()
    heights = dense.centers()[..., 2]
    assert (labels[surface & (heights < 0.03)] == wv.Label.GROUND).all()
    assert (labels[surface & (heights > 0.03)] == wv.Label.OBSTACLE).all()
    assert {wv.Label.GROUND, wv.Label.OBSTACLE} <= set(np.unique(labels))


BENT = lenses.OpenCVPinhole(40, 42, 32.5, 24, (-0.25, 0.05, 0.001, -0.002, 0.0))


@pytest.mark.parametrize("kind", ["z", "range"])
def test_images_of_lenses_are_rectified(device, kind):
    lens = LensCamera(BENT, 64, 48, near=0.3, far=2.5, kind=kind)
    scene, poses = build(device), around(3)
    depth = wv.render(scene, lens, poses, outputs="depth").depth
    rectified, pinhole = rectify(depth, lens, None)
    expected = reference_occupancy.rectify_depth(depth.numpy()[0], lens, pinhole)
    np.testing.assert_allclose(rectified.numpy()[0], expected, rtol=1e-6)
    assert np.isfinite(expected).mean() > 0.3
    assert len({int(i) for i in Rectification.of(lens, depth.device).pixels.numpy().ravel()}) > 0.9 * 64 * 48

    # The map is that of the pinhole, apart from the rounding of pixels.
    of_lens, of_pinhole = OccupancyMap(0.1, device=device), OccupancyMap(0.1, device=device)
    of_lens.integrate(depth, lens, poses)
    exact = wv.render(scene, pinhole, poses, outputs="depth").depth.numpy()
    exact[np.isnan(rectified.numpy())] = np.nan
    of_pinhole.integrate(exact, pinhole, poses)
    states = [one.voxel_map(BOX).states.numpy() for one in (of_lens, of_pinhole)]
    assert (states[0] == states[1]).mean() > 0.93


def test_lenses_that_are_too_wide_raise(device):
    wide = LensCamera(lenses.KannalaBrandt(20, 20, 32, 24, (0.0,) * 4), 64, 48)
    with pytest.raises(CameraError, match="camera must have rays up to 75 degrees from its axis for a map"):
        OccupancyMap(0.1, device=device).integrate(np.ones((1, 48, 64), np.float32), wide, around(1))


INVALID = {
    "cell_size must be a positive number of meters, got 0": {"cell_size": 0},
    "hit must be a probability between 0.5 and 1.0, got 0.4": {"hit": 0.4},
    "miss must be a probability between 0.0 and 0.5, got 0.5": {"miss": 0.5},
    "maximum must be a probability between 0.5 and 1.0, got 1.0": {"maximum": 1.0},
    "bounds must be the lower and upper corner of a box": {"bounds": [(0, 0, 0), (1, 1, 0)]},
    'up must be "z" or "y"': {"up": "x"},
}


@pytest.mark.parametrize("message", INVALID)
def test_invalid_options_raise(message):
    with pytest.raises(WarpvisError, match=re.escape(message)):
        OccupancyMap(**INVALID[message])


def test_invalid_images_raise(device):
    occupancy, poses = OccupancyMap(0.05, device=device), around(1)
    depth = np.full((1, 120, 160), 1.5, dtype=np.float32)
    with pytest.raises(ArrayError, match="max_range must be a positive number of meters, got 0"):
        occupancy.integrate(depth, CAMERA, poses, max_range=0)
    with pytest.raises(ArrayError, match="divide millimeters by 1000"):
        occupancy.integrate((1000 * depth).astype(np.uint16), CAMERA, poses)
    with pytest.raises(ArrayError, match="factor must be"):
        occupancy.decay(1.5)
    with pytest.raises(ArrayError, match="give it bounds or larger voxels"):
        OccupancyMap(1e-4, device=device).integrate(depth, CAMERA, poses)
    assert occupancy.voxel_map(BOX).counts()[Voxel.UNKNOWN] == 60 * 48 * 30


@pytest.mark.parametrize("together", [True, False])
def test_poses_of_another_meaning_are_refused(together):
    scene = build("cpu")
    eyes = np.linspace((1.4, -0.9, 0.7), (1.5, 0.6, 1.4), 6)
    poses = np.array([wv.look_at(eye, (0.0, 0.4 * eye[1], 0.3)) for eye in eyes], dtype=np.float32)
    depth = wv.render(scene, CAMERA, poses, outputs="depth").depth.numpy()
    matrices = poses_to_matrices(poses)
    wrong = {
        "pass their inverses": (np.linalg.inv(matrices), {}),
        'pass convention="opencv"': (matrices, {"convention": "opengl"}),
        'pass quaternion="wxyz"': (poses[:, [0, 1, 2, 6, 3, 4, 5]], {}),
    }
    for remedy, (given, options) in wrong.items():
        occupancy = OccupancyMap(0.05)
        steps = [slice(None)] if together else [slice(k, k + 1) for k in range(6)]
        with pytest.raises(PoseError, match=re.escape(remedy)):
            for step in steps:
                occupancy.integrate(depth[step], CAMERA, given[step], **options)
    occupancy = OccupancyMap(0.05)
    for k in range(6):
        occupancy.integrate(depth[k : k + 1], CAMERA, poses[k : k + 1])


def test_long_lists_of_blocks(device, monkeypatch):
    """Images that change more blocks than the list has room for are not lost."""
    scene, poses = build(device), around(3)
    depth = noisy_depth(scene, poses)
    maps = []
    for length in (_occupancy_batch._MIN_LISTED, 3):
        monkeypatch.setattr(_occupancy_batch, "_MIN_LISTED", length)
        maps.append(OccupancyMap(0.05, device=device))
        maps[-1].integrate(depth, CAMERA, poses, sigma=sigma)
        maps[-1].integrate(depth[:1], CAMERA, poses[:1], sigma=sigma)
    first, second = (one.voxel_map(BOX).states.numpy() for one in maps)
    np.testing.assert_array_equal(first, second)
    assert maps[0]._blocks.used_slots == maps[1]._blocks.used_slots > 3
