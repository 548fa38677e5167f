# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measurement of a scene's objects from the poses of several agents, in one or many situations."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.core.checks import as_items, is_number, pluralize
from warpvis.core.labels import LabelNames, Visibility
from warpvis.core.poses import QuaternionOrder, check_up, parse_poses, to_xyzw
from warpvis.core.types import ArrayInput, ObjectPoses
from warpvis.core.user_warnings import warn_user
from warpvis.errors import ArrayError, SceneError
from warpvis.maps import OccupancyMap
from warpvis.rendering import warn_of_eyes_inside, warn_of_units
from warpvis.scene import Scene, require_scene
from warpvis.scene.worlds import parse_worlds
from warpvis.visibility._agents import Agent, Situations
from warpvis.visibility._extents import ObjectBoxes, VisibleParts
from warpvis.visibility._measured_space import MeasuredSpace, as_space
from warpvis.visibility._objects import COUNTERS, ObjectVisibility, choose_objects, see_objects
from warpvis.visibility._perspective import Perspective


def perspective(
    scene: Scene,
    agents: Sequence[Agent],
    *,
    objects: Sequence[str | int] | None = None,
    min_pixels: int = 1,
    min_fraction: float = 0.0,
    delta: float = 0.0,
    occupancy: OccupancyMap | MeasuredSpace | None = None,
    object_poses: ObjectPoses = None,
    quaternion: QuaternionOrder = "xyzw",
    world_index: ArrayInput | None = None,
    threads: int | None = None,
) -> Perspective:
    """Compute the visibility of a scene's objects to agents, with `object_visibility` from each agent's pose.

    The counts of a wide `FieldOfView` are sums over its faces; fractions and reasons are computed from the sums. The
    body of an agent is an ordinary object to other agents. With `Agent.head`, an agent's own body hides things from it.

    A sequence of T frames is one call with T poses of the agents that move, and T worlds if objects move: the result
    has T situations, ``seen[t]`` is the one of frame t. Images are rendered in batches of limited size, so memory grows
    only with the results, about 150 bytes for each agent, situation and object.

    Args:
        scene: The scene.
        agents: Agents with distinct names. An agent has one pose for all situations, or one for each of V situations.
        objects: Names or indices of the objects to measure; all by default.
        min_pixels: Minimum number of visible pixels for an object to be seen, and to be attended to.
        min_fraction: Minimum visible fraction of the silhouette for an object to be seen.
        delta: Maximum distance of a surface behind the visible surface to count as visible [m]; see
            `object_visibility`.
        occupancy: A map of measured space that may hide the objects, too, or a `MeasuredSpace`, on the scene's device.
            Objects are UNKNOWN to an agent if most of their hidden pixels are behind space that was never measured.
        object_poses: Poses of the movable objects in each of W worlds, as for `Renderer.render`.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        world_index: World of each situation, as for `Renderer.render`. By default, all situations share the only world,
            or each of V situations has one of V worlds.
        threads: CPU threads to use; all cores of this process by default.
    """
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    agents = _check_agents(scene, agents)
    if not is_number(min_fraction) or not 0 <= min_fraction <= 1:
        raise ArrayError(f"min_fraction must be from 0 to 1, got {min_fraction!r}")
    indices = choose_objects(scene, objects)
    situations = Situations.parse(scene, agents, object_poses, world_index)
    space = as_space(occupancy, scene.device)
    measurement = _Measurement(scene, indices, situations, min_pixels, delta, space, threads)
    shape = (situations.count, len(indices))

    sums, unknown_sums, occluders, attended, angles, parts = [], [], [], [], [], []
    boxes = ObjectBoxes.of(scene, indices)
    centers = boxes.centers(situations.rows())
    for agent in agents:
        counts, unknown, occluder, part = measurement.measure(agent)
        parts.append(part)
        unknown_sums.append(np.broadcast_to(unknown, shape))
        sums.append(np.broadcast_to(counts, (len(COUNTERS), *shape)))
        occluders.append(np.broadcast_to(occluder, shape))
        attended.append(np.broadcast_to(measurement.count_attended(agent) >= min_pixels, shape))
        angles.append(np.broadcast_to(agent.angles_to(centers), shape))
    counts = np.stack(sums, axis=1)
    visible, _, silhouette, _, _ = counts
    fraction = visible / np.maximum(silhouette, 1)
    unknown = np.stack(unknown_sums)
    status = _status(counts, unknown, (visible >= min_pixels) & (fraction >= min_fraction))
    _warn_of_blind_agents(scene, agents, status, moves=object_poses is not None)
    items = scene.objects
    return Perspective(
        agents=tuple(agent.name for agent in agents),
        objects=tuple(items[index].name for index in indices),
        labels=tuple(items[index].label for index in indices),
        fraction=fraction.astype(np.float32),
        unknown_fraction=(unknown / np.maximum(silhouette, 1)).astype(np.float32),
        status=status,
        visible_pixels=visible,
        silhouette_pixels=silhouette,
        occluder=np.stack(occluders),
        attended=np.stack(attended) & (status == Visibility.VISIBLE),
        gaze_angle=np.stack(angles).astype(np.float32),
        body=np.array([[items[index].name in agent.body for index in indices] for agent in agents]),
        scene_objects=tuple(item.name for item in items),
        object_poses=situations.rows(),
        label_names=LabelNames(scene.label_names),
        _parts=tuple(parts),
        _boxes=boxes,
    )


