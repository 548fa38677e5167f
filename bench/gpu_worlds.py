# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure thousands of worlds of a MuJoCo model on a GPU: `BatchRenderer` against MuJoCo Warp's renderer.

    python bench/gpu_worlds.py [MODEL.xml ...] [--worlds 4096] [--sizes 64 128] [--cameras NAME ...]

The default model is MuJoCo Warp's aloha_pot. Joint positions differ between worlds. A call updates all objects from the
poses in MuJoCo Warp's data and renders depth of one camera in all worlds: `refit_bvh` and `render` there,
`BatchRenderer.render` here, each captured in a CUDA graph. Prints a Markdown table with the agreement of the images.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import product
from pathlib import Path
from typing import Any

import gpu_newton_worlds
import mujoco
import numpy as np
import warp as wp
from gpu_work import timer_of
from numpy.typing import NDArray
from ratios import Contest, Workload

from warpvis.mujoco import BatchRenderer
from warpvis.mujoco._scene import DEFAULT_MESH_TOLERANCE

_ROUNDS = 9
_GROUPS = (0, 1, 2)

# Cases of gpu_all.py: worlds, roll of the camera [rad], side of the image [px].
_WORKLOADS = (
    *((4096, 0.0, 64), (4096, 0.0, 128), (2048, 0.0, 64), (1024, 0.0, 64)),
    *((4096, 0.01, 64), (4096, 0.2, 64)),
)


def random_joints(model: mujoco.MjModel, worlds: int) -> NDArray[np.float32]:
    """Return joint positions, shape ``(worlds, nq)``: random in the middle half of the range of hinges and slides."""
    rng = np.random.default_rng(0)
    qpos = np.tile(model.qpos0, (worlds, 1))
    for joint in range(model.njnt):
        if int(model.jnt_type[joint]) not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            continue
        low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-1.0, 1.0)
        middle, reach = (low + high) / 2, (high - low) / 4
        qpos[:, model.jnt_qposadr[joint]] = rng.uniform(middle - reach, middle + reach, worlds)
    return qpos.astype(np.float32)


@dataclass(frozen=True)
class Placed:
    """A model, and MuJoCo Warp's model and data of many worlds, with computed poses of geoms and cameras."""

    model: mujoco.MjModel
    warp_model: Any
    data: Any
    device: wp.Device

    @classmethod
    def of(cls, model: mujoco.MjModel, qpos: NDArray[np.float32], device: wp.Device) -> Placed:
        """Set joint positions of all worlds, shape ``(worlds, nq)``."""
        import mujoco_warp as mjw

        host = mujoco.MjData(model)
        mujoco.mj_forward(model, host)
        with wp.ScopedDevice(device):
            m, data = mjw.put_model(model), mjw.put_data(model, host, nworld=len(qpos))
            data.qpos.assign(qpos)
            mjw.kinematics(m, data)
            mjw.com_pos(m, data)
            mjw.camlight(m, data)
        return cls(model, m, data, device)


