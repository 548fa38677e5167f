# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Face indices of a scene's triangles in their objects' meshes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

if TYPE_CHECKING:
    from warpvis.scene.acceleration.bvh import Bvh


def own_faces(owner: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return each triangle's face index in its object's mesh; an object's triangles are consecutive and in order.

    Args:
        owner: The triangles' object indices, shape ``(m,)``.
    """
    starts = np.flatnonzero(np.diff(owner, prepend=-1))
    counts = np.diff(starts, append=len(owner))
    return (np.arange(len(owner)) - np.repeat(starts, counts)).astype(np.int32)


def slot_faces(trees: Sequence[Bvh], owners: Sequence[NDArray[np.int32]], device: wp.Device) -> wp.array:
    """Return the object's face index for each leaf slot of the trees, one tree after the other; -1 for unused slots.

    Args:
        trees: The trees, on the host or a device.
        owners: For each tree, the object indices of the triangles it was built from.
        device: Device of the result.
    """
    parts = []
    for tree, owner in zip(trees, owners, strict=True):
        triangles = tree.triangles.numpy()
        parts.append(np.where(triangles < 0, np.int32(-1), own_faces(owner)[triangles]))
    return wp.array(np.concatenate(parts), dtype=wp.int32, device=device)
