# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""People of a size, in a posture, at a place: objects of a scene, and agents."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import check_choice, check_number, degrees_hint
from warpvis.core.labels import Label
from warpvis.core.poses import check_up, poses_to_opencv
from warpvis.errors import PoseError, SceneError, WarpvisError
from warpvis.scene import Scene, require_scene
from warpvis.scene.materials import Appearance, check_color
from warpvis.situations.people._body import Body, Sex
from warpvis.situations.people._figure import Figure
from warpvis.situations.people._goals import eye_point, eye_rotation
from warpvis.situations.people._postures import Posture, solve, standing
from warpvis.situations.people._skeleton import Frames
from warpvis.situations.people._skin import PARTS, make_skin
from warpvis.situations.people._solids import make_pieces
from warpvis.situations.people._state import State
from warpvis.visibility import Agent

Geometry = Literal["solids", "mesh"]
"""A body as one round solid per segment, or as one skinned mesh."""

_EYE_COLORS = {"white": (0.93, 0.93, 0.92), "pupil": (0.10, 0.07, 0.06)}

# Axes of the OpenCV camera (right, down, forward) in the frame of the eyes (forward, left, up).
_CAMERA_IN_EYES = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])

# The floor's axes and the vertical one, (forward, left, up) at heading 0, in a world with y up: z, x and y.
_Y_UP = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])

_MAX_COORDINATE = 1e6
_HEIGHT = 1.69


@dataclass(frozen=True)
class Colors:
    """Colors of a person: red, green and blue from 0 to 1, sRGB."""

    skin: tuple[float, float, float] = (0.80, 0.62, 0.50)
    hair: tuple[float, float, float] = (0.22, 0.15, 0.10)
    shirt: tuple[float, float, float] = (0.25, 0.42, 0.65)
    trousers: tuple[float, float, float] = (0.24, 0.25, 0.30)
    shoes: tuple[float, float, float] = (0.15, 0.12, 0.11)

    def __post_init__(self) -> None:
        for name in ("skin", "hair", "shirt", "trousers", "shoes"):
            object.__setattr__(self, name, check_color(getattr(self, name), f"{name} of a person", (3,))[:3])


