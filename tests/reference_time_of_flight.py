# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision references of `kernels.sensors.sub_rays` and `kernels.sensors.time_of_flight`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from reference_random import draw_normals

from warpvis import Camera
from warpvis.core.poses import poses_to_matrices
from warpvis.kernels.constants import STREAM_RANGE
from warpvis.sensors import Reason, TimeOfFlight

LIGHT = 299792458.0


def rays_at(camera: Camera, points: NDArray) -> NDArray[np.float64]:
    """Return rays of depth 1 in the camera's frame through image points, (..., 3)."""
    points = np.asarray(points, dtype=np.float64)
    x, y = (points[..., 0] - camera.cx) / camera.fx, (points[..., 1] - camera.cy) / camera.fy
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def pixel_rays(camera: Camera) -> NDArray[np.float64]:
    """Return rays through all pixel centers, (H, W, 3)."""
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    return rays_at(camera, np.stack([x, y], axis=-1))


def find_axes(poses: NDArray) -> NDArray[np.float64]:
    """Return cameras' axes in the world as columns, (V, 3, 3)."""
    return poses_to_matrices(poses)[:, :3, :3]


def in_camera(poses: NDArray, normals: NDArray) -> NDArray[np.float64]:
    """Rotate world normals (V, ..., 3) into the cameras' frames."""
    return np.einsum("vij,v...i->v...j", find_axes(poses), normals.astype(np.float64))


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def find_edges(
    camera: Camera, poses: NDArray, depth: NDArray, normals: NDArray, edge_step: float
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Return pixels with a neighbor off their plane, (V, H, W), and the margin to the opposite result [m]."""
    height, width = depth.shape[1:]
    rays, depth = pixel_rays(camera), depth.astype(np.float64)
    normals = in_camera(poses, normals)
    plane = depth * (normals * rays).sum(axis=-1)
    edges, margin = np.zeros(depth.shape, dtype=bool), np.full(depth.shape, np.inf)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            here = np.s_[:, max(0, -dy) : height - max(0, dy), max(0, -dx) : width - max(0, dx)]
            there = np.s_[:, max(0, dy) : height - max(0, -dy), max(0, dx) : width - max(0, -dx)]
            if not dx and not dy:
                continue
            expected = plane[here] / (normals[here] * rays[there[1:]]).sum(axis=-1)
            off = np.abs(depth[there] - expected)
            both = np.isfinite(depth[here]) & np.isfinite(depth[there])
            one = np.isfinite(depth[here]) != np.isfinite(depth[there])
            edges[here] |= one | (both & ~((off < edge_step) & (expected > 0)))
            margin[here] = np.minimum(margin[here], np.where(both, np.abs(off - edge_step), np.inf))
    return edges, margin


def number_edges(edges: NDArray, numbers: NDArray) -> list[NDArray[np.int32]]:
    """Return the edge pixels of each view by their numbers, which must be 0, 1, ... in any order."""
    pixels = []
    for view_edges, view_numbers in zip(edges, numbers, strict=True):
        is_edge = view_edges >= 0
        order = np.argsort(view_numbers[is_edge])
        np.testing.assert_array_equal(view_numbers[is_edge][order], np.arange(is_edge.sum()))
        np.testing.assert_array_equal(view_numbers[~is_edge], -1)
        pixels.append(view_edges[is_edge][order])
    return pixels


def count_edges(edges: NDArray, side: int) -> NDArray[np.int32]:
    """Return the number of edge pixels of each view in each tile, (V, rows, columns)."""
    height, width = edges.shape[1:]
    padded = np.pad(edges >= 0, ((0, 0), (0, -height % side), (0, -width % side)))
    return padded.reshape(len(edges), -(-height // side), side, -(-width // side), side).sum(axis=(2, 4))


def list_sub_rays(pixels: list[NDArray], first: int, width: int, capacity: int) -> list[NDArray[np.float64]]:
    """Return the sub-rays of pixels of each view from `first` on, (N, 2)."""
    return [place_sub_rays(numbers[first : first + capacity], width).reshape(-1, 2) for numbers in pixels]


def place_sub_rays(pixels: NDArray, width: int) -> NDArray[np.float64]:
    """Return 16 stratified sample positions [px] per pixel index, (..., 16, 2): one per 4 x 4 cell, row and column."""
    place = np.arange(16)
    column, row = place % 4, place // 4
    within = np.stack([column / 4 + (row + 0.5) / 16, row / 4 + (column + 0.5) / 16], axis=-1)
    return np.stack([pixels % width, pixels // width], axis=-1)[..., None, :] + within


def lights(
    rays: NDArray, normals: NDArray, depth: NDArray, reflectivity: NDArray | float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return ranges, rho cos(theta) / r^2, and rho / r^2, which is 0 without depth; normals in the rays' frame."""
    length = np.linalg.norm(rays, axis=-1)
    distance = depth.astype(np.float64) * length
    straight = np.where(np.isfinite(distance), reflectivity / distance**2, 0.0)
    cosine = np.abs((normals * rays).sum(axis=-1)) / length
    return distance, np.where(straight > 0, straight * cosine, 0.0), straight


@dataclass
class Mix:
    """Combined returns of pixels, and the margin of the choice of the ambiguity interval."""

    range: NDArray
    amplitude: NDArray
    light: NDArray
    straight: NDArray
    coherence: NDArray
    margin: NDArray


@np.errstate(invalid="ignore", divide="ignore")
def mix_sub_rays(
    sensor: TimeOfFlight, rays: NDArray, normals: NDArray, depth: NDArray, reflectivity: NDArray | float
) -> Mix:
    """Sum the phasors of sub-rays, along the last axis of `depth`; normals in the rays' frame."""
    distance, light, straight = lights(rays, normals, depth, reflectivity)
    all_light = light.sum(axis=-1)
    frequencies = np.array(sensor.frequencies)
    phases = 4j * np.pi * np.where(light > 0, distance, 0.0)[..., None] / LIGHT * frequencies
    phasors = (light[..., None] * np.exp(phases)).sum(axis=-2)
    strength = np.abs(phasors) / all_light[..., None]
    turns = np.angle(phasors) / (2 * np.pi) % 1.0
    first = frequencies[0]
    laps = np.arange(round(sensor.unambiguous_range * 2 * first / LIGHT))
    ranges = (turns[..., :1] + laps) * LIGHT / (2 * first)
    apart = np.angle(np.exp(2j * np.pi * (turns[..., None, :] - 2 * frequencies * ranges[..., None] / LIGHT)))
    rest = (apart[..., 1:] ** 2).sum(axis=-1)
    best = rest.argmin(axis=-1)[..., None]
    chosen = np.take_along_axis(ranges, best, axis=-1)[..., 0]
    order = np.sort(rest, axis=-1)
    margin = order[..., 1] - order[..., 0] if len(laps) > 1 else np.full(all_light.shape, np.inf)
    # Phases near 0 and near a full turn are equivalent.
    margin = np.minimum(margin, np.minimum(turns[..., 0], 1 - turns[..., 0]))
    count = light.shape[-1]
    coherent = strength[..., 0] / count
    return Mix(
        np.where(all_light > 0, chosen, np.inf),
        np.where(all_light > 0, coherent * all_light, 0.0),
        all_light / count,
        np.where(all_light > 0, coherent * straight.sum(axis=-1), 0.0),
        np.where(all_light > 0, strength.min(axis=-1), 1.0),
        np.where(all_light > 0, margin, np.inf),
    )


def deviation(sensor: TimeOfFlight, amplitude: NDArray, light: NDArray) -> NDArray[np.float64]:
    """Return the range's standard deviation by Lange's formula; light is relative to a white surface at 1 m."""
    if not np.isfinite(sensor.signal):
        return np.zeros(np.shape(amplitude))
    electrons = sensor.signal * light + sensor.background
    one = LIGHT / (4 * np.sqrt(2) * np.pi * sensor.frequencies[0])
    with np.errstate(invalid="ignore", divide="ignore"):
        return one * np.sqrt(electrons) / (sensor.contrast * sensor.signal * amplitude)


@np.errstate(invalid="ignore", divide="ignore")
def measure_time_of_flight(
    sensor: TimeOfFlight, camera: Camera, mix: Mix, draws: NDArray, seed: int = 0
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Return measured depth (V, H, W), reasons, and the margin of the nearest decision."""
    views, frames = np.asarray(draws).T
    length = np.linalg.norm(pixel_rays(camera), axis=-1)
    noise = draw_normals(views, frames, mix.range.shape[1:], seed, STREAM_RANGE)
    phase = 4 * np.pi * sensor.frequencies[0] * mix.range / LIGHT
    measured = mix.range + sensor.offset + sensor.wiggle * np.sin(4 * phase + sensor.wiggle_phase)
    measured = measured + deviation(sensor, mix.amplitude, mix.light) * noise
    laps = measured / sensor.unambiguous_range
    said = measured % sensor.unambiguous_range / length
    margins = [mix.margin, np.abs(laps - np.round(laps))]
    reason = np.full(mix.range.shape, int(Reason.VALID))

    def decide(which: NDArray, what: Reason, margin: NDArray) -> None:
        reason[which] = what
        margins.append(np.where(np.isfinite(margin), np.abs(margin), np.inf))

    decide(said < camera.near, Reason.RANGE, said - camera.near)
    decide(said > camera.far, Reason.RANGE, said - camera.far)
    dark = ~(mix.amplitude >= max(sensor.min_signal, 1e-30))
    decide(dark, Reason.DROPOUT, (mix.amplitude - sensor.min_signal) / mix.light)
    bright = mix.straight >= max(sensor.min_signal, 1e-30)
    decide(dark & bright, Reason.GRAZING, (mix.straight - sensor.min_signal) / mix.light)
    decide(mix.light > sensor.max_signal, Reason.SATURATED, (mix.light - sensor.max_signal) / mix.light)
    decide(mix.coherence < sensor.min_coherence, Reason.EDGE, mix.coherence - sensor.min_coherence)
    reason[np.isinf(mix.range)] = Reason.EMPTY
    in_range = np.where(said < camera.near, -np.inf, np.where(said > camera.far, np.inf, said))
    said = np.where(reason > Reason.RANGE, np.nan, np.where(reason == Reason.EMPTY, np.inf, in_range))
    return said, reason, np.where(reason == Reason.EMPTY, np.inf, np.min(margins, axis=0))
