# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A watcher of a depth camera: it keeps a map of what was measured, and reports what the robot and people see."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.image_cameras import ImageCamera, require_image_camera
from warpvis.core.arrays import as_numpy, check_length
from warpvis.core.checks import check_text, is_number
from warpvis.core.labels import Label
from warpvis.core.poses import (
    Convention,
    QuaternionOrder,
    poses_to_matrices,
    quaternion_product,
)
from warpvis.core.types import ArrayInput, DeviceLike, PoseLike
from warpvis.errors import ArrayError
from warpvis.maps import FloorFit, FloorMap, OccupancyMap, Sigma, Sphere, VoxelMap, back_project, classify, floor_map
from warpvis.visibility._agents import Agent
from warpvis.visibility._eyes import Eyes
from warpvis.visibility._line_of_sight import LineOfSight, line_of_sight, line_of_sight_in_depth
from warpvis.visibility._reference_model import ReferenceModel
from warpvis.visibility.watching._floor_search import FloorSearch
from warpvis.visibility.watching._inputs import read_angles, read_floor, read_people, read_places, read_row
from warpvis.visibility.watching._meaning import probabilities
from warpvis.visibility.watching._sights import Sight, Target, see_in_image, see_through_map

# The map extends this far below and above the floor [m].
_BELOW, _ABOVE = 0.5, 3.0

# Horizontal distance from the first image up to which the map extends [m].
_EXTENT = 15.0

# Most voxels of a dense part of the map.
_MAX_VOXELS = 16_000_000

# A person's body extends this far above the eyes [m].
_ABOVE_EYES = 0.25

# Where a floor at z = 0 is, for `classify`: with a plane given, it does not compare the floor with the image.
_FLOOR = (0.0, 0.0, 1.0, 0.0)


@dataclass(frozen=True, eq=False)
class Watched:
    """What one depth image shows, and what everybody sees then. Poses and points are in the floor's world."""

    time: float | None
    """Time of the image [s]."""
    robot: Agent
    """The robot: its camera and its pose."""
    people: tuple[Agent, ...]
    """The people, at the poses of their eyes."""
    depth: NDArray[np.float32]
    """The depth image [m], ``(H, W)``."""
    labels: NDArray[np.uint8]
    """`Label` of every pixel, ``(H, W)``: also OBJECT in the spheres of places of interest, and HUMAN at people."""
    points: NDArray[np.float32]
    """Points of the pixels [m], ``(H, W, 3)``; NaN without a measurement."""
    places: Mapping[str, NDArray[np.float64]]
    """Places of interest by name, ``x y z diameter`` [m]."""
    sights: Mapping[str, Mapping[str, Sight]]
    """What the robot and each person see of each place of interest: ``sights["anna"]["mug"]``."""
    candidates: Mapping[str, Mapping[str, float]]
    """Probability that a person means a place that the person sees or may see: ``candidates["anna"]["mug"]``."""

    @property
    def camera_to_world(self) -> NDArray[np.float64]:
        """Pose of the camera in OpenCV axes, row ``x y z qx qy qz qw``, shape ``(7,)``."""
        return self.robot.poses[0]

    def floor_map(self, *, cell_size: float = 0.02, max_range: float = 5.0) -> FloorMap:
        """Return the labels projected to the floor, within a distance of the camera along the axes [m]."""
        reach = check_length(max_range, "max_range", zero=False)
        center = self.camera_to_world[:2]
        bounds = np.stack([center - reach, center + reach])
        return floor_map(self.points[None], self.labels[None], bounds=bounds, cell_size=cell_size)


