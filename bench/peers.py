# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Define methods that render the same views, warpvis and its peers, behind one interface.

A method is a function of the work to do. It builds its acceleration structures, rays and buffers, which is not timed,
and returns two callables: the first renders all views in the library's own format and is timed; the second converts
that format to depth images for comparison. Every peer is used in the fastest way available to its users. A method that
cannot run raises.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from glob import glob
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.core.threads import core_count

Prepared = tuple[Callable[[], Any], Callable[[Any], NDArray]]
"""The call to time, and a function that returns its depth images ``(V, H, W)``: planar [m], +inf without a hit."""

_LLVM_FOLDERS = (
    "/usr/lib/*-linux-gnu",
    "/usr/lib/llvm*/lib",
    "/usr/lib64",
    "/usr/lib64/llvm*/lib",
    "/usr/lib",
    "/usr/local/lib",
    "/usr/local/opt/llvm/lib",
    "/opt/homebrew/opt/llvm/lib",
)

# OpenGL's near plane [m]. It must be nearer than anything in view, because clipped surfaces occlude nothing.
_GL_NEAR = 1e-3


# Number of objects from which peers receive the triangles of all objects as one mesh.
_MANY_OBJECTS = 1000


def joined(scene: wv.Scene) -> wv.Scene:
    """Return a scene with one object that has all triangles in the world frame."""
    first = np.cumsum([0] + [len(item.vertices) for item in scene])
    faces = np.concatenate([item.faces + start for item, start in zip(scene, first, strict=False)])
    still = wv.Scene(device=scene.device)
    still.add((np.concatenate([item.vertices for item in scene]), faces))
    return still


@dataclass(frozen=True)
class Work:
    """Views of a scene that every method has to render."""

    scene: wv.Scene
    camera: wv.Camera
    poses: NDArray[np.float32]
    """Camera to world, rows ``x y z qx qy qz qw``, shape ``(V, 7)``."""

    @cached_property
    def still(self) -> wv.Scene:
        """Return a scene of the same triangles without movable objects: the scene itself, or one merged object.

        Peers have no movable objects, or require a call for each.
        """
        return joined(self.scene) if self.scene.movable or len(self.scene) > _MANY_OBJECTS else self.scene

    def first(self, count: int) -> Work:
        """Return the first views."""
        return self if count >= len(self.poses) else Work(self.scene, self.camera, self.poses[:count])

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of views, height and width."""
        return len(self.poses), self.camera.height, self.camera.width

    @cached_property
    def matrices(self) -> NDArray[np.float64]:
        """Camera to world, shape ``(V, 4, 4)``."""
        return poses_to_matrices(self.poses)

    @cached_property
    def directions(self) -> NDArray[np.float32]:
        """Rays of all pixels in row-major order, of length 1 along the optical axis, ``(V, H * W, 3)``."""
        y, x = np.indices(self.shape[1:]).reshape(2, -1)
        pixels = self.camera.back_project(np.stack([x, y], axis=-1) + 0.5, np.ones(len(x)))
        return (pixels @ self.matrices[:, :3, :3].transpose(0, 2, 1)).astype(np.float32)

    @property
    def origins(self) -> NDArray[np.float32]:
        """Origins of these rays, ``(V, H * W, 3)``, a view without memory."""
        return np.broadcast_to(self.poses[:, None, :3], self.directions.shape)

    def as_images(self, depth: NDArray) -> NDArray:
        """Return depth of all rays as images."""
        return depth.reshape(self.shape)


@dataclass(frozen=True)
class Method:
    """One row of the table."""

    title: str
    prepare: Callable[[Work], Prepared]
    packages: tuple[str, ...]
    """Packages whose versions are reported."""
    max_views: int = sys.maxsize
    """Maximum number of views per round; slow methods are measured on the first ones."""
    culls: bool = False
    """Whether it hits triangles from behind, which matters if a camera is inside a mesh."""


def warpvis(work: Work, *outputs: Any, caster: Any = "packets", **options: Any) -> Prepared:
    """Return this library's method, by default for depth."""
    renderer = wv.Renderer(work.scene, work.camera, outputs=outputs or ("depth",), caster=caster, **options)
    views = renderer.render(work.poses)
    return lambda: renderer.render(work.poses, out=views), lambda result: result.depth.numpy()


