# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of visibility through occupancy maps: lines of sight that are blocked, free, or not measured."""

import numpy as np
import pytest
import reference_lines
import trimesh
from reference_occupancy import NOT_MEASURED, DenseMap
from reference_poses import poses_to_matrices

import warpvis as wv
from warpvis import Camera, Visibility
from warpvis.errors import WarpvisError
from warpvis.visibility import MeasuredSpace

CAMERA = Camera.from_fov(160, 120, hfov=1.2, near=0.2, far=8.0)
BOX = np.array([(-2.0, -2.0, -0.4), (2.0, 2.0, 2.0)])
EYE = wv.look_at((-1.5, 0.1, 1.0), (0.0, 0.0, 0.5))
CLEARANCE = 0.5


def room(device, *, cup=(1.2, 0.0, 0.6)):
    """Return a scene with a floor, a wall of 10 cm in the middle, and a movable cup behind it."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box(bounds=[(-3, -3, -0.2), (3, 3, -0.01)]), name="floor", label="ground")
    scene.add(trimesh.creation.box(bounds=[(0.0, -0.5, 0.0), (0.1, 0.5, 0.9)]), name="wall")
    scene.add(trimesh.creation.icosphere(radius=0.1), name="cup", movable=True, pose=(*cup, 0, 0, 0, 1))
    return scene


def measured(scene, eyes, cell=0.04, repeats=2):
    """Return a map of a scene without its cup, from eyes that look at the wall."""
    poses = np.array([wv.look_at(eye, (0.05, 0.0, 0.5)) for eye in eyes], dtype=np.float32)
    depth = wv.render(scene, CAMERA, poses, outputs="depth", exclude=["cup"]).depth
    occupancy = wv.OccupancyMap(cell, device=scene.device)
    for _ in range(repeats):
        occupancy.integrate(depth, CAMERA, poses)
    return occupancy


ALL_AROUND = [(1.8 * np.cos(a), 1.8 * np.sin(a), h) for a in np.arange(0, 6.28, 0.4) for h in (0.7, 1.6)]


def dense_copy(occupancy):
    """Return a map's voxels for the reference."""
    dense = DenseMap(BOX, occupancy.cell_size)
    centers = (dense.first + np.moveaxis(np.indices(dense.size), 0, -1) + 0.5) * dense.cell
    points = centers.reshape(-1, 3).astype(np.float32)
    probability = occupancy.probabilities(points).numpy()
    dense.values = np.where(np.isnan(probability), NOT_MEASURED, np.where(probability >= 0.5, 1, -1)).reshape(
        dense.size
    )
    return dense


@pytest.mark.parametrize("eyes", [ALL_AROUND, ALL_AROUND[:1]], ids=["much", "little"])
def test_lines_match_reference(device, eyes):
    occupancy = measured(room(device), eyes)
    dense = dense_copy(occupancy)
    random = np.random.default_rng(0)
    points = random.uniform(*BOX, (400, 3)).astype(np.float32)
    points[:20] = np.round(points[:20] / 0.04) * 0.04  # corners of voxels
    poses = np.array([EYE, wv.look_at((1.7, 1.0, 0.7), (0, 0, 0.4)), wv.look_at((0.06, -1.7, 0.5), (0.06, 0, 0.5))])
    wide = Camera.from_fov(400, 400, hfov=2.9)
    status, share = wv.point_visibility(occupancy, wide, poses, points, unknown=True)
    assert {Visibility.OUT_OF_VIEW, Visibility.OCCLUDED, Visibility.VISIBLE} <= set(np.unique(status.numpy()))
    assert (status.numpy() == Visibility.UNKNOWN).any() or eyes is ALL_AROUND
    for view, pose in enumerate(poses):
        eye = np.asarray(pose, dtype=np.float32)[:3].astype(np.float64)
        expected, expected_share = reference_lines.judge_lines(dense, eye, points, CLEARANCE, 0.08, 0.04)
        inside = status.numpy()[view] != Visibility.OUT_OF_VIEW
        # Lines along faces and edges of voxels are in either one.
        differs = (status.numpy()[view] != expected)[inside]
        assert differs[20:].sum() == 0
        assert differs.mean() < 0.02
        agrees = np.flatnonzero(inside)[~differs]
        np.testing.assert_allclose(share.numpy()[view][agrees], expected_share[agrees], atol=2e-5)


