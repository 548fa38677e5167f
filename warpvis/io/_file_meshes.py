# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What readers of mesh files give, in the file's own frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.scene.lights import Light
from warpvis.scene.looks import Look


class FileMesh(NamedTuple):
    """The triangles of a mesh where the file has it, or a mesh that others have too and where it is."""

    name: str
    """Empty if the file does not name it. Of glTF its node's, or else its mesh's, and the primitive's number if there
    are several."""
    vertices: NDArray[np.float64]
    """Shape ``(n, 3)``."""
    faces: NDArray[np.integer]
    extras: dict[str, Any]
    """What the file says of it besides."""
    row: NDArray[np.float64] | None = None
    """Mesh to file, ``x y z qx qy qz qw``; None if its vertices are in the file's frame."""
    shares_movable: bool = True
    """Whether one that may move shares its vertices, too, and begins there; else one that stays does."""
    look: Look | None = None
    """What it looks like, if the file says it."""


@dataclass
class FileMeshes:
    """What a file holds."""

    meshes: list[FileMesh] = field(default_factory=list)
    empty: list[str] = field(default_factory=list)
    """Names of what has no triangles."""
    notes: list[str] = field(default_factory=list)
    """What else is left out, as parts of a sentence."""
    lights: list[Light] = field(default_factory=list)
    unlit: list[str] = field(default_factory=list)
    """Which lights do not read, and why, as parts of a sentence: no error, whatever is wanted of the rest."""
    up: str | None = None
    """The file's vertical axis, if its format or the file says it."""
