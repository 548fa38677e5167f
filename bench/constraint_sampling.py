# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compare `check_constraints` with segmentation images of `mujoco.Renderer` for the placement of cameras in a room.

    MUJOCO_GL=egl python bench/constraint_sampling.py [--views 200] [--size 320 240] [--rounds 3] [--seed 0]

The room has 300 boxes: a floor, walls, furniture, and things on it. Cameras are around a thing and look at it, outside
of solids. A view is accepted if three things each take 0.1 % of the image, which is how a simulator for robots,
MolmoSpaces, checks the visibility of bodies: an image of segmentation, and the mean of each mask.

Prints views per second of both, by wall clock and by CPU time of the process, the views that only one of them accepts,
and how often the share of the image misjudges the share of the object: things that are accepted although more than half
of them is hidden or outside the image, and things that are rejected although nothing hides them.
Exits with 1 if an accepted set differs other than by a pixel at the threshold.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable

import mujoco
import numpy as np
import trimesh
from numpy.typing import NDArray

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.planning import Constraint, ShellRegion, check_constraints, sample_views

GEOMS, SHARE = 300, 0.001
_NEAR = 1e-3
Box = tuple[str, tuple[float, ...], tuple[float, ...], float]


def furnish(seed: int) -> list[Box]:
    """Return the boxes of a room: name, size, position of the center [m], and yaw [rad]."""
    generator = np.random.default_rng(seed)
    boxes: list[Box] = [("floor", (8.0, 8.0, 0.1), (0.0, 0.0, -0.05), 0.0)]
    for name, x, y in (("north", 0, 4.05), ("south", 0, -4.05), ("east", 4.05, 0), ("west", -4.05, 0)):
        boxes.append((name, (0.1, 8.2, 2.6) if x else (8.2, 0.1, 2.6), (x, y, 1.3), 0.0))
    tables = []
    for index, (x, y) in enumerate(np.stack(np.meshgrid(*[np.arange(-3, 4, 1.5)] * 2), axis=-1).reshape(-1, 2)):
        width, depth, height = generator.uniform((0.6, 0.5, 0.4), (1.1, 0.9, 1.0))
        yaw = generator.uniform(-0.3, 0.3)
        boxes.append((f"furniture_{index}", (width, depth, height), (x, y, height / 2), yaw))
        tables.append((x, y, width, depth, height, yaw))
    things = 0
    while len(boxes) < GEOMS:
        x, y, width, depth, height, yaw = tables[things % len(tables)]
        size = generator.uniform((0.04, 0.04, 0.05), (0.16, 0.12, 0.3))
        offset = generator.uniform(-0.5, 0.5, 2) * (width - 0.2, depth - 0.2)
        cosine, sine = np.cos(yaw), np.sin(yaw)
        place = (x + cosine * offset[0] - sine * offset[1], y + sine * offset[0] + cosine * offset[1])
        boxes.append((f"thing_{things}", tuple(size), (*place, height + size[2] / 2), generator.uniform(0, 3)))
        things += 1
    return boxes


def build_scene(boxes: list[Box]) -> wv.Scene:
    """Return the room as a scene."""
    scene = wv.Scene(device="cpu")
    for name, size, center, yaw in boxes:
        pose = (*center, 0, 0, np.sin(yaw / 2), np.cos(yaw / 2))
        scene.add(trimesh.creation.box(size), name=name, pose=pose)
    return scene


def build_model(boxes: list[Box], camera: wv.Camera) -> mujoco.MjModel:
    """Return the room as a model with one camera and one body for each box."""
    bodies = ""
    for name, size, center, yaw in boxes:
        position, half = (" ".join(f"{value:.17g}" for value in values) for values in (center, np.array(size) / 2))
        quaternion = f"{np.cos(yaw / 2):.17g} 0 0 {np.sin(yaw / 2):.17g}"
        geom = f'<geom type="box" size="{half}"/>'
        bodies += f'<body name="{name}" pos="{position}" quat="{quaternion}">{geom}</body>'
    vfov = np.degrees(2 * np.arctan(camera.height / 2 / camera.fy))
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><statistic extent="1"/><visual><map znear="{_NEAR}" zfar="50"/>'
        f'<global offwidth="{camera.width}" offheight="{camera.height}"/></visual>'
        f'<worldbody>{bodies}<camera name="eye" fovy="{vfov:.17g}"/></worldbody></mujoco>'
    )


