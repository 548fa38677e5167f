# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Objects that moved, vanished or appeared, from the labels of compared depth images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.core.checks import as_items, is_whole
from warpvis.core.labels import Label
from warpvis.errors import SceneError
from warpvis.kernels.constants import DEPTH_AGREES, DEPTH_FARTHER, DEPTH_NEARER, DEPTH_NO_SURFACE
from warpvis.scene import Scene

ChangeKind: TypeAlias = Literal["present", "moved", "vanished", "appeared", "unknown"]

# Fraction of the measured pixels of an object that are farther than expected, from which on it is a suspect.
_SUSPICIOUS = 0.02

# Fraction of an object's pixels where it or space behind it was seen that must be farther if it has vanished.
_VANISHED = 0.5

# Minimum number of pixels with the same label in the 3 x 3 pixels about a pixel of a cluster.
_NEIGHBORS = 5

# Boxes contain the points between these percentiles along each axis.
_PERCENTILES = 2.0, 98.0

# Maximum ratio of the sides of a cluster and of the object that it is, beyond the gap of clusters; maximum ratio of the
# diagonals of the object and of the cluster, which has no pixels at edges; and maximum cost of points at the new place.
_GROWTH, _LOSS, _MAX_COST = 1.4, 2.5, 0.5

# Largest coordinate of a grid cell: its number must be a 64-bit integer.
_MAX_CELL = 2e6

# Number of points of an object for the refinement of its displacement, steps of the search [m], and the increase of the
# mean cost at which the weight of a displacement is divided by e.
_REFINED_POINTS, _REFINED_STEPS, _COST_SCALE = 300, (0.02, 0.008, 0.004), 0.005

# Smallest displacement [px].
_MIN_SHIFT = 2.0


@dataclass(frozen=True)
class SceneChange:
    """What happened to an object of a scene, or a thing that the scene does not have. Vectors are in the world [m]."""

    kind: ChangeKind
    """``"present"`` at its place; ``"moved"``; ``"vanished"``; ``"appeared"``, a thing that the scene does not have; or
    ``"unknown"``: too few pixels are measured, or it is hidden by something new."""
    name: str
    """Name of the object, empty for something else."""
    object: int
    """Its index in the scene, or -1."""
    position: tuple[float, float, float] | None
    """Center of the bounding box of the visible points, for a moved object at its new place; None without any."""
    extent: tuple[float, float, float] | None
    """Size of that box, which contains 96 % of the points along each axis."""
    displacement: tuple[float, float, float] | None
    """Displacement of a moved object, from the centers of the visible points before and after; None for others."""
    pixels: int
    """Number of its pixels that are decisive: those that agree for a present object, those of the cluster for one that
    moved or appeared, those that are farther for one that vanished, and those that were measured for an unknown one."""

    def __str__(self) -> str:
        words = [self.kind, repr(self.name) if self.name else "something"]
        if self.position is not None:
            words.append("at ({:.2f}, {:.2f}, {:.2f}) m".format(*self.position))
        if self.displacement is not None:
            words.append("by ({:+.2f}, {:+.2f}, {:+.2f}) m".format(*self.displacement))
        return " ".join([*words, f"({self.pixels} px)"])


@dataclass(frozen=True, eq=False)
class Evidence:
    """Compared images in host memory, shape ``(V, H, W)``."""

    scene: Scene
    camera: ImageCamera
    matrices: NDArray[np.float64]  # camera to world, shape ``(V, 4, 4)``
    depth: NDArray[np.float32]  # measured
    labels: NDArray[np.uint8]
    expected: NDArray[np.float32]
    segmentation: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class _Cluster:
    """Points that belong together."""

    center: NDArray[np.float64]
    extent: NDArray[np.float64]
    pixels: int
    pixel_size: float  # mean size of its pixels in the world [m]

    def fields(self) -> dict[str, object]:
        return {"position": _triple(self.center), "extent": _triple(self.extent), "pixels": self.pixels}


