# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The generators of camera poses; the package's docstring defines their conventions."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import FARTHEST, as_numpy, as_point, check_length
from warpvis.core.checks import check_angle, check_whole, degrees_hint, pluralize
from warpvis.core.poses import check_up
from warpvis.core.types import Excluded
from warpvis.errors import ArrayError, PoseError
from warpvis.planning import clearance as free_distance, inside_solids, look_along, pose_grid
from warpvis.scene import Scene

Up = Literal["z", "y"]

MAX_POSES = 1 << 28
"""Maximum number of poses of a generator; they take 15 GB."""

# Number of poses per batch.
_AT_A_TIME = 1 << 18

# A direction is vertical if the ratio of its horizontal to its vertical part is at most this.
_STRAIGHT = 1e-9

_GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))

# Random positions: numbers of the random generator per candidate; minimum and maximum number of candidates per batch;
# the search fails if fewer than one in `_RAREST` candidates, of at least `_MIN_TRIED`, are valid.
_NUMBERS_EACH = 5
_FEWEST_CANDIDATES, _MAX_CANDIDATES = 1 << 12, 1 << 19
_RAREST, _MIN_TRIED = 10_000, 1_000_000

# Relative margin of the single-precision search for surfaces beyond the clearance.
_ROOM_FOR_ROUNDING = 1e-3


def orbit(
    target: ArrayLike, *, radius: float, height: float, count: int, up: Up = "z", start: float = 0.0
) -> NDArray[np.float64]:
    """Place cameras on a horizontal circle around a point that they look at.

    Args:
        target: The point [m], shape ``(3,)``.
        radius: Radius of the circle [m] around the vertical line through the target.
        height: Height of the cameras in the world [m], not relative to the target.
        count: Number of cameras, evenly spaced, counterclockwise as seen from above.
        up: The world's vertical axis.
        start: Azimuth of the first camera as seen from the target [rad], from the floor's first axis (x where z is up,
            z where y is up).

    Returns:
        Poses, shape ``(count, 7)``.
    """
    vertical, middle = check_up(up), as_point(target, "target")
    radius, height = check_length(radius, "radius", zero=False), check_length(height, "height", signed=True)
    angles: NDArray[np.float64] = np.arange(_check_count(count), dtype=np.float64) * (2 * math.pi / count)
    angles += check_angle(start, "start")
    places = middle + radius * _directions(angles, np.zeros(len(angles)), vertical)
    places[:, vertical] = height
    return _look_at(places, middle, vertical)


def sphere(
    target: ArrayLike,
    *,
    radius: float,
    count: int,
    up: Up = "z",
    min_elevation: float = -math.pi / 2,
    max_elevation: float = math.pi / 2,
) -> NDArray[np.float64]:
    """Place cameras evenly on a sphere around a point that they look at.

    Positions form a Fibonacci lattice: each represents the same area, on a golden-angle spiral from the lowest to the
    highest elevation (Swinbank and Purser 2006, https://doi.org/10.1256/qj.05.227). No camera is at a pole of a whole
    sphere.

    Args:
        target: The point [m], shape ``(3,)``.
        radius: Radius of the sphere [m].
        count: Number of cameras.
        up: The world's vertical axis.
        min_elevation: Minimum elevation of a camera as seen from the target [rad], at least -pi/2; 0 for the upper
            half.
        max_elevation: Maximum elevation [rad], at most pi/2.

    Returns:
        Poses, shape ``(count, 7)``.
    """
    vertical, middle = check_up(up), as_point(target, "target")
    radius = check_length(radius, "radius", zero=False)
    low, high = check_angle(min_elevation, "min_elevation"), check_angle(max_elevation, "max_elevation")
    if not -math.pi / 2 <= low <= high <= math.pi / 2:
        raise ArrayError(
            f"elevations must satisfy -pi/2 <= min_elevation <= max_elevation <= pi/2 radians, got {min_elevation} and "
            f"{max_elevation}{degrees_hint(max(low, high, key=abs))}"
        )
    index = np.arange(_check_count(count), dtype=np.float64)
    sines = math.sin(low) + (math.sin(high) - math.sin(low)) * (index + 0.5) / count
    outwards = _directions(index * _GOLDEN_ANGLE, np.arcsin(np.clip(sines, -1, 1)), vertical)
    return _look_at(middle + radius * outwards, middle, vertical)


