# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of ``kernels/visibility/fractions.py`` in double precision: every sample is cast against all surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from reference_silhouettes import Alone

from warpvis import Camera, Scene, Visibility
from warpvis.core.poses import poses_to_matrices
from warpvis.scene.worlds import pose_columns


@dataclass
class Samples:
    """States of the samples of a target, on a grid that includes all of them and a border."""

    across: int
    x0: int
    y0: int
    silhouette: NDArray[np.bool_]
    visible: NDArray[np.bool_]
    in_image: NDArray[np.bool_]
    near: NDArray[np.bool_]
    far: NDArray[np.bool_]
    occluder: NDArray[np.int64]


def find_window(
    scene: Scene, camera: Camera, pose: NDArray, members: list[int], canvas: tuple[int, int, int, int], least: int
) -> tuple[int, int, int, int, int]:
    """Return samples across a pixel, and the first and end sample in x and y that the boxes of objects may cover."""
    left, top, right, bottom = canvas
    ends = -left, -top, camera.width + right, camera.height + bottom
    to_camera = np.linalg.inv(poses_to_matrices(np.asarray(pose, dtype=np.float32)).astype(np.float64))
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    columns = pose_columns(scene)
    for index in members:
        own = np.asarray(scene.objects[index].frame_vertices, dtype=np.float64)
        box = np.stack([own.min(axis=0), own.max(axis=0)])
        corners = np.stack(np.meshgrid(*box.T, indexing="ij"), axis=-1).reshape(-1, 3)
        if columns[index] >= 0:
            carrier = scene.objects[scene.movable[columns[index]]]
            place = poses_to_matrices(np.asarray(carrier.pose, dtype=np.float32)).astype(np.float64)
            corners = corners @ place[:3, :3].T + place[:3, 3]
        seen = corners @ to_camera[:3, :3].T + to_camera[:3, 3]
        ahead = seen[:, 2] > 0
        if ahead.any() and not ahead.all():
            return (1, *ends)
        if ahead.all():
            at = seen[:, :2] / seen[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
            low, high = np.minimum(low, at.min(axis=0)), np.maximum(high, at.max(axis=0))
    low, high = np.maximum(low, ends[:2]), np.minimum(high, ends[2:])
    if (low > high).any():
        return 0, 0, 0, 0, 0
    across = 1
    while across < 63 and np.prod((high - low) * across + 1) < least:
        across += 2
    first = np.maximum(np.floor(low * across) - 1, np.array(ends[:2]) * across).astype(int)
    end = np.minimum(np.ceil(high * across) + 1, np.array(ends[2:]) * across).astype(int)
    return across, *map(int, first), *map(int, end)


def measure_fractions(
    scene: Scene,
    camera: Camera,
    pose: NDArray,
    members: list[int],
    *,
    canvas: tuple[int, int, int, int],
    least: int,
    near_plane: str = "occlude",
) -> Samples | None:
    """Return the states of a target's samples; None if it cannot be on the canvas."""
    import reference

    plane = {"near": camera.near if near_plane == "clip" else 0.0, "near_plane": near_plane}

    across, x0, y0, x1, y1 = find_window(scene, camera, pose, members, canvas, least)
    if not across:
        return None
    x, y = np.meshgrid(np.arange(x0 - 1, x1 + 1), np.arange(y0 - 1, y1 + 1))
    rays = np.ones((*x.shape, 3))
    rays[..., 0] = ((x + 0.5) / across - camera.cx) / camera.fx
    rays[..., 1] = ((y + 0.5) / across - camera.cy) / camera.fy
    depth = np.full(x.shape, np.inf)
    for index in members:
        depth = np.minimum(depth, reference.cast_ray_table(Alone((scene.objects[index],)), rays, pose, **plane).depth)
    depth[(x < x0) | (x >= x1) | (y < y0) | (y >= y1)] = np.inf
    silhouette = np.isfinite(depth)
    in_image = silhouette & (x >= 0) & (y >= 0) & (x < camera.width * across) & (y < camera.height * across)
    near, far = in_image & (depth < camera.near), in_image & (depth > camera.far)
    shown = reference.cast_ray_table(scene, rays, pose, **plane)
    is_open = np.isin(shown.objects, members) | (shown.depth >= depth)
    visible = in_image & ~near & ~far & is_open
    return Samples(across, x0 - 1, y0 - 1, silhouette, visible, in_image, near, far, shown.objects)


measure_fractions_packets = measure_fractions_packets_cuda = measure_fractions


def _edges(states: NDArray) -> int:
    return int((states[1:] != states[:-1]).sum() + (states[:, 1:] != states[:, :-1]).sum())


def judge_fractions(samples: Samples | None, camera: Camera, occluders: int) -> dict[str, Any]:
    """Return the results of a target from its samples."""
    if samples is None:
        samples = Samples(0, 0, 0, *np.zeros((5, 1, 1), dtype=bool), np.full((1, 1), -1))
    across, whole, visible = samples.across, int(samples.silhouette.sum()), int(samples.visible.sum())
    hidden = samples.in_image & ~samples.visible & ~samples.near & ~samples.far
    fraction = visible / whole if whole else 0.0
    doubt = _edges(samples.silhouette + 1 * samples.visible) / 2, _edges(samples.silhouette) / 2
    certain = whole - doubt[1]
    error = (doubt[0] + doubt[1] * fraction) / certain if certain > 0 else float(across > 0)
    y, x = np.nonzero(samples.visible)
    x, y = (x + samples.x0) // max(across, 1), (y + samples.y0) // max(across, 1)
    box = [int(x.min()), int(y.min()), int(np.ptp(x)) + 1, int(np.ptp(y)) + 1] if len(x) else [-1] * 4
    counts = {
        Visibility.OCCLUDED: int(hidden.sum()),
        Visibility.TOO_NEAR: int(samples.near.sum()),
        Visibility.TOO_FAR: int(samples.far.sum()),
    }
    status = max(counts, key=lambda reason: counts[reason]) if max(counts.values()) else Visibility.OUT_OF_VIEW
    by = np.bincount(samples.occluder[hidden], minlength=1)
    order = [index for index in np.lexsort((np.arange(len(by)), -by)) if by[index] > 0][:occluders]
    order += [-1] * (occluders - len(order))
    shares = [by[index] / whole if index >= 0 else 0.0 for index in order]

    def at_centers(mask: NDArray[np.bool_]) -> int:
        rows, columns = np.nonzero(mask)
        middle = across // 2
        is_center = ((columns + samples.x0) % across == middle) & ((rows + samples.y0) % across == middle)
        return int(is_center.sum())

    return {
        "fraction": fraction,
        "error": min(error, 1.0),
        "image_share": visible / (across**2 * camera.width * camera.height) if across else 0.0,
        "status": Visibility.VISIBLE if visible else status,
        "box": box,
        "visible_pixels": at_centers(samples.visible) if across else 0,
        "silhouette_pixels": at_centers(samples.silhouette) if across else 0,
        "occluders": order,
        "occluder_shares": shares,
    }
