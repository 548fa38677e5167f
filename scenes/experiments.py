# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's four experiments: visibility from a robot's depth camera past a low and a high obstacle.

The robot's camera is higher than the low obstacle and lower than the high one. The floor is 4.0 m x 4.0 m. The person's
gaze differs, so that each of the four states of the ball occurs: seen by both, by either one, or by neither.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.labels import Label
from warpvis.core.poses import look_at
from warpvis.maps import Sphere
from warpvis.scene import Scene
from warpvis.scene.lights import Background, Light
from warpvis.scene.materials import Appearance, Material, Texture
from warpvis.scenes import shapes
from warpvis.scenes.preset import ScenePreset
from warpvis.visibility import Agent, State

if TYPE_CHECKING:
    import trimesh

FLOOR_SIZE = 4.0
ROBOT_AT = (-1.8, 0.0)
ROBOT_RADIUS = 0.2
CAMERA_HEIGHT = 0.7
CAMERA_PITCH = np.radians(10.0)
LOW_OBSTACLE = (0.2, 0.8, 0.35)
HIGH_OBSTACLE = (0.2, 0.8, 1.4)
BALL_DIAMETER = 0.2
PERSON_HEIGHT = 1.7
EYE_HEIGHT = 1.6

_COLORS = {
    "low obstacle": (0.72, 0.50, 0.28),
    "high obstacle": (0.45, 0.66, 0.66),
    "ball": (0.87, 0.20, 0.13),
    "person": (0.33, 0.45, 0.80),
    "robot": (0.35, 0.36, 0.40),
}
_TILES = (0.80, 0.79, 0.76), (0.68, 0.67, 0.64)
"""Colors of the floor's tiles, 0.5 m x 0.5 m."""

# The test ||C_obj - P|| < size/2 is strict, but points lie on the ball's surface, so sizes have a margin.
_SIZE_MARGIN = 1.1


@dataclass(frozen=True)
class Experiment(ScenePreset):
    """One experiment with its expected results."""

    shows: str = ""
    """What it demonstrates."""
    visible: tuple[bool, bool] = (True, True)
    """Whether the camera sees the ball and the person."""
    plan_visible: tuple[bool, bool] = (True, True)
    """Whether 2D lines of sight on the floor plan reach the ball and the person."""
    spheres: tuple[Sphere, ...] = ()
    """Spheres of the ball and the person for the paper's test."""
    human_pose: tuple[float, ...] = ()
    """Pose of the person's eyes, camera to world, ``x y z qx qy qz qw``."""
    gaze: str = ""
    """Description of the person's gaze."""
    states: Mapping[str, State] = field(default_factory=dict, hash=False)
    """Visibility of the ball and the obstacles for the robot (first) and the person (second)."""

    def agents(self) -> tuple[Agent, Agent]:
        """Return the robot and the person, each with its own body excluded."""
        robot = Agent("robot", self.camera, self.poses()[0], body=("robot",))
        return robot, Agent.human("human", self.human_pose, body=("person",))


def _look_of(name: str, mesh: trimesh.Trimesh) -> Appearance:
    """Return the appearance of an object: a color, and smooth shading except for boxes."""
    if name == "floor":
        tile = np.kron([[0, 1], [1, 0]], np.ones((32, 32), dtype=np.int64))
        image = np.rint(255 * np.array(_TILES)[tile]).astype(np.uint8)
        return Appearance((Material(texture=Texture(image)),), uv=mesh.vertices[:, :2])
    is_round = name in ("ball", "person")
    return Appearance((Material(base_color=(*_COLORS[name], 1.0)),), normals=mesh.vertex_normals if is_round else None)


def _camera_pose(count: int) -> NDArray[np.float64]:
    eye = np.array([ROBOT_AT[0] + 0.03, ROBOT_AT[1], CAMERA_HEIGHT])
    pose = look_at(eye, eye + [np.cos(CAMERA_PITCH), 0.0, -np.sin(CAMERA_PITCH)])
    return np.tile(pose, (count, 1))


