# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What gpu.py gives every method to do, and how it finds out that what they made is the same picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any

import numpy as np
import warp as wp
from gpu_timing import HostTimer, Run, Timer, WarpTimer
from numpy.typing import NDArray

import warpvis as wv
from warpvis.core.poses import poses_to_matrices

# Pixels that are compared with the reference's.
_CHECKED_PIXELS = 600_000

# Depth counts as the same up to here [m].
_TOLERANCE = 1e-3

# Silhouettes may differ: rasterisers round corners to a fraction of a pixel. An image half a pixel aside does not pass.
_MIN_HITS = 0.99
_MIN_SAME = 0.95
_GREATEST_MEDIAN = 1e-4


class Subject:
    """A preset's scene on a device, with what methods make of it and can use for another image size."""

    def __init__(self, name: str, device: wp.Device) -> None:
        """Build the scene."""
        self.preset = wv.scenes.PRESETS[name]
        self.device = device
        self.scene = self.preset.build(device)
        first = np.cumsum([0] + [len(item.vertices) for item in self.scene])
        self.vertices: NDArray[np.float32] = np.concatenate([item.vertices for item in self.scene])
        faces = [item.faces + start for item, start in zip(self.scene, first, strict=False)]
        self.faces: NDArray[np.int32] = np.concatenate(faces).astype(np.int32)
        self._kept: dict[Any, Any] = {}

    @property
    def still(self) -> wv.Scene:
        """The same triangles, none of which moves: where many move, the reference takes an age."""
        return self.keep("still", self._make_still) if self.scene.movable else self.scene

    def _make_still(self) -> wv.Scene:
        still = wv.Scene(device=self.device)
        still.add((self.vertices, self.faces))
        return still

    def poses(self, count: int) -> wp.array:
        """Return camera poses on the device, as casters take them without a copy."""
        return self.keep(
            ("poses", count),
            lambda: wp.array(_poses(self.preset.pose_rows, count), dtype=wp.transform, device=self.device),
        )

    def keep(self, key: Any, make: Callable[[], Any]) -> Any:
        """What `make` makes, which is made once."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]


@cache
def subject_of(name: str, device: str) -> Subject:
    """Return a preset's scene on a device, which is built once."""
    return Subject(name, wp.get_device(device))


def timer_of(device: wp.Device) -> Timer:
    """Return what times Warp's work on a device."""
    return HostTimer() if device.is_cpu else WarpTimer(device)


def recorded(kernel: wp.Kernel, dim: tuple[int, ...], inputs: list[Any], device: wp.Device, block_dim: int) -> Run:
    """Return a launch that is packed once, and keeps its arrays alive."""
    command = wp.launch(kernel, dim, inputs, device=device, block_dim=block_dim, record_cmd=True)

    def run(held: list[Any] = inputs) -> None:
        command.launch()

    return run


