# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Study when the paper's rule fails with the noise of a Kinect: random scenes, by distance and visible fraction.

``python bench/noise_study.py`` places a ball of 0.2 m and two obstacles at random on the paper's floor, 10,000 times,
and renders the robot's view with an exact camera and with a Kinect of 0, 1, 2 and 4 times its noise. The rule uses the
depth image only: does the ball's sphere contain a pixel that is not ground (lower than 1 cm)? The exact image gives the
truth. Prints tables of how often the answer is wrong, and of floor that appears above the ground.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import trimesh
import warp as wp
from numpy.typing import NDArray

import warpvis as wv
from warpvis.maps import Sphere
from warpvis.scenes import EXPERIMENTS, shapes

LEVELS = (None, 0.0, 1.0, 2.0, 4.0)
"""Noise, as multiples of a Kinect's; None is the exact image."""
DISTANCES = (0.6, 1.2, 2.4, 3.6)
FRACTIONS = (0.0, 0.05, 0.1, 0.25, 0.5, 1.0)
SIZE_MARGIN = 1.1  # factor of the sphere's radius, as in the experiments
BALL, LOW, HIGH = 0.2, (0.2, 0.8, 0.35), (0.2, 0.8, 1.4)
FLOOR = 4.0
CHUNK = 200


def sensor_of(level: float | None) -> wv.sensors.StereoDepth | None:
    """Return a Kinect with scaled noise and depth steps; without noise it still loses pixels."""
    if level is None:
        return None
    kinect = wv.sensors.kinect_v1(320, 240)
    steps = 8 / level if level else 0
    return dataclasses.replace(kinect, sigma=kinect.sigma * level, subpixel=max(1, round(steps)) if level else 0)


def build() -> wv.Scene:
    """Return the floor, with the objects that each world places."""
    scene = wv.Scene()
    scene.add(shapes.floor(FLOOR, FLOOR), name="floor", label="ground")
    scene.add(trimesh.creation.icosphere(3, BALL / 2), name="ball", label="object", movable=True)
    for name, size in (("low", LOW), ("high", HIGH)):
        scene.add(trimesh.creation.box(size), name=name, label="obstacle", movable=True)
    return scene


def worlds(count: int, seed: int) -> NDArray[np.float32]:
    """Return random poses, ``(count, 3, 7)``: the ball before the robot, obstacles in between, apart from the ball."""
    rng = np.random.default_rng(seed)
    rows = np.zeros((count, 3, 7), dtype=np.float32)
    rows[..., 6] = 1
    eye = np.array(EXPERIMENTS[0].poses()[0][:2])
    for world in rows:
        distance, angle = rng.uniform(0.5, 3.6), rng.uniform(-0.4, 0.4)
        ball = eye + distance * np.array([np.cos(angle), np.sin(angle)])
        world[0, :3] = (*ball, BALL / 2)
        for index, size in enumerate((LOW, HIGH), start=1):
            place = ball
            while np.abs(place - ball).max() < 0.65 or np.linalg.norm(place - eye) < 0.8:
                near = eye + rng.uniform(0.2, 1.1) * (ball - eye)
                place = near + rng.uniform(-1.0, 1.0, 2)
            world[index, :3] = (*place, size[2] / 2)
    return rows


@dataclass
class Answers:
    """Results of every scene."""

    distance: NDArray[np.float64]
    """Distance from the camera to the ball [m]."""
    fraction: NDArray[np.float64]
    """Fraction of the isolated ball's pixels that the exact image shows."""
    pixels: NDArray[np.int64]
    """Number of pixels of the depth image within the sphere."""


def ask(scene: wv.Scene, rows: NDArray[np.float32], level: float | None, floor: NDArray[np.float64]) -> Answers:
    """Render all worlds, and count by distance the floor's pixels and those that appear above the ground."""
    camera, pose = EXPERIMENTS[0].camera, EXPERIMENTS[0].poses()[:1].astype(np.float32)
    poses = np.repeat(pose, CHUNK, axis=0)
    outputs = ("depth", "points", "segmentation")
    renderer = wv.Renderer(scene, camera, outputs=outputs, sensor=sensor_of(level), seed=1)
    distance, fraction, pixels = [], [], []
    for first, part in _chunks(rows):
        count = len(part)
        numbers = np.arange(first, first + count)
        drawn = {} if level is None else {"frame": 0, "view_index": numbers}
        views = renderer.render(poses[:count], object_poses=part, **drawn)
        visibility = wv.object_visibility(scene, camera, poses[:count], object_poses=part, objects=("ball",))
        fraction.append(visibility.fraction.numpy()[:, 0])
        distance.append(np.linalg.norm(part[:, 0, :3] - pose[0, :3], axis=-1))
        _count_floor(views, pose[0], floor)
        for view in range(count):
            pixels.append(_pixels_within(views.depth[view : view + 1], camera, pose, part[view, 0, :3]))
    return Answers(np.concatenate(distance), np.concatenate(fraction), np.array(pixels))


