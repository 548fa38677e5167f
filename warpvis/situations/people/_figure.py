# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Figures: custom people, as a mesh with a skeleton, such as those of glTF files and of SMPL's shape."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import as_items, check_mapping, is_number, truncate
from warpvis.errors import SceneError, WarpvisError
from warpvis.scene.materials import Appearance
from warpvis.situations.people._body import MAX_HEIGHT, MIN_HEIGHT, SIDES, Body
from warpvis.situations.people._skeleton import SEGMENTS, Frames

SMPL_JOINTS = tuple(
    "pelvis left_hip right_hip spine1 left_knee right_knee spine2 left_ankle right_ankle spine3 left_foot right_foot "
    "neck left_collar right_collar head left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist "
    "left_hand right_hand".split()
)
"""Names of the 24 joints of SMPL, in its order."""

# Names of joints of SMPL, Mixamo, VRM, Blender's Rigify and Unreal by segment, without prefixes and signs, by
# preference: SMPL's shoulder is Mixamo's arm, and its left_hand is the end of the hand.
_NAMES = {
    "pelvis": "hips pelvis",
    "neck": "neck neck1 neck01",
    "head": "head",
    "upper_arm": "*arm *upperarm upperarm* *shoulder",
    "forearm": "*forearm *lowerarm lowerarm* forearm* *elbow",
    "hand": "*wrist *hand hand*",
    "thigh": "*upleg *upperleg thigh* *hip *thigh",
    "shank": "*leg *lowerleg calf* shin* *knee",
    "foot": "*ankle *foot foot*",
    "eye": "*eye *faceeye eye*",
}
_PREFIX = re.compile(r"^(.*:|mixamorig\d*|j_(bip|adj|sec)_(c_)?|bip\d+[ _]?|def[-_.])", re.IGNORECASE)
_OPTIONAL = ("eye_left", "eye_right")

_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class _OwnBody(Body):
    """The body of a figure: its joints and eyes, and other sizes by its height."""

    own_joints: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    own_eyes: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))

    @cached_property
    def joints(self) -> Mapping[str, NDArray[np.float64]]:
        return self.own_joints

    @cached_property
    def eyes(self) -> NDArray[np.float64]:
        return self.own_eyes


