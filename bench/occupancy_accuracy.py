# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure the accuracy of occupancy maps from noisy depth and poses, in a room in which two people walk.

``python bench/occupancy_accuracy.py`` renders a robot's trajectory through a furnished room with the noise of a depth
camera, adds the images to a map with noisy poses, and prints the precision and recall of each state of a voxel.

The truth comes from exact poses and exact depth with 16 times the pixels, in double precision. A voxel is SURFACE if it
contains a visible point of something other than a person, else FREE if its center is in front of the visible surface in
an image, else HIDDEN if it is in an image. The trail is the volume of voxels where people walked that are SURFACE, but
not in a map of the same images without people; the last images show no people.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain

import numpy as np
import trimesh
import warp as wp
from numpy.typing import NDArray

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.maps import Voxel
from warpvis.scenes import shapes

MODELS = {"D435": wv.sensors.realsense_d435(640, 480), "Kinect": wv.sensors.kinect_v1(320, 240)}
REACH = 3.5
"""Depth to which images are used [m]."""
FINER = 4
"""Pixels of the exact image along an edge of a pixel."""
BOUNDS = np.array([(-3.1, -2.8, -0.2), (3.1, 2.8, 2.2)])
ROOM = trimesh.transformations.compose_matrix(angles=(0, 0, 0.3), translate=(0.013, 0.011, 0.007))
"""Pose of the room, whose walls are neither along voxels nor on their faces."""
PEOPLE = {"first": ((-2.0, -1.5), (2.0, 1.4)), "second": ((1.6, -1.7), (-1.9, 1.2))}
"""First and last place of each person [m]; they walk in the middle of the sequence, and are outside before and after.
"""
OUTSIDE = 50.0


def build() -> wv.Scene:
    """Return a room of 5 m x 4 m with furniture, and two people."""
    scene = wv.Scene()
    parts = {"floor": shapes.floor(5, 4), "ball": shapes.ball(0.2, -1.7, -1.2)}
    for name, size, x, y in (
        *(("east", (0.1, 4, 2.4), 2.55, 0), ("west", (0.1, 4, 2.4), -2.55, 0)),
        *(("north", (5, 0.1, 2.4), 0, 2.05), ("south", (5, 0.1, 2.4), 0, -2.05)),
        *(("cupboard", (0.5, 1.0, 1.8), 2.2, -1.3), ("box", (0.3, 0.4, 0.5), -1.2, 1.2)),
        *(("table leg", (0.05, 0.05, 0.7), 0.6, 1.0), ("stool", (0.35, 0.35, 0.45), 0.3, -0.9)),
    ):
        parts[name] = shapes.standing_box(size, x, y)
    parts["table top"] = shapes.standing_box((1.2, 0.7, 0.04), 1.0, 1.2).apply_translation((0, 0, 0.7))
    for name, mesh in parts.items():
        scene.add(mesh.apply_transform(ROOM), name=name)
    for name in PEOPLE:
        scene.add(shapes.person(1.7, 0, 0), name=name, label="human", movable=True)
    return scene


