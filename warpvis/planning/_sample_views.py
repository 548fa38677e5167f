# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Random poses of cameras and objects that meet constraints: rejection in batches, and refinement of near misses."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.core.checks import check_flag, check_mapping, check_whole, describe_exception, pluralize
from warpvis.core.poses import QuaternionOrder, check_up, parse_poses, poses_to_opencv, to_xyzw
from warpvis.core.types import ObjectPoses, PoseLike
from warpvis.errors import ArrayError, PoseError
from warpvis.planning._check_constraints import Observer, as_faces, parse_agents, violations
from warpvis.planning._constraints import Constraints, parse_constraints
from warpvis.planning._free_space import check_exclude, inside_solids, one_world
from warpvis.planning._overlap import boxes_meet_boxes, boxes_meet_triangles, points_in_boxes
from warpvis.planning._regions import BoxRegion, MovedObject, ShellRegion, SupportRegion, find_targets
from warpvis.scene import Scene, require_scene
from warpvis.scene.worlds import parse_worlds
from warpvis.visibility import Agent

Region: TypeAlias = BoxRegion | ShellRegion | Callable[[np.random.Generator, int], PoseLike]
"""A region of camera poses; or a function that returns n poses for a random generator and n."""

# Numbers of samples per batch: results of easy constraints take one small batch.
_MIN_BATCH, _MAX_BATCH = 32, 512

# Near misses are refined if fewer than this fraction of a batch is accepted.
_RARE = 0.1
# Number of near misses that are refined, and standard deviations of the steps, relative to the region.
_NEAR_MISSES = 32
_STEPS = tuple(0.15 * 0.7**step for step in range(8))


@dataclass(frozen=True, eq=False)
class SampledPoses:
    """Poses that meet constraints, as NumPy arrays, and how they were found."""

    poses: NDArray[np.float64]
    """Camera poses, rows ``x y z qx qy qz qw``, OpenCV camera to world, ``(n, 7)``; ``(0, 7)`` without a camera."""
    object_poses: NDArray[np.float32] | None
    """Poses of all movable objects in each of n worlds, ``(n, M, 7)``; None if no object was moved."""
    tries: int
    """Number of samples that were tested."""
    accepted: int
    """Number of samples that met all constraints, at least n."""
    refined: int
    """Number of accepted samples that were near misses before."""
    failures: dict[str, int]
    """Number of rejected samples by the condition that they violated most; they sum to ``tries - accepted``."""

    @property
    def acceptance(self) -> float:
        """Accepted samples as a fraction of the tries."""
        return self.accepted / self.tries if self.tries else 0.0

    @property
    def hardest(self) -> str | None:
        """The condition that most samples failed; None if no sample was rejected."""
        name = max(self.failures, key=self.failures.__getitem__, default=None)
        return name if name is not None and self.failures[name] else None

    def report(self) -> dict[str, Any]:
        """Return counts and failures as plain Python values for `json.dumps`."""
        counts = {"tries": self.tries, "accepted": self.accepted, "refined": self.refined}
        return {**counts, "acceptance": self.acceptance, "failures": dict(self.failures)}


def sample_views(
    scene: Scene,
    camera: ImageCamera,
    constraints: Constraints,
    region: Region,
    count: int,
    seed: int,
    *,
    move: Mapping[str, SupportRegion] | None = None,
    agents: Sequence[tuple[Agent, Constraints]] = (),
    max_tries: int = 10_000,
    refine: bool = True,
    partial: bool = False,
    object_poses: ObjectPoses = None,
    exclude: Sequence[str | int] | str | None = None,
    quaternion: QuaternionOrder = "xyzw",
    threads: int | None = None,
) -> SampledPoses:
    """Sample camera poses, and optionally poses of objects, that meet constraints.

    Samples are uniform in the region, except those that are refined: if less than a tenth of a batch is accepted, the
    best rejected samples take Gaussian steps of decreasing size toward a smaller total violation. Without refinement,
    the results are uniform among all poses of the region that meet the constraints. Cameras inside closed objects
    whose triangles face outward are rejected, and so are moved objects whose oriented bounding boxes overlap others.

    Results depend only on the arguments, bit for bit, not on the device or the number of threads.

    Args:
        scene: The scene.
        camera: The camera.
        constraints: What it must see of objects; see `check_constraints`.
        region: Where the camera may be: a `BoxRegion`, a `ShellRegion`, or a function of a NumPy random generator and
            a number n that returns n poses; the latter are not refined.
        count: Number of poses.
        seed: Seed of the random numbers (`numpy.random.default_rng`), at least 0.
        move: Movable objects, by name, that are placed at random, too, each with its `SupportRegion`.
        agents: Other agents, each at one pose, with their own constraints.
        max_tries: Maximum number of samples.
        refine: Whether to refine near misses.
        partial: Whether to return fewer poses after `max_tries` samples, instead of an error.
        object_poses: Poses of the movable objects that are not placed, in one world, as for `Renderer.render`.
        exclude: Names or indices of objects that are neither visible to the camera nor obstacles.
        quaternion: Order of the quaternions in `object_poses`, ``"xyzw"`` or ``"wxyz"``.
        threads: Number of CPU threads; by default all cores available to the process.

    Raises:
        PoseError: If fewer than `count` poses are found, and `partial` is False.
    """
    view = ("camera", camera, constraints, region)
    sampler = _Sampler.parse(scene, view, {} if move is None else move, agents, object_poses, exclude, quaternion)
    return sampler.run(count, seed, max_tries, refine, partial, threads)