def shares_of_mujoco(
    model: mujoco.MjModel, renderer: mujoco.Renderer, poses: NDArray[np.float64], names: list[str]
) -> NDArray[np.float64]:
    """Return the share of the image that each body takes, ``(V, K)``."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    geoms = [np.flatnonzero(model.geom_bodyid == model.body(name).id) for name in names]
    shares = np.empty((len(poses), len(names)))
    for view, matrix in enumerate(poses_to_matrices(poses)):
        data.cam_xpos[0], data.cam_xmat[0] = matrix[:3, 3], (matrix[:3, :3] * (1, -1, -1)).ravel()
        renderer.update_scene(data, camera=0)
        image = renderer.render()
        is_geom = image[..., 1] == mujoco.mjtObj.mjOBJ_GEOM
        shares[view] = [np.mean(is_geom & np.isin(image[..., 0], ids)) for ids in geoms]
    return shares


def least_times(functions: dict[str, Callable[[], object]], rounds: int) -> dict[str, tuple[float, float]]:
    """Return the least wall-clock time and CPU time of each function [s], measured by turns."""
    found = dict.fromkeys(functions, (np.inf, np.inf))
    for _ in range(rounds):
        for name, function in functions.items():
            wall, cpu = time.perf_counter(), time.process_time()
            function()
            spent = time.perf_counter() - wall, time.process_time() - cpu
            found[name] = min(found[name][0], spent[0]), min(found[name][1], spent[1])
    return found


def main() -> int:
    """Run the comparison."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--views", type=int, default=200)
    parser.add_argument("--size", type=int, nargs=2, default=(320, 240))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    boxes = furnish(options.seed)
    camera = wv.Camera.from_fov(*options.size, hfov=1.2, near=_NEAR)
    scene, model = build_scene(boxes), build_model(boxes, camera)
    names = [f"thing_{index}" for index in (12, 37, 62)]  # of one table
    shell = ShellRegion("thing_12", (0.3, 3.5), height=(-0.2, 0.8), jitter=0.1)
    anything = {"thing_12": Constraint(distance=(0.0, None))}
    poses = sample_views(scene, camera, anything, shell, options.views, options.seed).poses
    renderer = mujoco.Renderer(model, camera.height, camera.width)
    renderer.enable_segmentation_rendering()
    shares = {name: Constraint(image_fraction=(SHARE, 1.0)) for name in names}
    fractions = {name: Constraint(fraction=(0.5, 1.0), image_fraction=(SHARE, 1.0)) for name in names}
    functions = {
        "mujoco.Renderer": lambda: shares_of_mujoco(model, renderer, poses, names),
        "warpvis, share of the image": lambda: check_constraints(scene, camera, poses, shares),
        "warpvis, share of the object, too": lambda: check_constraints(scene, camera, poses, fractions),
    }
    theirs = shares_of_mujoco(model, renderer, poses, names)
    ours = check_constraints(scene, camera, poses, shares)
    both = check_constraints(scene, camera, poses, fractions)
    accepted = (theirs >= SHARE).all(axis=1)
    pixels = camera.width * camera.height
    difference = np.round(np.abs(theirs - ours.values) * pixels).astype(int)
    differing = accepted != ours.accepted
    near = np.abs(ours.values - SHARE).min(axis=1) * pixels
    print(f"{len(boxes)} boxes, {len(poses)} views, {camera.width} x {camera.height}")
    print(f"accepted: mujoco.Renderer {accepted.sum()}, warpvis {ours.accepted.sum()}, different {differing.sum()}")
    share = (difference > 0).mean()
    print(f"pixels of things that differ: at most {difference.max()}, in {share:.1%} of {difference.size}")
    fraction = both.values[:, [column for column, term in enumerate(both.terms) if term.quantity == "fraction"]]
    shown = theirs >= SHARE
    wrong = shown & (fraction < 0.5)
    print(f"things: {shown.size}, accepted {shown.sum()}, of these less than half visible {wrong.sum()}")
    unhidden = ~shown & (fraction > 0.99)
    print(f"rejected {(~shown).sum()}, of these nothing hides {unhidden.sum()}")
    print(f"views accepted although a thing is less than half visible: {(accepted & ~both.accepted).sum()}")
    for name, (wall, cpu) in least_times(functions, options.rounds).items():
        print(f"{name}: {len(poses) / wall:.0f} views/s, {len(poses) / cpu:.0f} per second of CPU time")
    start = time.perf_counter()
    found = sample_views(scene, camera, fractions, shell, 50, options.seed, max_tries=100_000)
    spent = time.perf_counter() - start
    print(f"sample_views: {50 / spent:.1f} placements/s, {found.tries / spent:.0f} tries/s, {found.report()}")
    return int((differing & (near > difference.max(axis=1) + 1)).any())


if __name__ == "__main__":
    sys.exit(main())
