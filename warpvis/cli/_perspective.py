# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The commands ``warpvis perspective`` and ``view``: what a robot and people see, as a report or in the browser."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from warpvis.cli._agents import AgentOptions
from warpvis.cli._inputs import (
    MaybePoses,
    Names,
    check_viewpoints,
    find_experiment,
    given_options,
    refuse_options,
    split_names,
    viewpoint_options,
)
from warpvis.cli._output import format_rows, make_folder, with_help, write_json
from warpvis.core.checks import format_fraction, with_article
from warpvis.errors import FileFormatError

if TYPE_CHECKING:
    from warpvis.cameras.frames import Frames
    from warpvis.planning import Proposal
    from warpvis.scene import Scene
    from warpvis.viewer import ViewerState
    from warpvis.visibility import Agent, Candidate

# Options for what an experiment of the demo defines itself: agents, labels and units.
_OF_AGENTS = ("robot", "human", "robot_body", "human_body", "device_name", *viewpoint_options)
_DEFINES_AGENTS = "{} defines its robot and its person, so it takes"
_NOT_OF_MODELS = ("up", "file_up", "scale", "search_path", "strict", "label_names")
"""Options that load a MuJoCo model as a scene without joints."""


@with_help
@dataclass(frozen=True, kw_only=True)
class Perspective(AgentOptions):
    """Compute what a robot and people see, what people may refer to, and where the robot could move to see it.

    The experiments define their robot and person, and need no option. In a Webots world, they are its range finder and
    its people.
    """

    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Output folder for perspective.json and perspective.png."""
    max_distance: float = 2.0
    """Maximum distance that the robot may move to see more [m]."""
    robot_radius: float = 0.2
    """The robot's radius [m]: it moves only to places that are free up to its camera's height."""
    floor: float = 0.0
    """Height of the floor on which the robot stands [m]."""
    device: str = "cpu"
    """Device to compute on: cpu, cuda:0, ..."""

    def run(self) -> None:
        from warpvis.core.arrays import check_length
        from warpvis.core.labels import Label
        from warpvis.planning import propose_view
        from warpvis.visibility import State, choose_likeliest, perspective

        max_distance = check_length(self.max_distance, "--max-distance")
        radius = check_length(self.robot_radius, "--robot-radius", zero=False)
        floor = check_length(self.floor, "--floor", signed=True)
        scene, robot, people = self._read()
        agents = (robot, *people)
        bodies = {name for agent in agents for name in agent.body}
        if any(item.label == Label.OBJECT and item.name not in bodies for item in scene):
            labels = [int(Label.OBJECT)]
        else:
            labels = sorted({item.label for item in scene} - scene.ground_labels)
        seen = perspective(scene, agents)
        meant = {
            human.name: seen.candidates(human.name, robot.name, labels=labels, exclude=sorted(bodies))
            for human in people
        }
        found = choose_likeliest(itertools.chain(*meant.values()))
        missed = [item.object for item in found if item.state == State.SECOND]
        proposal = propose_view(scene, robot, found, max_distance=max_distance, radius=radius, floor=floor)

        if self.out is not None:
            from warpvis.viz import save_perspective

            make_folder(self.out)
            title, pose = f"Who sees what: {self.file.name}", None if proposal is None else proposal.pose
            picture = self.out / "perspective.png"
            save_perspective(scene, agents, seen, picture, title=title, labels=labels, proposed=pose)
            report = _report(meant, missed, proposal)
            write_json(self.out / "perspective.json", {"file": str(self.file), **seen.report(), **report})
        for agent in agents:
            _warn_of_eyes_inside(scene, agent, "--robot-body" if agent is robot else "--human-body")
        print(seen.table())
        for name, items in meant.items():
            print(f"\n{_format_candidates(name, items)}")
        if found:
            print(f"\n{_format_result(missed, proposal, self.max_distance)}")
        if self.out is not None:
            print(f"\n{self.out / 'perspective.json'}, {self.out / 'perspective.png'}")

    def _read(self) -> tuple[Scene, Agent, list[Agent]]:
        """Read the scene, the robot and the people."""
        experiment = find_experiment(self.file)
        if experiment is not None:
            refuse_options(self, _OF_AGENTS, _DEFINES_AGENTS.format(experiment.name))
            robot, human = experiment.agents()
            return experiment.build(self.device), robot, [human]
        scene, given, people = self.load_agents(self.device, required=True)
        assert given is not None  # it is required
        return scene, given, people


def _warn_of_eyes_inside(scene: Scene, agent: Agent, option: str) -> None:
    """Warn if an agent's eyes are inside of objects, which hide everything else or appear cut open."""
    from warpvis.planning import inside_solids

    eyes = agent.poses[:, :3]
    if not inside_solids(scene, eyes, exclude=agent.body).any():  # testing single objects takes seconds in large scenes
        return
    names = [item.name for item in scene if item.name not in agent.body]
    around = [
        name
        for name in names
        if inside_solids(scene, eyes, exclude=[other.name for other in scene if other.name != name]).any()
    ]
    if around:
        listed, name = " ".join(map(repr, around)), with_article(agent.name)
        warnings.warn(
            f"{name}'s eyes are inside of {listed}: if that is {name}, give {option} {listed}",
            stacklevel=2,
        )


