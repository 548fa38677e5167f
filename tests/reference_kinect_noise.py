# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision references of Kinect noise models, written from the papers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from reference_random import draw_normals
from reference_stereo import points_in_view

from warpvis import Camera
from warpvis.core.poses import poses_to_matrices
from warpvis.kernels.constants import STREAM_ACROSS, STREAM_DEPTH, STREAM_DISPARITY, STREAM_DOWN
from warpvis.sensors import KhoshelhamNoise, NguyenNoise, Reason


@dataclass
class Said:
    """Measured depth and reasons, (V, H, W), and the margin of the nearest decision."""

    depth: NDArray[np.float64]
    reasons: NDArray[np.int64]
    margin: NDArray[np.float64]


def say(camera: Camera, depth: NDArray, lost: NDArray, margin: NDArray) -> Said:
    """Return measured depth clipped to the camera's range; `lost` contains the reasons of other losses."""
    said = np.where(depth > camera.far, np.inf, np.where((depth < camera.near) | ~(depth > 0), -np.inf, depth))
    reasons = np.where(lost != Reason.VALID, lost, np.where(np.isfinite(said), Reason.VALID, Reason.RANGE))
    said = np.where(lost > Reason.RANGE, np.nan, np.where(lost == Reason.EMPTY, np.inf, said))
    ends = np.abs(depth - camera.near), np.abs(depth - camera.far)
    margin = np.where(lost == Reason.VALID, np.minimum(margin, np.fmin(*ends)), margin)
    return Said(said, reasons, np.where(np.isnan(margin), np.inf, margin))


def nguyen_axial(model: NguyenNoise, depth: NDArray | float, angle: NDArray | float) -> NDArray[np.float64]:
    """Return the axial standard deviation, equations (3) and (4)."""
    angle = np.asarray(angle, dtype=np.float64)
    sigma = model.min_axial + model.axial_growth * (depth - model.best_depth) ** 2
    steep = model.grazing_axial / np.sqrt(depth) * angle**2 / (np.pi / 2 - angle) ** 2
    return sigma + np.where(angle >= model.grazing_angle, steep, 0.0)


def nguyen_lateral(model: NguyenNoise, angle: NDArray | float) -> NDArray[np.float64]:
    """Return the lateral standard deviation in pixels, equation (2)."""
    return np.asarray(model.lateral + model.lateral_growth * angle / (np.pi / 2 - angle))


@np.errstate(invalid="ignore")
def measure_nguyen(
    model: NguyenNoise, camera: Camera, poses: NDArray, clean: dict[str, NDArray], draws: NDArray, seed: int
) -> Said:
    """Return the measurement of exact images `true_depth` and `normals`."""
    true_depth, normals = clean["true_depth"].astype(np.float64), clean["normals"].astype(np.float64)
    views, frames = np.asarray(draws).T
    shape = true_depth.shape[1:]
    axes = poses_to_matrices(poses)[:, :3, :3]
    in_camera = np.einsum("vji,vyxj->vyxi", axes, normals)
    there = np.isfinite(true_depth)
    angle = np.arccos(np.clip(np.abs(np.where(there, in_camera[..., 2], 1.0)), 0, 1))
    lateral = nguyen_lateral(model, np.minimum(angle, model.max_angle))
    view, y, x = np.ogrid[: len(poses), : shape[0], : shape[1]]
    down = y + 0.5 + lateral * draw_normals(views, frames, shape, seed, STREAM_DOWN)
    across = x + 0.5 + lateral * draw_normals(views, frames, shape, seed, STREAM_ACROSS)
    margin = np.minimum(np.abs(down - np.round(down)), np.abs(across - np.round(across)))
    row = np.clip(np.floor(down), 0, shape[0] - 1).astype(int)
    column = np.clip(np.floor(across), 0, shape[1] - 1).astype(int)
    shown, normal = true_depth[view, row, column], in_camera[view, row, column]
    angle, there = angle[view, row, column], there[view, row, column]
    point = points_in_view(camera, true_depth)[view, row, column]
    rays = points_in_view(camera, np.ones((1, *shape)))
    with np.errstate(divide="ignore"):
        carried = (normal * point).sum(axis=-1) / (normal * rays).sum(axis=-1)
    carried = np.where(carried > 0, carried, shown)
    noise = draw_normals(views, frames, shape, seed, STREAM_DEPTH)
    measured = carried + nguyen_axial(model, np.where(there, carried, 1.0), np.minimum(angle, model.max_angle)) * noise
    lost = np.where(there, np.where(angle > model.max_angle, Reason.GRAZING, Reason.VALID), Reason.EMPTY)
    margin = np.minimum(margin, np.where(there, np.abs(angle - model.max_angle), np.inf))
    margin = np.minimum(margin, np.where(there, np.abs(angle - model.grazing_angle), np.inf))
    return say(camera, measured, lost, margin)


@np.errstate(divide="ignore", invalid="ignore")
def measure_khoshelham(model: KhoshelhamNoise, camera: Camera, true_depth: NDArray, draws: NDArray, seed: int) -> Said:
    """Return the measurement of exact depth."""
    views, frames = np.asarray(draws).T
    disparity = 1 / (model.step * true_depth.astype(np.float64))
    noise = draw_normals(views, frames, true_depth.shape[1:], seed, STREAM_DISPARITY)
    found, margin = disparity + model.sigma * noise, np.full(true_depth.shape, np.inf)
    if model.rounds:
        margin = np.abs(found % 1 - 0.5)
        found = np.floor(found + 0.5)
    depth = np.where(found > 0, 1 / (model.step * found), np.inf)
    lost = np.where(np.isfinite(true_depth), Reason.VALID, Reason.EMPTY)
    return say(camera, depth, lost, margin)
