# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes of files: their floor, where a person can stand, and horizontal surfaces on which an object can stand."""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.rays import Rays
from warpvis.core.labels import LabelPatterns, LabelRules
from warpvis.core.types import DeviceLike
from warpvis.errors import SceneError
from warpvis.planning import boxes_meet_triangles, corners_of, inside_solids, standing_room
from warpvis.rendering import Renderer
from warpvis.scene import Scene
from warpvis.scene.joints import JointTree
from warpvis.situations._stage_items import NAMES, ROBOT, TALL
from warpvis.situations.rooms._walkable import largest_area

Floats = NDArray[np.float64]

CELL = 0.05
"""Distance between the vertical rays that find surfaces [m]."""
_STRIDE = 2
"""Standing places are tried at every second ray in both directions."""
_MAX_HALF = 12.0
"""Half the side of the square of a scene that is searched [m]."""
_MARGIN = 1.0
"""Floor around the objects that is searched [m]."""
_MAX_LAYERS = 64
_STEP = 1e-3
"""Distance below a surface from which the next one is searched [m]."""
_LEVEL = math.cos(math.radians(5))
"""Cosine of the largest slope of a horizontal surface."""
_FLAT = 0.05
"""Objects of a smaller height do not count for the extent of a scene [m]: floors and rugs."""
WALK_RADIUS, WALK_HEIGHT = 0.3, 1.9
"""Size of a walking person [m]."""
STAND_HEIGHT = 2.15
"""Free height at standing places [m], which are also places of cameras."""
_SILL = 0.03
"""Height above the floor up to which geometry is no obstacle to a person [m]."""
_FLOOR_TOLERANCE = 0.01
_MIN_FLOOR = 1.0
"""Least area of a floor [m2]."""
_FLOOR_SHARE = 0.6
"""The lowest level with this share of the area of the largest one is the floor: the largest may be a roof."""
SUPPORT_HEIGHTS = 0.3, 1.6
"""Heights of supports above the floor [m]."""
_MIN_GAP = 0.08
"""Free height above a support [m]."""
_REACH = 1.5
"""Supports that are farther from all standing places, along x or y, are not used [m]."""
LIFT = 5e-4
"""Height of objects above the support that they are put on [m]."""
_GAP = 2e-3
"""Distance of objects from all other surfaces [m]."""
_UNEVEN = 4e-3
"""Largest unevenness of a support below an object [m]."""
_PROBE = 0.02
_TAKEN = re.compile(rf"({'|'.join((*NAMES, ROBOT))}|camera)(/.*)?|(thing|blocker|{TALL})_\d+")
"""Names of what situations add to a scene."""


class _Hits(NamedTuple):
    """Horizontal surfaces along vertical rays, from top to bottom."""

    ray: NDArray[np.int64]
    """Index of the ray, shape ``(n,)``."""
    z: Floats
    """Height [m]."""
    gap: Floats
    """Free height above the surface [m]."""
    item: NDArray[np.int64]
    """Index of the object."""
    upward: NDArray[np.bool_]
    """Whether it is the first surface of its ray, or its triangle faces up."""


