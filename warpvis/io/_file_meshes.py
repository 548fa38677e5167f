# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Results of mesh file readers, in the file's frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.lights import Light


class FileMesh(NamedTuple):
    """A mesh in the file's frame, or a mesh shared with others and its pose."""

    name: str
    """Empty if not defined in the file. For glTF, the name of the node, or else of the mesh, followed by the
    primitive's number if there are several."""
    vertices: NDArray[np.float64]
    """Shape ``(n, 3)``."""
    faces: NDArray[np.integer]
    extras: dict[str, Any]
    """Metadata of the mesh in the file."""
    row: NDArray[np.float64] | None = None
    """Mesh to file, ``x y z qx qy qz qw``; None if its vertices are in the file's frame."""
    shares_movable: bool = True
    """Whether movable objects share its vertices, too, with `row` as their initial pose; if false, only static ones."""
    appearance: LazyAppearance | None = None
    """Its appearance, if defined in the file."""


@dataclass
class FileMeshes:
    """Contents of a mesh file."""

    meshes: list[FileMesh] = field(default_factory=list)
    empty: list[str] = field(default_factory=list)
    """Names of items without triangles."""
    notes: list[str] = field(default_factory=list)
    """Other items that were skipped, as parts of a sentence."""
    lights: list[Light] = field(default_factory=list)
    unlit: list[str] = field(default_factory=list)
    """Lights that cannot be read, and why, as parts of a sentence. Not an error even with ``strict``."""
    up: str | None = None
    """The file's vertical axis, if defined by its format or the file."""
