# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Results for several agents in many situations: states of pairs of agents, candidates, reports and tables."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_items, format_fraction, is_whole
from warpvis.core.labels import Label, LabelNames, Visibility
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError, SceneError
from warpvis.visibility._candidates import Candidate, Query, State, require_model
from warpvis.visibility._extents import ObjectBoxes, VisibleParts
from warpvis.visibility._reference_model import ReferenceModel
from warpvis.visibility._tracking import Sequences, track_candidates


@dataclass(frozen=True, eq=False)
class Perspective:
    """Visibility of K objects to A agents in V situations, as NumPy arrays in host memory.

    ``len(seen)`` is V; ``seen[3]`` is a `Perspective` of one situation, ``seen[10:20]`` one of ten, and a loop over
    `seen` goes through the situations, for example the frames of a sequence.
    """

    agents: tuple[str, ...]
    """Names of the agents."""
    objects: tuple[str, ...]
    """Names of the objects."""
    labels: tuple[int, ...]
    """Labels of the objects."""
    fraction: NDArray[np.float32]
    """Visible fraction of the silhouette, ``(A, V, K)``; 0 without a silhouette."""
    unknown_fraction: NDArray[np.float32]
    """Fraction of the silhouette behind space that was never measured, ``(A, V, K)``; 0 without an occupancy map."""
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
    """Whether the object is part of the agent's own body, ``(A, K)``. The agent does not see it, except for parts that
    `Agent.head` leaves out."""
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

    def __len__(self) -> int:
        return self.status.shape[1]

    def __iter__(self) -> Iterator[Perspective]:
        return (self[view] for view in range(len(self)))

    def __getitem__(self, views: int | slice) -> Perspective:
        """Return one situation, or a slice of situations."""
        if is_whole(views) and -len(self) <= views < len(self):
            views = slice(int(views) % len(self), int(views) % len(self) + 1)
        if not isinstance(views, slice):
            raise ArrayError(f"a Perspective must be indexed by a slice or a number below {len(self)}, got {views!r}")
        arrays = (
            "fraction",
            "unknown_fraction",
            "status",
            "visible_pixels",
            "silhouette_pixels",
            "occluder",
            "attended",
            "gaze_angle",
        )
        poses = self.object_poses
        return replace(
            self,
            **{name: getattr(self, name)[:, views] for name in arrays},
            object_poses=poses[views] if poses is not None and len(poses) > 1 else poses,
            _parts=tuple(part.select(views) for part in self._parts),
        )

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Whether the agent sees the object, ``(A, V, K)``."""
        return self.status == Visibility.VISIBLE

    def states(self, first: str, second: str | Sequence[str]) -> NDArray[np.uint8]:
        """Return the `State` of every object for two agents, ``(V, K)``; or for one agent and several others.

        With several others, SECOND means that only others see the object, and BOTH that at least one of them does too.
        FIRST means that only the agent `first` sees it. Where this package compares a robot and a person, the robot is
        first: `candidates` as ``states(robot, human)``, `report` and `table` in the order of `agents`.
        """
        seen, others = self.visible, [self._agent(name) for name in as_items(second, "second", SceneError)]
        by_others = seen[others].any(axis=0)
        return (State.FIRST * seen[self._agent(first)] + State.SECOND * by_others).astype(np.uint8)

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
        others: Sequence[Sequence[Candidate]] = (),
        previous: Sequence[Candidate] | None = None,
        elapsed: float | None = None,
        model: ReferenceModel | None = None,
    ) -> list[Candidate]:
        """Return the objects that a person may refer to, those that the person sees, most likely first.

        The person's own body is not included. Probabilities sum to 1. Objects of equal probability are in the order of
        the scene's objects.

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
            others: Candidates of each of the other people, whose attention the person may share; see
                `ReferenceModel.joint_attention`. Compute them without `others`, or evidence counts twice.
            previous: Candidates of the previous frame, whose probabilities are updated. They may come from another
                `Perspective`: objects are matched by name.
            elapsed: Time since `previous` [s].
            model: Parameters of the probability; those of `ReferenceModel()` by default.

        Raises:
            ArrayError: If `gaze` is outside the range of the eyes, `ReferenceModel.max_eye_angle`.
        """
        query = self._query(human, robot, labels, exclude, model)
        return query.candidates(self._view(view), gaze, pointing, others, previous, elapsed)

    def track(
        self,
        human: str,
        robot: str | None = None,
        *,
        times: ArrayInput,
        labels: Sequence[Label | int | str] | None = (Label.OBJECT,),
        exclude: Sequence[str] = (),
        gaze: ArrayInput | None = None,
        pointing: ArrayInput | None = None,
        others: Sequence[Sequence[Sequence[Candidate]]] = (),
        model: ReferenceModel | None = None,
    ) -> list[list[Candidate]]:
        """Return the `candidates` of every situation, each updated from the one before, for the frames of a sequence.

        Dwelling on an object makes it likelier from frame to frame. Following a moving object with the eyes does, too:
        unlike a loop over `candidates`, this compares the motion of the gaze with that of the objects.

        Args:
            human: Name of the person.
            robot: Name of a robot; see `candidates`.
            times: Time of each situation [s], not decreasing, ``(V,)``.
            labels: See `candidates`.
            exclude: See `candidates`.
            gaze: Direction in which the eyes look in each situation, ``(V, 3)``; NaN where it is unknown.
            pointing: Rays in each situation, ``(V, 6)`` or ``(V, R, 6)``; NaN for a ray that is missing.
            others: Results of `track` for each of the other people, without `others`.
            model: See `candidates`.
        """
        query = self._query(human, robot, labels, exclude, model)
        return track_candidates(query, Sequences.parse(len(self), times, gaze, pointing, others))

    def _query(
        self,
        human: str,
        robot: str | None,
        labels: Sequence[Label | int | str] | None,
        exclude: Sequence[str],
        model: ReferenceModel | None,
    ) -> Query:
        """Parse arguments of `candidates`."""
        person, model = self._agent(human), require_model(model)
        included = set(self.labels) if labels is None else self.label_names.numbers(labels)
        excluded = as_items(exclude, "exclude", SceneError)
        unknown = [name for name in excluded if not isinstance(name, str) or name not in self.scene_objects]
        if unknown:
            raise SceneError(f"exclude must be names of objects of the scene, got {unknown[0]!r}")
        chosen = [
            label in included and name not in excluded for label, name in zip(self.labels, self.objects, strict=True)
        ]
        visible, fraction = self.visible, self.fraction
        agent = None if robot is None else self._agent(robot)
        return Query(
            self.objects,
            visible[person] & ~self.body[person] & chosen,
            fraction[person],
            self.attended[person],
            None if agent is None else (visible[agent], fraction[agent]),
            self.object_poses,
            self._parts[person],
            self._boxes,
            model,
        )

    def to_see(
        self,
        robot: str,
        human: str,
        *,
        view: int = 0,
        labels: Sequence[Label | int | str] | None = (Label.OBJECT,),
        gaze: ArrayInput | None = None,
        pointing: ArrayInput | None = None,
        model: ReferenceModel | None = None,
    ) -> list[str]:
        """Return the names of the objects that the person sees and the robot does not, most likely first.

        The person may refer to one of them, and the robot must move to see it. The robot's own body is not included.
        See `candidates` for `gaze`, `pointing` and `model`.
        """
        own_body = [name for name, is_own in zip(self.objects, self.body[self._agent(robot)], strict=True) if is_own]
        evidence: dict[str, Any] = {"gaze": gaze, "pointing": pointing, "model": model}
        found = self.candidates(human, robot, view=view, labels=labels, exclude=own_body, **evidence)
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
            "unknown_fraction": float(self.unknown_fraction[index]),
            "visible_pixels": int(self.visible_pixels[index]),
            "silhouette_pixels": int(self.silhouette_pixels[index]),
            "occluder": self.scene_objects[self.occluder[index]] if self.occluder[index] >= 0 else None,
            "attended": bool(self.attended[index]),
            "gaze_angle": float(self.gaze_angle[index]),
        }

    def table(self, view: int = 0) -> str:
        """Format one situation as a text table: a row per object, a column per agent and per pair of agents.

        An agent's column contains the visible fraction, or the reason why the agent does not see the object, and the
        fraction that is behind space that was never measured, if there is one.
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
        status = Visibility(self.status[index])
        if self.body[agent, k] and status != Visibility.VISIBLE:
            return "own body"
        if status == Visibility.VISIBLE:
            text = share(float(self.fraction[index]))
            if self.unknown_fraction[index] > 0:
                return f"{text}, {share(float(self.unknown_fraction[index]))} unknown"
            return f"{text} ({int(self.visible_pixels[index])} px)" if text.startswith("<") else text
        if status == Visibility.OCCLUDED and self.occluder[index] >= 0:
            return f"hidden by {self.scene_objects[self.occluder[index]]}"
        return status.name.lower().replace("_", " ")

    def _agent(self, name: str) -> int:
        if not isinstance(name, str) or name not in self.agents:
            raise SceneError(f"there is no agent {name!r}; there are {', '.join(map(repr, self.agents))}")
        return self.agents.index(name)

    def _view(self, view: int) -> int:
        if not is_whole(view) or not 0 <= view < len(self):
            raise ArrayError(f"view must be a whole number from 0 to {len(self) - 1}, got {view!r}")
        return int(view)
