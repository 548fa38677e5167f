# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Six poses and the contents of files that store them."""

import numpy as np

from warpvis.cameras.frames import Frames
from warpvis.core.poses import poses_to_matrices


def unit(poses):
    """Return poses, rows of 7 numbers, with normalized quaternions."""
    poses = np.array(poses, dtype=np.float64)
    poses[..., 3:] /= np.linalg.norm(poses[..., 3:], axis=-1, keepdims=True)
    return poses


RNG = np.random.default_rng(0)
TURNS = np.linalg.qr(RNG.normal(size=(6, 3, 3)))[0]
TURNS *= np.linalg.det(TURNS)[:, None, None]  # no reflections
PLACES = RNG.uniform(-3, 3, (6, 3))
MATRICES = np.tile(np.eye(4), (6, 1, 1))
MATRICES[:, :3, :3], MATRICES[:, :3, 3] = TURNS, PLACES
"""Camera to world, OpenCV."""
TIMES = np.array([0.5, 1.25, 2.0, 2.125, 3.0, 1305031102.175304])
OPENGL = np.diag([1.0, -1, -1, 1])
"""An OpenGL camera's axes in the OpenCV camera's frame."""
ROS = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
"""A ROS body's axes in the OpenCV camera's frame: forward is z, left is -x, up is -y."""


ROWS = Frames.from_poses(MATRICES).camera_to_world


def assert_same_poses(frames, matrices=MATRICES):
    np.testing.assert_allclose(poses_to_matrices(frames.camera_to_world), matrices, atol=1e-12)


def nerfstudio(matrices=MATRICES):
    frames = [{"file_path": f"{i}.png", "transform_matrix": m.tolist()} for i, m in enumerate(matrices @ OPENGL)]
    return {"fl_x": 500, "camera_model": "OPENCV", "applied_transform": [[0, 1], [2]], "frames": frames}


def bop(matrices=MATRICES, ids=None):
    """Return BOP records: a world point X is at R X + t in the camera's frame, t in millimeters."""
    inverse = np.linalg.inv(matrices)
    return {
        str(image): {
            "cam_K": [500, 0, 320, 0, 500, 240, 0, 0, 1],
            "depth_scale": 0.1,
            "cam_R_w2c": matrix[:3, :3].ravel().tolist(),
            "cam_t_w2c": (1000 * matrix[:3, 3]).tolist(),
        }
        for image, matrix in zip(ids or range(len(matrices)), inverse, strict=True)
    }
