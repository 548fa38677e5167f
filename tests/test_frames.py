# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Frames: poses with times and worlds, validation, slicing, and bit-identical round trips."""

import json
import pickle

import numpy as np
import pytest
import warp as wp
from pose_samples import unit

import warpvis as wv
from warpvis.cameras.frames import Frames
from warpvis.core.poses import poses_to_matrices

POSE = (0.0, 0, 1, 0, 0, 0, 1)


def random_rows(count, seed=0):
    return unit(np.random.default_rng(seed).normal(size=(count, 7)))


def worlds(count, objects=2):
    return unit(np.random.default_rng(1).normal(size=(count, objects, 7)))


def test_rows_are_normalized_and_timestamps_default_to_indices():
    rows = random_rows(50)
    frames = Frames.from_poses(rows)
    assert len(frames) == 50
    assert frames.camera_to_world.dtype == np.float64
    np.testing.assert_array_equal(frames.camera_to_world[:, :3], rows[:, :3])
    directions = rows[:, 3:] / np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
    np.testing.assert_allclose(frames.camera_to_world[:, 3:], directions, atol=1e-15)
    np.testing.assert_array_equal(frames.timestamps, np.arange(50.0))
    assert frames.object_poses is None and frames.world_index is None and frames.source == {}


@pytest.mark.parametrize("convention", ["opencv", "opengl", "ros_body", "ros_optical"])
def test_matrices_and_conventions(convention):
    rows = random_rows(20)
    matrices = poses_to_matrices(rows)
    one = Frames.from_poses(rows, convention=convention).camera_to_world
    two = Frames.from_poses(matrices, convention=convention).camera_to_world
    np.testing.assert_allclose(poses_to_matrices(one), poses_to_matrices(two), atol=1e-12)
    np.testing.assert_allclose(
        poses_to_matrices(one).astype(np.float32),
        poses_to_matrices(wv.core.poses.parse_poses(rows, convention=convention).numpy()),
        atol=1e-6,
    )
    assert len(Frames.from_poses(matrices[0], convention=convention)) == 1


def test_normalization_is_idempotent():
    once = Frames.from_poses(random_rows(10_000), object_poses=worlds(1))
    twice = Frames.from_poses(once.camera_to_world, object_poses=once.object_poses)
    assert once.camera_to_world.tobytes() == twice.camera_to_world.tobytes()
    assert once.object_poses.tobytes() == twice.object_poses.tobytes()


def test_input_arrays_are_copied():
    rows = random_rows(3)
    rows[:, 3:] /= np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
    before = rows.copy()
    frames = Frames.from_poses(rows)
    frames.camera_to_world[:] = 0
    np.testing.assert_array_equal(rows, before)


def test_slices_include_worlds():
    own = Frames.from_poses(random_rows(5), object_poses=worlds(5), timestamps=np.arange(5) * 0.1)
    part = own[1:4]
    np.testing.assert_array_equal(part.camera_to_world, own.camera_to_world[1:4])
    np.testing.assert_array_equal(part.object_poses, own.object_poses[1:4])
    np.testing.assert_array_equal(part.timestamps, [0.1, 0.2, 0.30000000000000004])
    assert part[1:2].object_poses.shape == (1, 2, 7)

    one = Frames.from_poses(random_rows(5), object_poses=worlds(1)[0])
    assert one.object_poses.shape == (1, 2, 7)
    assert one[3:].object_poses.shape == (1, 2, 7)

    named = Frames.from_poses(random_rows(5), object_poses=worlds(3), world_index=[0, 2, 2, 1, 0], source={"seed": 1})
    assert named[2:4].world_index.tolist() == [2, 1] and named.world_index.dtype == np.int32
    np.testing.assert_array_equal(named[2:4].object_poses, named.object_poses)
    assert named[2:4].source == {"seed": 1}
    assert len(named[9:]) == 0