def open3d(work: Work) -> Prepared:
    """Return Open3D's RaycastingScene: Embree, single rays, on all cores."""
    import open3d as o3d

    caster = o3d.t.geometry.RaycastingScene(nthreads=core_count())
    for item in work.still:
        caster.add_triangles(item.vertices, item.faces.astype(np.uint32))
    rays = o3d.core.Tensor(np.concatenate([work.origins, work.directions], axis=-1))
    return lambda: caster.cast_rays(rays), lambda result: work.as_images(result["t_hit"].numpy())


def embreex(work: Work) -> Prepared:
    """Return Embree with single rays on one core, without the conversions of trimesh's `RayMeshIntersector`."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene()
    for item in work.still:
        TriangleMesh(scene, item.vertices, item.faces)
    origins = np.ascontiguousarray(work.origins).reshape(-1, 3)
    directions = work.directions.reshape(-1, 3)

    return (
        lambda: scene.run(origins, directions, query="DISTANCE"),
        lambda length: work.as_images(np.where(length < 1e30, length, np.inf)),
    )


def mitsuba(work: Work) -> Prepared:
    """Return Mitsuba's LLVM variant: Embree's packets of 16 coherent rays, on all cores.

    Packets of 4x4 pixels are a quarter faster than rows of 16. Reordering those pixels is not timed.
    """
    mi, dr = _import_mitsuba()
    dr.set_thread_count(core_count())
    scene = mi.load_dict({"type": "scene", **{f"m{i}": _mitsuba_mesh(mi, o) for i, o in enumerate(work.still)}})
    y, x = np.indices(work.shape[1:]).reshape(2, -1)
    order = np.lexsort((x % 4, y % 4, x // 4, y // 4))
    origins, directions = (array[:, order].reshape(-1, 3).T for array in (work.origins, work.directions))
    rays = mi.Ray3f(mi.Point3f(origins), mi.Vector3f(directions))
    dr.eval(rays)

    def run() -> Any:
        length = scene.ray_intersect_preliminary(rays, coherent=True).t
        dr.eval(length)
        dr.sync_thread()
        return length

    def depth(length: Any) -> NDArray:
        ordered = np.empty(work.directions.shape[:2], dtype=np.float32)
        ordered[:, order] = np.array(length).reshape(ordered.shape)
        return work.as_images(ordered)

    return run, depth


def mujoco_rays(work: Work) -> Prepared:
    """Return MuJoCo's mj_multiRay: double precision, on one core."""
    mujoco, model, data = _load_mujoco(work)
    origins = work.matrices[:, :3, 3]
    directions = work.directions.astype(np.float64).reshape(len(origins), -1)
    lengths = np.empty(work.directions.shape[:2])
    geoms = np.empty(lengths.shape[1], dtype=np.int32)

    def run() -> NDArray:
        for origin, rays, out in zip(origins, directions, lengths, strict=True):
            mujoco.mj_multiRay(model, data, origin, rays, None, True, -1, geoms, out, None, len(out), mujoco.mjMAXVAL)
        return lengths

    return run, lambda result: work.as_images(np.where(result < 0, np.inf, result))


def mujoco_renderer(work: Work) -> Prepared:
    """Return MuJoCo's Renderer: OpenGL, on a machine without a GPU by Mesa's llvmpipe on all cores."""
    mujoco, model, data = _load_mujoco(work)
    if not hasattr(mujoco, "GLContext"):
        raise RuntimeError("no OpenGL library")
    far = 2 * float(np.linalg.norm(work.still.bounds)) + 2 * float(np.abs(work.poses[:, :3]).max())
    model.vis.map.znear, model.vis.map.zfar = _GL_NEAR / model.stat.extent, far / model.stat.extent
    renderer = mujoco.Renderer(model, work.camera.height, work.camera.width)
    renderer.enable_depth_rendering()
    renderer.scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = False  # two-sided, like all others
    to_opengl = np.diag([1.0, -1.0, -1.0])
    rotations = (work.matrices[:, :3, :3] @ to_opengl).reshape(-1, 9)
    images = np.empty(work.shape, dtype=np.float32)

    def run() -> NDArray:
        for pose, rotation, out in zip(work.poses, rotations, images, strict=True):
            data.cam_xpos[0], data.cam_xmat[0] = pose[:3], rotation
            renderer.update_scene(data, camera=0)
            renderer.render(out=out)
        return images

    return run, lambda result: np.where(result < 0.999 * far, result, np.inf)


