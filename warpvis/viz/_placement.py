# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of places for cameras, from above and over time."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import check_length
from warpvis.core.checks import check_text, format_percent
from warpvis.core.poses import check_up, poses_to_matrices
from warpvis.errors import ArrayError
from warpvis.planning import Placement
from warpvis.scene import Scene, require_scene
from warpvis.viz._drawing import draw_arrow, draw_name
from warpvis.viz._figures import new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Objects with more triangles are drawn as the box of their corners.
_MAX_TRIANGLES = 5000
# Maximum number of cells of the map.
_MAX_CELLS = 10**7
_ARROW = 0.05  # length relative to the map
_BEHIND = 12.0  # distance of a name behind its camera [pt]


def save_placement(
    scene: Scene, placement: Placement, path: str | os.PathLike[str], *, cell_size: float = 0.1, title: str = ""
) -> None:
    """Write a picture of a placement: the map from above, the share that each camera adds, and the share over time.

    Cells of the map show the share of worlds in which their targets are seen by enough cameras, as the mean of the
    targets by weight. Static objects that are not ground are gray.

    Args:
        scene: The scene.
        placement: Result of `warpvis.planning.place_cameras`.
        path: Picture to write.
        cell_size: Side of a cell [m].
        title: Title of the map; by default, the share of targets and worlds that enough cameras see.
    """
    require_scene(scene)
    if not isinstance(placement, Placement):
        raise ArrayError(f"placement must be a result of planning.place_cameras, got {type(placement).__name__}")
    check_text(title, "title")
    cell_size = check_length(cell_size, "cell_size", zero=False)
    vertical = check_up(scene.up)
    axes = [(vertical + 1) % 3, (vertical + 2) % 3]
    shares, bounds = _map_shares(placement, axes, cell_size)
    figure = new_figure(10, 5.2, gap=0.08)
    panels: dict[str, Axes] = figure.subplot_mosaic([["map", "cameras"], ["map", "worlds"]], width_ratios=[1.75, 1])
    below = f"at least {placement.at_least} cameras see" if placement.at_least > 1 else "a camera sees"
    image = panels["map"].imshow(
        shares, origin="lower", extent=bounds, cmap="viridis", vmin=0, vmax=1, interpolation="nearest"
    )
    figure.colorbar(
        image, ax=panels["map"], location="bottom", shrink=0.7, label=f"share of worlds in which {below} it"
    )
    _draw_objects(panels["map"], scene, axes)
    panels["map"].autoscale_view()
    _draw_cameras(panels["map"], placement, axes, max(bounds[1] - bounds[0], bounds[3] - bounds[2]))
    names = "xyz"
    panels["map"].set(
        title=title or f"{format_percent(placement.covered_fraction, digits=1)} of targets and worlds are seen",
        xlabel=f"{names[axes[0]]} [m]",
        ylabel=f"{names[axes[1]]} [m]",
    )
    _draw_gains(panels["cameras"], placement)
    by_world = placement.share_by_world()
    panels["worlds"].plot(by_world, color="C0", drawstyle="steps-mid", marker="o" if len(by_world) == 1 else None)
    panels["worlds"].set(title=f"Targets that {below}", xlabel="world", ylabel="share", ylim=(0, 1.02))
    save_figure(figure, path)


def _map_shares(
    placement: Placement, axes: list[int], cell_size: float
) -> tuple[NDArray[np.float64], tuple[float, float, float, float]]:
    """Return the mean share of the targets in each cell, NaN without targets, shape ``(rows, columns)``, and its extent
    [m].
    """
    places = placement.points[:, axes].astype(np.float64)
    low = np.floor(places.min(axis=0) / cell_size)
    size = np.floor(places.max(axis=0) / cell_size) - low + 1
    if not size.prod() <= _MAX_CELLS:
        raise ArrayError(f"cell_size must give at most {_MAX_CELLS:g} cells, got {size.prod():.3g}; use larger cells")
    columns, rows = size.astype(int).tolist()
    column, row = (np.floor(places / cell_size) - low).astype(int).T
    cell = row * columns + column
    total = np.bincount(cell, placement.weights, minlength=rows * columns)
    share = np.bincount(cell, placement.weights * placement.share_by_target(), minlength=rows * columns)
    with np.errstate(invalid="ignore"):
        shares = (share / total).reshape(rows, columns)
    (left, bottom), (right, top) = low * cell_size, (low + size) * cell_size
    return shares, (float(left), float(right), float(bottom), float(top))


def _draw_objects(axes: Axes, scene: Scene, floor: list[int]) -> None:
    """Draw static objects that are not ground, from above."""
    from matplotlib.collections import PolyCollection

    outlines: list[NDArray[np.float32]] = []
    for item in scene.objects:
        if item.movable or item.label in scene.ground_labels:
            continue
        corners = item.vertices[:, floor]
        if item.triangle_count <= _MAX_TRIANGLES:
            outlines.extend(corners[item.faces])
        else:
            (left, bottom), (right, top) = corners.min(axis=0), corners.max(axis=0)
            outlines.append(np.array([(left, bottom), (right, bottom), (right, top), (left, top)]))
    axes.add_collection(PolyCollection(outlines, facecolor="0.75", edgecolor="0.75", linewidth=0.3))


def _draw_cameras(axes: Axes, placement: Placement, floor: list[int], extent: float) -> None:
    """Draw positions and viewing directions: chosen cameras with their ranks, fixed ones without."""
    chosen = [(pose, str(rank)) for rank, pose in enumerate(placement.poses, start=1)]
    for pose, name in [*((pose, "") for pose in placement.fixed_poses), *chosen]:
        place, forward = pose[floor], poses_to_matrices(pose)[floor, 2]
        ahead = forward / max(float(np.linalg.norm(forward)), 1e-9)
        draw_arrow(axes, place, place + _ARROW * extent * ahead)
        axes.plot(*place, "o", color="C1" if name else "0.4", markeredgecolor="black", markersize=7)
        if name:
            draw_name(axes, name, place, (-_BEHIND * ahead[0], -_BEHIND * ahead[1]), "center", "center")
    for low, high, limit in ((*axes.get_xlim(), axes.set_xlim), (*axes.get_ylim(), axes.set_ylim)):
        limit(low - _ARROW * (high - low), high + _ARROW * (high - low))


def _draw_gains(axes: Axes, placement: Placement) -> None:
    """Draw the objective by the number of chosen cameras, and its bound."""
    reached = placement.fixed_share + np.concatenate([[0.0], np.cumsum(placement.gains)])
    numbers = np.arange(len(reached))
    axes.plot(numbers, reached, "o-", color="C1", label=f"{placement.method} choice: {placement.fraction:.3f}")
    axes.axhline(placement.bound, color="black", linestyle="--", label=f"upper bound: {placement.bound:.3f}")
    axes.set(title="Objective", xlabel="chosen cameras", ylabel="share", ylim=(0, 1.02))
    axes.set_xticks(numbers if len(numbers) <= 12 else numbers[:: len(numbers) // 8])
    axes.legend(loc="upper left" if placement.bound < 0.5 else "lower right", frameon=False)
