# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Postures: what a body does, which is solved for its size and place."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import check_angle, check_choice
from warpvis.errors import PoseError, WarpvisError
from warpvis.situations.people._body import SIDES, Body
from warpvis.situations.people._goals import look, point_arm, reach
from warpvis.situations.people._skeleton import Angles, check_angles
from warpvis.situations.people._solids import lowest_points
from warpvis.situations.people._state import State

Hand = Literal["right", "left", "nearest"]
"""A hand; the nearest one is on the side of the target."""

_MAX_SEATED_FLEXION, _MIN_SEATED_FLEXION = math.radians(115), math.radians(20)
_MAX_SHANK_LEAN = math.radians(50)
_SPREAD = math.radians(6)
_TUCK = math.radians(19)

# Walking: percent of the gait cycle, from the initial contact of a foot, and angles of its leg [degrees] at the ends of
# the phases (Perry and Burnfield, Gait Analysis, 2010): initial contact, loading response, mid stance, terminal stance,
# pre-swing, initial, mid and terminal swing.
_GAIT_PERCENT = (0, 12, 31, 50, 62, 75, 87)
_GAIT = {
    "hip_flexion": (20, 20, 0, -20, -10, 15, 25),
    "knee_flexion": (5, 15, 5, 5, 40, 60, 25),
    "ankle_flexion": (0, -5, 5, 10, -15, -5, 0),
}


@dataclass(frozen=True, eq=False)
class Posture:
    """What a body does; made by `standing`, `sitting`, `reaching` and other functions."""

    kind: str
    """Its name: ``"standing"``, ``"sitting"``, ..."""
    base: Posture | None = None
    """The posture that it changes, such as that of the legs while reaching; None for a posture of the whole body."""
    values: Mapping[str, NDArray[np.float64]] = field(default_factory=dict, repr=False)
    """Numbers and points, each one for all W worlds or one per world."""
    hand: Hand = "right"
    """Hand that reaches or points."""

    @property
    def worlds(self) -> int:
        """Number of worlds that it is for; 1 if it is the same in all."""
        sizes = {len(value) for name, value in self.values.items() if value.ndim > (name in _VECTORS)}
        sizes |= set() if self.base is None else {self.base.worlds}
        return max(sizes, default=1)

    def apply(self, state: State) -> None:
        """Set the joint angles of a body, and the place of its pelvis."""
        if self.base is not None:
            self.base.apply(state)
        _APPLY[self.kind](self, state)

    def rotated(self, rotation: NDArray[np.float64]) -> Posture:
        """Return the posture with its points and directions rotated, to another vertical axis."""
        values = {name: rows @ rotation.T if name in _VECTORS else rows for name, rows in self.values.items()}
        return replace(self, values=values, base=None if self.base is None else self.base.rotated(rotation))

    def value(self, name: str, worlds: int) -> NDArray[np.float64]:
        """Return a value for each world, shape ``(W,)`` or ``(W, 3)``."""
        rows = self.values[name]
        return np.broadcast_to(rows, (worlds, 3) if name in _VECTORS else (worlds,))


_VECTORS = ("point", "direction")


def standing() -> Posture:
    """Return an upright posture with hanging arms."""
    return Posture("standing")


def sitting(seat_height: ArrayLike = 0.45, *, recline: float = 0.0, table_height: ArrayLike | None = None) -> Posture:
    """Return a posture on a seat, with the feet on the floor and the hands on the thighs or a table.

    The place of the person is that of the hip joints.

    Args:
        seat_height: Height of the seat above the floor [m], one or one for each world.
        recline: Angle by which the trunk leans back [rad], from 0 to 0.6.
        table_height: Height of a table in front of the person, on which the hands lie [m].
    """
    values = {"seat_height": _numbers(seat_height, "seat_height", "m")}
    values["recline"] = np.array(check_angle(recline, "recline", minimum=0.0, maximum=0.6, error=PoseError))
    if table_height is not None:
        values["table_height"] = _numbers(table_height, "table_height", "m")
    return Posture("sitting", values=values)


def crouching(depth: ArrayLike = 0.8) -> Posture:
    """Return a posture on bent legs.

    Args:
        depth: How low, one or one for each world: from 0 for standing to 1 for knees bent by 120 degrees.
    """
    depths = _numbers(depth, "depth", "", hint_percent=True)
    if ((depths < 0) | (depths > 1)).any():
        raise PoseError(f"depth must be from 0 to 1, got {depths.min():g} to {depths.max():g}")
    return Posture("crouching", values={"depth": depths})


