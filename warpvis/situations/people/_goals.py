# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Goals of a posture: a hand at a point, an arm along a direction, the gaze at a point."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import PoseError
from warpvis.situations.people._skeleton import JOINT_LIMITS, Angles, Frames, rotation, shoulder_rotation
from warpvis.situations.people._state import State

_TRUNK = ("pelvis", "abdomen", "chest")
_LEGS = tuple(f"{part}_{side}" for side in ("left", "right") for part in ("thigh", "shank", "foot"))
_HEAD = (*_TRUNK, "neck", "head")

# Swivel angles of the elbow about the line from shoulder to hand, by preference: 0 is down and slightly outwards.
_SWIVELS = np.radians([0, 15, -15, 30, -30, 45, -45, 60, -60, 80, -80, 100, -100, 130, -130, 160, -160, 180])
_ELBOW_REST = np.array([-0.25, 0.35, -1.0])

# Steps by which the trunk leans to reach further, and how far it leans in all [rad].
_LEANS = np.linspace(0, 1, 13)
_HIP_LEAN, _SPINE_LEAN, _SPINE_TURN = math.radians(65), math.radians(50), math.radians(25)

_MIRROR = np.array([1.0, -1.0, 1.0])

# Eyes turn by this share of a change of gaze, up to this angle, before the head reaches its limits.
_EYE_SHARE, _EYE_COMFORT = 0.25, math.radians(20)
_GAZE_STEPS = 40


def reach(state: State, target: NDArray[np.float64], hand: str, subject: str, *, lean: bool = False) -> None:
    """Set the angles of an arm so that the center of its grip is at a point of the body's frame [m], ``(W, 3)``.

    Inverse kinematics of two links with the wrist straight. The preferred swivel angle of the elbow
    is chosen from those within the limits of the joints with which the arm does not cross the trunk.
    """
    for side in ("left", "right"):
        rows = _rows_of(state, target, hand, side)
        if rows.any():
            _reach_with(state, target, rows, side, subject, lean=lean)


def _rows_of(state: State, target: NDArray[np.float64], hand: str, side: str) -> NDArray[np.bool_]:
    if hand == "nearest":
        return (target[:, 1] > 0) == (side == "left")
    return np.full(state.worlds, hand == side)


def _reach_with(
    state: State, target: NDArray[np.float64], rows: NDArray[np.bool_], side: str, subject: str, *, lean: bool
) -> None:
    wanted = rows.copy()
    before = {name: state.angle(name) for name in ("pelvis_pitch", "spine_flexion", "spine_bend", "spine_twist")}
    before |= {f"hip_flexion_{one}": state.angle(f"hip_flexion_{one}") for one in ("left", "right")}
    names = [f"{name}_{side}" for name in ("shoulder_flexion", "shoulder_abduction", "shoulder_rotation")]
    names += [f"elbow_flexion_{side}", f"wrist_flexion_{side}"]
    found = {name: state.angle(name) for name in (*before, *names)}
    distance = np.zeros(state.worlds)
    leans = _LEANS if lean else _LEANS[:1]
    # First only with an arm that does not cross the body, then any.
    for must_clear, amount in itertools.product((True, False), leans):
        if lean:
            _lean(state, before, target, side, float(amount))
        frames = state.frames((*_TRUNK, *_LEGS))
        angles, fits, is_clear, span = _solve_arm(state, frames, target, side)
        distance = distance if amount else span
        solved = wanted & fits & (is_clear | (not must_clear))
        for name, value in (angles | {name: state.angle(name) for name in before}).items():
            found[name] = np.where(solved, value, found[name])
        wanted &= ~solved
        if not wanted.any():
            break
    if wanted.any():
        row = int(np.flatnonzero(wanted)[0])
        length = _arm_lengths(state).sum()
        place = ", ".join(f"{value:.2f}" for value in target[row])
        raise PoseError(
            f"{subject} must be within reach of the {side} hand: in world {row} it is {distance[row]:.2f} m from the "
            f"shoulder, at x, y, z {place} from the person, and the arm is {length:.2f} m long; move or turn the "
            "person, use another base, or reach for a nearer point"
        )
    state.angles |= found


def _arm_lengths(state: State) -> NDArray[np.float64]:
    joints = state.body.joints
    upper = np.linalg.norm(joints["upper_arm_left"] - joints["forearm_left"])
    lower = np.linalg.norm(joints["forearm_left"] - joints["hand_left"])
    return np.array([upper, lower + state.body.grip])


