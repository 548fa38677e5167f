# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure visible fractions of 64 bodies in 8 cameras of many worlds against counting pixels of segmentation images.

    MUJOCO_GL=egl python bench/visible_fractions.py [--device cpu] [--worlds 8] [--sizes 128x128 320x240]

Bodies are boxes, balls, cylinders and capsules at random places of a furnished room of a MuJoCo model. Peers render
segmentation images of all views: `mujoco.Renderer` on a CPU, MuJoCo Warp on a GPU, and warpvis itself. A segmentation
image has the pixels of a body, and thus its share of the image, but not its visible fraction, which needs the pixels
that the body would have by itself: an image more for each body. Both are measured, "share" and "fraction"; the latter
as the time of one image times one more than the number of bodies. Prints a Markdown table [ms].
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import warp as wp
from gpu_work import timer_of
from machine import describe
from numpy.typing import NDArray
from timing import take_turns

import warpvis as wv
from warpvis.visibility import FractionMeter

_KINDS = ("box", "sphere", "cylinder", "capsule")
_ROUNDS = 7


def room(bodies: int, cameras: int) -> mujoco.MjModel:
    """Return a model of a floor, walls, furniture, and bodies with free joints, seen by cameras along its walls."""
    rng, parts = np.random.default_rng(0), ['<geom name="floor" type="plane" size="3 3 0.1"/>']
    for x, y, a, b in ((3, 0, 0.05, 3), (-3, 0, 0.05, 3), (0, 3, 3, 0.05), (0, -3, 3, 0.05)):
        parts.append(f'<geom type="box" size="{a} {b} 1.3" pos="{x} {y} 1.3"/>')
    for _ in range(30):
        size, place = rng.uniform(0.1, 0.4, 3), rng.uniform(-2, 2, 2)
        parts.append(f'<geom type="box" size="{size[0]} {size[1]} {size[2]}" pos="{place[0]} {place[1]} {size[2]}"/>')
    for number in range(bodies):
        a, b = rng.uniform(0.03, 0.08), rng.uniform(0.03, 0.1)
        size = f"{a} {b} {a}" if number % 4 == 0 else f"{a} {b}"
        shape = f'<geom name="body{number}" type="{_KINDS[number % 4]}" size="{size}"/>'
        parts.append(f'<body name="body{number}" pos="0 0 1"><freejoint/>{shape}</body>')
    for number in range(cameras):
        angle = 2 * np.pi * number / cameras
        x, y = 2.6 * np.cos(angle), 2.6 * np.sin(angle)
        axes = f"{-np.sin(angle)} {np.cos(angle)} 0 {-0.6 * np.cos(angle)} {-0.6 * np.sin(angle)} 0.8"
        parts.append(f'<camera name="eye{number}" pos="{x} {y} 2.2" xyaxes="{axes}" fovy="60"/>')
    visual = '<visual><global offwidth="640" offheight="480"/><quality offsamples="0" shadowsize="0"/></visual>'
    return mujoco.MjModel.from_xml_string(f"<mujoco>{visual}<worldbody>{''.join(parts)}</worldbody></mujoco>")


