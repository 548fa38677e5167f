# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Write the four experiments as worlds of Webots R2023b: python scripts/write_webots_worlds.py [FOLDER]."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from warpvis.core.poses import look_at, poses_to_matrices
from warpvis.scenes import EXPERIMENTS, Experiment, shapes
from warpvis.scenes.experiments import BALL_DIAMETER, CAMERA_HEIGHT, PERSON_HEIGHT, ROBOT_AT

FOLDER = Path(__file__).parent.parent / "examples" / "webots" / "worlds"
DISPLAYS = {"labels": (320, 240), "floor map": (200, 200), "person's view": (200, 200)}
"""Names and sizes [px] of the controller's pictures."""
OVERLAYS = {"range-finder": (0, 0), "labels": (0, 0.55), "floor map": (0.75, 0), "person's view": (0.75, 0.55)}
"""Positions of the pictures in the 3D view, relative to its size, from its upper left corner."""
COLORS = {
    "floor": (0.8, 0.8, 0.8),
    "low obstacle": (0.6, 0.45, 0.3),
    "high obstacle": (0.6, 0.45, 0.3),
    "ball": (0.9, 0.2, 0.2),
    "person": (0.2, 0.3, 0.9),
    "robot": (0.3, 0.5, 0.4),
}
_EYE, _TARGET = (-4.3, -3.7, 3.4), (-0.3, -0.4, 0.1)
_FORWARD_LEFT_UP = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])  # in OpenCV camera axes


def world_of(experiment: Experiment) -> str:
    """Return the text of an experiment's world, with Webots' shapes."""
    eye, rotation = _placed(look_at(_EYE, _TARGET))
    lines = [
        "#VRML_SIM R2023b utf8",
        f"# {experiment.title}: {experiment.shows}. The person looks {experiment.gaze}.",
        "# Made by scripts/write_webots_worlds.py of warpvis.",
        "",
        *_node("WorldInfo", info=[_quoted(experiment.shows)], title=_quoted(experiment.title)),
        *_node("Viewpoint", orientation=rotation, position=eye),
        *_node("Background", skyColor=["0.6 0.7 0.8"]),
        *_node("DirectionalLight", ambientIntensity="1", direction="0.4 0.3 -1", intensity="2", castShadows="TRUE"),
    ]
    for item in experiment.build():
        low, high = item.bounds.astype(np.float64).round(6)
        if item.name == "robot":
            lines += _robot(experiment)
        elif item.name == "person":
            lines += _person(experiment)
        elif item.name == "ball":
            ball = _node("Sphere", radius=_numbers([BALL_DIAMETER / 2]), subdivision="3")
            lines += _thing("ball", (low + high) / 2, _defined("BALL_SHAPE", ball), COLORS["ball"])
        else:
            box = _node("Box", size=_numbers(high - low))
            name = item.name.upper().replace(" ", "_") + "_SHAPE"
            lines += _thing(item.name, (low + high) / 2, _defined(name, box))
    return "\n".join(lines) + "\n"


def project_of(experiment: Experiment) -> str:
    """Return the text of the project file of an experiment's world: with a console, and separated pictures."""
    lines = ["Webots Project File version R2023b", "maximizedDockId: -1", "centralWidgetVisible: 1"]
    lines += ["orthographicViewHeight: 1", "consoles: Console:All:All"]
    lines += [f"renderingDevicePerspectives: robot:{name};1;1;{x:g};{y:g}" for name, (x, y) in OVERLAYS.items()]
    return "\n".join(lines) + "\n"


def _thing(name: str, place: NDArray, geometry: list[str], color: tuple[float, ...] = ()) -> list[str]:
    """Build a Solid of one shape, which is also its bounding object."""
    used = [f"USE {geometry[0].split()[1]}"]
    fields = {"recognitionColors": [_numbers(color)]} if color else {}
    solid = _node(
        "Solid",
        translation=_numbers(place),
        children=_shape(name, geometry),
        name=_quoted(name),
        boundingObject=used,
        **fields,
    )
    return _defined(name.upper().replace(" ", "_"), solid)