def _lean(state: State, before: Angles, target: NDArray[np.float64], side: str, amount: float) -> None:
    """Lean the trunk towards a target, without moving the legs; the arm's shoulder turns towards it."""
    ahead = np.arctan2(target[:, 1], np.maximum(target[:, 0], 1e-9))
    forward, aside = np.cos(ahead), np.sin(ahead)
    pitch = amount * _HIP_LEAN * np.clip(forward, 0.2, 1)
    for one in ("left", "right"):
        pitch = np.minimum(pitch, JOINT_LIMITS[f"hip_flexion_{one}"][1] - before[f"hip_flexion_{one}"])
    state.angles["pelvis_pitch"] = before["pelvis_pitch"] + pitch
    for one in ("left", "right"):
        state.angles[f"hip_flexion_{one}"] = before[f"hip_flexion_{one}"] + pitch
    turn = -1 if side == "left" else 1
    changes = {
        "spine_flexion": amount * _SPINE_LEAN * forward,
        "spine_bend": amount * _SPINE_LEAN * aside,
        "spine_twist": amount * _SPINE_TURN * turn * forward,
    }
    for name, change in changes.items():
        state.angles[name] = np.clip(before[name] + change, *JOINT_LIMITS[name])


def _solve_arm(
    state: State, frames: Frames, target: NDArray[np.float64], side: str
) -> tuple[Angles, NDArray[np.bool_], NDArray[np.bool_], NDArray[np.float64]]:
    """Return the angles of an arm, whether they are within limits and do not cross the body, and the distance [m]."""
    joints = state.body.joints
    mirror = _MIRROR if side == "right" else np.ones(3)
    # The frame of the chest, mirrored for the right arm, so that there is only a left one.
    local = np.einsum("wji,wj->wi", frames.rotations["chest"], target - frames.origins["chest"]) * mirror
    shoulder = (joints["upper_arm_left"] - joints["chest"]).copy()
    upper, lower = _arm_lengths(state)
    line = local - shoulder
    distance = np.linalg.norm(line, axis=1)
    shortest = math.sqrt(upper**2 + lower**2 + 2 * upper * lower * math.cos(JOINT_LIMITS["elbow_flexion_left"][1]))
    in_range = (distance <= upper + lower) & (distance >= shortest)
    span = np.clip(distance, max(shortest, 1e-6), upper + lower)
    unit = line / np.maximum(distance, 1e-9)[:, None]
    at_shoulder = np.arccos(np.clip((upper**2 + span**2 - lower**2) / (2 * upper * span), -1, 1))
    down = _ELBOW_REST - (unit @ _ELBOW_REST)[:, None] * unit
    down /= np.maximum(np.linalg.norm(down, axis=1), 1e-9)[:, None]
    swing = np.cos(_SWIVELS)[:, None, None] * down + np.sin(_SWIVELS)[:, None, None] * np.cross(unit, down)
    to_elbow = np.cos(at_shoulder)[:, None] * unit + np.sin(at_shoulder)[:, None] * swing  # (S, W, 3)
    to_hand = (unit * span[:, None] - upper * to_elbow) / lower
    flexion, abduction, internal = _shoulder_angles(to_elbow, to_hand)
    elbow = np.arccos(np.clip((to_elbow * to_hand).sum(axis=-1), -1, 1))
    fits = np.full(flexion.shape, True)
    for name, value in zip(("flexion", "abduction", "rotation"), (flexion, abduction, internal), strict=True):
        low, high = JOINT_LIMITS[f"shoulder_{name}_left"]
        fits &= (value >= low) & (value <= high)
    arm = [shoulder + share * upper * to_elbow for share in (0.5, 1.0)]
    arm += [arm[-1] + share * lower * to_hand for share in (0.35, 0.7, 0.95)]
    clear = fits & ~_crosses_body(state, frames, np.stack(arm), side)
    # The first that is clear, else the first within the limits.
    choice = np.where(clear.any(axis=0), clear.argmax(axis=0), fits.argmax(axis=0))
    pick = choice, np.arange(len(choice))
    values = [flexion[pick], abduction[pick], internal[pick], elbow[pick], np.zeros(len(choice))]
    names = ("shoulder_flexion", "shoulder_abduction", "shoulder_rotation", "elbow_flexion", "wrist_flexion")
    angles = {f"{name}_{side}": value for name, value in zip(names, values, strict=True)}
    return angles, in_range & fits[pick], clear[pick], distance


