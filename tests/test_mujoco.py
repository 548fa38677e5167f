# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Comparison with MuJoCo: `mj_ray` in double precision, and its OpenGL renderer."""

import mujoco
import numpy as np
import pytest

import warpvis as wv
from warpvis import scenes
from warpvis.core.poses import poses_to_matrices

NAMES = [experiment.name for experiment in scenes.EXPERIMENTS]


def mujoco_model(scene, camera):
    """Return a model with the scene's meshes as geoms, in the same order, and the camera on a mocap body."""
    spec = mujoco.MjSpec()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = camera.width, camera.height
    spec.visual.quality.offsamples = 0
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 50.0
    spec.stat.extent = 1.0
    for item in scene:
        mesh = spec.add_mesh(name=item.name)
        mesh.uservert, mesh.userface = item.vertices.ravel(), item.faces.ravel()
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=item.name, name=item.name)
    body = spec.worldbody.add_body(name="eye", mocap=True)
    body.add_camera(name="eye", fovy=np.degrees(camera.vfov))
    model = spec.compile()
    assert [model.geom(i).name for i in range(model.ngeom)] == [item.name for item in scene]
    return model, mujoco.MjData(model)


def place_camera(model, data, pose):
    """Set the camera's mocap body; MuJoCo's cameras look along -z with y up."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, (poses_to_matrices(pose)[:3, :3] @ np.diag([1, -1, -1])).ravel())
    data.mocap_pos[0], data.mocap_quat[0] = pose[:3], quaternion
    mujoco.mj_forward(model, data)


@pytest.mark.parametrize("name", [*NAMES, "room"])
def test_pixels_match_mj_ray(name, device):
    preset = scenes.PRESETS[name]
    scene = preset.build(device)
    camera = wv.Camera.from_fov(80, 60, hfov=0.994837)
    pose = preset.poses()[0]
    model, data = mujoco_model(scene, camera)
    mujoco.mj_forward(model, data)
    views = wv.render(scene, camera, pose)
    y, x = np.mgrid[:60, :80] + 0.5
    rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)
    lengths = np.linalg.norm(rays, axis=-1)
    world = (rays / lengths[..., None]) @ poses_to_matrices(pose)[:3, :3].T

    depth, geom, hit = np.full((60, 80), np.inf), np.full((60, 80), -1), np.zeros(1, dtype=np.int32)
    origin = pose[:3].astype(np.float64)
    for pixel in np.ndindex(60, 80):
        distance = mujoco.mj_ray(model, data, origin, world[pixel], None, 1, -1, hit)
        if distance >= 0:
            depth[pixel], geom[pixel] = distance / lengths[pixel], hit[0]

    got = views.depth.numpy()[0].astype(np.float64)
    hits = np.isfinite(depth)
    # MuJoCo stores meshes relative to their centers in single precision, which shifts silhouettes.
    assert (np.isfinite(got) != hits).mean() <= 1e-3
    both = hits & np.isfinite(got)
    error = np.abs(got[both] - depth[both])
    assert np.median(error) < 1e-6
    assert (error > 1e-5 * np.maximum(1, depth[both])).mean() <= 1e-3
    assert (views.segmentation.numpy()[0] != geom).mean() <= 1e-3


def away_from_silhouettes(depth, reach=2, step=0.03):
    """Return pixels whose neighbors have similar depth; OpenGL and ray casting round edges to different pixels."""
    limited = np.where(np.isfinite(depth), depth, 1e3)
    padded = np.pad(limited, reach, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * reach + 1, 2 * reach + 1))
    return np.ptp(windows, axis=(2, 3)) < step * limited + step


@pytest.mark.smoke("experiment_1")
@pytest.mark.gl
@pytest.mark.parametrize("name", [*NAMES, "room"])
def test_depth_and_segmentation_match_mujoco_renderer(name):
    preset = scenes.PRESETS[name]
    scene = preset.build()
    camera = wv.Camera.from_fov(320, 240, hfov=0.994837, far=49.0)
    pose = preset.poses()[0].astype(np.float64)
    model, data = mujoco_model(scene, camera)
    place_camera(model, data, pose)
    with mujoco.Renderer(model, camera.height, camera.width) as renderer:
        renderer.update_scene(data, camera="eye")
        renderer.enable_depth_rendering()
        depth = renderer.render().copy()
        renderer.disable_depth_rendering()
        renderer.enable_segmentation_rendering()
        segmentation = renderer.render()
    geom = np.where(segmentation[..., 1] == mujoco.mjtObj.mjOBJ_GEOM, segmentation[..., 0], -1)

    views = wv.render(scene, camera, pose)
    got, objects = views.depth.numpy()[0], views.segmentation.numpy()[0]
    compared = away_from_silhouettes(got) & np.isfinite(got)
    assert compared.mean() > 0.3
    error = np.abs(got - depth)[compared]
    assert np.median(error) < 1e-4
    assert np.quantile(error, 0.99) < 2e-3
    assert (objects == geom).mean() >= 0.995
