# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compare the holes of a simulated RealSense D435 with those of recorded depth images.

``python bench/hole_statistics.py recordings/*.png --focal 613`` prints, for 16-bit depth images in millimeters and for
the model in ten views of a table in a room: the fraction of lost pixels, the number of connected holes per image, the
fraction of lost pixels in small holes, and the fraction of pixels of the largest plane that are lost, by angle of
incidence. The model is shown with its windows, with one decision per pixel by the angle, and as `MatchedStereo`.
Recordings are not part of this repository; docs/sensors/depth_cameras.md names those that it cites.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy import ndimage

import warpvis as wv
from warpvis.io import read_depth

SMALL_HOLE = 10
"""Area below which a hole is small [px]."""
ANGLES = (20, 40, 60, 80)
WINDOWS = wv.sensors.realsense_d435(640, 480)
PER_PIXEL = dataclasses.replace(
    WINDOWS,
    fattening=0,
    hole_spacing=1,
    min_signal=math.cos(math.radians(85.0)),
    full_signal=math.cos(math.radians(60.0)),
)
MATCHED = wv.sensors.MatchedStereo(WINDOWS.baseline, native_camera=WINDOWS.camera())


def make_room() -> wv.Scene:
    """Return a room with a table and three things on it."""
    scene = wv.Scene()
    for size, center in (
        ((9, 9, 0.1), (1, 0, -0.05)),
        ((0.1, 9, 6), (4, 0, 2)),
        ((9, 0.1, 6), (1, -3, 2)),
        ((9, 0.1, 6), (1, 3, 2)),
        ((1.0, 1.6, 0.1), (2.2, 0, 0.75)),
        ((0.2, 0.25, 0.3), (2.2, 0.45, 0.95)),
        ((0.25, 0.3, 0.12), (2.3, -0.5, 0.86)),
    ):
        scene.add(trimesh.creation.box(size), pose=(*center, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(radius=0.1), pose=(2.0, -0.05, 0.9, 0, 0, 0, 1))
    return scene


def simulate(sensor: wv.rendering.DepthSensor) -> NDArray[np.float32]:
    """Return measured depth of ten views of the table, NaN where lost."""
    random = np.random.default_rng(0)
    eyes, targets = random.uniform((0.6, -0.9, 1.1), (1.5, 0.9, 1.7), (10, 3)), random.uniform(-0.3, 0.3, 10)
    poses = np.stack([wv.look_at(tuple(eye), (2.2, y, 0.8)) for eye, y in zip(eyes, targets, strict=True)])
    return wv.render(make_room(), sensor.camera(), poses, outputs="depth", sensor=sensor, seed=1, frame=0).depth.numpy()


def count_lost(depth: NDArray[np.float32], camera: wv.Camera) -> NDArray[np.int64]:
    """Return the number of pixels of the largest plane and of those that are lost, by angle between `ANGLES`, (A, 2).

    1 / z is linear in pixel coordinates. The plane is found from random triples of pixels. Pixels near other surfaces
    are left out, as are holes that are wider than the closing of the plane.
    """
    found = np.isfinite(depth) & (depth > 0)
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)
    nearness = np.divide(1.0, depth, where=found, out=np.zeros(depth.shape))
    sample, target = rays[found][::37], nearness[found][::37]
    random, plane, best = np.random.default_rng(0), np.zeros(3), 0
    for _ in range(300):
        triple = random.integers(0, len(sample), 3)
        guess = np.linalg.lstsq(sample[triple], target[triple], rcond=None)[0]
        near = np.abs(sample @ guess - target) < 0.015
        if near.sum() > best:
            plane, best = np.linalg.lstsq(sample[near], target[near], rcond=None)[0], near.sum()
    on_plane = found & (np.abs(rays @ plane - nearness) < 0.03)
    region = ndimage.binary_closing(on_plane, iterations=6)
    region &= ~ndimage.binary_dilation(found & ~on_plane, iterations=12)
    region &= ndimage.binary_erosion(np.ones_like(region), iterations=8)
    cosines = np.abs(rays @ plane) / np.linalg.norm(plane) / np.linalg.norm(rays, axis=-1)
    angles = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    inside = [region & (angles >= low) & (angles < high) for low, high in pairwise(ANGLES)]
    return np.array([[mask.sum(), (mask & ~found).sum()] for mask in inside])


def report(name: str, images: NDArray[np.float32], camera: wv.Camera) -> None:
    """Print the statistics of depth images."""
    lost, areas = ~(np.isfinite(images) & (images > 0)), []
    for image in lost:
        areas.append(np.bincount(ndimage.label(image)[0].ravel())[1:])
    sizes = np.concatenate(areas)
    counts = sum(count_lost(image, camera) for image in images)
    print(
        f"{name}: {lost.mean():.1%} lost, {len(sizes) / len(images):.0f} holes per image, "
        f"{sizes[sizes < SMALL_HOLE].sum() / max(sizes.sum(), 1):.1%} of lost pixels in holes below {SMALL_HOLE} px"
    )
    for (low, high), (total, holes) in zip(pairwise(ANGLES), counts, strict=True):
        print(f"  plane at {low} to {high} degrees: {holes / max(total, 1):.2%} of {total} px lost")


def main() -> None:
    """Print the statistics of recordings and of the model."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", nargs="*", type=Path)
    parser.add_argument("--focal", type=float, default=613.0, help="focal length of the recordings [px]")
    arguments = parser.parse_args()
    if arguments.recordings:
        images = np.stack([read_depth(path, unit=0.001) for path in arguments.recordings])
        height, width = images.shape[1:]
        report("recorded", images, wv.Camera(width, height, *2 * [arguments.focal], width / 2, height / 2))
    for name, sensor in (("D435", WINDOWS), ("per pixel", PER_PIXEL), ("matched", MATCHED)):
        report(name, simulate(sensor), sensor.camera())


if __name__ == "__main__":
    main()