def _report(meant: Mapping[str, list[Candidate]], missed: list[str], proposal: Proposal | None) -> dict[str, object]:
    """Return the content of the JSON file in addition to `Perspective.report`."""
    from warpvis.visibility import State

    candidates = []
    for human, found in meant.items():
        for item in found:
            fields = asdict(item)
            del fields["object_poses"], fields["state"]
            candidates.append({"human": human, **fields, "robot_sees": item.state == State.BOTH})
    return {
        "candidates": candidates,
        "to_see": missed,
        "proposed_robot_pose": None if proposal is None else proposal.report(),
    }


def _format_candidates(human: str, found: list[Candidate]) -> str:
    """Return a person's candidates as a table."""
    from warpvis.visibility import State

    subject = with_article(human)
    if not found:
        return f"{subject[0].upper()}{subject[1:]} sees no objects, so there are no candidates."
    rows = []
    for item in found:
        assert item.robot_fraction is not None  # the robot was passed to `candidates`
        angle = f"{math.degrees(item.gaze_angle):.0f} degrees"
        robot = "no" if item.state == State.SECOND else format_fraction(item.robot_fraction)
        rows.append([item.object, format_fraction(item.probability), angle, "yes" if item.attended else "no", robot])
    return format_rows([f"{subject} may mean", "probability", "from the gaze", "attended", "robot sees"], rows)


def _format_result(missed: list[str], proposal: Proposal | None, max_distance: float) -> str:
    """Return what the robot has to do."""
    if not missed:
        return "The robot sees all of them."
    lines = [f"The robot must move to see {', '.join(missed)}."]
    if proposal is None:
        lines.append(f"No free place within {max_distance:g} m shows any of them.")
    else:
        place = " ".join(f"{number:.3f}" for number in proposal.pose)
        shares = ", ".join(f"{name} {format_fraction(share)}" for name, share in proposal.fractions.items())
        lines.append(f"{proposal.distance:.2f} m away, at {place}, it would see {shares}.")
    return "\n".join(lines)


