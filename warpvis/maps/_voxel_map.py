# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The visibility map in 3D: what is known of every voxel, and what can be made of it."""

from __future__ import annotations

import enum
import os
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import empty, get_device
from warpvis.core.checks import as_path
from warpvis.core.labels import Label, LabelNames
from warpvis.core.poses import check_up
from warpvis.core.threads import launch_images
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError, FileFormatError
from warpvis.maps._floor_map import FloorMap, floor_map
from warpvis.maps._map_labels import ground_bits


class Voxel(enum.IntEnum):
    """What views say of a voxel. The order is the order of precedence where several views differ."""

    OUTSIDE = 0
    """In no view's image and range, or only where nothing was measured."""
    HIDDEN = 1
    """Behind something in every view that it is in."""
    FREE = 2
    """A view sees through it."""
    SURFACE = 3
    """A seen surface is in it."""

    @classmethod
    def parse(cls, value: Voxel | int | str) -> Voxel:
        """Return the state from itself, its number or its name in any case.

        Raises:
            ArrayError: There is no such state.
        """
        try:
            return cls[value.upper()] if isinstance(value, str) else cls(value)
        except (KeyError, ValueError, TypeError):
            names = ", ".join(f"{state.name} ({state.value})" for state in cls)
            raise ArrayError(f"state of a voxel must be one of {names}, got {value!r}") from None


@dataclass(frozen=True)
class VoxelMap:
    """What views have seen of a box of space, in cubes along the world's axes."""

    states: wp.array
    """`Voxel` of every cube, ``(nx, ny, nz)`` uint8, indexed ``[x, y, z]``."""
    labels: wp.array
    """Highest label of the surface points in every cube, as for `floor_map`, ``(nx, ny, nz)`` uint8; EMPTY where there
    are none."""
    origin: tuple[float, float, float]
    """Least corner of the box [m]."""
    cell_size: float
    """Side of a cube [m]."""
    up: Literal["z", "y"]
    """The world's vertical axis."""
    label_names: LabelNames = field(default_factory=LabelNames)
    """Names of the classes."""
    ground_labels: frozenset[int] = frozenset({Label.GROUND})
    """Classes that are ground, which all others cover."""

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Least and greatest corner of the box [m], shape ``(2, 3)``."""
        low = np.array(self.origin)
        return np.stack([low, low + self.cell_size * np.array(self.states.shape)])

    def centers(self) -> NDArray[np.float32]:
        """Return the middles of the cubes [m], shape ``(nx, ny, nz, 3)``."""
        return np.stack(np.meshgrid(*self._middles(), indexing="ij"), axis=-1)

    def _middles(self) -> list[NDArray[np.float32]]:
        """Return the middles' coordinates along x, y and z."""
        sizes = zip(self.origin, self.states.shape, strict=True)
        return [(low + self.cell_size * (np.arange(count) + 0.5)).astype(np.float32) for low, count in sizes]

    def counts(self) -> dict[Voxel, int]:
        """Count how many cubes are in each state."""
        numbers = np.bincount(self.states.numpy().ravel(), minlength=len(Voxel))
        return {state: int(numbers[state]) for state in Voxel}

    def volume(self, state: Voxel | int | str) -> float:
        """Measure the space in a state [m^3]."""
        return self.counts()[Voxel.parse(state)] * self.cell_size**3

    def floor_map(self, *, robots: ArrayLike = ()) -> FloorMap:
        """Make the paper's map: the seen surface projected to the floor.

        A cell of the floor shows the highest label of the cubes over it, `Label.EMPTY` where no surface was seen.
        It is what `floor_map` makes of the points that lie in the box, seen from all views together, and of those
        that the rays through the cubes' middles meet (see `voxel_map`), without the level surface between points.

        Args:
            robots: Discs to draw: rows of centre on the floor's axes and radius [m], shape ``(R, 3)``.

        Returns:
            The map, as of one view, on this map's device.

        Raises:
            ArrayError: `robots` are malformed.
        """
        from warpvis.kernels import voxels as kernels

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
        """Make a new map of what this one or another one saw: of every cube the higher state and the higher label.

        Raises:
            ArrayError: The other map is of another grid, on another device, or has other ground.
            SceneError: The two have one name for different classes.
        """
        from warpvis.kernels import voxels as kernels

        device = self.states.device
        check_same_grid(other, "the other map", self.origin, self.states.shape, self.cell_size, self.up, device)
        check_same_ground(other, "the other map", self.ground_labels)
        names, ground = LabelNames({**self.label_names, **other.label_names}), ground_bits(self.ground_labels)
        grid = (self.origin, self.cell_size, self.up)
        result = VoxelMap(wp.clone(self.states), wp.clone(self.labels), *grid, names, self.ground_labels)
        launch_images(
            kernels.merge_voxels,
            self.states.shape,
            lambda window: [window, ground, other.states, other.labels, result.states, result.labels],
            device=device,
        )
        return result

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a NumPy ``.npz`` file of `states`, `labels`, `origin`, `cell_size` and `up`.

        `label_numbers` and `label_names` say what labels are called, `ground_labels` which are ground.

        Raises:
            FileFormatError: The file cannot be written.
        """
        try:
            with as_path(path).open("wb") as file:  # of that very name: NumPy would add a suffix
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
        except OSError as error:
            raise FileFormatError(f"{path}: cannot be written: {error.strerror or error}") from None


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
) -> None:
    theirs = require_map(other, name)
    if theirs.states.device != get_device(device):
        raise ArrayError(f"{name} must be on device {device}, got {theirs.states.device}")
    wanted = _describe(size, cell_size, origin, up)
    got = _describe(theirs.states.shape, theirs.cell_size, theirs.origin, theirs.up)
    if got != wanted:
        raise ArrayError(f"{name} must be of {wanted}, got {got}")


def check_same_ground(other: VoxelMap, name: str, ground: frozenset[int]) -> None:
    if other.ground_labels != ground:
        wanted, got = (sorted(map(int, labels)) for labels in (ground, other.ground_labels))
        raise ArrayError(f"{name} must have the ground_labels {wanted}, got {got}")


def _describe(size: tuple[int, ...], cell_size: float, origin: tuple[float, ...], up: str) -> str:
    x, y, z = size
    return f"{x} x {y} x {z} voxels of {cell_size} m from {origin}, {up} up"
