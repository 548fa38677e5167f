# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Options for a robot and people, given as poses or by a Webots world."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, NoReturn

import tyro

from warpvis.cli._info import is_world
from warpvis.cli._inputs import (
    Names,
    SceneFile,
    ViewpointOptions,
    check_viewpoints,
    is_numbers,
    refuse_options,
    split_names,
)
from warpvis.cli._output import with_help
from warpvis.errors import PoseError, SceneError, WarpvisError

if TYPE_CHECKING:
    from warpvis.scene import Scene
    from warpvis.visibility import Agent
    from warpvis.webots import WebotsWorld

_OF_CAMERA = ("camera", "distortion", "replace_camera")
_FIXED = ("scale", "file_up")


@with_help
@dataclass(frozen=True, kw_only=True)
class AgentOptions(ViewpointOptions):
    """Options for reading a scene, a robot and people."""

    file: SceneFile
    robot: Annotated[str | None, tyro.conf.arg(metavar="POSE")] = None
    """Pose of the robot's camera: eye and target, "x y z tx ty tz" (meters), or "x y z qx qy qz qw"; or a file with one
    pose. By default the range finder of a Webots world."""
    human: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="[NAME=]POSE")] = ()
    """Pose of a person's eyes, in the same form, with a name if wanted ("Ada=4 0 1.6 2 0 0.8"); or the name of a person
    of a Webots world, by default all of them. Give the option once for each person."""
    robot_body: Names = ()
    """Names of the objects that form the robot, which are invisible to it. The robot of a Webots world sees itself
    where Webots draws it."""
    human_body: Names = ()
    """Names of the objects that form the person, which are invisible to the person; for several people, each with the
    person's name: "Ada=legs,Ada=arms,Bo=suit"."""
    device_name: str | None = None
    """Webots worlds only: name of the range finder or camera that is the robot's, if there is not one range finder."""

    def load_agents(self, device: str = "cpu", *, required: bool = False) -> tuple[Scene, Agent | None, list[Agent]]:
        """Read the scene, the robot and the people; the robot is None if neither the options nor a world define it.

        With `required`, a missing robot or no person is an error; otherwise, a world without a range finder is a
        warning.
        """
        texts = self.pose_texts()
        world, reasons = None, {"--robot": "", "--human": ""}
        if is_world(self.file) and not (self.robot and self.human and all(is_pose(text) for text in texts)):
            world = self._load_world(device)
            reasons = {"--robot": _describe_cameras(world), "--human": ". The world has no person"}
        elif required and not (self.robot and self.human):
            _raise_missing("--human" if self.robot else "--robot")
        known = {} if world is None else world.people
        check_viewpoints(self, [text for text in texts if text not in known])
        scene = self.load_scene(self.file, device=device) if world is None else world.scene
        robot, people = self.read_robot(scene, world), self.read_people(scene, known, in_world=world is not None)
        for found, (option, reason) in zip((robot, people), reasons.items(), strict=True):
            if not found and required:
                _raise_missing(option, reason)
        if robot is None and world is not None:
            warnings.warn(f"the camera sees the whole scene{reasons['--robot']}", stacklevel=2)
        return scene, robot, people

    def pose_texts(self) -> list[str]:
        """Return the given poses, or what is given instead, without names."""
        return [*([] if self.robot is None else [self.robot]), *(text for _, text in self._named_people())]

    def _named_people(self) -> list[tuple[str, str]]:
        """Return name, which may be empty, and pose of each given person."""
        people = []
        for text in self.human:
            name, equals, pose = text.partition("=")
            people.append((name.strip(), pose.strip()) if equals and not os.path.exists(text) else ("", text))
        return people

    def read_robot(self, scene: Scene, world: WebotsWorld | None = None) -> Agent | None:
        """Read the robot: at a pose, or with the range finder of a world."""
        from warpvis.visibility import Agent
        from warpvis.webots import robot_agent

        body = tuple(split_names(self.robot_body))
        if self.robot is not None:
            refuse_options(self, ("device_name",), "a robot at a given pose has no device of the world, so it takes")
            return Agent("robot", self.choose_camera(), self.load_pose(self.robot, "--robot", scene.up), body=body)
        if world is None:
            refuse_options(self, ("device_name",), f"{self.file} is not a Webots world, so it takes")
        if world is None or (self.device_name is None and not any(item.measures for item in world.devices.values())):
            if body:
                raise WarpvisError("--robot-body has no effect without --robot")
            return None
        refuse_options(self, _OF_CAMERA, "a robot of the world has the camera of its device, so without --robot, give")
        robot = robot_agent(world, self.device_name)
        return replace(robot, body=body, head=None) if body else robot

    def read_people(self, scene: Scene, known: Mapping[str, Agent], *, in_world: bool = False) -> list[Agent]:
        """Read the people: at poses, or agents of `known`, which are all meant by default if they are `in_world`."""
        from warpvis.visibility import Agent

        people = list(known.values()) if in_world and not self.human else []
        for number, (name, text) in enumerate(self._named_people(), start=1):
            if text in known:
                people.append(replace(known[text], name=name or known[text].name))
                continue
            if in_world and known and not is_pose(text):
                listed = ", ".join(map(repr, known))
                raise PoseError(f"--human must be a pose or a person of the world, {listed}, got {text!r}")
            default = "human" if len(self.human) == 1 else f"human {number}"
            people.append(Agent.human(name or default, self.load_pose(text, "--human", scene.up)))
        return self._with_bodies(people)

    def _with_bodies(self, people: list[Agent]) -> list[Agent]:
        """Return the people with the bodies of --human-body."""
        bodies: dict[str, list[str]] = {}
        for word in split_names(self.human_body):
            name, equals, part = word.partition("=")
            if equals and any(agent.name == name for agent in people):
                bodies.setdefault(name, []).append(part)
            elif len(people) == 1:
                bodies.setdefault(people[0].name, []).append(word)
            elif people:
                listed = ", ".join(repr(agent.name) for agent in people)
                raise SceneError(f"--human-body must be NAME=OBJECT,... with names of people, {listed}, got {word!r}")
            else:
                raise WarpvisError("--human-body has no effect without --human")
        return [replace(a, body=tuple(bodies[a.name]), head=None) if a.name in bodies else a for a in people]

    def _load_world(self, device: str) -> WebotsWorld:
        from warpvis.webots import load_webots

        refuse_options(self, _FIXED, "a Webots world defines its unit (m) and axes, so it takes")
        world = load_webots(
            self.file, device=device, labels=self.label_rules(), search_path=self.folders(), strict=self.strict
        )
        if self.up not in (None, world.scene.up):
            raise SceneError(
                f"--up must be {world.scene.up}, as in the world, for its robot and people, got {self.up}. "
                "Give the poses of both, --robot and --human, for another axis"
            )
        return world


def is_pose(text: str) -> bool:
    """Return whether a text contains numbers or is the name of a file."""
    return is_numbers(text) or os.path.exists(text)


def _raise_missing(option: str, reason: str = "") -> NoReturn:
    raise PoseError(f"{option} must be given as eye and target, 'x y z tx ty tz'{reason}")


def _describe_cameras(world: WebotsWorld) -> str:
    """Return the end of a message about a robot without a range finder."""
    cameras = ", ".join(map(repr, world.devices))
    return f". The world has no range finder{cameras and f'; to use one of its cameras, {cameras}, give --device-name'}"