def choose_candidates(scene: Scene, objects: Sequence[str | int] | None) -> list[int]:
    """Return the ascending indices of objects given by name or index, or of those that are no ground or obstacle."""
    if objects is None:
        return [
            index
            for index, item in enumerate(scene.objects)
            if item.label > Label.OBSTACLE and item.label not in scene.ground_labels
        ]
    chosen = set()
    for item in as_items(objects, "objects", SceneError):
        if isinstance(item, str):
            chosen.add(scene.index(item))
        elif is_whole(item) and 0 <= item < len(scene):
            chosen.add(int(item))
        else:
            raise SceneError(f"objects must be names, or indices from 0 to {len(scene) - 1}, got {item!r}")
    return sorted(chosen)


def find_changes(
    evidence: Evidence,
    without: Callable[[Sequence[int]], Evidence],
    candidates: Sequence[int],
    *,
    min_pixels: int,
    gap: float,
    displacements: tuple[float, float],
) -> list[SceneChange]:
    """Return the changes, see `DepthComparison.changes`; `without` compares with the scene without some objects."""
    counts = _count(evidence, len(evidence.scene))
    suspects = []
    for index in candidates:
        agrees, nearer, farther = (int(counts[index, label]) for label in (DEPTH_AGREES, DEPTH_NEARER, DEPTH_FARTHER))
        measured = agrees + nearer + farther
        if measured >= min_pixels and (farther >= _SUSPICIOUS * measured or agrees < min_pixels):
            suspects.append(index)
    rest = without(suspects) if suspects else evidence
    was_suspect = np.isin(evidence.segmentation, suspects)
    # Behind a suspect, the scene may have no surface: there, only what is not behind the suspect is known to be new.
    unmodeled = (rest.labels == DEPTH_NO_SURFACE) & was_suspect & (evidence.labels != DEPTH_FARTHER)
    novel = (rest.labels == DEPTH_NEARER) | unmodeled
    appeared = _clusters(evidence, evidence.depth, novel, min_pixels, gap)
    before = {index: _box(evidence, evidence.segmentation == index) for index in candidates}
    matches = _match(evidence, before, suspects, appeared, gap, displacements[1])

    changes = []
    for index in candidates:
        place = before[index]
        agrees, farther = int(counts[index, DEPTH_AGREES]), int(counts[index, DEPTH_FARTHER])
        seen = agrees + farther
        kind: ChangeKind = "present" if agrees >= max(min_pixels, _VANISHED * seen) else "unknown"
        fields: dict[str, object] = {"position": None, "extent": None} if place is None else place.fields()
        pixels, displacement = agrees if kind == "present" else int(counts[index].sum()), None
        if index in matches:
            cluster, shift = matches[index]
            kind, fields, pixels = "present", cluster.fields(), cluster.pixels
            if np.linalg.norm(shift) > max(displacements[0], _MIN_SHIFT * cluster.pixel_size):
                kind, displacement = "moved", _triple(shift)
        elif index in suspects:
            if seen >= min_pixels and farther >= _VANISHED * seen:
                kind, pixels = "vanished", farther
        changes.append(_change(kind, evidence.scene, index, {**fields, "pixels": pixels}, displacement))
    taken = {id(cluster) for cluster, _ in matches.values()}
    changes += [_change("appeared", None, -1, cluster.fields()) for cluster in appeared if id(cluster) not in taken]
    gone = (rest.labels == DEPTH_FARTHER) & ~was_suspect
    vanished_things = _clusters(evidence, rest.expected, gone, min_pixels, gap)
    return changes + [_change("vanished", None, -1, cluster.fields()) for cluster in vanished_things]


