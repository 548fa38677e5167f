# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The segments of a body as round solids: ellipsoids, and capsules with round or elliptic cross sections."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from warpvis.scene.solids import Solid, SolidKind, capsule, ellipsoid
from warpvis.situations.people._body import HAND, SIDES, Body
from warpvis.situations.people._skeleton import Frames, rotation

_MESH_TOLERANCE = 2e-3
"""Tolerance of the triangles of static solids and of those that viewers show [m]."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A solid of a segment."""

    name: str
    """Name of the object, after that of the person."""
    segment: str
    solid: Solid
    center: NDArray[np.float64]
    """Offset from the segment's joint in its frame [m], shape ``(3,)``."""
    rotation: NDArray[np.float64]
    """Solid to segment, shape ``(3, 3)``."""
    color: str
    """Name of its color: skin, hair, shirt, trousers or shoes."""


@lru_cache(maxsize=256)
def make_pieces(body: Body) -> tuple[Piece, ...]:
    """Return the solids of a body in the order of its objects."""
    h, joints, measure = body.height, body.joints, body.measurement
    crotch, waist = measure("crotch_height"), measure("iliocristale_height")
    pelvis_half = measure("hip_breadth") / 2
    chest_half = (measure("chest_breadth") / 2 + joints["upper_arm_left"][1]) / 2 + 0.012 * h
    pieces = [
        _across("pelvis", body, (0.0, (crotch + waist - 0.012 * h) / 2), pelvis_half, measure("buttock_depth") / 2,
                (waist - 0.012 * h - crotch) / 2, "trousers"),
        _upright("abdomen", body, (-0.004 * h, 0.640 * h), 0.085 * h, measure("waist_depth") / 2,
                 measure("waist_breadth") / 2 * 0.95, "shirt"),
        _across("chest", body, (-0.008 * h, 0.745 * h), chest_half, measure("chest_depth") / 2, 0.092 * h, "shirt"),
    ]  # fmt: skip
    head, half_axes = body.head
    skull = joints["head"]
    nape = joints["neck"]
    tilt = rotation("y", math.atan2(skull[0] - nape[0], skull[2] - nape[2]))
    half = float(np.linalg.norm(skull - nape)) / 2 + 0.004 * h
    neck = capsule(body.radius("neck"), half, mesh_tolerance=_MESH_TOLERANCE)
    pieces.append(Piece("neck", "neck", neck, (skull - nape) / 2, tilt, "skin"))
    face = ellipsoid(half_axes, mesh_tolerance=_MESH_TOLERANCE)
    pieces.append(Piece("head", "head", face, head - skull, np.eye(3), "skin"))
    cap = ellipsoid(half_axes * (1.10, 1.07, 0.88), mesh_tolerance=_MESH_TOLERANCE)
    shift = half_axes * (-0.18, 0.0, 0.20)
    pieces.append(Piece("hair", "head", cap, head + shift - skull, np.eye(3), "hair"))
    for side in SIDES:
        pieces += _limb_pieces(body, side)
    return tuple(pieces)


def _limb_pieces(body: Body, side: str) -> list[Piece]:
    h, joints, measure = body.height, body.joints, body.measurement

    def along(part: str, following: str, radius: float, color: str) -> Piece:
        """Return a capsule from a joint to the next one of the limb."""
        length = joints[f"{part}_{side}"][2] - joints[f"{following}_{side}"][2]
        solid = capsule(radius, length / 2, mesh_tolerance=_MESH_TOLERANCE)
        return Piece(f"{part}_{side}", f"{part}_{side}", solid, np.array([0.0, 0.0, -length / 2]), np.eye(3), color)

    upper_arm = 0.92 * body.radius("biceps")
    forearm = (0.95 * body.radius("forearm") + body.radius("wrist")) / 2
    shank = (body.radius("calf") + body.radius("ankle")) / 2
    hand = ellipsoid((0.013 * h, measure("hand_breadth") / 2, HAND * h / 2), mesh_tolerance=_MESH_TOLERANCE)
    hand_center = np.array([0.0, 0.0, -0.5 * HAND * h])
    foot_half, sole = measure("foot_length") / 2, float(joints[f"foot_{side}"][2])
    height = 0.022 * h
    foot = _capsule(foot_half, measure("foot_breadth") / 2, height, 0.030 * h)
    # The heel is a quarter of the foot's length behind the ankle.
    foot_center = np.array([0.5 * foot_half, 0.0, height - sole])
    along_x = rotation("y", math.pi / 2) @ rotation("z", math.pi / 2)  # long axis forward, breadth sideways
    return [
        along("upper_arm", "forearm", upper_arm, "shirt"),
        along("forearm", "hand", forearm, "skin"),
        # The palm faces the thigh: the hand's breadth is along x.
        Piece(f"hand_{side}", f"hand_{side}", hand, hand_center, rotation("z", math.pi / 2), "skin"),
        along("thigh", "shank", body.thigh_radius, "trousers"),
        along("shank", "foot", shank, "trousers"),
        Piece(f"foot_{side}", f"foot_{side}", foot, foot_center, along_x, "shoes"),
    ]


def _capsule(half: float, first: float, second: float, cap: float) -> Solid:
    """Return a capsule along z of half length `half` in all, with ends of length `cap` and half axes along x and y."""
    solid = capsule(cap, half - cap, mesh_tolerance=_MESH_TOLERANCE)
    return solid.scaled((first / cap, second / cap, 1.0))


def _across(
    segment: str, body: Body, place: Sequence[float], half: float, depth: float, height: float, color: str
) -> Piece:
    """Return a piece of the trunk that is long from left to right, centered at `place`, x and z while standing."""
    solid = _capsule(half, depth, height, min(0.065 * body.height, 0.8 * half))
    to_y = rotation("x", -math.pi / 2)
    return Piece(segment, segment, solid, _offset(segment, body, place), to_y, color)


def _upright(
    segment: str, body: Body, place: Sequence[float], half: float, depth: float, breadth: float, color: str
) -> Piece:
    """Return a piece of the trunk that is long from bottom to top."""
    solid = _capsule(half, depth, breadth, 0.05 * body.height)
    return Piece(segment, segment, solid, _offset(segment, body, place), np.eye(3), color)


def _offset(segment: str, body: Body, place: Sequence[float]) -> NDArray[np.float64]:
    return np.array([place[0], 0.0, place[1]]) - body.joints[segment]


def lowest_points(body: Body, frames: Frames, names: Sequence[str]) -> NDArray[np.float64]:
    """Return the lowest coordinate of some pieces in the body's frame [m], shape ``(W,)``."""
    lowest = []
    for piece in make_pieces(body):
        if piece.name in names:
            center = frames.points(piece.segment, piece.center)[:, 2]
            up = (frames.rotations[piece.segment] @ piece.rotation)[:, 2]
            lowest.append(center - reach_of(piece.solid, up))
    return np.min(lowest, axis=0)


def reach_of(solid: Solid, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far a ball or capsule extends from its center along unit directions in its frame, ``(..., 3)`` [m]."""
    assert solid.kind in (SolidKind.BALL, SolidKind.CAPSULE)
    scaled = directions * solid.radii
    return np.linalg.norm(scaled, axis=-1) + solid.half * np.abs(scaled[..., 2])
