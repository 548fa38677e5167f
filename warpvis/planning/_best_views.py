# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Candidate camera poses, ranked by the visibility of given objects, and proposals for a robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.image_cameras import ImageCamera, require_image_camera
from warpvis.core.arrays import as_numpy, as_point, check_length, empty
from warpvis.core.checks import as_items, check_choice, check_number, check_whole, degrees_hint, is_number
from warpvis.core.poses import Convention, QuaternionOrder, check_up, parse_poses, poses_to_opencv, to_xyzw
from warpvis.core.types import ArrayInput, ObjectPoses, PoseLike
from warpvis.errors import ArrayError, CameraError, SceneError
from warpvis.planning._free_space import check_exclude, one_world, standing_room
from warpvis.scene import Scene, require_scene
from warpvis.scene.worlds import parse_worlds
from warpvis.visibility import Agent, Candidate, FieldOfView, State, choose_objects, see_objects

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds

Measure = Literal["fraction", "pixels"]

_FIELDS = {"fraction": ("fraction", wp.float32), "pixels": ("visible_pixels", wp.int32)}

# Without `ReferenceModel.lapse`, probabilities may round to 0.
_MIN_WEIGHT = 1e-30
# Candidates times objects that are evaluated per call, whose counters take 150 MB.
_AT_A_TIME = 1 << 21

# Maximum number of poses of a grid, which needs 2 GB including temporary arrays.
_MAX_PLACES = 10**7

# Scores are single precision: a quotient score / tie that is integral up to this rounding error counts as integral.
_TIE_ROUNDING = 1e-4

# Step of scores within which the nearest position is chosen.
_TIE = 0.05


@dataclass(frozen=True, eq=False)
class BestViews:
    """Candidate poses ranked by the visibility of K objects, as NumPy arrays."""

    order: NDArray[np.int64]
    """Indices of the candidates, best first, ``(k,)``."""
    scores: NDArray[np.float32]
    """Weighted mean of `values` over the objects, ``(C,)``; -inf for rejected candidates."""
    values: NDArray[np.float32]
    """Visible fraction or pixels of each object from every candidate, ``(C, K)``; NaN for rejected candidates."""
    path_lengths: NDArray[np.float64] | None
    """Path length to each candidate [m], ``(C,)``; None if not given."""
    objects: tuple[str, ...]
    """Names of the objects."""
    candidates: NDArray[np.float64]
    """The candidates, rows ``x y z qx qy qz qw``, OpenCV camera to world, ``(C, 7)``."""

    def pose(self, rank: int = 0) -> NDArray[np.float64]:
        """Return the pose at a rank, ``x y z qx qy qz qw``, OpenCV camera to world, ``(7,)``."""
        if check_whole(rank, "rank", minimum=0) >= len(self.order):
            raise ArrayError(f"rank must be from 0 to {len(self.order) - 1}, got {rank!r}")
        return self.candidates[self.order[rank]]


def pose_grid(
    center: ArrayLike,
    *,
    radius: float,
    step: float,
    height: float,
    look_at: ArrayLike | None = None,
    headings: int = 8,
    pitch: float = 0.0,
    up: Literal["z", "y"] = "z",
) -> NDArray[np.float64]:
    """Generate camera poses over a disc of the floor, on a square grid around its center.

    Args:
        center: Center of the disc in the world [m], shape ``(3,)``; its height is ignored.
        radius: Radius of the disc [m].
        step: Spacing of the grid [m].
        height: Height of the cameras in the world [m].
        look_at: A point [m] that all cameras look at, shape ``(3,)``. Grid points exactly above or below it are
            skipped. By default, every grid point has cameras in several directions.
        headings: Number of these directions, evenly spaced counterclockwise as seen from above, starting from the
            floor's first axis (x where z is up, z where y is up).
        pitch: Angle of these directions above the horizontal [rad]; negative looks down.
        up: The world's vertical axis.

    Returns:
        Rows ``x y z qx qy qz qw``, OpenCV camera to world, shape ``(C, 7)``.
    """
    vertical = check_up(up)
    first, second = (vertical + 1) % 3, (vertical + 2) % 3
    middle = as_point(center, "center")
    radius, step = check_length(radius, "radius"), check_length(step, "step", zero=False)
    height = check_length(height, "height", signed=True)
    directions = check_whole(headings, "headings") if look_at is None else 1
    across = 2 * radius / step + 1  # of a square around the disc; checked before allocation
    if directions > _MAX_PLACES or not across * across * directions <= _MAX_PLACES:
        raise ArrayError(
            f"a pose grid must have at most {_MAX_PLACES} poses, got a radius of {radius} m with a step of {step} m; "
            "use a larger step or fewer headings"
        )
    steps = np.arange(-math.floor(radius / step + 1e-9), math.floor(radius / step + 1e-9) + 1) * step
    grid = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    grid = grid[np.hypot(*grid.T) <= radius * (1 + 1e-9)]
    places = np.empty((len(grid), 3))
    places[:, first], places[:, second] = middle[first] + grid[:, 0], middle[second] + grid[:, 1]
    places[:, vertical] = height
    if look_at is not None:
        forward = as_point(look_at, "look_at") - places
        oblique = np.hypot(forward[:, first], forward[:, second]) > 1e-9 * np.abs(forward[:, vertical])
        return look_along(places[oblique], forward[oblique], vertical)
    if not is_number(pitch) or not -math.pi / 2 < pitch < math.pi / 2:
        raise ArrayError(f"pitch must be between -pi/2 and pi/2 radians, got {pitch!r}{degrees_hint(pitch)}")
    angles = np.arange(headings) * (2 * math.pi / headings)
    forward = np.empty((headings, 3))
    forward[:, first], forward[:, second] = np.cos(angles) * math.cos(pitch), np.sin(angles) * math.cos(pitch)
    forward[:, vertical] = math.sin(pitch)
    return look_along(np.repeat(places, headings, axis=0), np.tile(forward, (len(places), 1)), vertical)