@dataclass(frozen=True, eq=False)
class Person:
    """A person of a size, in a posture, at a place; or the same person in W worlds.

    Example:
        >>> anna = Person(height=1.65, posture=sitting(seat_height=0.45), pose=(2, 0, math.pi))
        >>> agent = anna.add_to(scene, "anna")
    """

    height: float = _HEIGHT
    """Stature, barefoot [m], from 1.2 to 2.3; see `stature` for that of a percentile."""
    sex: Sex = "average"
    """Whose proportions: ``"male"``, ``"female"``, or the mean of both."""
    build: float = 1.0
    """Factor of breadths, depths and girths, from 0.8 (slender) to 1.3 (stout)."""
    posture: Posture = field(default_factory=standing)
    """What the person does."""
    pose: ArrayLike = (0.0, 0.0, 0.0)
    """Place on the floor, ``x y heading`` [m, m, rad], shape ``(3,)``, or one for each world, ``(W, 3)``. The heading
    is counterclockwise from x. In a world with y up, the floor's axes are z and x."""
    figure: Figure | None = None
    """A mesh with a skeleton of one's own for a body. Height, sex and build then stay at their defaults."""
    floor: float = 0.0
    """Height of the floor [m]."""
    colors: Colors = Colors()
    up: Literal["z", "y"] = "z"
    """The world's vertical axis."""

    def __post_init__(self) -> None:
        if self.figure is not None and not isinstance(self.figure, Figure):
            raise SceneError(f"figure of a person must be a Figure, got {self.figure!r}")
        if self.figure is not None and (self.height, self.sex, self.build) != (_HEIGHT, "average", 1.0):
            raise SceneError("height, sex and build of a person with a figure are those of the figure; leave them out")
        _ = self.body  # raises if a size is invalid
        if not isinstance(self.posture, Posture):
            raise PoseError(
                f"posture must be one of warpvis.situations, such as standing() or sitting(), got {self.posture!r}"
            )
        if not isinstance(self.colors, Colors):
            raise SceneError(f"colors must be a Colors, got {self.colors!r}")
        check_up(self.up)
        check_number(self.floor, "floor", minimum=-_MAX_COORDINATE, maximum=_MAX_COORDINATE, error=PoseError)
        object.__setattr__(self, "pose", _check_places(self.pose))
        _ = self.worlds

    @cached_property
    def body(self) -> Body:
        """Measurements of the person."""
        return Body(self.height, self.sex, self.build) if self.figure is None else self.figure.body

    @property
    def worlds(self) -> int:
        """Number of worlds that the person is placed in: the number of poses, or of values of the posture."""
        poses, postures = len(np.atleast_2d(self.pose)), self.posture.worlds
        if 1 not in (poses, postures) and poses != postures:
            raise PoseError(f"pose and posture must be for the same number of worlds, got {poses} and {postures}")
        return max(poses, postures)

    def at(self, x: float, y: float, heading: float = 0.0) -> Person:
        """Return the person at another place."""
        return replace(self, pose=(x, y, heading))

    def doing(self, posture: Posture) -> Person:
        """Return the person in another posture."""
        return replace(self, posture=posture)

    def object_names(self, name: str, body: Geometry = "solids") -> tuple[str, ...]:
        """Return the names of the objects of a person, in the order of `object_poses`.

        Args:
            name: Name of the person.
            body: Whether it is round solids, ``NAME/head``, ``NAME/upper_arm_left``, ..., or a mesh, ``NAME/body``.
        """
        if not isinstance(name, str) or not name:
            raise SceneError(f"name of a person must be a non-empty string, got {name!r}")
        if _check_geometry(body) == "mesh":
            return (f"{name}/body",)
        return tuple(f"{name}/{piece.name}" for piece in make_pieces(self.body))

    @property
    def eye_poses(self) -> NDArray[np.float64]:
        """Poses of a camera at the midpoint of the eyes that looks along the gaze, camera to world, ``(W, 7)``."""
        state, frames = self.solved
        rotations = eye_rotation(state, frames) @ _CAMERA_IN_EYES
        return self._to_rows(rotations[:, None], eye_point(state, frames)[:, None])[:, 0]

    @property
    def eye_pose(self) -> NDArray[np.float64]:
        """The first of `eye_poses`, shape ``(7,)``."""
        return self.eye_poses[0]

    def object_poses(self, body: Geometry = "solids") -> NDArray[np.float64]:
        """Return the poses of the objects in W worlds, object to world, shape ``(W, K, 7)``; see `object_names`.

        A mesh has one pose, the place on the floor: its posture is that of its vertices.
        """
        state, frames = self.solved
        if _check_geometry(body) == "mesh":
            upright = np.broadcast_to(np.eye(3), (state.worlds, 1, 3, 3))
            return self._to_rows(upright, np.zeros((state.worlds, 1, 3)))
        pieces = make_pieces(self.body)
        rotations = np.stack([frames.rotations[piece.segment] @ piece.rotation for piece in pieces], axis=1)
        centers = np.stack([frames.points(piece.segment, piece.center) for piece in pieces], axis=1)
        return self._to_rows(rotations, centers)

    def joint_positions(self) -> dict[str, NDArray[np.float64]]:
        """Return the positions of the joints by segment, the proximal one of each, in the world [m], ``(W, 3)``."""
        state, frames = self.solved
        return {name: self._to_world(state, origin) for name, origin in frames.origins.items()}

    def joint_angles(self) -> dict[str, NDArray[np.float64]]:
        """Return the joint angles that are not 0 [rad], each of shape ``(W,)``."""
        state, _ = self.solved
        return {name: state.angle(name) for name in state.angles}

    def hand_positions(self, hand: Literal["right", "left"] = "right") -> NDArray[np.float64]:
        """Return the center of a hand's grip in the world [m], shape ``(W, 3)``."""
        check_choice(hand, "hand", ("right", "left"), PoseError)
        state, frames = self.solved
        return self._to_world(state, frames.points(f"hand_{hand}", (0.0, 0.0, -self.body.grip)))

    def mesh(self) -> tuple[NDArray[np.float32], NDArray[np.int32], Appearance]:
        """Return the skinned mesh in the posture of the first world, in the frame of its place on the floor.

        Returns:
            Vertices [m], shape ``(n, 3)``, corner indices, shape ``(m, 3)``, and the appearance, with smooth normals.
            The number of vertices depends on the body only.
        """
        vertices, normals = self.mesh_vertices()
        if self.figure is not None:
            looks = replace(self.figure.appearance, normals=normals[0].astype(np.float32))
            return vertices[0].astype(np.float32), self.figure.faces, looks
        skin = make_skin(self.body)
        colors = {**vars(self.colors), **_EYE_COLORS}
        palette = np.array([[*colors[part], 1.0] for part in PARTS], dtype=np.float32)
        looks = Appearance(
            vertex_colors=(skin.colors @ palette).astype(np.float32), normals=normals[0].astype(np.float32)
        )
        return vertices[0].astype(np.float32), skin.faces, looks

    def mesh_vertices(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the vertices [m] and normals of the skinned mesh, in the frame of the person's place, ``(W, n, 3)``.

        They are those of `Scene.update_vertices`.
        """
        _, frames = self.solved
        return (make_skin(self.body) if self.figure is None else self.figure).posed(frames)

    def update(self, scene: Scene, name: str) -> None:
        """Give a mesh in a scene, added by ``add_to(scene, name, body="mesh")``, the posture of the first world.

        Its place is in `object_poses`.
        """
        require_scene(scene)
        (mesh,) = self.object_names(name, "mesh")
        vertices, normals = self.mesh_vertices()
        scene.update_vertices(mesh, vertices[0].astype(np.float32), normals=normals[0].astype(np.float32))

    def add_to(self, scene: Scene, name: str, *, body: Geometry = "solids", movable: bool = True) -> Agent:
        """Add the body to a scene, and return the agent. The objects are those of the first world.

        Args:
            scene: The scene.
            name: Name of the person; `object_names` are those of the objects.
            body: Whether the body is one round solid per segment or one skinned mesh.
            movable: Whether the poses of its objects may differ between worlds; see `object_poses`.

        Returns:
            The result of `agent`; its `body` are the names of the objects, in the order of `object_poses`.
        """
        require_scene(scene)
        if scene.up != self.up:
            raise SceneError(f'up of the person must be that of the scene, "{scene.up}", got "{self.up}"')
        agent = self.agent(name, body=body)
        parts: list[tuple[Any, Any]] = []
        if body == "mesh":
            vertices, faces, looks = self.mesh()
            parts = [((vertices, faces), looks)]
        else:
            parts = [(piece.solid, getattr(self.colors, piece.color)) for piece in make_pieces(self.body)]
        options: dict[str, Any] = {"label": Label.HUMAN, "category": "person", "movable": movable}
        for (shape, color), one, pose in zip(parts, agent.body, self.object_poses(body)[0], strict=True):
            scene.add(shape, name=one, pose=pose, appearance=color, **options)
        return agent

    def agent(self, name: str, *, body: Geometry = "solids", **options: Any) -> Agent:
        """Return the person as an agent: at the eyes, looking along the gaze, with the field of view of both eyes.

        The field is that of `Agent.human`: 200 degrees wide, 60 up and 75 down, about the gaze. With a body of
        solids, only head and neck are invisible to the agent; it sees its own arms and legs, which may hide things from
        it. A mesh is invisible to it as a whole.

        Args:
            name: Name of the person, as for `add_to`.
            body: As for `add_to`.
            **options: Other arguments of `Agent.human`, such as `far` and `resolution`.
        """
        names = self.object_names(name, body)
        if body == "solids":
            near = [piece.segment in ("head", "neck") for piece in make_pieces(self.body)]
            options = {"head": tuple(one for one, is_near in zip(names, near, strict=True) if is_near), **options}
        return Agent.human(name, self.eye_poses, body=names, **options)

    @cached_property
    def solved(self) -> tuple[State, Frames]:
        """The solved posture and its frames, for other modules of people."""
        places = np.broadcast_to(np.atleast_2d(np.asarray(self.pose, dtype=np.float64)), (self.worlds, 3))
        posture = self.posture
        if self.up == "y":
            posture = posture.rotated(_Y_UP.T)
        state = solve(posture, self.body, places, self.floor)
        return state, state.frames()

    def _to_world(self, state: State, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Convert points of the body's frame to the world, shapes ``(W, 3)``."""
        placed = np.einsum("wij,wj->wi", state.heading, points) + state.origin
        return placed if self.up == "z" else placed @ _Y_UP.T

    def _to_rows(self, rotations: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return rows ``x y z qx qy qz qw`` of frames of the body in the world, shape ``(W, K, 7)``."""
        state, _ = self.solved
        matrices = np.zeros((*rotations.shape[:2], 4, 4))
        matrices[..., :3, :3] = state.heading[:, None] @ rotations
        matrices[..., :3, 3] = np.einsum("wij,wkj->wki", state.heading, points) + state.origin[:, None]
        matrices[..., 3, 3] = 1
        if self.up == "y":
            matrices[..., :3, :] = _Y_UP @ matrices[..., :3, :]
        return poses_to_opencv(matrices.reshape(-1, 4, 4)).reshape(*rotations.shape[:2], 7)


def _check_geometry(body: object) -> Geometry:
    check_choice(body, "body", ("solids", "mesh"), SceneError)
    return body  # type: ignore[return-value]  # checked


def _check_places(pose: ArrayLike) -> NDArray[np.float64]:
    """Check places ``x y heading``, one or one per world."""
    try:
        rows = as_numpy(pose, name="pose").astype(np.float64)
    except (WarpvisError, TypeError, ValueError):
        rows = np.zeros(0)
    if rows.ndim not in (1, 2) or rows.shape[-1] != 3 or not rows.size or not np.isfinite(rows).all():
        hint = "; a person has no other rotation" if rows.shape[-1:] == (7,) else ""
        raise PoseError(f"pose of a person must be finite x, y and heading, shape (3,) or (W, 3), got {pose!r}{hint}")
    if np.abs(rows[..., :2]).max() > _MAX_COORDINATE:
        raise PoseError(f"pose of a person must be within {_MAX_COORDINATE:g} m of the origin, got {pose!r}")
    turned = rows[..., 2][np.abs(rows[..., 2]) > 4 * math.pi]
    if len(np.atleast_1d(turned)):
        worst = float(np.atleast_1d(turned)[0])
        raise PoseError(f"heading of a person must be in radians, got {worst:g}{degrees_hint(worst)}")
    return rows


def require_people(people: Sequence[Person]) -> list[Person]:
    """Check a list of people, and return it."""
    found = list(people) if isinstance(people, Sequence) else []
    if not found or not all(isinstance(one, Person) for one in found):
        raise SceneError(f"people must be a list of at least one Person, got {people!r}")
    return found
