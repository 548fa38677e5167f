# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Define workloads that process images on a GPU or render other kinds of images, against plain depth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import warp as wp
from bench_visibility import things
from gpu_timing import Run
from gpu_work import subject_of, timer_of
from ratios import Contest, Workload

import warpvis as wv

_VIEWS = 256
_READOUT = 0.03  # rolling-shutter readout time [s]


class Images:
    """Depth of a preset's views, and the inputs of the functions to measure."""

    def __init__(self, name: str, views: int, device: wp.Device) -> None:
        """Render depth."""
        subject = subject_of(name, str(device))
        self.scene, self.camera, self.poses = subject.scene, subject.preset.camera, subject.poses(views)
        self.renderer = wv.Renderer(self.scene, self.camera, outputs="depth")
        self.views = self.renderer.render(self.poses)

    def render(self) -> None:
        """Render depth, the baseline."""
        self.renderer.render(self.poses, out=self.views)

    def other(self, *outputs: str) -> Run:
        """Return the call that renders other outputs."""
        renderer = wv.Renderer(self.scene, self.camera, outputs=outputs)
        return partial(renderer.render, self.poses, out=renderer.render(self.poses))

    def moving(self) -> Run:
        """Return the call that renders depth of a moving rolling-shutter camera."""
        camera = wv.sensors.RollingShutter(self.camera, _READOUT)
        rows = self.poses.numpy()
        motion = wv.sensors.Motion([rows, rows + np.float32([0.05, 0, 0.02, 0, 0, 0, 0])], [0, _READOUT])
        renderer = wv.Renderer(self.scene, camera, outputs="depth")
        return partial(renderer.render, motion, out=renderer.render(motion))

    def back_project(self) -> Run:
        """Return the call that computes points of depth."""
        points = wv.back_project(self.views.depth, self.camera, self.poses)
        return lambda: wv.back_project(self.views.depth, self.camera, self.poses, out=points)

    def classify(self) -> Run:
        """Return the call that labels pixels by their depth."""
        spheres = wv.scenes.PRESETS["experiment_3"].spheres
        labels = wv.classify(self.views.depth, self.camera, self.poses, spheres=spheres)
        return lambda: wv.classify(self.views.depth, self.camera, self.poses, spheres=spheres, out=labels)

    def floor_map(self) -> Run:
        """Return the call that computes a floor map of points and labels."""
        views = wv.render(self.scene, self.camera, self.poses, outputs=("points", "labels"))
        return lambda: wv.floor_map(views.points, views.labels, bounds=self.scene.bounds)

    def voxel_map(self) -> Run:
        """Return the call that computes a voxel map of depth."""
        bounds = self.scene.bounds
        voxels = wv.voxel_map(self.views.depth, self.camera, self.poses, bounds=bounds)
        return lambda: wv.voxel_map(self.views.depth, self.camera, self.poses, bounds=bounds, out=voxels)

    def occupancy_map(self) -> Run:
        """Return the call that integrates depth into an occupancy map that contains it already."""
        occupancy = wv.OccupancyMap(0.02, device=self.scene.device)
        return lambda: occupancy.integrate(self.views.depth, self.camera, self.poses, sigma=0.01)

    def object_visibility(self) -> Run:
        """Return the call that counts the pixels of objects."""
        return partial(wv.object_visibility, self.scene, self.camera, self.poses, objects=things(self.scene))

    def best_views(self) -> Run:
        """Return the call that sorts the views by the visibility of an object."""
        name = self.scene.objects[things(self.scene)[0]].name
        return lambda: wv.planning.best_views(self.scene, self.camera, self.poses, objects=[name])


MADE: dict[str, Callable[[Images], Run]] = {
    "color": lambda images: images.other("color"),
    "albedo": lambda images: images.other("albedo"),
    "moving": Images.moving,
    "back_project": Images.back_project,
    "classify": Images.classify,
    "floor_map": Images.floor_map,
    "voxel_map": Images.voxel_map,
    "occupancy_map": Images.occupancy_map,
    "object_visibility": Images.object_visibility,
    "best_views": Images.best_views,
}


def workloads(device: wp.Device, views: int | None = None) -> Iterator[Workload]:
    """Yield all workloads in the room, and those that trace rays also with more triangles."""

    def prepare(scene: str, name: str) -> Contest:
        images = Images(scene, views or _VIEWS, device)
        return Contest(MADE[name](images), {"depth": [images.render]}, timer_of(device))

    for name in MADE:
        yield Workload(f"images room {name}", partial(prepare, "room", name))
    for name in ("color", "object_visibility"):
        yield Workload(f"images blobs_77k {name}", partial(prepare, "blobs_77k", name))