class FileScene:
    """The scene of a file in the frame of the file, z up."""

    def __init__(self, path: str) -> None:
        """Load the file; search for the floor and for surfaces.

        Raises:
            FileFormatError: If the file is missing or cannot be read.
            SceneError: If there is no floor that a person can stand on, or no support next to it.
        """
        self.path = path
        found = Scene.read_parts(path)
        for message in found.warnings:
            warnings.warn(message, stacklevel=2)
        self.scene = Scene(up="z")
        """The scene in the frame of the file."""
        self.scene.use_labels(found.classes)
        loaded = found.objects("z", labels=LabelPatterns({}, self.scene.label_names))
        lights, background = found.environment("z")
        renamed = [replace(part, name=f"file/{part.name}") if _TAKEN.fullmatch(part.name) else part for part in loaded]
        upright = replace(found, parts=renamed, lights=lights, background=background, joints=JointTree())
        self._parts = replace(upright, up="z", defines_frame=False)
        self.scene.add_parts(self._parts, LabelRules())
        objects = self.scene.objects
        self._corners = corners_of(self.scene, [item.vertices for item in objects], range(len(objects)))
        self._first = np.cumsum([0, *(len(item.faces) for item in objects)])
        self._find_surfaces()

    def build(self, device: DeviceLike, shift: Floats) -> Scene:
        """Return a new scene of the file, with a shift of everything [m], shape ``(3,)``."""
        scene = Scene(device=device, up="z")
        parts = []
        for part in self._parts.parts:
            pose = np.array([0, 0, 0, 0, 0, 0, 1.0]) if part.pose is None else np.array(part.pose, dtype=np.float64)
            place = pose[:3] if pose.shape == (7,) else pose[:3, 3]
            place += shift
            parts.append(replace(part, pose=pose))
        lights = tuple(
            replace(light, position=tuple((np.array(light.position) + shift).tolist())) for light in self._parts.lights
        )
        scene.add_parts(replace(self._parts, parts=parts, lights=lights), LabelRules())
        return scene

    def overlaps(self, low: Floats, yaw: Floats, size: Floats) -> NDArray[np.bool_]:
        """Return which upright boxes overlap a surface, or are inside a solid, shape ``(n,)``.

        Args:
            low: Centers of their lower sides [m], shape ``(n, 3)``.
            yaw: Their rotations about z [rad], shape ``(n,)``.
            size: Sides of all of them [m], shape ``(3,)``.
        """
        if not len(low):
            return np.zeros(0, dtype=np.bool_)
        axes = np.zeros((len(low), 3, 3))
        axes[:, 0, 0] = axes[:, 1, 1] = np.cos(yaw)
        axes[:, 1, 0], axes[:, 0, 1], axes[:, 2, 2] = np.sin(yaw), -np.sin(yaw), 1
        halves = np.array([size[0] / 2 + _GAP, size[1] / 2 + _GAP, size[2] / 2])
        centers = low + [0, 0, size[2] / 2 + LIFT]
        met = boxes_meet_triangles(centers, axes, halves, self._corners)
        inside = inside_solids(self.scene, centers.astype(np.float32))
        return np.logical_or(met, inside)

    def is_supported(self, low: Floats, yaw: Floats, size: Floats) -> NDArray[np.bool_]:
        """Return which boxes stand on a horizontal surface with all of their lower side; arguments as `overlaps`."""
        if not len(low):
            return np.zeros(0, dtype=np.bool_)
        u, v = np.meshgrid(np.linspace(-0.5, 0.5, 5) * size[0], np.linspace(-0.5, 0.5, 5) * size[1])
        u, v = u.ravel(), v.ravel()
        c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
        points = np.stack([low[:, :1] + c * u - s * v, low[:, 1:2] + s * u + c * v, np.zeros((len(low), len(u)))], -1)
        points[..., 2] = low[:, 2:] + _PROBE
        depth, _, slope, _ = self._cast(points.reshape(-1, 3))
        rests = (np.abs(depth - _PROBE) <= _UNEVEN) & (slope >= _LEVEL)
        return np.logical_and.reduce(rests.reshape(len(low), -1), axis=1)

    def has_room(self, points: Floats, radius: float, height: float = STAND_HEIGHT) -> NDArray[np.bool_]:
        """Return whether an upright cylinder fits at points of the floor [m], ``(n, 3)``; shape ``(n,)``."""
        if not len(points):
            return np.zeros(0, dtype=np.bool_)
        poses = np.zeros((len(points), 7))
        poses[:, :3], poses[:, 6] = points + [0, 0, height], 1
        return standing_room(self.scene, poses, radius=radius, floor=self.floor, step=_SILL)

    def on_floor(self, points: Floats) -> NDArray[np.bool_]:
        """Return whether there is floor around points [m], shape ``(n, 3)``, within the radius of a person."""
        column, row = np.round((points[:, :2] - self._origin) / CELL).astype(int).T
        rows, columns = self._walkable.shape
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        return inside & self._walkable[row.clip(0, rows - 1), column.clip(0, columns - 1)]

    def _find_surfaces(self) -> None:
        """Find the floor, the standing places and the supports."""
        xs, ys = self._grid()
        self._origin = np.array([xs[0], ys[0]])
        shape = len(ys), len(xs)
        grid = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
        hits = self._horizontal_hits(grid)
        self.floor = self._floor_height(hits)
        """Height of the floor [m]."""
        is_floor = np.abs(hits.z - self.floor) <= _FLOOR_TOLERANCE
        self.floor_items = frozenset(hits.item[is_floor].tolist())
        """Indices of the objects with surfaces at the height of the floor."""
        mask = np.zeros(shape, dtype=np.bool_)
        mask.flat[hits.ray[is_floor]] = True
        self._walkable = _eroded(mask, WALK_RADIUS)
        coarse = self._walkable[::_STRIDE, ::_STRIDE]
        spots = np.column_stack(
            [grid.reshape(*shape, 2)[::_STRIDE, ::_STRIDE][coarse], np.full(int(coarse.sum()), self.floor)]
        )
        free = np.zeros_like(coarse)
        free[coarse] = self.has_room(spots, WALK_RADIUS, WALK_HEIGHT)
        free = largest_area(free)
        self.standing = spots[free[coarse]]
        """Where a person can stand, in one connected area [m], shape ``(n, 3)``."""
        if len(self.standing) * (CELL * _STRIDE) ** 2 < _MIN_FLOOR:
            raise SceneError(
                f"{self.path}: must have a floor with at least {_MIN_FLOOR:g} m2 where a person can stand, got "
                f"{len(self.standing) * (CELL * _STRIDE) ** 2:.2g} m2 at a height of {self.floor:.2f} m"
            )
        low, high = SUPPORT_HEIGHTS
        height = hits.z - self.floor
        chosen = (height >= low) & (height <= high) & hits.upward & (hits.gap >= _MIN_GAP)
        row, column = np.divmod(hits.ray, shape[1])
        chosen &= _grown(free, round(_REACH / (CELL * _STRIDE)))[row // _STRIDE, column // _STRIDE]
        self.supports = np.column_stack([grid[hits.ray[chosen]], hits.z[chosen]])
        """Points of horizontal surfaces next to standing places [m], shape ``(n, 3)``."""
        self.support_items = hits.item[chosen]
        """Indices of their objects, shape ``(n,)``."""

    def _grid(self) -> tuple[Floats, Floats]:
        """Return the x and y of the vertical rays [m]."""
        bounds = np.array([item.bounds for item in self.scene.objects], dtype=np.float64)
        ground = np.array([item.label in self.scene.ground_labels for item in self.scene.objects])
        tall = ~ground & (bounds[:, 1, 2] - bounds[:, 0, 2] >= _FLAT)
        if not tall.any():
            raise SceneError(f"{self.path}: must have a floor and furniture, got flat objects only")
        everything = bounds[:, 0, :2].min(axis=0), bounds[:, 1, :2].max(axis=0)
        middle = np.median(bounds[tall].mean(axis=1)[:, :2], axis=0)
        low = np.maximum(np.maximum(bounds[tall, 0, :2].min(axis=0) - _MARGIN, everything[0]), middle - _MAX_HALF)
        high = np.minimum(np.minimum(bounds[tall, 1, :2].max(axis=0) + _MARGIN, everything[1]), middle + _MAX_HALF)
        # An irrational offset: rays do not run along the edges of triangles at round coordinates.
        xs, ys = (np.arange(a + CELL * (math.pi - 3), b, CELL) for a, b in zip(low, high, strict=True))
        if not len(xs) or not len(ys):
            raise SceneError(f"{self.path}: must have a floor, got a scene of {high[0] - low[0]:.3g} m x "
                             f"{high[1] - low[1]:.3g} m")  # fmt: skip
        return xs, ys

    def _horizontal_hits(self, grid: Floats) -> _Hits:
        """Return the horizontal surfaces along vertical rays at ``x y`` [m], shape ``(n, 2)``."""
        top = float(self._corners[..., 2].max()) + 1
        rays, start, above = np.arange(len(grid)), np.full(len(grid), top), np.full(len(grid), np.inf)
        found = []
        for _ in range(_MAX_LAYERS):
            depth, item, slope, upward = self._cast(np.column_stack([grid[rays], start]))
            hit = np.isfinite(depth)
            rays, item, slope, upward = rays[hit], item[hit], slope[hit], upward[hit]
            z, above = start[hit] - depth[hit], above[hit]
            if not len(rays):
                break
            level = slope >= _LEVEL
            first = ~np.isfinite(above)
            rows = rays[level], z[level], (above - z)[level], item[level], (upward | first)[level]
            found.append(rows)
            start, above = z - _STEP, z
        return _Hits(*(np.concatenate(column) for column in zip(*found, strict=True)))

    def _cast(self, points: Floats) -> tuple[Floats, NDArray[np.int64], Floats, NDArray[np.bool_]]:
        """Cast rays downward from points [m], shape ``(n, 3)``.

        Returns:
            Distances to the first surfaces [m], +inf without one; the indices of their objects; the cosines of their
            slopes; and whether their triangles face up; shape ``(n,)`` each.
        """
        pattern = Rays(np.tile([0.0, 0.0, -1.0], (len(points), 1)), points)
        renderer = Renderer(self.scene, pattern, outputs=("depth", "segmentation", "faces"))
        views = renderer.render(np.array([[0, 0, 0, 0, 0, 0, 1.0]]))
        depth = views.depth.numpy()[0].astype(np.float64)
        item, face = (image.numpy()[0].astype(np.int64) for image in (views.segmentation, views.faces))
        corners = self._corners[np.where(item < 0, 0, self._first[item] + face)].astype(np.float64)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        slope = normal[:, 2] / np.maximum(np.linalg.norm(normal, axis=1), 1e-30)
        return depth, item, np.abs(slope), slope > 0

    def _floor_height(self, hits: _Hits) -> float:
        """Return the height of the floor: the largest level where a person can stand, of ground if any is labeled."""
        tall = hits.gap >= WALK_HEIGHT
        ground = np.array([item.label in self.scene.ground_labels for item in self.scene.objects])[hits.item] & tall
        chosen = ground if ground.sum() * CELL**2 >= _MIN_FLOOR else tall
        if not chosen.any():
            raise SceneError(f"{self.path}: must have a floor with {WALK_HEIGHT:g} m of free height, got none")
        heights = hits.z[chosen]
        bins = np.floor((heights - heights.min()) / _FLOOR_TOLERANCE).astype(int)
        counts = np.bincount(bins, minlength=bins.max() + 2)
        pairs = counts[:-1] + counts[1:]  # a level may be at the limit between two bins
        level = int(np.flatnonzero(pairs >= _FLOOR_SHARE * pairs.max())[0])
        return float(np.median(heights[(bins == level) | (bins == level + 1)]))


def _eroded(mask: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """Return the cells whose neighbors within a radius [m] are all set; cells outside of the grid are not."""
    reach = math.ceil(radius / CELL)
    padded = np.pad(mask, reach)
    found = np.ones_like(mask)
    for down in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            if (down * down + right * right) * CELL**2 <= radius**2:
                rows, columns = slice(reach + down, None), slice(reach + right, None)
                found &= padded[rows, columns][: mask.shape[0], : mask.shape[1]]
    return found


def _grown(mask: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Return the cells with a set cell at most `reach` rows and columns away."""
    sums = np.pad(np.pad(mask.astype(np.int64), reach).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    side = 2 * reach + 1
    found: NDArray[np.bool_] = sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side] > 0
    return found
