# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Evaluation of the supported settings of a `mujoco.MjvOption`."""

from __future__ import annotations

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np

from warpvis.errors import SceneError
from warpvis.mujoco._geoms import DEFAULT_GROUPS

_STATIC = int(mujoco.mjtVisFlag.mjVIS_STATIC)
_HULLS = int(mujoco.mjtVisFlag.mjVIS_CONVEXHULL)


# Flags that only change the appearance of geoms, sites, skins, flexes and tendons, or what other flags draw.
_ADD_NOTHING = (
    "CONVEXHULL",
    "TEXTURE",
    "ACTIVATION",
    "TENDON",
    "RANGEFINDER",
    "SCLINERTIA",
    "PERTOBJ",
    "ISLAND",
    "CONTACTSPLIT",
    "TRANSPARENT",
    "STATIC",
    "SKIN",
    "FLEXVERT",
    "FLEXEDGE",
    "FLEXFACE",
    "FLEXSKIN",
)
_ADDING = [
    int(flag)
    for name, flag in mujoco.mjtVisFlag.__members__.items()
    if name.removeprefix("mjVIS_") not in _ADD_NOTHING and name.startswith("mjVIS_")
]


def asks_for_more(option: mujoco.MjvOption) -> bool:
    """Return whether options enable visual elements that MuJoCo does not draw by default."""
    return option.frame != mujoco.mjtFrame.mjFRAME_NONE or bool(option.flags[_ADDING].any())


def shown_by(option: mujoco.MjvOption | None) -> tuple[tuple[int, ...], bool, tuple[int, ...]]:
    """Return the shown groups of geoms, whether geoms welded to the world are shown, and the shown groups of sites.

    Raises:
        SceneError: If `option` is not a `mujoco.MjvOption`, or enables convex hulls.
    """
    if option is None:
        return DEFAULT_GROUPS, True, DEFAULT_GROUPS
    if not isinstance(option, mujoco.MjvOption):
        raise SceneError(f"scene_option must be a mujoco.MjvOption, got {type(option).__name__}")
    if option.flags[_HULLS]:
        raise SceneError("scene_option must not enable convex hulls (mjVIS_CONVEXHULL), which are not rendered")
    groups, sites = (tuple(np.flatnonzero(shown).tolist()) for shown in (option.geomgroup, option.sitegroup))
    return groups, bool(option.flags[_STATIC]), sites