def trajectory(frames: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return poses of a camera that drives on a circle, turning twice to all walls, and of the people."""
    share = np.arange(frames) / frames
    angle = 2 * math.pi * share
    eye = np.stack([0.8 * np.cos(angle), 0.6 * np.sin(angle), 1.2 + 0.2 * np.sin(5 * angle)], axis=-1)
    ahead = np.stack([np.cos(2 * angle), np.sin(2 * angle), -0.35 + 0.15 * np.cos(7 * angle)], axis=-1)
    lines = np.stack([eye, eye + ahead], axis=1) @ ROOM[:3, :3].T + ROOM[:3, 3]
    poses = np.stack([wv.look_at(*line) for line in lines])
    people = np.zeros((frames, len(PEOPLE), 7))
    people[..., 6] = 1.0
    walked = np.clip((share - 0.1) / 0.4, 0, 1)[:, None]
    for index, (first, last) in enumerate(PEOPLE.values()):
        places = (1 - walked) * np.array((*first, 0.0)) + walked * np.array((*last, 0.0))
        people[:, index, :3] = places @ ROOM[:3, :3].T + ROOM[:3, 3]
    people[(share < 0.1) | (share > 0.5), :, 0] = OUTSIDE
    return poses.astype(np.float32), people.astype(np.float32)


def disturb(poses: NDArray[np.float32], meters: float, degrees: float, seed: int) -> NDArray[np.float64]:
    """Return poses as matrices ``(V, 4, 4)`` with independent errors of position and rotation along each axis."""
    rng = np.random.default_rng(seed)
    matrices = poses_to_matrices(poses.astype(np.float64))
    vectors = np.radians(degrees) * rng.normal(size=(len(poses), 3))
    half = 0.5 * vectors  # small angles: the vector part of quaternions
    quaternions = np.concatenate([half, np.sqrt(1 - (half**2).sum(axis=1, keepdims=True))], axis=1)
    errors = poses_to_matrices(np.concatenate([np.zeros((len(poses), 3)), quaternions], axis=1))
    matrices[:, :3, :3] = matrices[:, :3, :3] @ errors[:, :3, :3]
    matrices[:, :3, 3] += meters * rng.normal(size=(len(poses), 3))
    return matrices


@dataclass
class Truth:
    """Exact states of the voxels of `BOUNDS`."""

    cell: float
    states: NDArray[np.uint8]
    walked: NDArray[np.bool_]
    """Voxels whose centers were in a person's bounding cylinder."""


def find_truth(scene: wv.Scene, camera: wv.Camera, cell: float, frames: int) -> Truth:
    """Return the truth by exact depth."""
    poses, people = trajectory(frames)
    fine = wv.Camera(
        *(FINER * side for side in (camera.width, camera.height)),
        *(FINER * number for number in (camera.fx, camera.fy, camera.cx, camera.cy)),
        camera.near,
        camera.far,
    )
    size = np.rint((BOUNDS[1] - BOUNDS[0]) / cell).astype(int)
    axes = [BOUNDS[0][k] + (np.arange(size[k]) + 0.5) * cell for k in range(3)]
    centers = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    states, surface = np.zeros(len(centers), np.uint8), np.zeros(size, bool)
    walked = np.zeros(len(centers), bool)
    is_person = np.array([item.name in PEOPLE for item in scene.objects])
    for pose, matrix, places in zip(poses, poses_to_matrices(poses.astype(np.float64)), people, strict=True):
        outputs = ("depth", "points", "segmentation")
        views = wv.render(scene, fine, pose[None], object_poses=places[None], outputs=outputs)
        depth, points, objects = (getattr(views, name).numpy()[0] for name in outputs)
        seen = (depth <= REACH) & (objects >= 0) & ~is_person[np.maximum(objects, 0)]
        voxels = np.floor((points[seen].astype(np.float64) - BOUNDS[0]) / cell).astype(int)
        voxels = voxels[((voxels >= 0) & (voxels < size)).all(axis=1)]
        surface[tuple(voxels.T)] = True
        unsettled = np.flatnonzero(states < Voxel.FREE)
        places_in_camera = (centers[unsettled] - matrix[:3, 3]) @ matrix[:3, :3]
        z = places_in_camera[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = fine.project(places_in_camera)
        inside = (z > 0) & (z <= REACH) & (pixels >= 0).all(axis=1)
        inside &= (pixels[:, 0] < fine.width) & (pixels[:, 1] < fine.height)
        column, row = pixels[inside].astype(int).T
        states[unsettled[inside]] = np.where(z[inside] < depth[row, column], Voxel.FREE, Voxel.HIDDEN)
        for place in places[places[:, 0] < OUTSIDE, :2]:
            walked |= ((centers[:, :2] - place) ** 2).sum(axis=1) < 0.3**2
    states = states.reshape(size)
    states[surface] = Voxel.SURFACE
    return Truth(cell, states, walked.reshape(size))


def grow(voxels: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return voxels and their 26 neighbors."""
    for axis in range(3):
        padded = np.pad(voxels, [(int(k == axis),) * 2 for k in range(3)])
        parts = [np.take(padded, np.arange(voxels.shape[axis]) + k, axis=axis) for k in range(3)]
        voxels = parts[0] | parts[1] | parts[2]
    return voxels


@dataclass(frozen=True)
class Variant:
    """How a map is made."""

    title: str
    sigma: float = 1.0
    """Factor of the sensor's standard deviation."""
    pose_sigma: float = 0.0
    """Factor of the standard deviation by the errors of poses."""
    options: tuple[tuple[str, float], ...] = ()
    """Arguments of `OccupancyMap`."""


VARIANTS = (
    Variant("default"),
    Variant("sigma x 0", 0.0),
    Variant("sigma x 0.5", 0.5),
    Variant("sigma x 2", 2.0),
    Variant("with sigma of poses", 1.0, 1.0),
    Variant("hit 0.6", options=(("hit", 0.6),)),
    Variant("hit 0.8", options=(("hit", 0.8),)),
    Variant("miss 0.3", options=(("miss", 0.3),)),
    Variant("miss 0.45", options=(("miss", 0.45),)),
    Variant("limits 0.05, 0.98", options=(("minimum", 0.05), ("maximum", 0.98))),
    Variant("limits 0.25, 0.9", options=(("minimum", 0.25), ("maximum", 0.9))),
)


States = tuple[NDArray[np.uint8], NDArray[np.uint8]]
"""States of a map of people, and of a map of the same images without people."""


class Sequence:
    """Measured depth and noisy poses of a trajectory."""

    def __init__(self, scene: wv.Scene, model: wv.sensors.StereoDepth, arguments: argparse.Namespace) -> None:
        """Render it."""
        poses, people = trajectory(arguments.frames)
        assert model.native_camera is not None
        self.model, self.camera, self.noise = model, model.native_camera, arguments.pose_noise
        self.is_exact = arguments.exact
        noise = {} if self.is_exact else {"sensor": model, "seed": arguments.seed}
        renderer = wv.Renderer(scene, self.camera, outputs="depth", **noise)
        self.depth = renderer.render(poses, object_poses=people).depth
        people[..., 0] = OUTSIDE
        self.depth_without_people = renderer.render(poses, object_poses=people).depth
        self.poses = disturb(poses, *self.noise, arguments.seed)

    def map_with(self, variant: Variant, cell: float) -> States:
        """Return the states of maps with and without people."""

        def sigma(depth: NDArray[np.float64]) -> NDArray[np.float64]:
            by_sensor = variant.sigma * self.model.depth_sigma(depth, self.camera)
            return np.hypot(by_sensor, variant.pose_sigma * np.hypot(self.noise[0], np.radians(self.noise[1]) * depth))

        maps = []
        for depth in (self.depth, self.depth_without_people):
            occupancy = wv.OccupancyMap(cell, **dict(variant.options))
            given = sigma if variant.sigma and not self.is_exact else 0.0
            occupancy.integrate(depth, self.camera, self.poses, sigma=given, max_range=REACH)
            maps.append(occupancy.voxel_map(BOUNDS).states.numpy())
        return maps[0], maps[1]

    def map_exactly(self, cell: float) -> States:
        """Return the states of `warpvis.voxel_map`, which counts nothing."""
        maps = []
        for images in (self.depth, self.depth_without_people):
            depth = images.numpy()
            depth[depth > REACH] = np.nan
            voxels = wv.voxel_map(depth, self.camera, self.poses, bounds=BOUNDS, cell_size=cell)
            maps.append(voxels.states.numpy())
        return maps[0], maps[1]


def rows(truth: Truth, maps: Iterable[tuple[str, Callable[[], States]]]) -> Iterator[str]:
    """Yield a row of a table for each map."""
    order = (Voxel.FREE, Voxel.SURFACE, Voxel.HIDDEN, Voxel.UNKNOWN)
    cells = [f"{state.name.lower()} P / R" for state in order]
    cells.insert(2, "surface +-1 P / R")
    others = "surface seen as free | surface that is free | surface that is hidden | trail, liters"
    yield f"| map | {' | '.join(cells)} | {others} |"
    yield "|---|" + "---:|" * (len(cells) + 4)
    near_surface = grow(truth.states == Voxel.SURFACE)
    for title, make in maps:
        states, states_without_people = make()
        shares = []
        for state in order:
            found, true = states == state, truth.states == state
            both = (found & true).sum()
            shares.append((both / max(1, found.sum()), both / true.sum()))
        found, true = states == Voxel.SURFACE, truth.states == Voxel.SURFACE
        shares.insert(2, ((found & near_surface).sum() / max(1, found.sum()), (grow(found) & true).sum() / true.sum()))
        free_surface = (true & (states == Voxel.FREE)).sum() / true.sum()
        false_surface = [(found & (truth.states == state)).sum() / found.sum() for state in (Voxel.FREE, Voxel.HIDDEN)]
        trail = (
            1000
            * truth.cell**3
            * (found & truth.walked & ~near_surface & (states_without_people != Voxel.SURFACE)).sum()
        )
        text = " | ".join(f"{100 * precision:.1f} / {100 * recall:.1f}" for precision, recall in shares)
        yield (
            f"| {title} | {text} | {100 * free_surface:.1f} | {100 * false_surface[0]:.1f} | "
            f"{100 * false_surface[1]:.1f} | {trail:.2f} |"
        )


def main() -> None:
    """Print a table for each sensor and size of voxels."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=90)
    parser.add_argument("--cells", type=float, nargs="+", default=[0.02, 0.05], help="sides of voxels [m]")
    parser.add_argument("--sensors", nargs="+", choices=MODELS, default=list(MODELS))
    parser.add_argument("--pose-noise", type=float, nargs=2, default=[0.005, 0.3], help="position [m], rotation [deg]")
    parser.add_argument("--exact", action="store_true", help="exact depth of the sensors' cameras")
    parser.add_argument("--variants", action="store_true", help="measure other parameters, too")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    scene = build()
    for name in arguments.sensors:
        sequence = Sequence(scene, MODELS[name], arguments)
        for cell in arguments.cells:
            print(f"\n{name}, voxels of {100 * cell:g} cm, {arguments.frames} images; precision / recall, %")
            truth = find_truth(scene, sequence.camera, cell, arguments.frames)
            variants = VARIANTS if arguments.variants else VARIANTS[:1]
            maps = ((variant.title, partial(sequence.map_with, variant, cell)) for variant in variants)
            for row in rows(truth, chain(maps, [("voxel_map", partial(sequence.map_exactly, cell))])):
                print(row, flush=True)


if __name__ == "__main__":
    main()