@pytest.mark.parametrize("eyes", [ALL_AROUND, ALL_AROUND[:1]], ids=["much", "little"])
def test_rendered_depth_matches_reference(device, eyes):
    small, occupancy = Camera.from_fov(40, 30, hfov=1.2, near=0.3, far=1.8), measured(room(device), eyes)
    dense = dense_copy(occupancy)
    poses = np.array([EYE, wv.look_at((0.6, 1.2, 0.9), (0.0, -0.2, 0.3))], dtype=np.float32)
    depth = occupancy.render_depth(small, poses).numpy()
    assert np.isinf(depth).any() if eyes is ALL_AROUND else np.isnan(depth).any()
    for image, pose in zip(depth, poses, strict=True):
        matrix = poses_to_matrices(pose[None])[0]
        pixels = np.stack(np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5), axis=-1)
        rays = small.depth_rays(pixels) @ matrix[:3, :3].T
        expected = reference_lines.render_map(dense, matrix[:3, 3], rays, 0.3, 1.8)
        agrees = np.isclose(image, expected, atol=1e-4, equal_nan=True)
        assert agrees.mean() > 0.98  # lines along faces of voxels are in either one
    if eyes is ALL_AROUND:
        truth = wv.render(room(device), small, poses, exclude=["cup"], outputs="depth").depth.numpy()
        both = np.isfinite(depth) & np.isfinite(truth)
        assert both.mean() > 0.4
        assert np.median(np.abs(depth - truth)[both]) < 0.04


def test_points_behind_a_measured_wall_are_occluded(device):
    occupancy = measured(room(device), ALL_AROUND)
    points = [(0.6, 0.0, 0.5), (-0.5, 0.0, 0.5), (0.0, 0.0, 0.5), (0.6, 0.0, 1.3), (-1.5, 3.0, 1.0)]
    status = wv.point_visibility(occupancy, CAMERA, EYE, points).numpy()[0]
    assert status.tolist() == [
        Visibility.OCCLUDED,
        Visibility.VISIBLE,
        Visibility.VISIBLE,  # on the wall
        Visibility.VISIBLE,  # above it
        Visibility.OUT_OF_VIEW,
    ]


def test_lines_through_unmeasured_space_are_unknown(device):
    """A person behind the wall looks at a point that the camera does not see: nobody measured what is between."""
    occupancy = measured(room(device), [(-1.5, 0.1, 1.0)])
    person = wv.look_at((1.6, 0.0, 0.5), (0.5, 0.0, 0.3))
    status, share = wv.point_visibility(occupancy, CAMERA, person, [(0.5, 0.0, 0.3)], unknown=True)
    assert status.numpy() == Visibility.UNKNOWN
    assert share.numpy() > 0.9
    patient = MeasuredSpace(occupancy, max_unknown=2.0)
    space, free = room(device), wv.point_visibility(room(device), CAMERA, person, [(0.5, 0.0, 0.3)])
    assert wv.point_visibility(space, CAMERA, person, [(0.5, 0.0, 0.3)], occupancy=patient).numpy() == free.numpy()
    assert free.numpy() == Visibility.VISIBLE


def test_scene_and_map_hide_points_together(device):
    scene, occupancy = room(device), measured(room(device), ALL_AROUND)
    cup = wv.Scene(device=device)
    cup.add(trimesh.creation.icosphere(radius=0.1), name="cup", pose=(-0.6, 0.05, 0.75, 0, 0, 0, 1))
    behind_cup, behind_wall = (-0.35, 0.04, 0.67), (0.6, 0.3, 0.4)
    for first, expected in ((cup, [3, 3]), (scene, [4, 3])):
        status, hidden_by = wv.point_visibility(
            first, CAMERA, EYE, [behind_cup, behind_wall], occupancy=occupancy, occluders=True
        )
        assert status.numpy()[0].tolist() == expected
        if first is cup:
            assert hidden_by.numpy()[0].tolist() == [0, -1]


def test_floor_at_a_grazing_angle_does_not_hide_itself(device):
    occupancy = measured(room(device), ALL_AROUND)
    points = [(x, 1.2, 0.0) for x in (-0.5, 0.0, 0.5, 1.0, 1.5)]
    status = wv.point_visibility(occupancy, CAMERA, wv.look_at((-1.6, 1.2, 0.3), (0, 1.2, 0)), points).numpy()
    assert (status == Visibility.VISIBLE).all()