@with_help
@dataclass(frozen=True, kw_only=True)
class View(AgentOptions):
    """Open an interactive page of a scene: move the robot, people and objects, and watch what each of them sees.

    The experiments define their robot and person. In a Webots world, they are its range finder and its people. Without
    a robot, the camera sees the whole scene. Needs pip install 'warpvis[view]'.
    """

    robot: Annotated[str | None, tyro.conf.arg(metavar="POSE|CAMERA")] = None
    """Pose of the robot's camera: eye and target, "x y z tx ty tz" (meters), or "x y z qx qy qz qw"; or a file with one
    pose; or the name of a camera of a MuJoCo model. By default the range finder of a Webots world, else a pose that
    sees the whole scene."""
    human: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="[NAME=]POSE|CAMERA")] = ()
    """Pose of a person's eyes, in the same form, with a name if wanted ("Ada=4 0 1.6 2 0 0.8"); or the name of a person
    of a Webots world, by default all of them. Give the option once for each person."""
    robot_body: Names = ()
    """Names of the objects that form the robot: they move with it, and are invisible to it. The robot of a Webots world
    sees itself where Webots draws it."""
    human_body: Names = ()
    """Names of the objects that form the person: they move with the person, and are invisible to the person. For
    several people, each with the person's name: "Ada=legs,Ada=arms,Bo=suit"."""
    movable: Names = ()
    """Names or patterns of the objects that can be dragged; by default those labeled as object, person or robot."""
    objects: Names = ()
    """Names of the objects in the table; by default all except the ground, or, if there are many, those that can be
    dragged by default."""
    host: str = "localhost"
    """Address to listen on: by default only this machine can open the page, and others through
    ssh -L 8080:localhost:8080; 0.0.0.0 allows all machines that can reach this one."""
    port: int = 8080
    """Port to listen on, or the next free one."""
    dark: bool = False
    """Use a dark theme."""
    poses: MaybePoses = None
    """Robot poses to play on a slider: a file of poses or a generator, or the folder of a dataset that warpvis batch
    wrote of this scene, in which objects may move, too."""
    rerun: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Write a recording (.rrd) for Rerun of the poses to play, or of the current state, and exit. Needs
    pip install 'warpvis[rerun]'."""
    html: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Write one file that a browser opens without a server, and exit."""

    def run(self) -> None:
        from warpvis.viewer import Viewer

        state = self.load()
        if self.rerun is not None:
            from warpvis.viewer import save_rerun

            save_rerun(state, self.rerun)
            print(self.rerun)
            return
        with Viewer(state, host=self.host, port=self.port, dark=self.dark) as viewer:
            if self.html is not None:
                viewer.save_html(self.html, title=self.file.stem)
                print(self.html)
                return
            print(f"{viewer.url}  (Ctrl-C ends it)", flush=True)
            viewer.wait()

    def load(self) -> ViewerState:
        """Read the scene and the agents."""
        from warpvis.viewer import ViewerState

        names: dict[str, Any] = {
            "movable": split_names(self.movable) or None,
            "objects": split_names(self.objects) or None,
        }
        experiment = find_experiment(self.file)
        if experiment is not None:
            refuse_options(self, _OF_AGENTS, _DEFINES_AGENTS.format(experiment.name))
            scene = experiment.build()
            return ViewerState(scene, experiment.agents(), frames=self._frames(scene), **names)
        if self.file.suffix.lower() == ".xml" and not given_options(self, _NOT_OF_MODELS):
            return self._load_model(names)
        scene, robot, people = self.load_agents()
        agents = [robot or self._framing_robot(scene), *people]
        return ViewerState(scene, agents, frames=self._frames(scene), **names)

    def _frames(self, scene: Scene) -> Frames | None:
        """Read or generate the frames to play."""
        from warpvis.batch import open_dataset
        from warpvis.pose_generators import frames_from_spec, looks_like_spec

        if self.poses is None:
            return None
        if looks_like_spec(self.poses):
            return frames_from_spec(self.poses, scene, up=scene.up)
        return open_dataset(self.poses).frames if Path(self.poses).is_dir() else self.read_poses(self.poses)

    def _load_model(self, names: dict[str, Any]) -> ViewerState:
        """Read a MuJoCo model, with its joints and cameras."""
        import mujoco

        from warpvis.viewer import MujocoStage, ViewerState

        try:
            model = mujoco.MjModel.from_xml_path(str(self.file))
        except ValueError as error:
            raise FileFormatError(f"{self.file}: {str(error).splitlines()[0]}") from None
        stage = MujocoStage(model, labels=self.label_rules())
        cameras, scene, texts = stage.cameras(), stage.stage.scene, self.pose_texts()
        check_viewpoints(self, [text for text in texts if text not in cameras])
        robot = stage.agent("robot", self.robot) if self.robot in cameras else self.read_robot(scene)
        known = {name: stage.agent("human", name) for name in texts if name in cameras}
        agents = [robot or self._framing_robot(scene), *self.read_people(scene, known)]
        return ViewerState(stage, agents, frames=self._frames(scene), **names)

    def _framing_robot(self, scene: Scene) -> Agent:
        """Create a robot whose camera, a pinhole, sees the whole scene."""
        from warpvis.cameras.pinhole import require_camera
        from warpvis.viewer import framing_agent

        return framing_agent(scene, None if self.camera is None else require_camera(self.choose_camera()))
