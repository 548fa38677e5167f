# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Which points of depth images a second eye sees."""

import numpy as np
import pytest
import reference_second_eye as twin
import trimesh
import warp as wp
from test_remap import CAMERA, SHAPES, build
from test_worlds import eyes, random_poses

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.core.threads import launch_images
from warpvis.rendering._second_eye import SLACK, find_hidden
from warpvis.scene.worlds import parse_worlds

import reference


def aside(poses, baseline):
    """The same poses, so far to the right of the camera."""
    moved = np.array(poses, dtype=np.float32)
    moved[:, :3] += poses_to_matrices(moved)[:, :3, 0] * baseline
    return moved


def hidden_from(scene, camera, poses, baseline, threads=2, **arguments):
    """What is seen, and what of it a second eye does not see."""
    exclude = arguments.pop("exclude", None)
    options = {"outputs": ("depth",), "threads": threads, **arguments}
    renderer = wv.Renderer(scene, camera, **options)
    depth = renderer.render(poses, exclude=exclude).depth
    hidden = wp.full(depth.shape, 7, dtype=wp.uint8, device=scene.device)
    worlds = parse_worlds(scene, len(poses), None, None, exclude, None)
    caster = renderer._caster
    there = caster.parse_poses(aside(poses, baseline), "opencv")
    find_hidden(caster, there, worlds, depth, camera.fx * baseline, hidden, threads=threads)
    return depth.numpy(), hidden.numpy()


@pytest.mark.parametrize("size", [(96, 72), (75, 50), (700, 20), (3, 2)])
@pytest.mark.parametrize("baseline", [0.15, -0.4])
def test_hidden_points_match_their_twin(size, baseline, device, caster):
    scene, poses = build(device, random_poses(np.random.default_rng(1), len(SHAPES))), eyes(2)
    camera = wv.Camera(*size, 80.3, 77.9, size[0] / 2 - 0.7, size[1] / 2 - 0.9, near=0.3, far=6.0)
    depth, hidden = hidden_from(scene, camera, poses, baseline, caster=caster)
    assert set(np.unique(hidden)) <= {0, 1}
    for view, pose in enumerate(aside(poses, baseline)):
        places = twin.shift_places(depth[view], camera.fx * baseline)
        expected = reference.cast_rays_at(scene, camera, pose, places)
        surface = np.where(np.isneginf(expected.depth), 0.0, expected.depth)
        found = twin.judge_hidden(depth[view], surface, SLACK)
        sure = found == twin.judge_hidden(depth[view], surface, 20 * SLACK)
        wrong = (found != (hidden[view] == 1)) & sure
        assert wrong.mean() <= 2e-4
        assert not hidden[view][~np.isfinite(depth[view])].any()
        outside = (places[..., 0] < 0) | (places[..., 0] >= camera.width)
        assert not hidden[view][outside].any()
    assert size[0] < 10 or hidden.any(axis=(1, 2)).all()


@pytest.mark.parametrize(("baseline", "side"), [(0.075, "left"), (-0.075, "right")])
def test_the_shadow_of_a_plate(baseline, side, device, caster):
    """It is f b (1 / z1 - 1 / z2) wide, on the side from which the second eye is away."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.01, 8, 8)), name="wall", pose=(2.005, 0, 0, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.01, 0.4, 8)), name="plate", pose=(1.005, 0, 0, 0, 0, 0, 1))
    camera = wv.Camera.from_fov(320, 240, hfov=0.994837, near=0.1, far=10.0)
    pose = wv.look_at((0, 0, 0), (1, 0, 0))[None].astype(np.float32)
    depth, hidden = hidden_from(scene, camera, pose, baseline, caster=caster)
    width = camera.fx * abs(baseline) * (1 / 1.0 - 1 / 2.0)
    assert np.abs(hidden[0].sum(axis=1) - width).max() <= 1
    columns = np.flatnonzero(hidden[0, 120])
    plate = np.flatnonzero(depth[0, 120] < 1.5)
    assert (columns.max() == plate.min() - 1) if side == "left" else (columns.min() == plate.max() + 1)
    assert (depth[0][hidden[0] == 1] > 1.9).all()
    depth, hidden = hidden_from(scene, camera, pose, baseline, caster=caster, exclude=["plate"])
    assert not hidden.any()


def test_nothing_is_hidden_from_the_camera_itself(device, caster):
    preset = wv.scenes.PRESETS["blobs_77k"]
    _, hidden = hidden_from(preset.build(device), CAMERA, preset.poses(2), 0.0, caster=caster)
    assert not hidden.any()


def test_flags_do_not_depend_on_threads():
    preset = wv.scenes.PRESETS["room"]
    scene, poses = preset.build(), preset.poses(3)
    first = hidden_from(scene, CAMERA, poses, 0.1, threads=1)[1]
    assert 0 < first.mean() < 0.5
    for threads in (2, 7):
        np.testing.assert_array_equal(hidden_from(scene, CAMERA, poses, 0.1, threads=threads)[1], first)
    alone = hidden_from(scene, CAMERA, poses[1:2], 0.1)[1]
    np.testing.assert_array_equal(alone[0], first[1])


def test_kernels_match_their_twins(device):
    from warpvis.kernels.second_eye import judge_hidden, shift_places

    rng = np.random.default_rng(2)
    depth = rng.uniform(0.2, 9, (2, 11, 13)).astype(np.float32)
    depth[rng.uniform(size=depth.shape) < 0.2] = np.inf
    depth[0, :2], depth[1, 3] = -np.inf, np.nan
    surface = np.where(rng.uniform(size=depth.shape) < 0.5, depth, depth * 0.9).astype(np.float32)
    given = [wp.array(array, dtype=wp.float32, device=device) for array in (depth, surface)]
    places = wp.empty(depth.shape, dtype=wp.vec2, device=device)
    hidden = wp.empty(depth.shape, dtype=wp.uint8, device=device)
    launch_images(shift_places, depth.shape, lambda window: [window, given[0], 30.0, places], device=given[0].device)
    launch_images(judge_hidden, depth.shape, lambda window: [window, *given, SLACK, hidden], device=given[0].device)
    expected = twin.shift_places(depth, 30.0)
    np.testing.assert_array_equal(np.isnan(places.numpy()), np.isnan(expected))
    np.testing.assert_allclose(places.numpy(), expected, atol=2e-5)
    np.testing.assert_array_equal(hidden.numpy() == 1, twin.judge_hidden(depth, surface, SLACK))