def grid(
    bounds: ArrayLike,
    *,
    step: float,
    headings: int = 8,
    pitch: float = 0.0,
    look_at: ArrayLike | None = None,
    up: Up = "z",
) -> NDArray[np.float64]:
    """Place cameras on a cubic grid in a box.

    Args:
        bounds: Lower and upper corner of the box [m], shape ``(2, 3)``. The grid begins at the lower corner.
        step: Spacing of the grid [m].
        headings: Number of directions at every grid point; see `pose_grid`.
        pitch: Angle of these directions above the horizontal [rad], between -pi/2 and pi/2.
        look_at: Alternatively, a point [m] that all cameras look at, shape ``(3,)``; a grid point there is skipped.
        up: The world's vertical axis.

    Returns:
        Poses, shape ``(C, 7)``, ordered by grid point, with x slowest and z fastest, and then by direction.
    """
    low, high = _check_bounds(bounds)
    step, vertical = check_length(step, "step", zero=False), check_up(up)
    target = None if look_at is None else as_point(look_at, "look_at")
    rotations = pose_grid(np.zeros(3), radius=0, step=1, height=0, headings=headings, pitch=pitch, up=up)[:, 3:]
    with np.errstate(over="ignore"):
        counts = np.floor((high - low) / step + 1e-9) + 1
        total = counts.prod() * (len(rotations) if target is None else 1)
    if not total <= MAX_POSES:
        raise ArrayError(
            f"a grid must have at most {MAX_POSES} poses, got {total:.3g}; use a step greater than {step} m"
        )
    axes = [low[axis] + step * np.arange(int(counts[axis])) for axis in range(3)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    if target is not None:
        return _look_at(places[(places != target).any(axis=1)], target, vertical)
    rows = np.empty((len(places), len(rotations), 7))
    rows[..., :3], rows[..., 3:] = places[:, None], rotations
    return rows.reshape(-1, 7)


def random_poses(
    scene_or_bounds: Scene | ArrayLike,
    *,
    count: int,
    seed: int,
    bounds: ArrayLike | None = None,
    clearance: float = 0.0,
    look: Literal["level", "any"] | ArrayLike = "level",
    up: Up | None = None,
    exclude: Excluded = None,
    threads: int | None = None,
) -> NDArray[np.float64]:
    """Place cameras at uniformly random positions in the free space of a box.

    With a clearance, positions nearer to a surface, or inside a closed object whose triangles face outward (see
    `warpvis.planning.inside_solids`), are rejected and sampled again. Movable objects are at their initial poses. Space
    within the box but outside the scene is free.

    Poses depend only on the seed, not on the device or the number of threads; a smaller `count` gives the first of the
    same poses. Positions are checked on the CPU.

    Args:
        scene_or_bounds: A scene, or the lower and upper corner of the box [m], shape ``(2, 3)``.
        count: Number of cameras.
        seed: Seed of the random numbers (`numpy.random.default_rng`), at least 0.
        bounds: With a scene, the box; the scene's bounds by default.
        clearance: Minimum distance from all surfaces [m], which requires a scene. With 0, surfaces are ignored.
        look: ``"level"`` for horizontal directions, ``"any"`` for uniformly random directions, or a point [m] that the
            cameras look at, shape ``(3,)``.
        up: The world's vertical axis; the scene's by default, else ``"z"``.
        exclude: Names or indices of objects that are ignored for the clearance.
        threads: Number of CPU threads; by default all cores available to the process.

    Returns:
        Poses, shape ``(count, 7)``.

    Raises:
        PoseError: If fewer than one in 10,000 of at least a million positions are free.
    """
    scene: Scene | None = None
    if isinstance(scene_or_bounds, Scene):
        scene = scene_or_bounds
        box = scene.bounds if bounds is None else bounds
    elif bounds is not None:
        raise ArrayError("bounds= must be given with a scene; pass the bounds as the first argument otherwise")
    else:
        box = scene_or_bounds
    low, high = _check_bounds(box)
    vertical = check_up(up if up is not None else scene.up if scene is not None else "z")
    count, seed = _check_count(count), check_whole(seed, "seed", minimum=0)
    clearance = check_length(clearance, "clearance")
    target = None if isinstance(look, str) else as_point(look, "look")
    if target is None and look not in ("level", "any"):
        raise PoseError(f'look must be "level", "any" or a point of shape (3,), got {look!r}')
    if clearance and scene is None:
        raise ArrayError("clearance= requires a scene, since it is a distance from its surfaces")
    if exclude is not None and not clearance:
        raise ArrayError("exclude= requires clearance=, from which it excludes surfaces")
    is_free = (
        partial(_is_free, scene.to("cpu"), clearance, exclude, threads) if scene is not None and clearance else None
    )
    numbers = _sample(count, np.random.default_rng(seed), low, high, target, is_free, clearance)
    places = low + numbers[:, :3] * (high - low)
    if target is not None:
        return _look_at(places, target, vertical)
    pitch = np.arcsin(2 * numbers[:, 4] - 1) if look == "any" else np.zeros(count)
    return poses_along(places, _directions(2 * math.pi * numbers[:, 3], pitch, vertical), vertical)


def along(
    path: ArrayLike, *, count: int, look: Literal["forward"] | ArrayLike = "forward", up: Up = "z"
) -> NDArray[np.float64]:
    """Place cameras along a polyline, evenly spaced by arc length from its first to its last point.

    Args:
        path: The points [m], shape ``(n, 3)``; consecutive duplicates are merged.
        count: Number of cameras; a single one is at the first point.
        look: ``"forward"`` for the direction of the segment (at a vertex, of the next segment), or a point [m] that the
            cameras look at, shape ``(3,)``.
        up: The world's vertical axis.

    Returns:
        Poses, shape ``(count, 7)``.

    Raises:
        WarpvisError: If the path has zero length, or a camera is at the point that it looks at.
    """
    vertical, count = check_up(up), _check_count(count)
    points = as_numpy(path, name="path").astype(np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2 or not (np.abs(points) <= FARTHEST).all():
        raise ArrayError(f"path must be two or more finite points of shape (n, 3), got shape {points.shape}")
    target = None if isinstance(look, str) else as_point(look, "look")
    if target is None and look != "forward":
        raise PoseError(f'look must be "forward" or a point of shape (3,), got {look!r}')
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    moving = lengths > 0
    if not moving.any():
        raise ArrayError(f"path must have a positive length, got {len(points)} equal points")
    begins, steps, lengths = points[:-1][moving], steps[moving], lengths[moving]
    starts = np.concatenate([[0], np.cumsum(lengths)])
    arcs = np.linspace(0, starts[-1], count)
    segment = np.clip(np.searchsorted(starts, arcs, side="right") - 1, 0, len(steps) - 1)
    places = begins[segment] + ((arcs - starts[segment]) / lengths[segment])[:, None] * steps[segment]
    return poses_along(places, steps[segment], vertical) if target is None else _look_at(places, target, vertical)


def _is_free(
    scene: Scene, clearance: float, exclude: Excluded, threads: int | None, places: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return whether positions have a clearance from all surfaces and are outside of closed objects."""
    reach = clearance * (1 + _ROOM_FOR_ROUNDING)
    distance = free_distance(scene, places, max_distance=reach, exclude=exclude, threads=threads)
    free = distance.numpy() >= clearance
    if free.any():
        free[free] = ~inside_solids(scene, places[free], exclude=exclude, threads=threads)
    return free


def _sample(
    count: int,
    generator: np.random.Generator,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    target: NDArray[np.float64] | None,
    is_free: Callable[[NDArray[np.float64]], NDArray[np.bool_]] | None,
    clearance: float,
) -> NDArray[np.float64]:
    """Sample the random numbers of the first valid candidates, ``(count, 5)``.

    Every candidate consumes the same number of random numbers, so results do not depend on the batch size.
    """
    accepted: list[NDArray[np.float64]] = []
    num_accepted, tried, size = 0, 0, count + count // 8
    while num_accepted < count:
        size = min(max(size, _FEWEST_CANDIDATES), _MAX_CANDIDATES)
        numbers = generator.random((size, _NUMBERS_EACH))
        places = low + numbers[:, :3] * (high - low)
        valid = np.ones(size, dtype=bool) if target is None else (places != target).any(axis=1)
        if is_free is not None:
            valid &= is_free(places)
        accepted.append(numbers[valid])
        num_accepted, tried = num_accepted + len(accepted[-1]), tried + size
        if num_accepted < count and tried >= _MIN_TRIED and num_accepted * _RAREST < tried:
            condition = "differ from the point to look at"
            if is_free is not None:
                condition = f"are {clearance} m from all surfaces and not inside closed objects"
            box = " to ".join(" ".join(f"{value:g}" for value in corner) for corner in (low, high))
            raise PoseError(
                f"bounds {box} must have room for {pluralize(count, 'camera')}: "
                f"only {num_accepted} of {tried} random positions {condition}"
            )
        size = math.ceil((count - num_accepted) * tried / max(num_accepted, 1))
    return np.concatenate(accepted)[:count]


def _directions(headings: NDArray[np.float64], pitches: NDArray[np.float64], vertical: int) -> NDArray[np.float64]:
    """Compute unit vectors, shape ``(n, 3)``, from azimuths (from the floor's first axis) and elevations [rad]."""
    directions = np.empty((len(headings), 3))
    directions[:, (vertical + 1) % 3] = np.cos(headings) * np.cos(pitches)
    directions[:, (vertical + 2) % 3] = np.sin(headings) * np.cos(pitches)
    directions[:, vertical] = np.sin(pitches)
    return directions


def _look_at(places: NDArray[np.float64], target: NDArray[np.float64], vertical: int) -> NDArray[np.float64]:
    equal = np.flatnonzero((places == target).all(axis=1))
    if len(equal):
        raise PoseError(
            f"cameras must not be at the point that they look at, {target.tolist()}, got {len(equal)} there, "
            f"the first is {equal[0]}"
        )
    return poses_along(places, target - places, vertical)


def poses_along(places: NDArray[np.float64], forward: NDArray[np.float64], vertical: int) -> NDArray[np.float64]:
    """Build poses along directions of any nonzero length; see the package for vertical directions."""
    first, second = (vertical + 1) % 3, (vertical + 2) % 3
    rows = np.empty((len(places), 7))
    for start in range(0, len(places), _AT_A_TIME):
        part = slice(start, start + _AT_A_TIME)
        ahead = forward[part] / np.abs(forward[part]).max(axis=1, keepdims=True)
        straight = np.hypot(ahead[:, first], ahead[:, second]) <= _STRAIGHT * np.abs(ahead[:, vertical])
        for chosen, top in ((~straight, vertical), (straight, first)):
            if chosen.any():
                rows[part][chosen] = look_along(places[part][chosen], ahead[chosen], top)
    return rows


def _check_bounds(bounds: ArrayLike) -> NDArray[np.float64]:
    corners = as_numpy(bounds, name="bounds").astype(np.float64)
    if corners.shape != (2, 3) or not ((np.abs(corners) <= FARTHEST).all() and (corners[0] <= corners[1]).all()):
        raise ArrayError(f"bounds must be the lower and upper corner of a box, shape (2, 3), got {corners.tolist()}")
    return corners


def _check_count(count: int) -> int:
    if check_whole(count, "count") > MAX_POSES:
        raise ArrayError(f"count must be at most {MAX_POSES}, got {count}")
    return int(count)