def find_llvm() -> str | None:
    """Return the newest LLVM shared library in the usual folders: Dr.Jit does not find it by Debian's name."""
    found = {}
    for folder in _LLVM_FOLDERS:
        for path in glob(f"{folder}/libLLVM[-.]*"):
            name = re.fullmatch(r"libLLVM[-.](?:so\.|dylib\.)?(\d+).*|libLLVM\.dylib", Path(path).resolve().name)
            if name:
                found[path] = int(name[1] or 0)
    return max(found, key=found.__getitem__, default=None)


def _import_mitsuba() -> tuple[Any, Any]:
    llvm = find_llvm()
    if llvm:
        os.environ.setdefault("DRJIT_LIBLLVM_PATH", llvm)
    import drjit
    import mitsuba

    try:
        mitsuba.set_variant("llvm_ad_rgb")
    except ImportError:
        raise RuntimeError("no LLVM shared library; set DRJIT_LIBLLVM_PATH") from None
    return mitsuba, drjit


def _mitsuba_mesh(mi: Any, item: wv.SceneObject) -> Any:
    mesh = mi.Mesh(item.name, len(item.vertices), len(item.faces))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = item.vertices.ravel()
    parameters["faces"] = item.faces.astype(np.uint32).ravel()
    parameters.update()
    return mesh


def _import_mujoco() -> Any:
    if sys.platform == "linux":
        os.environ.setdefault("MUJOCO_GL", "egl")  # read when mujoco is imported
    try:
        import mujoco
    except AttributeError:  # PyOpenGL found no library; rays need none
        os.environ["MUJOCO_GL"] = "disable"
        import mujoco
    return mujoco


def _load_mujoco(work: Work) -> tuple[Any, Any, Any]:
    """Return MuJoCo, and the scene as its model: a mesh geom for every object, and one camera."""
    mujoco, camera = _import_mujoco(), work.camera
    spec = mujoco.MjSpec()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = camera.width, camera.height
    spec.visual.quality.offsamples = 0  # multisampling would average depth across edges
    for i, item in enumerate(work.still):
        spec.add_mesh(
            name=f"m{i}",
            uservert=item.vertices.astype(np.float64).ravel(),
            userface=item.faces.ravel(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"m{i}", contype=0, conaffinity=0)
    spec.worldbody.add_camera(fovy=np.degrees(camera.vfov))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return mujoco, model, data


BASELINE = "**warpvis** `packets`, depth"
"""The row with which others are compared."""

_OWN = ("warpvis", "warp-lang")

METHODS = (
    Method(BASELINE, warpvis, _OWN),
    Method(f"{BASELINE}, 1 thread", partial(warpvis, threads=1), _OWN),
    Method(f"{BASELINE}, back faces culled", partial(warpvis, cull_backfaces=True), _OWN, culls=True),
    Method(
        f"{BASELINE}, points, labels and objects",
        lambda work: warpvis(work, "depth", "points", "labels", "segmentation"),
        _OWN,
    ),
    Method("**warpvis** `rays`, depth", partial(warpvis, caster="rays"), _OWN, max_views=16),
    Method("Mitsuba `llvm_ad_rgb`, Embree's coherent packets", mitsuba, ("mitsuba", "drjit")),
    Method("Open3D `RaycastingScene`, Embree", open3d, ("open3d",)),
    Method("embreex, 1 thread", embreex, ("embreex",)),
    Method("`mujoco.Renderer`, OpenGL", mujoco_renderer, ("mujoco",), max_views=16),
    Method("MuJoCo `mj_multiRay`, 1 thread", mujoco_rays, ("mujoco",), max_views=4),
)
"""All rows, in order."""