def test_object_poses_are_stored_in_single_precision():
    given = worlds(2)
    frames = Frames.from_poses(random_rows(2), object_poses=given)
    np.testing.assert_array_equal(frames.object_poses, given.astype(np.float32))
    device = wp.array(given.astype(np.float32))
    np.testing.assert_array_equal(Frames.from_poses(random_rows(2), object_poses=device).object_poses, device.numpy())


def test_frames_can_be_pickled_and_source_is_json():
    source = {"generator": "orbit", "target": (0, 0, 1), "seed": 3}
    frames = Frames.from_poses([POSE], source=source)
    assert frames.source == {"generator": "orbit", "target": [0, 0, 1], "seed": 3}
    assert json.loads(json.dumps(frames.source)) == frames.source
    again = pickle.loads(pickle.dumps(frames))
    np.testing.assert_array_equal(again.camera_to_world, frames.camera_to_world)
    assert again.source == frames.source


BAD = {
    "no poses": ((np.zeros((0, 7)),), {}, "there must be at least one pose, got an array of shape (0, 7)"),
    "empty rows": ((np.zeros((3, 0)),), {}, "there must be at least one pose, got an array of shape (3, 0)"),
    "shape": ((np.zeros((3, 6)),), {}, "poses must have shape (V, 7), rows x y z qx qy qz qw, or (V, 4, 4)"),
    "number": ((3.0,), {}, "poses must have shape (V, 7)"),
    "booleans": ((np.ones((1, 7), dtype=bool),), {}, "poses must be numbers, got booleans"),
    "text": (([["a"] * 7],), {}, "poses must be an array of numbers, got dtype <U1"),
    "NaN": (([POSE, (np.nan, *POSE[1:])],), {}, "poses must be finite numbers of at most 1e18: 1 of 2 are not, the fi"),
    "huge": (([(1e19, *POSE[1:])],), {}, "poses must be finite numbers of at most 1e18: 1 of 1 are not"),
    "huge turn": (([(0, 0, 0, 1e300, 0, 0, 0)],), {}, "poses must be finite numbers of at most 1e18"),
    "no turn": (
        ([POSE, np.zeros(7)],),
        {},
        "poses must have quaternions of length 1, got 0: wrong in 1 of 2, at index 1",
    ),
    "scale": ((np.eye(4)[None] * [2, 2, 2, 1],), {}, "poses must be rotations without scale"),
    "convention": (
        ([POSE],),
        {"convention": "blender"},
        "convention must be one of 'opencv', 'opengl', 'ros_body', 'ros_optical', got 'bl",
    ),
    "no convention": (([POSE],), {"convention": None}, "convention must be one of"),
    "times": (
        ([POSE],),
        {"timestamps": [0, 1]},
        "timestamps must be 1 numbers of seconds, one per frame, got int64 of shape (2,)",
    ),
    "NaN time": (([POSE],), {"timestamps": [np.nan]}, "timestamps must be finite: 1 are not, the first at index 0"),
    "worlds": (
        ([POSE] * 3,),
        {"object_poses": worlds(2)},
        "object_poses must be of 1 world or of 3 worlds, one per frame, got 2",
    ),
    "objects": (([POSE],), {"object_poses": [POSE[:6]]}, "object_poses must have shape (W, M, 7), rows x y z qx qy qz"),
    "no objects": (([POSE],), {"object_poses": np.zeros((1, 0, 7))}, "object_poses must have shape (W, M, 7)"),
    "object NaN": (([POSE],), {"object_poses": [[np.nan] * 7]}, "object_poses must be finite numbers of at most 1e18"),
    "object turn": (
        ([POSE],),
        {"object_poses": [POSE, np.zeros(7)]},
        "object_poses must have quaternions of length 1, got 0: wrong in 1, of object 1 in world 0",
    ),
    "world alone": (
        ([POSE],),
        {"world_index": [0]},
        "object_poses must be given with world_index, which contains indices",
    ),
    "no such world": (
        ([POSE] * 2,),
        {"world_index": [0, 3], "object_poses": worlds(3)},
        "world_index must be from 0 to 2, the worlds of object_poses, got 3 for frame 1",
    ),
    "half a world": (
        ([POSE],),
        {"world_index": [0.5], "object_poses": worlds(3)},
        "world_index must be 1 whole numbers, one per fr",
    ),
    "source": (
        ([POSE],),
        {"source": {"a": object()}},
        "source must be a mapping of JSON values, got {'a': <obj",
    ),
    "source NaN": (([POSE],), {"source": {"a": np.nan}}, "source must be a mapping of JSON values"),
    "source list": (([POSE],), {"source": [1]}, "source must be a mapping of JSON values, got [1]"),
}


