# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure what cameras and agents see of objects, and check it against constraints."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera, require_image_camera
from warpvis.core.checks import as_items
from warpvis.core.labels import Visibility
from warpvis.core.poses import Convention, QuaternionOrder, parse_poses, poses_to_matrices, quaternion_product, to_xyzw
from warpvis.core.types import ArrayInput, ObjectPoses, PoseLike
from warpvis.errors import ArrayError
from warpvis.planning._constraints import GEOMETRIC, ConstraintCheck, Constraints, Term, parse_constraints
from warpvis.planning._free_space import check_exclude
from warpvis.scene import Scene, require_scene
from warpvis.scene.worlds import parse_worlds, pose_columns
from warpvis.visibility import Agent, FractionMeter, choose_objects, see_objects

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds

_IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def check_constraints(
    scene: Scene,
    camera: ImageCamera,
    camera_to_world: PoseLike,
    constraints: Constraints,
    *,
    object_poses: ObjectPoses = None,
    world_index: ArrayInput | None = None,
    exclude: Sequence[str | int] | str | None = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    threads: int | None = None,
) -> ConstraintCheck:
    """Check what many views see of objects against constraints.

    Args:
        scene: The scene.
        camera: The camera.
        camera_to_world: Poses, as for `Renderer.render`.
        constraints: For each object, by name, the range of its visible fraction, ``(0.6, 1.0)``, a `Constraint`, or a
            list of these. A tuple of names is the union of these objects, such as the parts of a robot; the camera
            must then be a pinhole.
        object_poses: As for `Renderer.render`.
        world_index: As for `Renderer.render`.
        exclude: Names or indices of objects that are invisible to the camera.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        threads: Number of CPU threads; by default all cores available to the process.
    """
    require_scene(scene).require_objects()
    require_image_camera(camera)
    terms = parse_constraints(scene, constraints)
    poses = parse_poses(to_xyzw(camera_to_world, quaternion, "camera_to_world"), convention=convention)
    worlds = parse_worlds(scene, len(poses), to_xyzw(object_poses, quaternion, "object_poses"), world_index, exclude)
    rows = np.zeros((len(poses), 0, 7), dtype=np.float32)
    if scene.movable:
        rows = worlds.object_poses.numpy().reshape(-1, len(scene.movable), 7)
        index = worlds.world.numpy() if worlds.world is not None and worlds.world.size else np.arange(len(poses))
        rows = rows[index % len(rows)]
    observer = Observer("camera", as_faces(camera), poses.numpy().reshape(-1, 7), terms, check_exclude(exclude))
    if not len(poses):
        return ConstraintCheck(terms, np.zeros((0, len(terms))), np.zeros((0, len(terms))))
    return observer.check(scene, rows, threads=threads)


def as_faces(camera: ImageCamera) -> tuple[Any, ...]:
    """Return the only face of a camera."""
    return Agent("camera", require_image_camera(camera), _IDENTITY).faces


