# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes for voxel maps."""

import numpy as np
import trimesh

import warpvis as wv
from warpvis import Label
from warpvis.maps import Voxel

import reference

CAMERA = wv.Camera.from_fov(160, 120, hfov=1.1, near=0.3, far=3.5)
# Avoid round numbers: the scene's faces lie on them, and rounding would decide at voxel borders.
BOUNDS = np.array([[-1.513, -1.187, -0.127], [1.337, 1.213, 1.081]])
POSES = np.stack(
    [
        wv.look_at((-1.4, 0.1, 0.8), (0.3, 0, 0.2)),
        wv.look_at((1.2, -1.1, 0.9), (0, 0, 0.2)),
        wv.look_at((0.2, 1.4, 0.6), (0.1, 0, 0.1)),
    ]
)
BOX_FRONT, BOX_BACK, BOX_TOP = 0.2, 0.5, 0.4


def build(device="cpu"):
    """Return a floor, a box and a ball."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((4, 4, 0.02)), name="floor", label="ground", pose=(0, 0, -0.01, 0, 0, 0, 1))
    middle = (BOX_FRONT + BOX_BACK) / 2
    scene.add(trimesh.creation.box((0.3, 0.6, BOX_TOP)), name="box", pose=(middle, 0, BOX_TOP / 2, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(radius=0.15), name="ball", label="object", pose=(-0.3, 0.4, 0.15, 0, 0, 0, 1))
    return scene


def single(poses):
    """Return poses in single precision, as kernels read them."""
    return wv.core.poses.parse_poses(poses).numpy()


def assert_matches_twin(result, depth, labels, poses, camera=CAMERA):
    grid = (np.array(result.origin), result.cell_size)
    marks = reference.mark_surface_points(camera, single(poses), depth, labels, *grid, result.states.shape)
    states, highest = reference.judge_voxels(camera, single(poses), depth, labels, *grid, marks)
    # A point within rounding error of a voxel's border may fall on either side.
    assert (result.states.numpy() != states).sum() <= 5
    assert (result.labels.numpy() != highest).sum() <= 5
    return states, highest


def at(result, point):
    """Return state and label of the voxel that contains a point."""
    index = tuple(np.floor((np.array(point) - result.origin) / result.cell_size).astype(int))
    return Voxel(result.states.numpy()[index]), Label(result.labels.numpy()[index])


def same(first, second):
    return (first.states.numpy() == second.states.numpy()).all() and (
        first.labels.numpy() == second.labels.numpy()
    ).all()