def best_views(
    scene: Scene,
    camera: ImageCamera,
    candidates: PoseLike,
    *,
    objects: Sequence[str | int],
    weights: ArrayLike | None = None,
    measure: Measure = "fraction",
    count: int | None = None,
    start: ArrayLike | None = None,
    path_lengths: ArrayLike | None = None,
    tie: float = 0.01,
    radius: float | None = None,
    floor: float = 0.0,
    delta: float = 0.0,
    object_poses: ObjectPoses = None,
    exclude: Sequence[str | int] | str | None = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    threads: int | None = None,
) -> BestViews:
    """Rank candidate poses by the visibility of given objects.

    A candidate's score is the weighted mean of the objects' visibility. Scores tie if they are equal after division by
    `tie` and rounding down (up to single-precision rounding errors). Ties are ordered by shorter path, then by higher
    score, then by lower index.

    Args:
        scene: The scene.
        camera: The camera.
        candidates: Candidate poses, camera to world, ``(C, 7)`` or ``(C, 4, 4)``; see `pose_grid`.
        objects: Names or indices of the K objects.
        weights: Weights of the objects, shape ``(K,)``; equal by default.
        measure: ``"fraction"``, the visible fraction of an object's silhouette, or ``"pixels"``, its number of visible
            pixels.
        count: Maximum number of ranked candidates; all by default.
        start: Current position of the camera, a point ``(3,)`` or a pose. Paths are straight lines on the floor from
            it.
        path_lengths: Alternatively, lengths of the paths to the candidates [m], shape ``(C,)``; inf for unreachable
            ones.
        tie: Step of scores within which path lengths decide; 0 if only equal scores tie.
        radius: Radius of a robot that stands under the camera [m]; candidates without room for it are rejected.
        floor: Height of the floor that it stands on [m]; see `warpvis.planning.standing_room`.
        delta: See `object_visibility`.
        object_poses: Poses of the movable objects in one world, as for `Renderer.render`.
        exclude: Names or indices of objects that are neither visible nor obstacles, such as the robot's body.
        convention: Axes of the camera frame of the candidates.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        threads: Number of CPU threads; by default all cores available to the process.

    Returns:
        Order and scores of the candidates; candidates without room or path are not in the order.

    Raises:
        ArrayError: If all candidates are rejected.
    """
    candidates = to_xyzw(candidates, quaternion, "candidates")
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    require_scene(scene).require_objects()
    require_image_camera(camera)
    check_choice(measure, "measure", tuple(_FIELDS))
    tie = check_number(tie, "tie", minimum=0.0)
    count = None if count is None else check_whole(count, "count")
    chosen = choose_objects(scene, objects)
    weights = _check_weights(weights, len(chosen))
    array = as_numpy(candidates, name="candidates")
    if array.size == 0:
        raise ArrayError("candidates must be one or more poses, got none")
    rows = parse_poses(array, convention=convention, name="candidates").numpy().astype(np.float64).reshape(-1, 7)
    lengths = _path_lengths(scene, rows, start, path_lengths)
    poses = parse_worlds(scene, 1, object_poses, [0], None).object_poses
    if len(poses) != 1:
        raise ArrayError(f"object_poses must be of one world, got {len(poses)}")
    surroundings: dict[str, Any] = {"object_poses": poses if scene.movable else None}
    surroundings["exclude"] = check_exclude(exclude) or None
    free = np.isfinite(lengths)
    if radius is not None:
        free &= standing_room(scene, rows, radius=radius, floor=floor, **surroundings)
    if not free.any():
        needed = "a path to it" if radius is None else "a path to it and room for the robot"
        raise ArrayError(f"at least one candidate must have {needed}, got {len(rows)} without")
    values = np.full((len(rows), len(chosen)), np.nan, dtype=np.float32)
    options = {"delta": delta, "threads": threads, "canvas": (0, 0, 0, 0) if measure == "pixels" else None}
    worlds = parse_worlds(scene, len(rows), world_index=None, **surroundings)
    values[free] = _measure(scene, camera, rows[free], worlds, chosen, measure, options)
    scores = np.full(len(rows), -np.inf, dtype=np.float32)
    scores[free] = values[free].astype(np.float64) @ (weights / weights.sum())
    order = np.flatnonzero(free)
    exact = scores[free].astype(np.float64)
    tied = np.floor(exact / tie + _TIE_ROUNDING) if tie > 0 else exact
    order = order[np.lexsort((-exact, lengths[free], -tied))][:count]
    names = tuple(scene.objects[index].name for index in chosen)
    known = start is not None or path_lengths is not None
    return BestViews(order, scores, values, lengths if known else None, names, rows)


