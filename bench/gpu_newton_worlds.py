# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Color of thousands of worlds by Newton's `SensorCamera`, the peer of gpu_worlds.py.

Newton reads the model itself. It renders one directional light without highlights and the ground as an endless plane,
and lays free bodies elsewhere: less work than the other renderers have.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import warp as wp


@lru_cache(maxsize=1)
def _worlds(path: Path, count: int, device: str) -> tuple[Any, Any, Any]:
    """Return a model of many worlds of an MJCF file, its state, and its sensor with a light."""
    import newton as nt
    from newton.sensors import SensorCamera

    one, all_worlds = nt.ModelBuilder(), nt.ModelBuilder()
    one.default_bvh_cfg.mesh_constructor = "sah"  # the fastest one
    one.add_mjcf(str(path), parse_visuals=True)
    all_worlds.replicate(one, count)
    with wp.ScopedDevice(device):
        model = all_worlds.finalize(device=device)
        state = model.state()
        nt.eval_fk(model, model.joint_q, model.joint_qd, state)
        sensor = SensorCamera(model)
        sensor.create_default_light(enable_shadows=True)
    return model, state, sensor


def renderer(
    path: Path, worlds: int, camera: str, size: int, device: wp.Device, *, shadows: bool
) -> Callable[[], None]:
    """Return a call that updates all shapes and renders color and depth of a fixed camera in all worlds."""
    from newton.sensors import SensorCamera

    model, state, sensor = _worlds(path, worlds, str(device))
    data = mujoco.MjData(mj_model := mujoco.MjModel.from_xml_path(str(path)))
    mujoco.mj_forward(mj_model, data)
    index, quaternion = mj_model.camera(camera).id, np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, data.cam_xmat[index])
    pose = np.array([*data.cam_xpos[index], *quaternion[1:], quaternion[0]], dtype=np.float32)
    with wp.ScopedDevice(device):
        poses = wp.array(np.tile(pose, (worlds, 1)), dtype=wp.transformf)
        fov = float(np.radians(mj_model.cam_fovy[index]))
        rays = SensorCamera.compute_camera_rays_pinhole(size, size, camera_fov=fov, device=device)
        color = sensor.allocate_image_color(worlds, size, size)
        depth = sensor.allocate_image_depth_forward(worlds, size, size)
    config = SensorCamera.RenderConfig(
        render_order=SensorCamera.RenderOrder.PIXEL_PRIORITY,  # the faster one
        enable_textures=True,
        enable_shadows=shadows,
        enable_backface_culling=True,
    )

    def call() -> None:
        with wp.ScopedDevice(device):
            model.bvh_refit_shapes(state)
            sensor.update(state, poses, rays, color_image=color, forward_depth_image=depth, render_config=config)

    return call
