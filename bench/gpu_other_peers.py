# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Define the methods of gpu.py that do not use Warp: OptiX through Mitsuba, and nvdiffrast.

Inputs that cost a real program time are prepared: rays for OptiX, vertices in clip space for nvdiffrast. A last step is
not timed either: nvdiffrast's planar depth has to be computed from z/w.
"""

from __future__ import annotations

import importlib
import os
import shutil
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import gpu_kernels
import numpy as np
import warp as wp
from gpu_timing import DrJitTimer, TorchTimer
from gpu_work import Case, Method, Prepared, Subject
from numpy.typing import NDArray
from peers import find_llvm

# nvdiffrast needs 81 bytes for every triangle of every view of a call: this limits it to 11 GB.
_NVDIFFRAST_TRIANGLES = 1 << 27

# If more calls than this are needed, the first ones are measured.
_NVDIFFRAST_CALLS = 4

# Near plane. A smaller value leaves fewer digits for distant depth.
_NVDIFFRAST_NEAR = 0.01

COMPILE = "WARPVIS_COMPILE_NVDIFFRAST"
"""Environment variable that allows compiling nvdiffrast if its sources are available and its binary is not."""


def methods() -> Iterator[Method]:
    """Return all ways to use these libraries."""
    for tile in ((1, 1), (8, 4)):
        order = "rays row by row" if tile == (1, 1) else f"rays in blocks of {tile[0]}x{tile[1]}"
        packages = ("mitsuba", "drjit")
        yield Method("optix", "OptiX, by Mitsuba, rays given", order, partial(mitsuba, tile=tile), packages)
    row = "nvdiffrast `rasterize`, clip-space vertices given"
    yield Method("nvdiffrast", row, "", nvdiffrast, ("nvdiffrast", "torch"))


def mitsuba(case: Case, tile: tuple[int, int]) -> Prepared:
    """Use Mitsuba's `ray_intersect_preliminary`: on CUDA by OptiX, on the CPU by Embree."""
    mi, dr = _import_mitsuba(case.device)
    scene = case.subject.keep("mitsuba", lambda: mi.load_dict({"type": "scene", "mesh": _mesh(mi, case.subject)}))
    pixels = _pixels(case, tile)
    rays = case.subject.keep(("rays", case.shape, tile), lambda: _rays(case, pixels))  # memory shared with Dr.Jit
    coordinates = [_float(mi, rays[k]) for k in range(6)]
    ray = mi.Ray3f(mi.Point3f(*coordinates[:3]), mi.Vector3f(*coordinates[3:]))
    dr.eval(ray)
    dr.sync_thread()
    last: list[Any] = []

    def run() -> None:
        length = scene.ray_intersect_preliminary(ray, coherent=True).t
        dr.eval(length)
        last[:] = [length]

    def depth(count: int) -> NDArray[np.float32]:
        images = np.empty((count, *case.shape[1:]), dtype=np.float32)
        found = last[0].numpy()[: count * len(pixels)].reshape(count, -1)
        images[:, pixels[:, 1], pixels[:, 0]] = found
        return images

    return Prepared(run, depth, case.views, DrJitTimer(), note="Embree" if case.device.is_cpu else "")


