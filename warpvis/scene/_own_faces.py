# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Which triangle of its object's own mesh each triangle of a scene is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

if TYPE_CHECKING:
    from warpvis.scene._bvh import Bvh


def own_faces(owner: NDArray[np.int32]) -> NDArray[np.int32]:
    """Count the triangles of each object from 0, whose triangles follow each other in its own order.

    Args:
        owner: The triangles' objects, shape ``(m,)``.
    """
    starts = np.flatnonzero(np.diff(owner, prepend=-1))
    counts = np.diff(starts, append=len(owner))
    return (np.arange(len(owner)) - np.repeat(starts, counts)).astype(np.int32)


def slot_faces(trees: Sequence[Bvh], owners: Sequence[NDArray[np.int32]], device: wp.Device) -> wp.array:
    """Say of each place in trees' leaves, one tree after the other, which triangle of its object is there; -1 for none.

    Args:
        trees: The trees, of the host or of a device.
        owners: Of each tree, the objects of the triangles that it was made of.
        device: Where the array is to be.
    """
    parts = []
    for tree, owner in zip(trees, owners, strict=True):
        triangles = tree.triangles.numpy()
        parts.append(np.where(triangles < 0, np.int32(-1), own_faces(owner)[triangles]))
    return wp.array(np.concatenate(parts), dtype=wp.int32, device=device)
