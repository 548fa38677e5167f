# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Coverage of a scene's surfaces by views, and greedy selection of views."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.core.arrays import as_numpy, as_points, check_length, empty
from warpvis.core.checks import check_whole, is_whole
from warpvis.core.labels import Label, Visibility
from warpvis.core.poses import Convention, QuaternionOrder, parse_poses, to_xyzw
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, PoseLike
from warpvis.errors import ArrayError, PoseError, SceneError
from warpvis.planning._free_space import one_world
from warpvis.scene import Scene
from warpvis.scene.worlds import parse_worlds
from warpvis.visibility import choose_objects, point_visibility

_MAX_SAMPLES = 10**8

# Pairs of a view and a sample per batch; point_visibility needs about 20 bytes for each.
_PAIRS = 1 << 22

# The low-discrepancy sequence R2 (Roberts 2018): multiples of these two numbers modulo 1 fill the unit square evenly.
_R2 = np.array([0.7548776662466927, 0.5698402909980532])


@dataclass(frozen=True)
class Samples:
    """Points on surfaces, each of which represents a part of its object's surface area."""

    points: NDArray[np.float32] = field(repr=False)
    """Points in the world frame [m], shape ``(N, 3)``."""
    normals: NDArray[np.float32] = field(repr=False)
    """Unit normals of their triangles, along ``(b - a) x (c - a)``, shape ``(N, 3)``; NaN if unknown."""
    areas: NDArray[np.float64] = field(repr=False)
    """Area represented by each point [m^2], shape ``(N,)``."""
    objects: NDArray[np.int32] = field(repr=False)
    """Indices of their objects in the scene, shape ``(N,)``; -1 for none."""

    def __len__(self) -> int:
        return len(self.points)


def surface_samples(
    scene: Scene,
    *,
    spacing: float = 0.05,
    objects: Sequence[str | int] | None = None,
    labels: Sequence[Label | int | str] | Label | int | str | None = None,
    object_poses: ObjectPoses = None,
    quaternion: QuaternionOrder = "xyzw",
    seed: int = 0,
) -> Samples:
    """Sample points evenly and deterministically on the surfaces of objects.

    An object's number of samples is its area divided by the square of `spacing`, at least one, and each sample
    represents an equal share of its area. Triangles are chosen by systematic sampling in proportion to their areas;
    points within triangles follow the sequence R2 (Roberts 2018), which leaves smaller gaps than random points.

    Args:
        scene: The scene. Surfaces are triangles, also those of movable `warpvis.scene.solids.Solid` objects.
        spacing: Approximate spacing of the samples [m].
        objects: Names or indices of the objects to sample; all by default.
        labels: Alternatively, labels of the objects to sample, such as ``"ground"``.
        object_poses: Poses ``x y z qx qy qz qw`` of the movable objects, ``(M, 7)``; their initial poses by default.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        seed: Seed of the samples.
    """
    spacing = check_length(spacing, "spacing", zero=False)
    check_whole(seed, "seed", minimum=0)
    vertices, _ = one_world(scene, object_poses, None, quaternion)
    chosen = _choose(scene, objects, labels)
    corners = [vertices[index].astype(np.float64)[scene.objects[index].faces] for index in chosen]
    doubled = [np.cross(part[:, 1] - part[:, 0], part[:, 2] - part[:, 0]) for part in corners]
    areas = [np.linalg.norm(part, axis=1).sum() / 2 for part in doubled]
    counts = [max(1.0, np.rint(area / spacing / spacing)) for area in areas]
    if not sum(counts) <= _MAX_SAMPLES:
        raise ArrayError(
            f"spacing must give at most {_MAX_SAMPLES:g} samples, got {sum(counts):.3g} with {spacing:g} m; "
            "use a greater spacing"
        )
    parts = []
    for index, part, doubles, area, count in zip(chosen, corners, doubled, areas, map(int, counts), strict=True):
        places, faces = _spread(part, np.linalg.norm(doubles, axis=1), count, np.random.default_rng([seed, index]))
        with np.errstate(invalid="ignore"):  # triangles without an area have no normal
            unit = doubles[faces] / np.linalg.norm(doubles[faces], axis=1, keepdims=True)
        parts.append((places, unit, np.full(count, area / count), np.full(count, index)))
    points, normals, shares, owners = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Samples(points.astype(np.float32), normals.astype(np.float32), shares, owners.astype(np.int32))


