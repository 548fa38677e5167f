# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Sizes of human bodies by stature, from published tables.

Lengths between joints are fractions of the stature H of Drillis and Contini (Body Segment Parameters, New York
University 1966; figure 4.1 of Winter, Biomechanics and Motor Control of Human Movement, 2009). Everything else is the
ratio of two means of ANSUR II (Gordon et al., 2012 Anthropometric Survey of U.S. Army Personnel, NATICK/TR-15/007,
public data of 4,082 men and 1,986 women), with the survey's name of the measurement.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import check_choice, is_number
from warpvis.errors import SceneError

Sex = Literal["average", "male", "female"]
"""Proportions of men, of women, or the mean of both."""

# Drillis and Contini: heights of joints above the sole, and lengths, relative to the stature.
ANKLE_HEIGHT, KNEE_HEIGHT, HIP_HEIGHT, SHOULDER_HEIGHT = 0.039, 0.285, 0.530, 0.818
UPPER_ARM, FOREARM, HAND = 0.186, 0.146, 0.108
CHIN_HEIGHT = 0.870

# ANSUR II: mean measurement / mean stature, of men and of women.
_RATIOS = {
    "eye_height": (0.9352, 0.9331),  # stature - sittingheight + eyeheightsitting
    "sitting_height": (0.5229, 0.5260),
    "interpupillary_breadth": (0.03645, 0.03789),
    "head_length": (0.1136, 0.1166),
    "head_breadth": (0.0879, 0.0907),
    "top_of_head_to_tragion": (0.0747, 0.0777),
    "neck_circumference": (0.2264, 0.2025),
    "cervicale_height": (0.8640, 0.8570),
    "biacromial_breadth": (0.2367, 0.2244),
    "bideltoid_breadth": (0.2906, 0.2765),
    "chest_breadth": (0.1648, 0.1654),
    "chest_depth": (0.1445, 0.1519),
    "waist_breadth": (0.1859, 0.1842),
    "waist_depth": (0.1354, 0.1308),
    "iliocristale_height": (0.6045, 0.6114),
    "crotch_height": (0.4817, 0.4804),
    "hip_breadth": (0.1969, 0.2173),
    "buttock_depth": (0.1400, 0.1430),
    "thigh_circumference": (0.3560, 0.3784),
    "lower_thigh_circumference": (0.2331, 0.2461),
    "calf_circumference": (0.2234, 0.2292),
    "ankle_circumference": (0.1306, 0.1325),
    "biceps_circumference": (0.2039, 0.1876),
    "forearm_circumference": (0.1765, 0.1622),
    "wrist_circumference": (0.1002, 0.0951),
    "hand_breadth": (0.0503, 0.0480),
    "foot_length": (0.1544, 0.1512),
    "foot_breadth": (0.0580, 0.0569),
    "grip_center": (0.0462, 0.0469),  # forearmcenterofgriplength - radialestylionlength
}

# Measurements that grow with the build: breadths, depths and girths of the trunk and the limbs.
_SOFT = (
    "neck_circumference bideltoid_breadth chest_breadth chest_depth waist_breadth waist_depth hip_breadth "
    "buttock_depth thigh_circumference lower_thigh_circumference calf_circumference ankle_circumference "
    "biceps_circumference forearm_circumference wrist_circumference"
).split()

# ANSUR II: stature [m] by percentile, of men and of women.
_PERCENTILES = (1, 5, 10, 25, 50, 75, 90, 95, 99)
_STATURES = {
    "male": (1.602, 1.648, 1.669, 1.710, 1.755, 1.802, 1.844, 1.870, 1.927),
    "female": (1.483, 1.525, 1.547, 1.586, 1.626, 1.672, 1.713, 1.740, 1.778),
}

MIN_HEIGHT, MAX_HEIGHT = 1.2, 2.3
MIN_BUILD, MAX_BUILD = 0.8, 1.3

SIDES = ("left", "right")


def stature(percentile: float, sex: Sex = "average") -> float:
    """Return the stature [m] of a percentile of adults, from 1 to 99, interpolated linearly in the table of ANSUR II.

    Args:
        percentile: Percentage of adults that are shorter.
        sex: Whose statures; ``"average"`` is the mean of both.
    """
    if not is_number(percentile) or not 1 <= percentile <= 99:
        hint = ""
        if is_number(percentile) and 0 < percentile < 1:
            hint = f"; pass {100 * percentile:g} for the fraction {percentile:g}"
        raise SceneError(f"percentile must be from 1 to 99 percent, got {percentile!r}{hint}")
    check_choice(sex, "sex", ("average", "male", "female"), SceneError)
    of_sex = _STATURES.values() if sex == "average" else (_STATURES[sex],)
    return float(np.mean([np.interp(percentile, _PERCENTILES, row) for row in of_sex]))