def walking(phase: ArrayLike = 0.0) -> Posture:
    """Return a moment of walking.

    Args:
        phase: Fraction of the gait cycle, one or one for each world, from 0, where the left heel meets the floor,
            over 0.5, where the right one does, to 1.
    """
    phases = _numbers(phase, "phase", "", hint_percent=True)
    if ((phases < 0) | (phases > 1)).any():
        raise PoseError(f"phase must be from 0 to 1, got {phases.min():g} to {phases.max():g}")
    return Posture("walking", values={"phase": phases})


def posed(angles: Mapping[str, ArrayLike], base: Posture | None = None) -> Posture:
    """Return a posture with given joint angles.

    Args:
        angles: Angles by name [rad], such as ``{"elbow_flexion_left": 1.2}``, each one or one for each world;
            `warpvis.situations.JOINT_LIMITS` lists them.
        base: Posture that defines the others; standing by default.
    """
    if not isinstance(angles, Mapping):
        raise PoseError(f"angles must be a mapping of names of joints to radians, got {angles!r}")
    return Posture("posed", _base(base), check_angles(angles))


def reaching(point: ArrayLike, base: Posture | None = None, *, hand: Hand = "right") -> Posture:
    """Return a posture with the center of a hand's grip at a point; the trunk leans if the arm is too short.

    Args:
        point: Point in the world [m], shape ``(3,)``, or one for each world, ``(W, 3)``.
        base: Posture of the rest of the body; standing by default.
        hand: The hand that reaches.
    """
    check_choice(hand, "hand", ("right", "left", "nearest"), PoseError)
    return Posture("reaching", _base(base), {"point": _points(point, "point")}, hand)


def pointing(
    point: ArrayLike | None = None,
    base: Posture | None = None,
    *,
    direction: ArrayLike | None = None,
    hand: Hand = "right",
) -> Posture:
    """Return a posture with a straight arm along the line from its shoulder to a point, or along a direction.

    Args:
        point: Point in the world [m], shape ``(3,)`` or ``(W, 3)``.
        base: Posture of the rest of the body; standing by default.
        direction: Direction in the world, instead of a point.
        hand: The hand that points.
    """
    check_choice(hand, "hand", ("right", "left", "nearest"), PoseError)
    if (point is None) == (direction is None):
        raise PoseError("pointing needs either a point or a direction")
    if point is not None:
        return Posture("pointing", _base(base), {"point": _points(point, "point")}, hand)
    rows = _points(direction, "direction")
    if (np.linalg.norm(rows, axis=-1) < 1e-9).any():
        raise PoseError("direction must not be zero")
    return Posture("pointing", _base(base), {"direction": rows}, hand)


def looking_at(point: ArrayLike, base: Posture | None = None) -> Posture:
    """Return a posture with the gaze at a point.

    The eyes make a quarter of the turn, up to 20 degrees, and head and neck the rest. Beyond the limits of the neck,
    the eyes turn up to 44 degrees sideways, 28 up and 47 down, and then the trunk twists.

    Args:
        point: Point in the world [m], shape ``(3,)``, or one for each world, ``(W, 3)``.
        base: Posture of the rest of the body; standing by default.
    """
    return Posture("looking", _base(base), {"point": _points(point, "point")})


def solve(posture: Posture, body: Body, places: NDArray[np.float64], floor: float) -> State:
    """Solve a posture for a body at places ``x y heading`` on a floor, shape ``(W, 3)``, with z up."""
    state = State(body, places, floor)
    posture.apply(state)
    return state


def _base(base: Posture | None) -> Posture:
    if base is None:
        return standing()
    if not isinstance(base, Posture):
        raise PoseError(f"base must be a posture, such as warpvis.situations.sitting(), got {base!r}")
    return base


def _numbers(value: ArrayLike, name: str, unit: str, *, hint_percent: bool = False) -> NDArray[np.float64]:
    """Check one finite number, or one per world."""
    try:
        rows = as_numpy(value, name=name).astype(np.float64)
    except (WarpvisError, TypeError, ValueError):
        rows = np.array(np.nan)
    if rows.ndim > 1 or not rows.size or not np.isfinite(rows).all():
        kind = f"a number [{unit}]" if unit else "a number"
        raise PoseError(f"{name} must be {kind}, or one for each world, got {value!r}")
    if hint_percent and rows.min() >= 0 and 1 < rows.max() <= 100:
        raise PoseError(f"{name} must be from 0 to 1, got {rows.max():g}; pass {rows.max() / 100:g} for percent")
    if unit == "m" and rows.max() > 10:
        raise PoseError(f"{name} must be in meters, got {rows.max():g}; pass {rows.max() / 100:g} for centimeters")
    return rows


