# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A Webots controller that shows labels of the robot's depth image, a floor map, and objects visible to each agent.

In Webots: open worlds/experiment_1.wbt, two folders up, and press play. Webots' Python (Tools > Preferences) must have
warpvis installed. Move ball, obstacles, person or robot with the mouse to update the results.

Without Webots, `python visibility.py` prints the same for the four worlds, with depth images rendered by warpvis.
"""

from pathlib import Path

import numpy as np
from trimesh.transformations import quaternion_from_matrix

import warpvis as wv
from warpvis.webots import DepthEye, load_webots, render_range

BOUNDS = ((-2, -2), (2, 2))  # of the map of the floor [m]
MARGIN = 1.1  # points on an object's surface must be inside its sphere
MOVING = {"low obstacle": "LOW_OBSTACLE", "high obstacle": "HIGH_OBSTACLE", "ball": "BALL", "person": "PERSON"}
MOVING["robot"] = "ROBOT"  # names in the scene, in its order, and DEF names in the world
WHO = ("neither sees", "the robot sees", "the person sees", "both see")
COLORS = np.array([wv.maps.MAP_LEGEND[label][1] for label in wv.Label], dtype=np.uint8)
LOOK = wv.Camera.from_fov(200, 200, hfov=np.radians(60))  # the person's view


def load(path):
    """Load a world as a scene with movable objects."""
    return wv.Scene.load(path, movable=list(MOVING))


def make_spheres(scene, moves):
    """Build the spheres of the paper's test at current poses: one for the ball, and three for the person."""
    spheres = []
    for name, parts in (("ball", 1), ("person", 3)):
        low, high = scene[name].bounds.astype(float)
        size = (high[2] - low[2]) / parts
        for k in range(parts):
            center = moves[name] @ [*(low + high)[:2] / 2, low[2] + (k + 0.5) * size, 1]
            spheres.append(wv.maps.Sphere(tuple(center[:3]), MARGIN * size, scene[name].label))
    return spheres


def watch(scene, depth, camera, robot_pose, person, moves):
    """Label a depth image, and compute the visibility of objects for robot and person.

    Args:
        scene: The world, from `load`.
        depth: The robot's depth image [m].
        camera: The robot's camera.
        robot_pose: Pose of the camera, camera to world.
        person: The person, a `warpvis.Agent`.
        moves: Motion of each object of `MOVING` since the world was loaded, a 4x4 matrix.

    Returns:
        A line of text, and pictures by the names of their displays.
    """
    labels = wv.classify(depth, camera, robot_pose, spheres=make_spheres(scene, moves))
    floor = wv.floor_map(wv.back_project(depth, camera, robot_pose), labels, bounds=BOUNDS)
    shown = set(labels.numpy().ravel().tolist())

    poses = [[*moves[name][:3, 3], *np.roll(quaternion_from_matrix(moves[name]), -1)] for name in MOVING]
    robot = wv.Agent("robot", camera, robot_pose, body="robot")
    seen = wv.perspective(scene, [robot, person], objects=["ball", *list(MOVING)[:2]], object_poses=poses)
    states = zip(seen.objects, seen.states("robot", "person")[0], strict=True)
    view = wv.render(scene, LOOK, person.poses, object_poses=poses, outputs="labels", exclude="person")

    words = [f"the {name}" for name, label in (("ball", wv.Label.OBJECT), ("person", wv.Label.HUMAN)) if label in shown]
    line = f"depth image: {' and '.join(words) or 'neither ball nor person'}"
    line += "".join(f"; {WHO[state]} the {name}" for name, state in states)
    images = {"labels": COLORS[labels.numpy()[0]], "floor map": floor.rgb()[0, ::-1]}
    return line, {**images, "person's view": COLORS[view.labels.numpy()[0]]}


def matrix_of(node):
    """Return the node-to-world matrix of a node of the simulation."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(node.getOrientation(), (3, 3))
    matrix[:3, 3] = node.getPosition()
    return matrix


def show(display, image):
    """Show a picture on a display."""
    height, width, _ = image.shape
    handle = display.imageNew(image.tobytes(), display.RGB, width, height)
    display.imagePaste(handle, 0, 0, False)
    display.imageDelete(handle)


def run(robot):
    """Run until the simulation ends: print changes, and show the pictures."""
    period = 4 * int(robot.getBasicTimeStep())
    range_finder = robot.getDevice("range-finder")
    range_finder.enable(period)
    eye = DepthEye(range_finder, robot=robot)
    scene = load(robot.getWorldPath())
    nodes = {name: robot.getFromDef(definition) for name, definition in MOVING.items()}
    starts = {name: np.linalg.inv(matrix_of(node)) for name, node in nodes.items()}
    eyes = robot.getFromDef("EYES")
    displays = {name: robot.getDevice(name) for name in ("labels", "floor map", "person's view")}
    last = ""
    robot.step(period)
    while robot.step(period) != -1:
        moves = {name: matrix_of(node) @ starts[name] for name, node in nodes.items()}
        person = wv.Agent.human("person", matrix_of(eyes), body="person", convention="ros_body")  # along x, z up
        line, pictures = watch(scene, eye.depth(), eye.camera, eye.pose(), person, moves)
        if line != last:
            print(line)
        last = line
        for name, display in displays.items():
            if display is not None:
                show(display, pictures[name])


def run_without_webots():
    """Print the controller's output for every world, with depth images rendered by warpvis."""
    from warpvis.scenes import EXPERIMENTS

    for experiment in EXPERIMENTS:
        path = Path(__file__).parents[2] / "worlds" / f"{experiment.name}.wbt"
        world = load_webots(path)
        device = world.devices["range-finder"]
        depth = render_range(world, "range-finder", webots_version="header")
        moves = dict.fromkeys(MOVING, np.eye(4))
        person = wv.Agent.human("person", experiment.human_pose, body="person")
        line, _ = watch(load(path), depth, device.camera, device.pose, person, moves)
        print(f"{path.name}: {line}")


if __name__ == "__main__":
    try:
        from controller import Supervisor  # Webots' package, which is available to its controllers only
    except ImportError:
        run_without_webots()
    else:
        run(Supervisor())
