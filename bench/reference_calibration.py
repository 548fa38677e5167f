# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Calibration of `Perspective.candidates` on generated tables: of objects with a probability of 0.7, are 70 % meant?

A person sits at a table of boxes, cylinders and balls that hide each other. A target is drawn, a fixation among its
visible pixels, and a gaze, a pointing ray and another person's glance with the errors that the model assumes. The
fixations come from rendered pixels, not from the model's rectangles, so the curve shows what its simplifications cost.
With ``--error 1.5``, all errors are 1.5 times what the model assumes.

    python bench/reference_calibration.py --scenes 40 --targets 50 --seed 0
"""

from __future__ import annotations

import argparse
import math
from collections import defaultdict

import numpy as np
import trimesh

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.visibility import Agent, Candidate, ReferenceModel

BINS = np.linspace(0, 1, 11)
EYES = (0.0, 0.0, 1.2)


def table(rng: np.random.Generator) -> wv.Scene:
    """Return a table with 5 to 9 objects of 4 to 40 cm that stand apart."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((1.2, 2.4, 0.04)), name="table", pose=(1.2, 0, 0.7, 0, 0, 0, 1))
    placed: list[tuple[float, float, float]] = []
    while len(placed) < 5 + rng.integers(5):
        size = 0.04 * 10 ** rng.uniform(0, 1, 3)
        radius = float(np.hypot(*size[:2])) / 2
        x, y = rng.uniform(0.7, 1.75), rng.uniform(-1.1, 1.1)
        if all(math.hypot(x - a, y - b) > radius + other for a, b, other in placed):
            shape = rng.integers(3)
            if shape == 0:
                mesh = trimesh.creation.box(size)
            elif shape == 1:
                mesh = trimesh.creation.cylinder(radius=size[0] / 2, height=size[2])
            else:
                mesh = trimesh.creation.icosphere(subdivisions=3, radius=size[2] / 2)
            height = 0.72 - float(mesh.bounds[0, 2])
            scene.add(mesh, name=str(len(placed)), label="object", pose=(x, y, height, 0, 0, 0, 1))
            placed.append((x, y, radius))
    return scene


def visible_rays(scene: wv.Scene, agent: Agent) -> dict[str, np.ndarray]:
    """Return unit vectors in the world to the visible pixels of each object."""
    found: dict[str, list[np.ndarray]] = {item.name: [] for item in scene}
    for face in agent.faces:
        pose = agent.face_poses(face)[0]
        objects = wv.render(scene, face.camera, pose, outputs=("segmentation",)).segmentation.numpy()[0]
        rays = face.camera.rays @ poses_to_matrices(pose[None])[0, :3, :3].T
        for index, item in enumerate(scene):
            found[item.name].append(rays[objects == index])
    joined = {name: np.concatenate(rays) for name, rays in found.items()}
    return {name: rays / np.linalg.norm(rays, axis=1, keepdims=True) for name, rays in joined.items()}


def fixate(rng: np.random.Generator, rays: np.ndarray) -> np.ndarray:
    """Draw one of an object's visible pixels, with a quarter of its width and height as standard deviation."""
    angles = np.stack([np.arctan2(rays[:, 1], rays[:, 0]), np.arcsin(rays[:, 2])], axis=1)
    sizes = np.maximum(np.ptp(angles, axis=0), 1e-3)
    weights = np.exp(-0.5 * (((angles - angles.mean(axis=0)) / (sizes / 4)) ** 2).sum(axis=1))
    return rays[rng.choice(len(rays), p=weights / weights.sum())]


def disturb(rng: np.random.Generator, direction: np.ndarray, sigma: float, lapse: float) -> np.ndarray:
    """Return a unit vector with a Gaussian error per axis [rad], or one from the whole sphere with chance `lapse`."""
    axis = np.cross(direction, rng.normal(size=3))
    angle = sigma * math.sqrt(-2 * math.log(1 - rng.random()))
    if rng.random() < lapse:
        axis = rng.normal(size=3)
        return axis / np.linalg.norm(axis)
    return math.cos(angle) * direction / np.linalg.norm(direction) + math.sin(angle) * axis / np.linalg.norm(axis)


def sequences(
    rng: np.random.Generator, scene: wv.Scene, rays: dict[str, np.ndarray], first: list[Candidate], error: float
) -> dict[str, list[tuple[list[Candidate], str]]]:
    """Return the candidates and the target in every frame of 10 s, in which the person moves from object to object.

    The eyes deviate from the head by the same angle as long as the person attends to an object; errors of the gaze are
    new in every fixation.
    """
    model = ReferenceModel(max_eye_angle=math.pi)
    salience = np.array([item.solid_angle**model.salience_exponent for item in first])
    times = np.arange(0, 10, 0.1)
    targets, heads, gazes = [], [], []
    for frame, _ in enumerate(times):
        if frame == 0 or rng.random() < 1 - math.exp(-model.switch_rate * 0.1):
            target = first[rng.choice(len(first), p=salience / salience.sum())].object
            head = disturb(rng, fixate(rng, rays[target]), error * model.head_sigma, model.lapse)
            fixated = -math.inf
        if times[frame] - fixated > model.fixation - 0.01:
            gaze = disturb(rng, fixate(rng, rays[target]), error * model.gaze_sigma, model.lapse)
            fixated = times[frame]
        targets.append(target)
        heads.append(wv.look_at(EYES, EYES + head))
        gazes.append(gaze)
    moving, still = (Agent.human("human", poses) for poses in (np.array(heads), wv.look_at(EYES, (1.2, 0, 0.8))))
    by_head = wv.perspective(scene, moving).track("human", times=times, model=model)
    seen = wv.perspective(scene, Agent.human("human", np.tile(still.poses, (len(times), 1))))
    by_eyes = seen.track("human", times=times, gaze=np.array(gazes), model=model)
    found = {"head, 10 s": by_head, "image of the eyes, 10 s": by_eyes}
    return {
        kind: [(candidates, target) for candidates, target in zip(frames, targets, strict=True) if candidates]
        for kind, frames in found.items()
    }


