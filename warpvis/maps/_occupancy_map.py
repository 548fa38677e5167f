# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Occupancy maps: what measured depth images show of space, and what they do not."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING, Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.depth_images import read_images
from warpvis.cameras.image_cameras import ImageCamera
from warpvis.cameras.lens_camera import LensCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import as_box, as_points, check_length, get_device
from warpvis.core.checks import as_path, check_number, is_number
from warpvis.core.file_content import reading
from warpvis.core.poses import (
    Convention,
    QuaternionOrder,
    check_convention,
    check_up,
    parse_poses,
    poses_to_matrices,
    to_xyzw,
)
from warpvis.core.types import ArrayInput, DeviceLike, PoseLike
from warpvis.errors import ArrayError
from warpvis.maps._depth_sigma import Sigma
from warpvis.maps._earlier_views import EarlierViews
from warpvis.maps._floor_map import FLOOR_AXES, check_floor_bounds, count_cells
from warpvis.maps._known_blocks import read_blocks, stored_log_odds, write_blocks
from warpvis.maps._occupancy_blocks import BlockStorage
from warpvis.maps._occupancy_files import Options, read_map, write_map
from warpvis.maps._occupancy_grid import OccupancyGrid, project_columns
from warpvis.maps._occupancy_lookup import dense_states, fade_blocks, look_up, render_surface
from warpvis.maps._occupancy_mesh import surface_net
from warpvis.maps._occupancy_views import Integrator
from warpvis.maps._rectified import rectify
from warpvis.maps._tsdf_blocks import blocks_of_tsdf
from warpvis.maps._voxel_map import VoxelMap

if TYPE_CHECKING:
    import trimesh

    from warpvis.kernels.maps.occupancy_blocks import Blocks

# Share of a voxel by which bounds that are multiples of its side may differ from them.
_ROUNDING = 1e-6


