# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The surface of a body at rest: a smooth union of round shapes around its bones, as a signed distance.

At rest, the arms are horizontal and the legs are apart, so that limbs touch nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from warpvis.situations.people._body import HAND, SIDES, Body
from warpvis.situations.people._skeleton import SEGMENTS, Angles, Frames, pose_segments
from warpvis.situations.people._solids import make_pieces

_ARM, _LEG = np.pi / 2, 0.14
REST: Angles = {f"shoulder_abduction_{side}": np.array(_ARM) for side in SIDES} | {
    f"hip_abduction_{side}": np.array(_LEG) for side in SIDES
}
"""Joint angles at rest [rad]."""

_SOFTNESS = 0.007
"""Width of the blend between shapes, relative to the stature."""

Distance = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Signed distance of points of a segment's frame, shape ``(n, 3)``, to a shape [m]."""


@dataclass(frozen=True, eq=False)
class Surface:
    """The smooth union of the shapes of a body at rest."""

    frames: Frames
    """Frames of the segments at rest, of one world."""
    shapes: dict[str, tuple[Distance, ...]]
    """Shapes by segment, in its frame."""
    softness: float
    """Width of the blend [m]."""

    def segment_distances(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance of points to each segment [m], shape ``(segments, n)``."""
        rows = []
        for segment in SEGMENTS:
            local = (points - self.frames.origins[segment][0]) @ self.frames.rotations[segment][0]
            rows.append(np.min([shape(local) for shape in self.shapes[segment]], axis=0))
        return np.stack(rows)

    def distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the signed distance to the surface [m], negative inside, shape ``(n,)``."""
        rows = self.segment_distances(points)
        least = rows.min(axis=0)
        return least - self.softness * np.log(np.exp((least - rows) / self.softness).sum(axis=0))

    def gradient(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the gradient of `distance` by central differences, shape ``(n, 3)``."""
        step = 1e-4
        columns = [self.distance(points + step * axis) - self.distance(points - step * axis) for axis in np.eye(3)]
        return np.stack(columns, axis=1) / (2 * step)


def make_surface(body: Body) -> Surface:
    """Return the surface of a body at rest."""
    frames = pose_segments(body, REST, body.joints["pelvis"][None])
    shapes: dict[str, list[Distance]] = {segment: [] for segment in SEGMENTS}
    for piece in make_pieces(body):
        if piece.segment in ("pelvis", "abdomen", "chest"):
            shape = partial(_round, radii=piece.solid.radii, half=piece.solid.half)
            shapes[piece.segment].append(partial(_placed, shape=shape, center=piece.center, rotation=piece.rotation))
    _add_head(body, shapes)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        _add_limbs(body, shapes, side, sign)
    return Surface(frames, {name: tuple(found) for name, found in shapes.items()}, _SOFTNESS * body.height)


def _add_head(body: Body, shapes: dict[str, list[Distance]]) -> None:
    h, joints = body.height, body.joints
    center, half = body.head
    skull, nape = joints["head"], joints["neck"]
    to_head = center - skull
    radius = body.radius("neck")
    start = np.array([0.004 * h, 0.0, -0.02 * h])
    shapes["neck"].append(_bone(start, skull - nape + (0.006 * h, 0.0, 0.012 * h), 1.08 * radius, 0.88 * radius))
    # Shoulders slope from the neck.
    for side in SIDES:
        shoulder = joints[f"upper_arm_{side}"] - joints["chest"]
        root = nape - joints["chest"] + (0.0, 0.0, -0.008 * h)
        shapes["chest"].append(_bone(root, shoulder * (1, 0.85, 1), 0.026 * h, 0.026 * h))
    # The skull is round above the eyes, and narrows towards the chin.
    top = half * (1.0, 1.0, 0.76)
    shapes["head"].append(partial(_ellipsoid, center=to_head + (0, 0, half[2] - top[2]), radii=top))
    jaw = half * (0.66, 0.80, 0.62)
    shapes["head"].append(partial(_ellipsoid, center=to_head + (0.26 * half[0], 0, jaw[2] - half[2]), radii=jaw))
    hair = next(piece for piece in make_pieces(body) if piece.name == "hair")
    shapes["head"].append(partial(_ellipsoid, center=hair.center, radii=hair.solid.radii))
    bridge = to_head + half * (0.90, 0.0, 0.02)
    tip = to_head + half * (1.10, 0.0, -0.24)
    shapes["head"].append(_bone(bridge, tip, 0.0045 * h, 0.0085 * h))


def _add_limbs(body: Body, shapes: dict[str, list[Distance]], side: str, sign: float) -> None:
    h, joints, measure = body.height, body.joints, body.measurement

    def end(part: str, following: str) -> NDArray[np.float64]:
        return joints[f"{following}_{side}"] - joints[f"{part}_{side}"]

    biceps, forearm, wrist = 0.92 * body.radius("biceps"), 0.92 * body.radius("forearm"), body.radius("wrist")
    elbow, hand = end("upper_arm", "forearm"), end("forearm", "hand")
    origin = np.zeros(3)
    shapes[f"upper_arm_{side}"].append(_bone(origin, elbow, biceps, 0.88 * biceps))
    shapes[f"forearm_{side}"] += [
        _bone(origin, 0.35 * hand, 0.84 * biceps, forearm),
        _bone(0.35 * hand, hand, forearm, wrist),
    ]
    # At rest the palm faces the thigh: the hand's breadth is along x.
    breadth = measure("hand_breadth") / 2
    palm, fingers = 0.50 * HAND * h, HAND * h
    hands = shapes[f"hand_{side}"]
    hands.append(
        partial(_ellipsoid, center=np.array([0, 0, -0.46 * palm]), radii=np.array([breadth, 0.0145 * h, 0.62 * palm]))
    )
    middle = -(0.85 * palm + fingers) / 2
    hands.append(
        partial(
            _ellipsoid, center=np.array([0, 0, middle]), radii=np.array([0.82 * breadth, 0.0115 * h, fingers + middle])
        )
    )
    hands.append(
        _bone(
            np.array([0.5 * breadth, 0, -0.25 * palm]),
            np.array([1.45 * breadth, 0, -0.95 * palm]),
            0.010 * h,
            0.008 * h,
        )
    )
    knee, ankle = end("thigh", "shank"), end("shank", "foot")
    thigh, lower = body.radius("thigh"), body.radius("lower_thigh")
    shapes[f"thigh_{side}"].append(_bone(0.06 * knee, knee, 0.93 * thigh, 0.96 * lower))
    calf, low = body.radius("calf"), body.radius("ankle")
    shapes[f"shank_{side}"] += [
        _bone(origin, ankle, 0.93 * lower, 1.02 * low),
        _bone(0.16 * ankle, 0.72 * ankle, 0.98 * calf, 0.8 * calf * 0.8),
    ]
    foot = next(piece for piece in make_pieces(body) if piece.name == f"foot_{side}")
    shape = partial(_round, radii=foot.solid.radii, half=foot.solid.half)
    shapes[f"foot_{side}"] += [
        partial(_placed, shape=shape, center=foot.center, rotation=foot.rotation),
        _bone(
            np.array([0, 0, 0.01 * h]), np.array([0.35 * measure("foot_length"), 0, -0.012 * h]), 1.02 * low, 0.018 * h
        ),
    ]


def _bone(start: NDArray[np.float64], end: NDArray[np.float64], first: float, last: float) -> Distance:
    return partial(_cone, start=np.asarray(start), end=np.asarray(end), first=first, last=last)


def _cone(
    points: NDArray[np.float64], *, start: NDArray[np.float64], end: NDArray[np.float64], first: float, last: float
) -> NDArray[np.float64]:
    """Return about the distance to a capsule whose radius changes linearly along its axis."""
    along = end - start
    share = np.clip((points - start) @ along / (along @ along), 0, 1)
    away = np.linalg.norm(points - start - share[:, None] * along, axis=1)
    return away - first - share * (last - first)


def _ellipsoid(
    points: NDArray[np.float64], *, center: NDArray[np.float64], radii: NDArray[np.float64]
) -> NDArray[np.float64]:
    return _round(points - center, radii=radii, half=0.0)


def _round(points: NDArray[np.float64], *, radii: NDArray[np.float64], half: float) -> NDArray[np.float64]:
    """Return about the distance to a scaled ball or capsule along z, to first order of the surface's gradient."""
    unit = points / radii
    unit[:, 2] -= np.clip(unit[:, 2], -half, half)
    length = np.linalg.norm(unit, axis=1)
    slope = np.linalg.norm(unit / radii, axis=1)
    return np.where(slope > 1e-9, length * (length - 1) / np.maximum(slope, 1e-9), -radii.min())


def _placed(
    points: NDArray[np.float64], *, shape: Distance, center: NDArray[np.float64], rotation: NDArray[np.float64]
) -> NDArray[np.float64]:
    return shape((points - center) @ rotation)