def nvdiffrast(case: Case) -> Prepared:
    """Use the CUDA rasterizer of nvdiffrast, with as many views per call as its memory allows."""
    torch, nv = _import_nvdiffrast(case.device)
    subject, device = case.subject, wp.device_to_torch(case.device)
    batch = max(1, min(case.views, _NVDIFFRAST_TRIANGLES // len(subject.faces)))
    views = min(case.views, batch * _NVDIFFRAST_CALLS)
    corners = torch.tensor(np.pad(subject.vertices, ((0, 0), (0, 1)), constant_values=1), device=device)
    faces = torch.tensor(subject.faces, device=device)
    to_clip = torch.tensor(_to_clip(case)[:views].astype(np.float32), device=device)
    batches = [(corners @ part.transpose(1, 2)).contiguous() for part in to_clip.split(batch)]
    context = nv.RasterizeCudaContext(device=device)
    size = (case.camera.height, case.camera.width)
    last: list[Any] = []

    def run() -> None:
        with torch.no_grad():
            images = [nv.rasterize(context, vertices, faces, size, grad_db=False)[0] for vertices in batches]
        last[:] = images

    def depth(count: int) -> NDArray[np.float32]:
        images = torch.cat([image[:count, ..., 2:] for image in last])[:count].cpu().numpy()
        return _depth_of_clip(images[..., 0], case.camera.far, seen=images[..., 1] > 0)

    return Prepared(run, depth, views, TorchTimer(), note=f"{len(batches)} calls" if len(batches) > 1 else "")


def _import_mitsuba(device: wp.Device) -> tuple[Any, Any]:
    variable, library = ("LIBLLVM", find_llvm()) if device.is_cpu else ("LIBOPTIX", _find_optix())
    if library:
        os.environ.setdefault(f"DRJIT_{variable}_PATH", library)
    import drjit
    import mitsuba

    try:
        mitsuba.set_variant("llvm_ad_rgb" if device.is_cpu else "cuda_ad_rgb")
    except ImportError as error:
        raise RuntimeError(f"no {'LLVM' if device.is_cpu else 'OptiX'} library: {error}") from None
    return mitsuba, drjit


def _find_optix() -> str | None:
    """Return the path of the driver's OptiX, in the folder of the CUDA library that Warp has loaded."""
    maps = Path("/proc/self/maps")
    lines = maps.read_text().splitlines() if maps.is_file() else []
    folders = {Path(line.split(maxsplit=5)[5]).parent for line in lines if "/libcuda.so" in line}
    found = [folder / "libnvoptix.so.1" for folder in sorted(folders)]
    return next((str(path) for path in found if path.exists()), None)


def _mesh(mi: Any, subject: Subject) -> Any:
    mesh = mi.Mesh("scene", len(subject.vertices), len(subject.faces))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = subject.vertices.ravel()
    parameters["faces"] = subject.faces.astype(np.uint32).ravel()
    parameters.update()
    return mesh


def _float(mi: Any, row: wp.array) -> Any:
    """Return an array for Dr.Jit, without a copy if it accepts Warp's."""
    try:
        return mi.Float(row)
    except (TypeError, RuntimeError):
        return mi.Float(row.numpy())


def _pixels(case: Case, tile: tuple[int, int]) -> NDArray[np.int32]:
    """Return the pixels ``(x, y)`` of an image in blocks, so that the rays of a warp are coherent."""
    y, x = np.indices(case.shape[1:]).reshape(2, -1)
    width, height = tile
    order = np.lexsort((x % width, y % height, x // width, y // height))
    return np.stack([x[order], y[order]], axis=1).astype(np.int32)


def _rays(case: Case, pixels: NDArray[np.int32]) -> wp.array:
    """Return origins and directions of all rays, six rows."""
    rays = wp.empty((6, case.views * len(pixels)), dtype=wp.float32, device=case.device)
    order = wp.array(pixels, dtype=wp.vec2i, device=case.device)
    dim = (case.views, len(pixels))
    inputs = [case.intrinsics, case.device_poses, order, rays]
    wp.launch(gpu_kernels.make_rays, dim=dim, inputs=inputs, device=case.device)
    wp.synchronize_device(case.device)
    return rays


def _to_clip(case: Case) -> NDArray[np.float64]:
    """Return matrices from world to clip space, ``(V, 4, 4)``. y points down: nvdiffrast's first row is the lowest."""
    camera, near, far = case.camera, _NVDIFFRAST_NEAR, case.camera.far
    projection = np.zeros((4, 4))
    projection[0, 0], projection[0, 2] = 2 * camera.fx / camera.width, 2 * camera.cx / camera.width - 1
    projection[1, 1], projection[1, 2] = 2 * camera.fy / camera.height, 2 * camera.cy / camera.height - 1
    projection[2, 2], projection[2, 3] = (far + near) / (far - near), -2 * far * near / (far - near)
    projection[3, 2] = 1
    return projection @ np.linalg.inv(case.matrices)


def _depth_of_clip(ratio: NDArray[np.float32], far: float, seen: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return planar depth from z/w."""
    near = _NVDIFFRAST_NEAR
    depth = 2 * far * near / (far + near - ratio.astype(np.float64) * (far - near))
    return np.where(seen, depth, np.inf).astype(np.float32)


def _import_nvdiffrast(device: wp.Device) -> tuple[Any, Any]:
    if device.is_cpu:
        raise RuntimeError("it needs CUDA")
    import torch

    if not torch.cuda.is_available():
        raise RuntimeError("PyTorch sees no GPU")
    try:
        return torch, importlib.import_module("nvdiffrast.torch")
    except ImportError:
        if not os.environ.get(COMPILE):
            raise
        _compile_nvdiffrast()
        return torch, importlib.import_module("nvdiffrast.torch")


def _compile_nvdiffrast() -> None:
    """Compile the module `_nvdiffrast_c` from the sources in `nvdiffrast_csrc`; takes minutes."""
    from torch.utils import cpp_extension

    if shutil.which("nvcc") is None:
        raise RuntimeError("there is no nvcc to compile it with")
    found = [Path(folder) / "nvdiffrast_csrc" for folder in sys.path]
    folder = next((path for path in found if path.is_dir()), None)
    if folder is None:
        raise RuntimeError("its sources are not there")
    sources = [str(path) for path in sorted(folder.rglob("*")) if path.suffix in (".cpp", ".cu")]
    flags = ["-DNVDR_TORCH"]
    name = "_nvdiffrast_c"
    sys.modules[name] = cpp_extension.load(name, sources, extra_cflags=flags, extra_cuda_cflags=flags)
