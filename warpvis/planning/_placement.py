# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Places for k cameras, so that targets are seen from enough of them while people and robots move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.image_cameras import ImageCamera, require_image_camera
from warpvis.core.arrays import as_numpy, check_length
from warpvis.core.checks import check_choice, check_number, check_whole, is_whole
from warpvis.core.poses import Convention, QuaternionOrder, parse_poses, to_xyzw
from warpvis.core.types import ArrayInput, ObjectPoses, PoseLike
from warpvis.errors import ArrayError
from warpvis.maps import OccupancyMap, Voxel
from warpvis.planning._choice import Choice, Tally, choose_exactly, choose_greedily, tally_of
from warpvis.planning._coverage import Samples, read_points, read_weights
from warpvis.planning._free_space import check_exclude
from warpvis.planning._seen_pairs import SeenPairs, find_seen_pairs
from warpvis.scene import Scene, require_scene
from warpvis.visibility import MeasuredSpace

Method = Literal["greedy", "exact"]

# Sums of weights differ by rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Placement:
    """Chosen cameras, and which of N targets they see in each of T worlds."""

    order: NDArray[np.int64]
    """Indices of the chosen candidates, in the order of their gains, shape ``(k,)``."""
    gains: NDArray[np.float64]
    """Share of the objective that each of them adds, shape ``(k,)``."""
    fixed_share: float
    """Share of the objective that the fixed cameras achieve alone."""
    bound: float
    """Upper bound of `fraction` for any choice of k candidates."""
    reachable: float
    """Share of the objective that all candidates and fixed cameras together achieve."""
    counts: NDArray[np.uint16] = field(repr=False)
    """Number of cameras, chosen or fixed, that see each target in each world, shape ``(T, N)``."""
    at_least: int
    """Number of cameras that should see each target."""
    weights: NDArray[np.float64] = field(repr=False)
    """Weights of the targets, times their areas [m^2] if they are `Samples`, shape ``(N,)``."""
    points: NDArray[np.float32] = field(repr=False)
    """The targets in the world frame [m], shape ``(N, 3)``."""
    poses: NDArray[np.float64] = field(repr=False)
    """Poses of the chosen candidates, ``x y z qx qy qz qw``, OpenCV camera to world, shape ``(k, 7)``."""
    fixed_poses: NDArray[np.float64] = field(repr=False)
    """Poses of the fixed cameras, likewise, shape ``(F, 7)``."""
    method: Method
    """How they were chosen."""

    @property
    def fraction(self) -> float:
        """The objective: weighted mean over targets and worlds of ``min(count, at_least) / at_least``."""
        return self.fixed_share + float(self.gains.sum())

    @property
    def covered(self) -> NDArray[np.bool_]:
        """Whether at least `at_least` cameras see each target in each world, shape ``(T, N)``."""
        return self.counts >= self.at_least

    @property
    def covered_fraction(self) -> float:
        """Weighted share of targets and worlds that are `covered`."""
        return float((self.covered.mean(axis=0) * self.weights).sum() / self.weights.sum())

    def share_by_target(self) -> NDArray[np.float64]:
        """Return the share of worlds in which each target is `covered`, shape ``(N,)``."""
        return self.covered.mean(axis=0)

    def share_by_world(self) -> NDArray[np.float64]:
        """Return the weighted share of targets that are `covered` in each world, shape ``(T,)``."""
        return (self.covered * self.weights).sum(axis=1) / self.weights.sum()

    def blind_spots(self, at_least: int | None = None) -> NDArray[np.int64]:
        """Return targets that too few cameras see, as rows of a world and a target, shape ``(B, 2)``.

        Args:
            at_least: Number of cameras that are enough; by default that of the placement. With 1, the result is what no
                camera sees.
        """
        enough = self.at_least if at_least is None else check_whole(at_least, "at_least")
        return np.argwhere(self.counts < enough)

    def report(self) -> dict[str, Any]:
        """Return the placement as plain Python values for `json.dumps`."""
        return {
            "method": self.method,
            "order": self.order.tolist(),
            "poses": self.poses.tolist(),
            "gains": self.gains.tolist(),
            "fixed_share": self.fixed_share,
            "fraction": self.fraction,
            "bound": self.bound,
            "reachable": self.reachable,
            "at_least": self.at_least,
            "covered_fraction": self.covered_fraction,
            "num_worlds": len(self.counts),
            "num_targets": len(self.points),
            "num_blind_spots": len(self.blind_spots()),
            "never_seen": np.flatnonzero(~(self.counts > 0).any(axis=0)).tolist(),
            "worst_world": int(self.share_by_world().argmin()),
        }


