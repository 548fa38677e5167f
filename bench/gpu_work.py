# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Define the views that every method of gpu.py renders, and compare their images."""

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

# Number of pixels compared with the reference.
_CHECKED_PIXELS = 600_000

# Tolerance of equal depth [m].
_TOLERANCE = 1e-3

# Silhouettes may differ: rasterizers snap vertices to a fraction of a pixel. An image displaced by half a pixel fails.
_MIN_HITS = 0.99
_MIN_SAME = 0.95
_GREATEST_MEDIAN = 1e-4


class Subject:
    """A preset's scene on a device, with data that methods derive from it and share between image sizes."""

    def __init__(self, name: str, device: wp.Device) -> None:
        """Build the scene."""
        self.preset = wv.scenes.PRESETS[name]
        self.device = device
        self.scene = self.preset.build(device)
        first = np.cumsum([0] + [len(item.vertices) for item in self.scene])
        self.vertices: NDArray[np.float32] = np.concatenate([item.vertices for item in self.scene])
        faces = [item.faces + start for item, start in zip(self.scene, first, strict=False)]
        self.faces: NDArray[np.int32] = np.concatenate(faces).astype(np.int32)
        self._cached: dict[Any, Any] = {}

    @property
    def still(self) -> wv.Scene:
        """Return the same triangles as static objects: with many movable ones the reference takes very long."""
        return self.keep("still", self._make_still) if self.scene.movable else self.scene

    def _make_still(self) -> wv.Scene:
        still = wv.Scene(device=self.device)
        still.add((self.vertices, self.faces))
        return still

    def poses(self, count: int) -> wp.array:
        """Return camera poses on the device, in the form that casters use without a copy."""
        return self.keep(
            ("poses", count),
            lambda: wp.array(_poses(self.preset.pose_rows, count), dtype=wp.transform, device=self.device),
        )

    def keep(self, key: Any, make: Callable[[], Any]) -> Any:
        """Return the result of `make`, which is called once."""
        if key not in self._cached:
            self._cached[key] = make()
        return self._cached[key]


@cache
def subject_of(name: str, device: str) -> Subject:
    """Return a preset's scene on a device, built once."""
    return Subject(name, wp.get_device(device))


def timer_of(device: wp.Device) -> Timer:
    """Return the timer of Warp's work on a device."""
    return HostTimer() if device.is_cpu else WarpTimer(device)


def recorded(kernel: wp.Kernel, dim: tuple[int, ...], inputs: list[Any], device: wp.Device, block_dim: int) -> Run:
    """Return a recorded launch that keeps its arrays alive."""
    command = wp.launch(kernel, dim, inputs, device=device, block_dim=block_dim, record_cmd=True)

    def run(held: list[Any] = inputs) -> None:
        command.launch()

    return run


@dataclass(frozen=True)
class Case:
    """Views of a scene that every method has to render."""

    subject: Subject
    camera: wv.Camera
    views: int

    @classmethod
    def of(cls, subject: Subject, width: int, height: int, views: int) -> Case:
        """Set up views through a camera with the preset's horizontal field of view."""
        old = subject.preset.camera
        return cls(subject, wv.Camera.from_fov(width, height, hfov=old.hfov, near=old.near, far=old.far), views)

    @property
    def device(self) -> wp.Device:
        """Device of the views."""
        return self.subject.device

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of views, height and width."""
        return self.views, self.camera.height, self.camera.width

    @property
    def checked(self) -> int:
        """Number of views compared with the reference."""
        return max(1, min(self.views, _CHECKED_PIXELS // (self.camera.width * self.camera.height)))

    @cached_property
    def poses(self) -> NDArray[np.float32]:
        """Camera to world, rows ``x y z qx qy qz qw``, shape ``(V, 7)``."""
        return _poses(self.subject.preset.pose_rows, self.views)

    @property
    def device_poses(self) -> wp.array:
        """The same poses on the device."""
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
        """Timer of Warp's work."""
        return timer_of(self.device)

    @cached_property
    def truths(self) -> dict[bool, NDArray[np.float32]]:
        """Depth of the first views by the reference, the `rays` caster, two-sided or with back faces culled."""
        poses = self.poses[: self.checked]
        return {
            culls: wv.render(
                self.subject.still, self.camera, poses, outputs=("depth",), caster="rays", cull_backfaces=culls
            ).depth.numpy()
            for culls in (False, True)
        }


