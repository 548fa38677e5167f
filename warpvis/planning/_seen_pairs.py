# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visibility of many targets from many cameras in many worlds, as bits of the pairs that the static scene lets through.

A camera sees a target in a world if neither the static objects nor the moving ones hide it. Static objects are the same
in all worlds, so `point_visibility` judges them once; only the remaining pairs are cast at the moving objects.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.core.arrays import empty
from warpvis.core.labels import Visibility
from warpvis.core.poses import poses_to_matrices
from warpvis.core.threads import launch_points
from warpvis.core.types import Excluded, ObjectPoses
from warpvis.errors import ArrayError
from warpvis.maps import OccupancyMap
from warpvis.scene import Scene
from warpvis.scene.acceleration.traversal_plan import plan_traversal
from warpvis.scene.worlds import parse_worlds, pose_columns
from warpvis.visibility import MeasuredSpace, point_visibility

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds

# Pairs of a camera and a target per batch; point_visibility needs about 20 bytes for each.
_PAIRS = 1 << 22

# Padding of boxes, relative to the largest coordinate; exceeds the rounding of lines to single precision.
_BOX_SLACK = 1e-6

# Worlds per word of `SeenPairs.words`.
_WORD = 64


@dataclass(frozen=True, eq=False)
class SeenPairs:
    """Pairs of a camera and a target that it sees in at least one of T worlds, ordered by camera."""

    starts: NDArray[np.int64]
    """Index of the first pair of each of V cameras, and the number of pairs, shape ``(V + 1,)``."""
    targets: NDArray[np.int32] = field(repr=False)
    """Target of each pair, shape ``(pairs,)``."""
    words: NDArray[np.uint64] = field(repr=False)
    """Worlds in which the camera sees the target, shape ``(pairs, words)``: bit b of word w is world 64 w + b."""
    worlds: int
    """Number of worlds."""

    def of(self, camera: int) -> tuple[NDArray[np.int32], NDArray[np.uint64]]:
        """Return the targets and words of a camera."""
        part = slice(self.starts[camera], self.starts[camera + 1])
        return self.targets[part], self.words[part]

    def unpack(self, camera: int) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
        """Return the targets of a camera, and 1 for each world in which it sees them, shape ``(targets, worlds)``."""
        targets, words = self.of(camera)
        octets = words.astype("<u8", copy=False).view(np.uint8)
        return targets, np.unpackbits(octets, axis=1, count=self.worlds, bitorder="little")