def test_objects_are_hidden_by_the_map_and_by_unknown_space(device):
    """A cup behind the wall is occluded by it; one in space that nobody measured is unknown; half of one is, too."""
    scene, chosen = wv.Scene(device=device), {}
    scene.add(trimesh.creation.icosphere(radius=0.1), name="cup", movable=True)
    poses = np.zeros((3, 1, 7), dtype=np.float32)
    poses[..., 6] = 1
    poses[:, 0, :3] = [(0.6, 0.0, 0.5), (-0.6, 0.0, 0.5), (0.05, 0.0, 1.3)]
    occupancy = measured(room(device), ALL_AROUND)
    eyes = np.tile(EYE, (3, 1))
    without = wv.object_visibility(scene, CAMERA, eyes, object_poses=poses)
    found = wv.object_visibility(scene, CAMERA, eyes, object_poses=poses, occupancy=occupancy)
    assert found.status.numpy()[:, 0].tolist() == [Visibility.OCCLUDED, Visibility.VISIBLE, Visibility.VISIBLE]
    assert without.visible_pixels.numpy().min() > 5
    assert (found.visible_pixels.numpy()[1:] == without.visible_pixels.numpy()[1:]).all()
    assert (found.silhouette_pixels.numpy() == without.silhouette_pixels.numpy()).all()
    assert found.unknown_pixels.numpy().tolist() == [[0], [0], [0]]
    assert found.occluder.numpy()[0] == -1

    little = measured(room(device), [(-1.5, 0.1, 1.0)])
    eye = wv.look_at((0.9, -1.0, 0.8), (0.1, -0.4, 0.5))
    for place, low, high in (((-0.5, -0.6, 0.6), 0.0, 0.05), ((0.7, 0.0, 0.4), 0.95, 1.0)):
        poses[0, 0, :3] = place
        chosen = wv.object_visibility(scene, CAMERA, eye, object_poses=poses[:1], occupancy=little)
        share = chosen.unknown_pixels.numpy() / chosen.image_pixels.numpy()
        assert low <= share <= high, (place, share)
        counts = [array.numpy() for array in (chosen.image_pixels, chosen.visible_pixels, chosen.unknown_pixels)]
        before = np.where(counts[1] > 0, Visibility.VISIBLE, Visibility.OCCLUDED)
        assert (chosen.status.numpy() == reference_lines.judge_unknown(*counts, before)).all()
        assert (chosen.status.numpy() == Visibility.UNKNOWN) == (share > 0.5)
    with_delta = wv.object_visibility(scene, CAMERA, eye, object_poses=poses[:1], occupancy=little, delta=0.01)
    assert (with_delta.unknown_pixels.numpy() == chosen.unknown_pixels.numpy()).all()
    assert abs(with_delta.visible_pixels.numpy() - chosen.visible_pixels.numpy()) <= 2


def test_empty_map_knows_nothing(device):
    status, share = wv.point_visibility(wv.OccupancyMap(0.1, device=device), CAMERA, EYE, [(0, 0, 0.5)], unknown=True)
    assert status.numpy() == Visibility.UNKNOWN
    assert share.numpy() == 1.0


def test_lenses_look_through_maps(device):
    scene, occupancy = room(device), measured(room(device), ALL_AROUND)
    lens = wv.cameras.LensCamera(CAMERA.lens, 160, 120, near=CAMERA.near, far=CAMERA.far)
    points = [(0.6, 0.0, 0.5), (-0.5, 0.0, 0.5), (-1.5, 3.0, 1.0)]
    expected = wv.point_visibility(occupancy, CAMERA, EYE, points).numpy()
    assert (wv.point_visibility(occupancy, lens, EYE, points).numpy() == expected).all()
    assert (wv.point_visibility(scene, lens, EYE, points, occupancy=occupancy).numpy() == expected).all()
    with pytest.raises(WarpvisError, match="camera must be a pinhole"):
        wv.object_visibility(scene, lens, EYE, occupancy=occupancy)


def test_invalid_maps_raise(device):
    scene, occupancy = room(device), wv.OccupancyMap(0.1, device=device)
    for message, call in {
        "occupancy must be a warpvis.OccupancyMap, got Scene": lambda: MeasuredSpace(scene),
        "eye_clearance must be": lambda: MeasuredSpace(occupancy, eye_clearance=-1),
        "unknown must be False without": lambda: wv.point_visibility(scene, CAMERA, EYE, [(0, 0, 0)], unknown=True),
        "scene must be a warpvis.Scene for occluders": lambda: wv.point_visibility(
            occupancy, CAMERA, EYE, [(0, 0, 0)], occluders=True
        ),
        "scene must be a warpvis.Scene": lambda: wv.object_visibility(occupancy, CAMERA, EYE),
    }.items():
        with pytest.raises(WarpvisError, match=message):
            call()


def test_agents_see_through_maps(device):
    """The robot's half of the cup is behind unmeasured space, and the person, at the other side, sees it whole."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.icosphere(radius=0.15), name="cup", pose=(-0.6, 0.0, 0.6, 0, 0, 0, 1))
    occupancy = measured(room(device), [(-1.7, 0.1, 1.0), (-1.7, -0.3, 1.1)])
    robot = wv.Agent("robot", CAMERA, wv.look_at((-1.5, 0.1, 1.0), (-0.6, 0.0, 0.6)))
    behind = wv.Agent.human("person behind the wall", wv.look_at((1.5, 0.0, 0.8), (0.0, 0.0, 0.7)))
    beside = wv.Agent.human("person outside", wv.look_at((-0.6, 2.5, 0.6), (-0.6, 0.0, 0.6)))
    seen = wv.perspective(scene, [robot, behind, beside], occupancy=occupancy)
    assert seen.status[:, 0, 0].tolist() == [Visibility.VISIBLE, Visibility.OCCLUDED, Visibility.UNKNOWN]
    assert seen.unknown_fraction[0, 0, 0] < 0.01
    assert seen.unknown_fraction[2, 0, 0] > 0.5
    assert "unknown" in seen.table()
    assert seen[0].report()["objects"][0]["agents"]["person outside"]["status"] == "UNKNOWN"
    everything = wv.perspective(scene, [robot, behind, beside])
    assert everything.visible.all()
    assert (everything.unknown_fraction == 0).all()
    lenient = wv.perspective(scene, [beside], occupancy=MeasuredSpace(occupancy, max_unknown=9.0))
    assert lenient.visible.all()
