# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Color and depth of thousands of worlds by Newton's `SensorCamera`, the peer of gpu_worlds.py.

Newton shows the same geoms in the same poses, as far as its model can: the ground is an endless plane, and the only
light is directional and without highlights.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray


@lru_cache(maxsize=1)
def _model(path: Path, groups: tuple[int, ...], worlds: int, device: str) -> tuple[Any, Any, list[int]]:
    """Return Newton's model of many worlds, its sensor with a light, and MuJoCo's index of each of its bodies."""
    import newton as nt
    from newton.sensors import SensorCamera

    one, all_worlds = nt.ModelBuilder(), nt.ModelBuilder()
    one.default_bvh_cfg.mesh_constructor = "sah"  # the fastest one
    spec = mujoco.MjSpec.from_file(str(path))
    for geom in [geom for geom in spec.geoms if geom.group not in groups]:
        spec.delete(geom)
    spec.meshdir, spec.texturedir = (
        str((path.parent / folder).resolve()) for folder in (spec.meshdir, spec.texturedir)
    )
    model = spec.compile()
    with TemporaryDirectory() as folder:
        (file := Path(folder, "model.xml")).write_text(spec.to_xml())
        one.add_mjcf(str(file), parse_visuals=True)
    for shape in range(one.shape_count):
        if not one.shape_flags[shape] & nt.ShapeFlags.SITE:
            one.shape_flags[shape] |= nt.ShapeFlags.VISIBLE  # those that collide, too
    all_worlds.replicate(one, worlds)
    with wp.ScopedDevice(device):
        newton_model = all_worlds.finalize(device=device)
        sensor = SensorCamera(newton_model)
        sensor.create_default_light(enable_shadows=True)
    names = {model.body(body).name: body for body in range(1, model.nbody)}
    bodies = [next(body for name, body in names.items() if label.endswith(f"/{name}")) for label in one.body_label]
    return newton_model, sensor, bodies


def renderer(
    path: Path,
    groups: tuple[int, ...],
    poses: tuple[NDArray[np.float32], NDArray[np.float32]],
    camera: str,
    size: int,
    device: wp.Device,
    *,
    shadows: bool,
) -> tuple[list[Callable[[], None]], wp.array]:
    """Return ways to update all shapes and render color and depth of a fixed camera in all worlds, and their depth.

    `poses` are positions and MuJoCo's quaternions of all bodies, shapes ``(worlds, bodies, 3)`` and ``(..., 4)``.
    """
    from newton.sensors import SensorCamera

    worlds = len(poses[0])
    model, sensor, bodies = _model(path, groups, worlds, str(device))
    positions, quaternions = (values[:, bodies].reshape(worlds * len(bodies), -1) for values in poses)
    state = model.state()
    state.body_q.assign(np.hstack([positions, np.roll(quaternions, -1, axis=1)]))
    data = mujoco.MjData(mj_model := mujoco.MjModel.from_xml_path(str(path)))
    mujoco.mj_forward(mj_model, data)
    index, quaternion = mj_model.camera(camera).id, np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, data.cam_xmat[index])
    pose = np.array([*data.cam_xpos[index], *quaternion[1:], quaternion[0]], dtype=np.float32)
    with wp.ScopedDevice(device):
        cameras = wp.array(np.tile(pose, (worlds, 1)), dtype=wp.transformf)
        fov = float(np.radians(mj_model.cam_fovy[index]))
        rays = SensorCamera.compute_camera_rays_pinhole(size, size, camera_fov=fov, device=device)
        color = sensor.allocate_image_color(worlds, size, size)
        depth = sensor.allocate_image_depth_forward(worlds, size, size)

    def way(order: int) -> Callable[[], None]:
        config = SensorCamera.RenderConfig(
            render_order=order, enable_textures=True, enable_shadows=shadows, enable_backface_culling=True
        )

        def call() -> None:
            with wp.ScopedDevice(device):
                model.bvh_refit_shapes(state)
                sensor.update(state, cameras, rays, color_image=color, forward_depth_image=depth, render_config=config)

        return call

    return [way(SensorCamera.RenderOrder.PIXEL_PRIORITY), way(SensorCamera.RenderOrder.TILED)], depth