def _points(value: ArrayLike | None, name: str) -> NDArray[np.float64]:
    """Check one point, or one per world."""
    try:
        rows = as_numpy(value, name=name).astype(np.float64)
    except (WarpvisError, TypeError, ValueError):
        rows = np.zeros(0)
    if rows.ndim not in (1, 2) or rows.shape[-1] != 3 or not rows.size or not np.isfinite(rows).all():
        raise PoseError(f"{name} must be three finite numbers, or three for each world, got {value!r}")
    return rows


def _stand(posture: Posture, state: State) -> None:
    wide = math.radians(7) + 0.25 * (state.body.build - 1)
    for side in SIDES:
        state.set(
            {"shoulder_abduction": wide, "shoulder_rotation": 0.1, "elbow_flexion": 0.22, "hip_abduction": 0.04}, side
        )
    _ground(state)


def _ground(state: State) -> None:
    """Place the pelvis so that the lower foot touches the floor."""
    state.root = np.zeros((state.worlds, 3))
    lowest = lowest_points(state.body, state.frames(), ("foot_left", "foot_right"))
    state.root[:, 2] = -lowest


def _sit(posture: Posture, state: State) -> None:
    body, h = state.body, state.body.height
    joints = body.joints
    thigh = joints["thigh_left"][2] - joints["shank_left"][2]
    shank = joints["shank_left"][2] - joints["foot_left"][2]
    ankle = float(joints["foot_left"][2])
    seats = posture.value("seat_height", state.worlds)
    recline = posture.value("recline", state.worlds)
    hips = seats + body.seat_drop

    def highest(flexion: float, lean: float) -> float:
        return ankle + shank * math.cos(lean) + thigh * math.cos(_SPREAD) * math.cos(flexion) - body.seat_drop

    low, high = highest(_MAX_SEATED_FLEXION, _MAX_SHANK_LEAN), highest(_MIN_SEATED_FLEXION, 0.0)
    if ((seats < low) | (seats > high)).any():
        wrong = seats[(seats < low) | (seats > high)][0]
        raise PoseError(
            f"seat_height must be from {low:.2f} to {high:.2f} m for a person of {h:.2f} m with both feet on the "
            f"floor, got {wrong:g}"
        )
    # The shank is vertical, or leans back at a table, unless the seat is so low that the hip would bend too much: then
    # the feet are in front.
    tuck = _TUCK if "table_height" in posture.values else 0.0
    drop = (hips - ankle - shank * math.cos(tuck)) / (thigh * math.cos(_SPREAD))
    flexion = np.clip(np.arccos(np.clip(drop, -1, 1)), _MIN_SEATED_FLEXION, _MAX_SEATED_FLEXION)
    for _ in range(4):
        lean = np.arccos(np.clip((hips - thigh * math.cos(_SPREAD) * np.cos(flexion) - ankle) / shank, -1, 1))
        lean = np.where(flexion < _MAX_SEATED_FLEXION, -tuck, lean)
        # Legs are spread, so that a shank that is not vertical is inclined sideways, too.
        side_slope = math.sin(_SPREAD) * np.cos(flexion - lean)
        vertical = np.sqrt(1 - side_slope**2)
        drop = (hips - ankle - shank * vertical * math.cos(tuck)) / (thigh * math.cos(_SPREAD))
        flexion = np.clip(np.arccos(np.clip(drop, -1, 1)), _MIN_SEATED_FLEXION, _MAX_SEATED_FLEXION)
    knee = np.arctan2(np.sin(flexion - lean), np.cos(flexion - lean))
    state.angles["pelvis_pitch"] = -recline
    state.angles["spine_flexion"] = 0.35 * recline
    state.angles["neck_flexion"] = 0.5 * recline
    for side in SIDES:
        legs = {"hip_flexion": flexion - recline, "hip_abduction": _SPREAD, "knee_flexion": knee}
        state.set({**legs, "ankle_flexion": -lean}, side)
    state.root = np.stack([np.zeros_like(hips), np.zeros_like(hips), hips], axis=1)
    _rest_hands(posture, state)