class OccupancyMap:
    """Voxels that count how often depth images show them occupied and free, as log-odds (OctoMap).

    The state of a voxel is

    - `Voxel.UNKNOWN` if it was in no image, or only in pixels without a measurement;
    - `Voxel.HIDDEN` if it was in an image, but always behind the visible surface;
    - `Voxel.SURFACE` if its probability of being occupied is at least 0.5;
    - `Voxel.FREE` otherwise.

    The map grows with the images. Space is divided into blocks of 8 x 8 x 8 voxels, and blocks whose voxels all have
    the same value take 6 bytes. Voxel ``(i, j, k)`` extends from ``(i, j, k) * cell_size`` to one voxel farther.
    """

    def __init__(
        self,
        cell_size: float = 0.02,
        *,
        bounds: ArrayLike | None = None,
        hit: float = 0.7,
        miss: float = 0.4,
        minimum: float = 0.12,
        maximum: float = 0.97,
        up: Literal["z", "y"] = "z",
        device: DeviceLike = None,
    ) -> None:
        """Create an empty map.

        Args:
            cell_size: Side of a voxel [m].
            bounds: Lower and upper corner of the space to map [m], shape ``(2, 3)``; everything that the images contain
                by default. Blocks on the boundary are mapped.
            hit: Probability that a voxel is occupied if an image shows a surface in it, above 0.5.
            miss: Probability that a voxel is occupied if an image shows a surface behind it, below 0.5.
            minimum: Minimum probability of a voxel. The nearer it is to 0.5, the fewer hits make a free voxel occupied:
                three by default.
            maximum: Maximum probability of a voxel. The nearer it is to 0.5, the fewer misses make an occupied voxel
                free: nine by default.
            up: The world's vertical axis.
            device: Device of the map and of its computations.
        """
        self._device = get_device(device)
        check_up(up)
        self._up = up
        self._blocks = BlockStorage(check_length(cell_size, "cell_size", zero=False), self._device)
        log_odds = {
            "hit": _log_odds(hit, "hit", 0.5, 1.0),
            "miss": _log_odds(miss, "miss", 0.0, 0.5),
            "minimum": _log_odds(minimum, "minimum", 0.0, 0.5),
            "maximum": _log_odds(maximum, "maximum", 0.5, 1.0),
        }
        box = None if bounds is None else as_box(bounds, "bounds")
        self._options: Options = {
            "bounds": box,
            "hit": hit,
            "miss": miss,
            "minimum": minimum,
            "maximum": maximum,
        }
        self._integrator = Integrator(self._blocks, box, log_odds)
        self._earlier_views = EarlierViews()

    @classmethod
    def load(
        cls, path: str | os.PathLike[str], *, bounds: ArrayLike | None = None, device: DeviceLike = None
    ) -> OccupancyMap:
        """Read a map that `save` has written, or an OctoMap in binary form (``.bt``).

        Occupied and free voxels of an OctoMap get the maximum and minimum probability, OctoMap's defaults of 0.971 and
        0.1192; the others are UNKNOWN. The vertical axis is z.

        Args:
            path: The file, ``.npz`` or ``.bt``.
            bounds: Lower and upper corner of the space to read and to map [m], shape ``(2, 3)``; by default that of the
                map that was saved, and everything for an OctoMap. Blocks on the boundary are read.
            device: Device of the map and of its computations.

        Raises:
            FileFormatError: If the file cannot be read, is damaged, or contains too many blocks.
        """
        place, target = as_path(path), get_device(device)
        box = None if bounds is None else as_box(bounds, "bounds")
        options, known = read_map(place)
        with reading(place, "an occupancy map"):
            result = cls(**(options if box is None else {**options, "bounds": box}), device=target)
            write_blocks(result._blocks, known if box is None else known.clip(box, result._blocks.block_side))
        return result

    @classmethod
    def from_tsdf(
        cls,
        distance: ArrayInput,
        weight: ArrayInput,
        cell_size: float,
        *,
        origin: ArrayLike = (0.0, 0.0, 0.0),
        up: Literal["z", "y"] = "z",
        device: DeviceLike = None,
    ) -> OccupancyMap:
        """Create a map from a truncated signed distance field (TSDF), as of nvblox.

        Voxels with a weight are FREE more than half a voxel in front of surfaces, HIDDEN more than half a voxel behind,
        and SURFACE in between, with the maximum or minimum probability. The others are UNKNOWN.

        Args:
            distance: Distance of the centers of voxels from the nearest surface [m], positive in front of it, float,
                shape ``(nx, ny, nz)``, indexed ``[x, y, z]``. Multiply normalized distances by the truncation distance.
            weight: Weight of the measurements, 0 without, of the same shape.
            cell_size: Side of a voxel [m].
            origin: Lower corner of the first voxel [m], a multiple of `cell_size`.
            up: The world's vertical axis.
            device: Device of the map and of its computations.
        """
        result = cls(cell_size, up=up, device=device)
        values = stored_log_odds(result._options["minimum"]), stored_log_odds(result._options["maximum"])
        write_blocks(result._blocks, blocks_of_tsdf(distance, weight, result.cell_size, origin, values))
        return result

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the known blocks and the options of the map to a file, which `load` reads.

        Args:
            path: ``.npz`` for NumPy's format, which keeps everything; or ``.bt`` for OctoMap's binary octree, which
                only has occupied (SURFACE) and free voxels. Log-odds, HIDDEN voxels, options and the vertical axis are
                not stored in it. It ends 32768 voxels from the origin.

        Raises:
            FileFormatError: If the file cannot be written.
        """
        options = {"cell_size": self.cell_size, "up": self.up, **self._options}
        write_map(as_path(path), options, read_blocks(self._blocks))

    @property
    def cell_size(self) -> float:
        """Side of a voxel [m]."""
        return self._blocks.cell_size

    @property
    def up(self) -> Literal["z", "y"]:
        """The world's vertical axis."""
        return self._up

    @property
    def device(self) -> wp.Device:
        """Device of the map."""
        return self._device

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Lower and upper corner of the space that may be known [m], shape ``(2, 3)``; zeros for an empty map."""
        blocks = self._blocks
        return np.stack([blocks.first, blocks.first + blocks.size]) * blocks.block_side

    def integrate(
        self,
        depth: ArrayInput,
        camera: ImageCamera,
        camera_to_world: PoseLike,
        *,
        sigma: Sigma = 0.0,
        max_range: float = 5.0,
        convention: Convention = "opencv",
        quaternion: QuaternionOrder = "xyzw",
        threads: int | None = None,
    ) -> None:
        """Add depth images to the map, one after the other.

        A voxel is judged by the pixel that contains its center. It is hit if the interval of depth that contains the
        pixel's surface overlaps with it, free if it is in front of the interval, and hidden if it is behind. The
        interval is one standard deviation to either side of the measured depth, and includes the depth at the pixel's
        borders on a surface that continues there, such as a floor at a grazing angle. Voxels that contain the point
        of any pixel are hit, too. Space nearer than the camera's `near` is free in front of a measured surface; its
        `far` and `max_range` limit the depth of all voxels that an image changes.

        Args:
            depth: Depth of each view [m], measured or rendered, as for `warpvis.point_visibility_from_depth`.
            camera: The camera of the images: a pinhole, or a `warpvis.cameras.LensCamera` with rays up to 75 degrees
                from its axis, whose images are rectified.
            camera_to_world: Poses of the camera, shape ``(V, 7)`` or ``(V, 4, 4)``.
            sigma: Standard deviation of depth: a number of meters, a model of `warpvis.sensors`, or a function that
                takes depths [m], an array, and returns standard deviations [m]; 0 for exact depth.
            max_range: Maximum depth [m]; greater depths only show that the space up to there is free.
            convention: Axes of the camera frame of the poses.
            quaternion: Order of the quaternions, ``"xyzw"`` or ``"wxyz"``.
            threads: Number of CPU threads; all cores by default.

        Raises:
            PoseError: If images contradict each other or the first ones of a map on a CPU, and would not if the poses
                had another meaning, such as world to camera or other axes.
        """
        reach = check_length(max_range, "max_range", zero=False)
        images, poses = read_images(
            depth, camera, camera_to_world, convention, quaternion, self.device, poses_on_host=True
        )
        rows = poses.numpy().reshape(-1, 7)
        matrices = poses_to_matrices(rows.astype(np.float64))
        if images.device.is_cpu:
            self._earlier_views.check(images.numpy(), camera, rows, matrices, check_convention(convention))
        if isinstance(camera, LensCamera):
            images, camera = rectify(images, camera, threads)
        self._integrator.add(images, camera, matrices, sigma, min(reach, camera.far), threads)

    def device_struct(self) -> Blocks:
        """Return the map as a kernel argument, valid until it changes."""
        return self._blocks.struct()

    def decay(self, factor: float) -> None:
        """Multiply all log-odds by a factor from 0 to 1, so that the map forgets what it has not seen again.

        Args:
            factor: For example ``0.5 ** (elapsed / half_life)``.
        """
        fade_blocks(self._blocks, check_number(factor, "factor", minimum=0.0, maximum=1.0))

    def states(self, points: ArrayInput, *, threads: int | None = None) -> wp.array:
        """Return the `Voxel` state at points in the world [m], shape ``(N, 3)``, as ``(N,)`` uint8."""
        return look_up(self._blocks, as_points(points, "points", "N", self.device), wp.uint8, threads)

    def probabilities(self, points: ArrayInput, *, threads: int | None = None) -> wp.array:
        """Return the probability that points in the world [m], shape ``(N, 3)``, are in occupied voxels.

        Returns:
            Probabilities, ``(N,)`` float32; NaN in voxels that are UNKNOWN or HIDDEN.
        """
        return look_up(self._blocks, as_points(points, "points", "N", self.device), wp.float32, threads)

    def render_depth(
        self,
        camera: Camera,
        camera_to_world: PoseLike,
        *,
        convention: Convention = "opencv",
        quaternion: QuaternionOrder = "xyzw",
        threads: int | None = None,
    ) -> wp.array:
        """Return the depth that cameras would measure if the map were the world.

        Args:
            camera: A pinhole camera with a finite `far`.
            camera_to_world: Poses of the camera, shape ``(V, 7)`` or ``(V, 4, 4)``.
            convention: Axes of the camera frame of the poses.
            quaternion: Order of the quaternions, ``"xyzw"`` or ``"wxyz"``.
            threads: Number of CPU threads; all cores by default.

        Returns:
            Planar depth of the first surface [m], ``(V, H, W)`` float32: +inf if the space up to `far` is free, NaN if
            space that was never measured is in front of the surface. The surface is in the middle of the SURFACE voxels
            on the ray, at most 1.5 voxels behind the first one's face.

        Raises:
            CameraError: If the camera is not a pinhole, or its `far` is infinite.
        """
        rows = to_xyzw(camera_to_world, quaternion, "camera_to_world")
        poses = parse_poses(rows, convention=convention, device=self.device)
        return render_surface(self.device_struct(), camera, poses, 1, threads)[0]

    def voxel_map(
        self,
        bounds: ArrayLike | None = None,
        *,
        ground_height: float = 0.0,
        ground_tolerance: float = 0.03,
        threads: int | None = None,
    ) -> VoxelMap:
        """Return the states of a box as a dense array.

        Args:
            bounds: Lower and upper corner [m], shape ``(2, 3)``, extended to whole voxels; by default `bounds`.
            ground_height: Height of the floor [m].
            ground_tolerance: Height above the floor below which the center of a voxel of the ground is [m]. Surfaces
                below are `Label.GROUND`, others `Label.OBSTACLE`.
            threads: Number of CPU threads; all cores by default.

        Returns:
            A copy on the map's device.
        """
        box = self.bounds if bounds is None else as_box(bounds, "bounds")
        first = np.floor(box[0] / self.cell_size + _ROUNDING).astype(np.int64)
        size = np.ceil(box[1] / self.cell_size - _ROUNDING).astype(np.int64) - first
        count_cells(size * self.cell_size, self.cell_size, "a grid", "voxels")
        up_axis = check_up(self.up)
        ground = check_length(ground_height, "ground_height", signed=True)
        top = (ground + check_length(ground_tolerance, "ground_tolerance")) / self.cell_size - 0.5
        levels = max(0, math.ceil(top) - int(first[up_axis]))
        states, labels = dense_states(self._blocks, first, size, up_axis, levels, threads)
        x, y, z = (first * self.cell_size).tolist()
        return VoxelMap(states, labels, (x, y, z), self.cell_size, self.up)

    def occupancy_grid(
        self,
        bounds: ArrayLike | None = None,
        *,
        ground_height: float = 0.0,
        min_height: float = 0.1,
        max_height: float = 1.8,
        max_unknown: float = 0.5,
        threads: int | None = None,
    ) -> OccupancyGrid:
        """Return which places of the floor are free, as in ROS's ``nav_msgs/OccupancyGrid``.

        A cell is the column of voxels whose centers are in a band of heights, for example those of a robot. It is
        occupied if one of them is SURFACE, free if at most the share `max_unknown` of them was not measured and the
        others are FREE, and unknown otherwise. Space below the band, such as a stair down, is ignored.

        Args:
            bounds: Lower and upper corner of the grid [m], shape ``(2, 2)`` on the floor's axes (x and y where z is up,
                z and x where y is up), or ``(2, 3)`` in the world, extended to whole voxels; by default what is not
                unknown.
            ground_height: Height of the floor [m].
            min_height: Lower end of the band above the floor [m].
            max_height: Upper end of the band above the floor [m].
            max_unknown: Maximum share of HIDDEN and UNKNOWN voxels in a free column, from 0 to 1. With 1, one free
                voxel suffices.
            threads: Number of CPU threads; all cores by default.
        """
        ground = check_length(ground_height, "ground_height", signed=True)
        low, high = (
            check_number(value, name) for value, name in ((min_height, "min_height"), (max_height, "max_height"))
        )
        share = check_number(max_unknown, "max_unknown", minimum=0.0, maximum=1.0)
        first = math.ceil((ground + low) / self.cell_size - 0.5 - _ROUNDING)
        end = math.floor((ground + high) / self.cell_size - 0.5 + _ROUNDING) + 1
        if end <= first:
            raise ArrayError(f"max_height must be at least a voxel above min_height, {low} m, got {high}")
        box = self.bounds
        if bounds is not None:
            box[:, FLOOR_AXES[self.up]] = check_floor_bounds(bounds, self.up)
        elif not box.any():
            raise ArrayError("bounds must be given for a map without images")
        box[:, check_up(self.up)] = first * self.cell_size, end * self.cell_size
        band = self.voxel_map(box, threads=threads)
        return project_columns(band, share, trim=bounds is None)

    def mesh(self) -> trimesh.Trimesh:
        """Return a mesh of the SURFACE voxels beside FREE ones, for `Scene.add`.

        It is smooth (surface nets), within about a voxel of exact surfaces, and open where nothing was measured behind
        them. Noise makes surfaces thicker: those of a Kinect are about 2 cm in front of the real ones. Things of one
        voxel in width are thinner.
        """
        import trimesh

        def states_at(points: NDArray[np.float32]) -> NDArray[np.uint8]:
            states: NDArray[np.uint8] = self.states(points).numpy()
            return states

        vertices, faces = surface_net(read_blocks(self._blocks), self.cell_size, states_at)
        return trimesh.Trimesh(vertices, faces, process=False)


def _log_odds(probability: object, name: str, low: float, high: float) -> float:
    """Return the log-odds of a probability between two others."""
    if not is_number(probability) or not low < probability < high:
        raise ArrayError(f"{name} must be a probability between {low} and {high}, got {probability!r}")
    return math.log(probability / (1.0 - probability))