def _chunks(rows: NDArray[np.float32]) -> Iterator[tuple[int, NDArray[np.float32]]]:
    for first in range(0, len(rows), CHUNK):
        yield first, rows[first : first + CHUNK]


def _pixels_within(depth: wp.array, camera: wv.Camera, pose: NDArray, ball: NDArray) -> int:
    sphere = wp.empty(depth.shape, dtype=wp.int32, device=depth.device)
    sought = Sphere(tuple(float(number) for number in ball), SIZE_MARGIN * BALL, "object")
    wv.classify(depth, camera, pose, spheres=[sought], spheres_out=sphere)
    return int((sphere.numpy() == 0).sum())


def _count_floor(views: wv.Views, pose: NDArray, floor: NDArray[np.float64]) -> None:
    shown = (views.segmentation.numpy() == 0) & np.isfinite(views.depth.numpy())
    points = views.points.numpy()[shown]
    nearest = np.digitize(np.linalg.norm(points - pose[:3], axis=-1), DISTANCES)
    floor[0] += np.bincount(nearest, minlength=len(DISTANCES) + 1)
    floor[1] += np.bincount(nearest, weights=points[:, 2] >= 0.01, minlength=len(DISTANCES) + 1)


def _ranges(ends: tuple[float, ...], unit: str) -> list[str]:
    return [f"{low:g} to {high:g}{unit}" for low, high in pairwise(ends)]


def table(answers: dict[float | None, Answers], min_pixels: int) -> str:
    """Return how often the answer is wrong, by noise and visible fraction, for far and near balls."""
    lines = ["| Ball visible, distance | scenes | " + " | ".join(_title(level) for level in LEVELS) + " |"]
    lines.append("|---|---:|" + "---:|" * len(LEVELS))
    first = answers[LEVELS[0]]
    for index in range(-1, len(FRACTIONS) - 1):
        for near, far in pairwise(DISTANCES):
            selected = (first.distance >= near) & (first.distance < far)
            if index < 0:
                selected &= first.fraction == 0
                title = "not at all"
            else:
                selected &= (first.fraction > FRACTIONS[index]) & (first.fraction <= FRACTIONS[index + 1])
                title = f"{FRACTIONS[index]:.0%} to {FRACTIONS[index + 1]:.0%}"
            if not selected.any():
                continue
            cells = []
            for level in LEVELS:
                reported = answers[level].pixels[selected] >= min_pixels
                cells.append(f"{(reported != (index >= 0)).mean():.1%}")
            lines.append(f"| {title}, {near:g} to {far:g} m | {selected.sum()} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def floor_table(floors: dict[float | None, NDArray[np.float64]]) -> str:
    """Return the fraction of the floor's pixels that appear 1 cm or more above it, by distance."""
    lines = ["| Floor at | " + " | ".join(_title(level) for level in LEVELS) + " |", "|---|" + "---:|" * len(LEVELS)]
    for index, title in enumerate(_ranges(DISTANCES, " m"), start=1):
        shares = [floors[level][1, index] / max(1.0, floors[level][0, index]) for level in LEVELS]
        lines.append(f"| {title} | " + " | ".join(f"{share:.1%}" for share in shares) + " |")
    return "\n".join(lines)


def _title(level: float | None) -> str:
    return "exact" if level is None else f"{level:g} x noise" if level else "no noise"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--min-pixels", type=int, default=1, help="so many pixels within the sphere make it seen")
    arguments = parser.parse_args()
    scene, rows = build(), worlds(arguments.scenes, arguments.seed)
    floors = {level: np.zeros((2, len(DISTANCES) + 1)) for level in LEVELS}
    answers = {level: ask(scene, rows, level, floors[level]) for level in LEVELS}
    print(table(answers, arguments.min_pixels))
    print()
    print(floor_table(floors))


if __name__ == "__main__":
    main()
