# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Camera poses by rule: around a point, in a volume, at random, along a path.

All are rows ``x y z qx qy qz qw`` [m] of the OpenCV camera frame, camera to world, and images are upright: their x axis
is level. A camera that looks straight up or down has the floor's first axis (x where z is up, z where y is up) at the
top of its image.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import FARTHEST, as_numpy, as_point, check_metres
from warpvis.core.checks import check_angle, check_whole, degrees_hint, pluralize
from warpvis.core.poses import check_up
from warpvis.core.types import Excluded
from warpvis.errors import ArrayError, PoseError
from warpvis.planning import clearance as free_distance, inside_solids, look_along, pose_grid
from warpvis.scene import Scene

Up = Literal["z", "y"]

MAX_POSES = 1 << 28
"""A generator makes at most this many: they take 15 GB."""

# Poses whose axes are computed in one go.
_AT_A_TIME = 1 << 18

# A direction is straight up or down if its level part is at most this share of it.
_STRAIGHT = 1e-9

_GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))

# Random places: a candidate is so many numbers of the generator; so many are judged in one go at least and at most; the
# search ends when one in so many is good, of so many at least.
_NUMBERS_EACH = 5
_FEWEST_CANDIDATES, _MAX_CANDIDATES = 1 << 12, 1 << 19
_RAREST, _MIN_TRIED = 10_000, 1_000_000

# How much farther than the clearance surfaces are looked for, in single precision.
_ROOM_FOR_ROUNDING = 1e-3


