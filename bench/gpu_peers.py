# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Define the methods of gpu.py that use Warp: this library, a minimal kernel, mujoco-warp and Newton.

All receive one mesh of all objects, which is faster for them than many meshes, and poses on the device. Work once per
scene (acceleration structures) or once per camera (rays) is not timed, nor is the conversion of poses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import gpu_kernels
import numpy as np
import warp as wp
from gpu_work import Case, Method, Prepared, Subject, recorded
from numpy.typing import NDArray

import warpvis as wv
from warpvis.core.poses import poses_to_opencv, quaternion_product

BASELINE = "**warpvis**, depth"
"""The row with which others are compared."""
EVERYTHING = "**warpvis**, depth, points, labels and objects"
BARE = "`wp.mesh_query_ray`, a thread a pixel, depth"

TREES = (("sah", 64), ("sah", 128), ("cubql", 64))
"""Warp's BVH constructors and block sizes with which the bare kernel is measured."""

_OWN = ("warpvis", "warp-lang")

# Number of movable objects up to which the rays caster is measured.
_MAX_ASKED = 100

# Rotates a camera that looks along +z (OpenCV) to one that looks along -z (OpenGL).
_HALF_TURN = np.array([1.0, 0.0, 0.0, 0.0])


def warpvis(case: Case, *outputs: Any, host: bool = False, **options: Any) -> Prepared:
    """Return the method of this library, optionally with poses on the host."""
    if options.get("caster") == "rays" and len(case.subject.scene.movable) > _MAX_ASKED:
        raise RuntimeError(f"each ray asks every movable object, {len(case.subject.scene.movable)} here")
    renderer = wv.Renderer(case.subject.scene, case.camera, outputs=outputs or ("depth",), **options)
    poses = case.poses if host or case.device.is_cpu else case.device_poses
    views = renderer.render(poses)
    return Prepared(
        run=lambda: renderer.render(poses, out=views),
        depth=lambda count: views.depth[:count].numpy(),
        views=case.views,
        timer=case.timer,
        image=views.depth,
        note=f"`{renderer.caster}`",
    )


def bare(case: Case, constructor: str, block: int) -> Prepared:
    """Return a kernel that queries Warp's mesh for the first hit of every pixel's ray, in single precision."""
    mesh = warp_mesh(case.subject, constructor)
    image = wp.empty(case.shape, dtype=wp.float32, device=case.device)
    inputs = [mesh.id, case.intrinsics, case.camera.far, case.device_poses, image]
    run = recorded(gpu_kernels.query_depth, case.shape, inputs, case.device, block)
    return Prepared(run, lambda count: image[:count].numpy(), case.views, case.timer, image)


def mujoco_warp(case: Case, refit: bool, cull: bool) -> Prepared:
    """Return mujoco-warp's batch renderer, depth only, with one world per view."""
    import mujoco_warp as mjw

    model, device_model, data = case.subject.keep(("mujoco", case.shape), lambda: _mujoco_model(case))
    context = case.subject.keep(("mujoco", case.shape, cull), lambda: _mujoco_context(case, model, cull))

    def run() -> None:
        with wp.ScopedDevice(case.device):
            if refit:
                mjw.refit_bvh(device_model, data, context)
            mjw.render(device_model, data, context)

    def depth(count: int) -> NDArray[np.float32]:
        images = context.depth_data[:count].numpy().reshape(count, *case.shape[1:])
        return np.where(images == 0, np.inf, images)  # 0 marks pixels without a hit

    return Prepared(run, depth, case.views, case.timer, context.depth_data)


def newton(case: Case, order: str, cull: bool, constructor: str | None) -> Prepared:
    """Return Newton's SensorCamera, planar depth only, with all views in one world."""
    from newton.sensors import SensorCamera

    _model, state, camera = case.subject.keep(("newton", constructor), lambda: _newton_model(case, constructor))
    rays = SensorCamera.compute_camera_rays_pinhole(
        case.camera.width, case.camera.height, camera_fov=case.camera.vfov, device=case.device
    )
    poses = wp.array(_opengl_poses(case), dtype=wp.transformf, device=case.device)
    worlds = wp.zeros(case.views, dtype=wp.int32, device=case.device)
    image = camera.allocate_image_depth_forward(case.views, case.camera.width, case.camera.height)
    config = SensorCamera.RenderConfig(
        render_order=SensorCamera.RenderOrder[order], enable_backface_culling=cull, max_distance=case.camera.far
    )

    def run() -> None:
        with wp.ScopedDevice(case.device):
            camera.update(state, poses, rays, forward_depth_image=image, world_indices=worlds, render_config=config)

    def depth(count: int) -> NDArray[np.float32]:
        images = image[:count].numpy()
        return np.where(images == 0, np.inf, images)  # 0 marks pixels without a hit

    return Prepared(run, depth, case.views, case.timer, image)


