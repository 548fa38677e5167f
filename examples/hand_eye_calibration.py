# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Find where the overhead camera of aloha is mounted, from depth images at known joint positions and the robot's model.

The scene is aloha_pot of the package mujoco-warp, the camera a D405. Its pose is known within 5 degrees and 5 cm only.
The pot is in the images, but not in the model. Prints errors before and after; writes hand_eye_calibration.png.
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

file = importlib.resources.files("mujoco_warp") / "test_data" / "aloha_pot" / "scene.xml"
model = mujoco.MjModel.from_xml_path(str(file))
data = mujoco.MjData(model)
built = scene_from_mujoco(model)
meshes = {item.name: model.geom_dataid[geom] for item, geom in zip(built.scene, built.geom_ids, strict=False)}
# The cameras are inside their housings.
housings = [name for name, mesh in meshes.items() if mesh >= 0 and "d405" in model.mesh(int(mesh)).name]
pot = [name for name in meshes if name.startswith("partnet")]
robot = built.scene
sensor = wv.sensors.realsense_d405(424, 240)
camera = sensor.camera()


def moved(pose, step):
    """Return a pose after a twist: a rotation about its own origin and a translation, along the axes of the world."""
    result = pose.copy()
    result[:3, :3] = Rotation.from_rotvec(step[:3]).as_matrix() @ pose[:3, :3]
    result[:3, 3] += step[3:]
    return result


def twist(pose, other):
    """Return the twist from a pose to another."""
    turned = Rotation.from_matrix(other[:3, :3] @ pose[:3, :3].T).as_rotvec()
    return np.concatenate([turned, other[:3, 3] - pose[:3, 3]])


def calibrate(depth, pose, object_poses):
    """Return the camera pose that fits all images.

    Views are registered independently from the same pose. Their twists are averaged with the information matrices of
    the views as weights, and the next round starts from the average.
    """
    for distance in (0.15, 0.1):
        found = wv.register(
            robot,
            camera,
            depth,
            pose[None],
            sigma=sensor,
            object_poses=object_poses,
            exclude=[*housings, *pot],
            max_distance=distance,
        )
        information, refined = found.H.numpy(), poses_to_matrices(found.poses.numpy())
        twists = np.array([twist(pose, other) for other in refined])
        weighted = np.einsum("vij,vj->i", information, twists)
        pose = moved(pose, np.linalg.solve(information.sum(axis=0), weighted))
    return pose


rng = np.random.default_rng(0)
objects = []
for key in range(model.nkey):
    mujoco.mj_resetDataKeyframe(model, data, key)
    for first in (0, 8):
        data.qpos[first : first + 6] += rng.uniform(-0.1, 0.1, 6)
    mujoco.mj_forward(model, data)
    objects.append(geom_poses(data, built))
truth = poses_to_matrices(camera_poses(data, model, [model.camera("overhead_cam").id]))[0]
turn, way = (vector / np.linalg.norm(vector) for vector in rng.normal(size=(2, 3)))
start = moved(truth, np.concatenate([np.radians(5) * turn, 0.05 * way]))
objects = np.array(objects)
poses = np.repeat(truth[None], len(objects), axis=0)
depth = wv.render(
    robot, camera, poses, outputs="depth", object_poses=objects, exclude=housings, sensor=sensor, seed=1
).depth.numpy()
result = calibrate(depth, start, objects)
one = calibrate(depth[:1], start, objects[:1])
for name, pose in (("before", start), ("one image", one), (f"{len(depth)} images", result)):
    error = twist(truth, pose)
    print(f"{name}: {1000 * np.linalg.norm(error[3:]):.2f} mm, {np.degrees(np.linalg.norm(error[:3])):.3f} degrees")

figure = Figure(figsize=(12, 2.6), layout="constrained")
axes = figure.subplots(1, 3)
measured = np.where(np.isfinite(depth[1]), depth[1], np.nan)
images = [axes[0].imshow(measured, cmap="turbo", vmin=0.5, vmax=1.3)]
axes[0].set_title("measured depth [m]")
for axis, name, pose in zip(axes[1:], ("before", "after"), (start, result), strict=True):
    model_depth = wv.render(robot, camera, pose, outputs="depth", object_poses=objects[1], exclude=[*housings, *pot])
    images.append(axis.imshow(1000 * (measured - model_depth.depth.numpy()[0]), cmap="RdBu", vmin=-100, vmax=100))
    axis.set_title(f"minus model [mm], {name}")
for axis in axes:
    axis.set_axis_off()
figure.colorbar(images[0], ax=axes[0])
figure.colorbar(images[1], ax=axes[1:])
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "hand_eye_calibration.png", dpi=80)
