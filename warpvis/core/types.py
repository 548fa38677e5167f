# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Types of arguments, for signatures and type checkers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol, TypeAlias

import warp as wp
from numpy.typing import ArrayLike

DeviceLike = wp.Device | str | None
"""A device or its name: ``"cpu"``, ``"cuda:0"``, ...; None for Warp's current one."""


class SupportsDLPack(Protocol):
    """An array of any library on any device that supports the DLPack protocol."""

    def __dlpack__(self, *, stream: int | None = None) -> object:
        """Export the array as a DLPack capsule."""

    def __dlpack_device__(self) -> tuple[int, int]:
        """Return the type and the index of the device."""


ArrayInput = ArrayLike | SupportsDLPack | wp.array
"""An array of Warp, NumPy, PyTorch, JAX, ..., or nested lists of numbers."""

PoseLike = ArrayInput
"""Rows ``x y z qx qy qz qw``, ``(V, 7)`` or ``(7,)``; matrices, ``(V, 4, 4)`` or ``(4, 4)``; transforms of Warp."""

ObjectPoses = ArrayInput | None
"""Rows ``x y z qx qy qz qw`` of the movable objects, ``(W, M, 7)`` or ``(M, 7)``; None for their initial poses."""

ObjectScales = ArrayInput | None
"""Scale factors along the axes of the movable objects, ``(W, M, 3)`` or ``(M, 3)``; None for their initial sizes."""

Excluded = str | Sequence[str | int] | ArrayInput | None
"""Names or indices of objects, or flags of shape ``(V, objects)``."""


class HasMesh(Protocol):
    """A triangle mesh, such as a `trimesh.Trimesh`."""

    @property
    def vertices(self) -> ArrayLike:
        """Vertices [m], shape ``(n, 3)``."""

    @property
    def faces(self) -> ArrayLike:
        """Vertex indices of the triangles, shape ``(m, 3)``."""


MeshLike = HasMesh | tuple[ArrayLike, ArrayLike]
"""A mesh, or the pair of its vertices and faces."""

KernelArguments = Sequence[object]
"""Arguments of a kernel launch: arrays, structs and numbers."""

Json: TypeAlias = "bool | int | float | str | Sequence[Json] | Mapping[str, Json] | None"
"""A JSON value."""
