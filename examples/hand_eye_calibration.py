# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Find where two cameras of aloha are mounted, from depth images at known joint positions and the robot's model.

The scene is aloha_pot of the package mujoco-warp. The overhead camera is fixed, the other one moves with the left hand;
both are D405. Their mountings are known within 5 degrees and 5 cm only. A pot is in the images, but not in the model.
Prints errors before and after; writes hand_eye_calibration.png.
"""

import importlib.resources
import sys

import mujoco  # noqa: TID253
import numpy as np
from matplotlib.figure import Figure  # noqa: TID253
from scipy.spatial.transform import Rotation

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.mujoco import camera_poses, geom_poses, scene_from_mujoco

CAMERAS = {"overhead camera": "overhead_cam", "wrist camera": "wrist_cam_left"}
STARTS = 8  # guesses of each mounting

file = importlib.resources.files("mujoco_warp") / "test_data" / "aloha_pot" / "scene.xml"
model = mujoco.MjModel.from_xml_path(str(file))
data = mujoco.MjData(model)
built = scene_from_mujoco(model)
names = [item.name for item in built.scene]
bodies = dict(zip(names, model.geom_bodyid[list(built.geom_ids)], strict=False))
meshes = dict(zip(names, model.geom_dataid[list(built.geom_ids)], strict=False))
# The cameras are inside their housings.
housings = [name for name, mesh in meshes.items() if mesh >= 0 and "d405" in model.mesh(int(mesh)).name]
pot = [name for name in meshes if name.startswith("partnet")]
robot = built.scene
sensor = wv.sensors.realsense_d405(424, 240)
camera = sensor.camera()


def random_motions(rng, count, angle, distance):
    """Return motions by at most an angle [rad] and a distance [m], ``(count, 4, 4)``."""
    directions = rng.normal(size=(2, count, 3))
    turns, ways = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    motions = np.tile(np.eye(4), (count, 1, 1))
    motions[:, :3, :3] = Rotation.from_rotvec(angle * rng.uniform(size=(count, 1)) * turns).as_matrix()
    motions[:, :3, 3] = distance * rng.uniform(size=(count, 1)) * ways
    return motions


def calibrate(depth, frames, guess, object_poses, exclude, rng):
    """Return the camera's pose in a frame that carries it, from images at known poses of that frame.

    Starts around the guess are registered with a standard deviation of the size of their errors, and the best of them
    with that of the sensor. The images of a start are a group: its poses are those of the frame times one mounting.
    """
    guesses = guess @ np.concatenate([np.eye(4)[None], random_motions(rng, STARTS - 1, np.radians(5), 0.05)])
    poses = (frames[None] @ guesses[:, None]).reshape(-1, 4, 4)
    options = {"object_poses": object_poses, "exclude": exclude}
    rough = wv.register(
        robot,
        camera,
        np.tile(depth, (STARTS, 1, 1)),
        poses,
        sigma=0.02,
        max_distance=0.15,
        groups=np.repeat(np.arange(STARTS), len(frames)),
        world_index=np.tile(np.arange(len(frames)), STARTS),
        **options,
    )
    best = rough.poses[rough.best() :][: len(frames)]
    one = np.zeros(len(frames), dtype=int)
    found = wv.register(robot, camera, depth, best, sigma=sensor, max_distance=0.05, groups=one, **options)
    return np.linalg.inv(frames[0]) @ poses_to_matrices(found.poses.numpy())[0]


rng = np.random.default_rng(0)
figure = Figure(figsize=(12, 5.2), layout="constrained")
for row, (title, name) in zip(figure.subplots(2, 3), CAMERAS.items(), strict=True):
    identifier = model.camera(name).id
    carrier = int(model.cam_bodyid[identifier])
    objects, frames, poses = [], [], []
    for key in range(model.nkey):
        mujoco.mj_resetDataKeyframe(model, data, key)
        for first in (0, 8):
            data.qpos[first : first + 6] += rng.uniform(-0.1, 0.1, 6)
        mujoco.mj_forward(model, data)
        objects.append(geom_poses(data, built))
        frames.append(np.eye(4))
        frames[-1][:3, :3], frames[-1][:3, 3] = data.xmat[carrier].reshape(3, 3), data.xpos[carrier]
        poses.append(poses_to_matrices(camera_poses(data, model, [identifier]))[0])
    objects, frames, poses = np.array(objects), np.array(frames), np.array(poses)
    depth = wv.render(
        robot, camera, poses, outputs="depth", object_poses=objects, exclude=housings, sensor=sensor, seed=1
    ).depth.numpy()
    truth = np.linalg.inv(frames[0]) @ poses[0]
    turn, way = (vector / np.linalg.norm(vector) for vector in rng.normal(size=(2, 3)))
    start = truth.copy()
    start[:3, :3] = truth[:3, :3] @ Rotation.from_rotvec(np.radians(5) * turn).as_matrix()
    start[:3, 3] += 0.05 * way
    # The camera does not see the body that carries it, but a wrong guess may be inside of it.
    hidden = [*housings, *pot, *(item for item, body in bodies.items() if carrier and body == carrier)]
    one = calibrate(depth[:1], frames[:1], start, objects[:1], hidden, rng)
    result = calibrate(depth, frames, start, objects, hidden, rng)
    for case, found in (("before", start), ("one image", one), (f"{len(depth)} images", result)):
        error = np.linalg.inv(truth) @ found
        angle = np.degrees(Rotation.from_matrix(error[:3, :3]).magnitude())
        print(f"{title}, {case}: {1000 * np.linalg.norm(error[:3, 3]):.2f} mm, {angle:.3f} degrees")

    measured = np.where(np.isfinite(depth[1]), depth[1], np.nan)
    near, far = np.nanpercentile(measured, [1, 95])
    images = [row[0].imshow(measured, cmap="turbo", vmin=near, vmax=far)]
    row[0].set_title(f"{title}: measured depth [m]")
    for axis, case, found in zip(row[1:], ("before", "after"), (start, result), strict=True):
        modeled = wv.render(
            robot, camera, frames[1] @ found, outputs="depth", object_poses=objects[1], exclude=hidden
        ).depth.numpy()[0]
        images.append(axis.imshow(1000 * (measured - modeled), cmap="RdBu", vmin=-100, vmax=100))
        axis.set_title(f"minus model [mm], {case}")
    for axis in row:
        axis.set_axis_off()
    figure.colorbar(images[0], ax=row[0])
    figure.colorbar(images[1], ax=row[1:])
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "hand_eye_calibration.png", dpi=60)
