# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The joints of a body: their angles, limits, and forward kinematics of many postures at once.

Frames are those of the body: x forward, y left, z up. All angles are 0 while standing upright with hanging arms, palms
towards the thighs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import degrees_hint, truncate
from warpvis.errors import PoseError, WarpvisError
from warpvis.situations.people._body import SIDES, Body

_LIMB = {"upper_arm": "chest", "forearm": "upper_arm", "hand": "forearm"} | {
    "thigh": "pelvis",
    "shank": "thigh",
    "foot": "shank",
}

PARENTS: dict[str, str | None] = {
    "pelvis": None,
    "abdomen": "pelvis",
    "chest": "abdomen",
    "neck": "chest",
    "head": "neck",
} | {
    f"{part}_{side}": parent if parent in ("chest", "pelvis") else f"{parent}_{side}"
    for side in SIDES
    for part, parent in _LIMB.items()
}
"""Parents of the segments; parents come first."""

SEGMENTS = tuple(PARENTS)

# Limits [degrees]: American Academy of Orthopaedic Surgeons, Joint Motion: Method of Measuring and Recording, 1965 (in
# Norkin and White, Measurement of Joint Motion). Exceptions are marked.
_TRUNK_LIMITS = {
    "spine_flexion": (-25, 80),
    "spine_bend": (-35, 35),  # to the left
    "spine_twist": (-45, 45),  # to the left
    "neck_flexion": (-45, 45),
    "neck_bend": (-45, 45),
    "neck_twist": (-60, 60),
}
_LIMB_LIMITS = {
    "shoulder_flexion": (-60, 180),
    "shoulder_abduction": (-50, 90),  # angle between arm and sagittal plane; flexion exceeds 90 above the shoulder
    "shoulder_rotation": (-90, 90),  # internal; AAOS: 70, but 90 with a hanging arm
    "elbow_flexion": (0, 150),
    "forearm_pronation": (-80, 80),
    "wrist_flexion": (-70, 80),
    "hip_flexion": (-30, 120),
    "hip_abduction": (-30, 45),
    "hip_rotation": (-45, 45),  # internal
    "knee_flexion": (0, 135),
    "ankle_flexion": (-50, 20),  # dorsiflexion
}

# Eyes in the head, to the left and down: Lee et al., Eye 33, 2019, 1145, doi:10.1038/s41433-019-0376-4.
_EYE_LIMITS = {"eye_yaw": (-44, 44), "eye_pitch": (-28, 47)}

# The whole body; not limited by joints.
_ROOT = {"pelvis_pitch": (-90, 90), "pelvis_roll": (-90, 90), "pelvis_yaw": (-180, 180)}

JOINT_LIMITS: dict[str, tuple[float, float]] = {
    name: (math.radians(low), math.radians(high))
    for name, (low, high) in (
        _ROOT
        | _TRUNK_LIMITS
        | _EYE_LIMITS
        | {f"{name}_{side}": limits for side in SIDES for name, limits in _LIMB_LIMITS.items()}
    ).items()
}
"""Minimum and maximum of each joint angle [rad]."""

_LIMIT_TOLERANCE = 1e-9

Angles = dict[str, NDArray[np.float64]]
"""Joint angles by name [rad], each of shape ``(W,)``; missing ones are 0."""


def rotation(axis: str, angle: ArrayLike) -> NDArray[np.float64]:
    """Return rotation matrices about a coordinate axis, shape ``(..., 3, 3)``."""
    angle = np.asarray(angle, dtype=np.float64)
    i = "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    matrices = np.zeros((*angle.shape, 3, 3))
    matrices[..., i, i] = 1.0
    matrices[..., j, j] = matrices[..., k, k] = np.cos(angle)
    matrices[..., k, j] = np.sin(angle)
    matrices[..., j, k] = -matrices[..., k, j]
    return matrices


def shoulder_rotation(flexion: ArrayLike, abduction: ArrayLike, internal: ArrayLike) -> NDArray[np.float64]:
    """Return the rotation of the left upper arm in the frame of the chest; see `mirrored` for the right one."""
    return rotation("y", -np.asarray(flexion)) @ rotation("x", abduction) @ rotation("z", -np.asarray(internal))


