# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""References of ``kernels/visibility/margins.py`` and ``nearest_pixels.py``: samples and pixels in double precision."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from reference_fractions import find_window
from reference_silhouettes import Alone

from warpvis import Camera, Scene
from warpvis.core.poses import poses_to_matrices


@dataclass
class Margin:
    """A margin, and its values for each pair of a sample and a pixel at the deciding distance: at most 1e-6 px more."""

    pixels: float
    degrees: NDArray[np.float64]
    meters: NDArray[np.float64]
    blocker: NDArray[np.int64]


def bound_depth_tiles(depth: NDArray, side: int) -> NDArray:
    """Return the least and greatest value of each square tile of an image, ``(rows, columns, 2)``."""
    rows, columns = (-(-size // side) for size in depth.shape)
    parts = [[depth[side * y :, side * x :][:side, :side] for x in range(columns)] for y in range(rows)]
    return np.array([[(part.min(), part.max()) for part in row] for row in parts])


def measure_margins(
    scene: Scene, camera: Camera, pose: NDArray, members: list[int], *, reach: float, least: int
) -> Margin:
    """Return the margin of a target at the poses of the scene."""
    import reference

    across, x0, y0, x1, y1 = find_window(scene, camera, pose, members, (math.ceil(reach),) * 4, least)
    if not across:
        return _none(-reach)
    x, y = (np.stack(np.meshgrid(np.arange(x0, x1), np.arange(y0, y1))) + 0.5).reshape(2, -1) / across
    rays = _rays(camera, x, y)
    depth = np.full(len(x), np.inf)
    for index in members:
        depth = np.minimum(depth, reference.cast_ray_table(Alone((scene.objects[index],)), rays[None], pose).depth[0])
    if not np.isfinite(depth).any():
        canvas = math.ceil(reach)
        is_whole = (x0, y0, x1, y1) == (-canvas, -canvas, camera.width + canvas, camera.height + canvas)
        overlaps = x1 > 0 and y1 > 0 and x0 < camera.width * across and y0 < camera.height * across
        return _none(math.nan if overlaps and not is_whole else -reach)
    keep = np.isfinite(depth) & (depth >= camera.near) & (depth <= camera.far)
    x, y, depth, rays = x[keep], y[keep], depth[keep], rays[keep]
    shown = reference.cast_ray_table(scene, rays[None], pose)
    in_image = (x >= 0) & (y >= 0) & (x < camera.width) & (y < camera.height)
    surface, hidden_by = shown.depth[0], shown.objects[0]
    is_visible = in_image & (np.isin(hidden_by, members) | (surface >= depth))
    hidden_by = np.where(in_image, hidden_by, -1)
    return _decide(scene, camera, pose, members, reach, (x, y, depth), (surface, hidden_by), is_visible)


judge_margins = measure_margins


def measure_point_margins(
    scene: Scene, camera: Camera, pose: NDArray, point: NDArray, *, reach: float, tolerance: float
) -> Margin:
    """Return the margin of a point at the poses of the scene."""
    import reference

    to_camera = np.linalg.inv(poses_to_matrices(np.asarray(pose, dtype=np.float32)).astype(np.float64))
    place = to_camera[:3, :3] @ np.asarray(point, dtype=np.float32).astype(np.float64) + to_camera[:3, 3]
    if not camera.near <= place[2] <= camera.far or place[2] <= 0:
        return _none(-reach)
    ray = place / place[2]
    x, y = ray[:1] * camera.fx + camera.cx, ray[1:2] * camera.fy + camera.cy
    in_image = (x >= 0) & (y >= 0) & (x < camera.width) & (y < camera.height)
    shown = reference.cast_ray_table(scene, ray[None, None], pose)
    surface, shown_object = shown.depth[0], shown.objects[0]
    allowed = tolerance / np.linalg.norm(ray)
    is_visible = in_image & (surface >= place[2] - allowed)
    on_surface = abs(surface[0] - place[2]) <= allowed
    owner = [int(shown_object[0])] if on_surface else []
    spot = x, y, np.array([place[2] - allowed])
    hidden_by = np.where(in_image, shown_object, -1)
    return _decide(scene, camera, pose, owner, reach, spot, (surface, hidden_by), is_visible)


def _none(pixels: float) -> Margin:
    infinite = np.array([math.copysign(math.inf, pixels) if pixels == pixels else pixels])
    return Margin(pixels, infinite, infinite, np.array([-1]))


def _rays(camera: Camera, x: NDArray, y: NDArray) -> NDArray:
    return np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)


def _decide(
    scene: Scene,
    camera: Camera,
    pose: NDArray,
    members: list[int],
    reach: float,
    spots: tuple[NDArray, NDArray, NDArray],
    hiding: tuple[NDArray, NDArray],
    is_visible: NDArray,
) -> Margin:
    """Return the margin of spots, of which the visible ones decide if there are any."""
    import reference

    sign = 1 if is_visible.any() else -1
    chosen = is_visible if is_visible.any() else np.ones_like(is_visible)
    x, y, depth = (values[chosen] for values in spots)
    surface, hidden_by = (values[chosen] for values in hiding)
    columns, rows = (np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height))) + 0.5).reshape(2, -1)
    image = reference.cast_ray_table(scene, _rays(camera, columns, rows)[None], pose)
    other = ~np.isin(image.objects[0], members)
    pairs = []
    for k in range(len(x)):
        nearer = image.depth[0] < depth[k]
        sought = np.flatnonzero(nearer & other if sign > 0 else ~nearer)
        u, v, number = columns[sought], rows[sought], sought
        if sign > 0:  # the border, half a pixel outside
            u = np.concatenate([u, [-0.5, camera.width + 0.5, x[k], x[k]]])
            v = np.concatenate([v, [y[k], y[k], -0.5, camera.height + 0.5]])
            number = np.concatenate([number, [-1] * 4])
        distance = np.hypot(u - x[k], v - y[k])
        nearest = distance.min(initial=np.inf)
        pairs += [(k, *pair) for pair in zip(u, v, number, distance, strict=True) if pair[3] <= nearest + 1e-6]
        if nearest > reach:
            pairs.append((k, x[k], y[k], -1, np.inf))
    if not pairs:
        return _none(-reach)
    found = np.array(pairs)
    nearest = np.full(len(x), np.inf)
    np.minimum.at(nearest, found[:, 0].astype(int), found[:, 4])
    best = nearest.max() if sign > 0 else nearest.min()
    if best > reach:
        return _none(sign * reach)
    found = found[(abs(found[:, 4] - best) <= 1e-6) & (nearest[found[:, 0].astype(int)] >= best - 1e-6)]
    k, number = found[:, 0].astype(int), found[:, 3].astype(int)
    p, q = _rays(camera, x[k], y[k]), _rays(camera, found[:, 1], found[:, 2])
    cosine = (p * q).sum(axis=1) / np.linalg.norm(p, axis=1) / np.linalg.norm(q, axis=1)
    if sign > 0:
        blocker = np.where(number >= 0, image.objects[0][number], -1)
        moving = np.where(number >= 0, image.depth[0][number], depth[k])
    else:
        blocker = hidden_by[k]
        moving = np.where(blocker >= 0, surface[k], depth[k])
    meters = moving * np.linalg.norm(p - q, axis=1)
    degrees = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return Margin(sign * float(best), sign * degrees, sign * meters, blocker)
