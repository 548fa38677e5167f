# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Repeat the four experiments with a noisy, moving depth camera whose floor is not known.

A simulated Kinect moves sideways and takes 13 images; its poses have errors, and are in a tilted frame. The floor is
found by `fit_floor`. Prints what differs from exact depth; writes measured_experiments.png: measured depth, the floor
map of exact depth, that of the middle image, and the floor of the map of all images.
"""

import numpy as np
import trimesh
from matplotlib.figure import Figure  # noqa: TID253

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.scenes import EXPERIMENTS

IMAGES, MIDDLE = 13, 6
POSITION_ERROR, ANGLE_ERROR = 0.003, np.radians(0.2)  # standard deviations of a pose [m], [rad]
BOUNDS = [(-2.0, -2.0, -0.1), (2.0, 2.0, 1.8)]
CELL_SIZE = 0.04
SENSOR = wv.sensors.kinect_v1(320, 240)


def walk(pose):
    """Return poses, (V, 4, 4), of a camera that moves 0.9 m sideways, and looks at a point 2.5 m in front of it."""
    matrix = poses_to_matrices(pose)
    target = matrix[:3, 3] + 2.5 * matrix[:3, 2]
    sideways = np.linspace(-0.45, 0.45, IMAGES)
    return poses_to_matrices([wv.look_at(matrix[:3, 3] + matrix[:3, 0] * offset, target) for offset in sideways])


def record(experiment, rng):
    """Return the scene, true poses, measured depth, poses with errors in a tilted frame, and its direction up."""
    scene, poses = experiment.build("cpu"), walk(experiment.poses()[0])
    depth = wv.render(scene, experiment.camera, poses, sensor=SENSOR, seed=1, frame=0, outputs="depth").depth.numpy()
    tilted = trimesh.transformations.euler_matrix(*rng.uniform(-np.pi, np.pi, 3))
    errors = np.array([trimesh.transformations.euler_matrix(*rng.normal(scale=ANGLE_ERROR, size=3)) for _ in poses])
    errors[:, :3, 3] = rng.normal(scale=POSITION_ERROR, size=(IMAGES, 3))
    return scene, poses, depth, tilted @ poses @ errors, tilted[:3, 2]


def make_upright(depth, camera, recorded, truth):
    """Return upright poses, and the floor of all points, which is z = 0.

    Height and tilt are measured. Position and heading on the floor are those of the middle image, to compare maps.
    """
    points = wv.back_project(depth, camera, recorded).numpy()
    floor = wv.fit_floor(points, camera_to_world=recorded[MIDDLE])
    poses = poses_to_matrices(floor.world_from_input) @ recorded
    (ax, ay), (bx, by) = poses[MIDDLE, :2, 2], truth[MIDDLE, :2, 2]
    level = trimesh.transformations.rotation_matrix(np.arctan2(by, bx) - np.arctan2(ay, ax), (0, 0, 1))
    level[:2, 3] = truth[MIDDLE, :2, 3] - (level @ poses[MIDDLE])[:2, 3]
    return level @ poses, floor


def draw_floor(depth, camera, pose, spheres, **tolerance):
    """Return the paper's floor map of one image, and how many pixels the ball and the person have."""
    labels = wv.classify(depth, camera, pose, spheres=spheres, **tolerance)
    floor = wv.floor_map(wv.back_project(depth, camera, pose), labels, bounds=BOUNDS, cell_size=CELL_SIZE)
    return floor, [int((labels.numpy() == label).sum()) for label in (wv.Label.OBJECT, wv.Label.HUMAN)]