def _shoulder_angles(
    to_elbow: NDArray[np.float64], to_hand: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return flexion, abduction and internal rotation of a left upper arm, from unit vectors along both links."""
    abduction = np.arcsin(np.clip(to_elbow[..., 1], -1, 1))
    flexion = np.arctan2(to_elbow[..., 0], -to_elbow[..., 2])
    # The forearm flexes about the y axis of the upper arm, towards its x axis.
    front = to_hand - (to_hand * to_elbow).sum(axis=-1, keepdims=True) * to_elbow
    swung = np.swapaxes(shoulder_rotation(flexion, abduction, 0.0), -1, -2) @ front[..., None]
    internal = -np.arctan2(swung[..., 1, 0], swung[..., 0, 0])
    return flexion, abduction, np.where(np.linalg.norm(front, axis=-1) < 1e-7, 0.0, internal)


def _crosses_body(state: State, frames: Frames, points: NDArray[np.float64], side: str) -> NDArray[np.bool_]:
    """Return whether points of an arm, shape ``(P, S, W, 3)``, are inside the trunk or a leg, shape ``(S, W)``.

    The points are in the frame of the chest, mirrored for the right arm. The trunk is an elliptic cylinder below the
    shoulders; all but the first point of the upper arm count for it.
    """
    body, radius = state.body, state.body.radius("forearm")
    mirror = _MIRROR if side == "right" else np.ones(3)
    shoulder = body.joints["upper_arm_left"] - body.joints["chest"]
    half = np.array([body.measurement("chest_depth") / 2, body.measurement("chest_breadth") / 2]) + radius
    inside = (((points[1:, ..., :2] - [shoulder[0], 0.0]) / half) ** 2).sum(axis=-1) < 1
    crosses = (inside & (points[1:, ..., 2] < shoulder[2] + radius)).any(axis=0)
    chest, to_chest = frames.origins["chest"], frames.rotations["chest"]
    for leg in ("left", "right"):
        ends = [frames.origins[f"{part}_{leg}"] - chest for part in ("thigh", "shank", "foot")]
        ends = [np.einsum("wji,wj->wi", to_chest, end) * mirror for end in ends]
        for start, end, thick in zip(ends, ends[1:], (body.thigh_radius, body.radius("calf")), strict=False):
            along = end - start
            share = np.clip(((points - start) * along).sum(axis=-1) / (along**2).sum(axis=-1), 0, 1)
            away = np.linalg.norm(points - start - share[..., None] * along, axis=-1)
            crosses |= (away < thick + 0.9 * radius).any(axis=0)
    return crosses


def point_arm(
    state: State,
    hand: str,
    *,
    point: NDArray[np.float64] | None = None,
    direction: NDArray[np.float64] | None = None,
) -> None:
    """Set the angles of a straight arm: along a direction of the body's frame, or to a point, shapes ``(W, 3)``."""
    joints, frames = state.body.joints, state.frames(_TRUNK)
    towards = direction if point is None else point
    assert towards is not None
    for side in ("left", "right"):
        rows = _rows_of(state, towards, hand, side)
        if not rows.any():
            continue
        shoulder = frames.points("chest", joints[f"upper_arm_{side}"] - joints["chest"])
        line = towards if point is None else point - shoulder
        local = np.einsum("wji,wj->wi", frames.rotations["chest"], line) * (_MIRROR if side == "right" else np.ones(3))
        length = np.linalg.norm(local, axis=1)
        unit = local / np.maximum(length, 1e-9)[:, None]
        flexion, abduction, _ = _shoulder_angles(unit, unit)
        fits = length > 1e-6
        for name, value in (("flexion", flexion), ("abduction", abduction)):
            low, high = JOINT_LIMITS[f"shoulder_{name}_{side}"]
            fits &= (value >= low) & (value <= high)
        if (rows & ~fits).any():
            row = int(np.flatnonzero(rows & ~fits)[0])
            raise PoseError(
                f"the {side} arm cannot point there in world {row}: its flexion would be "
                f"{math.degrees(flexion[row]):.0f} degrees and its abduction {math.degrees(abduction[row]):.0f}; use "
                "the other hand, or turn the person"
            )
        zero = np.zeros(state.worlds)
        values = {"shoulder_flexion": flexion, "shoulder_abduction": abduction, "shoulder_rotation": zero}
        values |= {"elbow_flexion": zero, "wrist_flexion": zero}
        for name, value in values.items():
            full = f"{name}_{side}"
            state.angles[full] = np.where(rows, value, state.angle(full))


def eye_point(state: State, frames: Frames) -> NDArray[np.float64]:
    """Return the midpoint of the eyes in the body's frame [m], shape ``(W, 3)``."""
    return frames.points("head", state.body.eyes - state.body.joints["head"])


def eye_rotation(state: State, frames: Frames) -> NDArray[np.float64]:
    """Return the frames of the eyes, x along the gaze and z up, in the body's frame, shape ``(W, 3, 3)``."""
    turn = rotation("z", state.angle("eye_yaw")) @ rotation("y", state.angle("eye_pitch"))
    return frames.rotations["head"] @ turn


def look(state: State, target: NDArray[np.float64]) -> None:
    """Set the angles of eyes, neck and trunk so that the gaze meets a point of the body's frame [m], ``(W, 3)``."""
    for name in ("neck_flexion", "neck_bend", "neck_twist"):
        state.angles[name] = np.zeros(state.worlds)
    twist = state.angle("spine_twist")
    for _ in range(_GAZE_STEPS):
        frames = state.frames(_HEAD)
        eyes = eye_point(state, frames)
        chest = np.einsum("wji,wj->wi", frames.rotations["chest"], target - eyes)
        yaw, pitch = _angles_of(chest)
        need = _beyond(yaw, "neck_twist", "eye_yaw")
        step = np.clip(twist + need, *JOINT_LIMITS["spine_twist"]) - twist
        if np.abs(step).max() > 1e-9:
            twist = twist + step
            state.angles["spine_twist"] = twist
            continue
        state.angles["neck_twist"] = _head_part(yaw, "neck_twist")
        state.angles["neck_flexion"] = _head_part(pitch, "neck_flexion")
    frames = state.frames(_HEAD)
    eyes = eye_point(state, frames)
    yaw, pitch = _angles_of(np.einsum("wji,wj->wi", frames.rotations["head"], target - eyes))
    near = np.linalg.norm(target - eyes, axis=1) < 0.05
    for name, value in (("eye_yaw", yaw), ("eye_pitch", pitch)):
        low, high = JOINT_LIMITS[name]
        is_bad = (value < low - 1e-6) | (value > high + 1e-6) | near
        if is_bad.any():
            row = int(np.flatnonzero(is_bad)[0])
            aside, down = _angles_of(target - eyes)
            raise PoseError(
                f"the point must be where the person can look: in world {row} it is "
                f"{np.linalg.norm(target[row] - eyes[row]):.2f} m from the eyes, {abs(math.degrees(aside[row])):.0f} "
                f"degrees to the {'left' if aside[row] > 0 else 'right'} and {abs(math.degrees(down[row])):.0f} "
                f"{'down' if down[row] > 0 else 'up'}; turn the person"
            )
        state.angles[name] = np.clip(value, low, high)


def _angles_of(vectors: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the angles of vectors to the left and down [rad]."""
    yaw = np.arctan2(vectors[:, 1], vectors[:, 0])
    return yaw, np.arctan2(-vectors[:, 2], np.hypot(vectors[:, 0], vectors[:, 1]))


def _head_part(angle: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Return the part of a change of gaze that neck and head make."""
    eyes = np.clip(_EYE_SHARE * angle, -_EYE_COMFORT, _EYE_COMFORT)
    return np.clip(angle - eyes, *JOINT_LIMITS[name])


def _beyond(angle: NDArray[np.float64], neck: str, eyes: str) -> NDArray[np.float64]:
    """Return the part of an angle that neck and eyes together cannot make, with a margin of 3 degrees."""
    margin = math.radians(3)
    low = JOINT_LIMITS[neck][0] + JOINT_LIMITS[eyes][0] + margin
    high = JOINT_LIMITS[neck][1] + JOINT_LIMITS[eyes][1] - margin
    return np.maximum(angle - high, 0) + np.minimum(angle - low, 0)
