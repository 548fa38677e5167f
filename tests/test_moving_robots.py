# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The scene of moving robots for lidars in many worlds."""

import mujoco
import numpy as np

import warpvis as wv
from warpvis.mujoco import Kinematics, geom_poses, scene_from_mujoco
from warpvis.scenes.robots import moving_robots_xml, robot_joints


def test_lidar_in_worlds_of_moving_robots_matches_mj_ray():
    model = mujoco.MjModel.from_xml_string(moving_robots_xml(robots=5, obstacles=6))
    joints = robot_joints(3, robots=5)
    assert joints.shape == (3, model.nq)
    made = scene_from_mujoco(model)
    poses = Kinematics(model).from_qpos(joints)
    lidar = wv.sensors.lidars.even(6, (-0.4, 0.4), increment=np.radians(6), far=60.0)
    matrices = np.tile(np.eye(4), (3, 1, 1))
    matrices[:, :3, :3] = poses.site_xmat[:, 0].reshape(-1, 3, 3)
    matrices[:, :3, 3] = poses.site_xpos[:, 0]
    views = wv.render(made.scene, lidar, matrices, object_poses=geom_poses(poses, made), world_index=[0, 1, 2])
    found = views.depth.numpy().reshape(3, -1)
    data, hit = mujoco.MjData(model), np.zeros(1, dtype=np.int32)
    seen = set()
    for world in range(3):
        data.qpos[:] = joints[world]
        mujoco.mj_forward(model, data)
        turn, place = data.site_xmat[0].reshape(3, 3), data.site_xpos[0]
        for ray, direction in enumerate(lidar.directions.reshape(-1, 3)):
            distance = mujoco.mj_ray(model, data, place, turn @ direction, None, 1, -1, hit)
            seen.add(int(hit[0]))
            expected = np.inf if distance < 0 else distance
            np.testing.assert_allclose(found[world, ray], expected, rtol=2e-5, err_msg=f"{world} {ray}")
    robots = {geom for geom in seen if geom >= 0 and model.geom_bodyid[geom] > 1}
    assert len(robots) > 4 and -1 in seen