@dataclass(frozen=True)
class Body:
    """The size of a person: the measurements that a skeleton and its segments are made from."""

    height: float = 1.69
    """Stature, barefoot [m], from 1.2 to 2.3; the proportions are those of adults."""
    sex: Sex = "average"
    """Whose proportions: ``"male"``, ``"female"``, or the mean of both."""
    build: float = 1.0
    """Factor of the breadths, depths and girths of trunk, neck and limbs, from 0.8 (slender) to 1.3 (stout)."""

    def __post_init__(self) -> None:
        if not is_number(self.height) or not MIN_HEIGHT <= self.height <= MAX_HEIGHT:
            hint = ""
            for unit, factor in (("cm", 100.0), ("mm", 1000.0)):
                if is_number(self.height) and MIN_HEIGHT <= self.height / factor <= MAX_HEIGHT:
                    hint = f"; pass {self.height / factor:g} for {self.height:g} {unit}"
            raise SceneError(f"height must be from {MIN_HEIGHT} to {MAX_HEIGHT} m, got {self.height!r}{hint}")
        check_choice(self.sex, "sex", ("average", "male", "female"), SceneError)
        if not is_number(self.build) or not MIN_BUILD <= self.build <= MAX_BUILD:
            hint = ""
            if is_number(self.build) and MIN_BUILD <= self.build / 100 <= MAX_BUILD:
                hint = f"; it is a factor: pass {self.build / 100:g} for {self.build:g} %"
            raise SceneError(f"build must be from {MIN_BUILD} to {MAX_BUILD}, got {self.build!r}{hint}")

    def measurement(self, name: str) -> float:
        """Return a measurement of ANSUR II for this body [m], such as ``"head_length"`` or ``"waist_breadth"``."""
        check_choice(name, "name", _RATIOS, SceneError)
        male, female = _RATIOS[name]
        ratio = {"male": male, "female": female, "average": (male + female) / 2}[self.sex]
        return self.height * ratio * (self.build if name in _SOFT else 1.0)

    @property
    def eye_height(self) -> float:
        """Height of the eyes above the floor while standing upright [m]."""
        return self.measurement("eye_height")

    @property
    def interpupillary_distance(self) -> float:
        """Distance between the centers of the pupils [m]."""
        return self.measurement("interpupillary_breadth")

    def radius(self, name: str) -> float:
        """Return the radius of a girth [m]: of ``"neck"``, ``"thigh"``, ``"calf"``, ..., by its circumference."""
        return self.measurement(f"{name}_circumference") / (2 * math.pi)

    @property
    def thigh_radius(self) -> float:
        """Mean radius of the thigh [m]."""
        return (self.radius("thigh") + self.radius("lower_thigh")) / 2

    @cached_property
    def joints(self) -> Mapping[str, NDArray[np.float64]]:
        """Positions of the joints while standing upright with hanging arms [m]: x forward, y left, z up from the floor.

        The joint of a segment is its proximal end: ``thigh_left`` is the left hip, ``hand_left`` the left wrist.
        """
        h = self.height
        upper_arm = 0.92 * self.radius("biceps")  # the girth is that of a flexed muscle
        shoulder = self.measurement("bideltoid_breadth") / 2 - upper_arm
        hip = self.thigh_radius + 0.001 * h  # thighs do not touch; hip joints are about 0.1 H apart
        # The neck bends near the seventh vertebra and below the skull, the trunk above the iliac crest and the ribs.
        places: dict[str, tuple[float, float, float]] = {
            "pelvis": (0.0, 0.0, HIP_HEIGHT * h),
            "abdomen": (-0.012 * h, 0.0, self.measurement("iliocristale_height")),
            "chest": (-0.016 * h, 0.0, 0.70 * h),
            "neck": (-0.020 * h, 0.0, self.measurement("cervicale_height") - 0.018 * h),
            "head": (-0.006 * h, 0.0, h - self.measurement("top_of_head_to_tragion") - 0.018 * h),
        }
        for side, sign in (("left", 1), ("right", -1)):
            places[f"upper_arm_{side}"] = (-0.010 * h, sign * shoulder, SHOULDER_HEIGHT * h)
            places[f"forearm_{side}"] = (-0.010 * h, sign * shoulder, (SHOULDER_HEIGHT - UPPER_ARM) * h)
            places[f"hand_{side}"] = (-0.010 * h, sign * shoulder, (SHOULDER_HEIGHT - UPPER_ARM - FOREARM) * h)
            places[f"thigh_{side}"] = (0.0, sign * hip, HIP_HEIGHT * h)
            places[f"shank_{side}"] = (0.0, sign * hip, KNEE_HEIGHT * h)
            places[f"foot_{side}"] = (0.0, sign * hip, ANKLE_HEIGHT * h)
        return {name: np.array(place) for name, place in places.items()}

    @cached_property
    def eyes(self) -> NDArray[np.float64]:
        """Midpoint of the pupils while standing upright [m], in the frame of `joints`."""
        center, half_axes = self.head
        z = self.eye_height - center[2]
        y = self.interpupillary_distance / 2
        depth = math.sqrt(max(0.0, 1 - (y / half_axes[1]) ** 2 - (z / half_axes[2]) ** 2))
        return np.array([center[0] + half_axes[0] * depth, 0.0, self.eye_height])

    @property
    def head(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Center and half axes of the head's ellipsoid while standing [m], from the chin to the top."""
        h = self.height
        half = np.array([self.measurement("head_length"), self.measurement("head_breadth"), (1 - CHIN_HEIGHT) * h]) / 2
        return np.array([0.012 * h, 0.0, h * (1 + CHIN_HEIGHT) / 2]), half

    @property
    def grip(self) -> float:
        """Distance from the wrist to the center of the grip [m]."""
        return self.measurement("grip_center")

    @property
    def seat_drop(self) -> float:
        """Height of the hip joints above a seat [m]: sitting height and stature differ by what is below the seat."""
        return self.measurement("sitting_height") - (1 - HIP_HEIGHT) * self.height