def full_words(worlds: int) -> NDArray[np.uint64]:
    """Return one row of `SeenPairs.words` with the bits of all worlds."""
    bits = np.arange(-(-worlds // _WORD) * _WORD) < worlds
    return np.packbits(bits, bitorder="little").view("<u8").astype(np.uint64)


def find_seen_pairs(
    scene: Scene | OccupancyMap,
    camera: ImageCamera,
    poses: wp.array,
    points: wp.array,
    *,
    tolerance: float,
    occupancy: OccupancyMap | MeasuredSpace | None,
    object_poses: ObjectPoses,
    exclude: Excluded,
    threads: int | None,
) -> SeenPairs:
    """Return which cameras see which targets in which worlds.

    Args:
        scene: The scene, or a map of measured space instead of it.
        camera: Image size, intrinsics and depth range.
        poses: Poses of the cameras on the scene's device, shape ``(V,)`` transform.
        points: Targets on the scene's device [m], shape ``(N,)`` vec3.
        tolerance: As for `point_visibility`, and so is `occupancy`.
        occupancy: A map of measured space that may hide targets, too.
        object_poses: Poses of the movable objects in T worlds, ``(T, M, 7)``.
        exclude: Names or indices of objects that no camera sees, or flags, shape ``(1, objects)``.
        threads: Number of CPU threads.
    """
    if isinstance(scene, OccupancyMap):
        if object_poses is not None or exclude is not None:
            raise ArrayError("scene must be a warpvis.Scene for object_poses and exclude, got an OccupancyMap")
        return _judge_static(scene, camera, poses, points, 1, tolerance, {"occupancy": occupancy, "threads": threads})
    worlds = parse_worlds(scene, 1, object_poses, np.zeros(1, dtype=np.int32), exclude)
    rows = worlds.object_poses.numpy().reshape(*worlds.object_poses.shape, 7)
    hidden = np.zeros((1, len(scene)), dtype=np.uint8)
    if worlds.excluded is not None and worlds.excluded.size:
        hidden[0] = worlds.excluded.numpy()[0]
    moving = np.flatnonzero((rows != rows[:1]).any(axis=(0, 2)))
    static_flags = hidden | np.isin(pose_columns(scene), moving)
    options = {
        "occupancy": occupancy,
        "object_poses": worlds.object_poses[:1] if scene.movable else None,
        "exclude": wp.array(static_flags, dtype=wp.uint8, device=scene.device) if static_flags.any() else None,
        "threads": threads,
    }
    pairs = _judge_static(scene, camera, poses, points, len(rows), tolerance, options)
    if len(moving) and len(pairs.targets):
        worlds.world = None
        if not hidden.any():
            worlds.excluded = None
        _clear_hidden(scene, poses, points, pairs, worlds, moving, rows, tolerance, threads)
    return pairs


def _judge_static(
    scene: Scene | OccupancyMap,
    camera: ImageCamera,
    poses: wp.array,
    points: wp.array,
    worlds: int,
    tolerance: float,
    options: dict[str, object],
) -> SeenPairs:
    """Return the pairs that the static objects let through, with the bits of all worlds."""
    counts, targets = np.zeros(len(poses) + 1, dtype=np.int64), []
    step = max(1, _PAIRS // len(points))
    for first in range(0, len(poses), step):
        part = slice(first, min(first + step, len(poses)))
        status = point_visibility(scene, camera, poses[part], points, tolerance=tolerance, **options)  # type: ignore[arg-type]
        assert isinstance(status, wp.array)
        seen = status.numpy() == Visibility.VISIBLE
        counts[first + 1 : part.stop + 1] = seen.sum(axis=1)
        targets.append((np.flatnonzero(seen) % len(points)).astype(np.int32))
    total = int(counts.sum())
    full = full_words(worlds)
    words = empty((total, len(full)), wp.uint64, name="visibility", device=wp.get_device("cpu")).numpy()
    words[:] = full
    return SeenPairs(np.cumsum(counts), np.concatenate(targets), words, worlds)


def _clear_hidden(
    scene: Scene,
    poses: wp.array,
    points: wp.array,
    pairs: SeenPairs,
    worlds: Worlds,
    moving: NDArray[np.intp],
    rows: NDArray[np.float32],
    tolerance: float,
    threads: int | None,
) -> None:
    """Clear the bits of the worlds in which moving objects hide a target."""
    from warpvis.kernels.visibility.moving_occluders import MovingOccluders, clear_hidden_worlds

    device = scene.device
    lows, highs = _boxes(scene, moving, rows, max(_largest(points), _largest(poses)))
    tree = wp.Bvh(
        wp.array(lows, dtype=wp.vec3, device=device),
        wp.array(highs, dtype=wp.vec3, device=device),
        constructor="sah" if device.is_cpu else None,
    )
    occluders = MovingOccluders()
    occluders.tree = tree.id
    occluders.movable = wp.array(moving, dtype=wp.int32, device=device)
    lines, line_of = _distinct_lines(poses, pairs, len(points))
    words = pairs.words if line_of is None else np.repeat(full_words(pairs.worlds)[None], len(lines), axis=0)
    halves = words.view(np.uint32)
    indices = wp.array(lines, dtype=wp.int32, device=device)
    seen = wp.array(halves, dtype=wp.uint32, device=device, copy=False)
    triangles, outputs = scene.triangles().struct, [points, indices, tolerance, seen]
    launch_points(
        clear_hidden_worlds,
        (1, len(indices)),
        lambda window: [triangles, worlds, occluders, poses, window, *outputs],
        device=device,
        threads=threads,
    )
    if not device.is_cpu:
        halves[:] = seen.numpy()
    if line_of is not None:
        np.take(words, line_of, axis=0, out=pairs.words)


def _distinct_lines(
    poses: wp.array, pairs: SeenPairs, targets: int
) -> tuple[NDArray[np.int64], NDArray[np.int64] | None]:
    """Return a camera and a target for each distinct line of sight, and the line of each pair; None if all differ.

    Cameras at one place that look in several directions share their lines.
    """
    places, first, place_of = np.unique(poses.numpy()[:, :3], axis=0, return_index=True, return_inverse=True)
    counts = np.diff(pairs.starts)
    if len(places) == len(counts):
        return np.stack([np.repeat(np.arange(len(counts)), counts), pairs.targets], axis=1), None
    lines, line_of = np.unique(np.repeat(place_of.ravel() * targets, counts) + pairs.targets, return_inverse=True)
    return np.stack([first[lines // targets], lines % targets], axis=1), line_of.ravel()


def _boxes(
    scene: Scene, moving: NDArray[np.intp], rows: NDArray[np.float32], reach: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the corners of the world boxes of moving objects in all worlds, ``(worlds * moving, 3)`` each."""
    boxes = plan_traversal(scene.require_objects(), scene.device).boxes()[moving].astype(np.float64)
    middles, halves = boxes.mean(axis=1), (boxes[:, 1] - boxes[:, 0]) / 2
    matrices = poses_to_matrices(rows[:, moving].reshape(-1, 7).astype(np.float64))
    rotations = matrices[:, :3, :3].reshape(len(rows), len(moving), 3, 3)
    centers = np.einsum("tmij,mj->tmi", rotations, middles).reshape(-1, 3) + matrices[:, :3, 3]
    extents = np.einsum("tmij,mj->tmi", np.abs(rotations), halves).reshape(-1, 3)
    slack = _BOX_SLACK * (reach + np.abs(centers).max(initial=0) + extents.max(initial=0))
    return (centers - extents - slack).astype(np.float32), (centers + extents + slack).astype(np.float32)


def _largest(places: wp.array) -> float:
    """Return the largest absolute coordinate of points or poses [m]."""
    return float(np.abs(places.numpy().reshape(len(places), -1)[:, :3]).max(initial=0.0))
