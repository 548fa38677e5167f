# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision references of the kernels of `warpvis.kernels.sensors.lidar_noise`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from reference_kinect_noise import Said
from reference_random import draw_normals, random_words, to_normal, to_uniform

from warpvis.cameras import Rays
from warpvis.core.poses import poses_to_matrices
from warpvis.kernels.constants import (
    STREAM_DROPOUT,
    STREAM_FALSE_RANGE,
    STREAM_FALSE_RETURN,
    STREAM_POWER,
    STREAM_RANGE,
    STREAM_RINGS,
)
from warpvis.sensors import LidarNoise, Reason


@dataclass
class Draws:
    """Random numbers of all pixels of views, (V, H, W)."""

    draws: NDArray  # number and frame of each view
    shape: tuple[int, int]
    seed: int

    def uniform(self, stream: int) -> NDArray[np.float64]:
        return to_uniform(random_words(*np.asarray(self.draws).T, self.shape, self.seed, stream))

    def normal(self, stream: int) -> NDArray[np.float64]:
        return draw_normals(*np.asarray(self.draws).T, self.shape, self.seed, stream)


def attenuation(model: LidarNoise) -> float:
    """Return the extinction coefficient [1/m]: of rain by ITU-R P.1814, and of fog by Koschmieder."""
    per_kilometer = 1.076 * model.rain**0.67  # dB
    return math.log(10 ** (per_kilometer / 10)) / 1000 + math.log(1 / 0.02) / model.visibility


def power(model: LidarNoise, distance: NDArray, reflectivity: NDArray, cosine: NDArray) -> NDArray[np.float64]:
    """Return received power relative to the limit of detection."""
    if math.isinf(model.detection_range):
        return np.full(np.shape(distance), np.inf)
    limit = model.detection_reflectivity / model.detection_range**2
    return reflectivity * cosine / distance**2 * np.exp(-2 * attenuation(model) * distance) / limit


def _drops(model: LidarNoise, draws: Draws, near: NDArray, far: NDArray, margins: list) -> NDArray[np.float64]:
    """Return ranges of returns from drops, +inf without one."""
    chance = draws.uniform(STREAM_FALSE_RETURN)
    found = -model.false_range * np.log(draws.uniform(STREAM_FALSE_RANGE))
    margins += [np.abs(chance - model.false_returns), np.abs(found - near), np.abs(found - far)]
    return np.where((chance < model.false_returns) & (found >= near) & (found <= far), found, np.inf)


def _losses(model: LidarNoise, draws: Draws, light: NDArray, straight: NDArray, margins: list) -> NDArray[np.int64]:
    chance = draws.uniform(STREAM_DROPOUT)
    noise = model.power_sigma * draws.normal(STREAM_POWER)
    dark = np.where((straight > 0) & (straight + noise >= 1), Reason.GRAZING, Reason.DROPOUT)
    lost = np.where((light > 0) & (light + noise >= 1), Reason.VALID, dark)
    margins += [np.abs(chance - model.dropout), np.abs(light + noise - 1), np.abs(straight + noise - 1)]
    return np.where(chance < model.dropout, Reason.DROPOUT, lost)


def _ranges(
    model: LidarNoise, rays: Rays, draws: Draws, distance: NDArray, light: NDArray, margins: list
) -> NDArray[np.float64]:
    """Return measured ranges."""
    found = distance
    if rays.rings is not None:
        rings = rays.rings.reshape(rays.height, rays.width)
        words = random_words([0], [0], (1, rings.max() + 1), draws.seed, STREAM_RINGS)[0, 0]
        offsets = model.ring_sigma * to_normal(words) + (0.0 if model.ring_offsets is None else model.ring_offsets)
        found = found + offsets[rings]
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = np.sqrt(model.sigma**2 + (model.sigma_growth * distance) ** 2 + model.weak_sigma**2 / light)
        found = found + sigma * draws.normal(STREAM_RANGE)
        if model.resolution:
            steps = found / model.resolution
            # Errors in single precision are about 1e-6 m: a margin of 1e-4 leaves out ties within 2e-6 m.
            margins.append(50 * model.resolution * np.abs(steps - np.floor(steps) - 0.5))
            found = np.round(steps) * model.resolution
    return found


def receive_power(
    model: LidarNoise,
    rays: Rays,
    poses: NDArray,
    clean: dict[str, NDArray],
    reflectivity: NDArray,
    straight: float = 0.0,
) -> NDArray[np.float64]:
    """Return received power relative to the limit of detection, (V, H, W); with `straight` 1, at normal incidence."""
    along = rays.rays.reshape(rays.height, rays.width, 3)
    length = np.linalg.norm(along, axis=-1)
    rotations = poses_to_matrices(poses)[..., :3, :3]  # of views, or of rays
    rotations = rotations if rotations.ndim == 5 else rotations[:, None, None]
    world = (rotations @ (along / length[..., None])[..., None])[..., 0]
    cosine = np.maximum(np.abs((world * clean["normals"]).sum(axis=-1)), straight)
    shares = np.asarray(reflectivity, dtype=np.float64)[clean["segmentation"]]
    found = power(model, clean["true_depth"].astype(np.float64) * length, shares, cosine)
    return np.where(np.isinf(clean["true_depth"]), 0.0, found)