def _change(
    kind: ChangeKind,
    scene: Scene | None,
    index: int,
    fields: dict[str, object],
    displacement: tuple[float, float, float] | None = None,
) -> SceneChange:
    name = "" if scene is None else scene.objects[index].name
    return SceneChange(kind, name, index, displacement=displacement, **fields)  # type: ignore[arg-type]


def _count(evidence: Evidence, objects: int) -> NDArray[np.int64]:
    """Return the number of measured pixels of each object with each label, shape ``(objects, 5)``."""
    valid = (evidence.segmentation >= 0) & (evidence.labels > 0)
    keys = evidence.segmentation[valid].astype(np.int64) * 5 + evidence.labels[valid]
    return np.bincount(keys, minlength=5 * objects).reshape(objects, 5)


def _match(
    evidence: Evidence,
    before: dict[int, _Cluster | None],
    suspects: Sequence[int],
    clusters: Sequence[_Cluster],
    gap: float,
    max_displacement: float,
) -> dict[int, tuple[_Cluster, NDArray[np.float64]]]:
    """Return the cluster and the displacement of each suspect that moved: pairs with the smallest distances first."""
    pairs = []
    for index in suspects:
        place = before[index]
        for number, cluster in enumerate(clusters if place is not None else ()):
            assert place is not None  # for type checkers
            distance = float(np.linalg.norm(cluster.center - place.center))
            fits = (cluster.extent <= _GROWTH * place.extent + gap).all()
            lost = np.linalg.norm(place.extent) > _LOSS * np.linalg.norm(cluster.extent)
            if distance <= max_displacement and fits and not lost:
                pairs.append((distance, index, number, cluster.center - place.center))
    found: dict[int, tuple[_Cluster, NDArray[np.float64]]] = {}
    taken: set[int] = set()
    for _, index, number, first in sorted(pairs, key=lambda pair: pair[:3]):
        if index not in found and number not in taken:
            shift, cost = _refine(evidence, index, first, gap)
            if cost <= _MAX_COST:
                found[index] = clusters[number], shift
                taken.add(number)
    return found


