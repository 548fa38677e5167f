# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of COLLADA that trimesh's reader ignores: the unit, the axes, and skinned meshes."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

_AXES = {
    "X_UP": [(0, -1, 0), (1, 0, 0), (0, 0, 1)],
    "Y_UP": [(1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "Z_UP": [(1, 0, 0), (0, 0, 1), (0, -1, 0)],
}
_MAX_CONTROLLERS = 10
"""Maximum depth of nested controllers, such as a skin of a morphed mesh."""


def frame_of(file: bytes) -> NDArray[np.float64]:
    """Return the matrix from the axes and the unit of a COLLADA file to meters with y up, shape ``(3, 3)``."""
    meters, axis = unit_and_axis(file)
    return meters * np.array(_AXES[axis], dtype=np.float64)


def unit_and_axis(file: bytes) -> tuple[float, str]:
    """Read the unit of a COLLADA file [m], and the axis that points up: ``"X_UP"``, ``"Y_UP"`` or ``"Z_UP"``."""
    head = file.partition(b"</asset>")[0]
    unit = re.search(rb"""<unit\b[^>]*\bmeter\s*=\s*["']([^"']*)["']""", head)
    axis = re.search(rb"<up_axis>\s*(\w+)\s*</up_axis>", head)
    meters = float(unit[1]) if unit else 1.0
    if not 0 < meters < np.inf:
        raise ValueError(f"the unit must be above zero, got {meters:g} m")
    name = axis[1].decode() if axis else "Y_UP"
    return meters, name if name in _AXES else "Y_UP"


def without_skins(file: bytes) -> bytes:
    """Replace instances of controllers by instances of the meshes that they deform, in their rest shape.

    Webots reads meshes without their bones (``WbMesh.cpp``; the Open Asset Import Library leaves the vertices of a
    skinned mesh as listed in the file, at the node that holds the instance), so its range finders see this shape.
    """
    if b"instance_controller" not in file:
        return file
    root = ElementTree.fromstring(file)
    space = root.tag.partition("}")[0] + "}" if root.tag.startswith("{") else ""
    sources: dict[str, str] = {}
    for controller in root.iter(f"{space}controller"):
        for kind in ("skin", "morph"):
            moved = controller.find(f"{space}{kind}")
            if moved is not None:
                sources[f"#{controller.get('id')}"] = moved.get("source", "")
    for instance in root.iter(f"{space}instance_controller"):
        instance.tag = f"{space}instance_geometry"
        url = instance.get("url", "")
        for _ in range(_MAX_CONTROLLERS):
            url = sources.get(url, url)
        instance.set("url", url)
    for library in root.findall(f"{space}library_controllers"):
        root.remove(library)
    return ElementTree.tostring(root)