def _strays(
    model: LidarNoise, rays: Rays, distance: NDArray, light: NDArray, margins: list
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return range and power of the brightest surface of the neighbors of each ray, (V, H, W)."""
    units = rays.directions.reshape(-1, 3)
    units = units / np.linalg.norm(units, axis=1, keepdims=True)
    angles = np.arccos(np.clip(units @ units.T, -1, 1))
    near = (angles <= 3 * model.glare_angle) & ~np.eye(len(units), dtype=bool)
    share = np.where(near, model.glare * np.exp(-0.5 * (angles / model.glare_angle) ** 2), 0.0)
    flat, far_away = light.reshape(len(light), -1), distance.reshape(len(light), -1)
    ranges, powers, gaps = np.empty_like(flat), np.empty_like(flat), np.empty_like(flat)
    for view in range(len(flat)):
        received = share * flat[view]
        best = received.argmax(axis=1)
        ranges[view], powers[view] = far_away[view][best], received.max(axis=1)
        # Another surface that is as bright, at another range.
        others = np.abs(far_away[view] - ranges[view][:, None]) > 1e-4 * ranges[view][:, None]
        gaps[view] = powers[view] - np.where(others, received, 0.0).max(axis=1)
    ranges, powers, gaps = (part.reshape(light.shape) for part in (ranges, powers, gaps))
    matters = (powers > 0.99) & (powers > 0.99 * light)
    margins.append(np.where(matters, np.minimum(gaps, np.abs(powers - light)), np.inf))
    return ranges, powers


def _report(found: NDArray, near: NDArray, far: NDArray, margins: list) -> NDArray[np.float64]:
    margins += [np.abs(found - near), np.abs(found - far)]
    return np.where(found > far, np.inf, np.where((found < near) | ~(found > 0), -np.inf, found))


@np.errstate(invalid="ignore", divide="ignore")
def measure_lidar(
    model: LidarNoise,
    rays: Rays,
    poses: NDArray,
    clean: dict[str, NDArray],
    reflectivity: NDArray,
    draws: NDArray,
    seed: int,
) -> Said:
    """Return the measurement of exact images `true_depth`, `normals` and `segmentation`, (V, H, W)."""
    length = np.linalg.norm(rays.rays.reshape(rays.height, rays.width, 3), axis=-1)
    near, far = rays.near * length, rays.far * length
    distance = clean["true_depth"].astype(np.float64) * length
    numbers, margins = Draws(draws, distance.shape[1:], seed), []
    drops = _drops(model, numbers, near, far, margins)
    is_drop = drops < distance
    margins.append(np.abs(drops - distance))
    own = receive_power(model, rays, poses, clean, reflectivity)
    light = np.where(is_drop, np.inf, own)
    straight = np.where(is_drop, np.inf, receive_power(model, rays, poses, clean, reflectivity, straight=1.0))
    lost = _losses(model, numbers, light, straight, margins)
    distance, no_surface = np.where(is_drop, drops, distance), np.isinf(distance) & ~is_drop
    if model.glare:
        ranges, powers = _strays(model, rays, clean["true_depth"].astype(np.float64) * length, own, margins)
        shown = _losses(model, numbers, powers, powers, margins) == Reason.VALID
        is_stray = (powers > light) & shown
        distance, light = np.where(is_stray, ranges, distance), np.where(is_stray, powers, light)
        lost, no_surface = np.where(is_stray, Reason.VALID, lost), no_surface & ~is_stray
    found = _ranges(model, rays, numbers, distance, light, margins)
    depth = np.where(lost == Reason.VALID, _report(found, near, far, margins) / length, np.nan)
    reasons = np.where(np.isinf(depth), Reason.RANGE, lost)
    margin = np.min([np.where(np.isnan(part), np.inf, part) for part in margins], axis=0)
    return Said(np.where(no_surface, np.inf, depth), np.where(no_surface, Reason.EMPTY, reasons), margin)


@np.errstate(invalid="ignore", divide="ignore")
def measure_returns(
    model: LidarNoise,
    rays: Rays,
    ranges: NDArray,
    intensities: NDArray,
    draws: NDArray,
    seed: int,
    *,
    falls_off: bool,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return measured ranges and intensities of returns (V, R, H, W), and the margin of the nearest decision."""
    views, count, height, width = ranges.shape
    numbers, margins = Draws(draws, (count * height, width), seed), []
    rows = np.tile(rays.rings.reshape(height, width), (count, 1))
    tall = Rays(np.tile(rays.directions.reshape(height, width, 3), (count, 1, 1)), rings=rows)
    distance = ranges.astype(np.float64).reshape(views, count * height, width)
    given = intensities.astype(np.float64).reshape(distance.shape)
    near, far = np.asarray(rays.near), np.asarray(rays.far)
    drops = _drops(model, numbers, near, far, margins)
    drops[:, height:] = np.inf
    is_drop = drops < distance
    margins.append(np.abs(drops - distance))
    limit = model.detection_reflectivity / model.detection_range**2
    weakest = limit * np.ones_like(drops) if falls_off else limit * drops**2
    given = np.where(is_drop, weakest, given)
    shares = given * distance**2 if falls_off else given
    light = np.where(is_drop, np.inf, power(model, distance, shares, np.ones_like(shares)))
    lost = _losses(model, numbers, light, light, margins)
    found = _ranges(model, tall, numbers, np.where(is_drop, drops, distance), light, margins)
    measured = np.where(lost == Reason.VALID, _report(found, near, far, margins), np.inf)
    nothing = np.isinf(distance) & ~is_drop
    margin = np.min([np.where(np.isnan(part), np.inf, part) for part in margins], axis=0)
    return (
        np.where(nothing, distance, measured).reshape(ranges.shape),
        np.where(nothing, given, np.where(np.isfinite(measured), given, 0.0)).reshape(ranges.shape),
        margin.reshape(ranges.shape),
    )
