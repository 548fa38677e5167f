# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``warpvis view``: an interactive page of a scene in the browser."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from warpvis.cli._help import with_help
from warpvis.cli._inputs import (
    MaybePoses,
    Names,
    SceneFile,
    ViewpointOptions,
    check_viewpoints,
    find_experiment,
    given_options,
    refuse_options,
    split_names,
    viewpoint_options,
)
from warpvis.errors import FileFormatError, WarpvisError

if TYPE_CHECKING:
    from warpvis.cameras.frames import Frames
    from warpvis.cameras.pinhole import Camera
    from warpvis.scene import Scene
    from warpvis.viewer import ViewerState
    from warpvis.visibility import Agent

_NOT_OF_MODELS = ("up", "file_up", "scale", "search_path", "strict", "label_names")
"""Options that load a MuJoCo model as a scene without joints."""


@with_help
@dataclass(frozen=True, kw_only=True)
class View(ViewpointOptions):
    """Open an interactive page of a scene: move the robot, the person and objects, and watch what each of them sees.

    The experiments define their robot and person. Needs pip install 'warpvis[view]'.
    """

    file: SceneFile
    robot: Annotated[str | None, tyro.conf.arg(metavar="POSE")] = None
    """Pose of the robot's camera: eye and target, "x y z tx ty tz" (meters), or "x y z qx qy qz qw"; or a file with one
    pose; or the name of a camera of a MuJoCo model. By default a pose that sees the whole scene."""
    human: Annotated[str | None, tyro.conf.arg(metavar="POSE")] = None
    """Pose of a person's eyes, in the same form; by default there is no person."""
    robot_body: Names = ()
    """Names of the objects that form the robot: they move with it, and are invisible to it."""
    human_body: Names = ()
    """Names of the objects that form the person: they move with the person, and are invisible to the person."""
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
            unused = ("robot", "human", "robot_body", "human_body", *viewpoint_options)
            refuse_options(self, unused, f"{experiment.name} defines its robot and its person, so it takes")
            scene = experiment.build()
            return ViewerState(scene, experiment.agents(), frames=self._frames(scene), **names)
        if self.file.suffix.lower() == ".xml" and not given_options(self, _NOT_OF_MODELS):
            return self._load_model(names)
        check_viewpoints(self, [text for text in (self.robot, self.human) if text is not None])
        scene = self.load_scene(self.file)
        return ViewerState(scene, self._agents(scene), frames=self._frames(scene), **names)

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
        agents = []
        for name, text in (("robot", self.robot), ("human", self.human)):
            if text in stage.cameras():
                agents.append(stage.agent(name, text))
        if len(agents) < sum(text is not None for text in (self.robot, self.human)) or not agents:
            texts = [text for text in (self.robot, self.human) if text is not None]
            check_viewpoints(self, [text for text in texts if text not in stage.cameras()])
            known = {agent.name: agent for agent in agents}
            agents = [known.get(agent.name, agent) for agent in self._agents(stage.stage.scene, set(known))]
        return ViewerState(stage, agents, frames=self._frames(stage.stage.scene), **names)

    def _agents(self, scene: object, known: Collection[str] = ()) -> list[Agent]:
        """Create the agents; names in `known` get a placeholder pose."""
        from warpvis.scene import require_scene
        from warpvis.viewer import framing_agent
        from warpvis.visibility import Agent

        up = require_scene(scene).up
        camera = None if self.camera is None else self._pinhole()
        body = tuple(split_names(self.robot_body))
        if self.robot is None or "robot" in known:
            if body:
                raise WarpvisError("--robot-body has no effect without --robot")
            robot = framing_agent(require_scene(scene), camera)
        else:
            robot = Agent("robot", self.choose_camera(), self.load_pose(self.robot, "--robot", up), body=body)
        if self.human is None:
            if self.human_body:
                raise WarpvisError("--human-body has no effect without --human")
            return [robot]
        if "human" in known:
            return [robot, Agent.human("human", robot.pose)]
        eyes = self.load_pose(self.human, "--human", up)
        return [robot, Agent.human("human", eyes, body=tuple(split_names(self.human_body)))]

    def _pinhole(self) -> Camera:
        """Return --camera, which must be a pinhole to compute a pose that sees the whole scene."""
        from warpvis.cameras.pinhole import require_camera

        return require_camera(self.choose_camera())