@pytest.mark.parametrize("case", BAD)
def test_invalid_arguments_raise(case):
    arguments, options, said = BAD[case]
    with pytest.raises(wv.WarpvisError) as error:
        Frames.from_poses(*arguments, **options)
    assert str(error.value).startswith(said)
    assert "\n" not in str(error.value)


def test_frames_are_indexed_by_slices_only():
    with pytest.raises(wv.WarpvisError, match=r"frames must be indexed by a slice, frames\[a:b\], got 0"):
        Frames.from_poses([POSE])[0]


HAND_MADE = {
    "timestamps": ({"timestamps": np.zeros(2)}, r"timestamps of frames must have shape (4,), got (2,)"),
    "no timestamps": (
        {"timestamps": None},
        r"timestamps of frames must be a NumPy array of numbers, shape (4,), got No",
    ),
    "matrices": (
        {"camera_to_world": np.zeros((4, 4, 4))},
        "camera_to_world of frames must have shape (n, 7), got (4, 4",
    ),
    "a list": (
        {"camera_to_world": [POSE] * 4},
        "camera_to_world of frames must be a NumPy array of numbers, shape (n, 7)",
    ),
    "words": ({"timestamps": np.array(["a"] * 4)}, "timestamps of frames must be a NumPy array of numbers"),
    "worlds": ({"object_poses": worlds(3)}, "object_poses must be of 1 world or of 4 worlds, one per frame, got 3"),
    "objects": ({"object_poses": np.zeros((4, 7))}, "object_poses of frames must have shape (n, n, 7), got (4, 7)"),
    "no objects": ({"world_index": np.zeros(4, np.int32)}, "object_poses must be given with world_index"),
    "index": (
        {"object_poses": worlds(3), "world_index": np.zeros(2, np.int32)},
        "world_index of frames must have shape (4,), got (2,)",
    ),
    "beyond": (
        {"object_poses": worlds(3), "world_index": np.full(4, 3)},
        "world_index must be from 0 to 2, the worlds of object_poses, got 3 for frame 0",
    ),
    "source": ({"source": 3}, "source must be a mapping of JSON values, got 3"),
}


@pytest.mark.parametrize("case", HAND_MADE)
def test_inconsistent_frames_raise(case):
    changes, said = HAND_MADE[case]
    whole = Frames.from_poses([POSE] * 4)
    arrays = {"camera_to_world": whole.camera_to_world, "timestamps": whole.timestamps, **changes}
    with pytest.raises(wv.WarpvisError) as error:
        Frames(**arrays)
    assert str(error.value).startswith(said)


def test_consistent_frames_can_be_sliced_anywhere():
    for more in ({}, {"object_poses": worlds(1)}, {"object_poses": worlds(4)}):
        frames = Frames.from_poses([POSE] * 4, **more)
        assert [len(frames[k:]) for k in range(6)] == [4, 3, 2, 1, 0, 0]
    frames = Frames.from_poses([POSE] * 4, object_poses=worlds(2), world_index=[0, 1, 1, 0])
    assert frames[1:3].world_index.tolist() == [1, 1]