def run(experiment, rng):
    """Return the maps of an experiment and lines that compare exact and measured results."""
    camera = experiment.camera
    scene, truth, depth, recorded, up = record(experiment, rng)
    poses, floor = make_upright(depth, camera, recorded, truth)
    to_measured = poses[MIDDLE] @ np.linalg.inv(truth[MIDDLE])  # objects and people are detected in the middle image
    spheres = [
        wv.maps.Sphere(tuple((to_measured @ (*item.center, 1))[:3]), item.diameter, item.label)
        for item in experiment.spheres
    ]
    exact_depth = wv.render(scene, camera, truth[MIDDLE], outputs="depth").depth.numpy()
    exact, exact_pixels = draw_floor(exact_depth, camera, truth[MIDDLE], experiment.spheres)
    tolerance = {"sigma": SENSOR, "ground_tolerance": 0.03}  # an angle of 0.4 degrees is 2 cm at 3 m
    measured, pixels = draw_floor(depth[MIDDLE], camera, poses[MIDDLE], spheres, **tolerance)
    cells = exact.cells.numpy()[0], measured.cells.numpy()[0]
    both = (cells[0] != wv.Label.EMPTY) & (cells[1] != wv.Label.EMPTY)

    occupancy = wv.OccupancyMap(CELL_SIZE, bounds=BOUNDS)
    occupancy.integrate(depth, camera, poses, sigma=SENSOR, max_range=4.5)
    known = wv.Scene(device="cpu")
    known.add(scene["ball"].mesh, name="ball", label="object", pose=to_measured)
    eyes = to_measured @ poses_to_matrices(experiment.human_pose)
    agents = [wv.Agent("robot", camera, poses[MIDDLE]), wv.Agent.human("human", eyes)]
    space = wv.visibility.MeasuredSpace(occupancy, eye_clearance=0.6)  # the person's chest was measured, too
    expected = wv.perspective(scene, experiment.agents(), objects=["ball"])
    seen = wv.perspective(known, agents, occupancy=space)

    tilt = np.degrees(np.arccos(min(1.0, floor.plane[:3] @ up)))
    height = 1000 * (floor.camera_height - truth[MIDDLE, 2, 3])
    lines = [f"floor: {tilt:.2f} degrees, {height:+.0f} mm"]
    lines += [f"floor map: {(cells[0] == cells[1])[both].mean():.1%} of {both.sum()} cells agree"]
    for name, counts in zip(("ball", "person"), zip(exact_pixels, pixels, strict=True), strict=True):
        lines.append(f"pixels of the {name}: {counts[0]} exact, {counts[1]} measured")
    for row, name in enumerate(seen.agents):
        words = [wv.Visibility(view.status[row, 0, 0]).name.lower().replace("_", " ") for view in (expected, seen)]
        share = max(seen.fraction[row, 0, 0], seen.unknown_fraction[row, 0, 0])
        lines.append(f"ball for the {name}: {words[0]}, measured {words[1]}" + f" {share:.0%}" * bool(share))
    return depth[MIDDLE], (exact, measured, occupancy.voxel_map(BOUNDS, ground_tolerance=0.06).floor_map()), lines


def draw(axes, experiment, depth, maps, lines):
    """Draw one row: measured depth, three floor maps, and who sees the ball."""
    axes[0].imshow(np.where(np.isfinite(depth), depth, np.nan), cmap="turbo", vmin=0.5, vmax=4.5)
    axes[0].set_title(f"{experiment.name[-1]}. {experiment.title}", fontsize=10, fontweight="bold", loc="left")
    axes[0].set_xlabel("\n".join(lines[-2:]), fontsize=8, loc="left")
    titles = "one image, exact", "one image, measured", f"map of {IMAGES} images"
    for axis, floor, title in zip(axes[1:], maps, titles, strict=True):
        axis.imshow(floor.rgb()[0], origin="lower", extent=floor.bounds)
        axis.plot(*experiment.spheres[0].center[:2], "o", color="white", fillstyle="none")
        axis.plot(*experiment.human_pose[:2], "s", color="white", fillstyle="none")
        axis.set_title(title, fontsize=10)
        axis.set(xlim=(-1.5, 2.0), ylim=(-1.5, 1.5))
    for axis in axes:
        axis.set(xticks=[], yticks=[])


if __name__ == "__main__":
    rng, figure = np.random.default_rng(4), Figure(figsize=(13, 10.5), layout="constrained")
    for row, experiment in zip(figure.subplots(4, 4), EXPERIMENTS, strict=True):
        depth, maps, lines = run(experiment, rng)
        print(experiment.name, *lines, sep="\n  ")
        draw(row, experiment, depth, maps, lines)
    figure.suptitle(
        "Depth (white: not measured), and maps of the seen floor (circle: ball, square: person)", fontsize=11
    )
    figure.savefig("measured_experiments.png", dpi=60)