class Pair:
    """Both renderers, for depth or color of one camera in all worlds."""

    def __init__(
        self,
        placed: Placed,
        camera: str,
        size: int,
        *,
        mesh_tolerance: float = DEFAULT_MESH_TOLERANCE,
        color: bool = False,
        shadows: bool = False,
    ) -> None:
        """Prepare to render square images of `size` pixels a side: depth, or color and depth."""
        import mujoco_warp as mjw

        self.placed, self.camera, self.worlds = placed, camera, placed.data.nworld
        self.batch = BatchRenderer(
            placed.model,
            self.worlds,
            height=size,
            width=size,
            outputs=("color", "depth") if color else ("depth",),
            shadows=shadows,
            reflections=False,  # as MuJoCo Warp
            geom_groups=_GROUPS,
            mesh_tolerance=mesh_tolerance,
            device=placed.device,
        )
        self.views = self.batch.render(placed.data, cameras=camera)
        with wp.ScopedDevice(placed.device):
            self.context = mjw.create_render_context(
                placed.model,
                nworld=self.worlds,
                cam_res=(size, size),
                render_rgb=color,
                render_depth=True,
                render_seg=False,
                use_textures=color,
                use_shadows=shadows,
                enabled_geom_groups=list(_GROUPS),
                cam_active=[camera],
            )

    def ours(self) -> None:
        """Move all objects and render, by warpvis."""
        self.batch.render(self.placed.data, cameras=self.camera, out=self.views)

    def theirs(self) -> None:
        """Move all objects and render, by MuJoCo Warp."""
        import mujoco_warp as mjw

        mjw.refit_bvh(self.placed.warp_model, self.placed.data, self.context)
        self.their_rendering()

    def their_rendering(self) -> None:
        """Render by MuJoCo Warp, without updating its acceleration structure."""
        import mujoco_warp as mjw

        mjw.render(self.placed.warp_model, self.placed.data, self.context)

    def agreement(self) -> tuple[float, float]:
        """Return the fraction of pixels that both hit or both miss, and the median difference of depth [m]."""
        ours = self.views.depth.numpy()
        other = self.context.depth_data.numpy().reshape(ours.shape)
        both = np.isfinite(ours) & (other > 0)
        hits = float(np.mean((ours < np.inf) == (other > 0)))  # -inf: hit, but too near
        return hits, float(np.median(np.abs(ours - other)[both]))

    def same_depth(self, depth: NDArray[np.float32]) -> float:
        """Return the fraction of pixels that both hit at depths within 1 mm, given other images of the same poses."""
        ours = self.views.depth.numpy()
        both = np.isfinite(ours) & (depth.reshape(ours.shape) > 0)
        return float(np.mean(np.abs(ours - depth.reshape(ours.shape))[both] < 1e-3))

    def contest(self) -> Contest:
        """Measure both in turns, each as a CUDA graph."""
        with wp.ScopedDevice(self.placed.device):
            self.ours()
            self.theirs()
        timer, same = timer_of(self.placed.device), self.agreement()[0]
        return Contest(self.ours, {"MuJoCo Warp": [self.theirs]}, timer, same, with_graphs=True)


@lru_cache(maxsize=2)
def load(path: Path, worlds: int, device: str, roll: float = 0.0) -> Placed:
    """Set up worlds of a model file, with all cameras rolled about their optical axes [rad]."""
    model = mujoco.MjModel.from_xml_path(str(path))
    rotation = np.array([np.cos(roll / 2), 0.0, 0.0, np.sin(roll / 2)])
    for quaternion in model.cam_quat:
        mujoco.mju_mulQuat(quaternion, quaternion.copy(), rotation)
    return Placed.of(model, random_joints(model, worlds), wp.get_device(device))


def workloads(device: wp.Device, worlds: int | None = None) -> Iterator[Workload]:
    """Yield aloha_pot's worlds: two cameras, as modeled and rolled, so that views that are slow by chance show."""

    def prepare(camera: str, size: int, count: int, roll: float) -> Contest:
        return Pair(load(default_model(), count, str(device), roll), camera, size).contest()

    for count, roll, size in dict.fromkeys((worlds or count, roll, size) for count, roll, size in _WORKLOADS):
        for camera in ("overhead_cam", "teleoperator_pov"):
            rolled = f" rolled {roll:g}" if roll else ""
            name = f"worlds {camera} {size}x{size} of {count}{rolled}"
            yield Workload(name, partial(prepare, camera, size, count, roll))


def color_workloads(device: wp.Device, worlds: int | None = None) -> Iterator[Workload]:
    """Yield color and depth of aloha_pot's worlds, with textures, without shadows and with them."""

    def prepare(camera: str, size: int, count: int, shadows: bool) -> Contest:
        placed = load(default_model(), count, str(device))
        pair = Pair(placed, camera, size, color=True, shadows=shadows)
        contest = pair.contest()
        if importlib.util.find_spec("newton") is None:
            return contest
        poses = placed.data.xpos.numpy(), placed.data.xquat.numpy()
        ways, depth = gpu_newton_worlds.renderer(default_model(), _GROUPS, poses, camera, size, device, shadows=shadows)
        for way in ways:
            way()
        same = pair.same_depth(depth.numpy())
        return replace(contest, peers={**contest.peers, "Newton": ways}, same=min(contest.same, same))

    for size, camera in product((64, 128), ("teleoperator_pov", "overhead_cam")):
        for shadows in (False, True):
            count = worlds or 4096
            name = f"worlds {camera} {size}x{size} of {count} color{' with shadows' if shadows else ''}"
            yield Workload(name, partial(prepare, camera, size, count, shadows))