def _experiment(
    number: int,
    title: str,
    shows: str,
    *,
    low: tuple[float, float],
    high: tuple[float, float],
    ball: tuple[float, float],
    person: tuple[float, float],
    visible: tuple[bool, bool],
    plan_visible: tuple[bool, bool],
    gaze: str,
    looks_at: tuple[float, float, float],
    states: tuple[State, State, State],
) -> Experiment:
    def add_objects(scene: Scene) -> None:
        for name, label, mesh in (
            ("floor", Label.GROUND, shapes.floor(FLOOR_SIZE, FLOOR_SIZE)),
            ("low obstacle", Label.OBSTACLE, shapes.standing_box(LOW_OBSTACLE, *low)),
            ("high obstacle", Label.OBSTACLE, shapes.standing_box(HIGH_OBSTACLE, *high)),
            ("ball", Label.OBJECT, shapes.ball(BALL_DIAMETER, *ball)),
            ("person", Label.HUMAN, shapes.person(PERSON_HEIGHT, *person)),
            ("robot", Label.ROBOT, shapes.robot(CAMERA_HEIGHT, *ROBOT_AT)),
        ):
            scene.add(mesh, name=name, label=label, appearance=_look_of(name, mesh))
        scene.lights = [
            Light("ambient", "room", ambient=(0.45,) * 3),
            Light("directional", "lamp", direction=(0.5, 0.45, -1), color=(0.65,) * 3),
        ]
        scene.background = Background(color=(0.88, 0.90, 0.93))

    size = _SIZE_MARGIN * BALL_DIAMETER
    person_size = PERSON_HEIGHT / 3
    spheres = (
        Sphere((*ball, BALL_DIAMETER / 2), size, Label.OBJECT),
        *(Sphere((*person, (i + 0.5) * person_size), _SIZE_MARGIN * person_size, Label.HUMAN) for i in range(3)),
    )
    return Experiment(
        name=f"experiment_{number}",
        title=title,
        add_objects=add_objects,
        camera=Camera.kinect(),
        pose_rows=_camera_pose,
        shows=shows,
        visible=visible,
        plan_visible=plan_visible,
        spheres=spheres,
        human_pose=tuple(look_at((*person, EYE_HEIGHT), looks_at).tolist()),
        gaze=gaze,
        states=dict(zip(("ball", "low obstacle", "high obstacle"), states, strict=True)),
    )


EXPERIMENTS: tuple[Experiment, ...] = (
    _experiment(
        1,
        "Nothing in the way",
        "ball and person are both in plain view",
        low=(-0.1, -1.0),
        high=(0.2, 1.0),
        ball=(0.3, 0.1),
        person=(1.3, 0.35),
        visible=(True, True),
        plan_visible=(True, True),
        gaze="at the ball",
        looks_at=(0.3, 0.1, 0.1),
        states=(State.BOTH, State.BOTH, State.BOTH),
    ),
    _experiment(
        2,
        "Occlusion",
        "the high obstacle hides the ball",
        low=(-0.1, -1.0),
        high=(-0.2, 0.45),
        ball=(0.5, 0.6),
        person=(1.2, -0.45),
        visible=(False, True),
        plan_visible=(False, True),
        gaze="at the ball, which the obstacle does not hide from here",
        looks_at=(0.5, 0.6, 0.1),
        states=(State.SECOND, State.BOTH, State.BOTH),
    ),
    _experiment(
        3,
        "Seeing over an obstacle",
        "the ball is seen over the low obstacle, though the floor plan hides it",
        low=(-0.6, -0.4),
        high=(-0.1, 0.55),
        ball=(1.1, -0.8),
        person=(0.8, 0.75),
        visible=(True, False),
        plan_visible=(False, False),
        gaze="over the high obstacle's end, the ball too far aside to see",
        looks_at=(-1.5, 1.8, 1.4),
        states=(State.FIRST, State.BOTH, State.BOTH),
    ),
    _experiment(
        4,
        "Tall enough to be seen",
        "the low obstacle hides the ball, but not the person behind it, nor its own top",
        low=(0.1, -0.2),
        high=(0.4, 0.9),
        ball=(0.45, -0.2),
        person=(1.3, -0.3),
        visible=(False, True),
        plan_visible=(False, False),
        gaze="away from the robot, with the ball behind",
        looks_at=(2.0, -0.3, 1.5),
        states=(State.NEITHER, State.FIRST, State.FIRST),
    ),
)
"""The four experiments, in order."""