def mirrored(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mirror rotations at the sagittal plane."""
    flip = np.array([1.0, -1.0, 1.0])
    return rotations * flip[:, None] * flip


def local_rotation(segment: str, angles: Angles) -> NDArray[np.float64]:
    """Return the rotation of a segment relative to its parent, or of the pelvis to the body, shape ``(..., 3, 3)``."""

    def angle(name: str) -> NDArray[np.float64]:
        return np.asarray(angles.get(name, 0.0))

    if segment == "pelvis":
        yaw, pitch, roll = (angle(f"pelvis_{name}") for name in ("yaw", "pitch", "roll"))
        return rotation("z", yaw) @ rotation("y", pitch) @ rotation("x", roll)
    if segment in ("abdomen", "chest", "neck", "head"):
        # Two segments share each angle equally.
        name = "spine" if segment in ("abdomen", "chest") else "neck"
        flexion, bend, twist = (angle(f"{name}_{part}") / 2 for part in ("flexion", "bend", "twist"))
        return rotation("z", twist) @ rotation("y", flexion) @ rotation("x", -bend)
    part, _, side = segment.rpartition("_")
    if part == "upper_arm":
        left = shoulder_rotation(*(angle(f"shoulder_{name}_{side}") for name in ("flexion", "abduction", "rotation")))
    elif part == "forearm":
        left = rotation("y", -angle(f"elbow_flexion_{side}")) @ rotation("z", -angle(f"forearm_pronation_{side}"))
    elif part == "hand":
        left = rotation("x", -angle(f"wrist_flexion_{side}"))
    elif part == "thigh":
        flexion, abduction, turn = (angle(f"hip_{name}_{side}") for name in ("flexion", "abduction", "rotation"))
        left = shoulder_rotation(flexion, abduction, turn)
    elif part == "shank":
        left = rotation("y", angle(f"knee_flexion_{side}"))
    else:
        left = rotation("y", -angle(f"ankle_flexion_{side}"))
    return left if side == "left" else mirrored(left)


@dataclass(frozen=True)
class Frames:
    """Frames of the segments of W postures."""

    rotations: dict[str, NDArray[np.float64]]
    """Rotation of each segment in the body's frame, shape ``(W, 3, 3)``."""
    origins: dict[str, NDArray[np.float64]]
    """Its proximal joint in the body's frame [m], shape ``(W, 3)``."""

    def points(self, segment: str, offsets: ArrayLike) -> NDArray[np.float64]:
        """Return points of a segment, from offsets to its joint [m], shape ``(W, 3)``."""
        rows = np.broadcast_to(offsets, self.origins[segment].shape)
        return self.origins[segment] + np.einsum("wij,wj->wi", self.rotations[segment], rows)


def pose_segments(body: Body, angles: Angles, root: NDArray[np.float64], segments: Iterable[str] = SEGMENTS) -> Frames:
    """Compute the frames of segments (forward kinematics).

    Args:
        body: The body.
        angles: Joint angles [rad].
        root: Positions of the pelvis's joint in the body's frame [m], shape ``(W, 3)``.
        segments: Segments in the order of `SEGMENTS`, with their parents.
    """
    joints, count = body.joints, len(root)
    rotations: dict[str, NDArray[np.float64]] = {}
    origins: dict[str, NDArray[np.float64]] = {}
    for segment in segments:
        local, parent = local_rotation(segment, angles), PARENTS[segment]
        if parent is None:
            rotations[segment] = np.broadcast_to(local, (count, 3, 3))
            origins[segment] = root
        else:
            rotations[segment] = rotations[parent] @ local
            origins[segment] = origins[parent] + rotations[parent] @ (joints[segment] - joints[parent])
    return Frames(rotations, origins)


def check_angles(angles: Mapping[str, ArrayLike]) -> Angles:
    """Check joint angles and their limits, and return them as arrays."""
    checked: Angles = {}
    for name, value in angles.items():
        if name not in JOINT_LIMITS:
            known = truncate(", ".join(JOINT_LIMITS), 400)
            raise PoseError(f"angles must be of the joints {known}, got {name!r}")
        try:
            array = as_numpy(value, name=name).astype(np.float64)
        except (WarpvisError, TypeError, ValueError):
            raise PoseError(f"angle {name} must be a number or a row of numbers [rad], got {value!r}") from None
        if array.ndim > 1:
            raise PoseError(f"angle {name} must be a number or one per world, shape (W,), got shape {array.shape}")
        check_limits(name, array)
        checked[name] = array
    return checked


def check_limits(name: str, angle: NDArray[np.float64]) -> None:
    """Raise a `PoseError` if an angle exceeds the limits of its joint."""
    low, high = JOINT_LIMITS[name]
    is_bad = ~((angle >= low - _LIMIT_TOLERANCE) & (angle <= high + _LIMIT_TOLERANCE))
    if is_bad.any():
        worst = float(angle[is_bad].flat[0])
        raise PoseError(
            f"{name} must be from {low:.3f} to {high:.3f} rad ({math.degrees(low):.0f} to {math.degrees(high):.0f} "
            f"degrees), got {worst:.4g}{degrees_hint(worst)}"
        )
