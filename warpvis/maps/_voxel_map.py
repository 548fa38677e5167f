# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The visibility map in 3D: which parts of space depth images show to be free, which hold a surface, which are hidden.

The grid is that of occupancy mapping: each view clears what lies before the surface that it shows, and says nothing of
what lies behind it (Hornung et al., OctoMap, Autonomous Robots 2013). Views are taken as exact, so one is enough.
"""

from __future__ import annotations

import enum
import math
import os
from dataclasses import dataclass
from typing import Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy, check_metres, empty, get_device
from warpvis.core.camera import Camera
from warpvis.core.checks import as_path
from warpvis.core.depth_images import read_depth, read_labels
from warpvis.core.kernel_cache import launch
from warpvis.core.poses import Convention, QuaternionOrder, check_up, parse_poses, to_xyzw
from warpvis.core.threads import launch_images
from warpvis.core.types import ArrayInput, DeviceLike, Excluded, ObjectPoses, PoseLike
from warpvis.errors import ArrayError, FileFormatError
from warpvis.maps._floor_map import FloorMap, floor_map
from warpvis.rendering import Renderer
from warpvis.scene import Scene
from warpvis.scene.worlds import parse_worlds, part_of

_MOST_VOXELS = 2**31 - 1

# Depth and labels of 218 images of 320x240: 84 MB.
_PIXELS_AT_A_TIME = 2**24


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
    """Highest `Label` of the surface points in every cube, ``(nx, ny, nz)`` uint8; EMPTY where there are none."""
    origin: tuple[float, float, float]
    """Least corner of the box [m]."""
    cell_size: float
    """Side of a cube [m]."""
    up: Literal["z", "y"]
    """The world's vertical axis."""

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

        A cell of the floor shows the highest `Label` of the cubes over it, `Label.EMPTY` where no surface was seen.
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
        launch_images(
            kernels.highest_labels, shape, lambda window: [window, self.labels, up_axis, labels], device=device
        )
        middles, points = self._middles(), np.zeros((*shape, 3), dtype=np.float32)
        points[..., column_axis], points[..., row_axis] = middles[column_axis], middles[row_axis][:, None]
        places = wp.array(points, dtype=wp.vec3, device=device)
        return floor_map(
            places, labels, bounds=self.bounds, cell_size=self.cell_size, up=self.up, level_tolerance=0.0, robots=robots
        )

    def merge(self, other: VoxelMap) -> VoxelMap:
        """Make a new map of what this one or another one saw: of every cube the higher state and the higher label.

        Raises:
            ArrayError: The other map is of another grid, or on another device.
        """
        from warpvis.kernels import voxels as kernels

        device = self.states.device
        _check_same_grid(other, "the other map", self.origin, self.states.shape, self.cell_size, self.up, device)
        result = VoxelMap(wp.clone(self.states), wp.clone(self.labels), self.origin, self.cell_size, self.up)
        launch_images(
            kernels.merge_voxels,
            self.states.shape,
            lambda window: [window, other.states, other.labels, result.states, result.labels],
            device=device,
        )
        return result

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a NumPy ``.npz`` file of `states`, `labels`, `origin`, `cell_size` and `up`.

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
                )
        except OSError as error:
            raise FileFormatError(f"{path}: cannot be written: {error.strerror or error}") from None