def orbit(
    target: ArrayLike, *, radius: float, height: float, count: int, up: Up = "z", start: float = 0.0
) -> NDArray[np.float64]:
    """Place cameras on a level circle around a point, which they look at.

    Args:
        target: The point [m], shape ``(3,)``.
        radius: Radius of the circle [m], around the vertical line through the target.
        height: Height of the cameras in the world [m], not above the target.
        count: Number of cameras, evenly spaced, counterclockwise seen from above.
        up: The world's vertical axis.
        start: Direction from the target to the first camera [rad], from the floor's first axis (x where z is up, z
            where y is up).

    Returns:
        Poses, shape ``(count, 7)``.

    Raises:
        WarpvisError: An argument is not what it has to be.
    """
    vertical, middle = check_up(up), as_point(target, "target")
    radius, height = check_metres(radius, "radius", zero=False), check_metres(height, "height", signed=True)
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
    """Place cameras spread evenly over a sphere around a point, which they look at.

    They lie on a Fibonacci lattice: each stands for the same area, on a spiral by the golden angle from the least
    elevation to the greatest (Swinbank and Purser 2006, https://doi.org/10.1256/qj.05.227). None is at a pole of a
    whole sphere.

    Args:
        target: The point [m], shape ``(3,)``.
        radius: Radius of the sphere [m].
        count: Number of cameras.
        up: The world's vertical axis.
        min_elevation: Least angle of a camera above the target's level [rad], from -pi/2; 0 for the upper half.
        max_elevation: Greatest such angle [rad], up to pi/2.

    Returns:
        Poses, shape ``(count, 7)``.

    Raises:
        WarpvisError: An argument is not what it has to be.
    """
    vertical, middle = check_up(up), as_point(target, "target")
    radius = check_metres(radius, "radius", zero=False)
    low, high = check_angle(min_elevation, "min_elevation"), check_angle(max_elevation, "max_elevation")
    if not -math.pi / 2 <= low <= high <= math.pi / 2:
        raise ArrayError(
            f"elevations need -pi/2 <= min_elevation <= max_elevation <= pi/2 radians, got {min_elevation} and "
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
        bounds: Least and greatest corner of the box [m], shape ``(2, 3)``. The grid begins at the least corner.
        step: Distance of neighbouring grid points [m].
        headings: Number of directions of every place; see `pose_grid`.
        pitch: Angle of these directions above the horizontal [rad], between -pi/2 and pi/2.
        look_at: A point [m] that all cameras look at instead, shape ``(3,)``; none is at the point itself.
        up: The world's vertical axis.

    Returns:
        Poses, shape ``(C, 7)``: place after place, x slowest and z fastest, the directions of each together.

    Raises:
        WarpvisError: An argument is not what it has to be.
    """
    low, high = _check_bounds(bounds)
    step, vertical = check_metres(step, "step", zero=False), check_up(up)
    target = None if look_at is None else as_point(look_at, "look_at")
    turns = pose_grid(np.zeros(3), radius=0, step=1, height=0, headings=headings, pitch=pitch, up=up)[:, 3:]
    with np.errstate(over="ignore"):
        counts = np.floor((high - low) / step + 1e-9) + 1
        total = counts.prod() * (len(turns) if target is None else 1)
    if not total <= MAX_POSES:
        raise ArrayError(f"a grid has at most {MAX_POSES} poses, and step {step} makes {total:.3g}; take a greater one")
    axes = [low[axis] + step * np.arange(int(counts[axis])) for axis in range(3)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    if target is not None:
        return _look_at(places[(places != target).any(axis=1)], target, vertical)
    rows = np.empty((len(places), len(turns), 7))
    rows[..., :3], rows[..., 3:] = places[:, None], turns
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
    """Place cameras at random, uniformly within a box where there is room.

    With a clearance, places are drawn again that are nearer to a surface, or inside of a closed object whose triangles
    face outwards (see `warpvis.planning.inside_solids`). Movable objects are where they were added. What is outside of
    the scene but within the box is room.

    The same seed gives the same poses: on every device, for every number of threads, and the first ones for every
    count. Places are judged on the CPU.

    Args:
        scene_or_bounds: A scene, or the least and greatest corner of the box [m], shape ``(2, 3)``.
        count: Number of cameras.
        seed: Seed of the random numbers (`numpy.random.default_rng`), from 0 up.
        bounds: Of a scene: the box; the scene's own by default.
        clearance: Least distance from all surfaces [m]; needs a scene unless it is 0. With 0, surfaces do not count.
        look: ``"level"``: horizontal, in any direction. ``"any"``: all directions alike. Or a point [m] that the
            cameras look at, shape ``(3,)``.
        up: The world's vertical axis; the scene's by default, else ``"z"``.
        exclude: Names or indices of objects that do not count for the clearance.
        threads: CPU threads to use; all cores of this process by default.

    Returns:
        Poses, shape ``(count, 7)``.

    Raises:
        PoseError: Of a million places or more, fewer than one in 10,000 had room.
        WarpvisError: An argument is not what it has to be.
    """
    scene: Scene | None = None
    if isinstance(scene_or_bounds, Scene):
        scene = scene_or_bounds
        box = scene.bounds if bounds is None else bounds
    elif bounds is not None:
        raise ArrayError("bounds= is the box of a scene; give a scene, or the bounds alone")
    else:
        box = scene_or_bounds
    low, high = _check_bounds(box)
    vertical = check_up(up if up is not None else scene.up if scene is not None else "z")
    count, seed = _check_count(count), _check_whole(seed, "seed", 0)
    clearance = check_metres(clearance, "clearance")
    target = None if isinstance(look, str) else as_point(look, "look")
    if target is None and look not in ("level", "any"):
        raise PoseError(f'look must be "level", "any" or a point of shape (3,), got {look!r}')
    if clearance and scene is None:
        raise ArrayError("clearance= is a distance from the surfaces of a scene, so give a scene")
    if exclude is not None and not clearance:
        raise ArrayError("exclude= says whose surfaces do not count for clearance=, so give a clearance")
    judge = _Room(scene.to("cpu"), clearance, exclude, threads) if scene is not None and clearance else None
    numbers = _draw(count, np.random.default_rng(seed), low, high, target, judge)
    places = low + numbers[:, :3] * (high - low)
    if target is not None:
        return _look_at(places, target, vertical)
    pitch = np.arcsin(2 * numbers[:, 4] - 1) if look == "any" else np.zeros(count)
    return poses_along(places, _directions(2 * math.pi * numbers[:, 3], pitch, vertical), vertical)


def along(
    path: ArrayLike, *, count: int, look: Literal["forward"] | ArrayLike = "forward", up: Up = "z"
) -> NDArray[np.float64]:
    """Place cameras along a path of straight pieces, evenly spaced by its length, from its first point to its last.

    Args:
        path: The points [m], shape ``(n, 3)``; equal neighbors count as one.
        count: Number of cameras; one alone is at the first point.
        look: ``"forward"``: along the piece that the camera is on, at a corner along the one that begins there. Or a
            point [m] that the cameras look at, shape ``(3,)``.
        up: The world's vertical axis.

    Returns:
        Poses, shape ``(count, 7)``.

    Raises:
        WarpvisError: An argument is not what it has to be, the path has no length, or a camera is at the point that it
            looks at.
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
        raise ArrayError(f"path must have a length, and all its points ({len(points)}) are one")
    begins, steps, lengths = points[:-1][moving], steps[moving], lengths[moving]
    at = np.concatenate([[0], np.cumsum(lengths)])
    ways = np.linspace(0, at[-1], count)
    piece = np.clip(np.searchsorted(at, ways, side="right") - 1, 0, len(steps) - 1)
    places = begins[piece] + ((ways - at[piece]) / lengths[piece])[:, None] * steps[piece]
    return poses_along(places, steps[piece], vertical) if target is None else _look_at(places, target, vertical)


class _Room:
    """Whether places have room in a scene."""

    def __init__(self, scene: Scene, clearance: float, exclude: Excluded, threads: int | None) -> None:
        self.scene, self.clearance = scene, clearance
        self.options = {"exclude": exclude, "threads": threads}

    def __call__(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        reach = self.clearance * (1 + _ROOM_FOR_ROUNDING)
        room = free_distance(self.scene, places, max_distance=reach, **self.options).numpy() >= self.clearance
        if room.any():
            room[room] = ~inside_solids(self.scene, places[room], **self.options)
        return room


def _draw(
    count: int,
    generator: np.random.Generator,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    target: NDArray[np.float64] | None,
    judge: _Room | None,
) -> NDArray[np.float64]:
    """Draw the random numbers of the first candidates that are good, ``(count, 5)``.

    Every candidate takes as many numbers, whatever they are used for, so it does not matter how many are drawn at once.
    """
    good: list[NDArray[np.float64]] = []
    have, tried, size = 0, 0, count + count // 8
    while have < count:
        size = min(max(size, _FEWEST_CANDIDATES), _MAX_CANDIDATES)
        numbers = generator.random((size, _NUMBERS_EACH))
        places = low + numbers[:, :3] * (high - low)
        fine = np.ones(size, dtype=bool) if target is None else (places != target).any(axis=1)
        if judge is not None:
            fine &= judge(places)
        good.append(numbers[fine])
        have, tried = have + len(good[-1]), tried + size
        if have < count and tried >= _MIN_TRIED and have * _RAREST < tried:
            what = "are elsewhere than the point to look at"
            if judge is not None:
                what = f"are {judge.clearance} m from all surfaces and not inside of closed objects"
            box = " to ".join(" ".join(f"{value:g}" for value in corner) for corner in (low, high))
            raise PoseError(
                f"there is no room for {pluralize(count, 'camera')} from {box}: of {tried} random places, {have} {what}"
            )
        size = math.ceil((count - have) * tried / max(have, 1))
    return np.concatenate(good)[:count]


def _directions(headings: NDArray[np.float64], pitches: NDArray[np.float64], vertical: int) -> NDArray[np.float64]:
    """Make unit vectors of angles from the floor's first axis, and above the floor [rad], shape ``(n, 3)``."""
    directions = np.empty((len(headings), 3))
    directions[:, (vertical + 1) % 3] = np.cos(headings) * np.cos(pitches)
    directions[:, (vertical + 2) % 3] = np.sin(headings) * np.cos(pitches)
    directions[:, vertical] = np.sin(pitches)
    return directions


def _look_at(places: NDArray[np.float64], target: NDArray[np.float64], vertical: int) -> NDArray[np.float64]:
    at = np.flatnonzero((places == target).all(axis=1))
    if len(at):
        raise PoseError(
            f"a camera cannot look at where it is: {len(at)} are at {target.tolist()}, the first is {at[0]}"
        )
    return poses_along(places, target - places, vertical)


def poses_along(places: NDArray[np.float64], forward: NDArray[np.float64], vertical: int) -> NDArray[np.float64]:
    """Make poses that look along directions of any length but 0; see the module for straight up and down."""
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
        raise ArrayError(f"bounds must be a box's least and greatest corner of shape (2, 3), got {corners.tolist()}")
    return corners


def _check_count(count: int) -> int:
    if _check_whole(count, "count", 1) > MAX_POSES:
        raise ArrayError(f"count must be at most {MAX_POSES}, got {count}")
    return int(count)


def _check_whole(value: object, name: str, least: int) -> int:
    return check_whole(value, name, least=least)