def place_cameras(
    scene: Scene | OccupancyMap,
    camera: ImageCamera,
    candidates: PoseLike,
    targets: Samples | ArrayInput,
    k: int,
    *,
    at_least: int = 1,
    weights: ArrayInput | None = None,
    fixed: PoseLike | None = None,
    method: Method = "greedy",
    time_limit: float = 60.0,
    occupancy: OccupancyMap | MeasuredSpace | None = None,
    tolerance: float = 1e-3,
    object_poses: ObjectPoses = None,
    exclude: Sequence[str | int] | str | None = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    threads: int | None = None,
) -> Placement:
    """Choose k of many candidate poses for cameras, so that targets are seen from enough of them in all worlds.

    The objective is the weighted mean over targets and worlds of ``min(count, at_least) / at_least``, where count is
    the number of cameras that see the target in that world. A camera sees a target if `point_visibility` returns
    `Visibility.VISIBLE`.

    The greedy choice takes the candidate with the greatest gain, k times, with ties resolved by lower index. Without
    fixed cameras, it achieves at least 1 - 1/e of the best choice (Nemhauser, Wolsey and Fisher 1978), and usually much
    more: `Placement.bound` is an upper bound of what any k candidates achieve here. The exact choice solves an integer
    program, and needs SciPy.

    Args:
        scene: The scene, or a map of measured space instead of it.
        camera: Image size, intrinsics and depth range of all cameras.
        candidates: C poses, as for `Renderer.render`.
        targets: Points in the world frame [m], shape ``(N, 3)``, or samples from `surface_samples`, which count by
            their areas.
        k: Number of candidates to choose.
        at_least: Number of cameras that should see each target.
        weights: Weights of the targets, shape ``(N,)``; 1 by default.
        fixed: Poses of existing cameras, which count in addition to the k.
        method: ``"greedy"``, or ``"exact"`` for small problems.
        time_limit: Time after which the exact method stops [s], with its best choice and bound so far.
        occupancy: As for `point_visibility`: a map that may hide targets, too.
        tolerance: Maximum distance of a visible target behind the first surface along its ray [m].
        object_poses: Poses ``x y z qx qy qz qw`` of the movable objects, people among them, in T worlds,
            ``(T, M, 7)``; their initial poses by default.
        exclude: Names or indices of objects that no camera sees.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        threads: Number of CPU threads; by default all cores available to the process.
    """
    candidates = to_xyzw(candidates, quaternion, "candidates")
    fixed = to_xyzw(fixed, quaternion, "fixed")
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    if not isinstance(scene, OccupancyMap):
        require_scene(scene).require_objects()
    require_image_camera(camera)
    check_choice(method, "method", ("greedy", "exact"))
    tolerance = check_length(tolerance, "tolerance")
    time_limit = check_number(time_limit, "time_limit", minimum=0.0)
    poses = _parse_cameras(candidates, convention, "candidates")
    if not is_whole(k) or not 1 <= k <= len(poses):
        raise ArrayError(f"k must be a whole number from 1 to the {len(poses)} candidates, got {k!r}")
    standing = np.zeros((0, 7), dtype=np.float32) if fixed is None else _parse_cameras(fixed, convention, "fixed")
    at_least = check_whole(at_least, "at_least")
    if at_least > len(standing) + k:
        raise ArrayError(f"at_least must be at most {len(standing) + k}, the number of cameras, got {at_least}")
    samples = read_points(targets, "targets", scene.device)
    factors = samples.areas * read_weights(weights, len(samples), "target")
    if not (factors >= 0).all() or not 0 < factors.sum() < np.inf:
        raise ArrayError("weights and areas of targets must be finite, not negative, and not all zero")
    pairs = find_seen_pairs(
        scene,
        camera,
        wp.array(np.concatenate([poses, standing]), dtype=wp.transform, device=scene.device),
        wp.array(samples.points, dtype=wp.vec3, device=scene.device),
        tolerance=tolerance,
        occupancy=occupancy,
        object_poses=object_poses,
        exclude=check_exclude(exclude) or None,
        threads=threads,
    )
    shares = factors / (factors.sum() * pairs.worlds)
    existing = list(range(len(poses), len(poses) + len(standing)))
    tally = tally_of(pairs, existing, len(samples), at_least)
    fixed_share = tally.value(shares)
    reachable = tally_of(pairs, range(len(poses) + len(standing)), len(samples), at_least).value(shares)
    choice = _choose(pairs, tally, len(poses), shares, int(k), method, time_limit)
    return Placement(
        np.array(choice.order, dtype=np.int64),
        np.array(choice.gains),
        fixed_share,
        max(min(choice.bound, reachable), fixed_share + sum(choice.gains)),
        reachable,
        _count(pairs, choice.order + existing, len(samples)),
        at_least,
        factors,
        samples.points,
        poses[choice.order].astype(np.float64),
        standing.astype(np.float64),
        method,
    )