def methods() -> Iterator[Method]:
    """Return all ways to use these libraries."""
    yield Method("warpvis", BASELINE, "", warpvis, _OWN)
    yield Method("warpvis", "**warpvis** `rays`, depth", "", lambda case: warpvis(case, caster="rays"), _OWN)
    yield Method("warpvis", "**warpvis** `packets`, depth", "", lambda case: warpvis(case, caster="packets"), _OWN)
    yield Method("warpvis", f"{BASELINE}, poses of the host", "", lambda case: warpvis(case, host=True), _OWN)
    yield Method(
        "warpvis", EVERYTHING, "", lambda case: warpvis(case, "depth", "points", "labels", "segmentation"), _OWN
    )
    culled = f"{BASELINE}, back faces culled"
    yield Method("warpvis", culled, "", lambda case: warpvis(case, cull_backfaces=True), _OWN, culls=True)
    for constructor, block in TREES:
        variant = f"{constructor} tree, blocks of {block}"
        yield Method("bare", BARE, variant, _with(bare, constructor, block), ("warp-lang",))
    for refit in (False, True):
        row = f"mujoco-warp {'`refit_bvh` and ' if refit else ''}`render`"
        for cull in (False, True):
            variant = "culled" if cull else "two-sided"
            packages = ("mujoco-warp", "mujoco")
            yield Method("mujoco-warp", row, variant, _with(mujoco_warp, refit, cull), packages, culls=cull)
    for cull in (False, True):
        row = f"Newton `SensorCamera`{', back faces culled' if cull else ''}"
        for order in ("PIXEL_PRIORITY", "TILED", "VIEW_PRIORITY"):
            for tree in (None, "sah", "cubql"):
                variant = f"{order}, {tree or 'default'} tree"
                yield Method("newton", row, variant, _with(newton, order, cull, tree), ("newton",), culls=cull)


def _with(prepare: Callable[..., Prepared], *arguments: Any) -> Callable[[Case], Prepared]:
    return lambda case: prepare(case, *arguments)


def warp_mesh(subject: Subject, constructor: str) -> wp.Mesh:
    """Return Warp's mesh of all triangles of a scene, which is built once."""

    def build() -> wp.Mesh:
        points = wp.array(subject.vertices, dtype=wp.vec3, device=subject.device)
        indices = wp.array(subject.faces.ravel(), dtype=wp.int32, device=subject.device)
        return wp.Mesh(points, indices, bvh_constructor=constructor)

    return subject.keep(("bare", constructor), build)


def _opengl_poses(case: Case) -> NDArray[np.float32]:
    """Return the poses of cameras that look along -z."""
    rows = poses_to_opencv(case.poses)
    return np.concatenate([rows[:, :3], quaternion_product(rows[:, 3:], _HALF_TURN)], axis=1).astype(np.float32)


def _mujoco_model(case: Case) -> tuple[Any, Any, Any]:
    """Return the scene as one mesh geom, the same on the device, and its data with a camera pose per world."""
    import mujoco
    import mujoco_warp as mjw

    camera, subject = case.camera, case.subject
    spec = mujoco.MjSpec()
    spec.add_mesh(
        name="scene",
        uservert=subject.vertices.astype(np.float64).ravel(),
        userface=subject.faces.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="scene", contype=0, conaffinity=0)
    spec.worldbody.add_camera(fovy=np.degrees(camera.vfov), resolution=[camera.width, camera.height])
    model = spec.compile()
    model.vis.map.zfar = camera.far / model.stat.extent
    host = mujoco.MjData(model)
    mujoco.mj_forward(model, host)
    rotations = case.matrices[:, None, :3, :3] @ np.diag([1.0, -1.0, -1.0])
    with wp.ScopedDevice(case.device):
        data = mjw.put_data(model, host, nworld=case.views)
        data.cam_xpos.assign(case.poses[:, None, :3])
        data.cam_xmat.assign(rotations.astype(np.float32))
        return model, mjw.put_model(model), data


def _mujoco_context(case: Case, model: Any, cull: bool) -> Any:
    import mujoco_warp as mjw

    with wp.ScopedDevice(case.device):
        return mjw.create_render_context(
            model,
            nworld=case.views,
            cam_res=(case.camera.width, case.camera.height),
            render_rgb=False,
            render_depth=True,
            render_seg=False,
            use_textures=False,
            enable_backface_culling=cull,
        )


def _newton_model(case: Case, constructor: str | None) -> tuple[Any, Any, Any]:
    import newton as nt
    from newton.sensors import SensorCamera

    builder = nt.ModelBuilder()
    builder.default_bvh_cfg.mesh_constructor = constructor
    mesh = nt.Mesh(case.subject.vertices, case.subject.faces.ravel(), compute_inertia=False)
    builder.add_shape_mesh(body=-1, mesh=mesh)
    with wp.ScopedDevice(case.device):
        model = builder.finalize(device=case.device)
        return model, model.state(), SensorCamera(model, load_textures=False)