def compare(path: Path, camera: str, worlds: int, size: int, mesh_tolerance: float, device: str) -> dict[str, Any]:
    """Return the time per call of each [s], and the agreement of their depth."""
    pair = Pair(load(path, worlds, device), camera, size, mesh_tolerance=mesh_tolerance)
    eighth = np.arange(0, worlds, 8)
    data, batch = pair.placed.data, pair.batch
    eighth_views = batch.render(data, cameras=camera, worlds=eighth)
    calls = {
        "warpvis": pair.ours,
        "warpvis, one world in eight": lambda: batch.render(data, cameras=camera, worlds=eighth, out=eighth_views),
        "MuJoCo Warp": pair.theirs,
        "MuJoCo Warp, render alone": pair.their_rendering,
    }
    seconds = measure(calls, device)
    seconds["triangles"] = batch.scene.triangle_count
    seconds["hit by both or neither"], seconds["median difference"] = pair.agreement()
    return seconds


def measure(calls: dict[str, Any], device: str) -> dict[str, Any]:
    """Return median times of each call as a graph [s], measured in turns."""
    timer = timer_of(wp.get_device(device))
    graphs: dict[str, Any] = {}
    for name, call in calls.items():
        with wp.ScopedDevice(device):
            call()
            call()
        graphs[name] = timer.record(call) or call
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(_ROUNDS):
        for name, graph in graphs.items():
            times[name].append(timer.device_seconds(graph, 2))
    return {name: float(np.median(found)) for name, found in times.items()}


def default_model() -> Path:
    """MuJoCo Warp's aloha_pot: 204 geoms, 134 meshes, 6 cameras."""
    spec = importlib.util.find_spec("mujoco_warp")
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError("mujoco_warp is not installed", name="mujoco_warp")
    return Path(spec.origin).parent / "test_data" / "aloha_pot" / "scene.xml"


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", type=Path)
    parser.add_argument("--worlds", type=int, default=4096)
    parser.add_argument("--sizes", type=int, nargs="+", default=[64, 128])
    parser.add_argument("--cameras", nargs="*", default=[])
    parser.add_argument(
        "--mesh-tolerance", type=float, default=DEFAULT_MESH_TOLERANCE, help="of round shapes, in meters"
    )
    parser.add_argument("--device", default="cuda:0")
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    print("| model, camera, size | warpvis | one world in eight | MuJoCo Warp | render alone | times as fast | agree |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | --- |")
    for path in options.models or [default_model()]:
        names = [camera.name for camera in mujoco.MjSpec.from_file(str(path)).cameras]
        for camera in [name for name in options.cameras if name in names] or names[:1]:
            for size in options.sizes:
                found = compare(path, camera, options.worlds, size, options.mesh_tolerance, options.device)
                ours, theirs = found["warpvis"], found["MuJoCo Warp"]
                part, render_only = found["warpvis, one world in eight"], found["MuJoCo Warp, render alone"]
                print(
                    f"| {path.parent.name}/{path.name}, {camera}, {size}x{size} | {1e3 * ours:.3f} ms | "
                    f"{1e3 * part:.3f} ms ({part / ours:.2f}) | {1e3 * theirs:.3f} ms | {1e3 * render_only:.3f} ms | "
                    f"{theirs / ours:.1f}x | {100 * found['hit by both or neither']:.2f} %, "
                    f"{1e3 * found['median difference']:.3f} mm, {found['triangles']} triangles |",
                    flush=True,
                )
    return 0


if __name__ == "__main__":
    sys.exit(main())