def unknown_targets(occupancy: OccupancyMap, bounds: ArrayLike | None = None) -> NDArray[np.float32]:
    """Return the centers of unknown voxels next to free space, as targets for the next views of a map.

    Args:
        occupancy: The map.
        bounds: Lower and upper corner of the space to explore [m], shape ``(2, 3)``; by default the map's bounds.

    Returns:
        Centers of the voxels that no image has shown and that share a face with a free one [m], shape ``(N, 3)``.
    """
    if not isinstance(occupancy, OccupancyMap):
        raise ArrayError(f"occupancy must be a warpvis.OccupancyMap, got {type(occupancy).__name__}")
    dense = occupancy.voxel_map(bounds)
    states = np.pad(dense.states.numpy(), 1, constant_values=Voxel.UNKNOWN)
    free, inner = states == Voxel.FREE, (slice(1, -1),) * 3
    adjacent = [np.roll(free, step, axis=axis)[inner] for axis in range(3) for step in (-1, 1)]
    unknown = (states[inner] == Voxel.UNKNOWN) | (states[inner] == Voxel.HIDDEN)
    return dense.centers()[unknown & np.logical_or.reduce(adjacent)]


def _parse_cameras(poses: PoseLike, convention: Convention, name: str) -> NDArray[np.float32]:
    """Check the poses of cameras and return them, OpenCV camera to world, ``x y z qx qy qz qw``, shape ``(V, 7)``."""
    array = as_numpy(poses, name=name)
    if array.size == 0:
        raise ArrayError(f"{name} must be one or more poses, got none")
    return parse_poses(array, convention=convention, name=name).numpy().reshape(-1, 7)


def _choose(
    pairs: SeenPairs,
    tally: Tally,
    count: int,
    weights: NDArray[np.float64],
    k: int,
    method: Method,
    time_limit: float,
) -> Choice:
    """Choose k of the first `count` cameras, given the tally of the fixed ones."""
    best = None
    if method == "exact":
        best = choose_exactly(pairs, tally, range(count), weights, k, time_limit)
    greedy = choose_greedily(pairs, tally, range(count), weights, k)
    if best is None:
        return greedy
    # Among equal choices, prefer the greedy one: its ties go to lower indices, and it does not depend on the solver.
    chosen = best if sum(best.gains) > sum(greedy.gains) + _ROUNDING else greedy
    return Choice(chosen.order, chosen.gains, min(best.bound, greedy.bound))


def _count(pairs: SeenPairs, cameras: Sequence[int], targets: int) -> NDArray[np.uint16]:
    """Return how many of the cameras see each target in each world, shape ``(worlds, targets)``."""
    counts = np.zeros((targets, pairs.worlds), dtype=np.uint16)
    for camera in cameras:
        seen, worlds = pairs.unpack(camera)
        counts[seen] += worlds
    return np.ascontiguousarray(counts.T)