@dataclass(frozen=True)
class Coverage:
    """Coverage of N samples by V views."""

    samples: Samples
    weights: NDArray[np.float64] = field(repr=False)
    """Weighted area of every sample [m^2], shape ``(N,)``: its area times its weight."""
    seen: NDArray[np.bool_] = field(repr=False)
    """Whether a view sees a sample, shape ``(V, N)``."""
    area_by_view: NDArray[np.float64] = field(repr=False)
    """Area covered by each view [m^2], shape ``(V,)``."""
    cumulative: NDArray[np.float64] = field(repr=False)
    """Area covered by views 0 to i together [m^2], shape ``(V,)``."""
    order: NDArray[np.int64]
    """Greedily chosen views, each with the largest gain over its predecessors, shape ``(count,)``."""
    gain: NDArray[np.float64]
    """Area added by each view of `order` [m^2], shape ``(count,)``."""

    @cached_property
    def total(self) -> float:
        """Weighted area of all samples [m^2]."""
        return float(self.weights.sum())

    @property
    def fraction(self) -> float:
        """Fraction of `total` that all views cover together."""
        return float(self.cumulative[-1]) / self.total

    @property
    def curve(self) -> NDArray[np.float64]:
        """Area covered by the first 1, 2, ... views of `order` together [m^2], shape ``(count,)``."""
        return np.cumsum(self.gain)

    def best(self, count: int) -> NDArray[np.int64]:
        """Return the first `count` views of `order`.

        They cover at least 1 - 1/e (63 %) of the largest area that `count` views can cover.
        """
        return self.order[: _check_count(count, len(self.order), "views of order")]

    def unseen(self) -> NDArray[np.bool_]:
        """Return whether each sample is seen by no view, shape ``(N,)``."""
        return np.logical_not(self.seen.any(axis=0))