def voxel_map(
    depth: ArrayInput,
    camera: Camera,
    camera_to_world: PoseLike,
    *,
    bounds: ArrayLike,
    cell_size: float = 0.05,
    labels: ArrayInput | None = None,
    up: Literal["z", "y"] = "z",
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    device: DeviceLike = None,
    threads: int | None = None,
    out: VoxelMap | None = None,
) -> VoxelMap:
    """Tell which voxels of a box depth images show to be free, which hold a seen surface, and which are hidden.

    A voxel is, by the first of these that is true in any view:

    - `Voxel.SURFACE` if the point of a pixel with depth lies in it, as `back_project` gives it, unrounded; or if the
      ray through its middle meets the seen surface in it: the middle lies in some pixel, and the point of that ray at
      the pixel's planar depth is in the voxel. The second is what closes surfaces whose pixels lie voxels apart. A
      voxel holds its least faces by the first rule, and all of them by the second.
    - `Voxel.FREE` if its middle is in the image, from the camera's `near` to its `far`, and nearer than what its pixel
      shows.
    - `Voxel.HIDDEN` if its middle is in the image and in that range, behind what its pixel shows.
    - `Voxel.OUTSIDE` else.

    A surface that lies on the border of two voxels, as a floor at a height of 0 does where the box begins there, falls
    into either by rounding: begin the box half a voxel lower.

    Args:
        depth: Planar depth [m], measured or rendered, shape ``(V, H, W)`` float32, or ``(H, W)`` for one view. +inf is
            nothing up to `far`, and so is a finite depth beyond it; -inf is something nearer than `near`, which hides
            all behind it, and so is a depth between 0 and `near` (REP 117). 0, negative and NaN is not measured, and
            says nothing.
        camera: The camera that took the images.
        camera_to_world: Its poses, shape ``(V, 7)`` or ``(V, 4, 4)``.
        bounds: Least and greatest corner of the box [m], shape ``(2, 3)``. Voxels begin at the least one; the last of
            an axis may reach beyond the greatest.
        cell_size: Side of a voxel [m].
        labels: `Label` of every pixel, as `classify` or `Renderer.render` gives them, of the shape of `depth`, uint8;
            by default every surface is `Label.OBSTACLE`.
        up: The world's vertical axis, which `VoxelMap.floor_map` looks along.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        device: Where to compute; by default where `out` is, or else the images.
        threads: CPU threads, all cores by default.
        out: An earlier map of the same grid, which these views are added to: so maps of several cameras and agents
            become one.

    Returns:
        One map of all views; `out` if it was given.

    Raises:
        WarpvisError: A shape, dtype, device or value is not what it has to be.
    """
    camera_to_world = to_xyzw(camera_to_world, quaternion, "camera_to_world")
    if out is not None and device is None:
        device = _require_map(out, "out").states.device
    images = read_depth(depth, camera, device)
    device = images.device
    poses = parse_poses(camera_to_world, convention=convention, device=device)
    if len(poses) != len(images):
        raise ArrayError(f"depth has {len(images)} views and camera_to_world has {len(poses)}; give one pose a view")
    pixel_labels = None if labels is None else read_labels(labels, images.shape, device)
    result = _map_for(bounds, cell_size, up, device, out)
    _add_views(result, images, pixel_labels, camera, poses, threads)
    return result