class Figure:
    """A mesh with a skeleton that a `Person` can have for a body: ``Person(figure=figure, posture=sitting())``."""

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        joints: ArrayLike,
        parents: ArrayLike,
        weights: ArrayLike,
        *,
        names: Sequence[str] | None = None,
        segments: Mapping[str, str] | None = None,
        height: float | None = None,
        appearance: Appearance | None = None,
    ) -> None:
        """Find the segments of a skeleton, and turn the mesh upright.

        At rest, the trunk is upright, arms and legs are straight in any direction, and the feet are flat. The joints
        tell along which axis the person stands, and along which the person faces.

        Args:
            vertices: Corners at rest, shape ``(n, 3)``.
            faces: Corner indices of the triangles, shape ``(m, 3)``.
            joints: Positions of the J joints at rest, shape ``(J, 3)``.
            parents: Index of the parent of each joint, -1 for the root, shape ``(J,)``; a parent has a smaller index.
            weights: Share of each joint in the motion of each corner, shape ``(n, J)``.
            names: Names of the joints; by default those of SMPL, in its order, for 24 joints.
            segments: Name of the joint at the beginning of a segment, such as ``{"thigh_left": "LeftHip"}``, where it
                is not found by a common name (SMPL, Mixamo, VRM, Rigify, Unreal). Segments are ``pelvis``, ``neck``,
                ``head``, and ``upper_arm``, ``forearm``, ``hand``, ``thigh``, ``shank``, ``foot`` and, optionally,
                ``eye`` with ``_left`` and ``_right``.
            height: Stature [m], to which the figure is scaled; by default its coordinates are in meters.
            appearance: Appearance of the mesh.
        """
        corners, places = _rows(vertices, "vertices", 3), _rows(joints, "joints", 3)
        self._faces = _triangles(faces, len(corners))
        self._parents = _check_parents(parents, len(places))
        self._weights = _check_weights(weights, len(corners), len(places))
        found = _find_segments(_joint_names(names, len(places)), segments)
        upright = _upright(places, found)
        corners, places = corners @ upright.T, places @ upright.T
        scale = _scale(float(np.ptp(corners[:, 2])), height)
        hips = (places[found["thigh_left"]] + places[found["thigh_right"]]) / 2
        shift = np.array([hips[0], hips[1], corners[:, 2].min()])
        self._vertices, self._places = (corners - shift) * scale, (places - shift) * scale
        self._joint_segments, chest = _segments_of_joints(self._parents, found)
        self.body: Body = _body_of(self._places, found, chest, self._vertices)
        """Measurements of the figure."""
        if appearance is not None and not isinstance(appearance, Appearance):
            raise SceneError(f"appearance of a figure must be an Appearance, got {appearance!r}")
        self.appearance = Appearance() if appearance is None else appearance
        """Appearance of the mesh."""
        self.appearance.check_fits(len(corners), len(self._faces), "a figure")
        self._found = found
        self._to_rest = _to_hanging(self._places, found)
        # Corners at one place have one normal, although texture coordinates may differ.
        _, self._same = np.unique(self._vertices, axis=0, return_inverse=True)

    @property
    def faces(self) -> NDArray[np.int32]:
        """Corner indices of the triangles, shape ``(m, 3)``."""
        return self._faces

    def posed(self, frames: Frames) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return corners [m] and normals in W postures, in the body's frame, shapes ``(W, n, 3)``."""
        worlds, count = len(frames.origins["pelvis"]), len(self._places)
        turns, points = np.empty((worlds, count, 3, 3)), np.empty((worlds, count, 3))
        hips = self.body.joints["pelvis"] * (1, 1, 0)
        hips[2] = (self._places[self._found["thigh_left"]] + self._places[self._found["thigh_right"]])[2] / 2
        for joint, parent in enumerate(self._parents):
            segment = self._joint_segments[joint]
            if segment is None:
                turns[:, joint] = turns[:, parent] if parent >= 0 else frames.rotations["pelvis"]
            else:
                turns[:, joint] = frames.rotations[segment] @ self._to_rest.get(segment, np.eye(3))
            if parent < 0:
                start, offset, turn = frames.origins["pelvis"], self._places[joint] - hips, frames.rotations["pelvis"]
            else:
                start, offset, turn = points[:, parent], self._places[joint] - self._places[parent], turns[:, parent]
            points[:, joint] = start + turn @ offset
        shifts = points - np.einsum("wjab,jb->wja", turns, self._places)
        vertices, normals = np.empty((2, worlds, len(self._vertices), 3))
        for world in range(worlds):
            blended = (self._weights @ turns[world].reshape(-1, 9)).reshape(-1, 3, 3)
            vertices[world] = np.einsum("nij,nj->ni", blended, self._vertices) + self._weights @ shifts[world]
            normals[world] = self._normals(vertices[world])
        return vertices, normals

    def _normals(self, vertices: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return unit normals, weighted by the areas of triangles; x where a corner has none, shape ``(n, 3)``."""
        a, b, c = vertices[self._faces].swapaxes(0, 1)
        areas = np.cross(b - a, c - a)
        total = np.zeros((self._same.max() + 1, 3))
        for k in range(3):
            np.add.at(total, self._same[self._faces[:, k]], areas)
        length = np.linalg.norm(total, axis=1, keepdims=True)
        unit = np.where(length > 1e-15, total / np.maximum(length, 1e-15), [1.0, 0.0, 0.0])
        return unit[self._same]


def _rows(value: ArrayLike, name: str, width: int) -> NDArray[np.float64]:
    try:
        rows = as_numpy(value, name=name).astype(np.float64)
    except (WarpvisError, TypeError, ValueError):
        rows = np.zeros(0)
    if rows.ndim != 2 or rows.shape[1] != width or not len(rows) or not np.isfinite(rows).all():
        raise SceneError(
            f"{name} of a figure must be finite numbers of shape (n, {width}), got {truncate(repr(value))}"
        )
    return rows


def _triangles(value: ArrayLike, count: int) -> NDArray[np.int32]:
    rows = _rows(value, "faces", 3)
    if (rows != np.round(rows)).any() or rows.min() < 0 or rows.max() >= count:
        raise SceneError(
            f"faces of a figure must be indices of its {count} vertices, got {rows.min():g} to {rows.max():g}"
        )
    return rows.astype(np.int32)


def _check_parents(value: ArrayLike, count: int) -> list[int]:
    try:
        rows = as_numpy(value, name="parents")
        parents = rows.astype(np.int64)
    except (WarpvisError, TypeError, ValueError):
        parents = np.zeros(0, dtype=np.int64)
    if parents.shape != (count,) or not ((parents >= -1) & (parents < np.arange(count))).all() or parents[0] != -1:
        raise SceneError(
            f"parents of a figure must be one index for each of {count} joints, -1 for the root and smaller than the "
            f"joint's index for others, got {truncate(repr(value))}"
        )
    return [int(parent) for parent in parents]


def _check_weights(value: ArrayLike, vertices: int, joints: int) -> NDArray[np.float64]:
    rows = _rows(value, "weights", joints)
    if len(rows) != vertices or rows.min() < -_TOLERANCE:
        raise SceneError(
            f"weights of a figure must be numbers from 0 up of shape ({vertices}, {joints}), got shape {rows.shape} "
            f"from {rows.min():g}"
        )
    rows = np.maximum(rows, 0)
    total = rows.sum(axis=1, keepdims=True)
    rows[total[:, 0] < 1e-9, 0] = 1.0
    return rows / np.where(total < 1e-9, 1.0, total)


def _joint_names(names: Sequence[str] | None, count: int) -> list[str]:
    if names is None:
        if count != len(SMPL_JOINTS):
            raise SceneError(
                f"names of the {count} joints of a figure must be given; only those of SMPL's 24 are known"
            )
        return list(SMPL_JOINTS)
    found = as_items(names, "names", SceneError)
    if len(found) != count or not all(isinstance(name, str) for name in found):
        raise SceneError(f"names of a figure must be one text for each of {count} joints, got {truncate(repr(names))}")
    return found


def _find_segments(names: list[str], given: Mapping[str, str] | None) -> dict[str, int]:
    """Return the index of the joint at the beginning of each segment."""
    plain = [re.sub(r"[^a-z0-9]", "", _PREFIX.sub("", name).lower()) for name in names]
    found: dict[str, int] = {}
    for part, patterns in _NAMES.items():
        sides = ("",) if part in ("pelvis", "neck", "head") else SIDES
        for side in sides:
            wanted = [
                pattern.replace("*", mark)
                for pattern in patterns.split()
                for mark in ((side, side[0]) if side else ("",))
            ]
            index = next((plain.index(name) for name in wanted if name in plain), None)
            if index is not None:
                found[f"{part}_{side}" if side else part] = index
    known = {f"{part}_{side}" for part in _NAMES for side in SIDES} | {"pelvis", "neck", "head"}
    for segment, name in check_mapping({} if given is None else given, "segments", SceneError).items():
        if segment not in known or name not in names:
            what = f"segment {segment!r}" if segment not in known else f"joint {name!r}"
            raise SceneError(f"segments must map segments of a person to names of joints; there is no {what}")
        found[segment] = names.index(name)
    needed = {"pelvis", "neck", "head"} | {f"{part}_{side}" for part in _NAMES for side in SIDES if part not in (
        "pelvis", "neck", "head")}  # fmt: skip
    missing = sorted(needed - set(found) - set(_OPTIONAL))
    if missing:
        known_names = truncate(", ".join(names), 300)
        raise SceneError(
            f"no joint of the figure was found for {', '.join(missing)}; pass segments={{{missing[0]!r}: NAME}}, the "
            f"joints are {known_names}"
        )
    return found


def _upright(places: NDArray[np.float64], found: Mapping[str, int]) -> NDArray[np.float64]:
    """Return the rotation to x forward, y left and z up, from the axes of a figure that its joints are closest to."""

    def nearest_axis(vector: NDArray[np.float64]) -> NDArray[np.float64]:
        axis = np.zeros(3)
        k = int(np.abs(vector).argmax())
        axis[k] = np.sign(vector[k])
        return axis

    upward = nearest_axis(places[found["head"]] - places[found["pelvis"]])
    left = nearest_axis(places[found["thigh_left"]] - places[found["thigh_right"]])
    if abs(upward @ left) > 0.5 or not upward.any() or not left.any():
        raise SceneError("joints of a figure must be those of a standing person: its hips are not side by side")
    return np.stack([np.cross(left, upward), left, upward])


def _scale(extent: float, height: float | None) -> float:
    if height is None:
        if not MIN_HEIGHT <= extent <= MAX_HEIGHT:
            raise SceneError(
                f"vertices of a figure must be from {MIN_HEIGHT} to {MAX_HEIGHT} m high, got {extent:.4g}; pass height="
            )
        return 1.0
    if not is_number(height) or not MIN_HEIGHT <= height <= MAX_HEIGHT or extent <= 0:
        raise SceneError(f"height of a figure must be from {MIN_HEIGHT} to {MAX_HEIGHT} m, got {height!r}")
    return height / extent


def _segments_of_joints(parents: list[int], found: Mapping[str, int]) -> tuple[list[str | None], list[int]]:
    """Return the segment that each joint turns with, None for that of its parent, and the joints of the spine."""

    def chain(low: int, top: int) -> list[int]:
        joints = [top]
        while joints[-1] != low:
            if parents[joints[-1]] < 0:
                raise SceneError("joints of a figure must lead from the pelvis over neck to head")
            joints.append(parents[joints[-1]])
        return joints[-2:0:-1]

    segments: list[str | None] = [None] * len(parents)
    spine = chain(found["pelvis"], found["neck"])
    for joint in chain(found["neck"], found["head"]):
        segments[joint] = "neck"
    for number, joint in enumerate(spine):
        segments[joint] = "abdomen" if number == 0 and len(spine) > 1 else "chest"
    for segment, joint in found.items():
        if segment in SEGMENTS:
            segments[joint] = segment
    return segments, spine


def _body_of(
    places: NDArray[np.float64], found: Mapping[str, int], spine: list[int], vertices: NDArray[np.float64]
) -> Body:
    """Return the body with the joints of a figure as they are with hanging arms and straight legs."""
    height = float(vertices[:, 2].max())

    def length(first: str, second: str) -> float:
        """Return the mean length of a segment of both sides."""
        ends = [(places[found[f"{first}_{side}"]], places[found[f"{second}_{side}"]]) for side in SIDES]
        return float(np.mean([np.linalg.norm(a - b) for a, b in ends]))

    def middle(segment: str) -> NDArray[np.float64]:
        """Return the mean of the left joint and the mirrored right one."""
        left, right = (places[found[f"{segment}_{side}"]] for side in SIDES)
        return (left + right * (1, -1, 1)) / 2

    thigh, shank, ankle = length("thigh", "shank"), length("shank", "foot"), middle("foot")[2]
    hip = middle("thigh")
    rise = np.array([0.0, 0.0, ankle + shank + thigh - hip[2]])
    lower, upper = (spine[0], spine[min(1, len(spine) - 1)]) if spine else (found["pelvis"], found["pelvis"])
    joints = {
        "pelvis": np.array([hip[0], 0.0, hip[2]]) + rise,
        "abdomen": places[lower] * (1, 0, 1) + rise,
        "chest": places[upper] * (1, 0, 1) + rise,
        "neck": places[found["neck"]] * (1, 0, 1) + rise,
        "head": places[found["head"]] * (1, 0, 1) + rise,
    }
    arm = (length("upper_arm", "forearm"), length("forearm", "hand"))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        limbs = {"upper_arm": middle("upper_arm") + rise, "thigh": hip + rise}
        limbs["forearm"] = limbs["upper_arm"] - (0, 0, arm[0])
        limbs["hand"] = limbs["forearm"] - (0, 0, arm[1])
        limbs["shank"] = limbs["thigh"] - (0, 0, thigh)
        limbs["foot"] = limbs["shank"] - (0, 0, shank)
        joints |= {f"{part}_{side}": place * (1, sign, 1) for part, place in limbs.items()}
    return _OwnBody(height, own_joints=joints, own_eyes=_eyes(places, found, vertices, height) + rise)


def _eyes(
    places: NDArray[np.float64], found: Mapping[str, int], vertices: NDArray[np.float64], height: float
) -> NDArray[np.float64]:
    """Return the midpoint of the eyes at rest: of their joints, or at the front of the head."""
    body = Body(height)
    if all(name in found for name in _OPTIONAL):
        center = (places[found["eye_left"]] + places[found["eye_right"]]) / 2
        return np.array([center[0] + 0.007 * height, 0.0, center[2]])
    aside = np.abs(np.abs(vertices[:, 1]) - body.interpupillary_distance / 2)
    near = (np.abs(vertices[:, 2] - body.eye_height) < 0.015 * height) & (aside < 0.008 * height)
    front = vertices[near, 0].max() if near.any() else body.eyes[0]
    return np.array([front, 0.0, body.eye_height])


def _to_hanging(places: NDArray[np.float64], found: Mapping[str, int]) -> dict[str, NDArray[np.float64]]:
    """Return the least rotation of each limb from rest to hanging down."""
    turns = {}
    for side in SIDES:
        for part, following in (("upper_arm", "forearm"), ("forearm", "hand"), ("thigh", "shank"), ("shank", "foot")):
            along = places[found[f"{following}_{side}"]] - places[found[f"{part}_{side}"]]
            turns[f"{part}_{side}"] = _least_rotation(along / max(float(np.linalg.norm(along)), 1e-12))
        turns[f"hand_{side}"] = turns[f"forearm_{side}"]
    return turns


def _least_rotation(unit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the least rotation from a unit vector to -z (Rodrigues)."""
    axis, cosine = np.cross(unit, (0, 0, -1.0)), float(-unit[2])
    if cosine < -1 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + cross + cross @ cross / (1 + cosine)
