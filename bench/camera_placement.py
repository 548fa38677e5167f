# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure `planning.place_cameras`: 2,000 candidates, 5,000 targets, and 200 worlds of five people in a hall.

``python bench/camera_placement.py`` prints the time of a call for the first world and for all, and compares `--checked`
worlds with `point_visibility`. ``--solids`` makes people capsules with exact surfaces instead of meshes, and
``--directions 1`` puts each candidate at another place: cameras at one place share their lines of sight.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import trimesh
import warp as wp

import warpvis as wv
from warpvis.scene import solids

PEOPLE, FURNITURE, CAMERAS = 5, 20, 8
CAMERA = wv.Camera.from_fov(640, 480, hfov=1.4, near=0.1, far=12.0)


def hall(rng: np.random.Generator, device: str, *, exact: bool) -> wv.Scene:
    """Return a hall of 10 x 8 x 3 m with furniture, and people of 480 triangles each, or exact capsules."""
    scene = wv.Scene(device=device)
    walls = trimesh.creation.box((10, 8, 3))
    walls.invert()
    scene.add(walls, name="walls", label="ground", pose=(0, 0, 1.5, 0, 0, 0, 1))
    for number in range(FURNITURE):
        height = rng.uniform(0.7, 2.0)
        pose = (rng.uniform(-4, 4), rng.uniform(-3.5, 3.5), height / 2, 0, 0, 0, 1)
        scene.add(trimesh.creation.box((1.0, 0.5, height)), name=f"furniture_{number}", pose=pose)
    person = solids.capsule(0.25, 0.6) if exact else trimesh.creation.capsule(height=1.2, radius=0.25, count=(16, 16))
    for number in range(PEOPLE):
        scene.add(person, name=f"person_{number}", label="human", pose=(0, 0, 0.85, 0, 0, 0, 1), movable=True)
    return scene


def main() -> None:
    """Print times, and whether the results agree."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--candidates", type=int, default=2000)
    parser.add_argument("--directions", type=int, default=8, help="candidates at each place")
    parser.add_argument("--targets", type=int, default=5000)
    parser.add_argument("--worlds", type=int, default=200)
    parser.add_argument("--checked", type=int, default=1)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--threads", type=int, default=None)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--solids", action="store_true")
    args = parser.parse_args()
    rng = np.random.default_rng(0)
    scene = hall(rng, args.device, exact=args.solids)
    places = rng.uniform((-4.9, -3.9, 2.2), (4.9, 3.9, 2.9), (-(-args.candidates // args.directions), 3))
    places = np.repeat(places, args.directions, axis=0)[: args.candidates]
    toward = places + rng.normal(0, 1, places.shape) * [1, 1, 0] - [0, 0, 0.8]
    poses = np.array([wv.look_at(*line) for line in zip(places, toward, strict=True)])
    targets = rng.uniform((-4.9, -3.9, 0.0), (4.9, 3.9, 1.0), (args.targets, 3))
    walks = np.zeros((args.worlds, PEOPLE, 7))
    walks[..., :3] = rng.uniform((-4.5, -3.5, 0.85), (4.5, 3.5, 0.85), (args.worlds, PEOPLE, 3))
    walks[..., 6] = 1.0
    print(
        f"{args.candidates} x {args.targets} x {args.worlds}: {args.candidates * args.targets * args.worlds:.3g} pairs"
    )
    for name, moved in (("static scene only", walks[:1]), ("all worlds", walks)):
        for _ in range(args.rounds):
            start, cpu = time.perf_counter(), time.process_time()
            found = wv.planning.place_cameras(
                scene, CAMERA, poses, targets, CAMERAS, object_poses=moved, threads=args.threads
            )
            wp.synchronize()
            wall, cpu = time.perf_counter() - start, time.process_time() - cpu
            print(f"  {name}: {wall:.2f} s, {cpu:.2f} s of CPU time, share {found.fraction:.4f} <= {found.bound:.4f}")
    for world in rng.choice(args.worlds, args.checked, replace=False):
        status = wv.point_visibility(
            scene, CAMERA, found.poses, targets, tolerance=1e-3, object_poses=walks[world], threads=args.threads
        )
        expected = (status.numpy() == wv.Visibility.VISIBLE).sum(axis=0)
        print(f"  world {world}: counts differ at {(expected != found.counts[world]).sum()} of {args.targets} targets")


if __name__ == "__main__":
    main()
