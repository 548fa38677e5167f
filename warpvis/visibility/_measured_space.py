# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lines of sight through space that depth cameras measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.cameras.pinhole import require_camera
from warpvis.core.arrays import check_length
from warpvis.core.kernel_cache import launch
from warpvis.core.labels import Visibility
from warpvis.core.threads import launch_images, launch_points
from warpvis.errors import ArrayError
from warpvis.maps import OccupancyMap, Voxel
from warpvis.rendering import Views

if TYPE_CHECKING:
    from warpvis.kernels.maps.occupancy_lines import LineLimits

_MARGIN_VOXELS = 2.0

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MeasuredSpace:
    """An occupancy map that may block lines of sight, and which part of the lines is examined.

    A target is OCCLUDED if a SURFACE voxel is on its line of sight, otherwise UNKNOWN if more than `max_unknown` of the
    line was never measured (voxels in state UNKNOWN or HIDDEN, and space outside the map).
    """

    occupancy: OccupancyMap
    """The map."""
    eye_clearance: float = 0.5
    """Length of a line at the eye that is not examined [m], since a person's head and chest are measured, too."""
    margin: float | None = None
    """Length of a line at the target that is not examined [m], since the target's own surface is in the map; two voxels
    by default."""
    max_unknown: float | None = None
    """Length of space that was not measured through which a target still counts as visible [m]; one voxel by default.
    """

    def __post_init__(self) -> None:
        if not isinstance(self.occupancy, OccupancyMap):
            raise ArrayError(f"occupancy must be a warpvis.OccupancyMap, got {type(self.occupancy).__name__}")
        check_length(self.eye_clearance, "eye_clearance")
        for name, voxels in (("margin", _MARGIN_VOXELS), ("max_unknown", 1.0)):
            value = getattr(self, name)
            length = voxels * self.occupancy.cell_size if value is None else check_length(value, name, infinite=True)
            object.__setattr__(self, name, length)


def as_space(value: OccupancyMap | MeasuredSpace | None, device: wp.Device) -> MeasuredSpace | None:
    """Return the space of an argument after a check of its device; None for None."""
    if value is None:
        return None
    space = value if isinstance(value, MeasuredSpace) else MeasuredSpace(value)
    if space.occupancy.device != device:
        raise ArrayError(f"occupancy must be on device {device}, got {space.occupancy.device}")
    return space


def _limits(space: MeasuredSpace) -> LineLimits:
    from warpvis.kernels.maps.occupancy_lines import LineLimits

    limits: Any = LineLimits()
    limits.eye_clearance, limits.margin, limits.max_unknown = space.eye_clearance, space.margin, space.max_unknown
    return limits


def judge_points(
    space: MeasuredSpace,
    poses: wp.array,
    points: wp.array,
    status: wp.array,
    unknown: wp.array | None,
    threads: int | None,
) -> None:
    """Change the status of visible points, and write unknown shares, both ``(V, N)``; see `judge_lines`."""
    from warpvis.kernels.maps.occupancy_lines import judge_lines

    inputs = [space.occupancy.device_struct(), _limits(space), points, status, unknown]
    launch_points(
        judge_lines, status.shape, lambda window: [poses, window, *inputs], device=status.device, threads=threads
    )


def find_stop(space: MeasuredSpace, eye: Floats, point: Floats, status: Visibility) -> Floats | None:
    """Return the first sample, half a voxel apart, of a surface or of unmeasured space on a line; None without one."""
    if status not in (Visibility.OCCLUDED, Visibility.UNKNOWN):
        return None
    length = float(np.linalg.norm(point - eye))
    step = space.occupancy.cell_size / 2
    distances = np.arange(space.eye_clearance, length - (space.margin or 0.0), step) + step / 2
    line = eye + distances[:, None] * (point - eye) / length
    states = space.occupancy.states(line).numpy()
    marks = states == Voxel.SURFACE if status == Visibility.OCCLUDED else states < Voxel.FREE
    return line[marks.argmax()] if marks.any() else None


def hide_pixels(
    space: MeasuredSpace,
    camera: ImageCamera,
    poses: wp.array,
    chosen: Sequence[int],
    objects: int,
    seen: Views,
    threads: int | None,
) -> wp.array:
    """Remove pixels of objects from images, and return how many are unknown, ``(V, K)``.

    Args:
        space: The map, and the limits of lines.
        camera: A pinhole camera.
        poses: Its poses, ``(V,)`` transforms.
        chosen: Indices of the K objects that matter.
        objects: Number of objects of the scene.
        seen: Exact depth and segmentation, ``(V, H, W)``, changed in place.
        threads: Number of CPU threads.
    """
    from warpvis.kernels.maps import occupancy_lines

    lens, device = require_camera(camera, "camera").device_struct(), seen.depth.device
    columns = np.full(objects, -1, dtype=np.int32)
    columns[list(chosen)] = np.arange(len(chosen))
    unknown = wp.zeros((len(poses), len(chosen)), dtype=wp.int32, device=device)
    inputs = [
        space.occupancy.device_struct(),
        _limits(space),
        wp.array(columns, dtype=wp.int32, device=device),
        seen.depth,
        seen.segmentation,
        unknown,
    ]
    launch_images(
        occupancy_lines.hide_pixels,
        seen.depth.shape,
        lambda window: [lens, poses, window, *inputs],
        device=device,
        threads=threads,
        split_views=False,  # Warp's atomics are not atomic on the CPU: one thread counts the pixels of a view
    )
    return unknown


def judge_unknown(image: wp.array, visible: wp.array, unknown: wp.array, status: wp.array) -> None:
    """Change the status of objects that are hidden by unknown space most of all, all arrays ``(V, K)``."""
    from warpvis.kernels.maps import occupancy_lines

    launch(occupancy_lines.judge_unknown, status.shape, [image, visible, unknown, status], status.device)