def _warn_of_blind_agents(scene: Scene, agents: Sequence[Agent], status: NDArray[np.uint8], *, moves: bool) -> None:
    """Warn of agents that see nothing, with the likely reason: far away, inside an object, or below the floor."""
    fixed = np.array([not (moves and item.movable) for item in scene.objects])
    ground = [item.bounds for item in scene.objects if item.label in scene.ground_labels]
    axis = check_up(scene.up)
    lowest = min((float(box[0, axis]) for box in ground), default=-np.inf)
    for agent, states in zip(agents, status, strict=True):
        poses, camera = agent.poses.astype(np.float32), agent.faces[0].camera
        below = agent.poses[:, axis] < lowest
        if below.any():
            warn_user(
                f"agent {agent.name!r} is below the floor in {pluralize(int(below.sum()), 'pose')}, at {'xyz'[axis]} = "
                f"{agent.poses[below][0, axis]:.3g} m: the lowest ground is at {lowest:.3g} m; check the axes of the "
                "world and the height of the agent",
                UserWarning,
            )
            continue
        blind = np.flatnonzero(~(states == Visibility.VISIBLE).any(axis=1))
        if len(blind):
            seen = fixed & np.array([item.name not in (*agent.body, *agent.excluded) for item in scene.objects])
            if len(blind) == len(states):
                warn_of_units(scene, camera.far, seen, poses)
            views = blind if len(poses) == len(states) else np.zeros(1, dtype=np.intp)
            warn_of_eyes_inside(scene, camera.near, poses, views, seen)