def _rest_hands(posture: Posture, state: State) -> None:
    """Place the hands of a sitting person on the thighs or the table."""
    body = state.body
    frames = state.frames()
    for side, sign in (("left", 1), ("right", -1)):
        if "table_height" in posture.values:
            height = posture.value("table_height", state.worlds) + 0.03 * body.height
            target = np.stack(
                [np.full_like(height, 0.18 * body.height), np.full_like(height, sign * 0.1 * body.height)]
            )
            reach(state, np.stack([*target, height], axis=1), side, "the hands on the table")
            continue
        length = body.joints["thigh_left"][2] - body.joints["shank_left"][2]
        # Above the front of the thigh, which is its x axis.
        on_thigh = [body.thigh_radius + 0.024 * body.height, 0.0, -0.55 * length]
        reach(state, frames.points(f"thigh_{side}", on_thigh), side, "the hands on the thighs")


def _crouch(posture: Posture, state: State) -> None:
    knee = posture.value("depth", state.worlds) * math.radians(120)
    lean = 0.3 * knee
    pitch = 0.19 * knee
    state.angles["pelvis_pitch"], state.angles["spine_flexion"] = pitch, 0.15 * knee
    state.angles["neck_flexion"] = -0.15 * knee
    for side in SIDES:
        legs: dict[str, ArrayLike] = {
            "hip_flexion": knee - lean + pitch,
            "hip_abduction": 0.04 + 0.13 * knee,
            "knee_flexion": knee,
        }
        state.set({**legs, "ankle_flexion": np.minimum(lean, math.radians(20))}, side)
        arms: dict[str, ArrayLike] = {
            "shoulder_flexion": 0.6 * knee,
            "shoulder_abduction": 0.12,
            "shoulder_rotation": 0.25,
        }
        state.set({**arms, "elbow_flexion": 0.22 + 0.35 * knee}, side)
    _ground(state)


def _walk(posture: Posture, state: State) -> None:
    phase = posture.value("phase", state.worlds)
    for side, shift in (("left", 0.0), ("right", 0.5)):
        own = (phase + shift) % 1.0
        state.set({name: np.radians(_cycle(own, row)) for name, row in _GAIT.items()}, side)
        # Arms swing with the opposite leg; the angles are a choice, not measured.
        swing = np.cos(2 * np.pi * (own + 0.5))
        state.set(
            {
                "shoulder_flexion": math.radians(-4) + math.radians(18) * swing,
                "shoulder_abduction": 0.12 + 0.25 * (state.body.build - 1),
                "elbow_flexion": math.radians(22) + math.radians(10) * swing,
                "hip_abduction": 0.03,
            },
            side,
        )
    state.angles["pelvis_yaw"] = -math.radians(4) * np.cos(2 * np.pi * phase)
    state.angles["spine_twist"] = math.radians(8) * np.cos(2 * np.pi * phase)
    state.angles["neck_twist"] = -state.angles["pelvis_yaw"] - state.angles["spine_twist"]
    _ground(state)


def _cycle(phase: NDArray[np.float64], degrees: tuple[float, ...]) -> NDArray[np.float64]:
    """Interpolate a periodic curve by cubic Hermite polynomials with the slopes of neighboring points."""
    times = np.array(_GAIT_PERCENT) / 100
    count = len(times)
    knots = np.concatenate([times - 1, times, times + 1])
    values = np.tile(degrees, 3).astype(np.float64)
    slopes = np.gradient(values, knots)
    index = np.searchsorted(times, phase, side="right") - 1 + count
    start, step = knots[index], knots[index + 1] - knots[index]
    t = (phase - start) / step
    a, b = values[index], values[index + 1]
    return (
        (2 * t**3 - 3 * t**2 + 1) * a
        + (t**3 - 2 * t**2 + t) * step * slopes[index]
        + (-2 * t**3 + 3 * t**2) * b
        + (t**3 - t**2) * step * slopes[index + 1]
    )


def _set_angles(posture: Posture, state: State) -> None:
    own: Angles = {name: posture.value(name, state.worlds) for name in posture.values}
    state.angles |= own


def _reach(posture: Posture, state: State) -> None:
    target = state.to_body(posture.value("point", state.worlds))
    reach(state, target, posture.hand, "the point", lean=True)


def _point(posture: Posture, state: State) -> None:
    if "point" in posture.values:
        point_arm(state, posture.hand, point=state.to_body(posture.value("point", state.worlds)))
    else:
        point_arm(state, posture.hand, direction=state.turned(posture.value("direction", state.worlds)))


def _look(posture: Posture, state: State) -> None:
    look(state, state.to_body(posture.value("point", state.worlds)))


_APPLY = {
    "standing": _stand,
    "sitting": _sit,
    "crouching": _crouch,
    "walking": _walk,
    "posed": _set_angles,
    "reaching": _reach,
    "pointing": _point,
    "looking": _look,
}