def sample_objects(
    scene: Scene,
    move: Mapping[str, SupportRegion],
    agents: Sequence[tuple[Agent, Constraints]],
    count: int,
    seed: int,
    *,
    max_tries: int = 10_000,
    refine: bool = True,
    partial: bool = False,
    object_poses: ObjectPoses = None,
    exclude: Sequence[str | int] | str | None = None,
    quaternion: QuaternionOrder = "xyzw",
    threads: int | None = None,
) -> SampledPoses:
    """Sample poses of objects so that several agents see them as constraints require.

    Arguments are those of `sample_views`; the agents' cameras are fixed.

    Example:
        >>> table = SupportRegion("table", margin=0.05)
        >>> agents = [(person, {"cup": (0.5, 1.0)}), (robot, {"cup": (0.0, 0.0)})]
        >>> worlds = sample_objects(scene, {"cup": table}, agents, count=10, seed=0).object_poses

    Raises:
        PoseError: If fewer than `count` arrangements are found, and `partial` is False.
    """
    sampler = _Sampler.parse(scene, None, move, agents, object_poses, exclude, quaternion)
    return sampler.run(count, seed, max_tries, refine, partial, threads)


@dataclass(eq=False)
class _Batch:
    """Samples and what was found about them."""

    numbers: NDArray[np.float64]
    """Uniform random numbers that determine the samples, ``(n, D)``."""
    given: NDArray[np.float64] | None
    """Poses from a function, ``(n, 7)``."""
    poses: NDArray[np.float64]
    rows: NDArray[np.float32]
    violation: NDArray[np.float64]
    """Total violation, ``(n,)``; 0 if accepted, inf if not measured."""
    reason: NDArray[np.int64]
    """Index of the condition that is violated most, ``(n,)``."""

    def put(self, index: NDArray[np.int64], other: _Batch, chosen: NDArray[np.bool_]) -> None:
        """Replace samples by others."""
        for name in ("numbers", "poses", "rows", "violation", "reason"):
            getattr(self, name)[index[chosen]] = getattr(other, name)[chosen]


