# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Voxel maps: the state of every voxel of a box."""

from __future__ import annotations

import enum
import os
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import empty, get_device
from warpvis.core.checks import as_path
from warpvis.core.file_content import writing
from warpvis.core.labels import Label, LabelNames
from warpvis.core.poses import check_up
from warpvis.core.threads import launch_images
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.maps._floor_map import FloorMap, floor_map, ground_bits


class Voxel(enum.IntEnum):
    """State of a voxel. Where views differ, the greatest value takes precedence."""

    UNKNOWN = 0
    """Outside of the image and range of all views, or without measurements."""
    HIDDEN = 1
    """Occluded in every view that contains it."""
    FREE = 2
    """Seen to be free in a view."""
    SURFACE = 3
    """Contains a visible surface."""

    @classmethod
    def parse(cls, value: Voxel | int | str) -> Voxel:
        """Convert a state, its number or its name (in any case) to a state."""
        try:
            return cls[value.upper()] if isinstance(value, str) else cls(value)
        except (KeyError, ValueError, TypeError):
            names = ", ".join(f"{state.name} ({state.value})" for state in cls)
            raise ArrayError(f"state of a voxel must be one of {names}, got {value!r}") from None


@dataclass(frozen=True)
class VoxelMap:
    """Visibility of a box of space, in cubic voxels along the world's axes."""

    states: wp.array
    """`Voxel` state of every voxel, ``(nx, ny, nz)`` uint8, indexed ``[x, y, z]``."""
    labels: wp.array
    """Highest label of the surface points in every voxel, as for `floor_map`, ``(nx, ny, nz)`` uint8; EMPTY without
    surface points."""
    origin: tuple[float, float, float]
    """Lower corner of the box [m]."""
    cell_size: float
    """Side of a voxel [m]."""
    up: Literal["z", "y"]
    """The world's vertical axis."""
    label_names: LabelNames = field(default_factory=LabelNames)
    """Names of the classes."""
    ground_labels: frozenset[int] = frozenset({Label.GROUND})
    """Classes that are ground, which have the lowest precedence."""

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Lower and upper corner of the box [m], shape ``(2, 3)``."""
        low = np.array(self.origin)
        return np.stack([low, low + self.cell_size * np.array(self.states.shape)])

    def centers(self) -> NDArray[np.float32]:
        """Return the centers of the voxels [m], shape ``(nx, ny, nz, 3)``."""
        return np.stack(np.meshgrid(*self._middles(), indexing="ij"), axis=-1)

    def _middles(self) -> list[NDArray[np.float32]]:
        """Return the centers' coordinates along x, y and z [m]."""
        sizes = zip(self.origin, self.states.shape, strict=True)
        return [(low + self.cell_size * (np.arange(count) + 0.5)).astype(np.float32) for low, count in sizes]

    def counts(self) -> dict[Voxel, int]:
        """Return the number of voxels in each state."""
        numbers = np.bincount(self.states.numpy().ravel(), minlength=len(Voxel))
        return {state: int(numbers[state]) for state in Voxel}

    def volume(self, state: Voxel | int | str) -> float:
        """Compute the volume in a state [m^3]."""
        return self.counts()[Voxel.parse(state)] * self.cell_size**3

    def floor_map(self, *, robots: ArrayLike = ()) -> FloorMap:
        """Project the visible surface to the floor, as in the paper.

        A cell of the floor has the highest label of the voxels above it, or `Label.EMPTY` if no surface was seen. The
        result equals `floor_map` of the points of all views within the box and of the points of the rays through voxel
        centers (see `voxel_map`), but without filling between points.

        Args:
            robots: Discs to draw: rows of center on the floor's axes and radius [m], shape ``(R, 3)``.

        Returns:
            A map with one view, on this map's device.
        """
        from warpvis.kernels.maps import voxels as kernels

        device, up_axis = self.states.device, check_up(self.up)
        column_axis, row_axis = (0, 1) if self.up == "z" else (2, 0)
        shape = (1, self.states.shape[row_axis], self.states.shape[column_axis])
        labels = empty(shape, wp.uint8, name="the map", device=device)
        ground = ground_bits(self.ground_labels)
        launch_images(
            kernels.highest_labels, shape, lambda window: [window, ground, self.labels, up_axis, labels], device=device
        )
        middles, points = self._middles(), np.zeros((*shape, 3), dtype=np.float32)
        points[..., column_axis], points[..., row_axis] = middles[column_axis], middles[row_axis][:, None]
        places = wp.array(points, dtype=wp.vec3, device=device)
        return floor_map(
            places,
            labels,
            bounds=self.bounds,
            cell_size=self.cell_size,
            up=self.up,
            level_tolerance=0.0,
            robots=robots,
            label_names=self.label_names,
            ground_labels=self.ground_labels,
        )

    def merge(self, other: VoxelMap) -> VoxelMap:
        """Return a new map with the higher state and the higher label of both maps in every voxel.

        Raises:
            ArrayError: If the maps differ in grid, device or ground labels.
            SceneError: If the maps use the same name for different classes.
        """
        from warpvis.kernels.maps import voxels as kernels

        device = self.states.device
        grid = (self.origin, self.states.shape, self.cell_size, self.up)
        check_same_grid(other, "the other map", *grid, device, self.ground_labels)
        names, ground = LabelNames({**self.label_names, **other.label_names}), ground_bits(self.ground_labels)
        result = replace(self, states=wp.clone(self.states), labels=wp.clone(self.labels), label_names=names)
        launch_images(
            kernels.merge_voxels,
            self.states.shape,
            lambda window: [window, ground, other.states, other.labels, result.states, result.labels],
            device=device,
        )
        return result

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a NumPy ``.npz`` file of `states`, `labels`, `origin`, `cell_size` and `up`.

        The file also contains the names of labels, as `label_numbers` and `label_names`, and `ground_labels`.

        Raises:
            FileFormatError: If the file cannot be written.
        """
        with writing(path), as_path(path).open("wb") as file:  # by handle, since NumPy appends a suffix to names
            np.savez_compressed(
                file,
                states=self.states.numpy(),
                labels=self.labels.numpy(),
                origin=np.array(self.origin),
                cell_size=np.float64(self.cell_size),
                up=np.array(self.up),
                label_numbers=np.array(list(self.label_names), dtype=np.uint8),
                label_names=np.array(list(self.label_names.values())),
                ground_labels=np.array(sorted(self.ground_labels), dtype=np.uint8),
            )


def require_map(value: object, name: str) -> VoxelMap:
    if not isinstance(value, VoxelMap):
        raise ArrayError(f"{name} must be a warpvis.VoxelMap, got {type(value).__name__}")
    return value


def check_same_grid(
    other: ArrayInput,
    name: str,
    origin: tuple[float, ...],
    size: tuple[int, ...],
    cell_size: float,
    up: str,
    device: wp.Device,
    ground: frozenset[int],
) -> None:
    """Raise an error unless another map has this grid, device and these ground labels."""
    theirs = require_map(other, name)
    if theirs.states.device != get_device(device):
        raise ArrayError(f"{name} must be on device {device}, got {theirs.states.device}")
    expected = _describe(size, cell_size, origin, up)
    got = _describe(theirs.states.shape, theirs.cell_size, theirs.origin, theirs.up)
    if got != expected:
        raise ArrayError(f"{name} must be of {expected}, got {got}")
    if theirs.ground_labels != ground:
        raise ArrayError(
            f"{name} must have the ground_labels {sorted(map(int, ground))}, got "
            f"{sorted(map(int, theirs.ground_labels))}"
        )


def _describe(size: tuple[int, ...], cell_size: float, origin: tuple[float, ...], up: str) -> str:
    x, y, z = size
    return f"{x} x {y} x {z} voxels of {cell_size} m from {origin}, {up} up"
