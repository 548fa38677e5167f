# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Calibrate a depth camera by images of a board with raised blocks, with gradients in PyTorch.

Optimizes intrinsics, two coefficients of the lens and the poses of the board at once. Prints the results without noise
and with noise of 1 mm.
"""

import sys
import warnings

import numpy as np
import trimesh
import warp as wp

import warpvis as wv
from warpvis.cameras import LensCamera, lenses, parameter_names, parameter_values
from warpvis.errors import IntrinsicsWarning

VIEWS = 10
TRUE = LensCamera(lenses.OpenCVPinhole(56.0, 54.0, 41.0, 29.5, (-0.12, 0.03, 0, 0)), 80, 60, near=0.2, far=3.0)
AT_ORIGIN = np.tile([0, 0, 0, 0, 0, 0, 1.0], (VIEWS, 1))
WRONG = (1.05, 0.95, 1.05, 0.95, 1.05, 0.95)  # factors of fx fy cx cy k1 k2; p1 and p2 are 0
# Pixels with larger residuals [m] are left out, since they see another surface, and the number of steps.
ROUNDS = ((0.05, 30), (0.01, 100))


def make_board():
    """Return a plate with frustums of several heights, whose slopes and steps determine the intrinsics."""
    rng = np.random.default_rng(0)
    parts = [trimesh.creation.box((0.6, 0.45, 0.01))]
    for x in np.linspace(-0.22, 0.22, 4):
        for y in np.linspace(-0.15, 0.15, 3):
            block = trimesh.creation.box((2, 2, 2))
            at_top = block.vertices[:, 2:] > 0
            widths, height = np.where(at_top, 0.02, 0.06), rng.uniform(0.03, 0.09)
            block.vertices = np.hstack([block.vertices[:, :2] * widths + (x, y), height * at_top])
            parts.append(block)
    return trimesh.util.concatenate(parts)


def make_poses(rng):
    """Return poses of the board that face a camera at the origin, and rough guesses of them."""
    places = rng.uniform((-0.05, -0.04, 0.4), (0.05, 0.04, 0.5), (VIEWS, 3))
    rows = np.hstack([places, np.array([1.0, 0, 0, 0]) + rng.uniform(-0.25, 0.25, (VIEWS, 4))])
    guesses = rows + rng.normal(scale=0.007, size=rows.shape)
    for poses in (rows, guesses):
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    return rows, guesses


def fit(scene, measured, guesses, start):
    """Return the parameters of the camera at which rendered depth agrees with measured depth."""
    try:
        import torch
    except ImportError:
        sys.exit("this example needs PyTorch: pip install torch")
    import warpvis.torch as wt

    depth, guesses = torch.tensor(measured), torch.tensor(guesses, dtype=torch.float32)[:, None]
    camera, start = torch.tensor(AT_ORIGIN, dtype=torch.float32), torch.tensor(start)
    # Pixels near a jump of depth may see another surface after a small change.
    filled = torch.where(depth.isfinite(), depth, 9.0)[:, None]
    largest, smallest = (sign * torch.nn.functional.max_pool2d(sign * filled, 3, 1, 1)[:, 0] for sign in (1, -1))
    is_smooth = largest - smallest < 0.04
    # Units in which all unknowns change depth by similar amounts; the last two coefficients stay 0.
    units = torch.tensor([TRUE.width] * 4 + [4.0, 8.0, 0.0, 0.0], dtype=torch.float64)
    change = torch.zeros(8, dtype=torch.float64, requires_grad=True)
    twists = torch.zeros(VIEWS, 1, 6, requires_grad=True)

    def residuals():
        boards = wt.apply_twists(guesses, twists)
        rendered = wt.render(scene, TRUE, camera, object_poses=boards, intrinsics=start + units * change).depth
        is_used = is_smooth & rendered.isfinite()
        return torch.where(is_used, rendered, 0.0) - torch.where(is_used, depth, 0.0), is_used

    for limit, steps in ROUNDS:
        error, is_used = residuals()
        is_near = is_used & (error.abs() < limit)
        options = {"max_iter": steps, "history_size": 50, "line_search_fn": "strong_wolfe"}
        optimizer = torch.optim.LBFGS([change, twists], **options, tolerance_change=1e-12)

        def loss(is_near=is_near, optimizer=optimizer):
            optimizer.zero_grad()
            error = 1000 * residuals()[0][is_near].double()  # in mm
            value = error.square().mean()
            value.backward()
            return value

        optimizer.step(loss)
    return (start + units * change).detach().numpy()


def main():
    """Calibrate with and without noise."""
    wp.config.log_level = wp.LOG_WARNING
    warnings.simplefilter("ignore", IntrinsicsWarning)  # line searches try extreme lenses, too
    scene = wv.Scene()
    scene.add(make_board(), name="board", movable=True)
    rows, guesses = make_poses(np.random.default_rng(1))
    depth = wv.render(scene, TRUE, AT_ORIGIN, object_poses=rows[:, None], outputs="depth").depth.numpy()
    noise = np.random.default_rng(2).normal(scale=0.001, size=depth.shape).astype(np.float32)
    truth = parameter_values(TRUE)
    start = truth * (*WRONG, 1, 1)
    columns = truth, start, fit(scene, depth, guesses, start), fit(scene, depth + noise, guesses, start)
    print(f"{'':4} {'true':>9} {'start':>9} {'found':>9} {'error':>9} {'noise':>9} {'error':>9}")
    for name, true, first, found, noisy in zip(
        parameter_names(TRUE)[:6], *(column[:6] for column in columns), strict=True
    ):
        errors = abs(found / true - 1), abs(noisy / true - 1)
        print(f"{name:4} {true:9.4f} {first:9.4f} {found:9.4f} {errors[0]:9.1e} {noisy:9.4f} {errors[1]:9.1e}")


if __name__ == "__main__":
    main()