@dataclass(frozen=True, eq=False)
class Observer:
    """A camera or the eyes of an agent, and their constraints."""

    name: str
    faces: tuple[Any, ...]
    """Images of the field of view, as `Agent.faces`."""
    poses: NDArray[np.float32]
    """One pose, or one for each view, OpenCV camera to world, ``(1 or V, 7)``."""
    terms: tuple[Term, ...]
    exclude: list[str | int]
    """Names or indices of the objects that it does not see."""

    def check(
        self,
        scene: Scene,
        rows: NDArray[np.float32],
        *,
        geometric: bool = True,
        visual: bool = True,
        threads: int | None = None,
    ) -> ConstraintCheck:
        """Check V views with poses of the movable objects, ``(V, M, 7)``; conditions that are left out are NaN."""
        values = np.full((len(rows), len(self.terms)), np.nan)
        seen = self._see(scene, rows, threads) if visual and self._visual else {}
        names = list(self._visual)
        for column, term in enumerate(self.terms):
            if term.quantity in GEOMETRIC:
                if geometric:
                    values[:, column] = self._measure(scene, rows, term)
            elif visual:
                values[:, column] = seen[term.quantity][:, names.index(term.object)]
        return ConstraintCheck(self.terms, values, _slack(self.terms, values))

    @property
    def _visual(self) -> dict[str, tuple[str, ...]]:
        """Members of the objects and unions that images are needed for, by name."""
        return {term.object: term.members for term in self.terms if term.quantity not in GEOMETRIC}

    def _measure(self, scene: Scene, rows: NDArray[np.float32], term: Term) -> NDArray[np.float64]:
        """Return distances [m] or angles [rad] of one object, ``(V,)``."""
        center, rotation = place_objects(scene, [scene.index(member) for member in term.members], rows)
        to_camera = self.poses[:, :3] - center
        if term.direction is None:
            return np.linalg.norm(to_camera, axis=-1)
        direction = np.broadcast_to(rotation @ np.array(term.direction), to_camera.shape)
        across = np.linalg.norm(np.cross(direction, to_camera), axis=-1)
        return np.arctan2(across, (direction * to_camera).sum(axis=-1))

    def _see(self, scene: Scene, rows: NDArray[np.float32], threads: int | None) -> dict[str, NDArray[Any]]:
        """Return the quantities that are measured in images, ``(V, K)`` each."""
        names = list(self._visual)
        found = [
            measure(scene, rows, chosen, threads)
            for chosen, measure in (
                ([name for name in names if len(self._visual[name]) == 1], self._see_objects),
                ([name for name in names if len(self._visual[name]) > 1], self._see_unions),
            )
            if chosen
        ]
        order = sorted(range(len(names)), key=lambda k: len(self._visual[names[k]]) > 1)
        return {
            quantity: np.concatenate([part[quantity] for part in found], axis=1)[:, np.argsort(order)]
            for quantity in found[0]
        }

    def _views(
        self, scene: Scene, rows: NDArray[np.float32]
    ) -> tuple[Worlds, Iterator[tuple[Any, tuple[int, int, int, int], wp.array]]]:
        """Return worlds, and the camera, the canvas and the poses ``(V,)`` of each face."""
        views = len(rows)
        worlds = parse_worlds(scene, views, rows if scene.movable else None, None, self.exclude or None)
        needed = any(term.quantity == "fraction" for term in self.terms)

        def of_faces() -> Iterator[tuple[Any, tuple[int, int, int, int], wp.array]]:
            for face in self.faces:
                placed = np.repeat(self.poses.astype(np.float64), views // len(self.poses), axis=0)
                placed[:, 3:] = quaternion_product(placed[:, 3:], np.array(face.rotation))
                poses = wp.array(placed.astype(np.float32), dtype=wp.transform, device=scene.device)
                yield face.camera, face.canvas if needed else (0, 0, 0, 0), poses

        return worlds, of_faces()

    def _see_objects(
        self, scene: Scene, rows: NDArray[np.float32], names: list[str], threads: int | None
    ) -> dict[str, NDArray[Any]]:
        """Return the quantities of single objects, ``(V, K)`` each, summed over the agent's faces."""
        chosen = choose_objects(scene, names)
        counts, found = np.zeros((5, len(rows), len(chosen)), dtype=np.int64), None
        worlds, faces = self._views(scene, rows)
        for camera, canvas, poses in faces:
            found = see_objects(scene, camera, poses, worlds, chosen, canvas=canvas, skip_unseen=True, threads=threads)
            counted = ("visible_pixels", "silhouette_pixels", "image_pixels", "too_near_pixels", "too_far_pixels")
            counts += np.stack([getattr(found, name).numpy() for name in counted])
        assert found is not None  # there is at least one face
        visible, silhouette, image, near, far = counts
        reasons = np.stack([image - visible - near - far, near, far])
        order = np.array([Visibility.OCCLUDED, Visibility.TOO_NEAR, Visibility.TOO_FAR])
        status = np.where(image > 0, order[reasons.argmax(axis=0)], Visibility.OUT_OF_VIEW)
        return self._quantities(visible, silhouette, status, found.visible_box)

    def _see_unions(
        self, scene: Scene, rows: NDArray[np.float32], names: list[str], threads: int | None
    ) -> dict[str, NDArray[Any]]:
        """Return the quantities of unions of objects, ``(V, K)`` each, summed over the agent's faces.

        If no face shows a union, its status is that of the face in whose image most of its silhouette is.
        """
        shape = len(rows), len(names)
        counts, status = np.zeros((2, *shape), dtype=np.int64), np.full(shape, int(Visibility.OUT_OF_VIEW))
        most, found = np.zeros(shape, dtype=np.int64), None
        worlds, faces = self._views(scene, rows)
        groups = {name: self._visual[name] for name in names}
        for camera, canvas, poses in faces:
            meter = FractionMeter(
                scene, camera, objects=groups, canvas=canvas, min_samples=1, occluders=0, threads=threads
            )
            found = meter.measure_parsed(poses, worlds)
            visible, silhouette = found.visible_pixels.numpy(), found.silhouette_pixels.numpy()
            counts += np.stack([visible, silhouette])
            met = found.status.numpy() != Visibility.OUT_OF_VIEW
            better = met & (silhouette > most)
            status, most = np.where(better, found.status.numpy(), status), np.where(better, silhouette, most)
        assert found is not None  # there is at least one face
        return self._quantities(counts[0], counts[1], status, found.box)

    def _quantities(
        self, visible: NDArray[np.int64], silhouette: NDArray[np.int64], status: NDArray[Any], boxes: wp.array
    ) -> dict[str, NDArray[Any]]:
        """Return quantities ``(V, K)`` from counts of pixels, and the visible boxes in the last face's image."""
        size = sum(face.camera.width * face.camera.height for face in self.faces)
        seen = {"pixels": visible, "image_fraction": visible / size, "fraction": visible / np.maximum(silhouette, 1)}
        seen["status"] = np.where(visible > 0, Visibility.VISIBLE, status)
        if any(term.quantity == "margin" for term in self.terms):
            x, y, width, height = np.moveaxis(boxes.numpy().astype(np.float64), -1, 0)
            camera = self.faces[0].camera
            gaps = np.stack([x, y, camera.width - x - width, camera.height - y - height])
            seen["margin"] = np.where(visible > 0, gaps.min(axis=0), -np.inf)
        return seen


def place_objects(
    scene: Scene, indices: Sequence[int], rows: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the center [m], ``(V, 3)``, and rotation, ``(V, 3, 3)``, of the box of one or several objects.

    Boxes are aligned with the frame with which all objects move; without a common frame, with the world, whose rotation
    is the identity.

    Args:
        scene: The scene.
        indices: The objects.
        rows: Poses of the movable objects in each view, ``(V, M, 7)``.
    """
    columns = pose_columns(scene)[list(indices)]
    identity = np.broadcast_to(np.eye(4), (len(rows), 4, 4))
    frame = poses_to_matrices(rows[:, columns[0]]) if columns[0] >= 0 and len(set(columns)) == 1 else None
    low, high = np.full((len(rows), 3), np.inf), np.full((len(rows), 3), -np.inf)
    for index, column in zip(indices, columns.tolist(), strict=True):
        vertices = scene.objects[index].frame_vertices
        corners = np.array(list(product(*np.stack([vertices.min(axis=0), vertices.max(axis=0)]).astype(np.float64).T)))
        pose = poses_to_matrices(rows[:, column]) if frame is None and column >= 0 else identity
        placed = corners @ pose[:, :3, :3].swapaxes(1, 2) + pose[:, None, :3, 3]
        low, high = np.minimum(low, placed.min(axis=1)), np.maximum(high, placed.max(axis=1))
    middle, frame = (low + high) / 2, identity if frame is None else frame
    return (frame[:, :3, :3] @ middle[..., None])[..., 0] + frame[:, :3, 3], frame[:, :3, :3]


def parse_agents(scene: Scene, agents: Sequence[tuple[Agent, Constraints]]) -> list[Observer]:
    """Check agents and their constraints."""
    observers: list[Observer] = []
    for item in as_items(agents, "agents"):
        if not isinstance(item, tuple | list) or len(item) != 2 or not isinstance(item[0], Agent):
            raise ArrayError(f"agents must be pairs of a warpvis.Agent and its constraints, got {item!r}")
        agent, constraints = item
        if len(agent.poses) != 1:
            raise ArrayError(f"{agent.name!r} must have one pose, got {len(agent.poses)}")
        if agent.name in [observer.name for observer in observers]:
            raise ArrayError(f"agents must have distinct names, got {agent.name!r} twice")
        terms = parse_constraints(scene, constraints, f"constraints of {agent.name!r}")
        if len(agent.faces) > 1 and any(term.quantity == "margin" for term in terms):
            raise ArrayError(f"margin requires a camera with one image, but {agent.name!r} has a FieldOfView")
        excluded = check_exclude(agent.excluded)
        for name in excluded:
            scene.index(name)  # type: ignore[arg-type]
        observers.append(Observer(agent.name, agent.faces, agent.poses.astype(np.float32), terms, excluded))
    return observers


def violations(terms: Sequence[Term], slack: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Return by how much conditions are violated, ``(n, T)``, from 0 to 1: relative to the range of the quantity."""
    fixed = {"fraction": 1.0, "status": 1.0, "angle": math.pi, "margin": float(width)}
    limits = [[abs(limit) for limit in (term.low, term.high) if math.isfinite(limit)] for term in terms]
    scales = [fixed.get(term.quantity, max(pair, default=0) or 1.0) for term, pair in zip(terms, limits, strict=True)]
    return np.clip(-slack / np.array(scales), 0.0, 1.0)


def _slack(terms: Sequence[Term], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the signed distance of values to the nearer limit; NaN for values that are NaN."""
    slack = np.empty_like(values)
    for column, term in enumerate(terms):
        value = values[:, column]
        if term.quantity == "status":
            slack[:, column] = np.where(np.isin(value, term.statuses), 1.0, -1.0)
            slack[np.isnan(value), column] = np.nan
        else:
            slack[:, column] = np.minimum(value - term.low, term.high - value)
    return slack
