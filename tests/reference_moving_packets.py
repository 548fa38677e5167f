# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of `kernels.casting.moving_tables` and of the search for rays that may hit moving objects."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices


def place_moving_packets(image: NDArray, middle: NDArray, poses: NDArray) -> tuple[NDArray, NDArray]:
    """Return the motion from a pose to others (N, 7) in the coordinates of an image: rotations minus 1, translations.

    The rows of `image` transform points of the sensor's frame.
    """
    relative = np.linalg.inv(poses_to_matrices(middle)) @ poses_to_matrices(poses)
    return image @ relative[:, :3, :3] @ np.linalg.inv(image) - np.eye(3), relative[:, :3, 3] @ image.T


def move_packet_rays(rays: NDArray, origins: NDArray, poses: NDArray) -> tuple[NDArray, NDArray]:
    """Return directions and origins in the world of rays (N, 3) from poses (N, 7)."""
    turns = poses_to_matrices(poses)
    directions, starts = (np.einsum("nij,nj->ni", turns[:, :3, :3], part) for part in (rays, origins))
    return directions, starts + turns[:, :3, 3]


def mark_touched_rays(starts: NDArray, directions: NDArray, centers: NDArray, radii: NDArray) -> NDArray[np.bool_]:
    """Return which spheres, centers (N, objects, 3) at the time of each ray, rays meet, shape (N, objects)."""
    offset, unit = centers - starts[:, None], directions / np.linalg.norm(directions, axis=1, keepdims=True)
    along = np.maximum((offset * unit[:, None]).sum(axis=-1), 0)
    return np.linalg.norm(offset - along[..., None] * unit[:, None], axis=-1) <= radii