def voxel_map_from_scene(
    scene: Scene,
    camera: Camera,
    camera_to_world: PoseLike,
    *,
    bounds: ArrayLike | None = None,
    cell_size: float = 0.05,
    object_poses: ObjectPoses = None,
    world_index: ArrayInput | None = None,
    exclude: Excluded = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    threads: int | None = None,
    out: VoxelMap | None = None,
) -> VoxelMap:
    """Map what views of a scene show: `voxel_map` of their depth and labels, which are rendered in parts.

    Args:
        scene: What is seen; its vertical axis is the map's.
        camera: Intrinsics, image size and depth range of all views.
        camera_to_world: Poses, as for `Renderer.render`.
        bounds: Least and greatest corner of the box [m], shape ``(2, 3)``. By default those of `out`, or else the
            scene's, with movable objects where they were added, and one and a half voxels more on every side: a floor
            or a wall that ends the scene then lies in the middle of voxels, not on their border.
        cell_size: Side of a voxel [m].
        object_poses: As for `Renderer.render`. One map shows all worlds that the views are of.
        world_index: As for `Renderer.render`.
        exclude: As for `Renderer.render`.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        threads: CPU threads, all cores by default.
        out: An earlier map of the same grid, which these views are added to.

    Returns:
        One map of all views, on the scene's device; `out` if it was given.

    Raises:
        WarpvisError: An argument is not what it has to be.
    """
    camera_to_world = to_xyzw(camera_to_world, quaternion, "camera_to_world")
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    renderer = Renderer(scene, camera, outputs=("depth", "labels"), threads=threads)
    scene.require_objects()
    poses = parse_poses(camera_to_world, convention=convention, device=scene.device)
    worlds = parse_worlds(scene, len(poses), object_poses, world_index, exclude)
    box: ArrayLike | None = bounds
    if box is None and out is not None:
        box = _require_map(out, "out").bounds
    elif box is None:
        box = scene.bounds.astype(np.float64) + [
            [-1.5 * check_metres(cell_size, "cell_size", zero=False)],
            [1.5 * cell_size],
        ]
    result = _map_for(box, cell_size, scene.up, scene.device, out)
    step = max(1, _PIXELS_AT_A_TIME // (camera.width * camera.height))
    for first in range(0, len(poses), step):
        part = slice(first, min(first + step, len(poses)))
        seen, some = part_of(worlds, part), poses[part]
        places = seen.object_poses if scene.movable else None
        views = renderer.render(some, object_poses=places, world_index=seen.world, exclude=seen.excluded)
        _add_views(result, views.depth, views.labels, camera, some, threads)
    return result


def _map_for(
    bounds: ArrayLike, cell_size: float, up: Literal["z", "y"], device: wp.Device, out: VoxelMap | None
) -> VoxelMap:
    """Make a map of which nothing is known yet, or `out` if that is there and of this grid."""
    check_up(up)
    origin, size, side = _check_grid(bounds, cell_size)
    if out is None:
        return VoxelMap(_zeros(size, wp.uint8, device), _zeros(size, wp.uint8, device), origin, side, up)
    _check_same_grid(out, "out", origin, size, side, up, device)
    return out


def _add_views(
    target: VoxelMap, depth: wp.array, labels: wp.array | None, camera: Camera, poses: wp.array, threads: int | None
) -> None:
    """Raise a map by what views show, on the device of all of them."""
    from warpvis.kernels import voxels as kernels
    from warpvis.kernels.points import camera_frames

    device, size = target.states.device, target.states.shape
    frames = [wp.empty(len(poses), dtype=dtype, device=device) for dtype in (wp.vec3d, wp.mat33d)]
    launch(camera_frames, len(poses), [poses, *frames], device)
    grid, lens = kernels.VoxelGrid(), camera.device_struct()
    grid.origin, grid.cell, grid.size = wp.vec3d(*target.origin), target.cell_size, wp.vec3i(*size)
    # Flat: Warp counts the bytes from one index of a first axis to the next in 32 bits.
    marks = _zeros((math.prod(size),), wp.int32, device)
    launch_images(
        kernels.mark_surface_points,
        depth.shape,
        lambda window: [lens, *frames, window, grid, depth, labels, marks],
        device=device,
        threads=1,  # on the CPU, Warp's atomics are not: only one thread may write to the marks
    )
    launch_images(
        kernels.judge_voxels,
        size,
        lambda window: [lens, *frames, window, grid, depth, labels, marks, target.states, target.labels],
        device=device,
        threads=threads,
    )


def _zeros(shape: tuple[int, ...], dtype: type, device: wp.Device) -> wp.array:
    array = empty(shape, dtype, name="the map", device=device)
    array.zero_()
    return array


def _check_grid(bounds: ArrayLike, cell_size: float) -> tuple[tuple[float, float, float], tuple[int, int, int], float]:
    """Check a grid's box, and return origin, size and side of a grid's voxels."""
    side = check_metres(cell_size, "cell_size", zero=False)
    corners = as_numpy(bounds, name="bounds").astype(np.float64)
    if corners.shape != (2, 3) or not np.isfinite(corners).all() or (corners[1] <= corners[0]).any():
        raise ArrayError(
            f"bounds must be the least and the greatest corner of a box, shape (2, 3), got {corners.tolist()}"
        )
    # A box of 4 m in voxels of 2 cm has 200 of them, whatever the quotient's last digit says.
    x, y, z = np.ceil((corners[1] - corners[0]) / side - 1e-6).clip(min=1)
    if x * y * z > _MOST_VOXELS:
        raise ArrayError(
            f"a grid of {x:.0f} x {y:.0f} x {z:.0f} voxels is too large, {_MOST_VOXELS} are the most; "
            f"give a larger cell_size than {side} m"
        )
    first, second, third = corners[0].tolist()
    return (first, second, third), (int(x), int(y), int(z)), side


def _require_map(value: object, name: str) -> VoxelMap:
    if not isinstance(value, VoxelMap):
        raise ArrayError(f"{name} must be a warpvis.VoxelMap, got {type(value).__name__}")
    return value


def _check_same_grid(
    other: ArrayInput,
    name: str,
    origin: tuple[float, ...],
    size: tuple[int, ...],
    cell_size: float,
    up: str,
    device: wp.Device,
) -> None:
    theirs = _require_map(other, name)
    if theirs.states.device != get_device(device):
        raise ArrayError(f"{name} must be on device {device}, got {theirs.states.device}")
    wanted = _describe(size, cell_size, origin, up)
    got = _describe(theirs.states.shape, theirs.cell_size, theirs.origin, theirs.up)
    if got != wanted:
        raise ArrayError(f"{name} must be of {wanted}, got {got}")


def _describe(size: tuple[int, ...], cell_size: float, origin: tuple[float, ...], up: str) -> str:
    x, y, z = size
    return f"{x} x {y} x {z} voxels of {cell_size} m from {origin}, {up} up"