class DepthWatcher:
    """Keeps the map of a depth camera, and reports for every image what the robot and people see.

    The floor's world has the floor at z = 0, and z up. Results are in this world; arguments are in the world of the
    poses, which may have any orientation.

    Example:
        >>> watcher = wv.watching.DepthWatcher(recording.camera, places={"mug": (1.2, 0.3, 0.8, 0.1)})
        >>> for frame in recording.posed():
        ...     watched = watcher.update(frame.depth, frame.camera_to_world, people=[anna])
        >>> watched.sights["anna"]["mug"].status
    """

    def __init__(
        self,
        camera: ImageCamera,
        *,
        places: Mapping[str, ArrayLike] | None = None,
        floor: FloorFit | float | None = None,
        up: ArrayLike | None = None,
        camera_height: float | None = None,
        cell_size: float = 0.03,
        max_range: float = 5.0,
        sigma: Sigma | None = None,
        person_radius: float = 0.3,
        robot: str = "robot",
        model: ReferenceModel | None = None,
        device: DeviceLike = None,
    ) -> None:
        """Start with an empty map.

        Args:
            camera: The camera of the depth images.
            places: Places of interest by name: a point ``x y z``, or a sphere ``x y z diameter`` [m].
            floor: The floor in the world of the poses: the result of `fit_floor`, or its height [m] if z is up. By
                default, it is searched in the first images.
            up: Approximate direction up in the world of the poses, which helps to find the floor.
            camera_height: Approximate height of the camera above the floor [m], which helps to find the floor.
            cell_size: Side of a voxel of the map [m].
            max_range: Maximum depth that is mapped [m].
            sigma: Standard deviation of depth, as for `OccupancyMap.integrate`; by default that of a Kinect.
            person_radius: Radius of a person's body [m]. Pixels within it, from the floor to above the eyes, are HUMAN
                and not mapped.
            robot: Name of the robot in results.
            model: Parameters of the probability of what a person means.
            device: Device of the map and of computations.
        """
        self._camera = require_image_camera(camera)
        self._targets = read_places(places)
        self._search: FloorSearch | None = None
        self._transform: NDArray[np.float64] | None = None
        if floor is None:
            self._search = FloorSearch(camera, up=up, camera_height=camera_height)
        else:
            self._transform = read_floor(floor)
        self._cell_size = check_length(cell_size, "cell_size", zero=False)
        self._max_range = check_length(max_range, "max_range", zero=False)
        self._sigma = _kinect_noise() if sigma is None else sigma
        self._radius = check_length(person_radius, "person_radius")
        self._robot = check_text(robot, "robot")
        if model is not None and not isinstance(model, ReferenceModel):
            raise ArrayError(f"model must be a warpvis.visibility.ReferenceModel, got {type(model).__name__}")
        self._model = model or ReferenceModel()
        self._device = device
        self._map: OccupancyMap | None = None
        self._last: Watched | None = None
        self._before: Watched | None = None
        """Results of the image before the last one."""
        self._heads: tuple[Agent, ...] = ()
        """People of the last image, in the floor's world, before their eyes are turned."""
        self._eyes = Eyes()
        self._lock = threading.RLock()

    @property
    def cell_size(self) -> float:
        """Side of a voxel of the map [m]."""
        return self._cell_size

    @property
    def world_from_input(self) -> NDArray[np.float64] | None:
        """Transform from the world of the poses to that of the floor, row ``x y z qx qy qz qw``; None before the floor
        is found.
        """
        return None if self._transform is None else self._transform.copy()

    @property
    def occupancy(self) -> OccupancyMap | None:
        """The map, in the floor's world; None before the floor is found."""
        return self._map

    @property
    def problem(self) -> str:
        """Why there is no floor yet, and the remedy; empty if there is one."""
        return "" if self._transform is not None or self._search is None else self._search.explain()

    def update(
        self,
        depth: ArrayInput,
        camera_to_world: PoseLike,
        people: Sequence[Agent] = (),
        *,
        time: float | None = None,
        convention: Convention = "opencv",
        quaternion: QuaternionOrder = "xyzw",
    ) -> Watched | None:
        """Add a depth image to the map, and return what everybody sees.

        The robot sees what its image shows; people see through the map. Images change the map, and each costs the same.

        Args:
            depth: Depth image as defined by the camera [m], shape ``(H, W)``, or ``(1, H, W)``.
            camera_to_world: Pose of the camera: a row ``x y z qx qy qz qw``, or a 4x4 matrix.
            people: People with one pose each in the world of the poses, such as `Agent.human`.
            time: Time of the image [s], with which probabilities of what people mean are updated; without it, each
                image is judged alone.
            convention: Axes of the camera frame of the pose.
            quaternion: Order of the quaternion of the pose, ``"xyzw"`` or ``"wxyz"``.

        Returns:
            The results; None before the floor is found: then `problem` tells why.
        """
        pose = read_row(camera_to_world, convention, quaternion)
        agents = read_people(people, self._robot)
        if time is not None and (not is_number(time) or not math.isfinite(time)):
            raise ArrayError(f"time must be a finite number of seconds, got {time!r}")
        if self._transform is None and self._search is not None:
            found = self._search.add(depth, pose)
            if found is None:
                return None
            self._transform = found.world_from_input
        with self._lock:
            return self._watch(depth, self._to_floor(pose), agents, time)

    def lines_of_sight(self, point: ArrayLike) -> dict[str, LineOfSight]:
        """Return whether the robot and each person see a point, and if not, why, by name.

        The last image decides for the robot, and the map for people. May be called from any thread.

        Args:
            point: Point in the floor's world [m], ``(3,)``.

        Raises:
            ArrayError: If there is no image yet, or if the point is at the eyes of someone.
        """
        with self._lock:
            if self._map is None or self._last is None:
                raise ArrayError("the map must not be empty: call update, and see problem if it returns None")
            robot, depth = self._last.robot, self._last.depth
            lines = {self._robot: line_of_sight_in_depth(robot, depth, point, 2 * self._cell_size)}
            return lines | {person.name: line_of_sight(self._map, person, point) for person in self._last.people}

    def turn_eyes(self, name: str, angles: tuple[float, float] | None) -> Watched | None:
        """Turn the eyes of a person from the axis of the head, in this and in later images.

        The fields of view and of attention turn with the eyes, and the person's gaze is then known. May be called from
        any thread.

        Args:
            name: Name of the person.
            angles: Angles to the right and up [rad], together at most `ReferenceModel.max_eye_angle`; None turns the
                eyes back, and the gaze is not known.

        Returns:
            The results of the last image; None without one.
        """
        check_text(name, "name")
        with self._lock:
            if angles is None:
                self._eyes.release(name)
            else:
                right, up = read_angles(angles)
                self._eyes.turn(name, right, up)
            return None if self._last is None else self._judge(self._last)

    def voxel_map(self) -> VoxelMap:
        """Return the map near the camera as a dense array: a copy.

        It extends from the camera to `max_range`, and is smaller if that has more than 16 million voxels.

        Raises:
            ArrayError: If there is no map yet.
        """
        if self._map is None or self._last is None:
            raise ArrayError("the map must not be empty: call update, and see problem if it returns None")
        mapped = self._map.bounds
        mapped[:, 2] = np.clip(mapped[:, 2], -_BELOW, _ABOVE)
        height = float(mapped[1, 2] - mapped[0, 2])
        side = math.sqrt(_MAX_VOXELS * self._cell_size**3 / height)
        reach = min(self._max_range, side / 2)
        center = self._last.camera_to_world[:2]
        low, high = mapped
        low[:2], high[:2] = np.maximum(low[:2], center - reach), np.minimum(high[:2], center + reach)
        return self._map.voxel_map((low, high), ground_tolerance=2 * self._cell_size)

    def _to_floor(self, row: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a pose in the floor's world."""
        assert self._transform is not None  # callers know that the floor was found
        return np.concatenate(
            [_move(self._transform, row[None, :3])[0], quaternion_product(self._transform[3:], row[3:])]
        )

    def _watch(
        self, depth: ArrayInput, pose: NDArray[np.float64], agents: Sequence[Agent], time: float | None
    ) -> Watched:
        assert self._transform is not None
        people = tuple(
            replace(agent, pose=self._to_floor(agent.poses[0]), convention="opencv", quaternion="xyzw")
            for agent in agents
        )
        targets = [replace(item, center=_move(self._transform, item.center[None])[0]) for item in self._targets]
        image = as_numpy(depth, name="depth")
        image = image[0] if image.ndim == 3 and len(image) == 1 else image
        options = {"device": self._device}
        points = back_project(image, self._camera, pose, **options).numpy()[0]
        labels = self._label(image, pose, targets, people, points)
        self._integrate(np.where(labels == Label.HUMAN, np.nan, image).astype(np.float32), pose)
        assert self._map is not None
        robot = Agent(self._robot, self._camera, pose)
        places = {item.name: np.append(item.center, item.diameter) for item in targets}
        self._before, self._heads = self._last, people
        return self._judge(Watched(time, robot, people, image, labels, points, places, {}, {}))

    def _judge(self, watched: Watched) -> Watched:
        """Compute what everybody sees of the places in an image that is in the map."""
        assert self._map is not None
        people = tuple(self._eyes.looking(head) for head in self._heads)
        targets = [Target(name, place[:3], float(place[3])) for name, place in watched.places.items()]
        sights = {self._robot: see_in_image(targets, watched.robot, watched.depth, 2 * self._cell_size)}
        for person in people:
            sights[person.name] = see_through_map(targets, person, self._map)
        candidates = {person.name: self._candidates(person, targets, sights, watched.time) for person in people}
        self._last = replace(watched, people=people, sights=sights, candidates=candidates)
        return self._last

    def _label(
        self,
        image: NDArray[np.floating],
        pose: NDArray[np.float64],
        targets: Sequence[Target],
        people: Sequence[Agent],
        points: NDArray[np.float32],
    ) -> NDArray[np.uint8]:
        spheres = [Sphere(tuple(item.center), item.diameter) for item in targets if item.diameter > 0]
        labels = (
            classify(
                image,
                self._camera,
                pose,
                spheres=spheres,
                ground_tolerance=self._cell_size,
                floor=_FLOOR,
                sigma=self._sigma or None,
                device=self._device,
            )
            .numpy()[0]
            .copy()
        )
        for person in people:
            x, y, z = person.poses[0, :3]
            with np.errstate(invalid="ignore"):
                near = np.hypot(points[..., 0] - x, points[..., 1] - y) < self._radius
                near &= points[..., 2] < z + _ABOVE_EYES
            labels[near & (labels == Label.OBSTACLE)] = Label.HUMAN
        return labels

    def _integrate(self, image: NDArray[np.float32], pose: NDArray[np.float64]) -> None:
        if self._map is None:
            low, high = pose[:2] - _EXTENT, pose[:2] + _EXTENT
            bounds = np.array([[*low, -_BELOW], [*high, _ABOVE]])
            self._map = OccupancyMap(self._cell_size, bounds=bounds, device=self._device)
        self._map.integrate(image, self._camera, pose, sigma=self._sigma, max_range=self._max_range)

    def _candidates(
        self,
        person: Agent,
        targets: Sequence[Target],
        sights: Mapping[str, Mapping[str, Sight]],
        time: float | None,
    ) -> dict[str, float]:
        """Return the probabilities of what a person means."""
        previous, elapsed = None, None
        if self._before is not None and self._before.time is not None and time is not None:
            previous, elapsed = self._before.candidates.get(person.name), time - self._before.time
            if elapsed < 0:
                previous = elapsed = None  # a recording begins again
        found = sights[person.name], sights[self._robot]
        gazing = person.name in self._eyes.angles
        return probabilities(self._model, person, targets, *found, previous, elapsed, gazing=gazing)


def _kinect_noise() -> Sigma:
    from warpvis.sensors import KhoshelhamNoise

    return KhoshelhamNoise()


def _move(transform: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Transform points ``(N, 3)`` by a pose row."""
    matrix = poses_to_matrices(transform[None])[0]
    return points @ matrix[:3, :3].T + matrix[:3, 3]
