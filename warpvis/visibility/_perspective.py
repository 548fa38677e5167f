# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visibility of a scene's objects to several agents, and comparison of pairs of agents."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.core.checks import as_items, format_fraction, is_number
from warpvis.core.labels import Label, LabelNames, Visibility
from warpvis.core.poses import QuaternionOrder, parse_poses, to_xyzw
from warpvis.core.types import ArrayInput, ObjectPoses
from warpvis.errors import ArrayError, SceneError
from warpvis.scene import Scene, require_scene
from warpvis.scene.worlds import parse_worlds
from warpvis.visibility._agents import Agent, Situations
from warpvis.visibility._candidates import (
    Candidate,
    State,
    parse_previous,
    require_model,
    weigh_candidates,
)
from warpvis.visibility._extents import ObjectBoxes, VisibleParts
from warpvis.visibility._objects import COUNTERS, ObjectVisibility, choose_objects, see_objects
from warpvis.visibility._reference_model import ReferenceModel


@dataclass(frozen=True, eq=False)
class Perspective:
    """Visibility of K objects to A agents in V situations, as NumPy arrays in host memory."""

    agents: tuple[str, ...]
    """Names of the agents."""
    objects: tuple[str, ...]
    """Names of the objects."""
    labels: tuple[int, ...]
    """Labels of the objects."""
    fraction: NDArray[np.float32]
    """Visible fraction of the silhouette, ``(A, V, K)``; 0 without a silhouette."""
    status: NDArray[np.uint8]
    """`Visibility`: VISIBLE, or the reason that applies to most of the object's pixels in the images, ``(A, V, K)``."""
    visible_pixels: NDArray[np.int32]
    """Pixels that show the object, summed over all images of an agent, ``(A, V, K)``."""
    silhouette_pixels: NDArray[np.int32]
    """Pixels of the isolated object's silhouette, inside and outside the images, ``(A, V, K)``."""
    occluder: NDArray[np.int32]
    """Index into `scene_objects` of the object that hides most of it; -1 for none, ``(A, V, K)``."""
    attended: NDArray[np.bool_]
    """Whether the agent sees the object and it is in the agent's field of attention, if it has one, ``(A, V, K)``."""
    gaze_angle: NDArray[np.float32]
    """Angle between the agent's axis and the center of the object's box [rad], ``(A, V, K)``. The box is aligned with
    the object's frame if it is movable, otherwise with the world."""
    body: NDArray[np.bool_]
    """Whether the object is part of the agent's own body, which it does not see, ``(A, K)``."""
    scene_objects: tuple[str, ...]
    """Names of all objects of the scene."""
    object_poses: NDArray[np.float32] | None = None
    """Poses of the movable objects in each situation, or in all of them, rows ``x y z qx qy qz qw``, ``(V, M, 7)`` or
    ``(1, M, 7)``; None if nothing is movable."""
    label_names: LabelNames = field(default_factory=LabelNames)
    """Names of the scene's classes."""
    _parts: tuple[VisibleParts, ...] = field(default=(), repr=False)
    """Images of each agent, for `candidates`."""
    _boxes: ObjectBoxes = field(default_factory=ObjectBoxes.none, repr=False)
    """Boxes of the objects, for `candidates`."""

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Whether the agent sees the object, ``(A, V, K)``."""
        return self.status == Visibility.VISIBLE

    def states(self, first: str, second: str) -> NDArray[np.uint8]:
        """Return the `State` of every object for two agents, ``(V, K)``. An agent does not see its own body.

        FIRST means that only the agent `first` sees it. Where this package compares a robot and a person, the robot is
        first: `candidates` as ``states(robot, human)``, `report` and `table` in the order of `agents`.
        """
        seen = self.visible
        return (State.FIRST * seen[self._agent(first)] + State.SECOND * seen[self._agent(second)]).astype(np.uint8)

    def candidates(
        self,
        human: str,
        robot: str | None = None,
        *,
        view: int = 0,
        labels: Sequence[Label | int | str] | None = (Label.OBJECT,),
        exclude: Sequence[str] = (),
        gaze: ArrayInput | None = None,
        pointing: ArrayInput | None = None,
        previous: Sequence[Candidate] | None = None,
        elapsed: float | None = None,
        model: ReferenceModel | None = None,
    ) -> list[Candidate]:
        """Return the objects that a person may refer to, those that the person sees, most likely first.

        Probabilities sum to 1. Objects of equal probability are in the order of the scene's objects.

        Args:
            human: Name of the person.
            robot: Name of a robot, for `Candidate.state`, `Candidate.robot_fraction` and
                `ReferenceModel.person_only_weight`.
            view: Index of the situation.
            labels: Labels of the objects to include, numbers or names; None for all.
            exclude: Names of objects that are not meant, for example the robot's body.
            gaze: Direction in the world in which the person's eyes look, of any length, ``(3,)``. By default only the
                head's direction is known, the axis of the person's pose.
            pointing: Rays along the person's fingers or forearms, ``x y z dx dy dz`` in the world [m], ``(6,)`` or
                ``(R, 6)``. Rays are treated as independent: pass one for each arm that points.
            previous: Candidates of the previous frame, whose probabilities are updated. They may come from another
                `Perspective`: objects are matched by name.
            elapsed: Time since `previous` [s].
            model: Parameters of the probability; those of `ReferenceModel()` by default.

        Raises:
            ArrayError: If `gaze` is outside the range of the eyes, `ReferenceModel.max_eye_angle`.
        """
        person, view, model = self._agent(human), self._view(view), require_model(model)
        included = set(self.labels) if labels is None else self.label_names.numbers(labels)
        excluded = as_items(exclude, "exclude", SceneError)
        unknown = [name for name in excluded if not isinstance(name, str) or name not in self.scene_objects]
        if unknown:
            raise SceneError(f"exclude must be names of objects of the scene, got {unknown[0]!r}")
        robot_index = None if robot is None else self._agent(robot)
        states = None if robot is None else self.states(robot, human)[view]
        chosen = [self.labels[k] in included and name not in excluded for k, name in enumerate(self.objects)]
        found = np.flatnonzero(self.visible[person, view] & chosen)
        fractions = self.fraction[person, view, found].astype(np.float64)
        evidence = weigh_candidates(
            model,
            self._parts[person],
            self._boxes,
            found,
            view,
            fractions=fractions,
            person_only=np.zeros(len(found), dtype=bool) if states is None else states[found] == State.SECOND,
            object_poses=self.objects_at(view),
            gaze=gaze,
            pointing=pointing,
            previous=parse_previous(previous, elapsed, [self.objects[k] for k in found]),
        )
        angles = evidence.pointing_angles
        return [
            Candidate(
                object=self.objects[k],
                probability=float(evidence.probabilities[n]),
                fraction=float(fractions[n]),
                gaze_angle=float(evidence.gaze_angles[n]),
                pointing_angle=None if angles is None else float(angles[n]),
                solid_angle=float(evidence.solid_angles[n]),
                attended=bool(self.attended[person, view, k]),
                state=None if states is None else State(states[k]),
                robot_fraction=None if robot_index is None else float(self.fraction[robot_index, view, k]),
                object_poses=self.objects_at(view),
            )
            for n in np.argsort(-evidence.probabilities, kind="stable")
            for k in [found[n]]
        ]

    def to_see(
        self,
        robot: str,
        human: str,
        *,
        view: int = 0,
        labels: Sequence[Label | int | str] | None = (Label.OBJECT,),
    ) -> list[str]:
        """Return the names of the objects that the person sees and the robot does not, in the order of `candidates`.

        The person may refer to one of them, and the robot must move to see it. The robot's own body is not included.
        """
        own_body = [name for name, is_own in zip(self.objects, self.body[self._agent(robot)], strict=True) if is_own]
        found = self.candidates(human, robot, view=view, labels=labels, exclude=own_body)
        return [item.object for item in found if item.state == State.SECOND]

    def objects_at(self, view: int) -> NDArray[np.float32] | None:
        """Return the poses of the movable objects in a situation, ``(M, 7)``; None if nothing is movable."""
        if self.object_poses is None:
            return None
        return self.object_poses[self._view(view) if len(self.object_poses) > 1 else 0]

    def report(self, view: int = 0) -> dict[str, Any]:
        """Return all results of one situation as plain Python values, suitable for `json.dumps`."""
        view = self._view(view)
        pairs = [(pair, self.states(*pair)[view]) for pair in itertools.combinations(self.agents, 2)]
        objects = []
        for k, name in enumerate(self.objects):
            states = [{"first": a, "second": b, "state": State(state[k]).name} for (a, b), state in pairs]
            views = {agent: self._entry(a, view, k) for a, agent in enumerate(self.agents)}
            objects.append(
                {"name": name, "label": self.label_names.word(self.labels[k]), "agents": views, "states": states}
            )
        return {"view": view, "agents": list(self.agents), "objects": objects}

    def _entry(self, agent: int, view: int, k: int) -> dict[str, Any]:
        """Return the entry of `report` for an agent and an object."""
        index = (agent, view, k)
        return {
            "visible": bool(self.visible[index]),
            "status": Visibility(self.status[index]).name,
            "own_body": bool(self.body[agent, k]),
            "fraction": float(self.fraction[index]),
            "visible_pixels": int(self.visible_pixels[index]),
            "silhouette_pixels": int(self.silhouette_pixels[index]),
            "occluder": self.scene_objects[self.occluder[index]] if self.occluder[index] >= 0 else None,
            "attended": bool(self.attended[index]),
            "gaze_angle": float(self.gaze_angle[index]),
        }

    def table(self, view: int = 0) -> str:
        """Format one situation as a text table: a row per object, a column per agent and per pair of agents.

        An agent's column contains the visible fraction, or the reason why the agent does not see the object.
        """
        view = self._view(view)
        pairs = list(itertools.combinations(self.agents, 2))
        rows = [["object", "label", *self.agents, *(f"{a} / {b}" for a, b in pairs)]]
        states = [(pair, self.states(*pair)[view]) for pair in pairs]
        for k, name in enumerate(self.objects):
            cells = [self.cell(a, view, k) for a in range(len(self.agents))]
            rows.append(
                [
                    name,
                    self.label_names.name(self.labels[k]),
                    *cells,
                    *(("neither", f"{a} only", f"{b} only", "both")[state[k]] for (a, b), state in states),
                ]
            )
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        rows.insert(1, ["-" * width for width in widths])
        return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)

    def cell(self, agent: int, view: int, k: int, share: Callable[[float], str] = format_fraction) -> str:
        """Return the cell of `table` for an agent and an object; `share` formats the visible fraction."""
        index = (agent, view, k)
        if self.body[agent, k]:
            return "own body"
        status = Visibility(self.status[index])
        if status == Visibility.VISIBLE:
            text = share(float(self.fraction[index]))
            return f"{text} ({int(self.visible_pixels[index])} px)" if text.startswith("<") else text
        if status == Visibility.OCCLUDED and self.occluder[index] >= 0:
            return f"hidden by {self.scene_objects[self.occluder[index]]}"
        return status.name.lower().replace("_", " ")

    def _agent(self, name: str) -> int:
        if not isinstance(name, str) or name not in self.agents:
            raise SceneError(f"there is no agent {name!r}; there are {', '.join(map(repr, self.agents))}")
        return self.agents.index(name)

    def _view(self, view: int) -> int:
        views = self.status.shape[1]
        if isinstance(view, bool) or not isinstance(view, int | np.integer) or not 0 <= view < views:
            raise ArrayError(f"view must be a whole number from 0 to {views - 1}, got {view!r}")
        return int(view)


def perspective(
    scene: Scene,
    agents: Sequence[Agent],
    *,
    objects: Sequence[str | int] | None = None,
    min_pixels: int = 1,
    min_fraction: float = 0.0,
    delta: float = 0.0,
    object_poses: ObjectPoses = None,
    quaternion: QuaternionOrder = "xyzw",
    world_index: ArrayInput | None = None,
    threads: int | None = None,
) -> Perspective:
    """Compute the visibility of a scene's objects to agents, with `object_visibility` from each agent's pose.

    The counts of a wide `FieldOfView` are sums over its faces; fractions and reasons are computed from the sums. The
    body of an agent is an ordinary object to other agents.

    Args:
        scene: The scene.
        agents: Agents with distinct names. An agent has one pose for all situations, or one for each of V situations.
        objects: Names or indices of the objects to measure; all by default.
        min_pixels: Minimum number of visible pixels for an object to be seen, and to be attended to.
        min_fraction: Minimum visible fraction of the silhouette for an object to be seen.
        delta: Maximum distance of a surface behind the visible surface to count as visible [m]; see
            `object_visibility`.
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
    measurement = _Measurement(scene, indices, situations, min_pixels, delta, threads)
    shape = (situations.count, len(indices))

    sums, occluders, attended, angles, parts = [], [], [], [], []
    boxes = ObjectBoxes.of(scene, indices)
    centers = situations.move(boxes.bounds.mean(axis=1), boxes.columns)
    for agent in agents:
        counts, occluder, part = measurement.measure(agent)
        parts.append(part)
        sums.append(np.broadcast_to(counts, (len(COUNTERS), *shape)))
        occluders.append(np.broadcast_to(occluder, shape))
        attended.append(np.broadcast_to(measurement.count_attended(agent) >= min_pixels, shape))
        angles.append(np.broadcast_to(agent.angles_to(centers), shape))
    counts = np.stack(sums, axis=1)
    visible, _, silhouette, _, _ = counts
    fraction = visible / np.maximum(silhouette, 1)
    status = _status(counts, (visible >= min_pixels) & (fraction >= min_fraction))
    items = scene.objects
    return Perspective(
        agents=tuple(agent.name for agent in agents),
        objects=tuple(items[index].name for index in indices),
        labels=tuple(items[index].label for index in indices),
        fraction=fraction.astype(np.float32),
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


@dataclass(frozen=True)
class _Measurement:
    """Arguments shared by all measurements of a call."""

    scene: Scene
    indices: list[int]
    situations: Situations
    min_pixels: int
    delta: float
    threads: int | None

    def measure(self, agent: Agent) -> tuple[NDArray[np.int32], NDArray[np.int32], VisibleParts]:
        """Return an agent's `COUNTERS`, summed over its faces, ``(5, views, K)``, main occluders and visible pixels."""
        faces = [self._see(agent, face.camera, agent.face_poses(face), face.canvas) for face in agent.faces]
        counts = np.stack([[getattr(seen, name).numpy() for name in COUNTERS] for seen in faces])
        hidden = np.stack([_hidden_pixels(one) for one in counts])
        occluders = np.stack([seen.occluder.numpy() for seen in faces])
        main_face = hidden.argmax(axis=0)[None]
        images = tuple((face.camera, agent.face_poses(face)) for face in agent.faces)
        boxes = np.stack([seen.visible_box.numpy() for seen in faces])
        parts = VisibleParts(agent.poses, images, boxes, counts[:, 0].copy())
        return counts.sum(axis=0, dtype=np.int32), np.take_along_axis(occluders, main_face, axis=0)[0], parts

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
        worlds = parse_worlds(scene, views, situations.object_poses, situations.world_index, agent.body or None)
        options: dict[str, Any] = {"delta": self.delta, "min_pixels": self.min_pixels, "threads": self.threads}
        return see_objects(scene, camera, rows, worlds, self.indices, canvas=canvas, **options)


def _hidden_pixels(counts: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the number of pixels in which objects are within the depth range and occluded."""
    visible, image, _, too_near, too_far = counts
    return np.maximum(image - visible - too_near - too_far, 0)


def _status(counts: NDArray[np.int32], seen: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return `Visibility` from `COUNTERS`: VISIBLE where `seen`, otherwise the reason for most pixels in the images."""
    _, image, silhouette, too_near, too_far = counts
    hidden = _hidden_pixels(counts)
    reasons = np.array([Visibility.OCCLUDED, Visibility.TOO_NEAR, Visibility.TOO_FAR], dtype=np.uint8)
    pixels = np.stack([hidden, too_near, too_far])
    status = reasons[pixels.argmax(axis=0)]
    # If all pixels in the images are visible but too few, the rest is outside the images, or the object is too far.
    too_few = np.where(silhouette > image, Visibility.OUT_OF_VIEW, Visibility.TOO_FAR)
    status = np.where(pixels.any(axis=0), status, too_few)
    status = np.where(image == 0, Visibility.OUT_OF_VIEW, status)
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
