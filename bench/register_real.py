# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure registration on real depth images whose poses are known, by `wv.register` and its peers.

``python bench/register_real.py SCENE --models MODEL.ply`` reads a scene folder of a BOP dataset (depth images,
``scene_gt.json``, ``scene_camera.json``), and refines the pose of the object in every image, from the given pose
perturbed by 2 degrees and 2 cm, and by 5 degrees and 5 cm. Depth is cut to a box around the object's true pose.
A folder without ``scene_gt.json`` is a recording of `wv.open_recording`: the camera's poses of every tenth frame are
refined in a mesh in meters, which was fused from other frames.
The tables have median errors relative to the given poses, which have errors themselves; depth residuals, medians of
absolute differences between measured and rendered depth, tell which poses agree better with the measurement.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh
from machine import describe
from numpy.typing import NDArray
from PIL import Image
from registration import METHODS, Problem, errors, perturb, successes

import warpvis as wv
from warpvis.core.poses import poses_to_matrices

PERTURBATIONS = ((2.0, 0.02), (5.0, 0.05))
"""Degrees and meters."""


def bop_problems(folder: Path, model: Path, distance: float) -> Iterator[Problem]:
    """Yield a problem for each depth image: the camera's pose in the frame of the object, with its depth only."""
    poses, cameras = (json.loads((folder / name).read_text()) for name in ("scene_gt.json", "scene_camera.json"))
    mesh = trimesh.load_mesh(model, process=False)
    for path in sorted((folder / "depth").glob("*.png")):
        (pose, *_), entry = poses[str(int(path.stem))], cameras[str(int(path.stem))]
        depth = np.asarray(Image.open(path)).astype(np.float32) * np.float32(1e-3 * entry["depth_scale"])
        fx, _, cx, _, fy, cy, *_ = entry["cam_K"]
        # A pixel's center is its index in BOP, and its index + 0.5 here.
        camera = wv.Camera(depth.shape[1], depth.shape[0], fx, fy, cx + 0.5, cy + 0.5, near=0.05, far=20.0)
        object_to_camera = np.eye(4)
        object_to_camera[:3, :3] = np.reshape(pose["cam_R_m2c"], (3, 3))
        object_to_camera[:3, 3] = 1e-3 * np.array(pose["cam_t_m2c"])
        scene = wv.Scene()
        scene.add((1e-3 * np.asarray(mesh.vertices), np.asarray(mesh.faces)), name="object", movable=True)
        truth = np.linalg.inv(object_to_camera)
        depth = np.where(depth > 0, depth, np.float32(np.nan))
        depth = near_box(depth, camera, truth, 1e-3 * mesh.bounds, margin=0.03)
        yield Problem(scene, camera, depth, truth, distance, moving="object")


def near_box(
    depth: NDArray[np.float32], camera: wv.Camera, pose: NDArray, bounds: NDArray, margin: float
) -> NDArray[np.float32]:
    """Return depth of points in a box that is larger by a margin [m], as from an object detector, NaN elsewhere."""
    y, x = np.indices(depth.shape)
    points = camera.back_project(np.stack([x, y], axis=-1) + 0.5, depth) @ pose[:3, :3].T + pose[:3, 3]
    with np.errstate(invalid="ignore"):
        is_inside = ((points > bounds[0] - margin) & (points < bounds[1] + margin)).all(axis=-1)
    return np.where(is_inside, depth, np.float32(np.nan))


def recording_problems(folder: Path, mesh: Path, distance: float) -> Iterator[Problem]:
    """Yield a problem for every tenth frame, from the second, with images of a quarter of the size."""
    recording, surface = wv.open_recording(folder), trimesh.load_mesh(mesh, process=False)
    camera, scene = recording.camera, wv.Scene()
    scene.add((surface.vertices, surface.faces), name="fused")
    numbers = [n / 4 for n in (camera.fx, camera.fy, camera.cx, camera.cy)]
    small = wv.Camera(camera.width // 4, camera.height // 4, *numbers, near=0.05, far=5.0)
    for frame in list(recording.posed())[1::10]:
        # The pixel at index 4 i + 2 has its center at 4 i + 2.5, half a pixel from that of pixel i of the small image.
        depth = np.ascontiguousarray(frame.depth[2::4, 2::4])
        yield Problem(scene, small, depth, poses_to_matrices(np.reshape(frame.camera_to_world, (1, 7)))[0], distance)


def residual(problem: Problem, pose: NDArray[np.float64]) -> float:
    """Return the median absolute difference of measured and rendered depth [m], of pixels that have both."""
    rendered = wv.render(problem.scene, problem.camera, pose, outputs=("depth",)).depth.numpy()[0]
    with np.errstate(invalid="ignore"):
        difference = np.abs(rendered - problem.depth)
    difference = difference[np.isfinite(difference) & (difference < problem.distance)]
    return float(np.median(difference)) if len(difference) else np.nan


def judge(problem: Problem, poses: NDArray[np.float64]) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Return errors [m] and [degrees], successes and residuals [m]; of an object in the frame of the camera."""
    values, truth = poses, problem.truth
    if problem.moving != "camera":
        values, truth = np.linalg.inv(poses), np.linalg.inv(truth)
    return *errors(values, truth), successes(values, truth), np.array([residual(problem, pose) for pose in poses])


def main() -> None:
    """Print a table for each perturbation."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--models", type=Path, required=True, help="the mesh, in millimeters for BOP")
    parser.add_argument("--starts", type=int, default=20, help="for each image")
    parser.add_argument("--iterations", type=int, default=30)
    parser.add_argument("--distance", type=float, default=0.1)
    parser.add_argument("--points", type=int, default=200_000)
    arguments = parser.parse_args()
    is_bop = (arguments.folder / "scene_gt.json").is_file()
    read = bop_problems if is_bop else recording_problems
    problems = list(read(arguments.folder, arguments.models, arguments.distance))
    print(describe(("warpvis", "open3d", "small_gicp")))
    residuals = [residual(problem, problem.truth) for problem in problems]
    print(f"{len(problems)} images, median residual at the given poses: {1e3 * np.median(residuals):.1f} mm")
    for degrees, meters in PERTURBATIONS:
        results: dict[str, list[tuple[NDArray, ...]]] = {}
        for number, problem in enumerate(problems):
            pose = problem.truth if problem.moving == "camera" else np.linalg.inv(problem.truth)
            starts = perturb(pose, arguments.starts, degrees, meters, np.random.default_rng(number))
            starts = starts if problem.moving == "camera" else np.linalg.inv(starts)
            results.setdefault("before", []).append(judge(problem, starts))
            for title, method in METHODS.items():
                try:
                    refine = method(problem) if "wv." in title else method(problem, arguments.points)
                except ImportError:
                    continue
                results.setdefault(title, []).append(judge(problem, refine(starts, arguments.iterations)))
        print(f"\n{degrees:g} degrees, {100 * meters:g} cm, {arguments.iterations} iterations\n")
        print("| | translation | rotation | residual | success |\n| --- | ---: | ---: | ---: | ---: |")
        for title, parts in results.items():
            far, turned, success, after = (np.concatenate(column) for column in zip(*parts, strict=True))
            print(
                f"| {title} | {1e3 * np.median(far):.1f} mm | {np.median(turned):.2f}° | "
                f"{1e3 * np.nanmedian(after):.1f} mm | {success.mean():.0%} |"
            )


if __name__ == "__main__":
    main()