@cache
def _poses(pose_rows: Callable[[int], NDArray], count: int) -> NDArray[np.float32]:
    """Return poses, cached: thousands take seconds, and presets share them."""
    return pose_rows(count).astype(np.float32)


@dataclass(frozen=True)
class Prepared:
    """A method with its acceleration structures, rays and buffers."""

    run: Callable[[], Any]
    """Queues the work of all views, which is timed."""
    depth: Callable[[int], NDArray[np.float32]]
    """Returns depth images of the first views of the last call: planar [m], +inf without a hit."""
    views: int
    """Number of views of a call."""
    timer: Timer
    image: wp.array | None = None
    """Output of the call, if it is always the same array: it is filled with NaN before the comparison."""
    note: str = ""


@dataclass(frozen=True)
class Method:
    """One way to use one library."""

    group: str
    """Name of the library."""
    row: str
    """Row of the table, which shows the fastest of its methods."""
    variant: str
    """Variant within the row."""
    prepare: Callable[[Case], Prepared]
    packages: tuple[str, ...] = ()
    """Packages whose versions are reported."""
    culls: bool = False
    """Whether it hits triangles from behind, which matters if a camera is inside a mesh."""

    @property
    def title(self) -> str:
        """Name in messages."""
        return f"{self.row} ({self.variant})" if self.variant else self.row


@dataclass
class Agreement:
    """Agreement of a depth image with the reference."""

    hits: float
    """Fraction of pixels that both hit or both miss."""
    median: float
    """Median difference [m] of pixels that both hit."""
    same: float
    """Fraction of pixels with the same depth within a millimeter."""

    @property
    def right(self) -> bool:
        """Whether it is the same image."""
        return self.hits >= _MIN_HITS and self.same >= _MIN_SAME and self.median <= _GREATEST_MEDIAN

    def __str__(self) -> str:
        return f"hit/miss agree {self.hits:.3%}, median difference {self.median:.1e} m, same depth {self.same:.3%}"


def agreement(depth: NDArray, truth: NDArray, camera: wv.Camera) -> Agreement:
    """Compare depth images, after marking pixels out of the camera's range as warpvis does."""
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
    """Return 0 for a depth, 1 without a hit, -1 if too near, 2 for NaN."""
    return np.select([np.isfinite(depth), np.isnan(depth), depth > 0], [0, 2, 1], -1).astype(np.int8)


@dataclass
class Result:
    """Result of one method in one case."""

    method: Method
    case: str
    views: int = 0
    missing: str = ""
    """Reason for a missing result, or empty."""
    note: str = ""
    agreement: Agreement | None = None
    first_seconds: float = 0.0
    """Device time of a call, measured once [s]."""
    device_seconds: list[float] = field(default_factory=list)
    """Device time of a call in each round [s]; empty if the method was not measured further."""
    graph_seconds: list[float] = field(default_factory=list)
    """The same for a replayed CUDA graph."""
    wall_seconds: list[float] = field(default_factory=list)
    """Latency of a call [s]."""
    graph_missing: str = ""
    """Reason for a missing graph."""

    @property
    def right(self) -> bool:
        """Whether it ran and rendered the reference's image."""
        return not self.missing and self.agreement is not None and self.agreement.right

    @property
    def seconds(self) -> float:
        """Device time of a call [s]: the median round of the call or the graph, whichever is faster; inf if unknown."""
        medians = [float(np.median(times)) for times in (self.device_seconds, self.graph_seconds) if times]
        return min(medians, default=self.first_seconds or np.inf)

    @property
    def fps(self) -> float:
        """Frames per second; 0 if unknown."""
        return self.views / self.seconds if self.views else 0.0

    @property
    def wall_fps(self) -> float:
        """Frames per second if every call is waited for; 0 if unknown."""
        return self.views / float(np.median(self.wall_seconds)) if self.wall_seconds else 0.0
