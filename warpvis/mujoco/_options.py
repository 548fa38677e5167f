# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What of a `mujoco.MjvOption` counts here."""

from __future__ import annotations

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np

from warpvis.errors import SceneError
from warpvis.mujoco._geoms import DEFAULT_GROUPS

_STATIC = int(mujoco.mjtVisFlag.mjVIS_STATIC)
_HULLS = int(mujoco.mjtVisFlag.mjVIS_CONVEXHULL)


# What is drawn in MuJoCo's images by flags that are off by default.
_DRAWN = (
    "JOINT",
    "CAMERA",
    "ACTUATOR",
    "LIGHT",
    "CONSTRAINT",
    "INERTIA",
    "PERTFORCE",
    "CONTACTPOINT",
    "CONTACTFORCE",
    "AUTOCONNECT",
    "COM",
    "SELECT",
    "FLEXVERT",
    "FLEXFACE",
    "BODYBVH",
    "MESHBVH",
    "SDFITER",
)


def without_effect(option: mujoco.MjvOption | None) -> list[str]:
    """Name what options ask for that MuJoCo draws, beside what it draws by default, and that is not drawn here."""
    if option is None:
        return []
    flags = {f"mjVIS_{name}": mujoco.mjtVisFlag.__members__.get(f"mjVIS_{name}") for name in _DRAWN}
    found = [name for name, flag in flags.items() if flag is not None and option.flags[int(flag)]]
    return [*found, *(["frame"] if option.frame != mujoco.mjtFrame.mjFRAME_NONE else [])]


def shown_by(option: mujoco.MjvOption | None) -> tuple[tuple[int, ...], bool]:
    """Return the groups of geoms that options show, and whether they show geoms whose body is welded to the world.

    Raises:
        SceneError: They are none, or ask for convex hulls.
    """
    if option is None:
        return DEFAULT_GROUPS, True
    if not isinstance(option, mujoco.MjvOption):
        raise SceneError(f"scene_option must be a mujoco.MjvOption, got {type(option).__name__}")
    if option.flags[_HULLS]:
        raise SceneError("scene_option asks for convex hulls (mjVIS_CONVEXHULL), which are not rendered")
    return tuple(np.flatnonzero(option.geomgroup).tolist()), bool(option.flags[_STATIC])