def calibration_error(predicted: np.ndarray, is_meant: np.ndarray) -> float:
    """Return the expected calibration error: the mean difference between probability and frequency over bins."""
    bins = np.clip(np.digitize(predicted, BINS) - 1, 0, len(BINS) - 2)
    gaps = [
        (bins == k).mean() * abs(predicted[bins == k].mean() - is_meant[bins == k].mean())
        for k in range(len(BINS) - 1)
        if (bins == k).any()
    ]
    return float(sum(gaps))


def main() -> None:
    """Print the calibration curve and error for each kind of evidence."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=40)
    parser.add_argument("--targets", type=int, default=50, help="targets in each scene")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--error", type=float, default=1.0, help="factor of all errors")
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    assumed = ReferenceModel(max_eye_angle=math.pi)
    tracker = ReferenceModel(max_eye_angle=math.pi, gaze_sigma=math.radians(2))
    kinds = ("head", "image of the eyes", "eye tracker", "head and finger", "head and other person")
    results: dict[str, list[tuple[list[Candidate], str]]] = defaultdict(list)
    for _ in range(options.scenes):
        scene = table(rng)
        ahead = Agent.human("human", wv.look_at(EYES, (1.2, 0, 0.8)))
        rays = visible_rays(scene, ahead)
        seen = wv.perspective(scene, ahead)
        first = seen.candidates("human")
        salience = np.array([item.solid_angle**assumed.salience_exponent for item in first])
        for _ in range(options.targets):
            target = first[rng.choice(len(first), p=salience / salience.sum())].object
            point = fixate(rng, rays[target])
            # The other person's glance is known, and with the model's probability it is at the target.
            is_joint = rng.random() < assumed.joint_attention
            other = target if is_joint else first[rng.choice(len(first), p=salience / salience.sum())].object
            watched = [item for item in first if item.object == other]
            lapse, error = assumed.lapse, options.error
            gaze = disturb(rng, point, error * assumed.gaze_sigma, lapse)
            precise = disturb(rng, point, error * tracker.gaze_sigma, lapse)
            head = disturb(rng, point, error * assumed.head_sigma, lapse)
            hand = np.array(EYES) + (0.3, -0.2, -0.3)
            corners = scene.objects[scene.index(target)].bounds
            aim = disturb(rng, corners.mean(axis=0) - hand, error * assumed.pointing_sigma, lapse)
            known_head = {"gaze": head, "model": ReferenceModel(max_eye_angle=math.pi, gaze_sigma=assumed.head_sigma)}
            certain = [[Candidate(**{**vars(item), "probability": 1.0}) for item in watched]]
            evidence = (
                known_head,
                {"gaze": gaze, "model": assumed},
                {"gaze": precise, "model": tracker},
                {**known_head, "pointing": [*hand, *aim]},
                {**known_head, "others": certain},
            )
            for kind, given in zip(kinds, evidence, strict=True):
                results[kind].append((seen.candidates("human", **given), target))
        for kind, frames in sequences(rng, scene, rays, first, options.error).items():
            results[kind] += frames
    print(f"{options.scenes} scenes, {options.targets} targets each, seed {options.seed}, errors x {options.error:g}")
    middles = "".join(f"{100 * low:5.0f}+" for low in BINS[:-1])
    print(
        f"{'evidence':24} {'first is meant':>14} {'ECE':>6} {'ECE of first':>12}   meant [%] by probability {middles}"
    )
    for kind, found in results.items():
        predicted = np.array([item.probability for candidates, _ in found for item in candidates])
        is_meant = np.array([item.object == target for candidates, target in found for item in candidates])
        top = np.array([candidates[0].probability for candidates, _ in found])
        is_first = np.array([candidates[0].object == target for candidates, target in found])
        bins = np.clip(np.digitize(predicted, BINS) - 1, 0, len(BINS) - 2)
        curve = "".join(
            f"{100 * is_meant[bins == k].mean():6.0f}" if (bins == k).any() else "     -" for k in range(len(BINS) - 1)
        )
        errors = calibration_error(predicted, is_meant), calibration_error(top, is_first)
        print(f"{kind:24} {is_first.mean():14.2f} {errors[0]:6.3f} {errors[1]:12.3f} {'':27}{curve}")


if __name__ == "__main__":
    main()