@dataclass(frozen=True, eq=False)
class _Sampler:
    """Samples of one call, with checked arguments."""

    scene: Scene
    region: Region | None
    moved: tuple[MovedObject, ...]
    observers: tuple[Observer, ...]
    """The agents, and first the sampled camera if there is a region."""
    rows: NDArray[np.float32]
    """Initial poses of the movable objects, ``(M, 7)``."""
    exclude: list[str | int]
    triangles: NDArray[np.float32]
    """Obstacles of moved objects, ``(T, 3, 3)``."""

    @classmethod
    def parse(
        cls,
        scene: Scene,
        view: tuple[str, ImageCamera, Constraints, Region] | None,
        move: Mapping[str, SupportRegion],
        agents: Sequence[tuple[Agent, Constraints]],
        object_poses: ObjectPoses,
        exclude: Sequence[str | int] | str | None,
        quaternion: QuaternionOrder,
    ) -> _Sampler:
        require_scene(scene).require_objects()
        excluded = check_exclude(exclude)
        observers, region = [], None
        if view is not None:
            name, camera, constraints, region = view
            faces, terms = as_faces(camera), parse_constraints(scene, constraints)
            observers.append(Observer(name, faces, np.zeros((1, 7), dtype=np.float32), terms, excluded))
            if not isinstance(region, BoxRegion | ShellRegion) and (isinstance(region, type) or not callable(region)):
                raise ArrayError(f"region must be a BoxRegion, a ShellRegion or a function, got {region!r}")
            target = getattr(region, "look_at", getattr(region, "target", None))
            if isinstance(target, str):
                scene.index(target)
        observers += parse_agents(scene, agents)
        moves = check_mapping(move, "move")
        if view is None and not moves:
            raise ArrayError("move must have one or more objects, got none")
        poses = to_xyzw(object_poses, quaternion, "object_poses")
        vertices, ignored = one_world(scene, poses, excluded or None)
        rows = np.zeros((0, 7), dtype=np.float32)
        if scene.movable:
            rows = _parse_rows(scene, poses)
        placed = tuple(MovedObject.parse(scene, name, region_of, rows) for name, region_of in moves.items())
        wrong = [item.name for item in placed if item.region.support in moves]
        if wrong:
            raise ArrayError(f"the support of {wrong[0]!r} must not be moved itself")
        columns = [item.column for item in placed]
        free = {scene.movable[column] for column in columns}
        attached = {child for child, parent in scene.attached().items() if parent in free}
        fixed = [i for i in range(len(scene)) if not ignored[i] and i not in free | attached]
        corners = [vertices[i][scene.objects[i].faces] for i in fixed] if placed else []
        triangles = np.concatenate([np.zeros((0, 3, 3), dtype=np.float32), *corners])
        names = [scene.objects[i].name for i in sorted(free | attached)]
        return cls(scene, region, placed, tuple(observers), rows, [*excluded, *names], triangles)

    def run(
        self, count: int, seed: int, max_tries: int, refine: bool, partial: bool, threads: int | None
    ) -> SampledPoses:
        """Sample until `count` samples are accepted or `max_tries` are tested."""
        count, max_tries = check_whole(count, "count"), check_whole(max_tries, "max_tries")
        generator = np.random.default_rng(check_whole(seed, "seed", minimum=0))
        refine, partial = check_flag(refine, "refine"), check_flag(partial, "partial")
        names = self._names()
        failed = np.zeros(len(names), dtype=np.int64)
        tries = accepted = refined = 0
        size, found = _MIN_BATCH, []
        while accepted < count and tries < max_tries:
            size = min(max(size, count - accepted), _MAX_BATCH, max_tries - tries)
            batch = self._sample(generator, size, threads)
            met = batch.violation == 0
            found.append((batch.poses[met], batch.rows[met]))
            failed += np.bincount(batch.reason[~met], minlength=len(names))
            tries, accepted = tries + size, accepted + int(met.sum())
            dimensions = batch.numbers.shape[1]
            if refine and accepted < count and met.sum() < _RARE * size and dimensions:
                near, used, misses = self._refine(generator, batch, max_tries - tries, threads)
                met = near.violation == 0
                found.append((near.poses[met], near.rows[met]))
                failed += misses
                tries, accepted, refined = tries + used, accepted + int(met.sum()), refined + int(met.sum())
            size *= 2
        poses, rows = (np.concatenate(parts)[:count] for parts in zip(*found, strict=True))
        failures: dict[str, int] = {}
        for name, number in zip(names, failed.tolist(), strict=True):
            if number:  # several conditions may have one name
                failures[name] = failures.get(name, 0) + number
        result = SampledPoses(poses, rows if self.moved else None, tries, accepted, refined, failures)
        if len(rows) < count and not partial:
            worst = result.hardest
            raise PoseError(
                f"only {len(rows)} of {pluralize(count, 'sample')} met all constraints in {tries} tries, and most "
                f"failed by the {worst} ({failures[worst or '']} of {tries}); relax it, enlarge the region, or raise "
                "max_tries"
            )
        return result

    def _names(self) -> list[str]:
        """Return the names of all conditions."""
        names = [f"placement of {item.name!r}" for item in self.moved]
        names += [] if self.region is None else ["position of the camera"]
        several = len(self.observers) > 1
        for observer in self.observers:
            names += [f"{term} for {observer.name!r}" if several else str(term) for term in observer.terms]
        return names

    def _sample(self, generator: np.random.Generator, size: int, threads: int | None) -> _Batch:
        """Draw and test samples."""
        dimensions = sum(item.region.dimensions for item in self.moved) + getattr(self.region, "dimensions", 0)
        numbers = generator.random((size, dimensions))
        given = None
        if self.region is not None and not isinstance(self.region, BoxRegion | ShellRegion):
            given = _call(self.region, generator, size)
        return self._test(numbers, given, threads)

    def _refine(
        self, generator: np.random.Generator, batch: _Batch, budget: int, threads: int | None
    ) -> tuple[_Batch, int, NDArray[np.int64]]:
        """Improve the near misses of a batch by random steps; return them, the tries, and failures by condition."""
        order = np.argsort(batch.violation, kind="stable")
        order = order[np.isfinite(batch.violation[order]) & (batch.violation[order] > 0)][:_NEAR_MISSES]
        parts = {name: getattr(batch, name)[order] for name in ("numbers", "poses", "rows", "violation", "reason")}
        near = _Batch(given=None if batch.given is None else batch.given[order], **parts)
        failed, used = np.zeros(len(self._names()), dtype=np.int64), 0
        for step in _STEPS:
            left = np.flatnonzero(near.violation > 0)[: budget - used]
            if not len(left):
                break
            numbers = near.numbers[left] + step * generator.standard_normal((len(left), near.numbers.shape[1]))
            numbers = 1 - np.abs(1 - numbers % 2)  # reflected at the limits of the region
            other = self._test(numbers, None if near.given is None else near.given[left], threads)
            failed += np.bincount(other.reason[other.violation > 0], minlength=len(failed))
            near.put(left, other, other.violation < near.violation[left])
            used += len(left)
        return near, used, failed

    def _test(self, numbers: NDArray[np.float64], given: NDArray[np.float64] | None, threads: int | None) -> _Batch:
        """Place cameras and objects, and measure how much they violate each condition."""
        size, scene, vertical = len(numbers), self.scene, check_up(self.scene.up)
        rows, first = np.repeat(self.rows[None], size, axis=0), 0
        violation = np.zeros((size, len(self._names())))
        for index, item in enumerate(self.moved):
            last = first + item.region.dimensions
            rows[:, item.column], fits = item.place(numbers[:, first:last])
            violation[~fits, index], first = math.inf, last
        self._test_overlap(rows, violation, threads)
        poses, observers = np.zeros((size, 0)), list(self.observers)
        if self.region is not None:
            target = getattr(self.region, "look_at", getattr(self.region, "target", None))
            if given is None:
                poses = self.region.place(numbers[:, first:], find_targets(scene, target, rows), vertical)  # type: ignore[union-attr, arg-type]
            else:
                poses = given
            violation[self._in_solids(poses, rows, threads), len(self.moved)] = math.inf
            observers[0] = replace(observers[0], poses=parse_poses(poses).numpy().reshape(-1, 7))
        start = len(self.moved) + (self.region is not None)
        for visual in (False, True):  # images are rendered only where everything else is met
            free = np.flatnonzero((violation == 0).all(axis=1))
            last = start
            for observer in observers if len(free) else ():
                chosen = replace(observer, poses=observer.poses[free]) if len(observer.poses) > 1 else observer
                checked = chosen.check(scene, rows[free], geometric=not visual, visual=visual, threads=threads)
                columns = slice(last, last + len(observer.terms))
                last = columns.stop
                found = violations(observer.terms, checked.slack, observer.faces[0].camera.width)
                violation[free, columns] += np.nan_to_num(found)
        measured = np.zeros(size, dtype=bool)
        measured[free] = True
        total = np.where(measured, violation.sum(axis=1), math.inf)
        return _Batch(numbers, given, poses, rows, total, violation.argmax(axis=1))

    def _test_overlap(self, rows: NDArray[np.float32], violation: NDArray[np.float64], threads: int | None) -> None:
        """Reject samples whose moved objects overlap others."""
        boxes = [item.boxes(rows) for item in self.moved]
        for index, (center, axes, half) in enumerate(boxes):
            meets = boxes_meet_triangles(center, axes, half, self.triangles)
            meets |= self._inside(center, threads)
            for other in boxes[:index]:
                meets |= boxes_meet_boxes(center, axes, half, *other)
            violation[meets, index] = math.inf

    def _inside(self, points: NDArray[np.float64], threads: int | None) -> NDArray[np.bool_]:
        """Return which points are inside closed objects that are not moved."""
        poses = self.rows[None] if len(self.rows) else None
        return inside_solids(self.scene, points, exclude=self.exclude or None, object_poses=poses, threads=threads)

    def _in_solids(
        self, poses: NDArray[np.float64], rows: NDArray[np.float32], threads: int | None
    ) -> NDArray[np.bool_]:
        """Return which cameras are inside closed objects, or inside the boxes of moved ones."""
        inside = self._inside(poses[:, :3], threads)
        for item in self.moved:
            inside |= points_in_boxes(poses[:, :3], *item.boxes(rows))
        return inside


def _parse_rows(scene: Scene, object_poses: ObjectPoses) -> NDArray[np.float32]:
    """Return the poses of the movable objects in one world, ``(M, 7)``."""
    return parse_worlds(scene, 1, object_poses, [0], None).object_poses.numpy().reshape(-1, 7)


def _call(region: Callable[[np.random.Generator, int], PoseLike], generator: np.random.Generator, size: int) -> Any:
    """Return the poses of a function, ``(size, 7)``."""
    try:
        found = region(generator, size)
    except Exception as error:
        raise PoseError(f"region must return {size} poses, but it raised {describe_exception(error)}") from error
    poses = poses_to_opencv(found, name="poses of the region")
    if len(poses) != size:
        raise PoseError(f"region must return {size} poses, got {len(poses)}")
    return poses