def joints(model: mujoco.MjModel, worlds: int) -> NDArray[np.float64]:
    """Return joint positions of worlds, in which all bodies are at random places."""
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(worlds, model.nq // 7, 7))
    rows[..., :3] = rng.uniform((-2, -2, 0.05), (2, 2, 0.9), (*rows.shape[:2], 3))
    rows[..., 3:] /= np.linalg.norm(rows[..., 3:], axis=-1, keepdims=True)
    return rows.reshape(worlds, model.nq)


class Study:
    """The calls to compare, for images of one size."""

    def __init__(self, bodies: int, cameras: int, worlds: int, size: tuple[int, int], device: str) -> None:
        """Place the bodies of all worlds."""
        self.width, self.height = size
        self.model, self.device = room(bodies, cameras), wp.get_device(device)
        self.qpos, self.names = joints(self.model, worlds), [f"body{k}" for k in range(bodies)]
        self.states = [mujoco.MjData(self.model) for _ in range(worlds)]
        for data, row in zip(self.states, self.qpos, strict=True):
            data.qpos = row
            mujoco.mj_forward(self.model, data)
        made = wv.mujoco.scene_from_mujoco(self.model, device=device)
        self.scene = made.scene
        self.camera = wv.mujoco.camera_from_mujoco(self.model, 0, self.width, self.height)
        poses = np.stack([wv.mujoco.geom_poses(data, made) for data in self.states])
        self.eyes = wv.mujoco.camera_poses(self.states[0], self.model, range(cameras))
        rows = np.tile(self.eyes, (worlds, 1))
        index = np.repeat(np.arange(worlds, dtype=np.int32), cameras)
        self.poses = wp.array(rows, dtype=wp.transform, device=self.device)
        self.worlds = {
            "object_poses": wp.array(poses, dtype=wp.transform, device=self.device),
            "world_index": wp.array(index, dtype=wp.int32, device=self.device),
        }

    def calls(self) -> dict[str, Callable[[], Any]]:
        """Return the calls by name; those of segmentation images count the pixels of all bodies."""
        found = {f"warpvis, at least {least} samples": self.fractions(least) for least in (1, 256)}
        found["warpvis, segmentation"] = self.own_segmentation()
        if self.device.is_cpu:
            found["mujoco.Renderer, segmentation"] = self.mujoco_segmentation()
        else:
            found["MuJoCo Warp, segmentation"] = self.mujoco_warp_segmentation()
        return found

    def fractions(self, least: int) -> Callable[[], Any]:
        """Return a call that measures fractions."""
        meter = FractionMeter(self.scene, self.camera, objects=self.names, min_samples=least, canvas=(0, 0, 0, 0))
        return lambda: meter.measure(self.poses, **self.worlds)

    def single_seconds(self) -> float:
        """Return the median time of one body in one camera [s]."""
        meter = FractionMeter(self.scene, self.camera, objects=self.names[:1], min_samples=1)
        meter.measure(self.eyes[0])
        return float(np.median(take_turns([lambda: meter.measure(self.eyes[0])], _ROUNDS)))

    def own_segmentation(self) -> Callable[[], Any]:
        """Return a call that renders segmentation images and counts their pixels."""
        renderer = wv.Renderer(self.scene, self.camera, outputs=("segmentation",))
        counts = wp.zeros((len(self.poses), len(self.scene)), dtype=wp.int32, device=self.device)
        views = renderer.render(self.poses, **self.worlds)

        def call() -> Any:
            renderer.render(self.poses, **self.worlds, out=views)
            if self.device.is_cpu:
                return [
                    np.bincount(image.ravel() + 1, minlength=len(self.scene) + 1)
                    for image in views.segmentation.numpy()
                ]
            counts.zero_()
            wp.launch(count_pixels, views.segmentation.shape, [views.segmentation, counts], device=self.device)
            return counts

        return call

    def mujoco_segmentation(self) -> Callable[[], Any]:
        """Return a call that renders segmentation images by OpenGL and counts their pixels."""
        renderer = mujoco.Renderer(self.model, self.height, self.width)
        renderer.enable_segmentation_rendering()

        def call() -> Any:
            found = []
            for data in self.states:
                for camera in range(len(self.eyes)):
                    renderer.update_scene(data, camera)
                    found.append(np.bincount(renderer.render()[..., 0].ravel() + 1, minlength=self.model.ngeom + 1))
            return found

        return call

    def mujoco_warp_segmentation(self) -> Callable[[], Any]:
        """Return a call that moves all objects, renders segmentation images and counts their pixels."""
        import mujoco_warp as mjw

        worlds, cameras = len(self.states), len(self.eyes)
        with wp.ScopedDevice(self.device):
            model, data = mjw.put_model(self.model), mjw.put_data(self.model, self.states[0], nworld=worlds)
            data.qpos.assign(self.qpos.astype(np.float32))
            mjw.kinematics(model, data)
            mjw.com_pos(model, data)
            mjw.camlight(model, data)
            size = (self.width, self.height)
            context = mjw.create_render_context(
                self.model, nworld=worlds, cam_res=size, render_rgb=False, render_depth=False, render_seg=True
            )
            images = wp.empty((worlds, self.height, self.width), dtype=wp.vec2i)
            counts = wp.zeros((cameras, worlds, self.model.ngeom), dtype=wp.int32)

        def call() -> Any:
            with wp.ScopedDevice(self.device):
                mjw.refit_bvh(model, data, context)
                mjw.render(model, data, context)
                counts.zero_()
                for camera in range(cameras):
                    mjw.get_segmentation(context, camera, images)
                    wp.launch(count_pairs, images.shape, [images, counts[camera]])
            return counts

        return call


@wp.kernel
def count_pixels(segmentation: wp.array3d[wp.int32], counts_out: wp.array2d[wp.int32]):
    view, y, x = wp.tid()
    index = segmentation[view, y, x]
    if index >= 0:
        wp.atomic_add(counts_out, view, index, 1)


@wp.kernel
def count_pairs(segmentation: wp.array3d[wp.vec2i], counts_out: wp.array2d[wp.int32]):
    view, y, x = wp.tid()
    index = segmentation[view, y, x][0]
    if index >= 0:
        wp.atomic_add(counts_out, view, index, 1)


def measure(study: Study) -> dict[str, float]:
    """Return the median time of each call [s]."""
    calls = study.calls()
    for call in calls.values():
        call()
        call()
    if study.device.is_cpu:
        return dict(zip(calls, map(np.median, take_turns(list(calls.values()), _ROUNDS)), strict=True))
    timer = timer_of(study.device)
    graphs = {name: timer.record(call) for name, call in calls.items()}
    rounds = [{name: timer.device_seconds(graph, 5) for name, graph in graphs.items()} for _ in range(_ROUNDS)]
    return {name: float(np.median([times[name] for times in rounds])) for name in calls}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--worlds", type=int, default=8)
    parser.add_argument("--cameras", type=int, default=8)
    parser.add_argument("--bodies", type=int, default=64)
    parser.add_argument("--sizes", nargs="+", default=["128x128", "320x240"])
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    print(
        f"{describe(['mujoco', 'warp-lang'])}; {options.device}, {options.bodies} bodies in "
        f"{options.cameras} cameras of {options.worlds} worlds\n"
    )
    print("| size | call | ms | warpvis is faster in shares | in fractions |\n|---|---|---:|---:|---:|")
    for size in options.sizes:
        study = Study(options.bodies, options.cameras, options.worlds, tuple(map(int, size.split("x"))), options.device)
        times = measure(study)
        own = times["warpvis, at least 1 samples"]
        for name, seconds in times.items():
            ratios = f"{seconds / own:.1f} | {seconds * (options.bodies + 1) / own:.0f}" if "segm" in name else " | "
            print(f"| {size} | {name} | {seconds * 1e3:.1f} | {ratios} |", flush=True)
        if study.device.is_cpu:
            print(f"| {size} | warpvis, one body in one camera | {study.single_seconds() * 1e3:.2f} | | |", flush=True)


if __name__ == "__main__":
    main()