def _measure(
    scene: Scene,
    camera: ImageCamera,
    rows: NDArray[np.float64],
    world: Worlds,
    chosen: list[int],
    measure: Measure,
    options: dict[str, Any],
) -> np.ndarray:
    """Return one field of `object_visibility` for all poses, ``(C, K)``, with a single transfer to the host."""
    poses, (field, dtype) = wp.array(rows.astype(np.float32), dtype=wp.transform, device=scene.device), _FIELDS[measure]
    values = empty((len(rows), len(chosen)), dtype, name="values", device=scene.device)
    step = max(1, _AT_A_TIME // len(chosen))
    for first in range(0, len(rows), step):
        part = slice(first, min(first + step, len(rows)))
        found = see_objects(scene, camera, poses[part], world, chosen, skip_unseen=True, **options)
        wp.copy(values[part], getattr(found, field))
    return values.numpy()


def _path_lengths(
    scene: Scene, rows: NDArray[np.float64], start: ArrayInput | None, path_lengths: ArrayInput | None
) -> NDArray[np.float64]:
    """Compute the path length to every candidate [m], shape ``(C,)``; 0 if not given."""
    if start is not None and path_lengths is not None:
        raise ArrayError("give either start or path_lengths, not both")
    if path_lengths is not None:
        lengths = as_numpy(path_lengths, name="path_lengths").astype(np.float64)
        if lengths.shape != (len(rows),) or not (lengths >= 0).all():
            raise ArrayError(
                f"path_lengths must be {len(rows)} lengths from 0 up, one for each candidate, got "
                f"{'a negative one or NaN' if lengths.shape == (len(rows),) else f'shape {lengths.shape}'}"
            )
        return lengths
    if start is None:
        return np.zeros(len(rows))
    start_array = as_numpy(start, name="start")
    places = as_point(start, "start")[None] if start_array.shape == (3,) else poses_to_opencv(start, name="start")
    if len(places) != 1:
        raise ArrayError(f"start must be a point or one pose, got {len(places)}")
    point = places[0, :3]
    floor_axes = [axis for axis in range(3) if axis != check_up(scene.up)]
    return np.linalg.norm(rows[:, floor_axes] - point[floor_axes], axis=1)


def _check_weights(weights: ArrayLike | None, count: int) -> NDArray[np.float64]:
    if weights is None:
        return np.ones(count)
    numbers = as_numpy(weights, name="weights").astype(np.float64)
    if numbers.shape != (count,) or not (np.isfinite(numbers).all() and (numbers >= 0).all() and numbers.any()):
        raise ArrayError(
            f"weights must be {count} numbers from 0 up, one for each object and not all 0, got {numbers.tolist()}"
        )
    return numbers


def look_along(places: NDArray[np.float64], forward: NDArray[np.float64], vertical: int) -> NDArray[np.float64]:
    """Build upright poses at positions ``(C, 3)`` along directions of any length: a vectorized `look_at`."""
    right = np.cross(forward, np.eye(3)[vertical])
    axes = np.stack([right, np.cross(forward, right), forward], axis=2)
    matrices = np.tile(np.eye(4), (len(places), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = axes / np.linalg.norm(axes, axis=1, keepdims=True), places
    return poses_to_opencv(matrices, name="pose grid")


@dataclass(frozen=True, eq=False)
class Proposal:
    """A pose from which a robot's camera sees objects that it does not see now."""

    pose: NDArray[np.float64]
    """The camera's pose, ``x y z qx qy qz qw``, OpenCV camera to world, shape ``(7,)``."""
    distance: float
    """Straight-line distance to it on the floor [m]."""
    fractions: dict[str, float]
    """Visible fraction of the silhouette of every missed object, by name."""

    def report(self) -> dict[str, Any]:
        """Return the proposal as plain Python values for `json.dumps`."""
        return {"pose": self.pose.tolist(), "distance": self.distance, "fractions": self.fractions}


def propose_view(
    scene: Scene,
    robot: Agent,
    candidates: list[Candidate],
    *,
    max_distance: float = 2.0,
    step: float = 0.1,
    radius: float = 0.2,
    floor: float = 0.0,
    object_poses: ObjectPoses = None,
    quaternion: QuaternionOrder = "xyzw",
) -> Proposal | None:
    """Find a pose near the robot from which it sees the most of the objects that only the person sees.

    The camera keeps its height and looks at the most likely of these objects. Candidate positions are those of
    `pose_grid` at which the robot has `standing_room`. Objects are weighted by `Candidate.probability`, that to
    be meant by the person. Among positions with similar scores, the nearest is chosen.

    Args:
        scene: The scene.
        robot: The robot, at one pose, with a `Camera`.
        candidates: Candidates of the person and the robot, from `Perspective.candidates`.
        max_distance: Maximum distance that the robot moves [m].
        step: Spacing of candidate positions [m].
        radius: Radius of the robot, an upright cylinder around its camera [m].
        floor: Height of the floor [m].
        object_poses: Poses of the movable objects in one world, as for `Renderer.render`; by default those of
            `candidates`.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.

    Returns:
        The pose; None if the robot sees all objects that the person sees, or sees none of the others from any position.
    """
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    require_scene(scene)
    if not isinstance(robot, Agent):
        raise SceneError(f"robot must be a warpvis.Agent, got {type(robot).__name__}")
    items = as_items(candidates, "candidates", SceneError)
    wrong = [type(item).__name__ for item in items if not isinstance(item, Candidate)]
    if wrong:
        raise SceneError(f"candidates must be Candidate objects from Perspective.candidates, got {wrong[0]}")
    if isinstance(robot.camera, FieldOfView):
        raise CameraError(f"camera of {robot.name!r} must be a warpvis.Camera, got a FieldOfView")
    if len(robot.poses) != 1:
        raise ArrayError(f"{robot.name!r} must have one pose, got {len(robot.poses)}")
    missed = [item for item in items if item.state == State.SECOND and item.object not in robot.body]
    if not missed:
        return None
    max_distance = check_length(max_distance, "max_distance")
    current_pose, vertical = robot.poses[0], check_up(scene.up)
    moved = missed[0].object_poses if object_poses is None else object_poses
    corners = one_world(scene, moved, None)[0][scene.index(missed[0].object)]
    target = np.stack([corners.min(axis=0), corners.max(axis=0)]).astype(np.float64).mean(axis=0)
    places = pose_grid(
        current_pose[:3],
        radius=max_distance,
        step=step,
        height=float(current_pose[vertical]),
        look_at=target,
        up=scene.up,
    )
    options: dict[str, Any] = {"object_poses": moved, "exclude": list(robot.body) or None}
    is_free = standing_room(scene, places, radius=radius, floor=floor, **options)
    if not is_free.any():
        return None
    found = best_views(
        scene,
        robot.camera,
        places[is_free],
        objects=[item.object for item in missed],
        weights=[max(item.probability, _MIN_WEIGHT) for item in missed],
        start=current_pose,
        tie=_TIE,
        **options,
    )
    best = int(found.order[0])
    if found.scores[best] <= 0:
        return None
    assert found.path_lengths is not None  # the start is given
    fractions = dict(zip(found.objects, found.values[best].astype(float).tolist(), strict=True))
    return Proposal(found.candidates[best], float(found.path_lengths[best]), fractions)