@dataclass(frozen=True)
class Case:
    """Views of a scene that every method has to make."""

    subject: Subject
    camera: wv.Camera
    views: int

    @classmethod
    def of(cls, subject: Subject, width: int, height: int, views: int) -> Case:
        """Views through a camera of the preset's horizontal field of view."""
        old = subject.preset.camera
        return cls(subject, wv.Camera.from_fov(width, height, hfov=old.hfov, near=old.near, far=old.far), views)

    @property
    def device(self) -> wp.Device:
        """Where the views are to be made."""
        return self.subject.device

    @property
    def shape(self) -> tuple[int, int, int]:
        """Views, height and width."""
        return self.views, self.camera.height, self.camera.width

    @property
    def checked(self) -> int:
        """Views that are compared with the reference's."""
        return max(1, min(self.views, _CHECKED_PIXELS // (self.camera.width * self.camera.height)))

    @cached_property
    def poses(self) -> NDArray[np.float32]:
        """Camera to world, rows ``x y z qx qy qz qw``, shape ``(V, 7)``."""
        return _poses(self.subject.preset.pose_rows, self.views)

    @property
    def device_poses(self) -> wp.array:
        """The same on the device."""
        return self.subject.poses(self.views)

    @cached_property
    def matrices(self) -> NDArray[np.float64]:
        """Camera to world, shape ``(V, 4, 4)``."""
        return poses_to_matrices(self.poses)

    @property
    def intrinsics(self) -> wp.vec4:
        """The camera for gpu_kernels.py."""
        return wp.vec4(self.camera.fx, self.camera.fy, self.camera.cx, self.camera.cy)

    @property
    def timer(self) -> Timer:
        """How Warp's work is timed."""
        return timer_of(self.device)

    @cached_property
    def truths(self) -> dict[bool, NDArray[np.float32]]:
        """Depth of the first views by the reference, the `rays` caster: two-sided, and with back faces culled."""
        poses = self.poses[: self.checked]
        return {
            culls: wv.render(
                self.subject.still, self.camera, poses, outputs=("depth",), caster="rays", cull_backfaces=culls
            ).depth.numpy()
            for culls in (False, True)
        }


@cache
def _poses(pose_rows: Callable[[int], NDArray], count: int) -> NDArray[np.float32]:
    """Poses, which take seconds for thousands, and which presets share."""
    return pose_rows(count).astype(np.float32)


@dataclass(frozen=True)
class Prepared:
    """A method that has built its trees, rays and buffers."""

    run: Callable[[], Any]
    """Queues the work of all views: what is timed."""
    depth: Callable[[int], NDArray[np.float32]]
    """Depth images of the first views of the last call, planar, in metres, +inf where nothing is."""
    views: int
    """How many views a call makes."""
    timer: Timer
    image: wp.array | None = None
    """Where the call writes, if it is always the same place: it is filled with NaN before the check."""
    note: str = ""


@dataclass(frozen=True)
class Method:
    """One way to use one library."""

    group: str
    """The library."""
    row: str
    """The table's row that shows the best of the ways of the same row."""
    variant: str
    """What tells it from those."""
    prepare: Callable[[Case], Prepared]
    packages: tuple[str, ...] = ()
    """Whose versions matter."""
    culls: bool = False
    """Whether it sees through triangles from behind, which is another picture where a camera is inside a mesh."""

    @property
    def title(self) -> str:
        """What messages call it."""
        return f"{self.row} ({self.variant})" if self.variant else self.row


@dataclass
class Agreement:
    """How much a depth image is the reference's."""

    hits: float
    """Share of pixels on which both hit something or both do not."""
    median: float
    """Median difference [m] where both do."""
    same: float
    """Share of pixels with the same depth within a millimetre."""

    @property
    def right(self) -> bool:
        """Whether it is the same picture."""
        return self.hits >= _MIN_HITS and self.same >= _MIN_SAME and self.median <= _GREATEST_MEDIAN

    def __str__(self) -> str:
        return f"hit/miss agree {self.hits:.3%}, median difference {self.median:.1e} m, same depth {self.same:.3%}"


def agreement(depth: NDArray, truth: NDArray, camera: wv.Camera) -> Agreement:
    """Compare depth images, after what lies out of the camera's range is marked as warpvis marks it."""
    depth = np.where(depth < camera.near, -np.inf, np.where(depth > camera.far, np.inf, depth))
    kinds, true_kinds = _kinds(depth), _kinds(truth)
    both = (kinds == 0) & (true_kinds == 0)
    difference = np.abs(depth[both].astype(np.float64) - truth[both])
    same = np.count_nonzero(difference <= _TOLERANCE) + np.count_nonzero((kinds == true_kinds) & ~both)
    return Agreement(
        hits=float(np.mean(kinds == true_kinds)),
        median=float(np.median(difference)) if difference.size else np.inf,
        same=float(same / truth.size),
    )


def _kinds(depth: NDArray) -> NDArray[np.int8]:
    """0 for a depth, 1 for nothing seen, -1 for too near, 2 for what is no number."""
    return np.select([np.isfinite(depth), np.isnan(depth), depth > 0], [0, 2, 1], -1).astype(np.int8)


@dataclass
class Result:
    """What one method did with one case."""

    method: Method
    case: str
    views: int = 0
    missing: str = ""
    """Why it could not run, if it could not."""
    note: str = ""
    agreement: Agreement | None = None
    first_seconds: float = 0.0
    """The device's time for a call, measured once."""
    device_seconds: list[float] = field(default_factory=list)
    """The device's time for a call, one a round; empty if the method was not measured further."""
    graph_seconds: list[float] = field(default_factory=list)
    """The same when the call is replayed as a CUDA graph."""
    wall_seconds: list[float] = field(default_factory=list)
    """Time of a call for who waits for it."""
    graph_missing: str = ""
    """Why there is no graph."""

    @property
    def right(self) -> bool:
        """Whether it ran and made the reference's picture."""
        return not self.missing and self.agreement is not None and self.agreement.right

    @property
    def seconds(self) -> float:
        """The device's time for a call: the median round, by whichever of call and graph is faster; inf if unknown."""
        medians = [float(np.median(times)) for times in (self.device_seconds, self.graph_seconds) if times]
        return min(medians, default=self.first_seconds or np.inf)

    @property
    def fps(self) -> float:
        """Frames per second; 0 if unknown."""
        return self.views / self.seconds if self.views else 0.0

    @property
    def wall_fps(self) -> float:
        """Frames per second for who waits for every call; 0 if unknown."""
        return self.views / float(np.median(self.wall_seconds)) if self.wall_seconds else 0.0
