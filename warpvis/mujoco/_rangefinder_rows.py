# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rangefinder sensors on CPU cores: launches that are packed once, and copies of the poses of one world."""

from __future__ import annotations

import math
from typing import Any

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import aligned_zeros, share
from warpvis.kernels.constants import CPU_LANES
from warpvis.mujoco._poses import PoseSource
from warpvis.rendering.casters.packed_rows import PackedRows

# Numbers of a bounding sphere in ``native/cpu/spheres.h``.
_SPHERE_NUMBERS = 5
# The number of threads is chosen as if a ray were this many pixels.
_PIXELS_PER_RAY = 16


class ReadingRows:
    """A packed launch that reads the sensors of worlds, for one call at a time."""

    def __init__(self, geoms: Any, rays: Any, columns: int, threads: int, **frames: wp.array) -> None:
        """Pack a launch for shapes and rays, structs of the kernel; a world has `columns` numbers.

        `frames` are the poses of calls without other ones.
        """
        from warpvis.kernels.mujoco.rangefinder_rows import RangefinderCall, RangefinderReadings, read_rangefinder_rows

        self._rays = rays.body.shape[0]
        self._rows = PackedRows(read_rangefinder_rows, RangefinderCall, RangefinderReadings, threads)
        blocks = -(-geoms.geom.shape[0] // CPU_LANES)
        self._spheres = aligned_zeros((threads, max(blocks, 1) * CPU_LANES * _SPHERE_NUMBERS), wp.float32)
        # Arguments that are not written yet.
        self._new = {"geoms": geoms, "rays": rays, "columns": columns, "spheres": self._spheres} | frames

    def run(self, worlds: int, readings: wp.array, **frames: wp.array) -> None:
        """Write the readings of worlds into a contiguous array. `frames` replace the poses of the launch."""
        if not worlds:
            return
        shape = worlds, self._rays, _PIXELS_PER_RAY
        self._rows.run(shape, {"readings": readings}, **self._new, **frames)
        self._new = {}


class FrameCopies:
    """Single-precision copies of the poses of one world, in the same memory in every call."""

    def __init__(self, counts: dict[str, int]) -> None:
        """Allocate memory for kinds of frames, of "geom", "site" and "cam", with their numbers in the model."""
        self._numbers = np.empty(12 * sum(counts.values()), dtype=np.float32)
        self.arrays: dict[str, wp.array] = {}
        # With and without an axis of worlds.
        self._of_worlds, self._of_data = (
            list[tuple[str, NDArray[np.float32]]](),
            list[tuple[str, NDArray[np.float32]]](),
        )
        self._rotations = list[NDArray[np.float32]]()
        begin = 0
        for kind, count in counts.items():
            for name, size, dtype in ((f"{kind}_xpos", 3, wp.vec3), (f"{kind}_xmat", 9, wp.mat33)):
                part = self._numbers[begin : begin + size * count].reshape(count, size)
                begin += size * count
                self._of_data.append((name, part))
                self._of_worlds.append((name, part[None]))
                self.arrays[name] = share(part, (1, count), dtype)
                if size == 9 and count:
                    self._rotations.append(part[0])

    def copy(self, source: PoseSource) -> bool:
        """Copy poses of NumPy arrays of one world.

        Returns:
            Whether they could be copied, and are provably finite and computed, as `check_computed` requires.
        """
        is_data = isinstance(source, mujoco.MjData)
        for name, part in self._of_data if is_data else self._of_worlds:
            values: Any = getattr(source, name, None)
            if not is_data and (type(values) is not np.ndarray or values.dtype.kind != "f"):
                return False
            if values.shape != part.shape:
                return False
            part[...] = values
        for rotation in self._rotations:
            # The first number is rarely 0, and testing it is much faster.
            if not rotation[0] and not rotation.any():
                return False
        return math.isfinite(self._numbers.dot(self._numbers))
