# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Geoms and sites of a model in one numbering: geoms have their ids, and sites follow them.

MuJoCo draws sites like geoms, after them (`mjv_addGeoms` in src/engine/engine_vis_visualize.c). Skins, flexes and
tendons, which have no pose, have the numbers after the sites.
"""

from __future__ import annotations

from typing import Any

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

GEOM, SITE, UNKNOWN = (int(getattr(mujoco.mjtObj, f"mjOBJ_{name}")) for name in ("GEOM", "SITE", "UNKNOWN"))
_SKIN, _FLEX, _TENDON = (int(getattr(mujoco.mjtObj, f"mjOBJ_{name}")) for name in ("SKIN", "FLEX", "TENDON"))

DEFAULT_COLOR = (0.5, 0.5, 0.5, 1.0)
"""A geom that has a material and this color takes the material's color (`setMaterial` in engine_vis_visualize.c)."""


def shape_count(model: mujoco.MjModel) -> int:
    """Return the number of geoms and sites."""
    return int(model.ngeom + model.nsite)


def shape_value(model: mujoco.MjModel, name: str, shape: int) -> Any:
    """Return the current value of a shape's field, ``geom_<name>`` or ``site_<name>``."""
    if shape < model.ngeom:
        return getattr(model, f"geom_{name}")[shape]
    return getattr(model, f"site_{name}")[shape - model.ngeom]


def shape_data(model: mujoco.MjModel, shape: int) -> int:
    """Return the id of a shape's mesh or height field; -1 for none."""
    return int(model.geom_dataid[shape]) if shape < model.ngeom else -1


def shape_bodies(model: mujoco.MjModel) -> NDArray[np.int32]:
    """Return the body id of every shape, ``(shapes,)``."""
    return np.concatenate([model.geom_bodyid, model.site_bodyid])


def shape_meaning(model: mujoco.MjModel, shape: int) -> tuple[int, int]:
    """Return the id and `mujoco.mjtObj` of a shape."""
    return (shape, GEOM) if shape < model.ngeom else (shape - int(model.ngeom), SITE)


def shape_places(data: mujoco.MjData) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Copy the poses of all shapes: positions [m], ``(shapes, 3)``, and rotations, ``(shapes, 9)``."""
    return np.concatenate([data.geom_xpos, data.site_xpos]), np.concatenate([data.geom_xmat, data.site_xmat])


def drawn_number(model: mujoco.MjModel, kind: int, index: int) -> int | None:
    """Return the number in `object_names` of a visual element, a `mujoco.mjtObj` and an id; None for decorations."""
    first = 0
    for known, count in _counts(model).items():
        if kind == known:
            return first + index
        first += count
    return None


def object_names(model: mujoco.MjModel) -> list[str]:
    """Return unique names of all visual elements: geoms, sites, skins, flexes and tendons."""
    names = [model.geom(geom).name for geom in range(model.ngeom)]
    taken, last = {name for name in names if name}, dict.fromkeys(range(model.nbody), -1)
    for geom, body in enumerate(model.geom_bodyid.tolist()):
        while not names[geom]:
            last[body] += 1
            name = (model.body(body).name or f"body_{body}") + (f"_{last[body]}" if last[body] else "")
            if name not in taken:
                names[geom] = name
                taken.add(name)
    for kind, count in _counts(model).items():
        if kind == GEOM:
            continue
        for index in range(count):
            names.append(free_name(_own_name(model, kind, index), taken))
            taken.add(names[-1])
    return names


def free_name(preferred: str, taken: set[str]) -> str:
    """Return `preferred`, with ``_1``, ``_2``, ... appended if it is taken."""
    name, number = preferred, 0
    while name in taken:
        number += 1
        name = f"{preferred}_{number}"
    return name


def _own_name(model: mujoco.MjModel, kind: int, index: int) -> str:
    found = mujoco.mj_id2name(model, kind, index)
    if found:
        return str(found)
    if kind == SITE:
        body = int(model.site_bodyid[index])
        return (model.body(body).name or f"body_{body}") + "_site"
    return f"{mujoco.mju_type2Str(kind)}_{index}"


def _counts(model: mujoco.MjModel) -> dict[int, int]:
    """Return the numbers of visual elements by type, in order."""
    counts = (model.ngeom, model.nsite, model.nskin, model.nflex, model.ntendon)
    return dict(zip((GEOM, SITE, _SKIN, _FLEX, _TENDON), map(int, counts), strict=True))