@dataclass(frozen=True)
class _Measurement:
    """Arguments shared by all measurements of a call."""

    scene: Scene
    indices: list[int]
    situations: Situations
    min_pixels: int
    delta: float
    space: MeasuredSpace | None
    threads: int | None

    def measure(self, agent: Agent) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], VisibleParts]:
        """Return an agent's `COUNTERS`, unknown pixels, main occluders and visible pixels.

        Counters are summed over its faces, ``(5, views, K)``, and unknown pixels, too, ``(views, K)``.
        """
        faces = [self._see(agent, face.camera, agent.face_poses(face), face.canvas) for face in agent.faces]
        counts = np.stack([[getattr(seen, name).numpy() for name in COUNTERS] for seen in faces])
        hidden = np.stack([_hidden_pixels(one) for one in counts])
        unknown = np.zeros_like(counts[0, 0])
        for seen in faces:
            if seen.unknown_pixels is not None:
                unknown += seen.unknown_pixels.numpy()
        occluders = np.stack([seen.occluder.numpy() for seen in faces])
        main_face = hidden.argmax(axis=0)[None]
        images = tuple((face.camera, agent.face_poses(face)) for face in agent.faces)
        boxes = np.stack([seen.visible_box.numpy() for seen in faces])
        parts = VisibleParts(agent.poses, images, boxes, counts[:, 0].copy())
        occluder = np.take_along_axis(occluders, main_face, axis=0)[0]
        return counts.sum(axis=0, dtype=np.int32), unknown, occluder, parts

    def count_attended(self, agent: Agent) -> NDArray[np.int32]:
        """Return the visible pixels of each object in the field of attention, ``(views, K)``; INT32_MAX without one."""
        if agent.attention is None:
            return np.array(np.iinfo(np.int32).max, dtype=np.int32)
        return self._see(agent, agent.attention, agent.poses, (0, 0, 0, 0)).visible_pixels.numpy()

    def _see(
        self, agent: Agent, camera: ImageCamera, poses: NDArray[np.float64], canvas: tuple[int, int, int, int]
    ) -> ObjectVisibility:
        situations, scene = self.situations, self.scene
        # An agent with one pose in a single world is measured once for all situations.
        views = len(poses) if situations.world_index is None else situations.count
        rows = parse_poses(np.broadcast_to(poses, (views, 7)), device=scene.device)
        worlds = parse_worlds(scene, views, situations.object_poses, situations.world_index, agent.excluded or None)
        options: dict[str, Any] = {"delta": self.delta, "min_pixels": self.min_pixels, "threads": self.threads}
        return see_objects(scene, camera, rows, worlds, self.indices, canvas=canvas, space=self.space, **options)


def _hidden_pixels(counts: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the number of pixels in which objects are within the depth range and occluded."""
    visible, image, _, too_near, too_far = counts
    return np.maximum(image - visible - too_near - too_far, 0)


def _status(counts: NDArray[np.int32], unknown: NDArray[np.int32], seen: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return `Visibility` from `COUNTERS`: VISIBLE where `seen`, otherwise the reason for most pixels in the images."""
    visible, image, silhouette, too_near, too_far = counts
    hidden = _hidden_pixels(counts)
    reasons = np.array([Visibility.OCCLUDED, Visibility.TOO_NEAR, Visibility.TOO_FAR], dtype=np.uint8)
    pixels = np.stack([hidden, too_near, too_far])
    status = reasons[pixels.argmax(axis=0)]
    # If all pixels in the images are visible but too few, the rest is outside the images, or the object is too far.
    too_few = np.where(silhouette > image, Visibility.OUT_OF_VIEW, Visibility.TOO_FAR)
    status = np.where(pixels.any(axis=0), status, too_few)
    status = np.where(image == 0, Visibility.OUT_OF_VIEW, status)
    most_unknown = (status == Visibility.OCCLUDED) & (2 * unknown > image - visible)
    status = np.where(most_unknown, Visibility.UNKNOWN, status)
    return np.where(seen, Visibility.VISIBLE, status).astype(np.uint8)


def _check_agents(scene: Scene, agents: Sequence[Agent]) -> list[Agent]:
    require_scene(scene).require_objects()
    agents = as_items(agents, "agents", SceneError) if isinstance(agents, Iterable) else [agents]
    wrong = [type(agent).__name__ for agent in agents if not isinstance(agent, Agent)]
    if wrong or not agents:
        raise SceneError(f"agents must be one or more of warpvis.Agent, got {', '.join(wrong) or 'none'}")
    names = [agent.name for agent in agents]
    repeated = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if repeated:
        raise SceneError(f"agents must have different names, got {', '.join(map(repr, repeated))} more than once")
    return agents