def _person(experiment: Experiment) -> list[str]:
    """Build a Solid of capsules and a head, with a Pose of the eyes."""
    middle, radius = shapes.PERSON_HEAD
    head = _node("Sphere", radius=_numbers([PERSON_HEIGHT * radius]), subdivision="2")
    body = _node("Pose", translation=_numbers([0, 0, PERSON_HEIGHT * middle]), children=_shape("person", head))
    for start, end, thick in shapes.PERSON_LIMBS:
        ends = PERSON_HEIGHT * np.array([start, end])
        along = ends[1] - ends[0]
        length = float(np.linalg.norm(along))
        capsule = _node("Capsule", height=_numbers([length]), radius=_numbers([PERSON_HEIGHT * thick]))
        fields = {"translation": _numbers(ends.mean(axis=0))}
        rotation = trimesh.geometry.align_vectors([0, 0, 1], along)[:3, :3]
        if not np.allclose(rotation, np.eye(3)):
            fields["rotation"] = _rotation(rotation)
        body += _node("Pose", **fields, children=_shape("person", capsule))
    place = np.array([*experiment.human_pose[:2], 0.0])
    eyes, eye_rotation = _placed(experiment.human_pose, -place)
    parts = _defined("PERSON_SHAPE", _node("Group", children=body))
    parts += _defined("EYES", _node("Pose", translation=eyes, rotation=eye_rotation))
    person = _node(
        "Solid",
        translation=_numbers(place),
        children=parts,
        name=_quoted("person"),
        boundingObject=["USE PERSON_SHAPE"],
        recognitionColors=[_numbers(COLORS["person"])],
    )
    return _defined("PERSON", person)


def _robot(experiment: Experiment) -> list[str]:
    """Build a Robot with range finder, displays of pictures, and controller."""
    radius, height, middle = shapes.ROBOT_BASE
    place = np.array([*ROBOT_AT, 0.0])
    base = _node("Cylinder", height=_numbers([height]), radius=_numbers([radius]), subdivision="32")
    body = _node("Pose", translation=_numbers([0, 0, middle]), children=_shape("robot", base))
    for size, center in shapes.robot_boxes(CAMERA_HEIGHT):
        box = _node("Box", size=_numbers(size))
        body += _node("Pose", translation=_numbers(center), children=_shape("robot", box))
    camera = experiment.camera
    eye, rotation = _placed(experiment.pose_rows(1)[0], -place)
    devices = _node(
        "RangeFinder",
        translation=eye,
        rotation=rotation,
        fieldOfView=_numbers([2 * np.arctan(camera.width / (2 * camera.fx))]),
        width=str(camera.width),
        height=str(camera.height),
        minRange=_numbers([camera.near]),
        maxRange=_numbers([camera.far]),
    )
    for name, (wide, high) in DISPLAYS.items():
        devices += _node("Display", name=_quoted(name), width=str(wide), height=str(high))
    robot = _node(
        "Robot",
        translation=_numbers(place),
        children=_defined("ROBOT_SHAPE", _node("Group", children=body)) + devices,
        name=_quoted("robot"),
        boundingObject=["USE ROBOT_SHAPE"],
        controller=_quoted("visibility"),
        supervisor="TRUE",
    )
    return _defined("ROBOT", robot)


def _placed(pose: NDArray | tuple[float, ...], moved: NDArray | float = 0.0) -> tuple[str, str]:
    """Format an OpenCV camera's pose as translation and rotation of a device that looks along x, with z up."""
    matrix = poses_to_matrices(np.asarray(pose, dtype=np.float64))
    return _numbers(matrix[:3, 3] + moved), _rotation(matrix[:3, :3] @ _FORWARD_LEFT_UP)


def _rotation(matrix: NDArray) -> str:
    """Format a rotation matrix as axis and angle."""
    m = matrix
    twice = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])  # axis * 2 sin
    angle = np.arctan2(np.linalg.norm(twice), np.trace(m) - 1)
    assert np.linalg.norm(twice) > 1e-3, "rotations by 180 degrees are not supported"
    return _numbers([*(twice / np.linalg.norm(twice)), angle])


def _shape(name: str, geometry: list[str]) -> list[str]:
    appearance = _node("PBRAppearance", baseColor=_numbers(COLORS[name]), roughness="1", metalness="0")
    return _node("Shape", appearance=appearance, geometry=geometry)


def _defined(name: str, lines: list[str]) -> list[str]:
    return [f"DEF {name} {lines[0]}", *lines[1:]]


def _node(kind: str, **fields: str | list[str]) -> list[str]:
    """Format a node as Webots does: one field per line, lists in brackets, indented by two spaces."""
    lines = [f"{kind} {{"]
    for name, value in fields.items():
        if isinstance(value, str):
            lines.append(f"  {name} {value}")
        elif name in ("appearance", "geometry", "boundingObject"):
            lines += [f"  {name} {value[0]}", *(f"  {line}" for line in value[1:])]
        else:
            lines += [f"  {name} [", *(f"    {line}" for line in value), "  ]"]
    return [*lines, "}"]


def _numbers(values: NDArray | tuple[float, ...] | list[float]) -> str:
    return " ".join(f"{round(float(value), 9) + 0.0:.9g}" for value in values)


def _quoted(text: str) -> str:
    return f'"{text}"'


def main(folder: Path = FOLDER) -> None:
    """Write the worlds to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for experiment in EXPERIMENTS:
        for path, write in ((f"{experiment.name}.wbt", world_of), (f".{experiment.name}.wbproj", project_of)):
            (folder / path).write_text(write(experiment), encoding="utf-8", newline="\n")
            print(folder / path)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