def coverage(
    scene: Scene,
    camera: ImageCamera,
    camera_to_world: PoseLike,
    *,
    samples: Samples | ArrayInput | None = None,
    weights: ArrayInput | None = None,
    count: int | None = None,
    tolerance: float = 1e-3,
    object_poses: ObjectPoses = None,
    exclude: Excluded = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    threads: int | None = None,
) -> Coverage:
    """Compute the surface area covered by views, and choose views greedily.

    A view covers a sample if `point_visibility` returns `Visibility.VISIBLE`: the sample is in the image, in range, and
    not occluded. Surfaces are two-sided: an unoccluded floor is also visible from below.

    The views of `Coverage.order` are chosen greedily by gain, with ties resolved by lower index. They cover at least
    1 - 1/e of the area of the best choice of as many views (Nemhauser, Wolsey and Fisher 1978). Since gains never
    increase, lazy evaluation recomputes only few of them (Minoux 1978).

    Args:
        scene: The scene.
        camera: Image size, intrinsics and depth range.
        camera_to_world: V poses, as for `Renderer.render`.
        samples: Samples from `surface_samples`, or points in the world frame [m], shape ``(N, 3)``, each of area 1 m^2.
            By default, samples of all objects except those excluded in all views.
        weights: Weights of the samples, which multiply their areas, shape ``(N,)``; 1 by default.
        count: Number of views to choose; by default all are ordered.
        tolerance: Maximum distance of a visible sample behind the first surface along its ray [m]. Triangles of movable
            solids are farther than this behind the exact round surface, unless they are fine or this is greater.
        object_poses: Poses ``x y z qx qy qz qw`` of the movable objects, ``(M, 7)``; their initial poses by default.
        exclude: Excluded objects, as for `Renderer.render`.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        threads: Number of CPU threads; by default all cores available to the process.
    """
    camera_to_world = to_xyzw(camera_to_world, quaternion, "camera_to_world")
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    one_world(scene, object_poses, None)
    device = scene.device
    poses = parse_poses(camera_to_world, convention=convention, device=device)
    if not len(poses):
        raise PoseError("camera_to_world must have at least one pose, got 0")
    count = len(poses) if count is None else _check_count(count, len(poses), "views")
    worlds = parse_worlds(scene, len(poses), object_poses, None, exclude)
    hidden: wp.array | None = worlds.excluded if worlds.excluded is not None and worlds.excluded.size else None
    samples = _read_samples(scene, samples, object_poses, hidden)
    areas = samples.areas * read_weights(weights, len(samples))
    if not areas.any():
        raise ArrayError("weights and areas of samples must not all be zero")
    places = wp.array(samples.points, dtype=wp.vec3, device=device)
    seen = empty((len(poses), len(samples)), wp.uint8, name="seen", device=wp.get_device("cpu")).numpy().view(np.bool_)
    step = max(1, _PAIRS // len(samples))
    for first in range(0, len(poses), step):
        part = slice(first, min(first + step, len(poses)))
        status: wp.array = point_visibility(
            scene,
            camera,
            poses[part],
            places,
            tolerance=tolerance,
            object_poses=object_poses,
            exclude=hidden if hidden is None or len(hidden) == 1 else hidden[part],
            threads=threads,
        )
        seen[part] = status.numpy() == Visibility.VISIBLE
    union, cumulative = np.zeros(len(samples), dtype=bool), np.empty(len(poses))
    for view, row in enumerate(seen):
        union |= row
        cumulative[view] = _area(areas, union)
    single = np.array([_area(areas, row) for row in seen])
    return Coverage(samples, areas, seen, single, cumulative, *_choose_views(seen, areas, single, count))


def _area(areas: NDArray[np.float64], mask: NDArray[np.bool_]) -> float:
    """Sum areas in a fixed order, so that rounding never makes the sum of a subset greater."""
    return float((areas * mask).sum())


def _choose_views(
    seen: NDArray[np.bool_], areas: NDArray[np.float64], single: NDArray[np.float64], count: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Choose views greedily; return them with their gains. The top of the heap is chosen once its gain is current."""
    uncovered = areas.copy()
    heap = [(-area, view, 0) for view, area in enumerate(single)]
    heapq.heapify(heap)
    order: list[int] = []
    gain: list[float] = []
    while len(order) < count:
        bound, view, num_chosen = heap[0]
        if num_chosen < len(order):
            heapq.heapreplace(heap, (-_area(uncovered, seen[view]), view, len(order)))
            continue
        heapq.heappop(heap)
        uncovered[seen[view]] = 0.0
        order.append(view)
        gain.append(-bound)
    return np.array(order, dtype=np.int64), np.array(gain)


def _spread(
    corners: NDArray[np.float64], areas: NDArray[np.float64], count: int, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Sample points on triangles with the given areas (of any scale); return them with their triangle indices."""
    ends = np.cumsum(areas)
    marks = (np.arange(count) + rng.random()) / count * ends[-1]
    faces = np.minimum(np.searchsorted(ends, marks, side="right"), len(areas) - 1)
    shares = (rng.random(2) + np.arange(count)[:, None] * _R2) % 1.0
    shares = np.where(shares.sum(axis=1, keepdims=True) > 1.0, 1.0 - shares, shares)
    a, b, c = corners[faces].swapaxes(0, 1)
    return a + shares[:, :1] * (b - a) + shares[:, 1:] * (c - a), faces


def _choose(
    scene: Scene,
    objects: Sequence[str | int] | None,
    labels: Sequence[Label | int | str] | Label | int | str | None,
) -> list[int]:
    if labels is None:
        return choose_objects(scene, objects)
    if objects is not None:
        raise SceneError("objects and labels must not both be given")
    numbers = scene.label_names.numbers(labels)
    chosen = [index for index, item in enumerate(scene.objects) if item.label in numbers]
    if not chosen:
        names = ", ".join(scene.label_names.word(label) for label in sorted(numbers)) or "no label"
        raise SceneError(f"the scene has no object labeled {names}")
    return chosen


def _read_samples(
    scene: Scene, samples: Samples | ArrayInput | None, object_poses: ObjectPoses, hidden: wp.array | None
) -> Samples:
    if samples is None:
        in_view = np.arange(len(scene)) if hidden is None else np.flatnonzero((hidden.numpy() == 0).any(axis=0))
        if not len(in_view):
            raise SceneError("exclude must not contain all objects if no samples are given")
        return surface_samples(scene, objects=in_view.tolist(), object_poses=object_poses)
    return read_points(samples, "samples", scene.device)


def read_points(samples: Samples | ArrayInput, name: str, device: wp.Device) -> Samples:
    """Check samples, or points in the world frame, which become samples of area 1 m^2 without an object."""
    positions = samples.points if isinstance(samples, Samples) else samples
    points = as_points(positions, name, "N", device).numpy()
    if not len(points):
        raise ArrayError(f"{name} must be at least one, got 0")
    if isinstance(samples, Samples):
        if np.shape(samples.areas) != (len(points),):
            raise ArrayError(f"areas of {name} must have shape ({len(points)},), got {np.shape(samples.areas)}")
        return samples
    return Samples(points, np.full_like(points, np.nan), np.ones(len(points)), np.full(len(points), -1, dtype=np.int32))


def read_weights(weights: ArrayInput | None, count: int, noun: str = "sample") -> NDArray[np.float64]:
    """Check the weights of samples, or of what `noun` names, and return them; ones if None."""
    if weights is None:
        return np.ones(count)
    factors = as_numpy(weights, name="weights").astype(np.float64)
    if factors.shape != (count,):
        raise ArrayError(f"weights must have shape ({count},), one for every {noun}, got {factors.shape}")
    bad = np.flatnonzero(~(np.isfinite(factors) & (factors >= 0)))
    if len(bad):
        raise ArrayError(f"weights must be finite and not negative: {len(bad)} are not, the first at {bad[0]}")
    return factors


def _check_count(count: int, limit: int, noun: str) -> int:
    if not is_whole(count) or not 1 <= count <= limit:
        raise ArrayError(f"count must be a whole number from 1 to the {limit} {noun}, got {count!r}")
    return int(count)