def _refine(
    evidence: Evidence, index: int, shift: NDArray[np.float64], gap: float
) -> tuple[NDArray[np.float64], float]:
    """Return the displacement at which an object's visible points match measured depth best, near a first one, and the
    cost.

    The bounding box of a cluster is too small where the sensor lost pixels at edges. Here, points at lost pixels do not
    count, and points beside the moved object see the background. The cost of a point is the squared error of depth,
    limited to `gap`; the result is a mean weighted by cost, the middle where several displacements match equally.
    """
    visible = np.equal(evidence.segmentation, index)
    _, points, _ = _world_points(evidence, evidence.expected, visible)
    points = points[:: max(1, len(points) // _REFINED_POINTS)]
    camera, size = evidence.camera, np.array([evidence.camera.width, evidence.camera.height])
    for step in _REFINED_STEPS:
        grid = np.stack(np.meshgrid(*[np.arange(-3, 4) * step] * 3, indexing="ij"), axis=-1).reshape(-1, 3) + shift
        costs, counts = np.zeros(len(grid)), np.zeros(len(grid))
        for view in np.flatnonzero(visible.any(axis=(1, 2))):
            rotation, origin = evidence.matrices[view, :3, :3], evidence.matrices[view, :3, 3]
            local = (grid[:, None] + points - origin) @ rotation
            pixels = camera.project(local)
            depth = local[..., 2] if camera.kind == "z" else np.linalg.norm(local, axis=-1)
            inside = ((pixels >= 0) & (pixels < size)).all(axis=-1) & (depth > 0)
            x, y = np.moveaxis(np.where(inside[..., None], pixels, 0).astype(np.intp), -1, 0)
            measured = inside & (evidence.labels[view, y, x] > 0)
            error = np.where(measured, np.abs(evidence.depth[view, y, x] - depth), 0.0)
            costs += (np.minimum(error / gap, 1.0) ** 2).sum(axis=1)
            counts += measured.sum(axis=1)
        costs /= np.maximum(counts, 1)
        weights = np.exp((costs.min() - costs) / _COST_SCALE) * (counts >= counts.max() / 2)
        shift = weights @ grid / weights.sum()
    return shift, float(costs.min())


def _clusters(
    evidence: Evidence, depth: NDArray[np.float32], mask: NDArray[np.bool_], min_pixels: int, gap: float
) -> list[_Cluster]:
    """Return clusters of the world points of pixels, the largest first, without single pixels and small clusters."""
    padded = np.pad(mask, ((0, 0), (1, 1), (1, 1))).astype(np.uint8)
    rows = padded[:, :-2] + padded[:, 1:-1] + padded[:, 2:]
    dense = mask & (rows[..., :-2] + rows[..., 1:-1] + rows[..., 2:] >= _NEIGHBORS)
    if not dense.any():
        return []
    views, points, sizes = _world_points(evidence, depth, dense)
    cells = np.floor((points - points.min(axis=0)) / gap).clip(max=_MAX_CELL)
    labels = _connect(cells.astype(np.int64))
    found = []
    for label in np.flatnonzero(np.bincount(labels) >= min_pixels):
        member = labels == label
        if np.bincount(views[member]).max() >= min_pixels:
            found.append(_bound(points[member], sizes[member]))
    return sorted(found, key=lambda cluster: -cluster.pixels)


def _box(evidence: Evidence, mask: NDArray[np.bool_]) -> _Cluster | None:
    """Return the box of the expected points of pixels; None without pixels."""
    if not mask.any():
        return None
    _, points, sizes = _world_points(evidence, evidence.expected, mask)
    return _bound(points, sizes)


def _bound(points: NDArray[np.float64], sizes: NDArray[np.float64]) -> _Cluster:
    low, high = np.percentile(points, _PERCENTILES, axis=0)
    return _Cluster((low + high) / 2, high - low, len(points), float(sizes.mean()))


def _world_points(
    evidence: Evidence, depth: NDArray[np.float32], mask: NDArray[np.bool_]
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
    """Return the views of pixels, shape ``(N,)``, their points in the world, ``(N, 3)``, and their sizes there [m]."""
    views, y, x = np.nonzero(mask)
    rays = evidence.camera.depth_rays(np.stack([x, y], axis=-1) + 0.5)
    local = rays * depth[mask][:, None]
    points = np.einsum("nij,nj->ni", evidence.matrices[views, :3, :3], local) + evidence.matrices[views, :3, 3]
    finite = np.isfinite(points).all(axis=1)
    sizes = depth[mask] * float(np.mean(evidence.camera.pixel_size()))
    return views[finite], points[finite], sizes[finite]


def _connect(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the number of the connected component of each point, from its grid cell, shape ``(N, 3)``, from 0 up.

    Cells are connected to their 26 neighbors.
    """
    _, depth, height = cells.max(axis=0) + 3  # a margin, so that neighbors of the last cell are not in the next row
    keys, owner = np.unique((cells[:, 0] * depth + cells[:, 1]) * height + cells[:, 2], return_inverse=True)
    offsets = [(x * depth + y) * height + z for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
    firsts, seconds = [], []
    for offset in offsets[:13]:
        place = np.searchsorted(keys, keys + offset).clip(max=len(keys) - 1)
        linked = np.flatnonzero(keys[place] == keys + offset)
        firsts.append(linked)
        seconds.append(place[linked])
    first, second = np.concatenate(firsts), np.concatenate(seconds)
    roots = np.arange(len(keys))
    while True:
        smaller = np.minimum(roots[first], roots[second])
        merged = roots.copy()
        for ends in (first, second):
            np.minimum.at(merged, roots[ends], smaller)
        merged = merged[merged]
        if np.array_equal(merged, roots):
            return np.unique(roots, return_inverse=True)[1][owner]
        roots = merged


def _triple(vector: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z
